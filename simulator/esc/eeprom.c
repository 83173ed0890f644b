/* EEPROM interface (registers 0x0500 to 0x050F), served from the SII image.
 *
 * A command is carried out at once. Its data and errors appear in the registers when the time
 * that a real EEPROM needs has passed. Each access to the registers checks that.
 */
#include "slave.h"

enum {
    CONFIG_TO_PDI = 0x01,   /* 0x0500: the master offers the EEPROM to the device */
    CONFIG_FORCE = 0x02,    /* 0x0500: the master takes it back */
    ACCESS_BY_PDI = 0x01,   /* 0x0501: the device has taken it */
    REG_ACCESS = REG_EEPROM_CONFIG + 1,
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
    STATUS_COMMAND_ERROR = 0x2000, /* no acknowledge, or no such command */
    STATUS_WRITE_ENABLE_ERROR = 0x4000,
    STATUS_BUSY = 0x8000,
    CONFIGURATION = 16, /* bytes of the configuration area; the last word is the checksum */
    CHECKED_BYTES = 14,
    CHECKSUM_OFF = 0x88A4, /* a checksum that is always right, for development */
    KEPT_ON_RELOAD = 0xF2, /* of register 0x0141: enhanced link detection */
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

static uint8_t byte_at(const struct eeprom *eeprom, size_t address)
{
    return address < eeprom->size ? eeprom->image[address] : 0xFF;
}

static bool is_valid(const struct eeprom *eeprom)
{
    const uint8_t *image = eeprom->image;
    return eeprom->size >= CONFIGURATION &&
           (load16(image + CHECKED_BYTES) == CHECKSUM_OFF ||
            checksum(image, CHECKED_BYTES) == image[CHECKED_BYTES]);
}

/* Loads the configuration area into the registers, which keep their values after an error. Returns
 * the error bits. */
static unsigned load_configuration(struct slave *slave, bool power_on)
{
    const struct eeprom *eeprom = &slave->eeprom;
    const uint8_t *image = eeprom->image;
    uint8_t *memory = slave->memory;
    unsigned before = power_on ? STATUS_NOT_LOADED : eeprom->errors & STATUS_NOT_LOADED;
    if (eeprom->size == 0) /* no EEPROM at all */
        return before | STATUS_COMMAND_ERROR;
    if (!is_valid(eeprom))
        return before | STATUS_CHECKSUM_ERROR;
    uint8_t kept = power_on ? 0 : KEPT_ON_RELOAD;
    memory[REG_PDI_CONTROL] = image[0];
    memory[REG_PDI_CONTROL + 1] =
        (uint8_t)((memory[REG_PDI_CONTROL + 1] & kept) | (image[1] & ~kept));
    memcpy(memory + REG_PDI_CONFIGURATION, image + 2, 2);
    memcpy(memory + REG_SYNC_PULSE, image + 4, 2);
    memcpy(memory + REG_PDI_CONFIGURATION + 2, image + 6, 2);
    if (power_on)
        memcpy(memory + REG_STATION_ALIAS, image + 8, 2);
    registers_set_dl_status(slave, DL_PDI_OPERATIONAL, true);
    if (!watchdog_has_pdi(slave))
        registers_set_dl_status(slave, DL_PDI_WATCHDOG, false);
    slave->segment->topology_stale = true; /* enhanced link detection is among these settings */
    return 0;
}

/* Loads the SII image, as at power-on or as for a reload. */
void eeprom_load(struct slave *slave, bool power_on)
{
    slave->eeprom.errors = load_configuration(slave, power_on);
}

static bool belongs_to_device(const struct slave *slave)
{
    return (slave->memory[REG_EEPROM_CONFIG] & CONFIG_TO_PDI) != 0 ||
           (slave->memory[REG_ACCESS] & ACCESS_BY_PDI) != 0;
}

/* Called after the master has written 0x0500, or the device 0x0501. */
void eeprom_assigned(struct slave *slave)
{
    uint8_t config = slave->memory[REG_EEPROM_CONFIG];
    bool offered = (config & (CONFIG_TO_PDI | CONFIG_FORCE)) == CONFIG_TO_PDI;
    bool forced = (config & CONFIG_FORCE) != 0;
    uint8_t *access = slave->memory + REG_ACCESS;
    *access &= ACCESS_BY_PDI;
    if (forced || (!offered && !slave->eeprom.taken))
        *access = 0;
    slave->eeprom.taken = *access != 0;
}

/* Whether the device or the master may write 0x0502 to 0x050F: the EEPROM must belong to it, and be
 * idle. */
bool eeprom_accepts(struct slave *slave, bool by_device)
{
    eeprom_refresh(slave);
    if (slave->eeprom.busy_until_ns != 0)
        return false;
    return by_device ? slave->eeprom.taken : !belongs_to_device(slave);
}

static void show(struct slave *slave)
{
    const struct eeprom *eeprom = &slave->eeprom;
    unsigned status = eeprom->errors;
    if (slave->config.eeprom_bytes == 8)
        status |= CONTROL_READS_8_BYTES;
    if (eeprom->size > SMALL_EEPROM)
        status |= CONTROL_ADDRESS_2_BYTES;
    if (eeprom->taken || eeprom->enabled == frame_number(slave->segment))
        status |= CONTROL_WRITE_ENABLE;
    if (eeprom->busy_until_ns != 0)
        status |= STATUS_BUSY | eeprom->command;
    store16(slave->memory + REG_EEPROM_CONTROL, status);
}

static void finish(struct slave *slave)
{
    struct eeprom *eeprom = &slave->eeprom;
    eeprom->busy_until_ns = 0;
    eeprom->errors = eeprom->outcome;
    if (eeprom->command == COMMAND_READ && (eeprom->outcome & STATUS_COMMAND_ERROR) == 0)
        memcpy(slave->memory + REG_EEPROM_DATA, eeprom->data, slave->config.eeprom_bytes);
}

/* Updates the registers. */
void eeprom_refresh(struct slave *slave)
{
    int64_t until_ns = slave->eeprom.busy_until_ns;
    if (until_ns != 0 && frame_time_ns(slave->segment) >= until_ns)
        finish(slave);
    show(slave);
}

static unsigned write_word(struct slave *slave, size_t address, bool enabled)
{
    struct eeprom *eeprom = &slave->eeprom;
    if (!enabled)
        return STATUS_WRITE_ENABLE_ERROR;
    if (address + 2 > eeprom->size)
        return STATUS_COMMAND_ERROR;
    memcpy(eeprom->image + address, slave->memory + REG_EEPROM_DATA, 2);
    pdi_event(slave, ESC_EEPROM);
    return 0;
}

static unsigned read_words(struct slave *slave, size_t address)
{
    struct eeprom *eeprom = &slave->eeprom;
    for (size_t i = 0; i < sizeof eeprom->data; i++)
        eeprom->data[i] = byte_at(eeprom, address + i);
    return eeprom->size == 0 ? STATUS_COMMAND_ERROR : 0;
}

static void start(struct slave *slave, unsigned command, bool enabled)
{
    struct eeprom *eeprom = &slave->eeprom;
    const struct esc_config *config = &slave->config;
    size_t address = (size_t)load32(slave->memory + REG_EEPROM_ADDRESS) * 2;
    unsigned lasting = eeprom->errors & (STATUS_CHECKSUM_ERROR | STATUS_NOT_LOADED);
    int64_t time_us = config->eeprom_read_us;
    eeprom->command = command;
    if (command == COMMAND_READ) {
        eeprom->outcome = lasting | read_words(slave, address);
    } else if (command == COMMAND_WRITE) {
        eeprom->outcome = lasting | write_word(slave, address, enabled);
        time_us = enabled ? config->eeprom_write_us : 0;
    } else if (command == COMMAND_RELOAD) {
        eeprom->outcome = load_configuration(slave, false);
    } else {
        eeprom->outcome = lasting | STATUS_COMMAND_ERROR;
        time_us = 0;
    }
    if (time_us == 0)
        finish(slave);
    else
        eeprom->busy_until_ns = frame_time_ns(slave->segment) + 1000 * time_us;
}

/* Called after the side that may write the control register has written it. */
void eeprom_command(struct slave *slave, bool by_device)
{
    struct eeprom *eeprom = &slave->eeprom;
    unsigned control = load16(slave->memory + REG_EEPROM_CONTROL);
    unsigned command = control & CONTROL_COMMAND;
    uint64_t frame = frame_number(slave->segment);
    if ((control & CONTROL_WRITE_ENABLE) != 0)
        eeprom->enabled = frame; /* until the next frame begins */
    if (command == COMMAND_NOP)
        eeprom->errors &= ~(unsigned)(STATUS_COMMAND_ERROR | STATUS_WRITE_ENABLE_ERROR);
    else if ((eeprom->errors & STATUS_COMMAND_ERROR) == 0) /* an error must be cleared first */
        start(slave, command, by_device || eeprom->enabled == frame);
    show(slave);
}
