/* Counts how often a busy thread of the highest priority loses its processor: to the host of a
 * virtual machine, to firmware, or, without real-time priority, to other programs.
 *
 * usage: interruptions --processor N --seconds S --longer-than US
 * Measures in bursts, because a thread without pauses would hold up the kernel's own work on the
 * processor. Prints one line of JSON: how long it measured, how often it was interrupted for longer
 * than US microseconds, and the longest interruption.
 */
#include "raw_socket.h"

#include <inttypes.h>
#include <string.h>
#include <time.h>

enum { PRIORITY = 90, BURST_NS = 100000000, PAUSE_US = 10000 };

int main(int count, char **arguments)
{
    double seconds = 0, longer_than_us = 0;
    int processor = -1;
    for (int i = 1; i + 1 < count; i += 2) {
        if (strcmp(arguments[i], "--processor") == 0)
            processor = atoi(arguments[i + 1]);
        if (strcmp(arguments[i], "--seconds") == 0)
            seconds = atof(arguments[i + 1]);
        if (strcmp(arguments[i], "--longer-than") == 0)
            longer_than_us = atof(arguments[i + 1]);
    }
    if (processor < 0 || seconds <= 0 || longer_than_us <= 0) {
        fprintf(stderr, "usage: interruptions --processor N --seconds S --longer-than US\n");
        return 2;
    }
    die_with_parent();
    cpu_set_t chosen;
    CPU_ZERO(&chosen);
    CPU_SET(processor, &chosen);
    if (sched_setaffinity(0, sizeof chosen, &chosen) != 0)
        fail("--processor");
    bool real_time = ask_for_real_time(PRIORITY);
    int64_t threshold = (int64_t)(longer_than_us * 1e3), longest = 0, looked = 0;
    unsigned times = 0;
    while (looked < (int64_t)(seconds * 1e9)) {
        int64_t begin = now_ns(), last = begin;
        do {
            int64_t now = now_ns(), gap = now - last;
            times += gap > threshold;
            longest = gap > longest ? gap : longest;
            last = now;
        } while (last < begin + BURST_NS);
        looked += last - begin;
        usleep(PAUSE_US);
    }
    printf("{\"real_time\": %s, \"seconds\": %.3f, \"times\": %u, \"longest_us\": %" PRId64 "}\n",
           real_time ? "true" : "false", (double)looked / 1e9, times, longest / 1000);
    return 0;
}
