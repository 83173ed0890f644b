/* A CAN bus in software (ISO 11898-1, classical frames): interface.
 *
 * Nodes have queues; the bus decides by identifier whose frame comes next, and how long it takes,
 * bit by bit. Nothing runs by itself: each call that has a time (`now_ns`, CLOCK_MONOTONIC) first
 * lets everything happen that has ended by then. So a test runs the same seconds again and again,
 * and a simulator passes the time of its clock.
 *
 * Functions return a negative errno value on failure. Every function may be called from any thread.
 */
#ifndef ECAT_CAN_H
#define ECAT_CAN_H

#include <stddef.h>
#include <stdint.h>

#define CAN_API __attribute__((visibility("default")))

enum {
    CAN_MAX_NODES = 32,
    CAN_MAX_FILTERS = 64, /* of a node */
    CAN_MAX_SOURCES = 16, /* of a node */
    CAN_MAX_CHECKS = 16,  /* of a node */
    CAN_MAX_BITS = 160    /* of a frame with stuff bits and intermission */
};

enum can_flag { CAN_EXTENDED = 0x01, CAN_REMOTE = 0x02 };

struct can_frame {
    int64_t time_ns; /* when it was given to its sender; for a receiver: the end of the frame */
    uint32_t id;
    uint32_t tag;   /* the sender's; it is not on the wire */
    uint8_t flags;  /* enum can_flag */
    uint8_t length; /* 0 to 8; of a remote frame, the data length code */
    uint8_t sender; /* node */
    uint8_t unused;
    uint8_t data[8];
};

enum can_node_flag {
    CAN_LISTENS_ONLY = 0x01, /* sends nothing, and acknowledges nothing */
    CAN_STAYS_OFF = 0x02     /* comes back from bus-off by `can_restart` only */
};

struct can_node_config {
    uint32_t bit_rate; /* bits a second */
    uint32_t flags;    /* enum can_node_flag */
    uint32_t transmit_queue; /* frames; at least 1 */
    uint32_t receive_queue;  /* 0: nobody takes what it receives */
};

/* Identifiers that a node receives: those of one of its filters, or all if it has none. */
enum can_filter_kind { CAN_STANDARD_ONLY, CAN_EXTENDED_ONLY, CAN_BOTH };
struct can_filter {
    uint32_t first, last;
    uint32_t kind; /* enum can_filter_kind */
};

enum can_state { CAN_ACTIVE, CAN_WARNING, CAN_PASSIVE, CAN_BUS_OFF, CAN_NO_POWER };

struct can_node_status {
    uint32_t state;                       /* enum can_state */
    uint32_t transmit_errors, receive_errors; /* the counters of ISO 11898-1 */
    uint32_t transmit_pending, receive_pending; /* frames in the queues */
    uint32_t last_tag;                    /* tag of the frame that was sent last */
    uint64_t sent, received;              /* `received`: those that a filter has let pass */
    uint64_t refused;                     /* frames for which the transmit queue had no room */
    uint64_t overflowed;                  /* frames for which the receive queue had no room */
    uint64_t dropped;                     /* frames in queues when they were emptied */
    uint64_t lost_arbitrations;
    uint64_t not_acknowledged;            /* attempts that nobody has acknowledged */
    uint64_t failed;                      /* attempts that an error frame has ended */
    uint64_t bus_offs;
};

struct can_bus_status {
    uint64_t frames;        /* that have come to their end */
    uint64_t error_frames;
    int64_t busy_ns, now_ns; /* time in which a frame or an error frame was on the wire */
};

/* Frames that a node makes by itself. The n-th one (from 0) has the identifier `id + n % span` and,
 * little endian, the number n in its data, cut off after `length` bytes. */
struct can_source {
    uint32_t id, span; /* span: at least 1 */
    uint32_t flags;
    uint32_t length;
    int64_t first_ns, period_ns; /* a period of 0: as fast as the bus allows */
    uint64_t count;              /* 0 = for ever */
};

