/* The device side: events, memory, mailbox and process data, and the process data watchdog. */
#include "slave.h"

#include <errno.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <time.h>
#include <unistd.h>

enum {
    AL_EVENT_CONTROL = 0x0001,
    AL_EVENT_WATCHDOG = 0x0040,
    SM_PDI = 7,
    SM_ACTIVATE = 6,
    SM_REPEAT = 0x02,
    WATCHDOG_OK = 0x01
};

/* Notes an event; the slave enters the queue with its first one. Called with the lock held. */
void pdi_event(struct slave *slave, uint32_t bits)
{
    struct esc_segment *segment = slave->segment;
    if (slave->events == 0) {
        unsigned tail = (segment->queue_head + segment->queue_count++) % ESC_MAX_SLAVES;
        segment->queue[tail] = slave->position;
        segment->signal_due = true;
    }
    slave->events |= bits;
    if (bits & ESC_AL_CONTROL)
        slave->memory[REG_AL_EVENT] |= AL_EVENT_CONTROL;
    if (bits & ESC_WATCHDOG)
        slave->memory[REG_AL_EVENT] |= AL_EVENT_WATCHDOG;
    if (bits & ESC_MAILBOX_IN)
        slave->memory[REG_AL_EVENT + 1] |= 0x01;
    if (bits & ESC_MAILBOX_OUT)
        slave->memory[REG_AL_EVENT + 1] |= 0x02;
}

/* Whether `pdi_signal` is to be called once the lock is released. */
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

int esc_wait(struct esc_segment *segment, int64_t timeout_ns, struct esc_event *events,
             int capacity)
{
    struct pollfd notify = {segment->notify, POLLIN, 0};
    struct timespec timeout = {timeout_ns / 1000000000, timeout_ns % 1000000000};
    uint64_t signals;
    if (ppoll(&notify, 1, timeout_ns < 0 ? NULL : &timeout, NULL) < 0)
        return -errno;
    if (read(segment->notify, &signals, sizeof signals) < 0)
        return 0;
    int count = 0;
    pthread_mutex_lock(&segment->lock);
    while (count < capacity && segment->queue_count > 0) {
        struct slave *slave = segment->slaves[segment->queue[segment->queue_head]];
        segment->queue_head = (segment->queue_head + 1) % ESC_MAX_SLAVES;
        segment->queue_count--;
        events[count++] = (struct esc_event){slave->position, slave->events};
        slave->events = 0;
        memset(slave->memory + REG_AL_EVENT, 0, 4);
    }
    bool more = segment->queue_count > 0;
    pthread_mutex_unlock(&segment->lock);
    if (more)
        pdi_signal(segment);
    return count;
}

/* Locks the segment and finds a slave; NULL without the lock if there is none. */
static struct slave *enter(struct esc_segment *segment, int position)
{
    pthread_mutex_lock(&segment->lock);
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
        memcpy(slave->memory + address, data, size);
        segment->topology_stale = true; /* the loop control may be among them */
        result = 0;
    }
    leave(segment);
    return result;
}

int esc_set_al_status(struct esc_segment *segment, int position, uint16_t status, uint16_t code)
{
    struct slave *slave = enter(segment, position);
    if (slave == NULL)
        return -ENODEV;
    bool changed = load16(slave->memory + REG_AL_STATUS) != status;
    store16(slave->memory + REG_AL_STATUS, status);
    store16(slave->memory + REG_AL_STATUS_CODE, code);
    if (changed) {
        registers_set_event(slave, ECAT_EVENT_AL, true);
        if (status == AL_OP) { /* the time to the first output data counts from here */
            slave->fed = true;
            slave->expired = false;
        }
    }
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
        sm->full = false;
        sm_write_status(slave, 0);
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
        sm->full = true;
        sm->open = false;
        sm_write_status(slave, 1);
        if (again)
            reg[SM_PDI] = (uint8_t)((reg[SM_PDI] & ~SM_REPEAT) | (reg[SM_ACTIVATE] & SM_REPEAT));
        result = 1;
    }
    leave(segment);
    return result;
}

