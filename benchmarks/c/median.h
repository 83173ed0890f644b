/* Times and their medians. */
#ifndef BENCHMARK_MEDIAN_H
#define BENCHMARK_MEDIAN_H

#include <stdlib.h>
#include <time.h>

static inline double now_ns(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec * 1e9 + (double)now.tv_nsec;
}

/* Waits until everything before it has been carried out. A processor begins the next call while the
 * last one is under way; a program that makes one each cycle has nothing of that. */
static inline void settle(void)
{
#if defined(__x86_64__)
    __asm__ volatile("lfence" ::: "memory");
#elif defined(__aarch64__)
    __asm__ volatile("isb" ::: "memory");
#else
    __atomic_thread_fence(__ATOMIC_SEQ_CST);
#endif
}

/* What that costs, in ns. */
static inline double settling(unsigned calls)
{
    double start = now_ns();
    unsigned i;
    for (i = 0; i < calls; i++)
        settle();
    return (now_ns() - start) / calls;
}

static inline int by_size(const void *a, const void *b)
{
    double left = *(const double *)a, right = *(const double *)b;
    return (left > right) - (left < right);
}

/* Sorts them. */
static inline double median(double *values, unsigned count)
{
    qsort(values, count, sizeof *values, by_size);
    return values[count / 2];
}

#endif
