/* Watchdogs (registers 0x0400 to 0x0443): the master feeds the one for process data, the device
 * feeds the one for the PDI. */
#include "slave.h"

enum {
    WATCHDOG_OK = 0x01,
    COUNTER_DATA = REG_WATCHDOG_COUNTERS,
    COUNTER_PDI = REG_WATCHDOG_COUNTERS + 1,
    DIGITAL_OUTPUTS = 4
};

/* Returns the time of a watchdog in ns, (divider + 2) * 40 ns * count; a count of 0 switches it
 * off. */
static int64_t time_of(const struct slave *slave, uint32_t reg)
{
    int64_t unit_ns = ((int64_t)load16(slave->memory + REG_WATCHDOG_DIVIDER) + 2) * 40;
    return unit_ns * load16(slave->memory + reg);
}

static void count(struct slave *slave, uint32_t counter)
{
    if (slave->memory[counter] < 0xFF)
        slave->memory[counter]++;
}

static void expire(struct slave *slave)
{
    slave->expired = true;
    slave->memory[REG_WATCHDOG_STATUS] &= (uint8_t)~WATCHDOG_OK;
    memset(slave->memory + REG_DIGITAL_OUTPUT, 0, DIGITAL_OUTPUTS);
    count(slave, COUNTER_DATA);
    slave->al_events |= AL_EVENT_WATCHDOG;
    if ((slave->memory[REG_AL_STATUS] & AL_STATE_MASK) == AL_OP)
        pdi_event(slave, ESC_WATCHDOG);
}

/* Runs the process data watchdog up to `now_ns`. It starts with the first data. */
void watchdog_run(struct slave *slave, int64_t now_ns)
{
    int64_t time_ns = slave->watchdog ? time_of(slave, REG_WATCHDOG_DATA) : 0;
    if (slave->fed || time_ns == 0) {
        slave->deadline_ns = slave->fed && time_ns > 0 ? now_ns + time_ns : 0;
        slave->fed = false;
        slave->expired = false;
        slave->memory[REG_WATCHDOG_STATUS] |= WATCHDOG_OK;
    } else if (slave->deadline_ns != 0 && now_ns > slave->deadline_ns && !slave->expired) {
        expire(slave);
    }
}

/* Whether there is a PDI. A coupler may have none (PDI control 0): then nothing feeds the watchdog,
 * and its status stays 0. */
bool watchdog_has_pdi(const struct slave *slave)
{
    return slave->memory[REG_PDI_CONTROL] != 0;
}

/* Lets the PDI watchdog expire if the device has done nothing for too long: DL status bit 1 and a
 * counter show it. */
void watchdog_check_pdi(struct slave *slave, int64_t now_ns)
{
    int64_t time_ns = time_of(slave, REG_WATCHDOG_PDI);
    if (slave->pdi_expired || slave->pdi_ns == 0 || time_ns == 0 || now_ns - slave->pdi_ns <= time_ns)
        return;
    slave->pdi_expired = true;
    count(slave, COUNTER_PDI);
    registers_set_dl_status(slave, DL_PDI_WATCHDOG, false);
}

/* Called when the device exchanges its process data. */
void watchdog_feed_pdi(struct slave *slave, int64_t now_ns)
{
    if (!watchdog_has_pdi(slave))
        return;
    watchdog_check_pdi(slave, now_ns);
    slave->pdi_ns = now_ns;
    if (slave->pdi_expired) {
        slave->pdi_expired = false;
        registers_set_dl_status(slave, DL_PDI_WATCHDOG, true);
    }
}
