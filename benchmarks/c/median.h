/* Clock and median for programs that measure the time of calls. */
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

/* Waits until all earlier instructions have been carried out. In a loop of calls, the processor
 * would begin the next call before the last one ends. A program that makes one call in each cycle
 * does not have this advantage, so it must not count. */
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

/* Returns the time of settle(), in ns. */
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

/* Returns the median, and sorts the values. */
static inline double median(double *values, unsigned count)
{
    qsort(values, count, sizeof *values, by_size);
    return values[count / 2];
}

#endif
