/* Distributed clocks (registers 0x0900 to 0x093F): local time, receive times and system time.
 *
 * Nothing drives the clocks: their time is computed from CLOCK_MONOTONIC when it is needed. A
 * frame has one time, at which it entered the segment. The topology adds the delay to each port.
 * The times that a master measures are therefore exact, even if the host is late.
 */
#include "slave.h"

#include <math.h>

enum {
    REG_RECEIVED = 0x0918, /* receive time of the processing unit */
    REG_OFFSET = 0x0920,
    REG_DELAY = 0x0928,
    REG_DIFFERENCE = 0x092C,
    REG_SPEED_START = 0x0930,
    REG_SPEED_DIFFERENCE = 0x0932,
    REG_DIFFERENCE_DEPTH = 0x0934,
    REG_SPEED_DEPTH = 0x0935,
    REG_LOOP_END = 0x0936,
    SPEED_MIN = 0x80,
    SPEED_MAX = 0x3FFF,
    SPEED_DEFAULT = 0x1000,
    DIFFERENCE_DEPTH_DEFAULT = 4,
    SPEED_DEPTH_DEFAULT = 12,
    DEPTH_MASK = 0x0F,
    DIFFERENCE_MASK = 0x7FFFFFFF,
    MEAN_INTERVALS = 16
};

static const uint32_t DIFFERENCE_NOT_BEHIND = 0x80000000;
/* An ESC counts its clock in steps of 10 ns. It corrects a step by 1 ns, and at most every 0x7F-th
 * step. */
static const double TICK_NS = 10.0;
static const double MAX_CORRECTION = 1.0 / (10.0 * 0x7F);
/* Part of a difference that is corrected at once, with the default bandwidth. */
static const double GAIN = 1.0 / 8, MAX_GAIN = 0.5;

static double clamp(double value, double limit)
{
    return value > limit ? limit : value < -limit ? -limit : value;
}

/* Advances a clock to a time at its present rate. The rate may change afterwards. */
static void advance(struct local_clock *clock, int64_t now_ns)
{
    double passed = (double)(now_ns - clock->at_ns);
    double slewed = clamp(clock->slew_ns, fabs(passed) * MAX_CORRECTION);
    double gained = clock->fraction + passed * (clock->drift + clock->trim) + slewed;
    double whole = floor(gained);
    clock->local_ns = time_after(clock->local_ns, now_ns - clock->at_ns + (int64_t)whole);
    clock->fraction = gained - whole;
    clock->slew_ns -= slewed;
    clock->at_ns = now_ns;
}

int64_t dc_local_time(const struct slave *slave, int64_t now_ns)
{
    struct local_clock clock = slave->dc.clock;
    advance(&clock, now_ns);
    return clock.local_ns;
}

/* Returns the local copy of the system time, which the SYNC unit, the latch units and the device
 * use. A clock of 32 bits shows its lower half. */
int64_t dc_system_time(const struct slave *slave, int64_t now_ns)
{
    uint64_t offset = load64(slave->memory + REG_OFFSET);
    return (int64_t)((uint64_t)dc_local_time(slave, now_ns) + offset);
}

/* Stores a time in a register, which is as wide as the clock. */
void dc_store_time(struct slave *slave, uint32_t reg, int64_t time)
{
    uint64_t bits = (uint64_t)time;
    store64(slave->memory + reg, slave->config.dc_bits == 32 ? bits & UINT32_MAX : bits);
}

/* Returns when the current frame arrives at the processing unit (CLOCK_MONOTONIC). */
static int64_t arrival_time(const struct slave *slave)
{
    int64_t arrival = topology_arrival(slave, 0);
    for (unsigned port = 1; arrival < 0 && port < PORTS; port++)
        arrival = topology_arrival(slave, port);
    return frame_time_ns(slave->segment) + (arrival < 0 ? 0 : arrival);
}

/* Returns the system time, by the clock of this slave, at which the frame passed the reference
 * clock. */
static int64_t time_at_reference(const struct slave *slave)
{
    int64_t delay = load32(slave->memory + REG_DELAY);
    return time_between(delay, dc_system_time(slave, arrival_time(slave)));
}

/* Handles a write of the master to 0x0900. Ports at which the frame does not arrive keep their
 * times. Commands other than BWR and FPWR latch the time of the processing unit alone. */
