/* A thread writes frames into a ring while another reads it: whatever comes out must be whole. */
#include "frame_ring.h"

#include <engine.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { FRAMES = 300000, BYTES = 65536, ROOM = 16384 };

uint64_t cyclic_now(void) {
  static uint64_t now;
  return ++now;
}

/* The frame of a number: its length and all of its bytes follow from it. */
static size_t make(uint8_t *frame, uint64_t number) {
  size_t length = 60 + number * 7919 % 1458;
  memset(frame, (int)(number % 251), length);
  memcpy(frame, &number, sizeof number);
  return length;
}

static void *write_all(void *ring) {
  uint8_t frame[2048];
  uint64_t number;
  for (number = 1; number <= FRAMES; number++)
    cyclic_frame_ring_write(ring, frame, make(frame, number), number & 1, number & 2, number);
  return NULL;
}

static uint64_t max_of(uint64_t a, uint64_t b) { return a > b ? a : b; }

int main(void) {
  cyclic_frame_ring_t *ring = cyclic_frame_ring_new(BYTES);
  uint8_t *to = malloc(ROOM), expected[2048];
  uint64_t position = 0, last = 0, lost = 0, seen = 0, number;
  pthread_t writer;
  pthread_create(&writer, NULL, write_all, ring);
  while (last < FRAMES) {
    uint64_t before = position = max_of(position, cyclic_frame_ring_find(ring, last));
    uint32_t at = 0, bytes = cyclic_frame_ring_read(ring, &position, to, ROOM);
    lost += position - before > bytes;
    while (at < bytes) {
      cyclic_frame_record record;
      memcpy(&record, to + at, sizeof record);
      memcpy(&number, to + at + sizeof record, sizeof number);
      if (number <= last || record.time_ns != number || record.length != make(expected, number) ||
          record.port != (number & 1) || record.sent != (number >> 1 & 1) ||
          memcmp(to + at + sizeof record, expected, record.length) != 0) {
        printf("record %llu after %llu is torn\n", (unsigned long long)number, (unsigned long long)last);
        return 1;
      }
      last = number;
      seen++;
      at += (uint32_t)sizeof record + ((record.length + 7) & ~7u);
    }
  }
  pthread_join(writer, NULL);
  for (number = last - 10; number < last + 3; number++) { /* its record, or the newest one */
    cyclic_frame_record record;
    position = cyclic_frame_ring_find(ring, number);
    if (cyclic_frame_ring_read(ring, &position, to, ROOM) < sizeof record) return 3;
    memcpy(&record, to, sizeof record);
    if (record.time_ns != (number < last ? number : last)) return 4;
  }
  position = 0;
  if (cyclic_frame_ring_find(ring, 1) == 0) return 5; /* gone; it is the oldest that is left */
  if (cyclic_frame_ring_read(ring, &position, to, ROOM) == 0) return 6;
  position = (uint64_t)1 << 60; /* of an earlier run */
  if (cyclic_frame_ring_read(ring, &position, to, ROOM) == 0) return 2;
  printf("%llu seen, %llu gaps\n", (unsigned long long)seen, (unsigned long long)lost);
  free(to);
  cyclic_frame_ring_free(ring);
  return cyclic_frame_ring_new(100) != NULL;
}
