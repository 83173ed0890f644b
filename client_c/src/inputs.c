/* Sampling, reading and waiting. All data is loaded from the daemon's shared memory. */
#include "internal.h"

#include <errno.h>
#include <linux/futex.h>
#include <string.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

/* Copies the images of domains [first, end). */
static int sample(ecat_t *bus, int first, int end) {
  uint64_t newest = 0; /* domains with a divider may have been exchanged earlier */
  int i, age, code;
  for (i = first; i < end; i++) bus->snapshot[i].fresh = 0;
  if ((code = ecat_memory_return(bus)) != 0) return code;
  for (i = first; i < end; i++) {
    struct snapshot *snapshot = &bus->snapshot[i];
    if (ecat_page_copy(snapshot) != 0) {
      code = ecat_fail(bus, ECAT_ESTALE,
                       "no consistent image of domain %d of bus '%s' could be read: the daemon "
                       "stopped while writing it", i, bus->name);
      continue;
    }
    snapshot->fresh = 1;
    snapshot->waited_cycle = snapshot->cycle;
    if (snapshot->cycle > newest) newest = snapshot->cycle;
  }
  if (bus->sample_cycle < newest) bus->sample_cycle = newest;
  if (bus->waited_cycle < newest) bus->waited_cycle = newest;
  if (bus->doorbell != NULL && !ecat_slot_foreign(bus))
    ecat_beat(bus);
  if ((age = ecat_memory_age(bus)) == 0) return code;
  for (i = first; i < end; i++) bus->snapshot[i].fresh = 0;
  return age;
}

int ecat_sample_domain(ecat_t *bus, int number) {
  int code = ecat_check_domain(bus, number);
  return code != 0 ? code : sample(bus, number, number + 1);
}

int ecat_sample(ecat_t *bus) {
  if (bus->map == NULL) return ecat_memory_check(bus, 0);
  return sample(bus, 0, ecat_domain_count(bus));
}

int ecat_domain(ecat_t *bus, int number, ecat_domain_info *info) {
  const struct snapshot *snapshot;
  uint64_t now = ecat_now();
  int code = ecat_check_domain(bus, number);
  if (code != 0) return code;
  snapshot = &bus->snapshot[number];
  info->name = bus->domains[number].name;
  info->divider = bus->domains[number].divider;
  info->cycle = snapshot->cycle;
  info->time_ns = snapshot->time_ns;
  info->age = snapshot->time_ns == 0    ? ECAT_AGE_NEVER
              : now > snapshot->time_ns ? (double)(now - snapshot->time_ns) * 1e-9
                                        : 0;
  info->wkc = snapshot->wkc;
  info->wkc_expected = bus->domains[number].wkc_expected;
  info->wkc_state = (int)snapshot->wkc_state;
  return 0;
}

const void *ecat_image(ecat_t *bus, int number, size_t *size) {
  if (ecat_check_domain(bus, number) != 0) return NULL;
  *size = bus->domains[number].image_bytes;
  return bus->snapshot[number].image;
}

int ecat_validity(ecat_t *bus, int number) {
  const struct snapshot *snapshot;
  const struct signal *signal;
  unsigned state;
  int code = ecat_check_signal(bus, number);
  if (code != 0) return code;
  signal = &bus->signal[number];
  snapshot = &bus->snapshot[signal->domain];
  if (snapshot->cycle == 0) return ECAT_NEVER;
  if (!snapshot->fresh) return ECAT_STALE;
  if (snapshot->wkc_state != ECAT_WKC_COMPLETE ||
      (signal->group >= 0 && (snapshot->absent >> signal->group & 1) != 0))
    return ECAT_INCOMPLETE;
  state = __atomic_load_n(&bus->slave_status[signal->slave].al_state, __ATOMIC_RELAXED);
  /* A slave delivers inputs in SAFEOP, but takes outputs only in OP (ETG.1000.6, 6.4.1). 0x10 is the
   * error flag; with it the comparison fails, so the entry is not valid. */
  return state == 8 || (state == 4 && !signal->output) ? ECAT_VALID : ECAT_NOT_OPERATIONAL;
}

/* The raw bits of an entry in the last sample. */
static uint64_t sampled(const struct signal *signal) {
  return bits_get((const uint8_t *)signal->at, signal->bit % 64, signal->bits);
}

/* The fast path, for integers that lie within one word. It loads the whole word, as the sample stored it:
 * a load that overlaps two stores still in flight would have to wait for both. */
static inline int64_t integer(const struct signal *signal) {
  uint64_t word = *signal->at << signal->up;
  if (signal->reading == READ_SIGNED) return (int64_t)word >> signal->down;
  return (int64_t)(word >> signal->down);
}

int ecat_read(ecat_t *bus, int number, double *value) {
  const struct signal *signal;
  if ((uint32_t)number >= bus->header->signal_count) return ecat_no_signal(bus, number);
  signal = &bus->signal[number];
  if (signal->reading != READ_OTHERWISE)
    *value = (double)integer(signal);
  else
    *value = raw_to_double(sampled(signal), signal->bits, signal->sign, signal->real);
  return 0;
}

