/* The engine's side of the shared memory: domain pages, the cycle number, histograms. */
#include "engine.h"

#include <string.h>

void cyclic_publish_domain(cyclic_t *c, struct domain *domain, uint64_t time_ns) {
  ecat_shm_page *page = domain->page;
  uint64_t *data = (uint64_t *)(page + 1);
  const uint64_t *image = (const uint64_t *)(const void *)domain->image;
  uint64_t seq = page->seq;
  uint32_t i, words = (domain->image_bytes + 7) / 8;
  __atomic_store_n(&page->seq, seq + 1, __ATOMIC_RELAXED);
  __atomic_thread_fence(__ATOMIC_RELEASE);
  __atomic_store_n(&page->cycle, c->cycle, __ATOMIC_RELAXED);
  __atomic_store_n(&page->time_ns, time_ns, __ATOMIC_RELAXED);
  __atomic_store_n(&page->absent, domain->absent, __ATOMIC_RELAXED);
  __atomic_store_n(&page->wkc, domain->wkc, __ATOMIC_RELAXED);
  __atomic_store_n(&page->wkc_state, domain->wkc_state, __ATOMIC_RELAXED);
#pragma GCC unroll 8
  for (i = 0; i < words; i++) __atomic_store_n(&data[i], image[i], __ATOMIC_RELAXED);
  __atomic_store_n(&page->seq, seq + 2, __ATOMIC_RELEASE);
}

enum { SILENT_CYCLES = 3 }; /* the slaves count as gone after this many cycles without a frame */

void cyclic_publish_bus(cyclic_t *c) {
  if (c->silent >= SILENT_CYCLES) c->found = c->al_status = 0;
  /* Published even if there is no room for an event. */
  __atomic_store_n(&c->health->slaves_found, c->found, __ATOMIC_RELAXED);
  __atomic_store_n(&c->health->al_status, c->al_status, __ATOMIC_RELAXED);
  if ((c->found != c->told_found || c->al_status != c->told_al_status) &&
      cyclic_emit(c, CYCLIC_EVENT_SLAVES, (int32_t)c->found, -1, c->al_status)) {
    c->told_found = c->found;
    c->told_al_status = c->al_status;
  }
  if (c->ring != ECAT_RING_NONE) {
    __atomic_store_n(&c->health->ring, c->ring, __ATOMIC_RELAXED);
    __atomic_store_n(&c->health->ring_break, c->ring_break, __ATOMIC_RELAXED);
    if ((c->ring != c->told_ring ||
         (c->ring == ECAT_RING_OPEN && c->ring_break != c->told_break)) &&
        cyclic_emit(c, CYCLIC_EVENT_RING, (int32_t)c->ring_break, -1, c->ring)) {
      c->told_ring = c->ring;
      c->told_break = c->ring_break;
    }
  }
  __atomic_store_n(&c->health->dc_state, c->clock.state, __ATOMIC_RELAXED);
  if (c->clock.state != c->clock.told_state &&
      cyclic_emit(c, CYCLIC_EVENT_CLOCK, -1, -1, c->clock.state))
    c->clock.told_state = c->clock.state;
}

static void forget(void *base, size_t from, size_t to) { memset((uint8_t *)base + from, 0, to - from); }

static void keep_if_worst(ecat_shm_worst *kept, const ecat_shm_worst *cycle, uint64_t took_ns) {
  if (took_ns <= kept->took_ns) return;
  __atomic_store_n(&kept->again, cycle->cycle, __ATOMIC_RELAXED);
  __atomic_thread_fence(__ATOMIC_RELEASE);
  __atomic_store_n(&kept->took_ns, took_ns, __ATOMIC_RELAXED);
  __atomic_store_n(&kept->wakeup_ns, cycle->wakeup_ns, __ATOMIC_RELAXED);
  __atomic_store_n(&kept->exchange_ns, cycle->exchange_ns, __ATOMIC_RELAXED);
  __atomic_store_n(&kept->cycle_ns, cycle->cycle_ns, __ATOMIC_RELAXED);
  __atomic_store_n(&kept->end_ns, cycle->end_ns, __ATOMIC_RELAXED);
  __atomic_store_n(&kept->lost, cycle->lost, __ATOMIC_RELAXED);
  __atomic_store_n(&kept->mailbox_frames, cycle->mailbox_frames, __ATOMIC_RELAXED);
  __atomic_store_n(&kept->cycle, cycle->cycle, __ATOMIC_RELEASE);
}

