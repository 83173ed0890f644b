/* The limit of the machine for a cyclic program: wakes up on a fixed grid and does nothing else.
 *
 * usage: nanosleep --rate HZ --seconds S
 * A deadline is missed if it passes before the program wakes up for the deadline before it. Prints
 * one line of JSON; the samples are the lateness of the wake-ups, in nanoseconds.
 */
#include "raw_socket.h"

#include "histogram.h"
#include <errno.h>
#include <inttypes.h>
#include <string.h>
#include <time.h>

enum { PRIORITY = 80, MAX_SAMPLES = 1 << 22, WARM_UP = 20 };

static uint32_t samples[MAX_SAMPLES];

static int compare(const void *a, const void *b)
{
    uint32_t x = *(const uint32_t *)a, y = *(const uint32_t *)b;
    return (x > y) - (x < y);
}

/* Wakes up `cycles` times; returns the number of missed deadlines. */
static uint64_t run(int64_t period, uint64_t cycles)
{
    int64_t due = now_ns();
    uint64_t i, missed = 0;
    for (i = 0; i < cycles; i++) {
        struct timespec at;
        int64_t now;
        due += period;
        at = (struct timespec){due / 1000000000, due % 1000000000};
        while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &at, NULL) == EINTR) {
        }
        now = now_ns();
        samples[i] = now - due < UINT32_MAX ? (uint32_t)(now - due) : UINT32_MAX;
        for (; due + period <= now; due += period)
            missed++; /* skips a missed deadline, but keeps to the grid */
    }
    return missed;
}

int main(int count, char **arguments)
{
    double rate = 0, seconds = 0;
    uint64_t cycles, missed;
    bool real_time;
    for (int i = 1; i + 1 < count; i += 2) {
        if (strcmp(arguments[i], "--rate") == 0)
            rate = atof(arguments[i + 1]);
        if (strcmp(arguments[i], "--seconds") == 0)
            seconds = atof(arguments[i + 1]);
    }
    if (rate <= 0 || seconds <= 0 || rate * seconds > MAX_SAMPLES) {
        fprintf(stderr, "usage: nanosleep --rate HZ --seconds S\n");
        return 2;
    }
    die_with_parent();
    real_time = ask_for_real_time(PRIORITY);
    memset(samples, 0, sizeof samples); /* avoids page faults later */
    cycles = (uint64_t)(rate * seconds);
    (void)run((int64_t)(1e9 / rate), WARM_UP);
    missed = run((int64_t)(1e9 / rate), cycles);
    qsort(samples, cycles, sizeof samples[0], compare);
    printf("{\"cycles\": %" PRIu64 ", \"missed_cycles\": %" PRIu64 ", \"real_time\": %s", cycles,
           missed, real_time ? "true" : "false");
    print_buckets(samples, cycles);
    printf("}\n");
    return 0;
}
