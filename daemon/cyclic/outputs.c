/* Outputs: their owners, and their values while they have no owner.
 *
 * Ownership of a slot is stored twice: as a set of signals, which is published to clients, and as a
 * mask over the output image. With the mask a commit is copied word by word, however many entries it
 * has. Bits without a signal are in no mask, so no client ever changes them. */
#include "engine.h"

#include <entries.h>
#include <errno.h>
#include <stdlib.h>
#include <string.h>

static uint32_t claim_words(const cyclic_t *c) { return (c->header->signal_count + 63) / 64; }

/* First bit of an output in the output image. */
static uint32_t bit_of(const cyclic_t *c, uint32_t signal) {
  const ecat_shm_signal *s = &c->signals[signal];
  return 8 * c->domain[s->domain].output_base + s->bit_offset;
}

static void tell_owner(cyclic_t *c, uint32_t signal, int32_t owner, uint32_t state,
                       uint32_t reason) {
  ecat_shm_output *output = &c->output[signal];
  __atomic_store_n(&output->state, state, __ATOMIC_RELAXED);
  __atomic_store_n(&output->reason, reason, __ATOMIC_RELAXED);
  __atomic_store_n(&output->since_cycle, c->cycle, __ATOMIC_RELAXED);
  __atomic_store_n(&output->since_ns, c->now_ns, __ATOMIC_RELAXED);
  __atomic_store_n(&output->owner, owner, __ATOMIC_RELEASE);
}

static size_t mask_words(const cyclic_t *c) { return ((size_t)c->header->output_bytes + 7) / 8 + 2; }

static size_t memory_words(const cyclic_t *c) {
  return 3 * claim_words(c) + ECAT_SLOTS * (2 * mask_words(c) + claim_words(c));
}

void cyclic_outputs_prefault(cyclic_t *c, void (*prefault)(void *memory, size_t size)) {
  prefault(c->output_memory, memory_words(c) * sizeof(uint64_t));
  prefault(c->limits, c->limits->size);
  prefault(c->stop_sequence, c->stops * sizeof *c->stop_sequence);
  prefault(c->copy, c->copies * sizeof *c->copy);
}

int cyclic_outputs_init(cyclic_t *c) {
  size_t image = mask_words(c), sets = claim_words(c);
  uint64_t *at;
  uint32_t i;
  c->output_memory = at = calloc(memory_words(c), sizeof *at);
  if (at == NULL) return -ENOMEM;
  c->claimable = at;
  c->wanted = at + sets;
  c->reserved = at + 2 * sets;
  at += 3 * sets;
  for (i = 0; i < ECAT_SLOTS; i++) {
    struct slot *slot = &c->slot[i];
    slot->claims = at;
    slot->mask = at + sets;
    slot->active = slot->mask + image;
    at = slot->active + image;
  }
  c->now_ns = cyclic_now();
  for (i = 0; i < c->header->signal_count; i++) {
    tell_owner(c, i, -1, ECAT_OUTPUTS_SAFE, ECAT_REASON_START);
    if (c->signals[i].output) set_add(c->claimable, i);
  }
  return cyclic_use_limits(c, NULL, 0);
}

/* --- safe values ---------------------------------------------------------------------------- */

/* Begins to stop a drive that has lost its owner; its other outputs are safe already. */
static void begin_stop(cyclic_t *c, struct stop *stop) {
  stop->running = 1;
  stop->until_ns = c->now_ns + stop->patience_ns;
  bits_put(c->outputs, stop->bit, 16, stop->value);
  __atomic_store_n(&c->output[stop->signal].state, ECAT_OUTPUTS_STOPPING, __ATOMIC_RELAXED);
}

/* Whether a CiA 402 drive still moves under its own power: operation enabled, quick stop active or
 * fault reaction active (CiA 402-2, statusword). */
static int moves(uint64_t statusword) {
  return (statusword & 0x6F) == 0x27 || (statusword & 0x6F) == 0x07 || (statusword & 0x4F) == 0x0F;
}

