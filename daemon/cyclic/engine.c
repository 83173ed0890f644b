/* The cycle, and the order of work within it. */
#include "engine.h"

#include <errno.h>
#include <string.h>

enum { FREE_RUNNING_PATIENCE_NS = 20000000, TELL_AGAIN_NS = 1000000000 };

uint64_t cyclic_now(void) {
  struct timespec now;
  clock_gettime(CLOCK_MONOTONIC, &now);
  return (uint64_t)now.tv_sec * 1000000000u + (uint64_t)now.tv_nsec;
}

static void take_part(cyclic_t *c, uint32_t number) {
  struct domain *domain = &c->domain[number];
  uint64_t left_out = (c->cycle - domain->next_cycle) / domain->divider;
  c->due |= 1u << number;
  domain->next_cycle += (left_out + 1) * domain->divider;
  if (left_out > 0) counter_add(&domain->status->overruns, left_out);
  domain->wkc = 0;
  domain->complete = domain->whole = 1;
  domain->absent = 0;
  memcpy(domain->image, c->outputs + domain->output_base, domain->output_bytes);
}

/* Chooses the domains of this cycle: those that are due. A domain that was due in a missed cycle is
 * exchanged late, and then returns to its old grid. A late domain does not join domains that are never
 * due in the same cycle with it, because the wire may not have room for all of them. It waits for a
 * later cycle, at most until it is due again. */
static void choose_domains(cyclic_t *c) {
  uint32_t i, late = 0;
  c->due = 0;
  for (i = 0; i < c->domains; i++) {
    const struct domain *domain = &c->domain[i];
    if (c->cycle < domain->next_cycle) continue;
    if ((c->cycle - domain->next_cycle) % domain->divider == 0)
      take_part(c, i);
    else
      late |= 1u << i;
  }
  for (i = 0; late >> i != 0; i++)
    if ((late >> i & 1) && (c->due & ~c->domain[i].meets) == 0) take_part(c, i);
}

static void conclude_domain(cyclic_t *c, uint32_t number, uint64_t received) {
  struct domain *domain = &c->domain[number];
  int32_t limit = __atomic_load_n(&c->settings.wkc_limit, __ATOMIC_RELAXED); /* control may change it */
  domain->wkc_state = domain->complete  ? ECAT_WKC_COMPLETE
                      : domain->wkc > 0 ? ECAT_WKC_INCOMPLETE
                                        : ECAT_WKC_ZERO;
  counter_add(&domain->status->exchanges, 1);
  domain->bad = domain->wkc_state == ECAT_WKC_COMPLETE ? 0 : domain->bad + 1;
  if (domain->bad > 0) {
    counter_add(&domain->status->wkc_bad, 1);
    if (domain->whole) counter_add(&domain->status->wkc_wrong, 1);
    counter_add(&c->health->wkc_bad, 1);
  }
  if (limit > 0 && domain->bad >= (uint32_t)limit) cyclic_slots_lapse_domain(c, number);
  if (domain->wkc_state != domain->told_state &&
      cyclic_emit(c, CYCLIC_EVENT_WKC, (int32_t)number, -1, domain->wkc_state))
    domain->told_state = domain->wkc_state;
  cyclic_publish_domain(c, domain, received);
}

/* The second turn of a cycle. A slave uses outputs that are written in pieces when it has the last byte,
 * whether it has the others or not. So the last pieces leave when the answers to the others are back. */
static void close_outputs(cyclic_t *c, uint64_t receive_until) {
  if (cyclic_now() >= receive_until) { /* a frame of the first turn was lost: no time is left */
    cyclic_ports_leave_out(c, c->first_turn, c->frames);
    return;
  }
  cyclic_frames_close(c);
  cyclic_ports_send(c, c->first_turn, c->frames);
  cyclic_ports_receive(c, c->first_turn, c->frames, receive_until);
}

static void exchange(cyclic_t *c, uint64_t receive_until) {
  uint64_t received;
  uint32_t i;
  c->send_ns = cyclic_now();
  cyclic_frames_fill(c);
  cyclic_ports_send(c, 0, c->first_turn);
  cyclic_slots_sent(c);
  cyclic_ports_receive(c, 0, c->first_turn, receive_until);
  if (c->first_turn < c->frames) close_outputs(c, receive_until);
  received = cyclic_now();
  c->exchange_ns = received - c->send_ns;
  cyclic_count(&c->health->exchange, c->exchange_ns);
  c->typical_ns += ((int64_t)c->exchange_ns - c->typical_ns) / 16;
  for (i = 0; i < c->domains; i++)
    if (c->due >> i & 1) conclude_domain(c, i, received);
  cyclic_publish_bus(c);
  if (c->cans > 0) cyclic_can_receive(c, received);
}

