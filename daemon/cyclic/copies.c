/* Copies: outputs that an input of another slave decides, in every cycle.
 *
 * An input of one cycle goes out with the next. While its slave does not take part in the exchange, the
 * output has its safe value. Nobody can claim such an output. */
#include "engine.h"

#include <errno.h>
#include <stdlib.h>

static uint32_t bit_of(const cyclic_t *c, uint32_t signal) {
  const ecat_shm_signal *s = &c->signals[signal];
  return 8 * c->domain[s->domain].output_base + s->bit_offset;
}

static void tell(cyclic_t *c, const struct copy *copy, uint32_t reason) {
  ecat_shm_output *output = &c->output[copy->target];
  __atomic_store_n(&output->state, ECAT_OUTPUTS_COPIED, __ATOMIC_RELAXED);
  __atomic_store_n(&output->reason, reason, __ATOMIC_RELAXED);
  __atomic_store_n(&output->since_cycle, c->cycle, __ATOMIC_RELAXED);
  __atomic_store_n(&output->since_ns, c->now_ns, __ATOMIC_RELEASE);
}

/* The value of the input as bits of the output; 0 if there is none. An input that is not a number has
 * none either. */
static int read_source(const cyclic_t *c, const struct copy *copy, uint64_t *bits) {
  const struct domain *domain = &c->domain[copy->domain];
  struct value value = {.scale = 1, .analog = 1};
  if (domain->wkc_state != ECAT_WKC_COMPLETE || (domain->absent & copy->group) != 0) return 0;
  *bits = bits_get(domain->image, copy->source_bit, copy->source_bits);
  if (copy->plain) return 1;
  value.real = raw_to_double(*bits, copy->source_bits, copy->source_sign, copy->source_real) *
                   copy->factor + copy->offset;
  return value_encode(&copy->rule, &value, bits) == 0;
}

void cyclic_copies_run(cyclic_t *c) {
  int stopping = __atomic_load_n(&c->make_safe, __ATOMIC_RELAXED);
  uint32_t i;
  for (i = 0; i < c->copies; i++) {
    struct copy *copy = &c->copy[i];
    uint64_t bits;
    int valid = !stopping && read_source(c, copy, &bits);
    if (!valid) {
      uint64_t hold = bits_get(c->hold, copy->target_bit, copy->rule.bits);
      bits = (bits_get(c->outputs, copy->target_bit, copy->rule.bits) & hold) |
             (bits_get(c->safe, copy->target_bit, copy->rule.bits) & ~hold);
    }
    bits_put(c->outputs, copy->target_bit, copy->rule.bits, bits);
    if (valid == copy->valid) continue;
    copy->valid = valid;
    tell(c, copy, valid ? ECAT_REASON_START : stopping ? ECAT_REASON_STOPPING : ECAT_REASON_WKC);
  }
}

int cyclic_set_copy(cyclic_t *c, uint32_t source, uint32_t target, double factor, double offset) {
  const ecat_shm_signal *from, *to;
  struct copy *grown, *copy;
  int32_t group;
  if (source >= c->header->signal_count || target >= c->header->signal_count ||
      c->signals[source].output || !c->signals[target].output || c->started)
    return -EINVAL;
  grown = realloc(c->copy, (c->copies + 1) * sizeof *grown);
  if (grown == NULL) return -ENOMEM;
  c->copy = grown;
  from = &c->signals[source];
  to = &c->signals[target];
  group = c->slaves[from->slave].group;
  copy = &c->copy[c->copies++];
  *copy = (struct copy){.target = target,
                        .target_bit = bit_of(c, target),
                        .domain = from->domain,
                        .group = group < 0 ? 0 : (uint64_t)1 << group,
                        .source_bit = from->bit_offset,
                        .source_bits = (uint8_t)from->bit_length,
                        .source_sign = (uint8_t)type_is_signed(from->type),
                        .source_real = (uint8_t)type_is_real(from->type, from->bit_length),
                        .factor = factor,
                        .offset = offset,
                        .rule = value_rule(to->type, to->bit_length, to->minimum, to->maximum)};
  copy->plain = factor == 1 && offset == 0 && from->bit_length == to->bit_length &&
                copy->source_sign == copy->rule.sign && copy->source_real == copy->rule.real &&
                to->minimum == -HUGE_VAL && to->maximum == HUGE_VAL;
  set_drop(c->claimable, target);
  set_add(c->copied, target);
  tell(c, copy, ECAT_REASON_START);
  return 0;
}
