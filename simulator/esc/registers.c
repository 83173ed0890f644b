/* Registers (addresses below 0x1000): writable areas, effects of writing, power-on and reset. */
#include "slave.h"

/* Areas the master may write. Everything else below 0x1000 is read-only. */
static const struct {
    uint16_t from, to;
} writable[] = {
    {REG_STATION_ADDRESS, REG_STATION_ADDRESS + 2},
    {REG_WRITE_ENABLE, REG_WRITE_ENABLE + 2},
    {REG_ESC_WRITE_ENABLE, REG_ESC_WRITE_ENABLE + 2},
    {REG_RESET, REG_RESET + 1},
    {REG_DL_CONTROL, REG_DL_CONTROL + 4},
    {REG_RW_OFFSET, REG_RW_OFFSET + 2},
    {REG_AL_CONTROL, REG_AL_CONTROL + 2},
    {REG_RUN_LED, REG_RUN_LED + 1},
    {REG_ECAT_EVENT_MASK, REG_ECAT_EVENT_MASK + 2},
    {REG_RX_ERRORS, REG_PDI_ERRORS + 1},
    {REG_LOST_LINKS, REG_LOST_LINKS + PORTS},
    {REG_WATCHDOG_DIVIDER, REG_WATCHDOG_DIVIDER + 2},
    {REG_WATCHDOG_PDI, REG_WATCHDOG_PDI + 2},
    {REG_WATCHDOG_DATA, REG_WATCHDOG_DATA + 2},
    {REG_WATCHDOG_COUNTERS, REG_WATCHDOG_COUNTERS + 2},
    {REG_EEPROM_CONFIG, REG_EEPROM_CONFIG + 1},
    {REG_EEPROM_CONTROL, REG_EEPROM_END},
    {REG_FMMU, REG_FMMU + 16 * ESC_MAX_CHANNELS},
    {REG_SM, REG_SM + 8 * ESC_MAX_CHANNELS},
    {REG_DC, REG_DC + 4},           /* receive times */
    {REG_CLOCK, REG_CLOCK + 8},
    {REG_DC + 0x20, REG_DC + 0x2C}, /* its offset and delay */
    {REG_DC + 0x30, REG_DC + 0x32}, /* time control loop */
    {REG_DC + 0x34, REG_DC + 0x36},
    {REG_DC + 0x80, REG_SYNC},      /* SYNC and latch units */
    {REG_SYNC, REG_SYNC + 1},
    {REG_DC + 0x90, REG_DC + 0x98},
    {REG_DC + 0xA0, REG_LATCH},
    {REG_LATCH, REG_LATCH + 2},
    {REG_DIGITAL_OUTPUT, REG_DIGITAL_OUTPUT_END},
    {0x0F10, 0x0F18}, /* general purpose outputs */
    {0x0F80, REG_RAM} /* user RAM */
};

enum {
    SM_ACTIVATE = 6,
    SM_STATUS = 5,
    SM_REPEAT = 0x02,
    ECAT_EVENT_SM_MASK = 0x0FF0,
    AL_EVENT_MASK_DEFAULT = 0x00FFFF0F,
    PDI_SYNC_UNIT = 0x04, /* of register 0x0141 */
    PDI_LATCH_UNIT = 0x08,
    DL_ALIAS_ENABLE = 0x01,          /* of register 0x0103 */
    DL_CONTROL_DEFAULT = 0x01,       /* forward EtherCAT frames only */
    DEVICE_EMULATION = 0x01,         /* of register 0x0141 */
    PROTECTED = 0x01,                /* of registers 0x0021 and 0x0031 */
    PROTECTED_REGISTERS = 0x0F80,    /* their end; user RAM and process data RAM follow */
    LED_TAKEN = 0x10                 /* of register 0x0138 */
};

void registers_show_state(struct slave *slave, bool changed)
{
    /* Off in INIT, blinking in PREOP, flickering in BOOT, one flash in SAFEOP, on in OP. */
    static const uint8_t leds[AL_STATE_MASK + 1] = {[2] = 0x0D, [3] = 0x0E, [4] = 0x01, [AL_OP] = 0x0F};
    uint8_t *led = slave->memory + REG_RUN_LED;
    if (changed || (*led & LED_TAKEN) == 0)
        *led = leds[slave->memory[REG_AL_STATUS] & AL_STATE_MASK];
}

static void update_station(struct slave *slave)
{
    const uint8_t *memory = slave->memory;
    struct esc_segment *segment = slave->segment;
    bool alias = (memory[REG_DL_CONTROL + 3] & DL_ALIAS_ENABLE) != 0;
    segment->station[slave->position] = load16(memory + REG_STATION_ADDRESS);
    segment->alias[slave->position] = alias ? load16(memory + REG_STATION_ALIAS) : 0x10000U;
}