/* Continues a stop; returns 0 when it is over. A new owner ends it by its first commit of the
 * controlword, not by its claim. */
static int goes_on(cyclic_t *c, const struct stop *stop) {
  const ecat_shm_output *output = &c->output[stop->signal];
  const struct domain *domain = &c->domain[stop->domain];
  int stands = domain->wkc_state == ECAT_WKC_COMPLETE &&
               !moves(bits_get(domain->image, stop->status_bit, 16));
  if (output->state == ECAT_OUTPUTS_ACTIVE) return 0;
  if (!stands && c->now_ns < stop->until_ns) return 1;
  bits_put(c->outputs, stop->bit, 16, bits_get(c->safe, stop->bit, 16));
  if (output->owner < 0)
    tell_owner(c, stop->signal, -1, ECAT_OUTPUTS_SAFE, output->reason);
  if (c->now_ns > stop->until_ns - stop->patience_ns) /* otherwise there was nothing to stop */
    (void)cyclic_emit(c, CYCLIC_EVENT_STOPPED, c->signals[stop->signal].slave, -1,
                      (uint32_t)stands);
  return 0;
}

void cyclic_outputs_stop_drives(cyclic_t *c) {
  uint32_t i, running = 0;
  for (i = 0; i < c->stops; i++) {
    struct stop *stop = &c->stop_sequence[i];
    if (stop->running) stop->running = goes_on(c, stop);
    running += (uint32_t)stop->running;
  }
  __atomic_store_n(&c->stopping, running, __ATOMIC_RELEASE);
}

static void make_safe(cyclic_t *c, uint32_t signal, uint32_t reason) {
  uint32_t bit = bit_of(c, signal), bits = c->signals[signal].bit_length;
  uint64_t hold = bits_get(c->hold, bit, bits), safe = bits_get(c->safe, bit, bits);
  uint64_t now = bits_get(c->outputs, bit, bits);
  bits_put(c->outputs, bit, bits, (now & hold) | (safe & ~hold));
  tell_owner(c, signal, -1, ECAT_OUTPUTS_SAFE, reason);
}

/* Makes outputs safe; `number` is the slot that they belonged to, for the event of each slave. */
static void make_set_safe(cyclic_t *c, const uint64_t *set, int32_t number, uint32_t reason) {
  uint32_t word, i, words = claim_words(c);
  int32_t slave = -1;
  for (word = 0; word < words; word++) {
    uint64_t left;
    for (left = set[word]; left != 0; left &= left - 1) {
      uint32_t signal = 64 * word + (uint32_t)__builtin_ctzll(left);
      make_safe(c, signal, reason);
      if (c->signals[signal].slave == slave) continue;
      slave = c->signals[signal].slave;
      (void)cyclic_emit(c, CYCLIC_EVENT_SAFE, slave, number, reason);
    }
  }
  for (i = 0; i < c->stops; i++)
    if (set_has(set, c->stop_sequence[i].signal)) begin_stop(c, &c->stop_sequence[i]);
}

void cyclic_outputs_make_all_safe(cyclic_t *c, uint32_t reason) {
  uint32_t i;
  for (i = 0; i < ECAT_SLOTS; i++) {
    cyclic_outputs_drop(c, i, reason);
    (void)cyclic_can_drop(c, i, reason);
  }
  for (i = 0; i < c->header->signal_count; i++)
    if (c->signals[i].output && !set_has(c->reserved, i) && c->output[i].reason != reason)
      tell_owner(c, i, -1, c->output[i].state, reason);
}

/* --- owners --------------------------------------------------------------------------------- */

/* Computes the part of the output image with all outputs that a slot owns. */
static void measure(cyclic_t *c, struct slot *slot) {
  uint32_t words = (c->header->output_bytes + 7) / 8, first = 0, end = words;
  while (end > 0 && slot->mask[end - 1] == 0) end--;
  while (first < end && slot->mask[first] == 0) first++;
  slot->first = 8 * first;
  slot->bytes = 8 * (end - first);
}

