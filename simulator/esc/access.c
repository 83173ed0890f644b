/* Physical access of the master to registers and memory of one slave. */
#include "slave.h"

const uint8_t *access_read(struct slave *slave, uint16_t address, size_t size)
{
    uint32_t from = address, to = from + (uint32_t)size;
    if (to > slave->ram_end || !sm_may_access(slave, from, to, false))
        return NULL;
    sm_accessed(slave, from, to, false);
    if (from < REG_AL_STATUS + 2 && to > REG_AL_STATUS)
        registers_set_event(slave, ECAT_EVENT_AL, false);
    if (from < REG_DL_STATUS + 2 && to > REG_DL_STATUS)
        registers_set_event(slave, ECAT_EVENT_DL, false);
    return slave->memory + from;
}

bool access_write(struct slave *slave, uint16_t address, const uint8_t *data, size_t size)
{
    uint32_t from = address, to = from + (uint32_t)size;
    if (to > slave->ram_end || !sm_may_access(slave, from, to, true))
        return false;
    if (from >= REG_RAM)
        memcpy(slave->memory + from, data, size);
    else if (!registers_write(slave, from, data, size))
        return false;
    sm_accessed(slave, from, to, true);
    return true;
}
