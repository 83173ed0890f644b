/* The life of an engine: memory, locking, start and end. */
#include "engine.h"
#include "relay.h"
#include "thread.h"

#include <errno.h>
#include <sched.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <sys/timerfd.h>
#include <unistd.h>

static void *at_offset(cyclic_t *c, uint32_t offset) { return (uint8_t *)c->header + offset; }

/* Whether there are cycles in which both domains are exchanged: if their phases differ by a multiple of
 * the greatest common divisor of their dividers. */
static int meet(const ecat_shm_domain *one, const ecat_shm_domain *other) {
  uint32_t a = one->divider, b = other->divider, rest;
  while (b != 0) {
    rest = a % b;
    a = b;
    b = rest;
  }
  return a == 0 || one->phase % a == other->phase % a;
}

/* Includes padding, since words are copied as a whole and bits_get() reads beyond the last byte. */
static size_t image_size(const cyclic_t *c) { return c->header->output_bytes + 16u; }

static size_t slot_image_size(const cyclic_t *c) {
  return sizeof(ecat_out_image) + 2 * image_size(c);
}

static int allocate_images(cyclic_t *c) {
  const ecat_shm_domain *table = at_offset(c, c->header->domains_offset);
  size_t size = image_size(c);
  uint32_t i, k;
  c->outputs = calloc(1, size);
  c->safe = calloc(1, size);
  c->hold = calloc(1, size);
  c->slot_image = calloc(1, slot_image_size(c));
  if (!c->outputs || !c->safe || !c->hold || !c->slot_image) return -ENOMEM;
  for (i = 0; i < c->domains; i++) {
    const ecat_shm_domain *from = &table[i];
    struct domain *to = &c->domain[i];
    to->status = (ecat_shm_domain_status *)at_offset(c, c->header->domain_status_offset) + i;
    to->page = at_offset(c, from->page_offset);
    to->image_bytes = from->image_bytes;
    to->output_bytes = from->output_bytes;
    to->output_base = from->output_base;
    to->divider = from->divider > 0 ? from->divider : 1;
    to->next_cycle = from->phase > 0 ? from->phase : to->divider; /* cycle 1 is the first */
    for (k = 0; k < c->domains; k++) to->meets |= (uint32_t)meet(from, &table[k]) << k;
    to->told_state = ECAT_WKC_ZERO;
    to->wkc_expected = from->wkc_expected;
    to->image = calloc(1, from->image_bytes + 16u);
    if (!to->image) return -ENOMEM;
  }
  return 0;
}

static void set_sockets(cyclic_t *c, int first_fd, int second_fd) {
  c->fd[0] = c->wanted_fd[0] = first_fd;
  c->fd[1] = c->wanted_fd[1] = second_fd;
  c->ports = second_fd >= 0 ? 2 : 1;
}

cyclic_t *cyclic_new(void *header, int out_fd, int first_fd, int second_fd, uint32_t run) {
  cyclic_t *c = calloc(1, sizeof *c);
  int code = -EINVAL;
  if (c == NULL) return NULL;
  c->header = header;
  c->out_fd = out_fd;
  set_sockets(c, first_fd, second_fd);
  c->source[0] = 0x02; /* an address of local use; slaves set this bit in any case */
  put32(c->source + 1, run);
  c->slaves = at_offset(c, c->header->slaves_offset);
  c->signals = at_offset(c, c->header->signals_offset);
  c->output = at_offset(c, c->header->outputs_offset);
  c->slot_status = at_offset(c, c->header->slot_status_offset);
  c->replies = at_offset(c, c->header->replies_offset);
  c->health = at_offset(c, c->header->health_offset);
  c->health->mailbox.min_ns = UINT64_MAX;
  c->health->dc_reference = -1;
  c->domains = c->header->domain_count;
  cyclic_frames_init(c);
  c->timer_fd = timerfd_create(CLOCK_MONOTONIC, TFD_CLOEXEC);
  if (c->timer_fd < 0) code = -errno;
  if (c->timer_fd >= 0 && c->domains <= ECAT_MAX_DOMAINS && (code = allocate_images(c)) == 0 &&
      (code = cyclic_outputs_init(c)) == 0 && (code = cyclic_slots_init(c)) == 0) {
    cyclic_publish_restart(c);
    return c;
  }
  cyclic_free(c);
  errno = -code;
  return NULL;
}