static void adopt_sockets(cyclic_t *c) {
  uint32_t port;
  for (port = 0; port < c->ports; port++)
    __atomic_store_n(&c->fd[port], __atomic_load_n(&c->wanted_fd[port], __ATOMIC_ACQUIRE),
                     __ATOMIC_RELEASE);
}

/* Returns the time until which the engine waits for frames. A frame that is not back after nine tenths
 * of the cycle counts as lost, so that waiting for it does not make the engine miss the next deadline.
 * After a late wake-up the engine still waits for a quarter of the cycle: a missed deadline is better
 * than a useless frame. */
static uint64_t patience(const cyclic_t *c, uint64_t period) {
  uint64_t until = c->deadline_ns + period / 10 * 9;
  if (c->settings.free_running) return c->now_ns + FREE_RUNNING_PATIENCE_NS;
  return until < c->now_ns + period / 4 ? c->now_ns + period / 4 : until;
}

/* Missed cycles also count against the control side, see cyclic_attend(). The limit is for a machine that
 * stood still: then the control side stood still as well, and only a few of the missed cycles count. */
enum { MISSED_AT_ONCE = 4 };

static void count_unattended(cyclic_t *c, uint32_t cycles) {
  if (c->attended == 0) return;
  c->attended -= cycles < c->attended ? cycles : c->attended;
  if (c->attended == 0) cyclic_make_safe(c);
}

/* Moves to the next deadline on the grid. Deadlines that have passed are skipped and counted as
 * missed, so that no burst of cycles follows. */
static void advance(cyclic_t *c, uint64_t period, uint64_t end) {
  if (c->settings.free_running) {
    c->deadline_ns = end;
    c->cycle++;
    return;
  }
  c->deadline_ns += period;
  if (c->clock.enabled) cyclic_clock_follow(c);
  c->cycle++;
  if (c->deadline_ns <= end) {
    uint64_t missed = (end - c->deadline_ns) / period + 1;
    c->deadline_ns += missed * period;
    c->cycle += missed;
    c->overruns += (uint32_t)missed;
    counter_add(&c->health->missed, missed);
    count_unattended(c, missed < MISSED_AT_ONCE ? (uint32_t)missed : MISSED_AT_ONCE);
  }
  if (c->overruns > 0 && end - c->overrun_told_ns >= TELL_AGAIN_NS &&
      cyclic_emit(c, CYCLIC_EVENT_OVERRUN, -1, -1, c->overruns)) {
    c->overruns = 0;
    c->overrun_told_ns = end;
  }
}

static void sleep_until_deadline(cyclic_t *c) {
  struct timespec at = {(time_t)(c->deadline_ns / 1000000000u),
                        (long)(c->deadline_ns % 1000000000u)};
  if (c->settings.free_running) return;
  __atomic_store_n(&c->next_ns, c->deadline_ns, __ATOMIC_RELAXED);
  while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &at, NULL) == EINTR) continue;
}

/* See cyclic_attend(). */
static void check_control(cyclic_t *c) {
  if (__atomic_load_n(&c->attend, __ATOMIC_RELAXED) > 0)
    c->attended = __atomic_exchange_n(&c->attend, 0, __ATOMIC_RELAXED);
  else
    count_unattended(c, 1);
}

void cyclic_run(cyclic_t *c) {
  uint64_t period = c->header->cycle_time_ns, end;
  c->deadline_ns = cyclic_now() + period;
  c->cycle = 1;
  __atomic_store_n(&c->health->start_ns, c->deadline_ns, __ATOMIC_RELAXED);
  while (!__atomic_load_n(&c->stop, __ATOMIC_RELAXED)) {
    sleep_until_deadline(c);
    c->now_ns = cyclic_now();
    cyclic_count(&c->health->wakeup, c->now_ns - c->deadline_ns);
    adopt_sockets(c);
    cyclic_outputs_adopt_limits(c);
    check_control(c);
    if (__atomic_load_n(&c->make_safe, __ATOMIC_RELAXED))
      cyclic_outputs_make_all_safe(c, ECAT_REASON_STOPPING);
    cyclic_slots_read(c);
    cyclic_outputs_stop_drives(c);
    if (c->copies > 0) cyclic_copies_run(c);
    if (c->cans > 0) cyclic_can_send(c);
    choose_domains(c);
    exchange(c, patience(c, period));
    cyclic_slots_publish(c);
    counter_add(&c->health->cycles, 1);
    end = cyclic_now();
    cyclic_publish_cycle(c, end);
    cyclic_count(&c->health->cycle, end - c->now_ns);
    cyclic_publish_worst(c, end);
    advance(c, period, end);
    if (__atomic_load_n(&c->restart, __ATOMIC_RELAXED)) {
      cyclic_publish_restart(c);
      __atomic_store_n(&c->restart, 0, __ATOMIC_RELEASE);
    }
  }
}
