/* State of the engine, shared by its parts. */
#ifndef ECAT_ENGINE_H
#define ECAT_ENGINE_H

#include "cyclic.h"

#include <ecat/ecat_shm.h>
#include <math.h>
#include <pthread.h>
#include <time.h>
#include <values.h>
#include <entries.h>

_Static_assert(ECAT_SLOTS <= 32, "slots in use are the bits of a word");

enum {
  MAX_DATAGRAMS = 256,
  MAX_SPLITS = MAX_DATAGRAMS / 2,
  MAX_FRAMES = 64,        /* in one cycle; an index is not used again for twice as many */
  MAX_PORTS = 2,
  FRAME_BYTES = 1518,
  EVENTS = 2048           /* power of two; more than the slaves, which may all lose their owner at once */
};

/* Ethernet and EtherCAT framing (ETG.1000.4, 5.3 and 5.4). */
enum {
  ETHERTYPE = 0x88A4,
  ETHERNET_HEADER = 14,
  ETHERCAT_HEADER = 2,
  FIRST_DATAGRAM = ETHERNET_HEADER + ETHERCAT_HEADER,
  DATAGRAM_HEADER = 10,
  DATAGRAM_WKC = 2,
  DATAGRAM_FRAMING = DATAGRAM_HEADER + DATAGRAM_WKC,
  ETHERNET_MIN = 60,
  PAYLOAD_MAX = 1498,     /* of datagrams in one frame */
  SOURCE_RUN_AT = 7,      /* bytes of the source address that name the run */
  SOURCE_PORT_AT = 11,    /* its lowest bit is the port by which the frame left */
  INDEX_AT = FIRST_DATAGRAM + 1
};

/* The data of the bus as a whole, which every cycle exchanges before the domains: the AL status of all
 * slaves, and the time of the reference clock. */
enum {
  STATUS_BYTES = 2,
  TIME_BYTES = 8,
  BUS_BYTES = STATUS_BYTES + TIME_BYTES + 2 * DATAGRAM_FRAMING,
  DOMAIN_DATAGRAM_MAX = PAYLOAD_MAX - BUS_BYTES - DATAGRAM_FRAMING
};
enum datagram_kind { STATUS_DATAGRAM, TIME_DATAGRAM, DOMAIN_DATAGRAM };

struct datagram {
  uint8_t header[DATAGRAM_HEADER]; /* complete except for the index and the "more follow" bit */
  uint8_t kind;
  uint32_t domain, offset, length;
  uint32_t outputs;      /* bytes at its start that are sent from the image */
  uint32_t wkc_expected;
  uint64_t group;        /* bit of the group of optional slaves whose bytes it has, 0: none */
  uint32_t split;        /* number of the split it is a piece of, counted from 1; 0: it has whole slaves */
  int closes;            /* it has the last byte of a sync manager that is written in pieces */
};

/* The outputs, or the inputs, of a slave in one domain that do not fit into one datagram. */
struct split {
  uint32_t domain, offset, length; /* in the image of the domain */
  uint32_t pieces, opening;        /* datagrams; of these those that do not close */
  uint32_t taken;                  /* in this cycle: pieces that came back with the expected counter */
  uint8_t *inputs;                 /* of the pieces so far, until all are there */
};

/* A frame of this cycle: its datagrams, and the copies of it that are back. */
struct frame {
  uint32_t first, count;   /* in `order` */
  uint32_t length;         /* on the wire */
  uint32_t domains;        /* bit per domain with data in it */
  uint8_t pending;         /* bit per port: the copy sent there is not back yet */
  uint8_t copies;          /* number of copies that are back; with two ports merged in `answer` */
  uint8_t bytes[FRAME_BYTES];
  uint8_t answer[FRAME_BYTES];
};