int cyclic_set_safe(cyclic_t *c, uint32_t slave, const uint8_t *value, const uint8_t *hold) {
  const ecat_shm_slave *s;
  uint32_t at;
  if (slave >= c->header->slave_count) return -EINVAL;
  s = &c->slaves[slave];
  at = c->domain[s->domain].output_base + s->output_offset;
  memcpy(c->safe + at, value, s->output_bytes);
  memcpy(c->hold + at, hold, s->output_bytes);
  memcpy(c->outputs + at, value, s->output_bytes);
  return 0;
}

/* Writes to each page of memory that the engine will use, so that cycles cause no page faults even if the
 * memory may not be locked. The write is atomic and changes nothing, since control may write into the
 * shared memory at the same time. */
static void prefault(void *memory, size_t size) {
  uint8_t *bytes = memory;
  size_t i;
  if (size == 0) return;
  for (i = 0; i < size; i += 4096) __atomic_fetch_or(&bytes[i], 0, __ATOMIC_RELAXED);
  __atomic_fetch_or(&bytes[size - 1], 0, __ATOMIC_RELAXED);
}

static void prefault_stack(void) {
  uint8_t stack[64 * 1024];
  prefault(memset(stack, 0, sizeof stack), sizeof stack);
}

static void prefault_memory(cyclic_t *c) {
  size_t image = image_size(c);
  uint32_t i;
  prefault_stack();
  prefault(c, sizeof *c);
  prefault(c->header, c->header->size);
  prefault(c->outputs, image);
  prefault(c->safe, image);
  prefault(c->hold, image);
  prefault(c->slot_image, slot_image_size(c));
  for (i = 0; i < c->domains; i++) prefault(c->domain[i].image, c->domain[i].image_bytes + 16u);
  for (i = 0; i < c->splits; i++)
    if (c->split[i].inputs != NULL) prefault(c->split[i].inputs, c->split[i].length);
  cyclic_outputs_prefault(c, prefault);
  cyclic_can_prefault(c, prefault);
}

/* Among ordinary threads, those that ask for short slices are run sooner (Linux 6.12). */
static void ask_for_short_slices(void) {
  struct {
    uint32_t size, policy;
    uint64_t flags;
    int32_t nice;
    uint32_t priority;
    uint64_t runtime, deadline, period;
  } attributes = {.size = 48, .policy = SCHED_OTHER, .runtime = 100000 /* ns */};
  (void)syscall(SYS_sched_setattr, 0, &attributes, 0);
}

static void *thread_main(void *argument) {
  cyclic_t *c = argument;
  if (prctl(PR_SET_TIMERSLACK, 1) != 0) c->slack_error = errno;
  prefault_memory(c);
  if (c->settings.cpu >= 0) {
    cpu_set_t set;
    CPU_ZERO(&set);
    CPU_SET((size_t)c->settings.cpu, &set);
    if (sched_setaffinity(0, sizeof set, &set) != 0) c->affinity_error = errno;
  }
  c->scheduling_error = cyclic_thread_become("ecat-cyclic", c->settings.priority);
  if (c->settings.priority == 0 || c->scheduling_error != 0) ask_for_short_slices();
  __atomic_store_n(&c->started, 2, __ATOMIC_RELEASE);
  cyclic_run(c);
  return NULL;
}

/* Locks all present and future memory of the process. Returns 0 or errno. With a finite limit mlockall()
 * may succeed, but later allocations beyond the limit would fail. A test mapping that is larger than the
 * limit shows whether the limit is in force. */