static void latch_receive_times(struct slave *slave)
{
    uint8_t *memory = slave->memory;
    dc_store_time(slave, REG_RECEIVED, dc_local_time(slave, arrival_time(slave)));
    for (unsigned port = 0; port < PORTS && slave->segment->latches_ports; port++) {
        int64_t arrival = topology_arrival(slave, port);
        if (arrival >= 0) {
            int64_t local = dc_local_time(slave, frame_time_ns(slave->segment) + arrival);
            store32(memory + REG_DC + 4 * port, (uint32_t)((uint64_t)local & UINT32_MAX));
        }
    }
}

/* Adds a value to the mean over the last 2^depth values, or over fewer at first. */
static void average(double *mean, unsigned *count, unsigned depth, double value)
{
    unsigned most = 1U << (depth & DEPTH_MASK);
    *count = *count < most ? *count + 1 : most;
    *mean += (value - *mean) / *count;
}

/* Returns the rate as an ESC expresses it, by a number x: its clock gains 1 ns every (start - x)
 * steps and loses 1 ns every (start + x) steps. x is positive if the clock must run faster. */
static double speed_difference(const struct slave *slave)
{
    double start = load16(slave->memory + REG_SPEED_START), rate = slave->dc.clock.trim * TICK_NS;
    double limit = start - 0x7F;
    return rate == 0 ? 0 : clamp((sqrt(1 + rate * rate * start * start) - 1) / rate, limit);
}

/* Corrects a clock that was `difference_ns` ahead at `now_ns`. Its time is corrected by a part of
 * the difference, spread over the following time. Its rate is corrected by a part of the rate that
 * would have avoided the difference. Together they remove a constant drift without overshoot. */
static void correct(struct slave *slave, int64_t now_ns, double difference_ns)
{
    struct local_clock *clock = &slave->dc.clock;
    struct time_loop *loop = &slave->dc.loop;
    double gain = GAIN * (double)SPEED_DEFAULT / load16(slave->memory + REG_SPEED_START);
    gain = gain > MAX_GAIN ? MAX_GAIN : gain;
    double passed = loop->corrected_ns == 0 ? 0 : (double)(now_ns - loop->corrected_ns);
    advance(clock, now_ns);
    clock->slew_ns = -gain * difference_ns;
    if (passed > 0) {
        loop->interval_ns += loop->interval_ns == 0
                                 ? passed
                                 : (passed - loop->interval_ns) / (double)MEAN_INTERVALS;
        double interval = passed > loop->interval_ns ? passed : loop->interval_ns;
        /* A difference that takes longer than the interval to correct says nothing about the rate. */
        if (fabs(clock->slew_ns) <= interval * MAX_CORRECTION)
            clock->trim = clamp(clock->trim - gain * gain / 4 * difference_ns / interval,
                                MAX_CORRECTION);
    }
    loop->corrected_ns = now_ns;
    average(&loop->deviation, &loop->deviations, slave->memory[REG_SPEED_DEPTH],
            speed_difference(slave));
}

/* Handles a write of the system time of the reference clock: compares the lower 32 bits with the
 * own time, and corrects the clock. */
static void compare(struct slave *slave, uint32_t received)
{
    struct time_loop *loop = &slave->dc.loop;
    uint32_t own = (uint32_t)((uint64_t)time_at_reference(slave) & UINT32_MAX);
    double difference = (int32_t)(own - received);
    average(&loop->difference_ns, &loop->differences, slave->memory[REG_DIFFERENCE_DEPTH],
            difference);
    correct(slave, arrival_time(slave), difference);
}

static void reset_loop(struct slave *slave)
{
    uint8_t *start = slave->memory + REG_SPEED_START;
    unsigned value = load16(start) & 0x7FFF;
    store16(start, value < SPEED_MIN ? SPEED_MIN : value > SPEED_MAX ? SPEED_MAX : value);
    advance(&slave->dc.clock, frame_time_ns(slave->segment));
    slave->dc.clock.trim = slave->dc.clock.slew_ns = 0;
    slave->dc.loop = (struct time_loop){0};
}

/* Returns register 0x092C: the magnitude and, in bit 31, whether the own time was not less than that
 * of the reference clock. Newer data sheets and captures of real slaves have the bit like this;
 * ETG.1000.4 has it inverted. */
