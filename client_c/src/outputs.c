/* Staging outputs and committing them. */
#include "internal.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

/* Fills in the error text of ECAT_ELEASE. The remedy is left out for a session (`program` is set), which
 * claims again by itself. */
static int fail_lease(ecat_t *bus, const char *before, const char *after, const char *remedy) {
  return ecat_fail(bus, ECAT_ELEASE, "bus '%s': %s%s%s%s", bus->name, before,
                   bus->program != NULL ? bus->program : "this client", after,
                   bus->program != NULL ? "" : remedy);
}

static int claims_lost(ecat_t *bus) {
  if (bus->lost == LOST_PLACE)
    return fail_lease(bus, "another program has written over the place of ",
                      " in the shared memory, and its outputs are at their safe values",
                      "; claim them again");
  return fail_lease(bus, "the daemon has ended, and with it the claims of ", "",
                    "; claim the outputs again when it is back");
}

static int lapsed(ecat_t *bus) {
  char after[160];
  uint32_t reason =
      __atomic_load_n(&bus->slot_status[bus->slot].reason, __ATOMIC_RELAXED);
  if (ecat_slot_overwritten(bus)) bus->lost = LOST_PLACE;
  memset(bus->claims, 0, 2 * bus->sets * sizeof *bus->claims); /* and `written` */
  memset(bus->mask, 0, bus->header->output_bytes);
  bus->first = bus->bytes = 0;
  if (bus->lost) return claims_lost(bus);
  if (reason == ECAT_REASON_WKC)
    return fail_lease(bus, "slaves did not take part in the exchange (wrong working counter), so the "
                      "outputs of ", " are at their safe values",
                      "; claim them again when the bus is complete");
  if (reason == ECAT_REASON_DIED)
    return fail_lease(bus, "another program has marked ", " as dead in the shared memory, and its outputs "
                      "are at their safe values", "; claim them again");
  snprintf(after, sizeof after, " did not sample in time and lost its outputs, which are at their safe "
           "values now");
  if (bus->longest_ns > 0)
    sprintf(after + strlen(after), " (its lease is %g s)", (double)bus->longest_ns * 1e-9);
  return fail_lease(bus, "", after, "; claim them again with a longer one");
}

/* The entry if this client may write it, else NULL with an error code in `*code`. */
static const struct signal *writable(ecat_t *bus, int number, int *code) {
  const struct signal *signal;
  if ((*code = ecat_check_output(bus, number)) != 0) return NULL;
  signal = &bus->signal[number];
  if (set_has(bus->claims, (uint32_t)number)) return signal;
  if (bus->lost) {
    *code = claims_lost(bus);
    return NULL;
  }
  if (ecat_slot_lapsed(bus)) {
    *code = lapsed(bus);
    return NULL;
  }
  *code = ecat_fail(bus, ECAT_ECLAIM, "0x%04X:%02X of slave %d (%s) must be claimed before it is "
                    "written", bus->signals[number].index, bus->signals[number].subindex,
                    signal->slave, ecat_shown(bus->slaves[signal->slave].name));
  return NULL;
}

/* Fails with the allowed range of an output, in the numbers in which the program wrote: raw values, or
 * physical ones. */
static int out_of_range(ecat_t *bus, int number, const struct value *value) {
  const ecat_shm_signal *entry = &bus->signals[number];
  const struct rule *rule = &bus->rule[number];
  const char *what = value->analog ? "values" : rule->real ? "numbers" : "whole numbers";
  int own = value->scale != entry->scale || value->offset != entry->offset;
  const char *unit = value->analog && !own ? entry->unit : "", *space = unit[0] != '\0' ? " " : "";
  double first, last;
  value_limits(rule, &first, &last);
  first = ecat_to_physical(first, value->scale, value->offset);
  last = ecat_to_physical(last, value->scale, value->offset);
  return ecat_fail(bus, ECAT_ERANGE,
                   "%.15g%s%s is out of range for 0x%04X:%02X (%s) of slave %d (%s): %s from %.15g to "
                   "%.15g%s%s are allowed",
                   value->is_whole ? (double)value->whole : value->real, space, unit, entry->index,
                   entry->subindex, ecat_shown(entry->name), entry->slave,
                   ecat_shown(bus->slaves[entry->slave].name), what, fmin(first, last), fmax(first, last), space, unit);
}

