/* A deterministic source of random numbers (xorshift64*). */
#ifndef FUZZ_RANDOM_H
#define FUZZ_RANDOM_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct source {
    uint64_t state;
};

static inline struct source source_from(uint64_t seed)
{
    return (struct source){seed * 0x9E3779B97F4A7C15U + 0x2545F4914F6CDD1DU};
}

static inline uint32_t draw(struct source *source)
{
    source->state ^= source->state >> 12;
    source->state ^= source->state << 25;
    source->state ^= source->state >> 27;
    return (uint32_t)(source->state * 0x2545F4914F6CDD1DU >> 32);
}

/* 0 to `limit` - 1. */
static inline uint32_t below(struct source *source, uint32_t limit)
{
    return (uint32_t)((uint64_t)draw(source) * limit >> 32);
}

static inline bool one_in(struct source *source, uint32_t n) { return below(source, n) == 0; }

static inline void fill(struct source *source, uint8_t *data, size_t size)
{
    for (size_t i = 0; i < size; i++)
        data[i] = (uint8_t)draw(source);
}

#endif
