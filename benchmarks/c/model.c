/* Times one sample of a model that reads and writes all entries of its bus through the blocks of
 * the generated library Bench. Also times the same reads and writes as plain calls of the client
 * library. Both take turns and use the same connection.
 *
 * usage: model BUS SECONDS
 * Prints as JSON the medians of the turns, in ns, and the median of the ratios of neighbouring
 * turns.
 */
#include "Bench.h"
#include "bus.h"
#include "median.h"

#include <unistd.h>

enum { TURN = 100, MOST_TURNS = 200000, MOST_SIGNALS = 10000 };
static const double LEASE = 0.5, SAMPLE_TIME = 0.001;

static struct {
    Bench blocks;
    void *master;
    ecat_t *bus;
    double time;
    int inputs[MOST_SIGNALS], outputs[MOST_SIGNALS], input_count, output_count;
} model;

static void open_model(const char *name)
{
    int i;
    model.master = ecatm_master_open(name, 0, SAMPLE_TIME, 1, LEASE, ECAT_FAILURE_ERROR,
                                     ECAT_FAILURE_ERROR, 0, 0, 0, "");
    model.bus = ((ecatm_master *)model.master)->session.bus;
    Bench_open(&model.blocks, model.master, 1);
    for (i = 0; i < ecat_signal_count(model.bus) && i < MOST_SIGNALS; i++) {
        ecat_signal_info info;
        check(model.bus, ecat_signal(model.bus, i, &info));
        if (info.output)
            model.outputs[model.output_count++] = i;
        else
            model.inputs[model.input_count++] = i;
    }
}

static void blocks(void)
{
    int cycle = ecatm_wait(model.master, model.time += SAMPLE_TIME);
    Bench_read(&model.blocks, model.time, cycle);
    keep(&model.blocks);
    Bench_write(&model.blocks, model.time, cycle);
}

static void plain(void)
{
    static double values[MOST_SIGNALS];
    int i;
    check(model.bus, ecat_sample(model.bus));
    for (i = 0; i < model.input_count; i++)
        (void)ecat_read(model.bus, model.inputs[i], &values[i]);
    keep(values);
    for (i = 0; i < model.output_count; i++)
        check(model.bus, ecat_write(model.bus, model.outputs[i], i & 1));
    check(model.bus, ecat_commit(model.bus));
}

static double turn(void (*work)(void))
{
    double idle = settling(TURN), start = now_ns();
    int i;
    for (i = 0; i < TURN; i++) {
        work();
        settle();
    }
    return (now_ns() - start) / TURN - idle;
}

int main(int count, char **arguments)
{
    static double ours[MOST_TURNS], theirs[MOST_TURNS], ratios[MOST_TURNS];
    double end;
    unsigned n = 0;
    if (count != 3) {
        fprintf(stderr, "usage: model BUS SECONDS\n");
        return 2;
    }
    open_model(arguments[1]);
    end = now_ns() + atof(arguments[2]) * 1e9;
    blocks(); /* claims the outputs */
    do {
        ours[n] = turn(blocks);
        theirs[n] = turn(plain);
        ratios[n] = ours[n] / theirs[n];
        n++;
    } while (n < MOST_TURNS && (now_ns() < end || n < 10));
    printf("{\"reads\": %d, \"writes\": %d, \"model\": %.1f, \"plain\": %.1f, \"ratio\": %.3f, "
           "\"turns\": %u}\n",
           model.input_count, model.output_count, median(ours, n), median(theirs, n),
           median(ratios, n), n);
    Bench_close(&model.blocks);
    ecatm_master_close(model.master);
    return 0;
}
