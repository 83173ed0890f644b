/* The cyclic engine: a thread that exchanges process data with the slaves and shares it with
 * clients. This header is what the control side (ecatd/bus/engine.py, over ctypes) calls.
 *
 * After cyclic_start() the engine allocates nothing, takes no lock and enters the kernel only to
 * sleep, send, receive, read the clients' slots (pread) and wake waiters (futex).
 */
#ifndef ECAT_CYCLIC_H
#define ECAT_CYCLIC_H

#include <stddef.h>
#include <stdint.h>

#define CYCLIC_API __attribute__((visibility("default")))

typedef struct cyclic cyclic_t;

/* Datagram commands that carry process data (ETG.1000.4). */
enum cyclic_command { CYCLIC_LRD = 10, CYCLIC_LWR = 11, CYCLIC_LRW = 12 };

enum cyclic_event_type {
  CYCLIC_EVENT_CLAIMED = 1, /* slot owns the outputs of slave */
  CYCLIC_EVENT_SAFE = 2,    /* outputs of slave fell to their safe values; value: ecat_reason */
  CYCLIC_EVENT_WKC = 3,     /* working-counter state of a domain changed; slave: domain, value: state */
  CYCLIC_EVENT_REQUEST = 4, /* slot has new requests; value: generation */
  CYCLIC_EVENT_SEND = 5     /* sending began to fail (value: errno), or works again (0) */
};

typedef struct cyclic_event {
  uint32_t type;
  int32_t slave;
  int32_t slot;
  uint32_t value;
  uint64_t cycle;
} cyclic_event;

typedef struct cyclic_settings {
  int32_t priority;      /* SCHED_FIFO priority, 0: ordinary scheduling */
  int32_t cpu;           /* CPU to run on, -1: any */
  int32_t lock_memory;   /* 1: lock the memory of the process */
  int32_t busy_receive;  /* 1: spin for the answer instead of sleeping */
} cyclic_settings;

/* An engine on `interface` for the prepared segment (tables filled, `header` mapped read-write)
 * and the open .out segment. NULL and errno on failure. */
CYCLIC_API cyclic_t *cyclic_new(void *header, int out_fd, const char *interface);
/* Datagram of domain `domain` that exchanges `length` bytes of its image from `offset` on, at
 * logical address `address + offset`. 0, or -EINVAL, -ENOSPC. */
CYCLIC_API int cyclic_add_datagram(cyclic_t *c, uint32_t domain, int command, uint32_t address,
                                   uint32_t offset, uint32_t length, uint32_t wkc_expected);
/* Safe values of the outputs of a slave: bits of `hold` keep what was last sent, the others take
 * `value`. Both have the slave's output_bytes. */
CYCLIC_API int cyclic_set_safe(cyclic_t *c, uint32_t slave, const uint8_t *value,
                               const uint8_t *hold);
/* Starts the thread; 0 or -errno. What could not be granted is visible in ecat_shm_health and in
 * the return values of cyclic_scheduling_error() and cyclic_memory_error() (errno, 0: granted). */
CYCLIC_API int cyclic_start(cyclic_t *c, const cyclic_settings *settings);
CYCLIC_API int cyclic_scheduling_error(const cyclic_t *c);
CYCLIC_API int cyclic_affinity_error(const cyclic_t *c);
CYCLIC_API int cyclic_memory_error(const cyclic_t *c);
/* From the next cycle on all outputs are safe and claims are refused. */
CYCLIC_API void cyclic_make_safe(cyclic_t *c);
/* Ends the thread after the current cycle and waits for it. */
CYCLIC_API void cyclic_stop(cyclic_t *c);
CYCLIC_API void cyclic_free(cyclic_t *c);

/* Writes the layout version: from now on clients may open the segment at `header`. */
CYCLIC_API void cyclic_publish_layout(void *header);

/* Next event: 1, or 0 when none came within `timeout_ns`. For one thread at a time. */
CYCLIC_API int cyclic_wait_event(cyclic_t *c, cyclic_event *event, int64_t timeout_ns);
/* Answers a request of a client (see ecat_shm_reply). */
CYCLIC_API void cyclic_reply(cyclic_t *c, uint32_t slot, uint32_t cell, uint32_t generation,
                             uint32_t seq, int32_t status, uint32_t abort_code, const void *data,
                             uint32_t length);

/* Lets only frames with a datagram index below (`above` 0) or from (`above` 1) `limit` on into an
 * AF_PACKET socket, so that the engine and SOEM do not see each other's frames. 0 or -errno. */
CYCLIC_API int cyclic_filter_index(int fd, int above, uint32_t limit);

#endif
