/* Registers that are computed when they are read, and acknowledgement by reading.
 *
 * Events and states are kept where they arise, so that process data need no register updates. A
 * read acknowledges only after it is complete: one datagram may read an event and its cause.
 */
#include "slave.h"

enum {
    SM_STATUS = 5,
    SM_ACTIVATE = 6,
    ECAT_EVENT_CHANNELS = 8,
    WATCHDOG_COUNTER_PDI = REG_WATCHDOG_COUNTERS + 1
};

/* Returns the ECAT event request. The bit of a sync manager shows that the device has read or
 * written its buffer. */
static unsigned ecat_events(const struct slave *slave)
{
    unsigned events = slave->ecat_events;
    for (unsigned i = 0; i < slave->sync_managers && i < ECAT_EVENT_CHANNELS; i++) {
        const struct sync_manager *sm = &slave->sm[i];
        if (sm->ecat_event && (sm->write ? sm->read : sm->written))
            events |= (unsigned)ECAT_EVENT_SM0 << i;
    }
    return events;
}

/* Returns the AL event request. The bit of a sync manager shows that the master has read or written
 * its buffer. */
static unsigned al_events(const struct slave *slave)
{
    unsigned events = slave->al_events | sync_al_events(slave);
    for (unsigned i = 0; i < slave->sync_managers; i++) {
        const struct sync_manager *sm = &slave->sm[i];
        if (sm->al_event && (sm->write ? sm->written : sm->read))
            events |= (unsigned)AL_EVENT_SM0 << i;
    }
    return events;
}

void registers_set_event(struct slave *slave, unsigned bits, bool on)
{
    unsigned next = on ? slave->ecat_events | bits : slave->ecat_events & ~bits;
    if (next != slave->ecat_events) {
        slave->ecat_events = next;
        slave->segment->event_word_stale = true;
    }
}

/* Returns the bits that the slaves on the route of the frame add to the IRQ field of a datagram. */
uint16_t registers_event_word(struct esc_segment *segment)
{
    struct route *route = segment->route;
    if (segment->event_word_stale) {
        for (unsigned i = 0; i < INTERFACES; i++)
            segment->routes[i].event_word_known = false;
        segment->event_word_stale = false;
    }
    if (!route->event_word_known) {
        unsigned word = 0;
        for (unsigned i = 0; i < route->count; i++) {
            const struct slave *slave = segment->slaves[route->order[i]];
            unsigned mask = load16(slave->memory + REG_ECAT_EVENT_MASK);
            if (mask != 0)
                word |= ecat_events(slave) & mask;
        }
        route->event_word = (uint16_t)word;
        route->event_word_known = true;
    }
    return route->event_word;
}

/* Sets or clears DL status bits of the PDI; the bits of the ports follow from the topology. */
void registers_set_dl_status(struct slave *slave, unsigned bits, bool on)
{
    uint8_t *status = slave->memory + REG_DL_STATUS;
    uint8_t before = *status;
    *status = (uint8_t)(on ? before | bits : before & ~bits);
    if (*status == before)
        return;
    registers_set_event(slave, ECAT_EVENT_DL, true);
    slave->segment->fmmus_changed = true; /* without a PDI there is no process data RAM */
}

/* Updates the registers in [from, to). */
void live_refresh(struct slave *slave, uint32_t from, uint32_t to, bool by_device)
{
    uint8_t *memory = slave->memory;
    if (touches(from, to, REG_DL_STATUS, 1) || touches(from, to, WATCHDOG_COUNTER_PDI, 1))
        watchdog_check_pdi(slave, frame_time_ns(slave->segment));
    if (touches(from, to, REG_ECAT_EVENT, 2))
        store16(memory + REG_ECAT_EVENT, ecat_events(slave));
    if (touches(from, to, REG_AL_EVENT, 4))
        store32(memory + REG_AL_EVENT, al_events(slave));
    if (touches(from, to, REG_EEPROM_CONFIG, REG_EEPROM_END - REG_EEPROM_CONFIG))
        eeprom_refresh(slave);
    if (touches(from, to, REG_SM, 8 * ESC_MAX_CHANNELS))
        for (unsigned i = 0; i < slave->sync_managers; i++)
            memory[REG_SM + 8 * i + SM_STATUS] = sm_status(&slave->sm[i]);
    if (touches(from, to, REG_DC, REG_DC_END - REG_DC))
        dc_refresh(slave, from, to, by_device);
}

static bool reads_activation(uint32_t from, uint32_t to)
{
    for (uint32_t i = 0; i < ESC_MAX_CHANNELS; i++)
        if (touches(from, to, REG_SM + 8 * i + SM_ACTIVATE, 1))
            return true;
    return false;
}

/* Called after a read of [from, to). */
void live_was_read(struct slave *slave, uint32_t from, uint32_t to, bool by_device)
{
    if (touches(from, to, REG_DC, REG_DC_END - REG_DC))
        sync_was_read(slave, from, to, by_device);
    if (!by_device) {
        if (touches(from, to, REG_AL_STATUS, 2))
            registers_set_event(slave, ECAT_EVENT_AL, false);
        if (touches(from, to, REG_DL_STATUS, 2))
            registers_set_event(slave, ECAT_EVENT_DL, false);
        return;
    }
    if (touches(from, to, REG_AL_CONTROL, 2))
        slave->al_events &= ~(unsigned)AL_EVENT_CONTROL;
    if (touches(from, to, REG_WATCHDOG_STATUS, 1))
        slave->al_events &= ~(unsigned)AL_EVENT_WATCHDOG;
    if ((slave->al_events & AL_EVENT_SM_ACTIVATION) != 0 && reads_activation(from, to))
        slave->al_events &= ~(unsigned)AL_EVENT_SM_ACTIVATION;
}
