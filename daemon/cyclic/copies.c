/* Copies: outputs that get the value of an input in every cycle.
 *
 * A target position follows the actual position of its drive only as long as no client has written it: the
 * input is its safe value (`follows`). All others have an input of another slave, and belong to the copy.
 *
 * The input of one cycle goes out with the next one. The output has its safe value while the input is not
 * valid, and while the drive of the output is brought to a stop. No client can claim such an output. */
#include "engine.h"

#include <errno.h>
#include <float.h>
#include <math.h>
#include <stdlib.h>

enum { OP = 8 }; /* AL status without the error flag (ETG.1000.6) */

static uint32_t bit_of(const cyclic_t *c, uint32_t signal) {
  const ecat_shm_signal *s = &c->signals[signal];
  return 8 * c->domain[s->domain].output_base + s->bit_offset;
}

static void tell(cyclic_t *c, struct copy *copy, uint32_t reason) {
  ecat_shm_output *output = &c->output[copy->target];
  copy->told = reason;
  __atomic_store_n(&output->state, ECAT_OUTPUTS_COPIED, __ATOMIC_RELAXED);
  __atomic_store_n(&output->reason, reason, __ATOMIC_RELAXED);
  __atomic_store_n(&output->since_cycle, c->cycle, __ATOMIC_RELAXED);
  __atomic_store_n(&output->since_ns, c->now_ns, __ATOMIC_RELEASE);
}

/* The value of an integer that needs no conversion. A double would lose digits of a 64-bit integer. */
static struct value whole_value(const struct copy *copy, const struct rule *rule, uint64_t bits) {
  struct value value = {.scale = 1, .analog = 1, .is_whole = 1};
  value.whole = copy->source_sign ? sign_extended(bits, copy->source_bits) : (int64_t)bits;
  if (value.whole < 0 && copy->source_sign != rule->sign) /* beyond the type of the output */
    value.whole = copy->source_sign ? 0 : INT64_MAX;
  return value;
}

static struct value converted_value(const struct copy *copy, uint64_t bits) {
  double raw = raw_to_double(bits, copy->source_bits, copy->source_sign, copy->source_real);
  double real = ecat_to_physical(raw, copy->factor, copy->offset);
  if (isfinite(raw) && !isfinite(real)) real = real > 0 ? DBL_MAX : -DBL_MAX; /* held at the limit */
  return (struct value){.scale = 1, .analog = 1, .real = real};
}

/* Sets `*bits` to the value of the input as bits of the output. Returns 0 if the input is not valid. The
 * input must meet the conditions of `valid` in a session, and be a finite number. */
static int read_source(const cyclic_t *c, const struct copy *copy, uint64_t *bits) {
  const struct domain *domain = &c->domain[copy->domain];
  const struct copy_limit *limit = &c->limits->copy[copy - c->copy];
  struct value value;
  if (copy->al_state == NULL || domain->wkc_state != ECAT_WKC_COMPLETE || (domain->absent & copy->group) != 0 ||
      __atomic_load_n(copy->al_state, __ATOMIC_RELAXED) != OP)
    return 0;
  *bits = bits_get(domain->image, copy->source_bit, copy->source_bits);
  if (limit->plain) return 1;
  value = copy->whole ? whole_value(copy, &limit->rule, *bits) : converted_value(copy, *bits);
  return value_encode(&limit->rule, &value, bits) == 0;
}

/* The reason for the safe value of an output. ECAT_REASON_START: no reason, the output has the value of
 * the input, `*bits`. */
static uint32_t why_safe(const cyclic_t *c, const struct copy *copy, int stopping, uint64_t *bits) {
  if (stopping) return ECAT_REASON_STOPPING;
  if (copy->stop >= 0 && c->stop_sequence[copy->stop].running)
    return c->output[c->stop_sequence[copy->stop].signal].reason;
  return read_source(c, copy, bits) ? ECAT_REASON_START : ECAT_REASON_SOURCE;
}

/* Keeps the safe value of an output equal to its input, and the output too unless somebody else has it. */
static void follow(cyclic_t *c, const struct copy *copy) {
  uint32_t state = c->output[copy->target].state;
  uint64_t bits;
  if (read_source(c, copy, &bits)) bits_put(c->safe, copy->target_bit, copy->target_bits, bits);
  if ((state != ECAT_OUTPUTS_SAFE && state != ECAT_OUTPUTS_CLAIMED) ||
      (copy->stop >= 0 && c->stop_sequence[copy->stop].running))
    return;
  bits_put(c->outputs, copy->target_bit, copy->target_bits,
           bits_get(c->safe, copy->target_bit, copy->target_bits));
}

