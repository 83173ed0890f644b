/* Physical access of the master to registers and memory of one slave. */
#include "slave.h"

/* The end of the memory. Without a valid SII there is no access to process data RAM. */
static uint32_t end_of(const struct slave *slave)
{
    bool loaded = (slave->memory[REG_DL_STATUS] & DL_PDI_OPERATIONAL) != 0;
    return loaded ? slave->ram_end : REG_RAM;
}

/* A read counts if one byte of it is there (ESC data sheet, section I, working counter). */
const uint8_t *access_read(struct slave *slave, uint16_t address, size_t size)
{
    uint32_t from = address, to = from + (uint32_t)size;
    if (from < slave->ram_end && to > slave->ram_end && from >= REG_RAM)
        to = slave->ram_end;
    if (to > end_of(slave) || !sm_may_access(slave, from, to, false))
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
    if (to > end_of(slave) || !sm_may_access(slave, from, to, true) ||
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
