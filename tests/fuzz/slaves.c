/* Slaves and topologies of every kind. */
#include "fuzz.h"

#include <string.h>

enum { MAX_IMAGE = 4096 };

/* SII images: none, too short, random, and (half of them) with a right checksum, without which the
 * ESC does not let masters touch the process data. Returns the size. */
static size_t random_chip(struct source *source, unsigned number, struct esc_config *config,
                          uint8_t image[MAX_IMAGE])
{
    /* Word 1: SYNC0 and SYNC1 interrupt the device. */
    static const uint8_t good[16] = {0x0C, 0x05, 0, 0x88, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0x0F, 0};
    size_t size = number % 4 == 3 ? below(source, 32) : 64 + below(source, MAX_IMAGE - 64);
    fill(source, image, MAX_IMAGE);
    if (number % 4 < 2)
        memcpy(image, good, sizeof good);
    *config = (struct esc_config){
        .type = 0x11,
        .fmmus = (uint8_t)(number % 5 == 4 ? below(source, 17) : 8),
        .sync_managers = (uint8_t)(number % 7 == 6 ? below(source, 17) : 8),
        .ram_kib = (uint8_t)(number % 3 == 2 ? 60 : 8),
        .ports = number % 2 == 0 ? 0xFF : 0x0F,
        .features = number % 5 == 3 ? 0x0200 : 0,
        .dc_by_sii = number % 4 < 2,
        .dc_bits = number % 4 == 1 ? 32 : number % 4 == 2 ? 0 : 64,
        .eeprom_bytes = number % 2 == 0 ? 8 : 4,
        .watchdog_divider = 2498,
        .watchdog_pdi = 1000,
        .watchdog_data = 1000,
        .eeprom_read_us = number % 3 == 1 ? 20 : 0,
        .eeprom_write_us = number % 3 == 2 ? 50 : 0,
    };
    return size;
}

/* A line, a tree, or either closed to a ring. */
void add_slaves(struct source *source)
{
    uint8_t image[MAX_IMAGE];
    struct esc_config config;
    bool tree = one_in(source, 3);
    for (unsigned i = 0; i < slaves; i++) {
        size_t size = random_chip(source, i, &config, image);
        if (esc_add_slave(segment, &config, image, size) != (int)i)
            die("a slave is not taken");
        if (tree && i > 0 && one_in(source, 2))
            (void)esc_connect(segment, (int)i, (int)below(source, i), 1 + (int)below(source, 3));
    }
    if (one_in(source, 3))
        (void)esc_close_ring(segment, (int)slaves - 1, 1);
}

void replace_slave(struct source *source, int slave)
{
    uint8_t image[MAX_IMAGE];
    struct esc_config config;
    size_t size = random_chip(source, below(source, 32), &config, image);
    (void)esc_replace(segment, slave, &config, image, size);
}