void cyclic_publish_worst(cyclic_t *c, uint64_t end_ns) {
  ecat_shm_health *health = c->health;
  uint64_t mailbox_frames = __atomic_load_n(&health->mailbox_frames, __ATOMIC_RELAXED);
  ecat_shm_worst cycle = {.cycle = c->cycle,
                          .wakeup_ns = c->now_ns - c->deadline_ns,
                          .exchange_ns = c->exchange_ns,
                          .cycle_ns = end_ns - c->now_ns,
                          .end_ns = end_ns,
                          .lost = health->lost - c->lost_before,
                          .mailbox_frames = mailbox_frames - c->mailbox_frames_before};
  struct {
    ecat_shm_worst *kept;
    uint64_t took_ns;
  } kinds[] = {{health->worst_wakeup, cycle.wakeup_ns},
               {health->worst_exchange, cycle.exchange_ns},
               {health->worst_cycle, cycle.cycle_ns}};
  uint32_t i;
  int begins = c->span == 0 || end_ns - c->span_ns >= ECAT_WORST_SPAN_S * 1000000000ull;
  c->lost_before = health->lost;
  c->mailbox_frames_before = mailbox_frames;
  if (begins) {
    const uint32_t spans = sizeof health->worst_wakeup / sizeof *health->worst_wakeup - 1;
    c->span = c->span % spans + 1; /* entry 0 is that since the start */
    c->span_ns = end_ns;
  }
  for (i = 0; i < sizeof kinds / sizeof *kinds; i++) {
    if (begins) memset(&kinds[i].kept[c->span], 0, sizeof *kinds[i].kept);
    keep_if_worst(&kinds[i].kept[0], &cycle, kinds[i].took_ns);
    keep_if_worst(&kinds[i].kept[c->span], &cycle, kinds[i].took_ns);
  }
}

/* Keeps the counters of the relay, since another thread writes them. */
void cyclic_publish_restart(cyclic_t *c) {
  ecat_shm_health *health = c->health;
  uint32_t i;
  c->overruns = 0;
  forget(health, offsetof(ecat_shm_health, start_ns), offsetof(ecat_shm_health, mailbox_frames));
  forget(health, offsetof(ecat_shm_health, delay_cycles), offsetof(ecat_shm_health, mailbox));
  forget(health, offsetof(ecat_shm_health, worst_wakeup), sizeof *health);
  c->lost_before = 0;
  health->wakeup.min_ns = health->exchange.min_ns = health->cycle.min_ns = UINT64_MAX;
  health->delay.min_ns = health->dc_offset.min_ns = UINT64_MAX;
  for (i = 0; i < c->domains; i++) memset(c->domain[i].status, 0, sizeof *c->domain[i].status);
  __atomic_store_n(&health->start_ns, c->deadline_ns, __ATOMIC_RELAXED);
}

void cyclic_publish_cycle(cyclic_t *c, uint64_t time_ns) {
  __atomic_store_n(&c->header->cycle_end_ns, time_ns, __ATOMIC_RELAXED);
  __atomic_store_n(&c->header->cycle, c->cycle, __ATOMIC_RELEASE);
  __atomic_store_n(&c->header->cycle_word, (uint32_t)c->cycle, __ATOMIC_RELEASE);
  cyclic_wake_clients(c);
}

void cyclic_count(ecat_shm_histogram *histogram, uint64_t ns) {
  counter_add(&histogram->buckets[ecat_histogram_bucket(ns)], 1);
  counter_add(&histogram->count, 1);
  counter_add(&histogram->sum_ns, ns);
  if (ns < histogram->min_ns) __atomic_store_n(&histogram->min_ns, ns, __ATOMIC_RELAXED);
  if (ns > histogram->max_ns) __atomic_store_n(&histogram->max_ns, ns, __ATOMIC_RELAXED);
}