/* Encodes a value into the output image that the next commit copies. */
static int stage(ecat_t *bus, int number, const struct value *value) {
  const struct signal *signal;
  uint64_t bits;
  int code = 0;
  if ((signal = writable(bus, number, &code)) == NULL) return code;
  if (value_encode(&bus->rule[number], value, &bits) != 0) return out_of_range(bus, number, value);
  if (signal->staged % 8 == 0 && signal->bits % 8 == 0)
    memcpy((uint8_t *)bus->stage + signal->staged / 8, &bits, signal->bits / 8u);
  else
    bits_put((uint8_t *)bus->stage, signal->staged, signal->bits, bits);
  if (set_has(bus->written, (uint32_t)number)) return 0;
  set_add(bus->written, (uint32_t)number);
  bits_put((uint8_t *)bus->mask, signal->staged, signal->bits, ~0ull);
  return 0;
}

int ecat_write(ecat_t *bus, int number, double value) {
  struct value given = {value, 0, 1, 0, 0, 0};
  return stage(bus, number, &given);
}

int ecat_write_int(ecat_t *bus, int number, int64_t value) {
  struct value given = {0, value, 1, 0, 1, 0};
  return stage(bus, number, &given);
}

int ecat_write_scaled(ecat_t *bus, int number, double value, double scale, double offset) {
  struct value given = {value, 0, scale, offset, 0, 1};
  if (scale == 0 || !isfinite(scale) || !isfinite(offset))
    return ecat_fail(bus, ECAT_EARG, "a value cannot be scaled by %g with an offset of %g: the scale "
                     "must be a finite number other than 0", scale, offset);
  return stage(bus, number, &given);
}

int ecat_write_physical(ecat_t *bus, int number, double value) {
  const ecat_shm_signal *entry;
  struct value given = {value, 0, 1, 0, 0, 0};
  if (number >= 0 && number < ecat_signal_count(bus)) {
    entry = &bus->signals[number];
    given.scale = entry->scale;
    given.offset = entry->offset;
    given.analog = value_is_analog(entry->unit, entry->scale, entry->offset);
  }
  return stage(bus, number, &given);
}

/* Gives the engine the time to read an image. Otherwise a client that commits without a pause would
 * always overwrite the image before the engine has read it, and none of its values would go out. */
static void give_way(ecat_t *bus) {
  uint32_t overtaken = __atomic_load_n(&bus->slot_status[bus->slot].overtaken, __ATOMIC_RELAXED);
  uint64_t until;
  if (overtaken == bus->overtaken) return;
  bus->overtaken = overtaken;
  for (until = ecat_now() + GIVE_WAY_NS; ecat_now() < until;) continue;
}

int ecat_commit(ecat_t *bus) {
  ecat_out_image *image;
  uint64_t now;
  uint32_t seq;
  int code;
  if (bus->slot < 0) return bus->lost ? claims_lost(bus) : 0;
  if ((code = ecat_slot_check_home(bus)) != 0) return code;
  if (ecat_slot_lapsed(bus)) return lapsed(bus);
  if (bus->lost) return claims_lost(bus);
  ecat_beat(bus);
  if (bus->bytes == 0) return 0;
  give_way(bus);
  now = ecat_now();
  if (now - __atomic_load_n(&bus->header->cycle_end_ns, __ATOMIC_RELAXED) > LATE_NS &&
      ecat_memory_age(bus) == ECAT_EDOWN)
    return claims_lost(bus);
  seq = bus->doorbell->commit_seq + 1;
  image = (void *)((uint8_t *)bus->out + bus->layout.images_offset +
                   (size_t)(seq % ECAT_IMAGES) * bus->layout.image_stride);
  /* The engine reads `commit_seq` again after an image, and accepts the image only if the next commits
   * cannot have overwritten it. The number of the last commit must therefore be visible before any byte
   * of this one. */
  __atomic_thread_fence(__ATOMIC_RELEASE);
  image->seq = seq;
  image->first = bus->first;
  image->bytes = bus->bytes;
  image->generation = bus->generation;
  image->commit_ns = now;
  image->sample_cycle = bus->sample_cycle;
  memcpy(image + 1, (const uint8_t *)bus->mask + bus->first, bus->bytes);
  memcpy((uint8_t *)(image + 1) + bus->bytes, (const uint8_t *)bus->stage + bus->first, bus->bytes);
  __atomic_store_n(&bus->doorbell->commit_seq, seq, __ATOMIC_RELEASE);
  return 0;
}
