/* The state of sync managers, and the functions of sync_manager.c. */
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
    bool open;            /* the master has accessed the first byte, but not the last */
    bool device_open;     /* buffered mode: so has the device */
    bool pending;         /* buffered mode: the newest data are in `buffers.newest` */
    bool fresh;           /* buffered mode: the reader has not taken the newest buffer */
    bool written, read;   /* status bits 0 and 1 */
    uint8_t writer, next, reader; /* buffered mode: numbers of the three buffers */
    uint8_t last;                 /* last buffer written; 3 = none */
};

/* Called when the writer of a buffered channel has finished a buffer, which becomes the newest. */
static inline void sm_hand_over(struct sync_manager *sm)
{
    uint8_t finished = sm->writer;
    sm->last = finished;
    sm->writer = sm->next;
    sm->next = finished;
    sm->fresh = sm->written = true;
    sm->read = false;
}

/* Called when the reader of a buffered channel begins: it exchanges its buffer for the newest one
 * if that is new to it. */
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
