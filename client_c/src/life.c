/* Lets the kernel tell the engine that this process has ended.
 *
 * A thread of the client sleeps as long as the client has its slot, and owns a robust futex: the word `life`
 * of the doorbell. When the process ends, however that happens, the kernel ends all threads, and sets
 * ECAT_DIED in the words that they own before it does anything else. The engine reads the doorbells in every
 * cycle. Locks of files and pidfds come later, after the kernel has given back the memory of the process:
 * milliseconds for a small simulation, a quarter of a second for a gigabyte (docs/performance.md).
 *
 * For a client that sends on a CAN channel without a lease of its own it also gives signs of life, so that a
 * process that was stopped is noticed. The kernel marks the word when this thread ends, whether the process goes
 * on or not. It does not use the list of robust mutexes of the C library, whose links would lie
 * in shared memory, where other clients could change them: here the list is private, and only the word is
 * shared. A forked child has neither the thread nor the list. */
#include "internal.h"

#include <linux/futex.h>
#include <pthread.h>
#include <signal.h>
#include <stdlib.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

enum { STACK_BYTES = 64 * 1024 };

struct ecat_life {
  struct robust_list_head head;
  struct robust_list entry;
  uint32_t *word;   /* in the doorbell */
  uint32_t id;      /* futex: 0 until the thread owns the word */
  uint32_t end;     /* futex: 1 when the thread is to end; 2: it shall look at `period_ns` again */
  uint32_t *heartbeat; /* in the doorbell */
  uint64_t period_ns; /* of the signs of life that the thread gives; 0: it gives none */
  pthread_t thread;
};

static void sleep_while(uint32_t *word, uint32_t value) {
  while (__atomic_load_n(word, __ATOMIC_ACQUIRE) == value)
    syscall(SYS_futex, word, FUTEX_WAIT_PRIVATE, value, NULL, NULL, 0);
}

static void set_and_wake(uint32_t *word, uint32_t value) {
  __atomic_store_n(word, value, __ATOMIC_RELEASE);
  syscall(SYS_futex, word, FUTEX_WAKE_PRIVATE, 1, NULL, NULL, 0);
}

static void beat_until_end(struct ecat_life *life) {
  while (__atomic_load_n(&life->end, __ATOMIC_ACQUIRE) != 1) {
    uint64_t period = __atomic_load_n(&life->period_ns, __ATOMIC_ACQUIRE);
    struct timespec pause = {(time_t)(period / NS_PER_S), (long)(period % NS_PER_S)};
    uint32_t again = 2;
    if (__atomic_compare_exchange_n(&life->end, &again, 0, 0, __ATOMIC_ACQ_REL, __ATOMIC_ACQUIRE)) continue;
    if (period != 0) __atomic_fetch_add(life->heartbeat, 1, __ATOMIC_RELAXED);
    syscall(SYS_futex, &life->end, FUTEX_WAIT_PRIVATE, 0, period != 0 ? &pause : NULL, NULL, 0);
  }
}

static void *live(void *argument) {
  struct ecat_life *life = argument;
  prctl(PR_SET_NAME, "ecat-life");
  life->head.list.next = &life->entry;
  life->entry.next = &life->head.list;
  life->head.futex_offset = (long)((char *)life->word - (char *)&life->entry);
  syscall(SYS_set_robust_list, &life->head, sizeof life->head);
  set_and_wake(&life->id, (uint32_t)syscall(SYS_gettid));
  beat_until_end(life);
  life->head.list.next = &life->head.list;
  return NULL;
}

/* Starts a thread that no signal of the program reaches. */
static int start(struct ecat_life *life) {
  pthread_attr_t attributes;
  sigset_t all, before;
  int code;
  sigfillset(&all);
  if (pthread_attr_init(&attributes) != 0) return -1;
  pthread_attr_setstacksize(&attributes, STACK_BYTES);
  pthread_sigmask(SIG_SETMASK, &all, &before);
  code = pthread_create(&life->thread, &attributes, live, life);
  pthread_sigmask(SIG_SETMASK, &before, NULL);
  pthread_attr_destroy(&attributes);
  return code;
}

void ecat_life_begin(ecat_t *bus) {
  struct ecat_life *life = calloc(1, sizeof *life);
  if (life == NULL) return;
  life->word = &bus->doorbell->life;
  life->heartbeat = &bus->doorbell->heartbeat;
  if (start(life) != 0) {
    free(life);
    return;
  }
  sleep_while(&life->id, 0);
  bus->life = life;
}

uint32_t ecat_life_word(const ecat_t *bus) { return bus->life == NULL ? 0 : bus->life->id; }

int ecat_life_beat(ecat_t *bus, uint64_t period_ns) {
  struct ecat_life *life = bus->life;
  if (life == NULL) return period_ns == 0 ? 0 : -1;
  if (__atomic_exchange_n(&life->period_ns, period_ns, __ATOMIC_ACQ_REL) != period_ns) set_and_wake(&life->end, 2);
  return 0;
}

void ecat_life_end(ecat_t *bus) {
  struct ecat_life *life = bus->life;
  if (life == NULL) return;
  bus->life = NULL;
  set_and_wake(&life->end, 1);
  pthread_join(life->thread, NULL);
  free(life);
}

void ecat_life_forget(ecat_t *bus) {
  free(bus->life);
  bus->life = NULL;
}