void cyclic_outputs_drop(cyclic_t *c, uint32_t number, uint32_t reason) {
  struct slot *slot = &c->slot[number];
  size_t words = (c->header->output_bytes + 7) / 8;
  if (slot->bytes == 0) return;
  make_set_safe(c, slot->claims, (int32_t)number, reason);
  memset(slot->claims, 0, claim_words(c) * sizeof *slot->claims);
  memset(slot->mask, 0, words * sizeof *slot->mask);
  memset(slot->active, 0, words * sizeof *slot->active);
  slot->first = slot->bytes = 0;
}

static int32_t find_conflict(const cyclic_t *c, const struct slot *slot) {
  uint32_t word, words = claim_words(c);
  for (word = 0; word < words; word++) {
    uint64_t left;
    for (left = c->wanted[word] & ~slot->claims[word]; left != 0; left &= left - 1) {
      uint32_t signal = 64 * word + (uint32_t)__builtin_ctzll(left);
      if (c->output[signal].owner >= 0 || set_has(c->reserved, signal)) return (int32_t)signal;
    }
  }
  return -1;
}

static void grant(cyclic_t *c, uint32_t number, uint32_t signal) {
  struct slot *slot = &c->slot[number];
  bits_put((uint8_t *)slot->mask, bit_of(c, signal), c->signals[signal].bit_length, ~0ull);
  set_add(slot->claims, signal);
  tell_owner(c, signal, (int32_t)number, ECAT_OUTPUTS_CLAIMED, c->output[signal].reason);
}

static void grant_set(cyclic_t *c, uint32_t number) {
  const struct slot *slot = &c->slot[number];
  uint32_t word, words = claim_words(c);
  int32_t slave = -1;
  for (word = 0; word < words; word++) {
    uint64_t left;
    for (left = c->wanted[word] & ~slot->claims[word]; left != 0; left &= left - 1) {
      uint32_t signal = 64 * word + (uint32_t)__builtin_ctzll(left);
      grant(c, number, signal);
      if (c->signals[signal].slave == slave) continue;
      slave = c->signals[signal].slave;
      cyclic_emit(c, CYCLIC_EVENT_CLAIMED, slave, (int32_t)number, slot->generation);
    }
  }
}

static void take_back(cyclic_t *c, uint32_t number) {
  struct slot *slot = &c->slot[number];
  uint32_t word, words = claim_words(c);
  uint64_t *released = c->wanted; /* no longer needed */
  for (word = 0; word < words; word++) {
    uint64_t left;
    released[word] = slot->claims[word] & ~c->wanted[word];
    slot->claims[word] &= ~released[word];
    for (left = released[word]; left != 0; left &= left - 1) {
      uint32_t signal = 64 * word + (uint32_t)__builtin_ctzll(left);
      uint32_t bit = bit_of(c, signal), bits = c->signals[signal].bit_length;
      bits_put((uint8_t *)slot->mask, bit, bits, 0);
      bits_put((uint8_t *)slot->active, bit, bits, 0);
    }
  }
  make_set_safe(c, released, (int32_t)number, ECAT_REASON_RELEASED);
}

int32_t cyclic_outputs_claim(cyclic_t *c, uint32_t number) {
  uint32_t word, words = claim_words(c);
  int32_t conflict;
  for (word = 0; word < words; word++) c->wanted[word] &= c->claimable[word] | c->reserved[word];
  conflict = __atomic_load_n(&c->make_safe, __ATOMIC_RELAXED) ? CYCLIC_CONFLICT_STOPPING
                                                              : find_conflict(c, &c->slot[number]);
  if (conflict == CYCLIC_CONFLICT_NONE) grant_set(c, number);
  take_back(c, number);
  measure(c, &c->slot[number]);
  return conflict;
}

int cyclic_outputs_has_domain(const cyclic_t *c, uint32_t number, uint32_t domain) {
  const uint8_t *mask = (const uint8_t *)c->slot[number].mask + c->domain[domain].output_base;
  uint32_t i;
  if (c->slot[number].bytes == 0) return 0;
  for (i = 0; i < c->domain[domain].output_bytes; i++)
    if (mask[i] != 0) return 1;
  return 0;
}

