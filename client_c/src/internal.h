/* Types and functions that the source files of the client share. */
#ifndef ECAT_INTERNAL_H
#define ECAT_INTERNAL_H

#ifndef _GNU_SOURCE
#define _GNU_SOURCE /* needed where the sources are compiled without options, as in an FMU */
#endif

#include <ecat/ecat.h>
#include <ecat/ecat_shm.h>

#include "entries.h"
#include "values.h"

#define NS_PER_S 1000000000u
#define GIVE_WAY_NS 20000u        /* pause of a client that keeps the engine from reading its outputs */
#define LATE_NS 20000000u         /* the daemon's lock is checked if the last cycle is older than this */
#define TICK_NS 10000000u         /* largest lag of CLOCK_MONOTONIC_COARSE */
#define RETURN_PAUSE_NS 20000000u /* between two attempts to find the daemon again */

/* File locks of the kernel (ECAT_LOCK_DAEMON, ECAT_LOCK_SLOT) show whether a process is alive. The kernel
 * drops them in whatever way the process ends. They also work between pid namespaces, and a reused
 * process ID makes no difference. */

/* How an entry is read: fast, as an integer that lies within one word and fits into int64_t, or in the
 * slow way. */
enum reading { READ_UNSIGNED, READ_SIGNED, READ_OTHERWISE };

/* Why claims ended other than by a lapse: the daemon ended, or another program wrote over the slot. */
enum lost { LOST_NOTHING, LOST_DAEMON, LOST_PLACE };

/* The place of one entry in the image of its domain, and its decoding. */
struct signal {
  const uint64_t *at; /* the word of the last sample in which it begins */
  uint32_t bit;    /* first bit in the domain's image */
  uint32_t staged; /* outputs: first bit in the output image of a slot */
  uint16_t slave;
  uint16_t domain;
  uint8_t bits;
  uint8_t reading;   /* enum reading */
  uint8_t up, down;  /* shifts of that word that leave only the entry */
  uint8_t sign, real, output;
  int8_t group;      /* bit of `absent` in the snapshot of its domain; -1: its slave must be there */
};

/* The last sample of one domain. */
struct snapshot {
  const ecat_shm_page *page; /* in the daemon's shared memory */
  uint64_t *image;           /* copy; two words longer, so that any entry may be read as a word */
  size_t words;
  uint64_t cycle, time_ns;
  uint64_t absent;           /* bit for each group of optional slaves that did not take part */
  uint32_t wkc, wkc_state;
  uint64_t waited_cycle; /* cycle of the last ecat_wait_domain() or sample */
  int fresh;             /* the daemon was delivering when the sample was taken */
};

/* What this client does on a CAN channel. */
struct can_use {
  int listens;          /* `next` is valid */
  uint64_t next;        /* record to be read next */
  uint64_t missed;
  int sends;            /* this client is a sender */
  int lost;             /* it was one, until its lease or the daemon ended */
  uint64_t lease_ns;    /* 0: a thread gives the signs of life */
  uint32_t written;     /* frames in its queue so far */
  ecat_can_range ranges[ECAT_CAN_RANGES];
  uint32_t range_count;
};

struct ecat_client {
  char name[32];
  char error[512];

  /* Shared memory of the daemon, mapped read-only. */
  char folder[ECAT_SHM_PATH]; /* empty until a bus was found; it comes back only there */
  int fd;
  const uint8_t *map;
  size_t map_size;
  int down;              /* error code if the daemon has gone, 0: it is there */
  char why[512];         /* the error text of `down` */
  uint64_t tried_ns;     /* time of the last attempt to find the daemon again */
  const ecat_shm_header *header;
  const ecat_shm_slave_status *slave_status;
  const ecat_shm_output *outputs;
  const ecat_shm_slot_status *slot_status;
  const ecat_shm_reply *replies;
  const ecat_shm_can *can;
  const ecat_shm_can_sender *can_senders;

