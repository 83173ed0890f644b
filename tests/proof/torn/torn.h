/* A bus without wires for the torn-read tests: the shared memory of the daemon as files, the engine's own
 * parts that write and read them, and the real client in other threads. */
#ifndef TORN_H
#define TORN_H

#include "engine.h"

#include <internal.h>

enum { READERS = 8, WRITERS = 3 };

struct bench {
  char name[32];
  uint32_t size;             /* bytes of the image: outputs of `slaves` slaves, in one domain */
  uint32_t slaves;
  uint64_t count;            /* reads or commits, of all threads together */
  int broken;                /* break the protocol: what is torn must be found */
  int hurry;                 /* clients never rest */
  cyclic_t *engine;
  int ended;                 /* threads that have done their part */
};

/* Word `i` of what is written as number `n`: a function of both, and no two of them alike. */
static inline uint64_t word_of(uint64_t n, uint64_t i) {
  return n * 0x9E3779B97F4A7C15u + (i + 1) * 0xC2B2AE3D27D4EB4Fu;
}

static inline uint32_t random_below(uint64_t *state, uint32_t n) {
  *state = *state * 6364136223846793005u + 1442695040888963407u;
  return (uint32_t)((*state >> 32) * n >> 32);
}

/* Waits a little, without giving the processor away. */
static inline void rest(uint32_t turns) {
  volatile uint32_t left = turns;
  while (left > 0) left--;
}

_Noreturn void die(const char *what, uint64_t number);
/* Makes the files and an engine on them, which is never started: the test calls its parts. */
void files_make(struct bench *bench);
void files_remove(void);
/* A connection as programs make it. */
ecat_t *connection(const struct bench *bench);

/* Each prints what it has seen as JSON, or dies. */
void read_images(struct bench *bench);
void take_commits(struct bench *bench);

#endif