/* --- values --------------------------------------------------------------------------------- */

/* The comparison is false for NaN, so NaN is out of every range. */
static int is_within(const struct rule *rule, uint64_t bits) {
  double value = raw_to_double(bits, rule->bits, rule->sign, rule->real);
  return value >= rule->minimum && value <= rule->maximum;
}

static void save_limited(cyclic_t *c, uint32_t number) {
  uint32_t i;
  for (i = 0; i < c->limits->count; i++) {
    struct limit *limit = &c->limits->limit[i];
    if (c->output[limit->signal].owner == (int32_t)number)
      limit->before = bits_get(c->outputs, limit->bit, limit->rule.bits);
  }
}

/* Undoes values of a commit that are out of their declared range: the earlier value stays. */
static void enforce_limits(cyclic_t *c, uint32_t number) {
  ecat_shm_slot_status *status = &c->slot_status[number];
  uint32_t i;
  for (i = 0; i < c->limits->count; i++) {
    struct limit *limit = &c->limits->limit[i];
    uint64_t bits;
    if (c->output[limit->signal].owner != (int32_t)number) continue;
    bits = bits_get(c->outputs, limit->bit, limit->rule.bits);
    if (is_within(&limit->rule, bits)) {
      limit->told = 0;
      continue;
    }
    if (bits == limit->before) continue;
    bits_put(c->outputs, limit->bit, limit->rule.bits, limit->before);
    counter_add(&c->health->refused, 1);
    __atomic_store_n(&status->refused, status->refused + 1, __ATOMIC_RELAXED);
    if (!limit->told)
      limit->told = cyclic_emit(c, CYCLIC_EVENT_REFUSED, c->signals[limit->signal].slave,
                                (int32_t)number, limit->signal);
  }
}

static void tell_active(cyclic_t *c, uint32_t number) {
  const struct slot *slot = &c->slot[number];
  uint32_t word, words = claim_words(c);
  for (word = 0; word < words; word++) {
    uint64_t left;
    for (left = slot->claims[word]; left != 0; left &= left - 1) {
      uint32_t signal = 64 * word + (uint32_t)__builtin_ctzll(left);
      if (c->output[signal].state != ECAT_OUTPUTS_ACTIVE &&
          bits_get((const uint8_t *)slot->active, bit_of(c, signal), 1))
        tell_owner(c, signal, (int32_t)number, ECAT_OUTPUTS_ACTIVE, c->output[signal].reason);
    }
  }
}

void cyclic_outputs_take(cyclic_t *c, uint32_t number, const uint64_t *part) {
  struct slot *slot = &c->slot[number];
  uint32_t i, at = slot->first / 8, words = slot->bytes / 8;
  const uint64_t *written = part, *values = part + words;
  uint64_t *to = (uint64_t *)(void *)c->outputs + at, fresh = 0;
  if (c->limits->count > 0) save_limited(c, number);
  for (i = 0; i < words; i++) {
    uint64_t mask = written[i] & slot->mask[at + i];
    to[i] = (to[i] & ~mask) | (values[i] & mask);
    fresh |= mask & ~slot->active[at + i];
    slot->active[at + i] |= mask;
  }
  if (c->limits->count > 0) enforce_limits(c, number);
  if (fresh != 0) tell_active(c, number);
}

/* --- declared ranges ------------------------------------------------------------------------ */

/* Holds an output, or its safe value, at the limits of a range that has become narrower. */
static int hold(cyclic_t *c, uint8_t *image, const struct limit *limit) {
  uint64_t bits = bits_get(image, limit->bit, limit->rule.bits);
  struct value value = {.scale = 1, .analog = 1};
  if (is_within(&limit->rule, bits) || c->output[limit->signal].state == ECAT_OUTPUTS_STOPPING) return 0;
  value.real = raw_to_double(bits, limit->rule.bits, limit->rule.sign, limit->rule.real);
  if (value_encode(&limit->rule, &value, &bits) != 0) /* infinite, or no number */
    bits = bits_get(c->safe, limit->bit, limit->rule.bits);
  bits_put(image, limit->bit, limit->rule.bits, bits);
  return 1;
}

