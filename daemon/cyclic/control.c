/* The interface between engine and control side: events from the engine, answers for clients. */
#include "engine.h"

#include <linux/futex.h>
#include <string.h>
#include <sys/syscall.h>
#include <unistd.h>

/* Number of events that may be unread after an event of this type is added. Events that a client can
 * cause in every cycle leave half of the room to the others. All of them but conflicts are tried again
 * later. */
static uint32_t room_for(uint32_t type) {
  return type == CYCLIC_EVENT_REQUEST || type == CYCLIC_EVENT_REFUSED ||
                 type == CYCLIC_EVENT_MALFORMED || type == CYCLIC_EVENT_CONFLICT
             ? EVENTS / 2
             : EVENTS;
}

int cyclic_emit(cyclic_t *c, uint32_t type, int32_t slave, int32_t slot, uint32_t value) {
  uint32_t head = c->event_head;
  if (head - __atomic_load_n(&c->event_tail, __ATOMIC_ACQUIRE) >= room_for(type)) return 0;
  c->event[head % EVENTS] = (cyclic_event){type, slave, slot, value, c->cycle};
  __atomic_store_n(&c->event_head, head + 1, __ATOMIC_RELEASE);
  syscall(SYS_futex, &c->event_head, FUTEX_WAKE_PRIVATE, 1, NULL, NULL, 0);
  return 1;
}

void cyclic_publish_layout(void *header) {
  ecat_shm_header *h = header;
  __atomic_store_n(&h->state, ECAT_BUS_RUNNING, __ATOMIC_RELAXED);
  __atomic_store_n(&h->layout, ECAT_SHM_LAYOUT, __ATOMIC_RELEASE);
}

int cyclic_wait_event(cyclic_t *c, cyclic_event *event, int64_t timeout_ns) {
  uint32_t tail = c->event_tail;
  if (__atomic_load_n(&c->event_head, __ATOMIC_ACQUIRE) == tail) {
    struct timespec timeout = {(time_t)(timeout_ns / 1000000000), (long)(timeout_ns % 1000000000)};
    syscall(SYS_futex, &c->event_head, FUTEX_WAIT_PRIVATE, tail, &timeout, NULL, 0);
    if (__atomic_load_n(&c->event_head, __ATOMIC_ACQUIRE) == tail) return 0;
  }
  *event = c->event[tail % EVENTS];
  __atomic_store_n(&c->event_tail, tail + 1, __ATOMIC_RELEASE);
  return 1;
}

void cyclic_listen(cyclic_t *c, uint32_t slot) {
  if (slot < ECAT_SLOTS) __atomic_fetch_and(&c->request_told, ~(1u << slot), __ATOMIC_ACQ_REL);
}

void cyclic_reply(cyclic_t *c, uint32_t slot, uint32_t cell, uint32_t generation, uint32_t seq,
                  int32_t status, uint32_t abort_code, const void *data, uint32_t length) {
  ecat_shm_reply *reply;
  if (slot >= c->header->slot_count || cell >= ECAT_REQUESTS) return;
  if (length > ECAT_REQUEST_BYTES) length = ECAT_REQUEST_BYTES;
  reply = &c->replies[slot * ECAT_REQUESTS + cell];
  __atomic_store_n(&reply->seq, 0, __ATOMIC_RELAXED);
  __atomic_thread_fence(__ATOMIC_RELEASE);
  reply->generation = generation;
  reply->status = status;
  reply->abort_code = abort_code;
  reply->length = length;
  memcpy(reply->data, data, length);
  __atomic_store_n(&reply->seq, seq, __ATOMIC_RELEASE);
}
