/* Functions for clients of a bus that measure. An error ends the program with a message. */
#ifndef BENCHMARK_BUS_H
#define BENCHMARK_BUS_H

#include <ecat/ecat.h>
#include <stdio.h>
#include <stdlib.h>

static inline void check(ecat_t *bus, int code)
{
    if (code >= 0 || code == ECAT_ESTALE) /* not an error: the machine stood still for a moment */
        return;
    fprintf(stderr, "benchmark: %s\n", ecat_error(bus));
    exit(1);
}

static inline ecat_t *open_bus(const char *name)
{
    ecat_t *bus;
    check(bus, ecat_open(&bus, name));
    return bus;
}

/* Makes the compiler assume that the memory `at` is used and changed. */
static inline void keep(void *at)
{
    __asm__ volatile("" : : "r"(at) : "memory");
}

/* Chooses `count` entries, evenly spread over the bus. */
static inline void choose(const ecat_t *bus, int *entries, int count)
{
    int i, all = ecat_signal_count(bus);
    for (i = 0; i < count; i++)
        entries[i] = (int)((long)i * all / count);
}

#endif
