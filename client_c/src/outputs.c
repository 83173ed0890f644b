/* Staged outputs, and commits. */
#include "internal.h"

#include <float.h>
#include <math.h>
#include <string.h>

static int claims_lost(ecat_t *bus) {
  if (bus->lost == LOST_PLACE)
    return ecat_fail(bus, ECAT_ELEASE,
                     "bus '%s': another program has written over the place of this client in the "
                     "shared memory, and its outputs are at their safe values; claim them again",
                     bus->name);
  return ecat_fail(bus, ECAT_ELEASE,
                   "bus '%s': the daemon has ended, and with it the claims of this client; claim the "
                   "outputs again when it is back",
                   bus->name);
}

static int lapsed(ecat_t *bus) {
  uint32_t reason =
      __atomic_load_n(&bus->slot_status[bus->slot].reason, __ATOMIC_RELAXED);
  if (ecat_slot_overwritten(bus)) bus->lost = LOST_PLACE;
  memset(bus->claims, 0, 2 * bus->sets * sizeof *bus->claims); /* and `written` */
  memset(bus->mask, 0, bus->header->output_bytes);
  bus->first = bus->bytes = 0;
  if (bus->lost) return claims_lost(bus);
  if (reason == ECAT_REASON_WKC)
    return ecat_fail(bus, ECAT_ELEASE,
                     "bus '%s': slaves did not take part in the exchange (wrong working counter), so "
                     "outputs are at their safe values; claim them again when the bus is complete",
                     bus->name);
  return ecat_fail(bus, ECAT_ELEASE,
                   "bus '%s': this client did not sample in time and lost its outputs, which are at "
                   "their safe values now; claim them again with a longer lease",
                   bus->name);
}

/* The entry if this client may write it, else NULL and a code. */
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
                    signal->slave, bus->slaves[signal->slave].name);
  return NULL;
}

/* The raw values that an output can have. */
static void limits(const ecat_t *bus, int number, double *low, double *high) {
  const struct signal *signal = &bus->signal[number];
  const ecat_shm_signal *entry = &bus->signals[number];
  *low = signal->sign ? -ldexp(1, signal->bits - 1) : 0;
  *high = ldexp(1, signal->sign ? signal->bits - 1 : signal->bits) - 1;
  if (signal->real) *low = -(*high = signal->bits == 32 ? (double)FLT_MAX : DBL_MAX);
  if (entry->minimum > *low) *low = entry->minimum;
  if (entry->maximum < *high) *high = entry->maximum;
}

static int out_of_range(ecat_t *bus, int number, double value) {
  const struct signal *signal = &bus->signal[number];
  const ecat_shm_signal *entry = &bus->signals[number];
  double low, high;
  limits(bus, number, &low, &high);
  return ecat_fail(bus, ECAT_ERANGE,
                   "%.15g is out of range for 0x%04X:%02X (%s) of slave %d (%s): %s from %.15g to "
                   "%.15g are allowed",
                   value, entry->index, entry->subindex, entry->name, signal->slave,
                   bus->slaves[signal->slave].name, signal->real ? "numbers" : "whole numbers", low,
                   high);
}

/* The same as the program sees it, which gave a physical value. */
static int out_of_physical_range(ecat_t *bus, int number, double value) {
  const ecat_shm_signal *entry = &bus->signals[number];
  const char *space = entry->unit[0] != '\0' ? " " : "";
  double first, second;
  limits(bus, number, &first, &second);
  first = first * entry->scale + entry->offset;
  second = second * entry->scale + entry->offset;
  return ecat_fail(bus, ECAT_ERANGE,
                   "%.15g%s%s is out of range for 0x%04X:%02X (%s) of slave %d (%s): values from "
                   "%.15g to %.15g%s%s are allowed",
                   value, space, entry->unit, entry->index, entry->subindex, entry->name,
                   entry->slave, bus->slaves[entry->slave].name, fmin(first, second),
                   fmax(first, second), space, entry->unit);
}

