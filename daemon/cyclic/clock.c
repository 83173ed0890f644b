/* The cycle follows the reference clock of the distributed clocks (ETG.1000.4, 9.1).
 *
 * In each cycle a frame reads the time of the reference clock when it passes that slave. The engine
 * subtracts the time from the deadline to the sending of the frame. The result is the deadline in the
 * time of the reference clock, independent of the delay of the host's wake-up. A PI controller moves
 * the next deadline; its integral is the difference in speed of the two clocks. The time is too late
 * if something holds the frame up on its way. Therefore the effect of one measurement is limited, and
 * the limit is tighter while the cycle is locked.
 */
#include "engine.h"

enum {
  DRIFT_BITS = 12,         /* further fraction bits for the mean of the integral */
  FRACTION_BITS = 12,      /* fraction bits of a nanosecond in corrections of deadlines */
  PROPORTIONAL_BITS = 7,   /* gains: proportional 2^(7-12) = 1/32, integral 1/4096 */
  FILTER_BITS = 4,         /* of the filter for the phase that decides about the lock: 16 cycles */
  SETTLED_CYCLES = 100,
  SILENT_CYCLES = 100,     /* the lock is lost after this many cycles without a measurement */
  DRIFT_CYCLES = 4096,     /* the published drift is a mean over these cycles: the integral is noisy */
  LIMIT = 1000             /* a deadline moves by at most 1/LIMIT of the cycle */
};

static int64_t clamp(int64_t value, int64_t limit) {
  return value > limit ? limit : value < -limit ? -limit : value;
}

uint64_t cyclic_clock_estimate(const cyclic_t *c) {
  /* Both clocks differ by some 100 ppm at most: 0.1 us in a cycle of 1 ms. */
  return c->clock.measured ? c->clock.time_ns + (c->send_ns - c->clock.send_ns) : 0;
}

/* The phase of the deadline in the cycle of the reference clock, less the wanted phase: -period/2 to
 * period/2. */
static int64_t phase(const cyclic_t *c) {
  int64_t period = (int64_t)c->header->cycle_time_ns;
  int64_t at = (int64_t)(c->clock.time_ns - (c->send_ns - c->deadline_ns)) - c->clock.phase_ns;
  at %= period;
  if (at < 0) at += period;
  return at >= (period + 1) / 2 ? at - period : at;
}

static void decide(cyclic_t *c, struct clock *clock, int64_t offset) {
  int64_t magnitude;
  clock->filtered += offset - (clock->filtered >> FILTER_BITS);
  magnitude = clock->filtered >> FILTER_BITS;
  if (magnitude < 0) magnitude = -magnitude;
  if (magnitude < clock->lock_ns) {
    if (clock->settled < SETTLED_CYCLES) clock->settled++;
  } else if (magnitude > 2 * clock->lock_ns) {
    clock->settled = 0;
  }
  if (clock->settled == SETTLED_CYCLES) clock->state = ECAT_DC_LOCKED;
  if (clock->settled == 0) clock->state = ECAT_DC_LOCKING;
  if (clock->state == ECAT_DC_LOCKED)
    cyclic_count(&c->health->dc_offset, (uint64_t)(offset < 0 ? -offset : offset));
}

/* The integral is negative, so that deadlines come sooner, if the reference clock is the faster one. While
 * the cycle still approaches the clock, the integral is more than the drift. Such cycles do not count,
 * except before the first lock. */
static void publish_drift(cyclic_t *c, struct clock *clock, int64_t period) {
  int64_t now = -clock->integral * (1 << DRIFT_BITS);
  if (clock->state == ECAT_DC_LOCKED) {
    if (clock->drifts < DRIFT_CYCLES) clock->drifts++;
    clock->drift += (now - clock->drift) / clock->drifts;
  } else if (clock->drifts == 0) {
    clock->drift = now;
  }
  __atomic_store_n(&c->health->dc_drift_ppb,
                   (clock->drift >> DRIFT_BITS) * (1000000000 >> FRACTION_BITS) / period,
                   __ATOMIC_RELAXED);
}

void cyclic_clock_measure(cyclic_t *c, uint64_t time_ns) {
  struct clock *clock = &c->clock;
  int64_t period = (int64_t)c->header->cycle_time_ns, limit = period / LIMIT, offset, wanted;
  int first = !clock->measured;
  /* A 32-bit clock starts again every 4.3 s. The local time that has passed since the last measurement
   * tells how often it has done so. */
  if (!first && time_ns >> 32 == 0) {
    uint64_t expected = cyclic_clock_estimate(c);
    time_ns = expected + (uint64_t)(int64_t)(int32_t)((uint32_t)time_ns - (uint32_t)expected);
  }
  clock->time_ns = time_ns;
  clock->send_ns = c->send_ns;
  clock->measured = 1;
  offset = phase(c);
  __atomic_store_n(&c->health->dc_time_ns, time_ns, __ATOMIC_RELAXED);
  __atomic_store_n(&c->health->dc_offset_ns, offset, __ATOMIC_RELAXED);
  if (first) { /* one step, before any slave needs the phase */
    clock->correction = offset <= 0 ? -offset : period - offset;
    return;
  }
  decide(c, clock, offset);
  offset = clamp(offset, clock->state == ECAT_DC_LOCKED ? clock->lock_ns / 4 : period / 2);
  /* Anti-windup: the integral stays within twice the value that the limit lets through. */
  clock->integral = clamp(clock->integral - clamp(offset, period / 64),
                          (2 * limit) << FRACTION_BITS);
  wanted = clock->fraction + clock->integral - offset * (1 << PROPORTIONAL_BITS);
  clock->correction = clamp(wanted >> FRACTION_BITS, limit);
  clock->fraction = wanted & ((1 << FRACTION_BITS) - 1);
  publish_drift(c, clock, period);
}

void cyclic_clock_follow(cyclic_t *c) {
  struct clock *clock = &c->clock;
  c->deadline_ns += (uint64_t)clock->correction;
  if (clock->send_ns == c->send_ns) {
    clock->silent = 0;
  } else if (++clock->silent >= SILENT_CYCLES) { /* the cycle no longer follows the clock */
    clock->silent = SILENT_CYCLES;
    clock->settled = 0;
    clock->state = ECAT_DC_LOCKING;
  }
  /* Valid if the next cycle brings no measurement: the speed is kept, the phase is not corrected. */
  clock->correction = clamp(clock->integral >> FRACTION_BITS,
                            (int64_t)c->header->cycle_time_ns / LIMIT);
}
