/* What the parts of the client share. */
#ifndef ECAT_INTERNAL_H
#define ECAT_INTERNAL_H

#ifndef _GNU_SOURCE
#define _GNU_SOURCE /* where the sources are compiled without any options, as those in an FMU */
#endif

#include <ecat/ecat.h>
#include <ecat/ecat_shm.h>

#include "entries.h"
#include "values.h"

#define NS_PER_S 1000000000u
#define LATE_NS 20000000u         /* since the last cycle, until it is asked whether the daemon lives */
#define TICK_NS 10000000u         /* that CLOCK_MONOTONIC_COARSE is behind, at most */
#define RETURN_PAUSE_NS 20000000u /* between two looks whether the daemon is back */

/* Kernel file locks say who is alive (ECAT_LOCK_DAEMON, ECAT_LOCK_SLOT): they vanish with their
 * holder however it ends, reach across pid namespaces and cannot be confused by a process number
 * used again. */

/* How an entry is read: an integer within one word, which a double or int64_t holds, or else. */
enum reading { READ_UNSIGNED, READ_SIGNED, READ_OTHERWISE };

/* How claims may end without a lapse: with the daemon, or because somebody wrote over the slot. */
enum lost { LOST_NOTHING, LOST_DAEMON, LOST_PLACE };

/* How one entry lies in the image of its domain. */
struct signal {
  const uint64_t *at; /* the word of the last sample that it begins in */
  uint32_t bit;    /* first one, in the domain's image */
  uint32_t staged; /* outputs: the same in the output image of a slot */
  uint16_t slave;
  uint16_t domain;
  uint8_t bits;
  uint8_t reading;   /* enum reading */
  uint8_t up, down;  /* shifts that leave nothing but the entry of that word */
  uint8_t sign, real, output;
};

/* The last sample of one domain. */
struct snapshot {
  const ecat_shm_page *page; /* in the mapping */
  uint64_t *image;           /* copy; two words longer, so that any entry may be read as a word */
  size_t words;
  uint64_t cycle, time_ns;
  uint32_t wkc, wkc_state;
  uint64_t waited_cycle; /* last one seen by ecat_wait_domain or a sample */
  int fresh;             /* when it was taken, the daemon delivered */
};

struct ecat_client {
  char name[32];
  char error[512];

  /* Shared memory of the daemon, mapped read-only. */
  int fd;
  const uint8_t *map;
  size_t map_size;
  int down;              /* code that says why the daemon is not there any more, 0: it is */
  char why[512];         /* the sentence to it */
  uint64_t tried_ns;     /* when it was last looked whether it is back */
  const ecat_shm_header *header;
  const ecat_shm_slave_status *slave_status;
  const ecat_shm_output *outputs;
  const ecat_shm_slot_status *slot_status;
  const ecat_shm_reply *replies;

  /* Copies of what never changes while the daemon lives. Their place does not change when it comes
   * back, since programs have pointers to the texts in them. */
  uint8_t *tables;
  ecat_shm_slave *slaves;
  ecat_shm_signal *signals;
  ecat_shm_domain *domains;
  struct signal *signal;
  struct rule *rule;     /* of each signal, what is written to it has to keep to */
  struct snapshot *snapshot;
  uint64_t *retired;     /* images of domains that have another size now, for who has their address */
  uint64_t waited_cycle; /* last cycle seen by ecat_wait or ecat_sample */
  uint64_t sample_cycle;

  /* Shared memory of the clients, mapped when the first slot is needed. */
  int out_fd;
  uint8_t *out_map;
  size_t out_size;
  ecat_out_header layout; /* copy: other clients could change the one in the mapping */
  int slot;              /* -1: none */
  uint32_t generation;
  ecat_out_doorbell *doorbell;
  ecat_out_slot *out;
  uint64_t *out_claims;  /* in the mapping: what this client wants */
  size_t sets;           /* words of a set of signals */
  uint64_t *claims, *written;  /* sets of signals: what it has got, and has written since */
  uint64_t *wish;              /* set of signals that a call claims or releases */
  uint64_t *lease_ns;          /* of each signal in `claims` */
  uint64_t longest_ns;         /* of them: the lease of the client */
  uint64_t *stage, *mask;      /* output image as it will be committed, and its bits that count */
  uint32_t first, bytes; /* part of the output image with all claims; multiples of 8 */
  uint32_t request_seq;
  uint32_t request[ECAT_REQUESTS]; /* seq of the running requests, 0: free */
  int handle[ECAT_REQUESTS];       /* of the last request of each cell; never used twice */
  unsigned handles;
  uint8_t ended[ECAT_REQUESTS]; /* 1: ended with the daemon, which its owner has not asked for yet */
  enum lost lost;        /* why claims have ended that were not made again */
  const char *program;   /* sentences speak of it, NULL: of "this client", and tell it to claim again */
  char *home;            /* 0 in a process that was forked since; with `out_map` */
};

/* Fills ecat_error() and returns `code`. */
__attribute__((format(printf, 3, 4))) int ecat_fail(ecat_t *bus, int code, const char *format,
                                                    ...);
uint64_t ecat_now(void);
uint64_t ecat_ns(double seconds);

/* shared_memory.c */
int ecat_memory_open(ecat_t *bus);
void ecat_memory_close(ecat_t *bus);
void ecat_images_free(ecat_t *bus); /* those that nobody may use after ecat_close() */
/* Is the daemon still delivering, `age_ns` after its last cycle? When it is not there any more,
 * that is the end of the slot. */
int ecat_memory_check(ecat_t *bus, uint64_t age_ns);
int ecat_memory_age(ecat_t *bus); /* the same for now */
/* 0 while the daemon is there, or when it is there again: looks for it, but not too often. */
int ecat_memory_look(ecat_t *bus);
static inline int ecat_memory_return(ecat_t *bus) {
  return bus->down == 0 ? 0 : ecat_memory_look(bus);
}
int ecat_page_copy(struct snapshot *snapshot);

/* inputs.c */
/* Waits until `*cycle` is at least `target`; `wake` says for what, see ECAT_WAKE_CYCLE. */
int ecat_wait_until(ecat_t *bus, const uint64_t *cycle, uint64_t target, uint32_t wake,
                    double timeout);

/* client.c */
int ecat_check_position(ecat_t *bus, int position);
int ecat_no_signal(ecat_t *bus, int number);
/* A name as messages show it in brackets: some slaves and entries have none. */
static inline const char *ecat_shown(const char *name) {
  return name[0] != '\0' ? name : "no name";
}
static inline int ecat_check_signal(ecat_t *bus, int number) {
  return (uint32_t)number < bus->header->signal_count ? 0 : ecat_no_signal(bus, number);
}
int ecat_check_domain(ecat_t *bus, int number);

/* claims.c */
int ecat_check_output(ecat_t *bus, int number);

/* slot.c */
int ecat_slot_take(ecat_t *bus);
void ecat_slot_free(ecat_t *bus);
void ecat_slot_forget(ecat_t *bus); /* the end of all claims and requests */
void ecat_slot_begin(ecat_t *bus); /* a new life in it: the engine forgets the old one */
int ecat_slot_lapsed(const ecat_t *bus);
int ecat_slot_overwritten(const ecat_t *bus); /* by another program: it ends all that was in it */
int ecat_slot_foreign(const ecat_t *bus);     /* this process was forked from the one that has it */
int ecat_slot_check_home(ecat_t *bus);        /* an error if so */
const ecat_out_slot *ecat_slot_of(ecat_t *bus, int slot); /* of any client */

#endif