struct domain {
  ecat_shm_page *page;     /* in the shared memory */
  ecat_shm_domain_status *status;
  uint8_t *image;          /* outputs as sent, inputs as last received; padded to whole words */
  uint32_t image_bytes, output_bytes, output_base, divider, wkc_expected;
  uint64_t next_cycle;     /* in which it is exchanged */
  uint32_t meets;          /* bit per domain: there are cycles in which both are exchanged */
  uint32_t wkc, wkc_state, told_state;
  uint32_t bad;            /* exchanges in a row without a complete working counter */
  int32_t complete;        /* all datagrams of this cycle so far had their expected counter */
  int32_t whole;           /* all frames of this cycle with its data were sent and came back */
  uint64_t absent;         /* bit per group of optional slaves that did not take part */
};

/* How the deadlines follow the reference clock; see clock.c. */
struct clock {
  int32_t enabled, measured;
  int64_t phase_ns, lock_ns;
  uint64_t time_ns;        /* of the reference clock, when the frame of `send_ns` passed it */
  uint64_t send_ns;
  int64_t integral, fraction, filtered;
  int64_t drift, drifts;   /* mean of the integral, and over how many cycles it is taken */
  int64_t correction;      /* of the next deadline, in ns */
  uint32_t settled, silent, state, told_state;
};

/* The state of a client, as the engine has read it. */
struct slot {
  uint32_t generation, heartbeat, claim_seq, commit_seq, request_seq;
  uint32_t first, bytes;   /* part of the output image with all outputs of the client; multiples of 8 */
  uint64_t *claims;        /* set of signals that the client owns */
  uint64_t *mask, *active; /* bits of the output image that the client owns, and that it has written */
  uint64_t beat_ns, lease_ns;
  uint64_t commit_ns, sample_cycle; /* of a commit that goes out in this cycle; 0: none */
  uint32_t can_seq, can_sends;      /* can_sends: bit per CAN channel on which the client sends */
  int told_malformed;
};

/* An output whose values have a declared range, in raw units. */
struct limit {
  uint32_t signal, bit;    /* bit: of the output image */
  int told;
  int held;                /* its value was beyond the range when the engine took the range over */
  struct rule rule;
  uint64_t before;
};

/* The values that a copy may have. */
struct copy_limit {
  struct rule rule;
  uint8_t plain;           /* the bits are copied as they are */
};

/* All declared ranges. If they change, control makes others, and the engine takes them over between two
 * cycles, all at once. So each value is compared with both limits of one range. */
struct limits {
  size_t size;             /* of the whole block of memory, with both arrays */
  uint32_t count;
  struct limit *limit;     /* of the outputs that have one */
  struct copy_limit *copy; /* of each copy */
};

/* The stop of a CiA 402 drive without an owner. The controlword is `value` until the statusword says that
 * the drive no longer moves, or until patience ends. Then the controlword takes its safe value. */
struct stop {
  uint32_t signal, bit;    /* of the controlword; bit: of the output image */
  uint32_t domain, status_bit;
  uint32_t value;
  uint64_t patience_ns, until_ns;
  int running;
};

/* An output that gets the value of an input; see copies.c. */
struct copy {
  uint32_t target, target_bit; /* signal, and bit of the output image */
  uint32_t domain, source_bit; /* of the input: its domain, and bit of its image */
  uint64_t group;              /* bit of its group of optional slaves, 0: none */
  const uint32_t *al_state;    /* of its slave, in the shared memory; NULL: the input is not on the bus */
  int32_t stop;                /* of the drive that the output belongs to; -1: none */
  uint8_t source_bits, source_sign, source_real;
  uint8_t target_bits;
  uint8_t whole;               /* an integer becomes an integer without conversion */
  uint8_t follows;             /* only the safe value of the output is that of the input */
  uint8_t same;                /* of the same length and sign, so that the bits can be copied as they are */
  uint32_t told;               /* ecat_reason that was published last */
  double factor, offset;       /* raw output = raw input * factor + offset */
};

struct cyclic {
  ecat_shm_header *header;
  const ecat_shm_slave *slaves;
  const ecat_shm_signal *signals;
  ecat_shm_output *output;
  ecat_shm_slot_status *slot_status;
  ecat_shm_reply *replies;
  ecat_shm_health *health;