/* Puts the bits of a value, which fits its type, where the next commit takes them from. */
static int stage(ecat_t *bus, int number, uint64_t bits) {
  const struct signal *signal = &bus->signal[number];
  if (signal->limited) {
    double value = raw_to_double(bits, signal->bits, signal->sign, signal->real);
    if (!(value >= bus->signals[number].minimum && value <= bus->signals[number].maximum))
      return out_of_range(bus, number, value);
  }
  if (signal->staged % 8 == 0 && signal->bits % 8 == 0)
    memcpy((uint8_t *)bus->stage + signal->staged / 8, &bits, signal->bits / 8u);
  else
    bits_put((uint8_t *)bus->stage, signal->staged, signal->bits, bits);
  if (set_has(bus->written, (uint32_t)number)) return 0;
  set_add(bus->written, (uint32_t)number);
  bits_put((uint8_t *)bus->mask, signal->staged, signal->bits, ~0ull);
  return 0;
}

int ecat_write_int(ecat_t *bus, int number, int64_t value) {
  int code = 0;
  uint64_t bits;
  const struct signal *signal = writable(bus, number, &code);
  if (signal == NULL) return code;
  if (signal->real) return ecat_write(bus, number, (double)value);
  if (signal->bits < 64) {
    int64_t low = signal->sign ? -((int64_t)1 << (signal->bits - 1)) : 0;
    int64_t high = (int64_t)((1ull << (signal->bits - signal->sign)) - 1);
    if (value < low || value > high) return out_of_range(bus, number, (double)value);
  }
  bits = (uint64_t)value;
  if (signal->bits < 64) bits &= (1ull << signal->bits) - 1;
  return stage(bus, number, bits);
}

int ecat_write(ecat_t *bus, int number, double value) {
  int code = 0;
  uint64_t bits = 0;
  const struct signal *signal = writable(bus, number, &code);
  if (signal == NULL) return code;
  if (signal->real) {
    if (!isfinite(value)) return out_of_range(bus, number, value);
    if (signal->bits == 32) {
      float single = (float)value;
      if (!isfinite(single)) return out_of_range(bus, number, value);
      memcpy(&bits, &single, 4);
    } else {
      memcpy(&bits, &value, 8);
    }
    return stage(bus, number, bits);
  }
  /* NaN fails both comparisons; 2^63 and 2^64 are exact as double, so the casts below are sound. */
  if (!(value >= -9223372036854775808.0 && value < 18446744073709551616.0) ||
      value != floor(value))
    return out_of_range(bus, number, value);
  if (value >= 9223372036854775808.0) {
    if (signal->sign || signal->bits < 64) return out_of_range(bus, number, value);
    return stage(bus, number, (uint64_t)value);
  }
  if (value < 0 && !signal->sign) return out_of_range(bus, number, value);
  return ecat_write_int(bus, number, (int64_t)value);
}

int ecat_write_physical(ecat_t *bus, int number, double value) {
  const ecat_shm_signal *entry;
  double raw;
  int code;
  if (number < 0 || number >= ecat_signal_count(bus)) return ecat_write(bus, number, value);
  entry = &bus->signals[number];
  raw = (value - entry->offset) / entry->scale;
  code = ecat_write(bus, number, bus->signal[number].real ? raw : nearbyint(raw));
  return code == ECAT_ERANGE ? out_of_physical_range(bus, number, value) : code;
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
  bus->doorbell->heartbeat++;
  if (bus->bytes == 0) return 0;
  now = ecat_now();
  if (now - __atomic_load_n(&bus->header->cycle_end_ns, __ATOMIC_RELAXED) > LATE_NS &&
      ecat_segment_age(bus) == ECAT_EDOWN)
    return claims_lost(bus);
  seq = bus->doorbell->commit_seq + 1;
  image = (void *)((uint8_t *)bus->out + bus->layout.images_offset +
                   (size_t)(seq % ECAT_IMAGES) * bus->layout.image_stride);
  /* The engine trusts an older image while this number is unchanged: no byte of this one may come
   * before the number of the last. */
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
