/* The cyclic engine: a thread that exchanges process data with the slaves and shares it with
 * clients. The control side (ecatd/master/engine/engine.py) calls the functions below through ctypes.
 *
 * After cyclic_start() the engine allocates nothing, takes no lock and enters the kernel only to
 * sleep (and set the timer that ends waiting for frames), send, receive, read the clients' slots
 * (pread) and wake waiters (futex).
 */
#ifndef ECAT_CYCLIC_H
#define ECAT_CYCLIC_H

#include <stddef.h>
#include <stdint.h>

#define CYCLIC_API __attribute__((visibility("default")))

typedef struct cyclic cyclic_t;

/* Datagram commands that carry process data (ETG.1000.4). */
enum cyclic_command { CYCLIC_LRD = 10, CYCLIC_LWR = 11, CYCLIC_LRW = 12 };

/* Ranges of the index of a frame's first datagram: each socket accepts only frames of its range. */
enum cyclic_index {
  CYCLIC_INDEX_CONTROL = 0x00, /* mailboxes and registers, by the control side */
  CYCLIC_INDEX_ENGINE = 0x80,  /* from here on: the engine */
  CYCLIC_INDEX_LAST = 0xFF
};

enum cyclic_event_type {
  CYCLIC_EVENT_CLAIMED = 1, /* slot owns outputs of slave; value: generation */
  CYCLIC_EVENT_SAFE = 2,    /* outputs of slave that slot owned are safe; value: ecat_reason */
  CYCLIC_EVENT_WKC = 3,     /* working-counter state of a domain changed; slave: domain, value: state */
  CYCLIC_EVENT_REQUEST = 4, /* slot has new requests; value: generation */
  CYCLIC_EVENT_SEND = 5,    /* sending on port `slot` began to fail (value: errno), or works again (0) */
  CYCLIC_EVENT_SLAVES = 6,  /* `slave` slaves answer the broadcast read; value: their AL status, ORed */
  CYCLIC_EVENT_RING = 7,    /* value: ecat_ring, slave: slaves before the break */
  CYCLIC_EVENT_CLOCK = 8,   /* value: ecat_dc_state */
  CYCLIC_EVENT_OVERRUN = 9, /* value: deadlines missed since the last such event */
  CYCLIC_EVENT_REFUSED = 10, /* a value of slot is out of the declared range; value: signal */
  CYCLIC_EVENT_MALFORMED = 11, /* content of slot is malformed; value: generation */
  CYCLIC_EVENT_STOPPED = 12, /* stop of a drive of slave is over; value 1: it stands still, 0: time-out */
  CYCLIC_EVENT_CONFLICT = 13, /* slot is refused outputs of slave; value: signal with another owner */
  CYCLIC_EVENT_CAN_STATE = 14, /* CAN controller of slave; value: ecat_can_state */
  CYCLIC_EVENT_CAN_ENDED = 15, /* slot no longer sends on the CAN channel of slave; value: ecat_reason */
  CYCLIC_EVENT_CAN_REFUSED = 16, /* a CAN frame of slot for slave was not sent; value: its id */
  CYCLIC_EVENT_CAN_CONFLICT = 17, /* slot is refused identifiers of slave; value: slot that has them */
  CYCLIC_EVENT_CAN_OVERFLOW = 18, /* slave has lost CAN frames that it received */
  CYCLIC_EVENT_CAN_MALFORMED = 19 /* slave says that it delivers `value` frames, which cannot be */
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
  int32_t busy_receive;  /* 1: poll for the answer and never sleep */
  int32_t poll_ns;       /* how long to poll before sleeping, if answers usually come that soon */
  int32_t wkc_limit;     /* outputs become safe after so many bad working counters in a row, 0: never */
  int32_t free_running;  /* 1: cycles follow each other without a pause; only for measurements */
} cyclic_settings;

/* The distributed clock that the cycle follows. */
typedef struct cyclic_clock {
  uint32_t address;  /* configured station address of the reference clock */
  int32_t position;  /* its position */
  int32_t phase_ns;  /* phase of the deadlines in the cycle of the reference clock */
  uint32_t lock_ns;  /* the cycle counts as locked once the phase stays this close */
} cyclic_clock;

/* Opens a raw socket for EtherCAT frames whose first datagram has an index from `first` to `last`.
 * Returns the file descriptor, or -errno. */
CYCLIC_API int cyclic_open_socket(const char *interface, uint32_t first, uint32_t last);
/* Lets only frames with such an index into an AF_PACKET socket. 0 or -errno. */
CYCLIC_API int cyclic_filter_index(int fd, uint32_t first, uint32_t last);

/* Makes an engine for the prepared shared memory (tables filled, `header` mapped read-write), the
 * open .out shared memory, and one or two sockets (`second_fd` -1: no cable redundancy). The caller
 * still owns all of them. `run` goes into bytes 1 to 4 of the source address of its frames, and
 * tells this run from others. Returns NULL on failure, and sets errno. */
