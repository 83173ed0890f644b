/* Registers (addresses below 0x1000): what the master may write, and what then happens. */
#include "slave.h"

/* Areas the master may write. Everything else below 0x1000 is read-only. */
static const struct {
    uint16_t from, to;
} writable[] = {
    {REG_STATION_ADDRESS, REG_STATION_ADDRESS + 2},
    {0x0020, 0x0022}, /* write protection, ESC reset: accepted, without effect */
    {0x0030, 0x0032},
    {0x0040, 0x0042},
    {REG_DL_CONTROL, REG_DL_CONTROL + 4},
    {0x0108, 0x010A},
    {REG_AL_CONTROL, REG_AL_CONTROL + 2},
    {REG_ECAT_EVENT_MASK, REG_ECAT_EVENT_MASK + 2},
    {REG_ERROR_COUNTERS, REG_ERROR_COUNTERS + 0x14},
    {REG_WATCHDOG_DIVIDER, REG_WATCHDOG_DIVIDER + 2},
    {REG_WATCHDOG_PDI, REG_WATCHDOG_PDI + 2},
    {REG_WATCHDOG_DATA, REG_WATCHDOG_DATA + 2},
    {REG_WATCHDOG_COUNTERS, REG_WATCHDOG_COUNTERS + 2},
    {REG_EEPROM_CONFIG, REG_EEPROM_CONFIG + 1},
    {REG_EEPROM_CONTROL, REG_EEPROM_END},
    {REG_FMMU, REG_FMMU + 16 * ESC_MAX_CHANNELS},
    {REG_SM, REG_SM + 8 * ESC_MAX_CHANNELS},
    {REG_DIGITAL_OUTPUT, 0x0F04},
    {0x0F10, 0x0F18}, /* general purpose outputs */
    {0x0F80, REG_RAM} /* user RAM */
};

enum {
    SM_ACTIVATE = 6,
    SM_REPEAT = 0x02,
    FEATURES_NONE = 0x0000, /* FMMUs map bits, LRW works; no distributed clocks */
    WATCHDOG_DIVIDER_DEFAULT = 2498, /* (2498 + 2) * 40 ns = 100 us */
    WATCHDOG_DEFAULT = 1000,         /* 100 ms */
    DL_ALIAS_ENABLE = 0x01,          /* of register 0x0103 */
    DL_CONTROL_DEFAULT = 0x01,       /* forward EtherCAT frames only */
    DL_PDI_RUNS = 0x0001,
    DL_PDI_WATCHDOG_OK = 0x0002,
    DL_LINK = 0x0010,          /* port 0; the next bits are the other ports */
    DL_LOOP_CLOSED = 0x0100,   /* port 0; two bits a port */
    DL_COMMUNICATION = 0x0200, /* likewise */
    EEPROM_OWNED_BY_PDI = 0x01
};

static bool touches(uint32_t from, uint32_t to, uint32_t reg, uint32_t size)
{
    return from < reg + size && to > reg;
}

void registers_set_event(struct slave *slave, unsigned bits, bool on)
{
    uint8_t *event = slave->memory + REG_ECAT_EVENT;
    unsigned now = load16(event), next = on ? now | bits : now & ~bits;
    if (next != now) {
        store16(event, next);
        slave->segment->event_word_stale = true;
    }
}

/* What the slaves on the route of the frame add to the IRQ field of a datagram. */
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
            const uint8_t *memory = segment->slaves[route->order[i]]->memory;
            word |= (unsigned)load16(memory + REG_ECAT_EVENT) &
                    load16(memory + REG_ECAT_EVENT_MASK);
        }
        route->event_word = (uint16_t)word;
        route->event_word_known = true;
    }
    return route->event_word;
}

static void update_station(struct slave *slave)
{
    const uint8_t *memory = slave->memory;
    struct esc_segment *segment = slave->segment;
    bool alias = (memory[REG_DL_CONTROL + 3] & DL_ALIAS_ENABLE) != 0;
    segment->station[slave->position] = load16(memory + REG_STATION_ADDRESS);
    segment->alias[slave->position] = alias ? load16(memory + REG_STATION_ALIAS) : 0x10000U;
}

/* DL status and lost-link counters after a change of links and loops. */
void registers_set_links(struct slave *slave, uint8_t links, uint8_t open)
{
    uint8_t *memory = slave->memory;
    unsigned status = DL_PDI_RUNS | DL_PDI_WATCHDOG_OK;
    for (unsigned port = 0; port < PORTS; port++) {
        unsigned bit = 1U << port;
        bool up = (links & bit) != 0, is_open = (open & bit) != 0;
        uint8_t *lost = memory + REG_LOST_LINKS + port;
        if (up)
            status |= DL_LINK << port;
        if (!is_open)
            status |= DL_LOOP_CLOSED << 2 * port;
        else if (up)
            status |= DL_COMMUNICATION << 2 * port;
        if (!up && (slave->links & slave->open & bit) != 0 && *lost < 0xFF)
            ++*lost;
    }
    slave->links = links;
    slave->open = open;
    if (status != load16(memory + REG_DL_STATUS)) {
        store16(memory + REG_DL_STATUS, status);
        registers_set_event(slave, ECAT_EVENT_DL, true);
    }
}

