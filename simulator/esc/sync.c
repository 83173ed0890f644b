/* SYNC and latch units of distributed clocks (registers 0x0980 to 0x09CF).
 *
 * No thread makes pulses. Their number is computed from the system time when registers are read or
 * the device side calls. All times are local copies of the system time, without the delay.
 */
#include "slave.h"

enum {
    REG_CONTROL = 0x0980,
    REG_ACTIVATION = 0x0981,
    REG_ACTIVATION_STATUS = 0x0984,
    REG_SYNC_STATUS = 0x098E, /* two of them */
    REG_START = 0x0990,       /* reads as the time of the next SYNC0 pulse */
    REG_NEXT_SYNC1 = 0x0998,
    REG_CYCLE0 = 0x09A0,
    REG_CYCLE1 = 0x09A4,
    REG_LATCH_CONTROL = 0x09A8, /* two of them */
    REG_LATCH_STATUS = 0x09AE,  /* two of them */
    REG_LATCH_TIMES = 0x09B0,   /* positive and negative edge of latch 0, then of latch 1 */
    REG_LATCH_END = 0x09D0,
    CONTROL_BY_DEVICE = 0x01, /* the SYNC unit belongs to the device; latch units have their bits */
    CONTROL_LATCH0_BY_DEVICE = 0x10,
    CONTROL_LATCH1_BY_DEVICE = 0x20,
    CONTROL_BITS = 0x31,
    ACTIVATE = 0x01,
    ACTIVATE_SYNC0 = 0x02,
    ACTIVATE_AUTOMATIC = 0x08, /* by writing the start time */
    ACTIVATE_EXTEND = 0x10,    /* a start time of 32 bits is extended to 64 */
    ACTIVATE_CHECK = 0x20,     /* a start time that is not near starts at once */
    ACTIVATE_NEAR = 0x40,      /* near is 2^31 ns instead of half the width of the clock */
    ACTIVATE_BITS = 0x7F,      /* bit 7 makes a test pulse and reads 0 */
    STATUS_NOT_NEAR = 0x04,
    PULSE_UNIT_NS = 10,
    LATCH_SINGLE = 0x01, /* of an edge; latch control has a bit for each */
    LATCH_PIN = 0x04,
    PDI_SYNC0_EVENT = 0x08, /* of register 0x0151: SYNC0 is in the AL event request; bit 7: SYNC1 */
    SIGNALS = 2
};

static int64_t now(const struct slave *slave)
{
    return dc_system_time(slave, frame_time_ns(slave->segment));
}

/* Returns the number of pulses of a signal up to a time. */
static int64_t pulses(const struct slave *slave, const struct sync_signal *signal, int64_t time)
{
    const struct sync_unit *sync = &slave->dc.sync;
    int64_t passed = time_between(signal->first, time);
    if (!sync->running || sync->never || passed < 0)
        return 0;
    return signal->period == 0 ? 1 : passed / signal->period + 1;
}

static int64_t time_of_pulse(const struct sync_signal *signal, int64_t number)
{
    return (int64_t)((uint64_t)signal->first + (uint64_t)number * (uint64_t)signal->period);
}

/* Returns the time of the next pulse, or of the last one if there are no more. */
static int64_t next_pulse(const struct slave *slave, const struct sync_signal *signal, int64_t time)
{
    return time_of_pulse(signal, pulses(slave, signal, time));
}

/* Returns the level of a signal; with a pulse length of 0, it stays high until the device
 * acknowledges it. */
static bool level(const struct slave *slave, const struct sync_signal *signal, int64_t time)
{
    int64_t count = signal->on ? pulses(slave, signal, time) : 0;
    int64_t length = load16(slave->memory + REG_SYNC_PULSE) * (int64_t)PULSE_UNIT_NS;
    if (count == 0)
        return false;
    if (length == 0)
        return count > signal->acknowledged;
    return time_between(time_of_pulse(signal, count - 1), time) < length;
}

/* Returns the time until the start. If the start has passed, this is negative, or with a clock of
 * 32 bits far in the future. */
static int64_t time_to_start(const struct slave *slave, int64_t time)
{
    uint64_t distance = load64(slave->dc.sync.start) - (uint64_t)time;
    return slave->config.dc_bits == 32 ? (int64_t)(distance & UINT32_MAX) : (int64_t)distance;
}

