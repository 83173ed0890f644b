/* The last frames that a thread has sent and received, for `ecatctl capture`. The thread writes them into
 * memory of a fixed size, over the oldest frames. Other threads may read at the same time. The writer
 * never waits.
 */
#ifndef ECAT_FRAME_RING_H
#define ECAT_FRAME_RING_H

#include "cyclic.h"
#include "relay.h"

typedef struct cyclic_frame_ring cyclic_frame_ring_t;

/* The header of each frame in the ring. The frame follows, filled up to a multiple of 8 bytes. */
typedef struct cyclic_frame_record {
  uint64_t time_ns; /* CLOCK_MONOTONIC when the kernel took or delivered the frame */
  uint32_t length;  /* bytes of the frame */
  uint8_t port;     /* 0 or 1 */
  uint8_t sent;     /* 1: sent, 0: received */
  uint16_t cycle;   /* the low bits of the number of the cycle; frames of the relay: 0 */
} cyclic_frame_record;

/* Makes a ring of this many bytes, at least 16384. Returns NULL on failure, and sets errno. */
CYCLIC_API cyclic_frame_ring_t *cyclic_frame_ring_new(uint64_t bytes);
/* Makes an engine or a relay write into a ring. For an engine, call it before cyclic_start(). The caller
 * still owns the ring, and frees it after the engine or the relay. */
CYCLIC_API void cyclic_set_frame_ring(cyclic_t *c, cyclic_frame_ring_t *ring);
CYCLIC_API void cyclic_relay_set_frame_ring(cyclic_relay_t *r, cyclic_frame_ring_t *ring);
/* Copies whole records to `to`, which has room for `room` bytes, at least 2048. Returns the number of bytes
 * in `to`. `*position` counts all bytes ever written: the copy begins there, and the next call continues
 * at its new value. If the records there are overwritten already, the copy begins with the oldest record
 * that is left; then `*position` advances by more than the returned number. */
CYCLIC_API uint32_t cyclic_frame_ring_read(const cyclic_frame_ring_t *ring, uint64_t *position, void *to,
                                           uint32_t room);
/* The position of the last record that is not newer than `time_ns`; of the oldest one, if all are newer. */
CYCLIC_API uint64_t cyclic_frame_ring_find(const cyclic_frame_ring_t *ring, uint64_t time_ns);
/* The position behind the newest record. */
CYCLIC_API uint64_t cyclic_frame_ring_end(const cyclic_frame_ring_t *ring);
CYCLIC_API void cyclic_frame_ring_free(cyclic_frame_ring_t *ring);

/* Writes a frame; does nothing if `ring` is NULL. For the thread that owns the ring. */
void cyclic_frame_ring_write(cyclic_frame_ring_t *ring, const uint8_t *frame, size_t length, uint32_t port,
                             int sent, uint64_t cycle);

#endif