  struct domain domain[ECAT_MAX_DOMAINS];
  struct datagram datagram[MAX_DATAGRAMS]; /* the status, the time, then the data of the domains */
  uint32_t domains, datagrams;
  struct split split[MAX_SPLITS];
  uint32_t splits, closing;                /* closing: datagrams that close */

  /* The frames of this cycle. */
  uint32_t due, packed;                    /* bit per domain: exchanged in this cycle; in the layout */
  uint16_t order[MAX_DATAGRAMS];           /* datagrams in their order in the frames */
  uint16_t position[MAX_DATAGRAMS];        /* of these datagrams in their frame */
  struct frame frame[MAX_FRAMES];
  uint32_t frames, waiting;                /* waiting: frames that are not back completely */
  uint32_t first_turn;                     /* frames sent at once; those behind wait for their answers */
  uint32_t sent;                           /* frames since the start: index and tag */
  uint32_t lost[128];                      /* by index: domains of a frame that was given up */
  uint8_t source[6];
  uint8_t receive_buffer[2048];

  int fd[MAX_PORTS], wanted_fd[MAX_PORTS];
  uint32_t ports;
  int timer_fd;                            /* ends waiting for frames */
  int send_error[MAX_PORTS];
  uint32_t ring, ring_break;               /* of this cycle, ECAT_RING_NONE: not known */
  uint32_t told_ring, told_break;
  uint32_t found, al_status, told_found, told_al_status, silent;

  struct clock clock;

  int out_fd;
  void *out_map;                  /* never accessed: the mapping exists so that its pages are locked */
  size_t out_size;
  ecat_out_header out;            /* copy from the start; a client cannot change it */
  ecat_out_doorbell doorbell[ECAT_SLOTS];
  struct slot slot[ECAT_SLOTS];
  uint32_t used;                  /* bit per slot that has a client in this cycle, or just lost it */
  uint32_t request_told;          /* bit per slot: control has the event and will read the requests */
  uint32_t claim_turn;            /* slot whose claims are read in this cycle */
  uint8_t *outputs, *safe, *hold; /* output images */
  uint8_t *slot_image;            /* ecat_out_image with its mask and values, as read */
  uint64_t *claimable, *wanted;   /* sets of signals: outputs that may have an owner; claims as read */
  uint64_t *reserved;             /* set of signals: outputs that the engine writes itself, by copies and for CAN */
  void *output_memory;            /* memory of these sets and of the sets of the slots */
  struct limits *limits, *wanted_limits; /* wanted: set by control */
  struct stop *stop_sequence;
  struct copy *copy;
  uint32_t copies;
  uint32_t stops, stopping;       /* stopping: drives that are being stopped now */
  int make_safe, restart;         /* set by control */
  struct can_channel *can;        /* see can.h */
  uint32_t cans, can_news;        /* can_news: bits as in ECAT_WAKE_CAN: channels with new records */
  uint32_t can_stopping;          /* safe frames that have not been sent yet */
  uint32_t attend;                /* set by control: new value for `attended`; 0: already taken over */
  uint32_t attended;              /* cycles left until outputs become safe; 0: never called, or too late */

  struct cyclic_frame_ring *frame_ring; /* records sent and received frames, or NULL */
  struct cyclic_relay *relay;     /* relay that follows this engine, or NULL; control */
  cyclic_settings settings;
  uint64_t cycle;
  uint64_t deadline_ns;           /* of the current cycle, until its end */
  uint64_t next_ns;               /* the deadline, for other threads */
  uint64_t now_ns;                /* start of the current cycle */
  uint64_t send_ns;
  uint64_t exchange_ns;           /* how long the exchange of this cycle took */
  uint64_t lost_before, mailbox_frames_before; /* counters at the end of the cycle before */
  uint64_t span_ns;               /* start of the span of the worst cycles; `span`: its entry */
  uint32_t span;
  int64_t typical_ns;             /* of an exchange, averaged */
  uint64_t overrun_told_ns;
  uint32_t overruns;              /* missed deadlines that no event has reported yet */
  pthread_t thread, wake_thread;
  uint32_t crowd;                 /* futex: clients that `wake_thread` must wake, bits as in ECAT_WAKE_CYCLE */
  int started, stop;
  int scheduling_error, affinity_error, memory_error, slack_error;