static void start(struct slave *slave)
{
    struct sync_unit *sync = &slave->dc.sync;
    const uint8_t *memory = slave->memory;
    uint8_t activation = memory[REG_ACTIVATION];
    int64_t time = now(slave), wait = time_to_start(slave, time);
    bool narrow = slave->config.dc_bits == 32 || (activation & ACTIVATE_NEAR) != 0;
    int64_t cycle0 = load32(memory + REG_CYCLE0), cycle1 = load32(memory + REG_CYCLE1);
    sync->not_near = wait < 0 || (narrow && wait >= INT64_C(1) << 31);
    sync->never = wait < 0;
    if (sync->not_near && (activation & ACTIVATE_CHECK) != 0) {
        sync->never = false;
        wait = 0;
    }
    sync->signals[0] = (struct sync_signal){.first = time_after(time, wait), .period = cycle0};
    sync->signals[1] = sync->signals[0];
    if (cycle1 > 0) { /* else SYNC1 is SYNC0 */
        sync->signals[1].first = time_after(sync->signals[1].first, cycle1);
        sync->signals[1].period = cycle0 == 0 ? 0 : (cycle1 / cycle0 + 1) * cycle0;
    }
    if (!sync->running)
        slave->segment->syncs_running++;
    sync->running = true;
}

void sync_stop(struct slave *slave)
{
    struct sync_unit *sync = &slave->dc.sync;
    if (sync->running)
        slave->segment->syncs_running--;
    sync->running = sync->never = sync->not_near = false;
}

/* Called after a write to the activation register. */
static void activate(struct slave *slave)
{
    struct sync_unit *sync = &slave->dc.sync;
    uint8_t *activation = slave->memory + REG_ACTIVATION;
    *activation &= ACTIVATE_BITS;
    if ((*activation & ACTIVATE) == 0)
        sync_stop(slave);
    else if (!sync->running)
        start(slave);
    for (unsigned i = 0; i < SIGNALS; i++)
        sync->signals[i].on = (*activation & ACTIVATE_SYNC0 << i) != 0;
}

static void write_start(struct slave *slave, uint32_t from, uint32_t to, const uint8_t *data)
{
    uint8_t *start_time = slave->dc.sync.start;
    uint8_t activation = slave->memory[REG_ACTIVATION];
    memcpy(start_time + (from - REG_START), data, to - from);
    if (slave->config.dc_bits == 32) {
        memset(start_time + 4, 0, 4);
    } else if (to <= REG_START + 4 && (activation & ACTIVATE_EXTEND) != 0) {
        uint64_t time = (uint64_t)now(slave);
        uint32_t ahead = load32(start_time) - (uint32_t)(time & UINT32_MAX);
        store64(start_time, time + ahead);
    }
    if ((activation & ACTIVATE_AUTOMATIC) != 0) {
        slave->memory[REG_ACTIVATION] |= ACTIVATE;
        activate(slave);
    }
}

/* Whether the device may write a register, rather than the master. */
static bool is_of_device(const struct slave *slave, uint32_t reg)
{
    unsigned bit = CONTROL_BY_DEVICE;
    if (reg >= REG_LATCH_CONTROL)
        bit = reg == REG_LATCH_CONTROL ? CONTROL_LATCH0_BY_DEVICE : CONTROL_LATCH1_BY_DEVICE;
    return reg != REG_CONTROL && (slave->memory[REG_CONTROL] & bit) != 0;
}

/* Handles a write of the master or the device to [from, to), which lies within one area of writable
 * registers. */
void sync_write(struct slave *slave, uint32_t from, uint32_t to, const uint8_t *data,
                bool by_device)
{
    if (from >= REG_START && to <= REG_START + 8) {
        if (is_of_device(slave, from) == by_device)
            write_start(slave, from, to, data);
        return;
    }
    for (uint32_t reg = from; reg < to; reg++)
        if (is_of_device(slave, reg) == by_device)
            slave->memory[reg] = data[reg - from];
    slave->memory[REG_CONTROL] &= CONTROL_BITS;
    if (touches(from, to, REG_ACTIVATION, 1))
        activate(slave);
}

/* Updates the registers in [from, to) to a system time. */
void sync_refresh(struct slave *slave, uint32_t from, uint32_t to, int64_t time)
{
    uint8_t *memory = slave->memory;
    const struct sync_unit *sync = &slave->dc.sync;
    if (!touches(from, to, REG_ACTIVATION_STATUS, REG_LATCH_END - REG_ACTIVATION_STATUS))
        return;
    memory[REG_ACTIVATION_STATUS] = sync->not_near ? STATUS_NOT_NEAR : 0;
    for (unsigned i = 0; i < SIGNALS; i++) {
        const struct sync_signal *signal = &sync->signals[i];
        if (sync->running && signal->on && pulses(slave, signal, time) == 0)
            memory[REG_ACTIVATION_STATUS] |= (uint8_t)(1U << i);
        memory[REG_SYNC_STATUS + i] = level(slave, signal, time);
        memory[REG_LATCH_STATUS + i] =
            (uint8_t)((memory[REG_LATCH_STATUS + i] & LATCH_PIN) | sync->latched[i]);
    }
    memcpy(memory + REG_START, sync->start, sizeof sync->start);
    if (sync->running && !sync->never)
        dc_store_time(slave, REG_START, next_pulse(slave, &sync->signals[0], time));
    dc_store_time(slave, REG_NEXT_SYNC1,
                  sync->running ? next_pulse(slave, &sync->signals[1], time) : 0);
}