void cyclic_copies_run(cyclic_t *c) {
  int stopping = __atomic_load_n(&c->make_safe, __ATOMIC_RELAXED);
  uint32_t i;
  for (i = 0; i < c->copies; i++) {
    struct copy *copy = &c->copy[i];
    uint64_t bits = 0;
    uint32_t reason;
    if (copy->follows) {
      follow(c, copy);
      continue;
    }
    reason = why_safe(c, copy, stopping, &bits);
    if (reason != ECAT_REASON_START) {
      uint64_t hold = bits_get(c->hold, copy->target_bit, copy->target_bits);
      bits = (bits_get(c->outputs, copy->target_bit, copy->target_bits) & hold) |
             (bits_get(c->safe, copy->target_bit, copy->target_bits) & ~hold);
    }
    bits_put(c->outputs, copy->target_bit, copy->target_bits, bits);
    if (reason != copy->told) tell(c, copy, reason);
  }
}

struct copy_limit cyclic_copy_limit(const cyclic_t *c, const struct copy *copy) {
  const ecat_shm_signal *to = &c->signals[copy->target];
  struct copy_limit limit = {.rule = value_rule(to->type, to->bit_length, to->minimum, to->maximum)};
  limit.plain = copy->same && to->minimum == -HUGE_VAL && to->maximum == HUGE_VAL;
  return limit;
}

/* The number of the stop of the drive with this controlword, -1: none. */
static int32_t find_stop(const cyclic_t *c, int32_t controlword) {
  int32_t i = (int32_t)c->stops;
  while (--i >= 0 && (int32_t)c->stop_sequence[i].signal != controlword) continue;
  return i;
}

/* Fills in place and type of an input. */
static void set_source(const cyclic_t *c, struct copy *copy, const ecat_shm_signal *from) {
  const ecat_shm_slave_status *status =
      (const void *)((const uint8_t *)c->header + c->header->slave_status_offset);
  int32_t group = c->slaves[from->slave].group;
  copy->domain = from->domain;
  copy->group = group < 0 ? 0 : (uint64_t)1 << group;
  copy->al_state = &status[from->slave].al_state;
  copy->source_bit = from->bit_offset;
  copy->source_bits = (uint8_t)from->bit_length;
  copy->source_sign = (uint8_t)type_is_signed(from->type);
  copy->source_real = (uint8_t)type_is_real(from->type, from->bit_length);
}

/* Adds a copy; NULL: there is no memory. `from`: NULL if there is no input. */
static struct copy *add(cyclic_t *c, const ecat_shm_signal *from, uint32_t target, double factor,
                        double offset, int32_t controlword) {
  const ecat_shm_signal *to = &c->signals[target];
  struct copy *grown = realloc(c->copy, (c->copies + 1) * sizeof *grown), *copy;
  if (grown == NULL) return NULL;
  c->copy = grown;
  copy = &c->copy[c->copies++];
  *copy = (struct copy){.target = target,
                        .target_bit = bit_of(c, target),
                        .stop = find_stop(c, controlword),
                        .target_bits = (uint8_t)to->bit_length,
                        .factor = factor,
                        .offset = offset};
  if (from == NULL) return copy;
  set_source(c, copy, from);
  copy->whole = factor == 1 && offset == 0 && !copy->source_real && !type_is_real(to->type, to->bit_length);
  copy->same = copy->whole && from->bit_length == to->bit_length &&
               copy->source_sign == type_is_signed(to->type);
  return copy;
}

int cyclic_set_follow(cyclic_t *c, uint32_t source, uint32_t target, int32_t controlword) {
  struct copy *copy;
  if (source >= c->header->signal_count || target >= c->header->signal_count ||
      c->signals[source].output || !c->signals[target].output || c->started)
    return -EINVAL;
  copy = add(c, &c->signals[source], target, 1, 0, controlword);
  if (copy == NULL) return -ENOMEM;
  copy->follows = 1;
  return 0;
}

int cyclic_set_copy(cyclic_t *c, uint32_t source, uint32_t target, double factor, double offset,
                    int32_t controlword) {
  const ecat_shm_signal *from = NULL;
  struct copy *copy;
  if (source != UINT32_MAX) {
    if (source >= c->header->signal_count || c->signals[source].output) return -EINVAL;
    from = &c->signals[source];
  }
  if (target >= c->header->signal_count || !c->signals[target].output ||
      set_has(c->reserved, target) || c->started)
    return -EINVAL;
  copy = add(c, from, target, factor, offset, controlword);
  if (copy == NULL) return -ENOMEM;
  set_drop(c->claimable, target);
  set_add(c->reserved, target);
  c->output[target].source = source;
  tell(c, copy, ECAT_REASON_SOURCE);
  return 0;
}