static int lock_memory(void) {
  struct rlimit limit;
  void *probe;
  if (mlockall(MCL_CURRENT | MCL_FUTURE) != 0) return errno;
  if (getrlimit(RLIMIT_MEMLOCK, &limit) != 0 || limit.rlim_cur == RLIM_INFINITY) return 0;
  probe = mmap(NULL, limit.rlim_cur + 4096, PROT_NONE,
               MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
  if (probe == MAP_FAILED) {
    munlockall();
    return ENOMEM;
  }
  munmap(probe, limit.rlim_cur + 4096);
  return 0;
}

int cyclic_start(cyclic_t *c, const cyclic_settings *settings) {
  int code;
  if (!cyclic_frames_fit(c)) return -ENOSPC;
  if ((code = cyclic_use_limits(c, NULL, 0)) != 0) return code;
  c->settings = *settings;
  if (settings->lock_memory) c->memory_error = lock_memory();
  if ((code = cyclic_wake_start(c)) != 0) return code;
  /* A small stack, since all of it is locked. */
  if ((code = cyclic_thread_start(&c->thread, 256 * 1024, thread_main, c)) != 0) {
    __atomic_store_n(&c->stop, 1, __ATOMIC_RELAXED);
    cyclic_wake_stop(c);
    return code;
  }
  while (__atomic_load_n(&c->started, __ATOMIC_ACQUIRE) != 2) sched_yield();
  return 0;
}

int cyclic_scheduling_error(const cyclic_t *c) { return c->scheduling_error; }
int cyclic_affinity_error(const cyclic_t *c) { return c->affinity_error; }
int cyclic_memory_error(const cyclic_t *c) { return c->memory_error; }
int cyclic_slack_error(const cyclic_t *c) { return c->slack_error; }

uint32_t cyclic_stopping(const cyclic_t *c) {
  return __atomic_load_n(&c->stopping, __ATOMIC_ACQUIRE) + __atomic_load_n(&c->can_stopping, __ATOMIC_ACQUIRE);
}

uint64_t cyclic_deadline(const cyclic_t *c) { return __atomic_load_n(&c->next_ns, __ATOMIC_RELAXED); }

void cyclic_set_socket(cyclic_t *c, uint32_t port, int fd) {
  if (port >= c->ports) return;
  __atomic_store_n(&c->wanted_fd[port], fd, __ATOMIC_RELEASE);
  if (c->started == 0) {
    c->fd[port] = fd;
    return;
  }
  while (__atomic_load_n(&c->fd[port], __ATOMIC_ACQUIRE) != fd)
    nanosleep(&(struct timespec){0, 100000}, NULL);
}

void cyclic_set_wkc_limit(cyclic_t *c, int32_t limit) {
  __atomic_store_n(&c->settings.wkc_limit, limit, __ATOMIC_RELAXED);
}

void cyclic_make_safe(cyclic_t *c) { __atomic_store_n(&c->make_safe, 1, __ATOMIC_RELAXED); }

int cyclic_attend(cyclic_t *c, uint32_t cycles) {
  __atomic_store_n(&c->attend, cycles, __ATOMIC_RELAXED);
  return __atomic_load_n(&c->make_safe, __ATOMIC_RELAXED) ? -ETIMEDOUT : 0;
}

void cyclic_restart_counting(cyclic_t *c) {
  __atomic_store_n(&c->restart, 1, __ATOMIC_RELAXED);
  while (c->started != 0 && __atomic_load_n(&c->restart, __ATOMIC_ACQUIRE))
    nanosleep(&(struct timespec){0, 100000}, NULL);
}

void cyclic_stop(cyclic_t *c) {
  if (c->relay != NULL) cyclic_relay_follow(c->relay, NULL);
  if (c->started == 0) return;
  __atomic_store_n(&c->stop, 1, __ATOMIC_RELAXED);
  pthread_join(c->thread, NULL);
  cyclic_wake_stop(c);
  c->started = 0;
}

void cyclic_free(cyclic_t *c) {
  uint32_t i;
  if (c == NULL) return;
  cyclic_stop(c);
  if (c->timer_fd >= 0) close(c->timer_fd);
  if (c->out_map != NULL) munmap(c->out_map, c->out_size);
  for (i = 0; i < c->domains && i < ECAT_MAX_DOMAINS; i++) free(c->domain[i].image);
  cyclic_frames_free(c);
  free(c->outputs);
  free(c->safe);
  free(c->hold);
  free(c->slot_image);
  free(c->output_memory);
  if (c->wanted_limits != c->limits) free(c->wanted_limits);
  free(c->limits);
  free(c->stop_sequence);
  free(c->copy);
  free(c->can);
  free(c);
}