/* The value of a REAL entry as an integer. */
static int rounded(ecat_t *bus, double real, int64_t *value) {
  real = ecat_round(real);
  if (!(real >= -9223372036854775808.0 && real < 9223372036854775808.0)) /* true for NaN, too */
    return ecat_fail(bus, ECAT_ERANGE, "%g is no 64-bit integer", real);
  *value = (int64_t)real;
  return 0;
}

int ecat_read_int(ecat_t *bus, int number, int64_t *value) {
  const struct signal *signal;
  if ((uint32_t)number >= bus->header->signal_count) return ecat_no_signal(bus, number);
  signal = &bus->signal[number];
  if (signal->reading != READ_OTHERWISE)
    *value = integer(signal);
  else if (signal->real)
    return rounded(bus, raw_to_double(sampled(signal), signal->bits, 0, 1), value);
  else
    *value = signal->sign ? sign_extended(sampled(signal), signal->bits) : (int64_t)sampled(signal);
  return 0;
}

int ecat_read_physical(ecat_t *bus, int number, double *value) {
  int code = ecat_read(bus, number, value);
  if (code == 0) *value = ecat_to_physical(*value, bus->signals[number].scale, bus->signals[number].offset);
  return code;
}

int ecat_wait_until(ecat_t *bus, const uint64_t *cycle, uint64_t target, uint32_t wake,
                    double timeout) {
  uint64_t start = ecat_now(), limit = ecat_ns(timeout);
  for (;;) {
    uint32_t word = __atomic_load_n(&bus->header->cycle_word, __ATOMIC_ACQUIRE);
    uint64_t now, slice = 20000000u;
    struct timespec until;
    int code;
    if (__atomic_load_n(cycle, __ATOMIC_ACQUIRE) >= target) return 0;
    if ((code = ecat_memory_age(bus)) != 0) return code;
    now = ecat_now();
    if (now - start >= limit)
      return ecat_fail(bus, ECAT_ETIMEOUT, "bus '%s': cycle %llu did not come within %g s",
                       bus->name, (unsigned long long)target, timeout);
    /* Waits in slices of at most 20 ms: if the daemon is killed, no process wakes the futex, and only
     * the check of the lock can notice it. */
    if (slice > limit - (now - start)) slice = limit - (now - start);
    now += slice;
    until.tv_sec = (time_t)(now / NS_PER_S);
    until.tv_nsec = (long)(now % NS_PER_S);
    syscall(SYS_futex, &bus->header->cycle_word, FUTEX_WAIT_BITSET, word, &until, NULL, wake);
  }
}

/* Waits for a daemon that has ended. It sleeps between two attempts, so that a program that waits in a
 * loop does not keep a processor busy. */
static int wait_return(ecat_t *bus, double timeout) {
  uint64_t start = ecat_now(), limit = ecat_ns(timeout), passed = 0;
  int code;
  while ((code = ecat_memory_return(bus)) != 0 && passed < limit) {
    struct timespec pause = {0, RETURN_PAUSE_NS};
    if (limit - passed < RETURN_PAUSE_NS) pause.tv_nsec = (long)(limit - passed);
    nanosleep(&pause, NULL);
    passed = ecat_now() - start;
    if (code != ECAT_EDOWN) break; /* the daemon is back with another bus: waiting would not help */
  }
  return code;
}

static int check_timeout(ecat_t *bus, double timeout) {
  if (timeout >= 0) return 0;
  return ecat_fail(bus, ECAT_EARG, "%g s is no time to wait", timeout);
}

int ecat_wait(ecat_t *bus, unsigned cycles, double timeout) {
  int code = check_timeout(bus, timeout);
  if (code != 0 || (code = wait_return(bus, timeout)) != 0) return code;
  /* Without a sample before, the first call counts from the current cycle. */
  if (bus->waited_cycle == 0) bus->waited_cycle = ecat_cycle(bus);
  code = ecat_wait_until(bus, &bus->header->cycle, bus->waited_cycle + cycles, ECAT_WAKE_CYCLE,
                         timeout);
  if (code == 0) bus->waited_cycle = ecat_cycle(bus);
  return code;
}

/* The cycle in which a domain has its turn, `turns` turns after the one exchanged in `cycle`. If that
 * exchange was late, the turns after it stay where they were. */
static uint64_t turn_after(const ecat_shm_domain *domain, uint64_t cycle, unsigned turns) {
  uint64_t divider = domain->divider;
  uint64_t late = (cycle + divider - domain->phase % divider) % divider;
  uint64_t target = cycle + turns * divider;
  return target > late ? target - late : 0;
}

int ecat_wait_domain(ecat_t *bus, int number, unsigned exchanges, double timeout) {
  struct snapshot *snapshot;
  int code = ecat_check_domain(bus, number);
  if (code != 0 || (code = check_timeout(bus, timeout)) != 0) return code;
  if ((code = wait_return(bus, timeout)) != 0) return code;
  snapshot = &bus->snapshot[number];
  if (snapshot->waited_cycle == 0)
    snapshot->waited_cycle = __atomic_load_n(&snapshot->page->cycle, __ATOMIC_RELAXED);
  code = ecat_wait_until(bus, &snapshot->page->cycle,
                         turn_after(&bus->domains[number], snapshot->waited_cycle, exchanges),
                         1u << number, timeout);
  if (code == 0) snapshot->waited_cycle = __atomic_load_n(&snapshot->page->cycle, __ATOMIC_RELAXED);
  return code;
}