/* Called after a read of [from, to), which acknowledges SYNC status and latch times. */
void sync_was_read(struct slave *slave, uint32_t from, uint32_t to, bool by_device)
{
    struct sync_unit *sync = &slave->dc.sync;
    for (unsigned i = 0; i < SIGNALS; i++) {
        struct sync_signal *signal = &sync->signals[i];
        if (by_device && touches(from, to, REG_SYNC_STATUS + i, 1))
            signal->acknowledged = pulses(slave, signal, now(slave));
        if (is_of_device(slave, REG_LATCH_CONTROL + i) != by_device)
            continue;
        for (unsigned edge = 0; edge < 2; edge++)
            if (touches(from, to, REG_LATCH_TIMES + 16 * i + 8 * edge, 8))
                sync->latched[i] &= (uint8_t)~(1U << edge);
    }
    sync_latch_events(slave);
}

/* Shows the events of each latch unit to its owner, the master or the device. */
void sync_latch_events(struct slave *slave)
{
    const struct sync_unit *sync = &slave->dc.sync;
    bool event[2] = {false, false};
    for (unsigned i = 0; i < SIGNALS; i++)
        event[is_of_device(slave, REG_LATCH_CONTROL + i)] |= sync->latched[i] != 0;
    registers_set_event(slave, ECAT_EVENT_LATCH, event[0]);
    slave->al_events &= ~(unsigned)AL_EVENT_LATCH;
    slave->al_events |= event[1] ? (unsigned)AL_EVENT_LATCH : 0U;
}

/* Latches an edge at an input. In single mode, its time stays until it is read. */
void sync_latch(struct slave *slave, unsigned unit, bool rising)
{
    struct sync_unit *sync = &slave->dc.sync;
    uint8_t *memory = slave->memory;
    unsigned edge = rising ? 0 : 1, bit = (unsigned)LATCH_SINGLE << edge;
    memory[REG_LATCH_STATUS + unit] = rising ? LATCH_PIN : 0;
    if ((sync->latched[unit] & bit) != 0)
        return;
    dc_store_time(slave, REG_LATCH_TIMES + 16 * unit + 8 * edge, now(slave));
    sync->latched[unit] |= (uint8_t)(memory[REG_LATCH_CONTROL + unit] & bit);
    sync_latch_events(slave);
}

static bool reaches_device(const struct slave *slave, unsigned i)
{
    unsigned mapped = slave->memory[REG_PDI_CONFIGURATION + 1] & PDI_SYNC0_EVENT << 4 * i;
    return mapped != 0 && slave->dc.sync.signals[i].on;
}

/* Returns the bits of SYNC signals in the AL event request. */
unsigned sync_al_events(const struct slave *slave)
{
    unsigned events = 0;
    for (unsigned i = 0; i < SIGNALS && slave->dc.sync.running; i++)
        if (reaches_device(slave, i) && level(slave, &slave->dc.sync.signals[i], now(slave)))
            events |= (unsigned)AL_EVENT_SYNC0 << i;
    return events;
}

/* Reports the pulses that have passed to the device, if they interrupt it. Returns the time to the
 * next one in ns, or INT64_MAX. */
int64_t sync_run(struct slave *slave)
{
    int64_t next = INT64_MAX;
    if (!slave->dc.sync.running)
        return next;
    int64_t time = now(slave);
    uint32_t mask = load32(slave->memory + REG_AL_EVENT_MASK);
    for (unsigned i = 0; i < SIGNALS; i++) {
        struct sync_signal *signal = &slave->dc.sync.signals[i];
        if (!reaches_device(slave, i) || (mask & (unsigned)AL_EVENT_SYNC0 << i) == 0)
            continue;
        int64_t count = pulses(slave, signal, time);
        int64_t wait = time_between(time, next_pulse(slave, signal, time));
        if (count > signal->passed)
            pdi_event(slave, (uint32_t)ESC_SYNC0 << i);
        signal->passed = count;
        if (wait > 0 && wait < next)
            next = wait;
    }
    return next;
}
