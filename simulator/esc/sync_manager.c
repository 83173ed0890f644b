/* Sync managers (registers 0x0800 upward) in mailbox and buffered mode, as the master sees them.
 *
 * A buffered channel behaves as if it had three buffers: the reader keeps a buffer until it has
 * read the last byte, and never sees a buffer whose writer has not written the last byte. Copying
 * would make frames slow. The master's buffer is therefore always the memory at the channel's
 * address, and data are put aside (`buffers.newest`) only while one side has a buffer open. Most
 * accesses are in one piece, for which the lock of the segment is enough. The status shows the
 * numbers of buffers, which are kept as if there were three.
 */
#include "slave.h"

enum {
    OFFSET_CONTROL = 4,
    OFFSET_ACTIVATE = 6,
    OFFSET_PDI = 7,
    CONTROL_MODE = 0x03,
    CONTROL_MODE_MAILBOX = 0x02,
    CONTROL_DIRECTION = 0x0C,
    CONTROL_DIRECTION_WRITE = 0x04,
    CONTROL_ECAT_EVENT = 0x10,
    CONTROL_AL_EVENT = 0x20,
    CONTROL_WATCHDOG = 0x40,
    STATUS_WRITTEN = 0x01,
    STATUS_READ = 0x02,
    STATUS_FULL = 0x08,
    STATUS_LAST_BUFFER_SHIFT = 4,
    NO_BUFFER = 3,
    ACTIVATE_ENABLE = 0x01,
    PDI_DEACTIVATE = 0x01
};

static void reset(struct sync_manager *sm)
{
    sm->full = sm->open = sm->device_open = false;
    sm->pending = sm->fresh = sm->written = sm->read = false;
    sm->writer = 0;
    sm->next = 1;
    sm->reader = 2;
    sm->last = NO_BUFFER;
}

/* Called after the registers of the channel have changed. */
void sm_decode(struct slave *slave, unsigned channel)
{
    struct sync_manager *sm = &slave->sm[channel];
    const uint8_t *reg = slave->memory + REG_SM + 8 * channel;
    bool was_on = sm->size > 0;
    bool on = (reg[OFFSET_ACTIVATE] & ACTIVATE_ENABLE) != 0;
    sm->start = load16(reg);
    sm->size = on ? load16(reg + 2) : 0;
    if ((uint32_t)sm->start + sm->size > slave->ram_end)
        sm->size = 0; /* there is no memory for it: the channel stays off */
    sm->mailbox = (reg[OFFSET_CONTROL] & CONTROL_MODE) == CONTROL_MODE_MAILBOX;
    sm->write = (reg[OFFSET_CONTROL] & CONTROL_DIRECTION) == CONTROL_DIRECTION_WRITE;
    sm->ecat_event = (reg[OFFSET_CONTROL] & CONTROL_ECAT_EVENT) != 0;
    sm->al_event = (reg[OFFSET_CONTROL] & CONTROL_AL_EVENT) != 0;
    sm->watchdog = (reg[OFFSET_CONTROL] & CONTROL_WATCHDOG) != 0;
    sm->locked = (reg[OFFSET_PDI] & PDI_DEACTIVATE) != 0;
    if (!on || !was_on || sm->locked)
        reset(sm);
    slave->watchdog = false;
    for (unsigned i = 0; i < slave->sync_managers; i++)
        slave->watchdog |= slave->sm[i].size > 0 && slave->sm[i].write && slave->sm[i].watchdog;
    slave->segment->fmmus_changed = true;
    slave->segment->event_word_stale = true;
}

/* Returns the value of the status register, 0x0805 + 8 * channel. */
uint8_t sm_status(const struct sync_manager *sm)
{
    unsigned status = (sm->written ? STATUS_WRITTEN : 0U) | (sm->read ? STATUS_READ : 0U);
    if (sm->mailbox)
        status |= sm->full ? STATUS_FULL : 0U;
    else
        status |= (unsigned)sm->last << STATUS_LAST_BUFFER_SHIFT;
    return (uint8_t)status;
}

static bool overlaps(const struct sync_manager *sm, uint32_t from, uint32_t to)
{
    return sm->size > 0 && from < (uint32_t)sm->start + sm->size && to > sm->start;
}