int esc_map(struct esc_segment *segment, int position, const struct esc_process_data *map)
{
    struct slave *slave = enter(segment, position);
    if (slave == NULL)
        return -ENODEV;
    int result = 0;
    if (map != NULL && (map->output_address + map->output_size > ESC_MEMORY ||
                        map->input_address + map->input_size > ESC_MEMORY)) {
        result = -EINVAL;
    } else {
        slave->mapped = map != NULL;
        slave->deadline_ns = 0;
        slave->fed = false;
        slave->expired = false;
        if (map != NULL)
            slave->map = *map;
    }
    leave(segment);
    return result;
}

int esc_await_outputs(struct esc_segment *segment, int position)
{
    struct slave *slave = enter(segment, position);
    if (slave == NULL)
        return -ENODEV;
    slave->awaits_outputs = true;
    leave(segment);
    return 0;
}

/* The time is (divider + 2) * 40 ns * count; 0 in either register switches the watchdog off. */
static void run_watchdog(struct slave *slave, int64_t now_ns)
{
    uint8_t *memory = slave->memory;
    int64_t unit_ns = ((int64_t)load16(memory + REG_WATCHDOG_DIVIDER) + 2) * 40;
    int64_t time_ns = unit_ns * load16(memory + REG_WATCHDOG_DATA);
    if (slave->fed || time_ns == 0) {
        slave->deadline_ns = slave->fed ? now_ns + time_ns : 0;
        slave->fed = false;
        slave->expired = false;
        memory[REG_WATCHDOG_STATUS] |= WATCHDOG_OK;
    } else if (slave->deadline_ns != 0 && now_ns > slave->deadline_ns && !slave->expired) {
        slave->expired = true;
        memory[REG_WATCHDOG_STATUS] &= (uint8_t)~WATCHDOG_OK;
        if (memory[REG_WATCHDOG_COUNTERS] < 0xFF)
            memory[REG_WATCHDOG_COUNTERS]++;
        if ((memory[REG_AL_STATUS] & AL_STATE_MASK) == AL_OP)
            pdi_event(slave, ESC_WATCHDOG);
    }
}

/* Process data are copied slave by slave, so that no frame waits for more than one of them. */
int esc_get_outputs(struct esc_segment *segment, uint8_t *image, size_t size, int64_t now_ns)
{
    struct slave *slave;
    int result = 0;
    for (int position = 0; (slave = enter(segment, position)) != NULL; position++) {
        const struct esc_process_data *map = &slave->map;
        if (slave->mapped && map->output_size > 0) {
            if (slave->watchdog)
                run_watchdog(slave, now_ns);
            if ((size_t)map->output_offset + map->output_size > size)
                result = -EINVAL;
            else if (slave->memory[REG_AL_STATUS] == AL_OP && !slave->expired)
                memcpy(image + map->output_offset, slave->memory + map->output_address,
                       map->output_size);
            else
                memset(image + map->output_offset, 0, map->output_size);
        }
        leave(segment);
    }
    return result;
}

int esc_put_inputs(struct esc_segment *segment, const uint8_t *image, size_t size)
{
    struct slave *slave;
    int result = 0;
    for (int position = 0; (slave = enter(segment, position)) != NULL; position++) {
        const struct esc_process_data *map = &slave->map;
        if (slave->mapped && map->input_size > 0) {
            if ((size_t)map->input_offset + map->input_size > size)
                result = -EINVAL;
            else
                memcpy(slave->memory + map->input_address, image + map->input_offset,
                       map->input_size);
        }
        leave(segment);
    }
    return result;
}

int esc_sii(struct esc_segment *segment, int position, uint8_t *image, size_t capacity)
{
    struct slave *slave = enter(segment, position);
    if (slave == NULL)
        return -ENODEV;
    if (capacity > 0)
        memcpy(image, slave->sii, slave->sii_size < capacity ? slave->sii_size : capacity);
    int size = (int)slave->sii_size;
    leave(segment);
    return size;
}