static void power_on_settings(uint8_t *memory, const struct esc_config *config)
{
    memory[REG_TYPE] = config->type;
    memory[REG_REVISION] = config->revision;
    store16(memory + REG_BUILD, config->build);
    memory[REG_FMMUS] = config->fmmus;
    memory[REG_SYNC_MANAGERS] = config->sync_managers;
    memory[REG_RAM_SIZE] = config->ram_kib;
    memory[REG_PORTS] = config->ports;
    store16(memory + REG_FEATURES, config->features);
    store16(memory + REG_WATCHDOG_DIVIDER, config->watchdog_divider);
    store16(memory + REG_WATCHDOG_PDI, config->watchdog_pdi);
    store16(memory + REG_WATCHDOG_DATA, config->watchdog_data);
}

/* Puts everything in the controller into its state at power-on, except the links of the ports. */
void registers_power_on(struct slave *slave)
{
    uint8_t *memory = slave->memory;
    memset(memory, 0, slave->ram_end);
    power_on_settings(memory, &slave->config);
    memory[REG_DL_CONTROL] = DL_CONTROL_DEFAULT;
    memory[REG_DL_STATUS] = DL_PDI_WATCHDOG;
    memory[REG_AL_CONTROL] = 1;
    memory[REG_AL_STATUS] = 1;
    store32(memory + REG_AL_EVENT_MASK, AL_EVENT_MASK_DEFAULT);
    memory[REG_WATCHDOG_STATUS] = 1;
    slave->sm_interrupts = slave->protected = false;
    slave->has_outputs = slave->awaits_outputs = false;
    slave->fed = slave->expired = slave->pdi_expired = false;
    slave->deadline_ns = slave->pdi_ns = 0;
    slave->write_enabled = slave->esc_write_enabled = slave->al_controlled = 0;
    slave->loops_until_ns = 0;
    memset(slave->reset_step, 0, sizeof slave->reset_step);
    memset(slave->sm, 0, sizeof slave->sm);
    for (unsigned i = 0; i < slave->sync_managers; i++)
        sm_decode(slave, i);
    slave->eeprom.busy_until_ns = 0;
    slave->eeprom.enabled = 0;
    slave->eeprom.taken = false;
    dc_power_on(slave);
    eeprom_load(slave, true);
    update_station(slave);
    slave->ecat_events = slave->al_events = 0;
    slave->area_count = 0;
    slave->segment->event_word_stale = true;
}

/* A reset by the master or the device. */
void registers_reset(struct slave *slave)
{
    registers_power_on(slave);
    slave->segment->topology_stale = true;
    pdi_event(slave, ESC_RESET);
    slave->events = ESC_RESET; /* earlier events no longer concern the device */
}

/* A reset takes the letters R, E and S in three writes; any other letter starts the sequence
 * again. Register 0x0040 belongs to the master, 0x0041 to the device. */
static void advance_reset(struct slave *slave, unsigned side)
{
    static const char sequence[] = "RES";
    uint8_t *reg = slave->memory + REG_RESET + side;
    uint8_t *step = &slave->reset_step[side];
    *step = *reg == sequence[*step] ? (uint8_t)(*step + 1) : 0;
    *reg = *step;
    if (*step == sizeof sequence - 1)
        registers_reset(slave);
}

/* Whether write protection allows the master to write [from, to). */
bool registers_may_write(const struct slave *slave, uint32_t from, uint32_t to)
{
    const uint8_t *memory = slave->memory;
    uint64_t frame = frame_number(slave->segment);
    if (to - from == 1 && (from == REG_WRITE_ENABLE || from == REG_ESC_WRITE_ENABLE))
        return true;
    if ((memory[REG_ESC_WRITE_ENABLE + 1] & PROTECTED) != 0 && slave->esc_write_enabled != frame)
        return false;
    return (memory[REG_WRITE_ENABLE + 1] & PROTECTED) == 0 || slave->write_enabled == frame ||
           from >= PROTECTED_REGISTERS;
}

