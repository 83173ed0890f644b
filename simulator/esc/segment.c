/* Makes and frees a segment and its slaves, and switches their power. */
#include "slave.h"

#include <errno.h>
#include <stdlib.h>
#include <sys/eventfd.h>
#include <unistd.h>

struct esc_segment *esc_create(void)
{
    struct esc_segment *segment = calloc(1, sizeof *segment);
    if (segment == NULL)
        return NULL;
    pthread_mutexattr_t attributes;
    pthread_mutexattr_init(&attributes);
    /* While the frame thread waits for the lock, the holder of the lock gets the same priority. */
    pthread_mutexattr_setprotocol(&attributes, PTHREAD_PRIO_INHERIT);
    pthread_mutex_init(&segment->lock, &attributes);
    pthread_mutexattr_destroy(&attributes);
    segment->route = &segment->routes[0];
    topology_update(segment);
    segment->notify = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
    if (segment->notify < 0) {
        pthread_mutex_destroy(&segment->lock);
        free(segment);
        return NULL;
    }
    return segment;
}

static void free_slave(struct slave *slave)
{
    if (slave == NULL)
        return;
    free(slave->eeprom.image);
    free(slave->buffers);
    program_remove(slave);
    free(slave);
}

void esc_destroy(struct esc_segment *segment)
{
    esc_stop(segment);
    for (unsigned i = 0; i < segment->count; i++) {
        free_slave(segment->slaves[i]);
    }
    close(segment->notify);
    pthread_mutex_destroy(&segment->lock);
    free(segment);
}

/* Returns a copy of an SII image; NULL only if memory is short, also for an empty image. */
static uint8_t *copy_image(const uint8_t *sii, size_t size)
{
    uint8_t *image = malloc(size + 1);
    if (image != NULL)
        memcpy(image, sii, size);
    return image;
}

static bool possible(const struct esc_config *config)
{
    return config->fmmus <= ESC_MAX_CHANNELS && config->sync_managers <= ESC_MAX_CHANNELS &&
           config->ram_kib <= 60 && (config->eeprom_bytes == 4 || config->eeprom_bytes == 8);
}

/* Gives a slave its chip and its SII image, which it owns from now on. */
static void configure(struct slave *slave, const struct esc_config *config, uint8_t *image,
                      size_t size)
{
    free(slave->eeprom.image);
    slave->config = *config;
    slave->eeprom.image = image;
    slave->eeprom.size = size;
    slave->sync_managers = config->sync_managers;
    slave->fmmus = config->fmmus;
    slave->ram_end = REG_RAM + 1024U * config->ram_kib;
    registers_power_on(slave);
}

int esc_add_slave(struct esc_segment *segment, const struct esc_config *config, const uint8_t *sii,
                  size_t sii_size)
{
    if (!possible(config))
        return -EINVAL;
    if (segment->count >= ESC_MAX_SLAVES)
        return -ENOSPC;
    struct slave *slave = calloc(1, sizeof *slave);
    uint8_t *image = copy_image(sii, sii_size);
    if (slave != NULL)
        slave->buffers = calloc(1, sizeof *slave->buffers);
    if (slave == NULL || image == NULL || slave->buffers == NULL) {
        free(image);
        free_slave(slave);
        return -ENOMEM;
    }
    pthread_mutex_lock(&segment->lock);
    slave->segment = segment;
    segment->frame_ns = 0;
    slave->position = segment->count;
    segment->slaves[segment->count++] = slave;
    configure(slave, config, image, sii_size);
    topology_plug_next(slave);
    topology_update(segment);
    pthread_mutex_unlock(&segment->lock);
    return (int)slave->position;
}

/* Switches the power of a slave and drops its pending events. Called with the lock held. */
static void switch_power(struct slave *slave, bool on)
{
    if (slave->off != on)
        return;
    sync_stop(slave);
    topology_refresh(slave->segment);
    slave->off = !on;
    slave->events = 0;
    slave->area_count = 0;
    topology_update(slave->segment); /* the neighbours see links come up or go down */
}

int esc_power(struct esc_segment *segment, int position, int on)
{
    int result = -ENODEV;
    pthread_mutex_lock(&segment->lock);
    segment->frame_ns = 0;
    if (position >= 0 && (unsigned)position < segment->count) {
        struct slave *slave = segment->slaves[position];
        if (slave->off && on != 0)
            registers_power_on(slave);
        switch_power(slave, on != 0);
        result = 0;
    }
    pthread_mutex_unlock(&segment->lock);
    return result;
}

int esc_replace(struct esc_segment *segment, int position, const struct esc_config *config,
                const uint8_t *sii, size_t sii_size)
{
    if (!possible(config))
        return -EINVAL;
    uint8_t *image = copy_image(sii, sii_size);
    if (image == NULL)
        return -ENOMEM;
    pthread_mutex_lock(&segment->lock);
    segment->frame_ns = 0;
    if (position < 0 || (unsigned)position >= segment->count) {
        pthread_mutex_unlock(&segment->lock);
        free(image);
        return -ENODEV;
    }
    struct slave *slave = segment->slaves[position];
    switch_power(slave, false);
    program_remove(slave);
    configure(slave, config, image, sii_size);
    switch_power(slave, true);
    pthread_mutex_unlock(&segment->lock);
    return 0;
}

int esc_pass(struct esc_segment *segment, int interface, uint8_t *frame, size_t size, int64_t now_ns,
             struct esc_passage *passage)
{
    if (interface < 0 || interface >= INTERFACES)
        return -EINVAL;
    pthread_mutex_lock(&segment->lock);
    segment->frame_ns = now_ns;
    frame_process(segment, (unsigned)interface, frame, size, passage);
    if (segment->programs_due)
        program_run_due(segment);
    bool due = pdi_signal_due(segment);
    pthread_mutex_unlock(&segment->lock);
    if (due)
        pdi_signal(segment);
    return 0;
}

int esc_process(struct esc_segment *segment, uint8_t *frame, size_t size)
{
    struct esc_passage passage;
    return esc_pass(segment, 0, frame, size, 0, &passage) == 0 && passage.exit == 0;
}

void esc_get_counters(struct esc_segment *segment, struct esc_counters *counters)
{
    pthread_mutex_lock(&segment->lock);
    *counters = segment->counters;
    pthread_mutex_unlock(&segment->lock);
}