/* Counts the frames of a source at another node. `source` describes them; its times do not matter. */
struct can_check_status {
    uint64_t received, lost, doubled, wrong; /* wrong: another length, or data that fit no number */
};

enum can_stuck { CAN_NOT_STUCK, CAN_RECESSIVE, CAN_DOMINANT };

struct can_bus;

CAN_API struct can_bus *can_create(int64_t now_ns);
CAN_API void can_destroy(struct can_bus *bus);

/* Adds a node without power. Returns its number. */
CAN_API int can_add_node(struct can_bus *bus, const struct can_node_config *config);
/* Power off empties its queues and forgets its counters; sources stay. Power on begins with them. */
CAN_API int can_power(struct can_bus *bus, int node, int on, int64_t now_ns);
/* Gives a node another bit rate and other flags. */
CAN_API int can_configure(struct can_bus *bus, int node, uint32_t bit_rate, uint32_t flags,
                          int64_t now_ns);
/* Gives a node queues of other lengths, which are empty. */
CAN_API int can_set_queues(struct can_bus *bus, int node, unsigned transmit, unsigned receive,
                           int64_t now_ns);
CAN_API int can_set_filters(struct can_bus *bus, int node, const struct can_filter *filters,
                            unsigned count);

/* Lets everything happen up to `now_ns`. Returns the nodes with received frames, a bit for each. */
CAN_API int64_t can_advance(struct can_bus *bus, int64_t now_ns);
/* Puts frames into the transmit queue. Returns how many had room. */
CAN_API int can_send(struct can_bus *bus, int node, const struct can_frame *frames, unsigned count,
                     int64_t now_ns);
/* Takes received frames. Returns their number. */
CAN_API int can_receive(struct can_bus *bus, int node, struct can_frame *frames, unsigned capacity,
                        int64_t now_ns);
/* Waits in real time until the node has received something, whoever lets the time pass. Returns 1,
 * or 0 after the timeout. */
CAN_API int can_wait(struct can_bus *bus, int node, int64_t timeout_ns);
/* Empties the transmit queue. A frame on the wire still comes to its end. */
CAN_API int can_cancel(struct can_bus *bus, int node, int64_t now_ns);

CAN_API int can_node_status(struct can_bus *bus, int node, struct can_node_status *status,
                            int64_t now_ns);
CAN_API int can_bus_status(struct can_bus *bus, struct can_bus_status *status, int64_t now_ns);

/* Faults. */
CAN_API int can_restart(struct can_bus *bus, int node, int64_t now_ns); /* ends bus-off, as asked for */
CAN_API int can_force_bus_off(struct can_bus *bus, int node, int64_t now_ns);
/* Damages each attempt with a probability, as on a line without termination. */
CAN_API int can_set_noise(struct can_bus *bus, double probability, uint64_t seed, int64_t now_ns);
CAN_API int can_set_stuck(struct can_bus *bus, int stuck, int64_t now_ns);

/* Adds a source or a check. Returns its number at the node. */
CAN_API int can_add_source(struct can_bus *bus, int node, const struct can_source *source,
                           int64_t now_ns);
CAN_API int can_clear_sources(struct can_bus *bus, int node, int64_t now_ns);
/* Returns how many frames a source has sent. */
CAN_API int64_t can_source_sent(struct can_bus *bus, int node, int source);
CAN_API int can_add_check(struct can_bus *bus, int node, const struct can_source *source);
CAN_API int can_check_status(struct can_bus *bus, int node, int check,
                             struct can_check_status *status);
/* Has a node send each data frame that it receives back, with its identifier changed by `exclusive
 * or`. 0 ends it. */
CAN_API int can_set_echo(struct can_bus *bus, int node, uint32_t change);

/* Writes the bits of a frame on the wire, from start of frame to the end of the intermission, stuff
 * bits included (0 dominant). Returns their number. */
CAN_API int can_frame_bits(const struct can_frame *frame, uint8_t *bits, size_t capacity);

#endif