/* Called after a write to 0x0020 to 0x0031. Enabling lasts until the end of the frame. */
static void update_protection(struct slave *slave, uint32_t from, uint32_t to)
{
    uint8_t *memory = slave->memory;
    uint64_t frame = frame_number(slave->segment);
    if (touches(from, to, REG_WRITE_ENABLE, 1))
        slave->write_enabled = frame;
    if (touches(from, to, REG_ESC_WRITE_ENABLE, 1))
        slave->esc_write_enabled = frame;
    memory[REG_WRITE_ENABLE] = memory[REG_ESC_WRITE_ENABLE] = 0;
    memory[REG_WRITE_ENABLE + 1] &= PROTECTED;
    memory[REG_ESC_WRITE_ENABLE + 1] &= PROTECTED;
    slave->protected =
        ((memory[REG_WRITE_ENABLE + 1] | memory[REG_ESC_WRITE_ENABLE + 1]) & PROTECTED) != 0;
    slave->segment->fmmus_changed = true;
}

/* Writes registers of sync managers. A new area or mode is accepted only while the sync manager is
 * off; the status is read-only. */
static void write_sync_managers(struct slave *slave, uint32_t from, const uint8_t *data,
                                size_t size)
{
    unsigned first = (from - REG_SM) / 8;
    unsigned last = (unsigned)((from + size - 1 - REG_SM) / 8);
    for (unsigned channel = first; channel <= last && channel < slave->sync_managers; channel++) {
        uint32_t base = REG_SM + 8 * channel;
        uint8_t *reg = slave->memory + base;
        uint8_t activate = reg[SM_ACTIVATE];
        bool on = slave->sm[channel].size > 0;
        for (uint32_t k = 0; k <= SM_ACTIVATE; k++)
            if (base + k >= from && base + k < from + size && k != SM_STATUS && (k == SM_ACTIVATE || !on))
                reg[k] = data[base + k - from];
        sm_decode(slave, channel);
        if (activate != reg[SM_ACTIVATE])
            slave->al_events |= AL_EVENT_SM_ACTIVATION;
        if (channel == 1 && (activate ^ reg[SM_ACTIVATE]) & SM_REPEAT)
            pdi_event(slave, ESC_MAILBOX_AGAIN);
    }
}

/* Whether the master may write AL control. It is like a mailbox: a second write is not taken before
 * the device has read the first one, which it cannot do within a frame. Between frames, the device
 * counts as fast enough. With device emulation, nobody reads it, and every write is taken. */
static bool takes_al_control(struct slave *slave)
{
    uint64_t frame = frame_number(slave->segment);
    if ((slave->memory[REG_PDI_CONTROL + 1] & DEVICE_EMULATION) != 0)
        return true;
    if (slave->al_controlled == frame)
        return false;
    slave->al_controlled = frame;
    return true;
}

static void take_effect(struct slave *slave, uint32_t from, uint32_t to)
{
    uint8_t *memory = slave->memory;
    if (touches(from, to, REG_STATION_ADDRESS, 2) || touches(from, to, REG_DL_CONTROL, 4))
        update_station(slave);
    if (touches(from, to, REG_WRITE_ENABLE, REG_RESET - REG_WRITE_ENABLE))
        update_protection(slave, from, to);
    if (touches(from, to, REG_DL_CONTROL + 1, 1)) {
        slave->reopen = true;
        slave->segment->topology_stale = true;
    }
    if (touches(from, to, REG_AL_CONTROL, 1)) {
        slave->al_events |= AL_EVENT_CONTROL;
        pdi_event(slave, ESC_AL_CONTROL);
    }
    if (touches(from, to, REG_RUN_LED, 1))
        registers_show_state(slave, false);
    if (touches(from, to, REG_ECAT_EVENT_MASK, 2)) {
        slave->sm_interrupts = (load16(memory + REG_ECAT_EVENT_MASK) & ECAT_EVENT_SM_MASK) != 0;
        slave->segment->event_word_stale = true;
    }
    if (touches(from, to, REG_WATCHDOG_COUNTERS, 2))
        memset(memory + REG_WATCHDOG_COUNTERS, 0, 2);
    if (touches(from, to, REG_FMMU, 16 * ESC_MAX_CHANNELS))
        slave->segment->fmmus_changed = true;
    if (touches(from, to, REG_EEPROM_CONFIG, 1))
        eeprom_assigned(slave);
    if (touches(from, to, REG_EEPROM_CONTROL, 2))
        eeprom_command(slave, false);
    if (touches(from, to, REG_RESET, 1))
        advance_reset(slave, 0);
}

static void write_area(struct slave *slave, uint32_t from, uint32_t to, const uint8_t *data)
{
    if (from >= REG_SM && to <= REG_SM + 8 * ESC_MAX_CHANNELS) {
        write_sync_managers(slave, from, data, to - from);
        return;
    }
    if (ports_clear_counters(slave, from, to))
        return;
    if (from >= REG_DC && to <= REG_DC_END) {
        dc_write(slave, from, to, data);
        return;
    }
    if (touches(from, to, REG_EEPROM_CONTROL, REG_EEPROM_END - REG_EEPROM_CONTROL) &&
        !eeprom_accepts(slave, false))
        return;
    uint8_t loops = slave->memory[REG_DL_CONTROL + 1];
    memcpy(slave->memory + from, data, to - from);
    if (touches(from, to, REG_DL_CONTROL, 2))
        topology_set_loops(slave, loops);
    take_effect(slave, from, to);
}

