/* Times a commit, and a whole step of a program: sample, reads, writes, commit.
 *
 * usage: commit BUS SLAVES SECONDS
 * Claims the outputs of the first SLAVES slaves. Prints the medians over all turns as JSON.
 *
 *        commit BUS SLAVES --once
 * Makes 10000 such steps between two calls of getppid(), which mark the steps for strace.
 */
#include "bus.h"
#include "median.h"

#include <string.h>
#include <unistd.h>

enum { READS = 20, WRITES = 4, TURN = 100, STEPS = 10000, MOST_TURNS = 200000 };
static const double LEASE = 0.5;

struct client {
    ecat_t *bus;
    int reads[READS], writes[WRITES];
};

static struct client prepare(const char *name, int slaves)
{
    struct client client;
    int i, found = 0;
    client.bus = open_bus(name);
    for (i = 0; i < slaves; i++)
        check(client.bus, ecat_claim(client.bus, i, LEASE));
    choose(client.bus, client.reads, READS);
    for (i = 0; found < WRITES; i++) {
        ecat_signal_info info;
        check(client.bus, ecat_signal(client.bus, i, &info));
        if (info.output && info.slave < slaves)
            client.writes[found++] = i;
        else if (info.slave >= slaves)
            client.writes[found++] = client.writes[0]; /* there are fewer outputs than WRITES */
    }
    return client;
}

static void take(const struct client *client)
{
    double values[READS];
    int i;
    check(client->bus, ecat_sample(client->bus));
    for (i = 0; i < READS; i++)
        (void)ecat_read(client->bus, client->reads[i], &values[i]);
    keep(values);
}

static void give(const struct client *client)
{
    static int number;
    int i;
    number++;
    for (i = 0; i < WRITES; i++)
        check(client->bus, ecat_write(client->bus, client->writes[i], number & 0x7F));
    check(client->bus, ecat_commit(client->bus));
}

static void measure(const struct client *client, double seconds)
{
    static double commit[MOST_TURNS], step[MOST_TURNS];
    double end = now_ns() + seconds * 1e9, start, between, now, idle;
    unsigned turn;
    int i;
    give(client);
    for (turn = 0, now = 0; turn < MOST_TURNS && (now < end || turn < 10); turn++) {
        idle = settling(TURN);
        start = now_ns();
        for (i = 0; i < TURN; i++) {
            check(client->bus, ecat_commit(client->bus));
            settle();
        }
        between = now_ns();
        for (i = 0; i < TURN; i++) {
            take(client);
            give(client);
            settle();
        }
        now = now_ns();
        commit[turn] = (between - start) / TURN - idle;
        step[turn] = (now - between) / TURN - idle;
    }
    printf("{\"commit\": %.2f, \"step\": %.2f, \"turns\": %u}\n", median(commit, turn),
           median(step, turn), turn);
}

static void make_steps(const struct client *client)
{
    int i;
    take(client);
    give(client);
    (void)getppid();
    for (i = 0; i < STEPS; i++) {
        take(client);
        give(client);
    }
    (void)getppid();
    printf("{\"steps\": %d}\n", STEPS);
}

int main(int count, char **arguments)
{
    struct client client;
    if (count != 4) {
        fprintf(stderr, "usage: commit BUS SLAVES SECONDS|--once\n");
        return 2;
    }
    client = prepare(arguments[1], atoi(arguments[2]));
    if (strcmp(arguments[3], "--once") == 0)
        make_steps(&client);
    else
        measure(&client, atof(arguments[3]));
    ecat_close(client.bus);
    return 0;
}
