/* State of the engine, shared by its parts. */
#ifndef ECAT_ENGINE_H
#define ECAT_ENGINE_H

#include "cyclic.h"

#include <ecat/ecat_shm.h>
#include <pthread.h>
#include <time.h>

enum {
  MAX_DOMAINS = 16,
  MAX_DATAGRAMS = 256,
  MAX_FRAMES = 128,
  FRAME_BYTES = 1518,
  EVENTS = 256,           /* power of two */
  INDEX_FIRST = 0x80      /* SOEM uses datagram indices 0 to 15 */
};

/* Ethernet and EtherCAT framing (ETG.1000.4, 5.3 and 5.4). */
enum {
  ETHERNET_HEADER = 14,
  ETHERCAT_HEADER = 2,
  DATAGRAM_HEADER = 10,
  DATAGRAM_WKC = 2,
  ETHERNET_MIN = 60,
  PAYLOAD_MAX = 1498,     /* of datagrams in one frame */
  INDEX_AT = ETHERNET_HEADER + ETHERCAT_HEADER + 1
};

struct datagram {
  uint32_t domain, address, offset, length, wkc_expected;
  uint8_t command;
};

/* A frame in its sending buffer, with the datagrams that it carries. */
struct frame {
  uint32_t first, count; /* datagrams */
  uint32_t domain;
  uint32_t length;       /* on the wire */
  uint8_t index;         /* of this cycle */
  uint8_t pending;       /* sent, not back yet */
  uint8_t bytes[FRAME_BYTES];
};

struct domain {
  ecat_shm_page *page;   /* in the segment */
  uint8_t *image;        /* outputs as sent, inputs as last received; padded to whole words */
  uint32_t image_bytes, output_bytes, output_base, divider, wkc_expected;
  uint32_t wkc, wkc_state;
  int32_t complete;      /* all datagrams of this cycle so far had their expected counter */
};

/* What the engine knows about a client. */
struct slot {
  uint32_t generation, heartbeat, claim_seq, commit_seq, request_seq;
  uint32_t owned;        /* number of slaves */
  uint64_t beat_ns, lease_ns;
  uint64_t commit_ns, sample_cycle; /* of a commit that goes out in this cycle; 0: none */
};

struct cyclic {
  ecat_shm_header *header;
  ecat_shm_slave *slaves;
  ecat_shm_slave_status *slave_status;
  ecat_shm_slot_status *slot_status;
  ecat_shm_reply *replies;
  ecat_shm_health *health;

  struct domain domain[MAX_DOMAINS];
  struct datagram datagram[MAX_DATAGRAMS];
  struct frame frame[MAX_FRAMES];
  uint32_t domains, datagrams, frames;
  uint8_t receive_buffer[2048];
  uint8_t next_index;
  int socket_fd;
  int sending_fails;

  int out_fd;
  void *out_map;                  /* never touched: there so that its pages are locked */
  size_t out_size;
  ecat_out_header out;            /* copy from the start; a client cannot change it */
  ecat_out_doorbell doorbell[ECAT_SLOTS];
  struct slot slot[ECAT_SLOTS];
  uint8_t *outputs, *safe, *hold; /* output images */
  uint8_t *slot_image;            /* ecat_out_image and its data, as read */
  int make_safe;                  /* set by control */

  cyclic_settings settings;
  uint64_t cycle;
  uint64_t now_ns;                /* start of the current cycle */
  uint64_t send_ns;
  pthread_t thread;
  int started, stop;
  int scheduling_error, affinity_error, memory_error;

  /* Events: the engine is the only writer, control the only reader. */
  cyclic_event event[EVENTS];
  uint32_t event_head, event_tail;
};

/* engine.c */
uint64_t cyclic_now(void);
void cyclic_run(cyclic_t *c); /* until `stop` */

/* control.c */
/* 0 when control has not read the last EVENTS ones yet, and this one is lost. */
int cyclic_emit(cyclic_t *c, uint32_t type, int32_t slave, int32_t slot, uint32_t value);

/* wire.c */
int cyclic_wire_open(cyclic_t *c, const char *interface);
int cyclic_wire_plan(cyclic_t *c);
void cyclic_wire_send(cyclic_t *c);
void cyclic_wire_receive(cyclic_t *c, uint64_t deadline_ns);

/* slots.c */
int cyclic_slots_init(cyclic_t *c);
void cyclic_slots_read(cyclic_t *c);      /* before sending */
void cyclic_slots_sent(cyclic_t *c);      /* after sending */
void cyclic_slots_publish(cyclic_t *c);   /* at the end of the cycle */
void cyclic_slots_make_safe(cyclic_t *c);

/* publish.c */
void cyclic_publish_domain(cyclic_t *c, struct domain *domain, uint64_t time_ns);
void cyclic_publish_cycle(cyclic_t *c, uint64_t time_ns);
void cyclic_count(ecat_shm_histogram *histogram, uint64_t ns);

static inline void counter_add(uint64_t *counter, uint64_t n) {
  __atomic_store_n(counter, *counter + n, __ATOMIC_RELAXED); /* single writer */
}

#endif
