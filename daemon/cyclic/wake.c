/* Wakes the clients that wait for a cycle. Waking a client takes microseconds. The engine therefore wakes
 * only the first few, which is enough on most buses, and leaves the others to a separate thread. So the
 * work of the cycle does not grow with the number of clients. */
#include "engine.h"
#include "thread.h"

#include <limits.h>
#include <linux/futex.h>
#include <sys/syscall.h>
#include <unistd.h>

enum { FIRST_FEW = 2, STACK_BYTES = 64 * 1024 };

static long wake(const cyclic_t *c, int most, uint32_t whom) {
  return syscall(SYS_futex, &c->header->cycle_word, FUTEX_WAKE_BITSET, most, NULL, NULL, whom);
}

void cyclic_wake_clients(cyclic_t *c) {
  uint32_t whom = ECAT_WAKE_CYCLE | c->due | c->can_news;
  c->can_news = 0;
  if (wake(c, FIRST_FEW, whom) < FIRST_FEW) return;
  __atomic_fetch_or(&c->crowd, whom, __ATOMIC_RELEASE);
  syscall(SYS_futex, &c->crowd, FUTEX_WAKE_PRIVATE, 1, NULL, NULL, 0);
}

static void *thread_main(void *argument) {
  cyclic_t *c = argument;
  (void)cyclic_thread_become("ecat-wake", c->settings.priority - 1); /* the engine reports it */
  while (!__atomic_load_n(&c->stop, __ATOMIC_RELAXED)) {
    uint32_t whom = __atomic_exchange_n(&c->crowd, 0, __ATOMIC_ACQUIRE);
    if (whom != 0)
      (void)wake(c, INT_MAX, whom);
    else
      syscall(SYS_futex, &c->crowd, FUTEX_WAIT_PRIVATE, 0, NULL, NULL, 0);
  }
  return NULL;
}

int cyclic_wake_start(cyclic_t *c) {
  return cyclic_thread_start(&c->wake_thread, STACK_BYTES, thread_main, c);
}

void cyclic_wake_stop(cyclic_t *c) {
  __atomic_fetch_or(&c->crowd, ECAT_WAKE_CYCLE, __ATOMIC_RELEASE);
  syscall(SYS_futex, &c->crowd, FUTEX_WAKE_PRIVATE, 1, NULL, NULL, 0);
  pthread_join(c->wake_thread, NULL);
}
