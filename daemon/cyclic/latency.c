/* Measures the delay of the wake-ups of a thread that sleeps like the engine, for `ecatctl doctor`. */
#include "engine.h"

#include <errno.h>
#include <time.h>

enum { SECOND = 1000000000 };

static uint64_t now_ns(void) {
  struct timespec now;
  clock_gettime(CLOCK_MONOTONIC, &now);
  return (uint64_t)now.tv_sec * SECOND + (uint64_t)now.tv_nsec;
}

void cyclic_measure_wakeup(uint64_t period_ns, uint64_t count, void *histogram) {
  ecat_shm_histogram *late = histogram;
  uint64_t deadline_ns = now_ns();
  late->min_ns = UINT64_MAX;
  for (uint64_t done = 0; done < count; done++) {
    deadline_ns += period_ns;
    const struct timespec at = {.tv_sec = (time_t)(deadline_ns / SECOND),
                                .tv_nsec = (long)(deadline_ns % SECOND)};
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &at, NULL) == EINTR) continue;
    uint64_t now = now_ns();
    cyclic_count(late, now - deadline_ns);
    if (now > deadline_ns + period_ns) deadline_ns = now; /* missed periods count as one late wake-up */
  }
}