  /* Copies of the tables that never change while a daemon lives. They keep their address when the daemon
   * comes back, since programs have pointers to the texts in them. */
  uint8_t *tables;
  ecat_shm_slave *slaves;
  ecat_shm_signal *signals;
  ecat_shm_domain *domains;
  struct signal *signal;
  struct rule *rule;     /* of each signal: the values that may be written */
  struct snapshot *snapshot;
  uint64_t *retired;     /* old images of domains that have changed size: programs may use them */
  uint64_t waited_cycle; /* last cycle seen by ecat_wait or ecat_sample */
  uint64_t sample_cycle;

  /* Shared memory of the clients, mapped when the first slot is needed. */
  int out_fd;
  uint8_t *out_map;
  size_t out_size;
  ecat_out_header layout; /* a copy, since other clients could change the mapped one */
  int slot;              /* -1: none */
  uint32_t generation;
  uint32_t overtaken;    /* last value read from the slot status */
  ecat_out_doorbell *doorbell;
  ecat_out_slot *out;
  uint64_t *out_claims;  /* in the slot: the outputs that this client wants */
  size_t sets;           /* words of a set of signals */
  uint64_t *claims, *written;  /* sets of signals: owned, and written since they were claimed */
  uint64_t *wish;              /* set of signals that the current call claims or releases */
  uint64_t *lease_ns;          /* of each signal in `claims` */
  uint64_t longest_ns;         /* longest of `lease_ns`: the lease of the client */
  uint64_t *stage, *mask;      /* output image of the next commit, and the bits of it that were written */
  uint32_t first, bytes; /* part of the output image with all claims; multiples of 8 */
  uint32_t request_seq;
  uint32_t request[ECAT_REQUESTS]; /* seq of the running requests, 0: free */
  int handle[ECAT_REQUESTS];       /* of the last request in each cell; reused after 2^24 requests */
  unsigned handles;
  uint8_t ended[ECAT_REQUESTS]; /* 1: the request ended with the daemon, and was not polled since */
  struct can_use can_use[ECAT_MAX_CAN];
  enum lost lost;        /* why the claims ended, until outputs are claimed again */
  const char *program;   /* name in messages; NULL: "this client", and messages advise to claim again */
  struct ecat_life *life; /* tells the engine when this process ends, see life.c; NULL: nothing does */
  char *home;            /* contains 0 in a process that was forked later; mapped with `out_map` */
};

/* Sets the text of ecat_error() and returns `code`. */
__attribute__((format(printf, 3, 4))) int ecat_fail(ecat_t *bus, int code, const char *format,
                                                    ...);
uint64_t ecat_now(void);
uint64_t ecat_ns(double seconds);

/* claims.c */
/* Whether the daemon itself writes an output, so that no client can own it. */
int ecat_is_reserved(const ecat_t *bus, int number);
/* Has the engine carry out what this client has by now: outputs in `claims`, and CAN channels. Returns 0 with
 * `*conflict`, see `claim_conflict` of ecat_shm_slot_status. */
int ecat_claims_ring(ecat_t *bus, int *conflict);
/* Takes a refused claim back: the engine sees what this client has one cycle later. */
void ecat_claims_withdraw(ecat_t *bus);
/* The client in a slot, as it calls itself, for messages; empty if that is not known. */
void ecat_client_name(ecat_t *bus, int slot, char text[96]);

/* can.c */
void ecat_can_want(ecat_t *bus);    /* writes its channels into its slot */
void ecat_can_begin(ecat_t *bus);   /* a new generation of the slot sends nothing */
/* Ends sending on all channels in order. */
void ecat_can_end(ecat_t *bus);
void ecat_can_lose(ecat_t *bus);    /* the slot is gone */
uint64_t ecat_can_lease(const ecat_t *bus); /* longest lease of its channels; 0: it sends on none */
int ecat_can_beats(const ecat_t *bus);      /* whether a thread gives the signs of life */