CYCLIC_API cyclic_t *cyclic_new(void *header, int out_fd, int first_fd, int second_fd, uint32_t run);
/* Adds a datagram that exchanges `length` bytes of the image of `domain` from `offset` on, at the
 * logical address `address + offset`. Add datagrams in the order of the domains. `group` is -1, or the
 * group of optional slaves (0 to ECAT_MAX_GROUPS - 1) that all of these bytes belong to. These slaves
 * may be absent; then the working counter of this datagram says nothing about the domain. `split` is 0,
 * or the number (from 1 on, in order) of the outputs or inputs of one slave that several datagrams carry
 * together; they follow each other. `closes` is 1 if it has the last byte of a sync manager that several of
 * them write. Returns 0, or -EINVAL, -ENOSPC, -ENOMEM. */
CYCLIC_API int cyclic_add_datagram(cyclic_t *c, uint32_t domain, int command, uint32_t address,
                                   uint32_t offset, uint32_t length, uint32_t wkc_expected,
                                   int group, uint32_t split, int closes);
/* Makes the cycle follow a reference clock, and distributes its time to the slaves in each cycle.
 * Call it before cyclic_start(). */
CYCLIC_API void cyclic_set_clock(cyclic_t *c, const cyclic_clock *clock);
/* Sets the safe values of a slave's outputs: bits set in `hold` keep their last value, the others
 * take `value`. Both have output_bytes of the slave. */
CYCLIC_API int cyclic_set_safe(cyclic_t *c, uint32_t slave, const uint8_t *value,
                               const uint8_t *hold);
/* Makes the engine refuse raw values of outputs beyond `minimum` and `maximum` of the signal table, and
 * hold copies there. cyclic_start() does this first. Call it again after the table has changed: it returns
 * when the engine uses all of the new limits, which it takes over between two cycles. Outputs that are
 * beyond them then get the value of the nearer limit. Returns how many these are, at most `room`, and
 * writes their signals into `held`; or -ENOMEM. */
CYCLIC_API int cyclic_use_limits(cyclic_t *c, uint32_t *held, uint32_t room);
/* Sets how a drive is stopped when its controlword loses its owner: the controlword is `value` until
 * the statusword (CiA 402) says that the drive no longer moves, for at most `patience_ns`. Then it
 * takes its safe value. Call it before cyclic_start(). */
CYCLIC_API int cyclic_set_stop(cyclic_t *c, uint32_t controlword, uint32_t statusword,
                               uint32_t value, uint64_t patience_ns);
/* Copies an input to an output in every cycle: raw output = raw input * factor + offset, rounded to the
 * nearest number and cut to the limits of the output. The output has its safe value while the input is
 * not valid, and while the drive with `controlword` (-1: none) is brought to a stop. No client can claim
 * the output, even if the input is not on the bus (`source` UINT32_MAX). Call it after cyclic_set_stop()
 * of that drive, and before cyclic_start(). */
CYCLIC_API int cyclic_set_copy(cyclic_t *c, uint32_t source, uint32_t target, double factor,
                               double offset, int32_t controlword);
/* Makes the value of an input the safe value of an output, which has the same type and unit: the output
 * follows the input in every cycle until a client writes it, and again after that client has lost it. While
 * the input is not valid, the last valid value stays. While the drive with `controlword` (-1: none) is
 * brought to a stop, the output stays as it is. Call it after cyclic_set_safe() and cyclic_set_stop(), and
 * before cyclic_set_copy() and cyclic_start(). */
CYCLIC_API int cyclic_set_follow(cyclic_t *c, uint32_t source, uint32_t target, int32_t controlword);
/* A number in the process data of a CAN terminal: a little-endian word of 1, 2 or 4 bytes from byte `at` on,
 * shifted right by `shift` and masked. `mask` 0: there is no such number. */
typedef struct cyclic_can_field {
  uint32_t at, bytes, shift, mask;
} cyclic_can_field;

/* The CAN frames in the process data of a terminal. The fields lie relative to the first byte of a frame. */
typedef struct cyclic_can_messages {
  uint32_t first, stride; /* byte of the first one, and from one to the next */
  uint32_t data;          /* first of the 8 bytes of data, relative to the frame */
  cyclic_can_field identifier, extended, remote, length;
  cyclic_can_field transaction; /* of frames that are sent: a number that the terminal confirms */
} cyclic_can_messages;

/* A terminal with a CAN bus behind it (see can.c). Fields of inputs lie relative to the inputs of the slave,
 * fields of outputs to its outputs. */
typedef struct cyclic_can {
  uint32_t slave;
  uint32_t handshake;     /* 1: the terminal and the master wait for each other; 0: a batch in each cycle */
  cyclic_can_field send_echo, receive_counter, receive_count, transaction; /* inputs */
  cyclic_can_field bus_off, passive, warning, overflow, send_errors, receive_errors; /* inputs */
  cyclic_can_field send_counter, receive_echo, send_count; /* outputs */
  cyclic_can_messages received, sent;
} cyclic_can;

