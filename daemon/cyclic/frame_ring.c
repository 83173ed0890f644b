/* The last frames: see frame_ring.h. `tail` and `head` count bytes since the start. The writer moves
 * `tail` on before it overwrites a record. A reader that reads `tail` after copying therefore knows which
 * part of its copy is intact. */
#include "frame_ring.h"

#include "engine.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

enum { RING_MIN = 16384 };

struct cyclic_frame_ring {
  uint64_t *words;
  uint64_t size; /* in bytes */
  uint64_t tail; /* the oldest record begins here */
  uint64_t head; /* the next record begins here */
};

static uint64_t record_bytes(uint32_t length) {
  return sizeof(cyclic_frame_record) + ((length + 7u) & ~7u);
}

cyclic_frame_ring_t *cyclic_frame_ring_new(uint64_t bytes) {
  cyclic_frame_ring_t *ring;
  if (bytes < RING_MIN) {
    errno = EINVAL;
    return NULL;
  }
  ring = calloc(1, sizeof *ring);
  if (ring == NULL) return NULL;
  ring->size = bytes & ~(uint64_t)7;
  /* MAP_POPULATE: the engine must not cause page faults when it writes. */
  ring->words = mmap(NULL, ring->size, PROT_READ | PROT_WRITE,
                    MAP_PRIVATE | MAP_ANONYMOUS | MAP_POPULATE, -1, 0);
  if (ring->words != MAP_FAILED) return ring;
  free(ring);
  return NULL;
}

void cyclic_frame_ring_free(cyclic_frame_ring_t *ring) {
  if (ring == NULL) return;
  munmap(ring->words, ring->size);
  free(ring);
}

void cyclic_set_frame_ring(cyclic_t *c, cyclic_frame_ring_t *ring) { c->frame_ring = ring; }

/* Copies word by word with relaxed atomics: the reader may copy words while the writer overwrites them,
 * and this must not be a data race. `at` is a multiple of 8. */
static void put(cyclic_frame_ring_t *ring, uint64_t at, const void *from, size_t length) {
  size_t words = (size_t)ring->size / sizeof(uint64_t), index = (size_t)(at / sizeof(uint64_t) % words), done;
  for (done = 0; done < length; done += sizeof(uint64_t)) {
    uint64_t word = 0;
    size_t left = length - done;
    memcpy(&word, (const uint8_t *)from + done, left < sizeof word ? left : sizeof word);
    __atomic_store_n(&ring->words[index], word, __ATOMIC_RELAXED);
    if (++index == words) index = 0;
  }
}

/* `length` is a multiple of 8. */
static void get(const cyclic_frame_ring_t *ring, uint64_t at, void *to, size_t length) {
  size_t words = (size_t)ring->size / sizeof(uint64_t), index = (size_t)(at / sizeof(uint64_t) % words), done;
  for (done = 0; done < length; done += sizeof(uint64_t)) {
    uint64_t word = __atomic_load_n(&ring->words[index], __ATOMIC_RELAXED);
    memcpy((uint8_t *)to + done, &word, sizeof word);
    if (++index == words) index = 0;
  }
}

static uint64_t bytes_at(const cyclic_frame_ring_t *ring, uint64_t at) {
  cyclic_frame_record record;
  get(ring, at, &record, sizeof record);
  return record_bytes(record.length);
}

void cyclic_frame_ring_write(cyclic_frame_ring_t *ring, const uint8_t *frame, size_t length, uint32_t port,
                             int sent, uint64_t cycle) {
  cyclic_frame_record record = {
      .length = (uint32_t)length, .port = (uint8_t)port, .sent = sent != 0, .cycle = (uint16_t)cycle};
  uint64_t need, tail;
  if (ring == NULL) return;
  record.time_ns = cyclic_now();
  need = record_bytes(record.length);
  tail = ring->tail;
  while (ring->head + need - tail > ring->size) tail += bytes_at(ring, tail);
  __atomic_store_n(&ring->tail, tail, __ATOMIC_RELAXED);
  __atomic_thread_fence(__ATOMIC_RELEASE);
  put(ring, ring->head, &record, sizeof record);
  put(ring, ring->head + sizeof record, frame, length);
  __atomic_store_n(&ring->head, ring->head + need, __ATOMIC_RELEASE);
}

/* The number of bytes, at most `bytes`, that whole records fill. */
static uint32_t whole_records(const uint8_t *from, uint32_t bytes) {
  uint32_t at = 0;
  cyclic_frame_record record;
  while (bytes - at >= sizeof record) {
    memcpy(&record, from + at, sizeof record);
    if (record_bytes(record.length) > bytes - at) break;
    at += (uint32_t)record_bytes(record.length);
  }
  return at;
}

uint32_t cyclic_frame_ring_read(const cyclic_frame_ring_t *ring, uint64_t *position, void *to,
                                uint32_t room) {
  uint64_t head = __atomic_load_n(&ring->head, __ATOMIC_ACQUIRE);
  uint64_t tail = __atomic_load_n(&ring->tail, __ATOMIC_RELAXED), from = *position, skip = 0;
  uint32_t bytes;
  if (from > head || from < tail) from = tail; /* beyond the head: of an earlier run */
  if (room > ring->size) room = (uint32_t)ring->size;
  room &= ~7u;
  bytes = head - from < room ? (uint32_t)(head - from) : room;
  get(ring, from, to, bytes);
  __atomic_thread_fence(__ATOMIC_ACQUIRE);
  tail = __atomic_load_n(&ring->tail, __ATOMIC_RELAXED);
  if (tail > from) skip = tail - from < bytes ? tail - from : bytes;
  memmove(to, (uint8_t *)to + skip, bytes - skip);
  bytes = whole_records(to, bytes - (uint32_t)skip);
  *position = (tail > from ? tail : from) + bytes;
  return bytes;
}

uint64_t cyclic_frame_ring_find(const cyclic_frame_ring_t *ring, uint64_t time_ns) {
  uint64_t head = __atomic_load_n(&ring->head, __ATOMIC_ACQUIRE);
  uint64_t tail = __atomic_load_n(&ring->tail, __ATOMIC_RELAXED), at = tail, found = tail;
  while (at < head) {
    cyclic_frame_record record;
    get(ring, at, &record, sizeof record);
    __atomic_thread_fence(__ATOMIC_ACQUIRE);
    tail = __atomic_load_n(&ring->tail, __ATOMIC_RELAXED);
    if (tail > at) { /* overwritten meanwhile; the writer is slower than this loop */
      at = found = tail;
      continue;
    }
    if (record.time_ns > time_ns) break;
    found = at;
    at += record_bytes(record.length);
  }
  return found;
}

uint64_t cyclic_frame_ring_end(const cyclic_frame_ring_t *ring) {
  return __atomic_load_n(&ring->head, __ATOMIC_ACQUIRE);
}
