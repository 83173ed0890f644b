/* The device side: events, memory, mailbox and process data. */
#include "slave.h"

#include <errno.h>
#include <poll.h>
#include <stdlib.h>
#include <sys/eventfd.h>
#include <time.h>
#include <unistd.h>

enum { SM_PDI = 7, SM_ACTIVATE = 6, SM_REPEAT = 0x02 };

/* Adds events, and queues the slave if it is not queued yet. Called with the lock held. */
void pdi_event(struct slave *slave, uint32_t bits)
{
    struct esc_segment *segment = slave->segment;
    if (!slave->queued) {
        slave->queued = true;
        unsigned tail = (segment->queue_head + segment->queue_count++) % ESC_MAX_SLAVES;
        segment->queue[tail] = slave->position;
        segment->signal_due = true;
    }
    slave->events |= bits;
}

/* Whether the caller must call `pdi_signal` after it has released the lock. True only once. */
bool pdi_signal_due(struct esc_segment *segment)
{
    bool due = segment->signal_due;
    segment->signal_due = false;
    return due;
}

void pdi_signal(struct esc_segment *segment)
{
    uint64_t one = 1;
    /* The counter of an eventfd cannot overflow here, and a full one is readable as well. */
    ssize_t written = write(segment->notify, &one, sizeof one);
    (void)written;
}

/* Reports SYNC pulses. Returns the timeout in ns, shortened if necessary to report the next pulse
 * in time. */
static int64_t run_syncs(struct esc_segment *segment, int64_t timeout_ns)
{
    pthread_mutex_lock(&segment->lock);
    segment->frame_ns = 0;
    for (unsigned i = 0; i < segment->count && segment->syncs_running > 0; i++) {
        int64_t next = sync_run(segment->slaves[i]);
        if (next < timeout_ns || timeout_ns < 0)
            timeout_ns = next == INT64_MAX ? timeout_ns : next;
    }
    bool due = pdi_signal_due(segment);
    pthread_mutex_unlock(&segment->lock);
    if (due)
        pdi_signal(segment);
    return timeout_ns;
}

int esc_wait(struct esc_segment *segment, int64_t timeout_ns, struct esc_event *events,
             int capacity)
{
    struct pollfd notify = {segment->notify, POLLIN, 0};
    int64_t wait_ns = run_syncs(segment, timeout_ns);
    struct timespec timeout = {wait_ns / 1000000000, wait_ns % 1000000000};
    uint64_t signals;
    int ready = ppoll(&notify, 1, wait_ns < 0 ? NULL : &timeout, NULL);
    if (ready < 0)
        return -errno;
    if (wait_ns != timeout_ns)
        run_syncs(segment, 0);
    else if (ready == 0)
        return 0;
    if (read(segment->notify, &signals, sizeof signals) < 0)
        return 0;
    int count = 0;
    pthread_mutex_lock(&segment->lock);
    while (count < capacity && segment->queue_count > 0) {
        struct slave *slave = segment->slaves[segment->queue[segment->queue_head]];
        segment->queue_head = (segment->queue_head + 1) % ESC_MAX_SLAVES;
        segment->queue_count--;
        slave->queued = false;
        if (slave->events == 0) /* the slave lost power */
            continue;
        events[count++] = (struct esc_event){slave->position, slave->events};
        slave->events = 0;
    }
    bool more = segment->queue_count > 0;
    pthread_mutex_unlock(&segment->lock);
    if (more)
        pdi_signal(segment);
    return count;
}

/* Locks the segment and returns a slave. If there is none, returns NULL without the lock. */
static struct slave *enter(struct esc_segment *segment, int position)
{
    pthread_mutex_lock(&segment->lock);
    segment->frame_ns = 0;
    if (position >= 0 && (unsigned)position < segment->count)
        return segment->slaves[position];
    pthread_mutex_unlock(&segment->lock);
    return NULL;
}

static void leave(struct esc_segment *segment)
{
    bool due = pdi_signal_due(segment);
    pthread_mutex_unlock(&segment->lock);
    if (due)
        pdi_signal(segment);
}

int esc_read(struct esc_segment *segment, int position, uint16_t address, uint8_t *data,
             size_t size)
{
    struct slave *slave = enter(segment, position);
    if (slave == NULL)
        return -ENODEV;
    int result = -EINVAL;
    if (size <= ESC_MEMORY - (size_t)address) {
        uint32_t from = address, to = from + (uint32_t)size;
        live_refresh(slave, from, to, true);
        buffers_read(slave, from, to, data);
        live_was_read(slave, from, to, true);
        result = 0;
    }
    leave(segment);
    return result;
}

int esc_peek(struct esc_segment *segment, int position, uint16_t address, uint8_t *data,
             size_t size)
{
    struct slave *slave = enter(segment, position);
    if (slave == NULL)
        return -ENODEV;
    int result = -EINVAL;
    if (size <= ESC_MEMORY - (size_t)address) {
        live_refresh(slave, address, address + (uint32_t)size, true);
        memcpy(data, slave->memory + address, size);
        result = 0;
    }
    leave(segment);
    return result;
}