  /* Events: the engine is the only writer, control the only reader. */
  cyclic_event event[EVENTS];
  uint32_t event_head, event_tail;
};

/* engine.c */
uint64_t cyclic_now(void);
void cyclic_run(cyclic_t *c); /* until `stop` */

/* control.c */
/* Queues an event for control. Returns 0 if the queue is full (EVENTS unread); the event is lost. */
int cyclic_emit(cyclic_t *c, uint32_t type, int32_t slave, int32_t slot, uint32_t value);

/* frames.c */
void cyclic_frames_init(cyclic_t *c);
int cyclic_frames_fit(const cyclic_t *c); /* whether a cycle with all domains has room */
void cyclic_frames_fill(cyclic_t *c);     /* makes the frames of this cycle ready to be sent */
/* Before the second turn: leaves out the datagrams of splits whose opening pieces were not all taken. */
void cyclic_frames_close(cyclic_t *c);
void cyclic_frames_free(cyclic_t *c);
/* Whether `bytes` is the answer to a frame: all its datagrams are where they were sent. */
int cyclic_frame_is_answer(const cyclic_t *c, const struct frame *frame, const uint8_t *bytes,
                           size_t length);
/* Adds the copy that came back by another port to `frame->answer`. */
void cyclic_frame_merge(const cyclic_t *c, struct frame *frame, const uint8_t *bytes);
int cyclic_frame_complete(const cyclic_t *c, const struct frame *frame, const uint8_t *bytes);
/* Takes over the data that a frame has brought back. */
void cyclic_frame_take(cyclic_t *c, const struct frame *frame, const uint8_t *bytes);

/* ports.c */
/* Both for the frames `first` to `end` - 1 of this cycle. */
void cyclic_ports_send(cyclic_t *c, uint32_t first, uint32_t end);
void cyclic_ports_receive(cyclic_t *c, uint32_t first, uint32_t end, uint64_t deadline_ns);
/* Counts frames that are not sent as not exchanged. */
void cyclic_ports_leave_out(cyclic_t *c, uint32_t first, uint32_t end);

/* clock.c */
uint64_t cyclic_clock_estimate(const cyclic_t *c); /* of the reference clock's time, at send_ns */
void cyclic_clock_measure(cyclic_t *c, uint64_t time_ns);
void cyclic_clock_follow(cyclic_t *c); /* at the end of the cycle: corrects the next deadline */

/* slots.c */
int cyclic_slots_init(cyclic_t *c);
void cyclic_slots_read(cyclic_t *c);      /* before sending */
void cyclic_slots_sent(cyclic_t *c);      /* after sending */
void cyclic_slots_publish(cyclic_t *c);   /* at the end of the cycle */
/* Ends the claims of all clients that own outputs in a domain. */
void cyclic_slots_lapse_domain(cyclic_t *c, uint32_t domain);

/* can.c */
void cyclic_can_send(cyclic_t *c);    /* before sending: puts frames of clients into the outputs */
void cyclic_can_receive(cyclic_t *c, uint64_t time_ns); /* after the exchange: takes them out of the inputs */
void cyclic_can_prefault(cyclic_t *c, void (*prefault)(void *memory, size_t size));

/* can_senders.c */
/* The client of a slot has put frames into its queues. */
void cyclic_can_look(cyclic_t *c, uint32_t number);
/* Carries out the claims of a slot on CAN channels. Returns CYCLIC_CONFLICT_NONE, or CYCLIC_CONFLICT_CAN - n
 * if another client has reserved identifiers of channel n; then the slot gets nothing new. */
