/* Access of the device to buffered sync managers; sync_manager.c explains them. */
#include "slave.h"

static bool overlaps(const struct sync_manager *sm, uint32_t from, uint32_t to)
{
    return sm->size > 0 && !sm->mailbox && !sm->locked &&
           from < (uint32_t)sm->start + sm->size && to > sm->start;
}

/* Returns the memory with the newest complete buffer. */
static const uint8_t *newest(const struct slave *slave, const struct sync_manager *sm)
{
    return sm->pending ? slave->buffers->newest : slave->memory;
}

/* Reads the part of an output channel that lies in [from, to). An access takes the newest buffer if
 * it begins at the first byte, or continues one that did. Any other access only looks at it. */
static void read_outputs(struct slave *slave, struct sync_manager *sm, uint32_t from, uint32_t to,
                         uint8_t *data)
{
    uint32_t end = (uint32_t)sm->start + sm->size;
    uint32_t first = from > sm->start ? from : sm->start, last = to < end ? to : end;
    const uint8_t *source = sm->device_open ? slave->buffers->device : newest(slave, sm);
    memcpy(data + (first - from), source + first, last - first);
    if (!sm->device_open && first != sm->start)
        return;
    if (!sm->device_open) {
        sm_take_newest(sm);
        if (last < end)
            memcpy(slave->buffers->device + sm->start, source + sm->start, sm->size);
    }
    sm->device_open = last < end;
    sm->read |= last == end;
    sm_changed(slave);
}

/* Reads memory as the device sees it. */
void buffers_read(struct slave *slave, uint32_t from, uint32_t to, uint8_t *data)
{
    memcpy(data, slave->memory + from, to - from);
    for (unsigned i = 0; i < slave->sync_managers; i++) {
        struct sync_manager *sm = &slave->sm[i];
        if (sm->write && overlaps(sm, from, to))
            read_outputs(slave, sm, from, to, data);
    }
}

/* Process data in one buffer (mailbox mode) are the device's turn while the buffer is full of outputs
 * or empty of inputs, and the master's turn otherwise. Takes or gives them; returns false if it is not
 * the device's turn. */
bool buffers_turn(struct slave *slave, const struct esc_area *area)
{
    for (unsigned i = 0; i < slave->sync_managers; i++) {
        struct sync_manager *sm = &slave->sm[i];
        if (!sm->mailbox || sm->size == 0 || sm->start != area->address || sm->write != (area->output != 0))
            continue;
        if (sm->full != sm->write)
            return false;
        sm->full = !sm->write;
        *(sm->write ? &sm->read : &sm->written) = true;
        *(sm->write ? &sm->written : &sm->read) = false;
        sm_changed(slave);
    }
    return true;
}

/* Hands the inputs at `source` to the master, at once or after the buffer that it is reading. */
static void give_inputs(struct slave *slave, struct sync_manager *sm, const uint8_t *source)
{
    uint8_t *target = sm->open ? slave->buffers->newest : slave->memory;
    memcpy(target + sm->start, source, sm->size);
    sm->pending = sm->open;
    sm->device_open = false;
    sm_hand_over(sm);
    sm_changed(slave);
}

/* Writes the part of an input channel that lies in [from, to). */
static void write_inputs(struct slave *slave, struct sync_manager *sm, uint32_t from, uint32_t to,
                         const uint8_t *data)
{
    uint32_t end = (uint32_t)sm->start + sm->size;
    uint32_t first = from > sm->start ? from : sm->start, last = to < end ? to : end;
    if (first == sm->start && last == end && !sm->device_open) {
        give_inputs(slave, sm, data + (first - from));
        return;
    }
    sm->read &= sm->device_open;
    sm->device_open = true;
    memcpy(slave->buffers->device + first, data + (first - from), last - first);
    if (last == end)
        give_inputs(slave, sm, slave->buffers->device + sm->start);
    sm_changed(slave);
}

/* Writes memory as the device does. Returns false, and writes nothing, if an access to an input
 * channel does not begin at its first byte. */
bool buffers_write(struct slave *slave, uint32_t from, uint32_t to, const uint8_t *data)
{
    uint32_t at = from;
    for (unsigned i = 0; i < slave->sync_managers; i++) {
        struct sync_manager *sm = &slave->sm[i];
        if (!sm->write && overlaps(sm, from, to) && !sm->device_open && from > sm->start)
            return false;
    }
    /* Bytes outside of input channels go to memory directly. */
    while (at < to) {
        struct sync_manager *inside = NULL;
        uint32_t stop = to;
        for (unsigned i = 0; i < slave->sync_managers; i++) {
            struct sync_manager *sm = &slave->sm[i];
            uint32_t end = (uint32_t)sm->start + sm->size;
            if (sm->write || !overlaps(sm, at, to))
                continue;
            if (sm->start <= at) {
                inside = sm;
                stop = end < to ? end : to;
                break;
            }
            stop = sm->start < stop ? sm->start : stop;
        }
        if (inside != NULL)
            write_inputs(slave, inside, at, stop, data + (at - from));
        else
            memcpy(slave->memory + at, data + (at - from), stop - at);
        at = stop;
    }
    return true;
}
