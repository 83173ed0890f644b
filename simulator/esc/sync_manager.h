/* Sync managers: state, and what sync_manager.c and buffers.c do with it. */
#ifndef ECAT_ESC_SYNC_MANAGER_H
#define ECAT_ESC_SYNC_MANAGER_H

#include <stdbool.h>
#include <stdint.h>

struct slave;

/* A sync manager, decoded from its registers. See sync_manager.c for the buffers. */
struct sync_manager {
    uint16_t start, size; /* `size` is 0 while the channel is off */
    bool mailbox;         /* else buffered */
    bool write;           /* the master writes; else it reads */
    bool watchdog;        /* a complete write feeds the process data watchdog */
    bool locked;          /* deactivated by the device */
    bool ecat_event;      /* shows in the ECAT event request */
    bool al_event;        /* shows in the AL event request */
    bool full;            /* mailbox mode: written and not read yet */
    bool open;            /* the master's access began at the first byte, the last is to come */
    bool device_open;     /* buffered mode: the device's access likewise */
    bool pending;         /* buffered mode: the newest data are not in `memory`, but aside */
    bool fresh;           /* buffered mode: the reader has not taken the newest buffer */
    bool written, read;   /* status bits 0 and 1 */
    uint8_t writer, next, reader; /* buffered mode: numbers of the three buffers */
    uint8_t last;                 /* last buffer written; 3 = none */
};

/* The writer of a buffered channel has finished its buffer, which becomes the newest one. */
static inline void sm_hand_over(struct sync_manager *sm)
{
    uint8_t finished = sm->writer;
    sm->last = finished;
    sm->writer = sm->next;
    sm->next = finished;
    sm->fresh = sm->written = true;
    sm->read = false;
}

/* The reader of a buffered channel begins: it gives its buffer back for the newest one. */
static inline void sm_take_newest(struct sync_manager *sm)
{
    if (sm->fresh) {
        uint8_t taken = sm->next;
        sm->next = sm->reader;
        sm->reader = taken;
        sm->fresh = false;
    }
    sm->written = false;
}

/* sync_manager.c */
void sm_decode(struct slave *slave, unsigned channel);
uint8_t sm_status(const struct sync_manager *sm);
bool sm_may_access(const struct slave *slave, uint32_t from, uint32_t to, bool write);
void sm_begin(struct slave *slave, uint32_t from, uint32_t to);
void sm_accessed(struct slave *slave, uint32_t from, uint32_t to, bool write);
void sm_begin_read(struct slave *slave, struct sync_manager *sm);
void sm_read(struct slave *slave, struct sync_manager *sm);
void sm_written(struct slave *slave, struct sync_manager *sm);

#endif
