/* Clients that commit once a cycle, each with outputs of its own.
 *
 * usage: writers BUS CLIENTS SLAVES
 * Each of the CLIENTS claims SLAVES slaves. All clients are handles of one process. It sleeps with
 * its own timer, so that the engine does not have to wake it. Prints "{}" when all outputs are
 * claimed; ends when standard input is closed.
 */
#include "bus.h"

#include <poll.h>
#include <stdint.h>
#include <time.h>

enum { MOST = 32 };
static const double LEASE = 0.5;

struct client {
    ecat_t *bus;
    int output;
};

static struct client join(const char *name, int first, int slaves)
{
    struct client client;
    int i;
    client.bus = open_bus(name);
    for (i = first; i < first + slaves; i++)
        check(client.bus, ecat_claim(client.bus, i, LEASE));
    client.output = ecat_bind(client.bus, first, 0x7000, 1, ECAT_OUTPUT);
    check(client.bus, client.output);
    return client;
}

static void commit_all(const struct client *clients, int count, int number)
{
    int i;
    for (i = 0; i < count; i++) {
        check(clients[i].bus, ecat_sample(clients[i].bus));
        check(clients[i].bus, ecat_write_int(clients[i].bus, clients[i].output, number & 0x7F));
        check(clients[i].bus, ecat_commit(clients[i].bus));
    }
}

int main(int count, char **arguments)
{
    struct client clients[MOST];
    struct pollfd input = {.fd = 0, .events = POLLIN};
    struct timespec due;
    int wanted = count == 4 ? atoi(arguments[2]) : 0, i;
    long period;
    if (wanted < 1 || wanted > MOST) {
        fprintf(stderr, "usage: writers BUS CLIENTS SLAVES\n");
        return 2;
    }
    for (i = 0; i < wanted; i++) {
        clients[i] = join(arguments[1], i * atoi(arguments[3]), atoi(arguments[3]));
        commit_all(clients, i + 1, i); /* renews the leases of earlier clients */
    }
    period = (long)(ecat_cycle_time(clients[0].bus) * 1e9);
    clock_gettime(CLOCK_MONOTONIC, &due);
    printf("{}\n");
    fflush(stdout);
    for (i = 0; poll(&input, 1, 0) == 0; i++) {
        due.tv_nsec += period;
        if (due.tv_nsec >= 1000000000) {
            due.tv_nsec -= 1000000000;
            due.tv_sec++;
        }
        clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &due, NULL);
        commit_all(clients, wanted, i);
    }
    for (i = 0; i < wanted; i++)
        ecat_close(clients[i].bus);
    return 0;
}
