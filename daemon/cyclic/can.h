/* CAN channels: what can.c, which talks to the terminal, and can_senders.c, which knows the clients that send,
 * share. */
#ifndef ECAT_CYCLIC_CAN_H
#define ECAT_CYCLIC_CAN_H

#include "engine.h"

enum {
  CAN_FLIGHTS = 512, /* frames that the terminal has and has not sent yet, at most; a power of two */
  CAN_SAFE = 32, /* bits of a word */
  CAN_BATCH = 256    /* frames in one batch, at most */
};

struct can_frame {
  uint32_t id;          /* as in ecat_out_can_frame */
  uint32_t length;
  uint8_t data[8];
  int32_t slot;         /* of the client; -1: a safe frame */
  uint32_t generation;  /* of the client; 0: a safe frame */
  uint32_t number;      /* in the queue of the client, or of the safe frame */
  uint32_t transaction; /* number that the terminal confirms */
};

/* A client that sends on a channel. */
struct can_sender {
  uint32_t generation;  /* 0: it does not send */
  uint32_t written, taken; /* frames in its queue; `taken` modulo 2^32 of `written` */
  uint32_t touched;     /* bit per safe frame: it has sent an identifier that the safe frame is about */
  uint32_t range_count; /* identifiers that it has reserved */
  ecat_can_range ranges[ECAT_CAN_RANGES];
  int told_refused;
};

/* A frame that is sent when a client ends. */
struct can_safe {
  cyclic_can_safe frame;
  int active;           /* it is sent, until a client sends what it is about */
  int waits;            /* since it became active it was not sent yet */
  int in_flight;        /* the terminal has it */
  uint64_t next_cycle;  /* in which it is sent again */
  uint64_t since_ns;    /* when it became active */
};

struct can_channel {
  cyclic_can terminal;
  ecat_shm_can *shared;
  ecat_shm_can_record *records;
  uint32_t number;
  uint32_t domain;
  uint64_t group;             /* bit of its group of optional slaves, 0: none */
  const uint32_t *al_state;   /* of the terminal, in the shared memory */
  const uint8_t *inputs;      /* of the terminal, in the image of its domain */
  uint8_t *outputs;           /* of the terminal, in the output image */
  uint32_t output_bytes;

  int runs;                   /* the counters of both sides were compared since the terminal came into OP */
  int was_running;            /* the terminal was in OP before */
  uint32_t settle;            /* exchanges left until frames are sent */
  int accepted;               /* the terminal has the last batch */
  uint32_t send_counter, receive_counter, transaction;
  struct can_frame flight[CAN_FLIGHTS];
  uint32_t flight_head, flight_tail; /* modulo 2^32; from tail to head: frames that the terminal has */
  int overflow;               /* the bit of the terminal was set */
  uint64_t overflow_told_ns, malformed_told_ns;

  struct can_sender sender[ECAT_SLOTS];
  uint32_t waiting;           /* bit per slot with frames in its queue */
  uint32_t turn;              /* slot whose frames come first in the next batch */
  struct can_safe safe[CAN_SAFE];
  uint32_t safes;
  struct can_frame batch[CAN_BATCH];
};

/* can_senders.c */
/* Takes at most `room` frames out of the queues of clients, in fair turns, and puts them behind each other into
 * `frames`. Returns how many. */
uint32_t cyclic_can_collect(cyclic_t *c, struct can_channel *channel, struct can_frame *frames, uint32_t room);
/* The same with the safe frames that are due. */
uint32_t cyclic_can_collect_safe(cyclic_t *c, struct can_channel *channel, struct can_frame *frames,
                                 uint32_t room);
/* The terminal has sent a frame, or lost it. */
void cyclic_can_conclude(cyclic_t *c, struct can_channel *channel, const struct can_frame *frame, int sent);
/* Counts the safe frames that were not sent yet, of channels that can send. */
void cyclic_can_count_waiting(cyclic_t *c);

#endif