void registers_power_on(struct slave *slave, const struct esc_config *config)
{
    uint8_t *memory = slave->memory;
    memory[REG_TYPE] = config->type;
    memory[REG_REVISION] = config->revision;
    store16(memory + REG_BUILD, config->build);
    memory[REG_FMMUS] = config->fmmus;
    memory[REG_SYNC_MANAGERS] = config->sync_managers;
    memory[REG_RAM_SIZE] = config->ram_kib;
    memory[REG_PORTS] = config->ports;
    store16(memory + REG_FEATURES, FEATURES_NONE);
    memory[REG_DL_CONTROL] = DL_CONTROL_DEFAULT;
    memory[REG_AL_CONTROL] = 1;
    memory[REG_AL_STATUS] = 1;
    store16(memory + REG_WATCHDOG_DIVIDER, WATCHDOG_DIVIDER_DEFAULT);
    store16(memory + REG_WATCHDOG_PDI, WATCHDOG_DEFAULT);
    store16(memory + REG_WATCHDOG_DATA, WATCHDOG_DEFAULT);
    memory[REG_WATCHDOG_STATUS] = 1;
    eeprom_load(slave, true);
    update_station(slave);
}

/* A sync manager takes a new area or mode only while it is off; its status is the ESC's own. */
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
            if (base + k >= from && base + k < from + size && k != 5 && (k == SM_ACTIVATE || !on))
                reg[k] = data[base + k - from];
        sm_decode(slave, channel);
        if (channel == 1 && (activate ^ reg[SM_ACTIVATE]) & SM_REPEAT)
            pdi_event(slave, ESC_MAILBOX_AGAIN);
    }
}

static void take_effect(struct slave *slave, uint32_t from, uint32_t to)
{
    uint8_t *memory = slave->memory;
    if (touches(from, to, REG_STATION_ADDRESS, 2) || touches(from, to, REG_DL_CONTROL, 4))
        update_station(slave);
    if (touches(from, to, REG_DL_CONTROL + 1, 1)) {
        slave->reopen = true;
        slave->segment->topology_stale = true;
    }
    if (touches(from, to, REG_AL_CONTROL, 1))
        pdi_event(slave, ESC_AL_CONTROL);
    if (touches(from, to, REG_ECAT_EVENT_MASK, 2))
        slave->segment->event_word_stale = true;
    if (touches(from, to, REG_ERROR_COUNTERS, 0x14))
        memset(memory + REG_ERROR_COUNTERS, 0, 0x14);
    if (touches(from, to, REG_WATCHDOG_COUNTERS, 2))
        memset(memory + REG_WATCHDOG_COUNTERS, 0, 2);
    if (touches(from, to, REG_FMMU, 16 * ESC_MAX_CHANNELS))
        slave->segment->fmmus_changed = true;
    if (touches(from, to, REG_EEPROM_CONTROL, 2))
        eeprom_command(slave);
}

static void write_area(struct slave *slave, uint32_t from, uint32_t to, const uint8_t *data)
{
    if (from >= REG_SM && to <= REG_SM + 8 * ESC_MAX_CHANNELS) {
        write_sync_managers(slave, from, data, to - from);
        return;
    }
    bool eeprom = touches(from, to, REG_EEPROM_CONTROL, REG_EEPROM_END - REG_EEPROM_CONTROL);
    if (eeprom && (slave->memory[REG_EEPROM_CONFIG] & EEPROM_OWNED_BY_PDI) != 0)
        return;
    memcpy(slave->memory + from, data, to - from);
    take_effect(slave, from, to);
}

/* Writes the writable parts of [address, address + size). Returns whether there are any. */
bool registers_write(struct slave *slave, uint32_t address, const uint8_t *data, size_t size)
{
    uint32_t end = address + (uint32_t)size;
    bool any = end > REG_RAM || size == 0;
    for (size_t i = 0; i < sizeof writable / sizeof writable[0]; i++) {
        uint32_t from = writable[i].from > address ? writable[i].from : address;
        uint32_t to = writable[i].to < end ? writable[i].to : end;
        if (from >= to)
            continue;
        any = true;
        write_area(slave, from, to, data + (from - address));
    }
    if (end > REG_RAM)
        memcpy(slave->memory + REG_RAM, data + (REG_RAM - address), end - REG_RAM);
    return any;
}
