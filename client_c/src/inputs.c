/* Samples, reads and waiting: only loads from the daemon's segment. */
#include "internal.h"

#include <errno.h>
#include <linux/futex.h>
#include <string.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

int ecat_sample_domain(ecat_t *bus, int number) {
  struct snapshot *snapshot;
  uint64_t now, end;
  if (number < 0 || number >= ecat_domain_count(bus))
    return ecat_fail(bus, ECAT_EARG, "bus '%s' has no domain %d: it has %d", bus->name, number,
                     ecat_domain_count(bus));
  snapshot = &bus->snapshot[number];
  if (ecat_page_copy(snapshot->page, snapshot->image, snapshot->words, snapshot) != 0)
    return ecat_fail(bus, ECAT_ESTALE,
                     "no consistent image of domain %d of bus '%s' could be read: the daemon stopped "
                     "while writing it", number, bus->name);
  bus->sample_cycle = snapshot->cycle;
  if (bus->waited_cycle < snapshot->cycle) bus->waited_cycle = snapshot->cycle;
  if (bus->doorbell != NULL)
    __atomic_store_n(&bus->doorbell->heartbeat, bus->doorbell->heartbeat + 1, __ATOMIC_RELAXED);
  now = ecat_now();
  end = __atomic_load_n(&bus->header->cycle_end_ns, __ATOMIC_RELAXED);
  return ecat_segment_check(bus, now > end ? now - end : 0);
}

int ecat_sample(ecat_t *bus) {
  uint64_t newest = 0;
  int i, code = 0;
  if (bus->map == NULL) return ecat_segment_check(bus, 0);
  for (i = 0; i < ecat_domain_count(bus); i++) {
    int now = ecat_sample_domain(bus, i);
    if (code == 0) code = now;
    if (bus->snapshot[i].cycle > newest) newest = bus->snapshot[i].cycle;
  }
  bus->sample_cycle = newest; /* domains with a divider may be older */
  return code;
}

int ecat_domain(ecat_t *bus, int number, ecat_domain_info *info) {
  const struct snapshot *snapshot;
  uint64_t now = ecat_now();
  if (number < 0 || number >= ecat_domain_count(bus))
    return ecat_fail(bus, ECAT_EARG, "bus '%s' has no domain %d: it has %d", bus->name, number,
                     ecat_domain_count(bus));
  snapshot = &bus->snapshot[number];
  info->cycle = snapshot->cycle;
  info->time_ns = snapshot->time_ns;
  info->age = now > snapshot->time_ns ? (double)(now - snapshot->time_ns) * 1e-9 : 0;
  info->wkc = snapshot->wkc;
  info->wkc_expected = bus->domains[number].wkc_expected;
  info->wkc_state = (int)snapshot->wkc_state;
  return 0;
}

/* The bits of an entry of the last sample, or of a staged output, in the low bits of the result. */
static uint64_t raw_bits(const struct signal *signal, const uint8_t *image) {
  uint64_t word;
  memcpy(&word, image, 8);
  word >>= signal->shift;
  if (signal->shift + signal->bits > 64) word |= (uint64_t)image[8] << (64 - signal->shift);
  return signal->bits == 64 ? word : word & ((1ull << signal->bits) - 1);
}

static const struct signal *find(ecat_t *bus, int number) {
  if (number >= 0 && number < ecat_signal_count(bus)) return &bus->signal[number];
  ecat_fail(bus, ECAT_EARG, "%d is no signal: bus '%s' has %d", number, bus->name,
            ecat_signal_count(bus));
  return NULL;
}

static int64_t extended(const struct signal *signal, uint64_t bits) {
  if (signal->sign && signal->bits < 64 && (bits >> (signal->bits - 1) & 1))
    bits |= ~0ull << signal->bits;
  return (int64_t)bits;
}

static double as_double(const struct signal *signal, uint64_t bits) {
  if (!signal->real) {
    int64_t value = extended(signal, bits);
    return signal->sign ? (double)value : (double)(uint64_t)value;
  }
  if (signal->bits == 32) {
    uint32_t half = (uint32_t)bits;
    float value;
    memcpy(&value, &half, 4);
    return (double)value;
  } else {
    double value;
    memcpy(&value, &bits, 8);
    return value;
  }
}

static uint64_t sampled(const ecat_t *bus, const struct signal *signal) {
  const uint8_t *image = (const uint8_t *)bus->snapshot[signal->domain].image;
  return raw_bits(signal, image + signal->byte);
}

int ecat_read(ecat_t *bus, int number, double *value) {
  const struct signal *signal = find(bus, number);
  if (signal == NULL) return ECAT_EARG;
  *value = as_double(signal, sampled(bus, signal));
  return 0;
}

int ecat_read_int(ecat_t *bus, int number, int64_t *value) {
  const struct signal *signal = find(bus, number);
  if (signal == NULL) return ECAT_EARG;
  if (signal->real)
    *value = (int64_t)as_double(signal, sampled(bus, signal));
  else
    *value = extended(signal, sampled(bus, signal));
  return 0;
}

int ecat_read_physical(ecat_t *bus, int number, double *value) {
  int code = ecat_read(bus, number, value);
  if (code == 0) *value = *value * bus->signals[number].scale + bus->signals[number].offset;
  return code;
}

int ecat_wait(ecat_t *bus, unsigned cycles, double timeout) {
  uint64_t target = bus->waited_cycle + cycles;
  uint64_t start = ecat_now(), limit = ecat_ns(timeout);
  if (!(timeout >= 0))
    return ecat_fail(bus, ECAT_EARG, "%g s is no time to wait", timeout);
  if (bus->waited_cycle == 0) target = ecat_cycle(bus) + cycles; /* nothing sampled yet */
  for (;;) {
    uint32_t word = __atomic_load_n(&bus->header->cycle_word, __ATOMIC_ACQUIRE);
    uint64_t now, end, cycle = ecat_cycle(bus), slice = 20000000u;
    struct timespec relative;
    int code;
    if (cycle >= target) {
      bus->waited_cycle = cycle;
      return 0;
    }
    now = ecat_now();
    end = __atomic_load_n(&bus->header->cycle_end_ns, __ATOMIC_RELAXED);
    code = ecat_segment_check(bus, now > end ? now - end : 0);
    if (code != 0) return code;
    if (now - start >= limit)
      return ecat_fail(bus, ECAT_ETIMEOUT, "bus '%s': cycle %llu did not come within %g s",
                       bus->name, (unsigned long long)target, timeout);
    /* In slices, so that a daemon that was killed is noticed: nobody wakes the futex then. */
    if (slice > limit - (now - start)) slice = limit - (now - start);
    relative.tv_sec = 0;
    relative.tv_nsec = (long)slice;
    syscall(SYS_futex, &bus->header->cycle_word, FUTEX_WAIT, word, &relative, NULL, 0);
  }
}
