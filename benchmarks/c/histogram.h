/* Puts samples into the buckets of the engine's histograms, so that all programs use the same. */
#ifndef BENCHMARK_HISTOGRAM_H
#define BENCHMARK_HISTOGRAM_H

#include <stdint.h>
#include <stdio.h>

/* Like ecat_histogram_bucket() of the client library: 1 ns wide below 32 ns, then 32 per octave. */
static inline unsigned bucket_of(uint32_t ns)
{
    unsigned octave;
    if (ns < 32)
        return ns;
    octave = 31u - (unsigned)__builtin_clz(ns) - 5u;
    return octave * 32 + (ns >> octave);
}

/* Prints `, "buckets": [[bucket, number of samples], ...]` of sorted samples. */
static inline void print_buckets(const uint32_t *samples, uint64_t count)
{
    uint64_t i, first;
    printf(", \"buckets\": [");
    for (i = 0; i < count; i += first) {
        unsigned bucket = bucket_of(samples[i]);
        for (first = 1; i + first < count && bucket_of(samples[i + first]) == bucket; first++) {
        }
        printf("%s[%u, %llu]", i > 0 ? ", " : "", bucket, (unsigned long long)first);
    }
    printf("]");
}

#endif