/* A CAN frame that is sent when a client that has sent on the channel ends. */
typedef struct cyclic_can_safe {
  uint32_t id, length;    /* as in ecat_out_can_frame */
  uint8_t data[8];
  uint64_t period_cycles; /* 0: it is sent once */
  uint32_t ended;         /* 1: also if the client ends in order; 0: only if it dies or loses its lease */
  uint32_t range_count;   /* 0: of any client; else of those that have sent an identifier in a range */
  struct { uint32_t first, last; } ranges[128]; /* see ecat_can_range */
} cyclic_can_safe;

/* Adds the next channel of the ecat_shm_can table. The engine writes the outputs of the slave from now on, and
 * no client can claim them. Call it before cyclic_start(). 0, -EINVAL or -ENOMEM. */
CYCLIC_API int cyclic_add_can(cyclic_t *c, const cyclic_can *terminal);
/* Adds a safe frame to the channel that was added last. 0, -EINVAL or -ENOSPC (there may be 32). */
CYCLIC_API int cyclic_add_can_safe(cyclic_t *c, const cyclic_can_safe *frame);
/* Number of drives that are being stopped, and of safe CAN frames that have not been sent yet; valid from two
 * cycles after cyclic_make_safe() on. */
CYCLIC_API uint32_t cyclic_stopping(const cyclic_t *c);
/* Starts the thread. Returns 0 or -errno. The thread starts even if the system refuses a real-time
 * setting; cyclic_..._error() returns the errno of the refusal (0: granted). */
CYCLIC_API int cyclic_start(cyclic_t *c, const cyclic_settings *settings);
CYCLIC_API int cyclic_scheduling_error(const cyclic_t *c);
CYCLIC_API int cyclic_affinity_error(const cyclic_t *c);
CYCLIC_API int cyclic_memory_error(const cyclic_t *c);
CYCLIC_API int cyclic_slack_error(const cyclic_t *c);
/* Gives the engine another socket for port 0 or 1, after an interface went away and came back.
 * Returns when the old socket is no longer used. */
CYCLIC_API void cyclic_set_socket(cyclic_t *c, uint32_t port, int fd);
/* Changes `wkc_limit` of the settings. */
CYCLIC_API void cyclic_set_wkc_limit(cyclic_t *c, int32_t limit);
/* CLOCK_MONOTONIC of the next cycle, in ns; 0 before the first one. */
CYCLIC_API uint64_t cyclic_deadline(const cyclic_t *c);
/* Sets all counters and histograms of the engine back to zero, and returns when that is done. Call it
 * when the slaves are in OP: counts of the time before say nothing about the bus. */
CYCLIC_API void cyclic_restart_counting(cyclic_t *c);
/* Sets all outputs to their safe values from the next cycle on, and refuses claims. */
CYCLIC_API void cyclic_make_safe(cyclic_t *c);
/* Says that the control side works. If no other call follows within `cycles` cycles, the engine does the
 * same as cyclic_make_safe(), since nothing would notice a lost slave or answer a request. The limit is
 * in cycles and not in time, so that outputs do not become safe because the whole machine stood still
 * for a while. Returns 0, or -ETIMEDOUT if the call comes too late. */
CYCLIC_API int cyclic_attend(cyclic_t *c, uint32_t cycles);
/* Ends the thread after the current cycle and waits for it. */
CYCLIC_API void cyclic_stop(cyclic_t *c);
CYCLIC_API void cyclic_free(cyclic_t *c);

/* Writes the layout version: from now on clients may open the shared memory at `header`. */
CYCLIC_API void cyclic_publish_layout(void *header);

/* Waits for the next event. Returns 1, or 0 if none came within `timeout_ns`. For one thread at a time. */
CYCLIC_API int cyclic_wait_event(cyclic_t *c, cyclic_event *event, int64_t timeout_ns);
/* Lets the engine send one more CYCLIC_EVENT_REQUEST for a slot. After that event it sends no other
 * for this slot until the next call, so a client with endless requests cannot fill the event queue. */
CYCLIC_API void cyclic_listen(cyclic_t *c, uint32_t slot);
/* Answers a request of a client (see ecat_shm_reply). */
CYCLIC_API void cyclic_reply(cyclic_t *c, uint32_t slot, uint32_t cell, uint32_t generation,
                             uint32_t seq, int32_t status, uint32_t abort_code, const void *data,
                             uint32_t length);

/* Measures wake-ups of the calling thread: sleeps `count` times until deadlines that are `period_ns` apart,
 * and counts the delays after the deadlines in `late`, an ecat_shm_histogram of zeros. */
CYCLIC_API void cyclic_measure_wakeup(uint64_t period_ns, uint64_t count, void *late);

#endif
