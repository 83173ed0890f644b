/* Physical access of the master to registers and memory of one slave. */
#include "slave.h"

/* Without a valid SII there is no access to process data RAM. */
static bool is_there(const struct slave *slave, uint32_t to)
{
    bool loaded = (slave->memory[REG_DL_STATUS] & DL_PDI_OPERATIONAL) != 0;
    return to <= (loaded ? slave->ram_end : REG_RAM);
}

const uint8_t *access_read(struct slave *slave, uint16_t address, size_t size)
{
    uint32_t from = address, to = from + (uint32_t)size;
    if (!is_there(slave, to) || !sm_may_access(slave, from, to, false))
        return NULL;
    if (from < REG_RAM) {
        if (!registers_exist(slave, from, to))
            return NULL;
        live_refresh(slave, from, to, false);
    }
    sm_begin(slave, from, to);
    sm_accessed(slave, from, to, false);
    if (from < REG_RAM)
        live_was_read(slave, from, to, false);
    return slave->memory + from;
}

bool access_write(struct slave *slave, uint16_t address, const uint8_t *data, size_t size)
{
    uint32_t from = address, to = from + (uint32_t)size;
    if (!is_there(slave, to) || !sm_may_access(slave, from, to, true) ||
        (slave->protected && !registers_may_write(slave, from, to)))
        return false;
    sm_begin(slave, from, to);
    if (from >= REG_RAM)
        memcpy(slave->memory + from, data, size);
    else if (!registers_write(slave, from, data, size))
        return false;
    sm_accessed(slave, from, to, true);
    return true;
}