/* Writes registers as the device does. False if it may not write the EEPROM interface now. */
bool registers_device_write(struct slave *slave, uint32_t from, uint32_t to, const uint8_t *data)
{
    bool command = touches(from, to, REG_EEPROM_CONTROL, REG_EEPROM_END - REG_EEPROM_CONTROL);
    if (command && !eeprom_accepts(slave, true))
        return false;
    if (from >= REG_DC && to <= REG_DC_END) {
        sync_write(slave, from, to, data, true);
        return true;
    }
    memcpy(slave->memory + from, data, to - from);
    if (touches(from, to, REG_EEPROM_CONFIG + 1, 1))
        eeprom_assigned(slave);
    if (touches(from, to, REG_EEPROM_CONTROL, 2))
        eeprom_command(slave, true);
    if (touches(from, to, REG_RESET + 1, 1))
        advance_reset(slave, 1);
    return true;
}

static bool within(uint32_t from, uint32_t to, uint32_t start, uint32_t end)
{
    return from < to && from >= start && to <= end;
}

/* Whether all of [from, to) are registers of distributed clocks that the chip lacks. A chip without
 * distributed clocks has the receive times only. The SII may switch off units of a chip with
 * `dc_by_sii`: with both units off, it has the receive times only; with one unit on, it lacks just
 * the registers of the other one. Other chips have all registers, whatever the SII says. */
static bool lacks_clock(const struct slave *slave, uint32_t from, uint32_t to)
{
    const struct esc_config *config = &slave->config;
    unsigned units = slave->memory[REG_PDI_CONTROL + 1] & (PDI_SYNC_UNIT | PDI_LATCH_UNIT);
    if (config->dc_bits > 0 && !config->dc_by_sii)
        return false;
    if (config->dc_bits == 0 || units == 0)
        return within(from, to, REG_CLOCK, REG_DC_END);
    return ((units & PDI_SYNC_UNIT) == 0 && within(from, to, REG_SYNC, REG_LATCH)) ||
           ((units & PDI_LATCH_UNIT) == 0 && within(from, to, REG_LATCH, REG_DC_END));
}

/* Returns the end of a writable area on a chip that may lack channels or distributed clocks. */
static uint32_t end_of_area(const struct slave *slave, uint32_t from, uint32_t to)
{
    if (from == REG_FMMU)
        return REG_FMMU + 16 * slave->fmmus;
    if (from == REG_SM)
        return REG_SM + 8 * slave->sync_managers;
    return lacks_clock(slave, from, to) ? from : to;
}

/* Whether the chip has [from, to): false if all of it belongs to FMMUs, to sync managers or to a
 * distributed clock that the chip lacks. */
bool registers_exist(const struct slave *slave, uint32_t from, uint32_t to)
{
    return !lacks_clock(slave, from, to) &&
           !within(from, to, REG_FMMU + 16 * slave->fmmus, REG_FMMU + 16 * ESC_MAX_CHANNELS) &&
           !within(from, to, REG_SM + 8 * slave->sync_managers, REG_SM + 8 * ESC_MAX_CHANNELS);
}

/* Writes the writable parts of [address, address + size). Returns whether there are any. */
bool registers_write(struct slave *slave, uint32_t address, const uint8_t *data, size_t size)
{
    uint32_t end = address + (uint32_t)size;
    bool any = end > REG_RAM || size == 0;
    if (address == REG_CLOCK && size > 0 && end <= REG_CLOCK + 8 &&
        !lacks_clock(slave, address, end)) { /* a fast path: all slaves, in every cycle */
        dc_write(slave, address, end, data);
        return true;
    }
    for (size_t i = 0; i < sizeof writable / sizeof writable[0]; i++) {
        uint32_t from = writable[i].from > address ? writable[i].from : address;
        uint32_t last = end_of_area(slave, writable[i].from, writable[i].to);
        uint32_t to = last < end ? last : end;
        if (from >= to || (writable[i].from == REG_AL_CONTROL && !takes_al_control(slave)))
            continue;
        any = true;
        write_area(slave, from, to, data + (from - address));
    }
    if (end > REG_RAM)
        memcpy(slave->memory + REG_RAM, data + (REG_RAM - address), end - REG_RAM);
    return any;
}
