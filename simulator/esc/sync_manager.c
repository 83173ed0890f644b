/* Sync managers (registers 0x0800 upward): mailbox and buffered mode.
 *
 * The frame thread and the device side hold the segment's lock while they copy, so a buffered
 * channel needs one buffer only: neither side can see the other's half-written data.
 */
#include "slave.h"

enum {
    OFFSET_CONTROL = 4,
    OFFSET_STATUS = 5,
    OFFSET_ACTIVATE = 6,
    OFFSET_PDI = 7,
    CONTROL_MODE = 0x03,
    CONTROL_MODE_MAILBOX = 0x02,
    CONTROL_DIRECTION = 0x0C,
    CONTROL_DIRECTION_WRITE = 0x04,
    CONTROL_WATCHDOG = 0x40,
    STATUS_WRITTEN = 0x01,
    STATUS_READ = 0x02,
    STATUS_FULL = 0x08,
    STATUS_LAST_BUFFER = 0x30, /* buffered mode: 3 = nothing written yet */
    ACTIVATE_ENABLE = 0x01,
    PDI_DEACTIVATE = 0x01
};

static uint8_t *registers_of(struct slave *slave, unsigned channel)
{
    return slave->memory + REG_SM + 8 * channel;
}

/* Called after the registers of the channel changed. */
void sm_decode(struct slave *slave, unsigned channel)
{
    struct sync_manager *sm = &slave->sm[channel];
    uint8_t *reg = registers_of(slave, channel);
    bool was_on = sm->size > 0;
    bool on = (reg[OFFSET_ACTIVATE] & ACTIVATE_ENABLE) != 0;
    sm->start = load16(reg);
    sm->size = on ? load16(reg + 2) : 0;
    sm->mailbox = (reg[OFFSET_CONTROL] & CONTROL_MODE) == CONTROL_MODE_MAILBOX;
    sm->write = (reg[OFFSET_CONTROL] & CONTROL_DIRECTION) == CONTROL_DIRECTION_WRITE;
    sm->watchdog = (reg[OFFSET_CONTROL] & CONTROL_WATCHDOG) != 0;
    sm->locked = (reg[OFFSET_PDI] & PDI_DEACTIVATE) != 0;
    if (!on || !was_on || sm->locked) {
        sm->full = false;
        sm->open = false;
        reg[OFFSET_STATUS] = sm->mailbox ? 0 : STATUS_LAST_BUFFER;
    }
    slave->watchdog = false;
    for (unsigned i = 0; i < slave->sync_managers; i++)
        slave->watchdog |= slave->sm[i].size > 0 && slave->sm[i].write && slave->sm[i].watchdog;
    slave->segment->fmmus_changed = true;
}

void sm_write_status(struct slave *slave, unsigned channel)
{
    const struct sync_manager *sm = &slave->sm[channel];
    uint8_t *status = registers_of(slave, channel) + OFFSET_STATUS;
    *status = (uint8_t)(sm->full ? STATUS_FULL | STATUS_WRITTEN : STATUS_READ);
}

static bool overlaps(const struct sync_manager *sm, uint32_t from, uint32_t to)
{
    return sm->size > 0 && from < (uint32_t)sm->start + sm->size && to > sm->start;
}

/* Whether the master may access [from, to): the direction must be that of every channel that
 * holds a part of it, and a mailbox must be empty to be written and full to be read. */
bool sm_may_access(const struct slave *slave, uint32_t from, uint32_t to, bool write)
{
    if (to <= REG_DIGITAL_OUTPUT)
        return true;
    for (unsigned i = 0; i < slave->sync_managers; i++) {
        const struct sync_manager *sm = &slave->sm[i];
        if (!overlaps(sm, from, to))
            continue;
        if (sm->locked || sm->write != write)
            return false;
        if (sm->mailbox && (sm->full == write || !(sm->open || from <= sm->start)))
            return false;
    }
    return true;
}

void sm_outputs_complete(struct slave *slave, const struct sync_manager *sm)
{
    if (sm->watchdog)
        slave->fed = true;
    if (slave->awaits_outputs) {
        slave->awaits_outputs = false;
        pdi_event(slave, ESC_OUTPUTS);
    }
}

/* Called after the master accessed [from, to). The last byte hands a buffer over. */
void sm_accessed(struct slave *slave, uint32_t from, uint32_t to, bool write)
{
    if (to <= REG_DIGITAL_OUTPUT)
        return;
    for (unsigned i = 0; i < slave->sync_managers; i++) {
        struct sync_manager *sm = &slave->sm[i];
        if (!overlaps(sm, from, to))
            continue;
        bool complete = to >= (uint32_t)sm->start + sm->size;
        if (sm->mailbox) {
            sm->open = !complete;
            if (complete) {
                sm->full = write;
                sm_write_status(slave, i);
                pdi_event(slave, write ? ESC_MAILBOX_IN : ESC_MAILBOX_OUT);
            }
        } else if (complete && write) {
            registers_of(slave, i)[OFFSET_STATUS] = STATUS_WRITTEN;
            sm_outputs_complete(slave, sm);
        }
    }
}