/* files.c: ecat_shm_folder(), ecat_shm_open(), ecat_shm_find() */

/* shared_memory.c */
int ecat_daemon_lives(int fd); /* whether it holds its lock of the shared memory */
int ecat_memory_open(ecat_t *bus);
void ecat_memory_close(ecat_t *bus);
void ecat_images_free(ecat_t *bus); /* the retired ones, valid until ecat_close() */
/* Checks that the daemon still delivers, `age_ns` after the end of its last cycle. ECAT_EDOWN: it has
 * gone, and the slot of this client is given up; ECAT_ESTALE: its cycle stands still. */
int ecat_memory_check(ecat_t *bus, uint64_t age_ns);
int ecat_memory_age(ecat_t *bus); /* the same with the current age */
/* Tries to connect to a daemon that has come back, at most every RETURN_PAUSE_NS. Returns 0 if it is
 * there, else an error code. */
int ecat_memory_look(ecat_t *bus);
static inline int ecat_memory_return(ecat_t *bus) {
  return bus->down == 0 ? 0 : ecat_memory_look(bus);
}
int ecat_page_copy(struct snapshot *snapshot);

/* inputs.c */
/* Waits until `*cycle` is at least `target`. `wake` holds the bits of the futex that wake the caller,
 * such as ECAT_WAKE_CYCLE. */
int ecat_wait_until(ecat_t *bus, const uint64_t *cycle, uint64_t target, uint32_t wake,
                    double timeout);

/* client.c */
int ecat_check_position(ecat_t *bus, int position);
int ecat_no_signal(ecat_t *bus, int number);
/* A name as messages show it in brackets; some slaves and entries have none. */
static inline const char *ecat_shown(const char *name) {
  return name[0] != '\0' ? name : "no name";
}
static inline int ecat_check_signal(ecat_t *bus, int number) {
  return (uint32_t)number < bus->header->signal_count ? 0 : ecat_no_signal(bus, number);
}
int ecat_check_domain(ecat_t *bus, int number);

/* claims.c */
int ecat_check_output(ecat_t *bus, int number);

/* A sign of life. The thread of life.c may give some at the same time. */
static inline void ecat_beat(ecat_t *bus) {
  uint32_t *heartbeat = &bus->doorbell->heartbeat;
  __atomic_store_n(heartbeat, __atomic_load_n(heartbeat, __ATOMIC_RELAXED) + 1, __ATOMIC_RELAXED);
}

/* slot.c */
int ecat_slot_take(ecat_t *bus);
void ecat_slot_free(ecat_t *bus);
void ecat_slot_forget(ecat_t *bus); /* ends all claims and requests */
uint64_t ecat_pid_namespace(void); /* of this process: the inode of /proc/self/ns/pid; 0: not known */
void ecat_slot_begin(ecat_t *bus); /* starts a new generation: the engine drops the last one */
int ecat_slot_lapsed(const ecat_t *bus);
int ecat_slot_overwritten(const ecat_t *bus); /* whether another program wrote over the slot */
int ecat_slot_foreign(const ecat_t *bus);     /* whether this process was forked from the slot's owner */
int ecat_slot_check_home(ecat_t *bus);        /* ECAT_EARG if the slot is foreign */
const ecat_out_slot *ecat_slot_of(ecat_t *bus, int slot); /* of any client; NULL: not readable */

/* life.c */
void ecat_life_begin(ecat_t *bus);  /* after the lock of the slot is taken; without a thread, only the lease tells */
uint32_t ecat_life_word(const ecat_t *bus); /* for the doorbell */
/* Has the thread of ecat_life_begin() give signs of life, every `period_ns`; 0: no more. */
int ecat_life_beat(ecat_t *bus, uint64_t period_ns);
void ecat_life_end(ecat_t *bus);    /* before the lock is released */
void ecat_life_forget(ecat_t *bus); /* in a forked child: the thread is that of the parent */

#endif
