/* The cycle follows the reference clock of the distributed clocks (ETG.1000.4, 9.1).
 *
 * In each cycle the frame reads the time of the reference clock as it passes it. From this time, the
 * engine subtracts how long after its deadline the frame left. The result is the deadline in the time
 * of the reference clock, whatever the delay of the host's wake-up was. A PI controller moves the
 * next deadline; its integral is the difference in speed of the two clocks. A frame that is held up
 * on its way gives too late a time. So the effect of one measurement is limited, and more tightly
 * once the cycle is locked.
 */
#include "engine.h"

enum {
  DRIFT_BITS = 12,         /* of the unit of the integral, in which its mean is kept */
  FRACTION_BITS = 12,      /* of a nanosecond, in which deadlines are corrected */
  PROPORTIONAL_BITS = 7,   /* gains: 2^(7-12) = 1/32, and 1/4096 */
  FILTER_BITS = 4,         /* of the phase that decides about the lock: 16 cycles */
  SETTLED_CYCLES = 100,
  SILENT_CYCLES = 100,     /* without a measurement until the lock counts as lost */
  DRIFT_CYCLES = 4096,     /* over which the published drift is averaged: noise moves the integral */
  LIMIT = 1000             /* a deadline moves by 1/LIMIT of the cycle at most */
};

static int64_t clamp(int64_t value, int64_t limit) {
  return value > limit ? limit : value < -limit ? -limit : value;
}

uint64_t cyclic_clock_estimate(const cyclic_t *c) {
  /* Both clocks differ by some 100 ppm at most: 0.1 us in a cycle of 1 ms. */
  return c->clock.measured ? c->clock.time_ns + (c->send_ns - c->clock.send_ns) : 0;
}

/* The deadline's place in the reference clock's cycle, less the wanted one: -period/2 to period/2. */
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

/* Deadlines come sooner (negative integral) when the reference clock is the faster one. A cycle that
 * approaches the clock corrects more than the drift: it does not count, but before the first lock. */
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
  /* A clock of 32 bits starts again every 4.3 s; how often it did so while no frame came back tells
   * the time that has passed here. */
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
  /* The integral is kept within twice what the limit can use, or it would have to come back. */
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
  } else if (++clock->silent >= SILENT_CYCLES) { /* whatever it shows now, nobody follows it */
    clock->silent = SILENT_CYCLES;
    clock->settled = 0;
    clock->state = ECAT_DC_LOCKING;
  }
  /* Without a measurement in the next cycle the speed stays, and the phase is not corrected. */
  clock->correction = clamp(clock->integral >> FRACTION_BITS,
                            (int64_t)c->header->cycle_time_ns / LIMIT);
}