int esc_write(struct esc_segment *segment, int position, uint16_t address, const uint8_t *data,
              size_t size)
{
    struct slave *slave = enter(segment, position);
    if (slave == NULL)
        return -ENODEV;
    int result = -EINVAL;
    if (size <= ESC_MEMORY - (size_t)address) {
        uint32_t from = address, to = from + (uint32_t)size;
        bool written = to <= REG_DIGITAL_OUTPUT ? registers_device_write(slave, from, to, data)
                                                : buffers_write(slave, from, to, data);
        if (touches(from, to, REG_DL_CONTROL, 4))
            segment->topology_stale = true;
        result = written ? 0 : -EACCES;
    }
    leave(segment);
    return result;
}

int esc_set_al_status(struct esc_segment *segment, int position, uint16_t status, uint16_t code)
{
    struct slave *slave = enter(segment, position);
    if (slave == NULL)
        return -ENODEV;
    uint16_t before = load16(slave->memory + REG_AL_STATUS);
    store16(slave->memory + REG_AL_STATUS, status);
    store16(slave->memory + REG_AL_STATUS_CODE, code);
    if (status != before)
        registers_set_event(slave, ECAT_EVENT_AL, true);
    registers_show_state(slave, status != before);
    bool is_op = (status & AL_STATE_MASK) == AL_OP, was_op = (before & AL_STATE_MASK) == AL_OP;
    if (is_op && !was_op) {
        slave->fed = true; /* the time to the first output data counts from here */
        slave->expired = false;
    }
    if (was_op && !is_op)
        slave->has_outputs = false; /* the way back to OP needs new ones */
    leave(segment);
    return 0;
}

int esc_lock_sync_manager(struct esc_segment *segment, int position, int channel, int locked)
{
    struct slave *slave = enter(segment, position);
    if (slave == NULL)
        return -ENODEV;
    int result = -EINVAL;
    if (channel >= 0 && (unsigned)channel < slave->sync_managers) {
        uint8_t *pdi = slave->memory + REG_SM + 8 * channel + SM_PDI;
        *pdi = (uint8_t)((*pdi & 0xFE) | (locked != 0));
        sm_decode(slave, (unsigned)channel);
        result = 0;
    }
    leave(segment);
    return result;
}

int esc_mailbox_take(struct esc_segment *segment, int position, uint8_t *mail, size_t capacity)
{
    struct slave *slave = enter(segment, position);
    if (slave == NULL)
        return -ENODEV;
    struct sync_manager *sm = &slave->sm[0];
    int result = 0;
    if (sm->size > 0 && sm->mailbox && sm->write && sm->full) {
        size_t size = sm->size < capacity ? sm->size : capacity;
        memcpy(mail, slave->memory + sm->start, size);
        sm->full = sm->written = false;
        sm->read = true;
        segment->event_word_stale = true;
        result = (int)size;
    }
    leave(segment);
    return result;
}

int esc_mailbox_put(struct esc_segment *segment, int position, const uint8_t *mail, size_t size,
                    int again)
{
    struct slave *slave = enter(segment, position);
    if (slave == NULL)
        return -ENODEV;
    struct sync_manager *sm = &slave->sm[1];
    int result = 0;
    bool usable = sm->mailbox && !sm->write && size <= sm->size && sm->size > 0;
    if (usable && (!sm->full || again)) {
        uint8_t *reg = slave->memory + REG_SM + 8;
        memcpy(slave->memory + sm->start, mail, size);
        memset(slave->memory + sm->start + size, 0, sm->size - size);
        sm->full = sm->written = true;
        sm->open = sm->read = false;
        segment->event_word_stale = true;
        if (again)
            reg[SM_PDI] = (uint8_t)((reg[SM_PDI] & ~SM_REPEAT) | (reg[SM_ACTIVATE] & SM_REPEAT));
        result = 1;
    }
    leave(segment);
    return result;
}

int esc_map(struct esc_segment *segment, int position, const struct esc_area *areas, unsigned count)
{
    if (areas == NULL)
        count = 0;
    if (count > ESC_MAX_CHANNELS)
        return -EINVAL;
    for (unsigned i = 0; i < count; i++)
        if (areas[i].address + areas[i].size > ESC_MEMORY)
            return -EINVAL;
    struct slave *slave = enter(segment, position);
    if (slave == NULL)
        return -ENODEV;
    slave->has_outputs = slave->awaits_outputs = false;
    slave->deadline_ns = 0;
    slave->fed = false;
    slave->expired = false;
    slave->area_count = count;
    program_clear(slave);
    if (count > 0)
        memcpy(slave->areas, areas, count * sizeof *areas);
    leave(segment);
    return 0;
}

int esc_await_outputs(struct esc_segment *segment, int position)
{
    struct slave *slave = enter(segment, position);
    if (slave == NULL)
        return -ENODEV;
    if (slave->has_outputs)
        pdi_event(slave, ESC_OUTPUTS);
    else
        slave->awaits_outputs = true;
    leave(segment);
    return 0;
}

bool pdi_outputs_count(const struct slave *slave)
{
    return (slave->memory[REG_AL_STATUS] & AL_STATE_MASK) == AL_OP && !slave->expired;
}

