/* A bus and its nodes; shared by the files of this folder. */
#ifndef ECAT_CAN_BUS_H
#define ECAT_CAN_BUS_H

#include "can.h"

#include <errno.h>
#include <pthread.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

enum {
    INTERMISSION_BITS = 3,
    IDLE_BITS = 11,        /* recessive bits after which a node takes part */
    RECOVERY_IDLES = 128,  /* how often a node in bus-off waits for these */
    WARNING_AT = 96,
    PASSIVE_AT = 128,
    BUS_OFF_AT = 256
};
#define NEVER INT64_MAX

struct queue {
    struct can_frame *frames;
    unsigned capacity, first, count;
};

struct source {
    struct can_source settings;
    uint64_t sent;
};

struct check {
    struct can_source settings;
    struct can_check_status status;
    uint64_t next; /* number of the frame that it expects */
    bool begun;
};

struct node {
    uint32_t bit_rate, flags;
    bool on, bus_off;
    unsigned transmit_errors, receive_errors;
    unsigned idles;   /* in bus-off: how many of RECOVERY_IDLES it has seen */
    int64_t ready_ns; /* it begins no frame before */
    struct queue transmit, receive;
    unsigned filter_count, source_count, check_count;
    uint32_t echo;    /* what `can_set_echo` has set; 0 = none */
    unsigned waiting; /* threads in `can_wait` */
    int picked;       /* source of its frame on the wire; -1 = the queue */
    bool cancelled;   /* its frame on the wire is not sent again */
    struct can_node_status counters; /* only what is counted */
    struct can_filter filters[CAN_MAX_FILTERS];
    struct source sources[CAN_MAX_SOURCES];
    struct check checks[CAN_MAX_CHECKS];
};

/* How an attempt to send a frame ends. It is known when it begins. */
enum outcome { SENT, NOT_ACKNOWLEDGED, DESTROYED };

/* A frame on the wire. */
struct attempt {
    bool under_way;
    enum outcome outcome;
    uint32_t senders;   /* several, if they send the same bits */
    uint32_t disturbed; /* nodes with another bit rate, which see nonsense */
    struct can_frame frame;
    int64_t begin_ns, end_ns, free_ns; /* the next frame may begin at `free_ns` */
};

struct can_bus {
    pthread_mutex_t lock; /* guards everything below; the functions of this file need it */
    pthread_cond_t received;
    int64_t now_ns;
    int64_t lag_ns;  /* how far `now_ns` is behind the clock of the callers */
    int64_t free_ns; /* the wire is idle from here on, unless `attempt` is under way */
    double noise;
    uint64_t random;
    enum can_stuck stuck;
    struct attempt attempt;
    struct can_bus_status counters;
    unsigned count;
    struct node nodes[CAN_MAX_NODES];
};

static inline uint32_t bit_of(unsigned node) { return UINT32_C(1) << node; }

static inline int64_t bits_ns(int64_t bits, uint32_t bit_rate)
{
    return bits * INT64_C(1000000000) / bit_rate;
}

/* bits.c */
unsigned bits_to_crc(const struct can_frame *frame);
uint32_t bits_rank(const struct can_frame *frame);

/* queue.c */
int queue_make(struct queue *queue, unsigned capacity);
bool queue_push(struct queue *queue, const struct can_frame *frame);
void queue_pop(struct queue *queue);
static inline const struct can_frame *queue_head(const struct queue *queue)
{
    return &queue->frames[queue->first];
}

/* node.c */
bool node_takes_part(const struct node *node);
bool node_passive(const struct node *node);
enum can_state node_state(const struct node *node);
/* Returns when it wants to send, or NEVER. */
int64_t node_wants_ns(const struct node *node);
/* Returns the frame that it begins at `now_ns`. */
struct can_frame node_pick(struct node *node, int64_t now_ns);
void node_sent(struct node *node, const struct can_frame *frame);
void node_send_failed(struct node *node);
void node_receive_failed(struct node *node, unsigned by);
void node_deliver(struct can_bus *bus, struct node *node, const struct can_frame *frame);
void node_keep(struct node *node);
void node_cancel(struct can_bus *bus, struct node *node);
void node_reset(struct node *node, int64_t ready_ns);

/* traffic.c */
int64_t source_due_ns(const struct source *source);
struct can_frame source_frame(const struct source *source);
void check_frame(struct check *check, const struct can_frame *frame);

/* bus.c */
void bus_advance(struct can_bus *bus, int64_t now_ns);
/* Locks the bus and returns a node. If there is none, returns NULL without the lock. */
struct node *bus_enter(struct can_bus *bus, int node);
void bus_leave(struct can_bus *bus);
int bus_push(const struct can_bus *bus, struct node *node, const struct can_frame *frame);

/* attempt.c */
void attempt_begin(struct can_bus *bus, int64_t now_ns);
void attempt_end(struct can_bus *bus);

#endif