static uint32_t difference_register(const struct time_loop *loop)
{
    double mean = round(loop->difference_ns);
    bool behind = mean < 0 || loop->differences == 0;
    return (uint32_t)clamp(fabs(mean), DIFFERENCE_MASK) | (behind ? 0 : DIFFERENCE_NOT_BEHIND);
}

void dc_power_on(struct slave *slave)
{
    uint8_t *memory = slave->memory;
    struct local_clock *clock = &slave->dc.clock;
    sync_stop(slave);
    *clock = (struct local_clock){.at_ns = frame_time_ns(slave->segment),
                                  .local_ns = clock->offset_ns,
                                  .drift = clock->drift,
                                  .offset_ns = clock->offset_ns};
    slave->dc.loop = (struct time_loop){0};
    if (slave->config.dc_bits == 0)
        return;
    store16(memory + REG_SPEED_START, SPEED_DEFAULT);
    memory[REG_DIFFERENCE_DEPTH] = DIFFERENCE_DEPTH_DEFAULT;
    memory[REG_SPEED_DEPTH] = SPEED_DEPTH_DEFAULT;
}

/* Updates the registers in [from, to): for the device with the present time, for the master with
 * the time of the frame. */
void dc_refresh(struct slave *slave, uint32_t from, uint32_t to, bool by_device)
{
    uint8_t *memory = slave->memory;
    const struct time_loop *loop = &slave->dc.loop;
    if (slave->config.dc_bits == 0)
        return;
    if (touches(from, to, REG_CLOCK, 8))
        dc_store_time(slave, REG_CLOCK,
                      by_device ? dc_system_time(slave, frame_time_ns(slave->segment))
                                : time_at_reference(slave));
    if (touches(from, to, REG_DIFFERENCE, 4))
        store32(memory + REG_DIFFERENCE, difference_register(loop));
    if (touches(from, to, REG_SPEED_DIFFERENCE, 2))
        store16(memory + REG_SPEED_DIFFERENCE, (unsigned)(int)round(loop->deviation) & 0xFFFF);
    int64_t now_ns = by_device ? frame_time_ns(slave->segment) : arrival_time(slave);
    sync_refresh(slave, from, to, dc_system_time(slave, now_ns));
}

/* Handles a write of the master to [from, to), which lies within one area of writable registers. */
void dc_write(struct slave *slave, uint32_t from, uint32_t to, const uint8_t *data)
{
    if (touches(from, to, REG_DC, 1))
        latch_receive_times(slave);
    if (to <= REG_DC + 4)
        return;
    if (touches(from, to, REG_CLOCK, 8)) {
        if (from == REG_CLOCK && to >= from + 4)
            compare(slave, load32(data));
        return;
    }
    if (from >= REG_LOOP_END) {
        sync_write(slave, from, to, data, false);
        return;
    }
    memcpy(slave->memory + from, data, to - from);
    if (slave->config.dc_bits == 32)
        memset(slave->memory + REG_OFFSET + 4, 0, 4);
    if (touches(from, to, REG_SPEED_START, 2))
        reset_loop(slave);
    if (touches(from, to, REG_DIFFERENCE_DEPTH, 1))
        slave->dc.loop.difference_ns = slave->dc.loop.differences = 0;
    if (touches(from, to, REG_SPEED_DEPTH, 1))
        slave->dc.loop.deviation = slave->dc.loop.deviations = 0;
}

void dc_set_clock(struct slave *slave, const double *drift, const int64_t *offset_ns)
{
    struct local_clock *clock = &slave->dc.clock;
    advance(clock, frame_time_ns(slave->segment));
    if (drift != NULL)
        clock->drift = *drift;
    if (offset_ns != NULL) {
        int64_t change = time_between(clock->offset_ns, *offset_ns);
        clock->local_ns = time_after(clock->local_ns, change);
        clock->offset_ns = *offset_ns;
    }
}

void dc_get_clock(struct slave *slave, int64_t now_ns, struct esc_clock *clock)
{
    const struct local_clock *local = &slave->dc.clock;
    *clock = (struct esc_clock){.local_ns = dc_local_time(slave, now_ns),
                                .system_ns = dc_system_time(slave, now_ns),
                                .offset_ns = (int64_t)load64(slave->memory + REG_OFFSET),
                                .delay_ns = load32(slave->memory + REG_DELAY),
                                .difference_ns = (int64_t)round(slave->dc.loop.difference_ns),
                                .drift_ppm = 1e6 * local->drift,
                                .trim_ppm = 1e6 * local->trim};
}
