/* The cycle, and the order of work within it. */
#include "engine.h"

#include <errno.h>
#include <string.h>

uint64_t cyclic_now(void) {
  struct timespec now;
  clock_gettime(CLOCK_MONOTONIC, &now);
  return (uint64_t)now.tv_sec * 1000000000u + (uint64_t)now.tv_nsec;
}

static void exchange(cyclic_t *c, uint64_t deadline_ns) {
  uint64_t received;
  uint32_t i;
  for (i = 0; i < c->domains; i++) {
    struct domain *domain = &c->domain[i];
    if (c->cycle % domain->divider != 0) continue;
    domain->wkc = 0;
    domain->complete = 1;
    memcpy(domain->image, c->outputs + domain->output_base, domain->output_bytes);
  }
  c->send_ns = cyclic_now();
  cyclic_wire_send(c);
  cyclic_slots_sent(c);
  cyclic_wire_receive(c, deadline_ns);
  received = cyclic_now();
  cyclic_count(&c->health->exchange, received - c->send_ns);
  for (i = 0; i < c->domains; i++) {
    struct domain *domain = &c->domain[i];
    uint32_t state;
    if (c->cycle % domain->divider != 0) continue;
    state = domain->complete  ? ECAT_WKC_COMPLETE
            : domain->wkc > 0 ? ECAT_WKC_INCOMPLETE
                              : ECAT_WKC_ZERO;
    if (state != ECAT_WKC_COMPLETE) counter_add(&c->health->wkc_bad, 1);
    if (state != domain->wkc_state) {
      domain->wkc_state = state;
      cyclic_emit(c, CYCLIC_EVENT_WKC, (int32_t)i, -1, state);
    }
    cyclic_publish_domain(c, domain, received);
  }
}

void cyclic_run(cyclic_t *c) {
  uint64_t period = c->header->cycle_time_ns;
  uint64_t deadline = cyclic_now() + period, end;
  __atomic_store_n(&c->health->start_ns, deadline, __ATOMIC_RELAXED);
  while (!__atomic_load_n(&c->stop, __ATOMIC_RELAXED)) {
    uint64_t receive_until;
    struct timespec at = {(time_t)(deadline / 1000000000u), (long)(deadline % 1000000000u)};
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &at, NULL) == EINTR) continue;
    c->now_ns = cyclic_now();
    c->cycle++;
    cyclic_count(&c->health->wakeup, c->now_ns - deadline);
    if (__atomic_load_n(&c->make_safe, __ATOMIC_RELAXED)) cyclic_slots_make_safe(c);
    cyclic_slots_read(c);
    /* A frame that is not back after nine tenths of the cycle counts as lost, so that waiting for
     * it does not cost the next cycle its deadline. After a late wake-up it still gets a quarter:
     * a deadline missed is better than a frame sent for nothing. */
    receive_until = deadline + period / 10 * 9;
    if (receive_until < c->now_ns + period / 4) receive_until = c->now_ns + period / 4;
    exchange(c, receive_until);
    cyclic_slots_publish(c);
    counter_add(&c->health->cycles, 1);
    end = cyclic_now();
    cyclic_publish_cycle(c, end);
    cyclic_count(&c->health->cycle, end - c->now_ns);
    deadline += period;
    if (deadline <= end) { /* keep the grid, without a burst of cycles to catch up */
      uint64_t missed = (end - deadline) / period + 1;
      deadline += missed * period;
      counter_add(&c->health->missed, missed);
    }
  }
}