/* Control has checked all safe values but those that follow an input. */
static int safe_follows(const cyclic_t *c, uint32_t signal) {
  uint32_t i;
  for (i = 0; i < c->copies; i++)
    if (c->copy[i].follows && c->copy[i].target == signal) return 1;
  return 0;
}

void cyclic_outputs_adopt_limits(cyclic_t *c) {
  struct limits *wanted = __atomic_load_n(&c->wanted_limits, __ATOMIC_ACQUIRE);
  uint32_t i;
  if (wanted == c->limits) return;
  for (i = 0; i < wanted->count; i++) {
    struct limit *limit = &wanted->limit[i];
    if (safe_follows(c, limit->signal)) (void)hold(c, c->safe, limit);
    limit->held = hold(c, c->outputs, limit);
  }
  __atomic_store_n(&c->limits, wanted, __ATOMIC_RELEASE); /* from now on control may free the others */
}

static int is_limited(const ecat_shm_signal *s) {
  return s->output && (s->minimum > -HUGE_VAL || s->maximum < HUGE_VAL);
}

/* Makes the ranges that the signal table declares. NULL: there is no memory. */
static struct limits *make_limits(const cyclic_t *c) {
  struct limits *made;
  uint32_t i, count = 0;
  size_t size;
  for (i = 0; i < c->header->signal_count; i++) count += (uint32_t)is_limited(&c->signals[i]);
  size = sizeof *made + count * sizeof *made->limit + c->copies * sizeof *made->copy;
  made = calloc(1, size);
  if (made == NULL) return NULL;
  made->size = size;
  made->limit = (void *)(made + 1);
  made->copy = (void *)(made->limit + count);
  for (i = 0; i < c->header->signal_count; i++) {
    const ecat_shm_signal *s = &c->signals[i];
    if (!is_limited(s)) continue;
    made->limit[made->count++] =
        (struct limit){.signal = i,
                       .bit = bit_of(c, i),
                       .rule = value_rule(s->type, s->bit_length, s->minimum, s->maximum)};
  }
  for (i = 0; i < c->copies; i++) made->copy[i] = cyclic_copy_limit(c, &c->copy[i]);
  return made;
}

int cyclic_use_limits(cyclic_t *c, uint32_t *held, uint32_t room) {
  struct limits *made = make_limits(c), *before = c->limits;
  uint32_t i, count = 0;
  if (made == NULL) return -ENOMEM;
  __atomic_store_n(&c->wanted_limits, made, __ATOMIC_RELEASE);
  if (c->started == 0) c->limits = made;
  while (__atomic_load_n(&c->limits, __ATOMIC_ACQUIRE) != made)
    nanosleep(&(struct timespec){0, 100000}, NULL);
  free(before);
  for (i = 0; i < made->count && count < room; i++)
    if (made->limit[i].held) held[count++] = made->limit[i].signal;
  return (int)count;
}

/* --- settings before the start -------------------------------------------------------------- */

int cyclic_set_stop(cyclic_t *c, uint32_t controlword, uint32_t statusword, uint32_t value,
                    uint64_t patience_ns) {
  struct stop *grown;
  if (controlword >= c->header->signal_count || statusword >= c->header->signal_count ||
      !c->signals[controlword].output || c->signals[statusword].output ||
      c->signals[controlword].bit_length != 16 || c->signals[statusword].bit_length != 16 ||
      c->started)
    return -EINVAL;
  grown = realloc(c->stop_sequence, (c->stops + 1) * sizeof *grown);
  if (grown == NULL) return -ENOMEM;
  c->stop_sequence = grown;
  c->stop_sequence[c->stops++] = (struct stop){.signal = controlword,
                                               .bit = bit_of(c, controlword),
                                               .domain = c->signals[statusword].domain,
                                               .status_bit = c->signals[statusword].bit_offset,
                                               .value = value,
                                               .patience_ns = patience_ns};
  return 0;
}