int32_t cyclic_can_claim(cyclic_t *c, uint32_t number);
/* Ends all that a slot sends; `reason` is an ecat_reason. Returns whether it sent on any channel. */
int cyclic_can_drop(cyclic_t *c, uint32_t number, uint32_t reason);

/* copies.c */
void cyclic_copies_run(cyclic_t *c); /* in every cycle, after the commits of clients */
/* The values that a copy may have, as the signal table says now. */
struct copy_limit cyclic_copy_limit(const cyclic_t *c, const struct copy *copy);

/* outputs.c */
enum { CYCLIC_CONFLICT_NONE = -1, CYCLIC_CONFLICT_STOPPING = -2, CYCLIC_CONFLICT_CAN = -3 };
int cyclic_outputs_init(cyclic_t *c);
/* Takes over other declared ranges, if control has made some; at the start of a cycle. */
void cyclic_outputs_adopt_limits(cyclic_t *c);
/* Calls `prefault` for all memory that outputs.c has allocated. */
void cyclic_outputs_prefault(cyclic_t *c, void (*prefault)(void *memory, size_t size));
/* Makes a slot the owner of exactly the signals in `c->wanted`. If another slot owns one of them, this
 * slot gets no new signal. Signals that it no longer wants are released in any case. Returns a signal
 * in conflict, or CYCLIC_CONFLICT_... */
int32_t cyclic_outputs_claim(cyclic_t *c, uint32_t slot);
void cyclic_outputs_drop(cyclic_t *c, uint32_t slot, uint32_t reason); /* all outputs of the slot */
int cyclic_outputs_has_domain(const cyclic_t *c, uint32_t slot, uint32_t domain);
/* Takes a commit over. `part`: a mask and values for the part of the output image that the slot owns. */
void cyclic_outputs_take(cyclic_t *c, uint32_t slot, const uint64_t *part);
void cyclic_outputs_stop_drives(cyclic_t *c);                          /* in every cycle */
void cyclic_outputs_make_all_safe(cyclic_t *c, uint32_t reason);

/* publish.c */
void cyclic_publish_domain(cyclic_t *c, struct domain *domain, uint64_t time_ns);
void cyclic_publish_bus(cyclic_t *c);     /* slaves, ring, clock */
void cyclic_publish_restart(cyclic_t *c); /* zeroes counters and histograms */
void cyclic_publish_cycle(cyclic_t *c, uint64_t time_ns);
void cyclic_publish_worst(cyclic_t *c, uint64_t end_ns); /* keeps the cycle if it is one of the worst */
void cyclic_count(ecat_shm_histogram *histogram, uint64_t ns);

/* wake.c */
int cyclic_wake_start(cyclic_t *c);
void cyclic_wake_clients(cyclic_t *c);    /* that wait for the end of a cycle, or a due domain */
void cyclic_wake_stop(cyclic_t *c);       /* after `stop` is set */

static inline void counter_add(uint64_t *counter, uint64_t n) {
  __atomic_store_n(counter, *counter + n, __ATOMIC_RELAXED); /* single writer */
}

static inline void put16(uint8_t *at, uint32_t value) {
  at[0] = (uint8_t)value;
  at[1] = (uint8_t)(value >> 8);
}
static inline void put32(uint8_t *at, uint32_t value) {
  put16(at, value);
  put16(at + 2, value >> 16);
}
static inline void put64(uint8_t *at, uint64_t value) {
  put32(at, (uint32_t)value);
  put32(at + 4, (uint32_t)(value >> 32));
}
static inline uint32_t get16(const uint8_t *at) { return (uint32_t)(at[0] | at[1] << 8); }
static inline uint32_t get32(const uint8_t *at) { return get16(at) | get16(at + 2) << 16; }
static inline uint64_t get64(const uint8_t *at) {
  return get32(at) | (uint64_t)get32(at + 4) << 32;
}

#endif