static int get_outputs(struct slave *slave, uint8_t *image, size_t size)
{
    bool valid = pdi_outputs_count(slave);
    for (unsigned i = 0; i < slave->area_count; i++) {
        const struct esc_area *area = &slave->areas[i];
        uint32_t from = area->address, to = from + area->size;
        if (!area->output)
            continue;
        if ((size_t)area->offset + area->size > size)
            return -EINVAL;
        bool turn = buffers_turn(slave, area);
        if (valid && !turn)
            continue; /* the one buffer is empty: the last outputs hold */
        if (valid)
            buffers_read(slave, from, to, image + area->offset);
        else
            memset(image + area->offset, 0, area->size);
    }
    return 0;
}

/* Process data are copied slave by slave, so that no frame waits for more than one of them. */
int esc_get_outputs(struct esc_segment *segment, uint8_t *image, size_t size, int64_t now_ns)
{
    struct slave *slave;
    int result = 0;
    int64_t time_ns = clock_now_ns();
    for (int position = 0; (slave = enter(segment, position)) != NULL; position++) {
        segment->frame_ns = time_ns;
        sync_run(slave);
        watchdog_feed_pdi(slave, time_ns);
        watchdog_run(slave, now_ns);
        int error = 0;
        if (slave->program != NULL)
            program_run_idle(slave, now_ns);
        else
            error = get_outputs(slave, image, size);
        result = error != 0 ? error : result;
        leave(segment);
    }
    return result;
}

static int put_inputs(struct slave *slave, const uint8_t *image, size_t size)
{
    for (unsigned i = 0; i < slave->area_count; i++) {
        const struct esc_area *area = &slave->areas[i];
        if (area->output)
            continue;
        if ((size_t)area->offset + area->size > size)
            return -EINVAL;
        if (!buffers_turn(slave, area))
            continue; /* the master has not read the last inputs yet */
        /* Refused if the master has moved the sync manager: the inputs then stay as they are. */
        (void)buffers_write(slave, area->address, (uint32_t)area->address + area->size,
                            image + area->offset);
    }
    return 0;
}

int esc_put_inputs(struct esc_segment *segment, const uint8_t *image, size_t size)
{
    struct slave *slave;
    int result = 0;
    for (int position = 0; (slave = enter(segment, position)) != NULL; position++) {
        int error = slave->program == NULL ? put_inputs(slave, image, size) : 0;
        result = error != 0 ? error : result;
        leave(segment);
    }
    return result;
}

int esc_sii(struct esc_segment *segment, int position, uint8_t *image, size_t capacity)
{
    struct slave *slave = enter(segment, position);
    if (slave == NULL)
        return -ENODEV;
    const struct eeprom *eeprom = &slave->eeprom;
    if (capacity > 0)
        memcpy(image, eeprom->image, eeprom->size < capacity ? eeprom->size : capacity);
    int size = (int)eeprom->size;
    leave(segment);
    return size;
}

int esc_set_sii(struct esc_segment *segment, int position, const uint8_t *image, size_t size)
{
    uint8_t *copy = malloc(size + 1); /* never 0 bytes */
    if (copy == NULL)
        return -ENOMEM;
    memcpy(copy, image, size);
    struct slave *slave = enter(segment, position);
    if (slave == NULL) {
        free(copy);
        return -ENODEV;
    }
    uint8_t *before = slave->eeprom.image;
    slave->eeprom.image = copy;
    slave->eeprom.size = size;
    leave(segment);
    free(before);
    return 0;
}

int esc_set_clock(struct esc_segment *segment, int position, const double *drift_ppm,
                  const int64_t *offset_ns)
{
    struct slave *slave = enter(segment, position);
    if (slave == NULL)
        return -ENODEV;
    double drift = drift_ppm == NULL ? 0 : *drift_ppm / 1e6;
    dc_set_clock(slave, drift_ppm == NULL ? NULL : &drift, offset_ns);
    leave(segment);
    return 0;
}

int esc_step_clock(struct esc_segment *segment, int position, int64_t step_ns)
{
    struct slave *slave = enter(segment, position);
    if (slave == NULL)
        return -ENODEV;
    slave->dc.clock.local_ns = time_after(slave->dc.clock.local_ns, step_ns);
    leave(segment);
    return 0;
}

int esc_clocks(struct esc_segment *segment, struct esc_clock *clocks, int capacity)
{
    int count = 0;
    pthread_mutex_lock(&segment->lock);
    int64_t now_ns = clock_now_ns();
    for (; count < capacity && (unsigned)count < segment->count; count++)
        dc_get_clock(segment->slaves[count], now_ns, &clocks[count]);
    pthread_mutex_unlock(&segment->lock);
    return count;
}

int esc_latch(struct esc_segment *segment, int position, int unit, int rising)
{
    if (unit < 0 || unit > 1)
        return -EINVAL;
    struct slave *slave = enter(segment, position);
    if (slave == NULL)
        return -ENODEV;
    if (slave->config.dc_bits > 0)
        sync_latch(slave, (unsigned)unit, rising != 0);
    leave(segment);
    return 0;
}