/* Whether the master may access [from, to). The direction must be that of every channel with a part
 * of it. The access must begin at the first byte, or continue one that did. A mailbox must be empty
 * to be written, and full to be read. */
bool sm_may_access(const struct slave *slave, uint32_t from, uint32_t to, bool write)
{
    if (to <= REG_DIGITAL_OUTPUT)
        return true;
    for (unsigned i = 0; i < slave->sync_managers; i++) {
        const struct sync_manager *sm = &slave->sm[i];
        if (!overlaps(sm, from, to))
            continue;
        if (sm->locked || sm->write != write || (sm->mailbox && sm->full == write))
            return false;
        if (!sm->open && from > sm->start)
            return false;
    }
    return true;
}

/* Called when the master begins to read a buffer; it gets the newest one. */
void sm_begin_read(struct slave *slave, struct sync_manager *sm)
{
    if (sm->pending) {
        memcpy(slave->memory + sm->start, slave->buffers->newest + sm->start, sm->size);
        sm->pending = false;
    }
    sm_take_newest(sm);
    sm_changed(slave);
}

/* Called when the master has read the last byte of a buffer. */
void sm_read(struct slave *slave, struct sync_manager *sm)
{
    sm->open = false;
    sm->read = true;
    sm_changed(slave);
}

/* Notes that output data have come. */
static void has_come(struct slave *slave, const struct sync_manager *sm)
{
    if (sm->watchdog)
        slave->fed = true;
    slave->has_outputs = true;
    if (slave->program != NULL)
        slave->program_due = slave->segment->programs_due = true;
    if (slave->awaits_outputs) {
        slave->awaits_outputs = false;
        pdi_event(slave, ESC_OUTPUTS);
    }
}

/* Called when the master has written the last byte of a buffer. */
void sm_written(struct slave *slave, struct sync_manager *sm)
{
    sm->open = false;
    sm->pending = false;
    sm_hand_over(sm);
    has_come(slave, sm);
    sm_changed(slave);
}

/* Called before the master accesses [from, to), if `sm_may_access` allows it. */
void sm_begin(struct slave *slave, uint32_t from, uint32_t to)
{
    if (to <= REG_DIGITAL_OUTPUT)
        return;
    for (unsigned i = 0; i < slave->sync_managers; i++) {
        struct sync_manager *sm = &slave->sm[i];
        if (sm->open || !overlaps(sm, from, to))
            continue;
        sm_changed(slave);
        if (sm->mailbox) {
            *(sm->write ? &sm->read : &sm->written) = false;
        } else if (!sm->write) {
            sm_begin_read(slave, sm);
        } else {
            sm->read = false;
            if (to < (uint32_t)sm->start + sm->size) { /* the device must not see half a buffer */
                memcpy(slave->buffers->newest + sm->start, slave->memory + sm->start, sm->size);
                sm->pending = true;
            }
        }
    }
}

static bool is_process_data(const struct slave *slave, const struct sync_manager *sm)
{
    for (unsigned i = 0; i < slave->area_count; i++)
        if (slave->areas[i].address == sm->start)
            return true;
    return false;
}

static void mailbox_accessed(struct slave *slave, struct sync_manager *sm, bool write)
{
    sm->open = false;
    sm->full = write;
    if (write && is_process_data(slave, sm))
        has_come(slave, sm);
    *(write ? &sm->written : &sm->read) = true;
    pdi_event(slave, write ? ESC_MAILBOX_IN : ESC_MAILBOX_OUT);
    sm_changed(slave);
}

/* Called after the master has accessed [from, to). The last byte hands a buffer over. */
void sm_accessed(struct slave *slave, uint32_t from, uint32_t to, bool write)
{
    if (to <= REG_DIGITAL_OUTPUT)
        return;
    for (unsigned i = 0; i < slave->sync_managers; i++) {
        struct sync_manager *sm = &slave->sm[i];
        if (!overlaps(sm, from, to))
            continue;
        if (to < (uint32_t)sm->start + sm->size)
            sm->open = true;
        else if (sm->mailbox)
            mailbox_accessed(slave, sm, write);
        else if (write)
            sm_written(slave, sm);
        else
            sm_read(slave, sm);
    }
}
