/* EEPROM interface (registers 0x0500 to 0x050F), served from the SII image at once. */
#include "slave.h"

enum {
    CONTROL_WRITE_ENABLE = 0x0001,
    CONTROL_READS_8_BYTES = 0x0040,
    CONTROL_ADDRESS_2_BYTES = 0x0080,
    CONTROL_COMMAND = 0x0700,
    COMMAND_NOP = 0x0000,
    COMMAND_READ = 0x0100,
    COMMAND_WRITE = 0x0200,
    COMMAND_RELOAD = 0x0400,
    STATUS_CHECKSUM_ERROR = 0x0800,
    STATUS_NOT_LOADED = 0x1000,
    STATUS_COMMAND_ERROR = 0x2000,
    STATUS_WRITE_ENABLE_ERROR = 0x4000,
    CHECKED_BYTES = 14, /* words 0 to 6; the checksum is word 7 */
    SMALL_EEPROM = 2048
};

static uint8_t checksum(const uint8_t *data, size_t size)
{
    unsigned crc = 0xFF; /* x^8 + x^2 + x + 1 */
    for (size_t i = 0; i < size; i++) {
        crc ^= data[i];
        for (int bit = 0; bit < 8; bit++)
            crc = (crc << 1 ^ (crc & 0x80 ? 0x07 : 0)) & 0xFF;
    }
    return (uint8_t)crc;
}

static uint8_t byte_at(const struct slave *slave, size_t address)
{
    return address < slave->sii_size ? slave->sii[address] : 0xFF;
}

static void set_status(struct slave *slave, unsigned errors)
{
    unsigned fixed = CONTROL_READS_8_BYTES;
    if (slave->sii_size > SMALL_EEPROM)
        fixed |= CONTROL_ADDRESS_2_BYTES;
    store16(slave->memory + REG_EEPROM_CONTROL, fixed | errors);
}

/* Takes the configuration area: PDI control and configuration, and at power-on the alias. */
void eeprom_load(struct slave *slave, bool power_on)
{
    uint8_t *memory = slave->memory;
    if (slave->sii_size < CHECKED_BYTES + 2 ||
        checksum(slave->sii, CHECKED_BYTES) != slave->sii[CHECKED_BYTES]) {
        set_status(slave, STATUS_CHECKSUM_ERROR | STATUS_NOT_LOADED);
        return;
    }
    memcpy(memory + REG_PDI_CONTROL, slave->sii, 2);
    memcpy(memory + REG_PDI_CONFIGURATION, slave->sii + 2, 2);
    memcpy(memory + REG_PDI_CONFIGURATION + 2, slave->sii + 6, 2);
    if (power_on)
        memcpy(memory + REG_STATION_ALIAS, slave->sii + 8, 2);
    set_status(slave, 0);
}

static unsigned write_word(struct slave *slave, size_t address, unsigned control)
{
    if ((control & CONTROL_WRITE_ENABLE) == 0)
        return STATUS_WRITE_ENABLE_ERROR;
    if (address + 2 > slave->sii_size)
        return STATUS_COMMAND_ERROR;
    memcpy(slave->sii + address, slave->memory + REG_EEPROM_DATA, 2);
    pdi_event(slave, ESC_EEPROM);
    return 0;
}

/* Called after the master wrote the control register. */
void eeprom_command(struct slave *slave)
{
    uint8_t *memory = slave->memory;
    unsigned control = load16(memory + REG_EEPROM_CONTROL);
    size_t address = (size_t)load32(memory + REG_EEPROM_ADDRESS) * 2;
    unsigned errors = 0;
    switch (control & CONTROL_COMMAND) {
    case COMMAND_NOP:
        break;
    case COMMAND_READ:
        for (size_t i = 0; i < 8; i++)
            memory[REG_EEPROM_DATA + i] = byte_at(slave, address + i);
        break;
    case COMMAND_WRITE:
        errors = write_word(slave, address, control);
        break;
    case COMMAND_RELOAD:
        eeprom_load(slave, false);
        return;
    default:
        errors = STATUS_COMMAND_ERROR;
    }
    set_status(slave, errors);
}
