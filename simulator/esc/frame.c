/* EtherCAT frames and datagrams (ETG.1000.4, "DLPDU structure"): addresses, working counters. */
#include "slave.h"

#include <time.h>

enum command {
    CMD_NOP,
    CMD_APRD,
    CMD_APWR,
    CMD_APRW,
    CMD_FPRD,
    CMD_FPWR,
    CMD_FPRW,
    CMD_BRD,
    CMD_BWR,
    CMD_BRW,
    CMD_LRD,
    CMD_LWR,
    CMD_LRW,
    CMD_ARMW,
    CMD_FRMW
};

enum {
    FRAME_HEADER = ETHERNET_HEADER + 2,
    FRAME_TYPE_DATAGRAMS = 1,
    LENGTH_MASK = 0x07FF,
    MORE_FOLLOW = 0x8000,
    DATAGRAM_HEADER = 10,
    DATAGRAM_OVERHEAD = DATAGRAM_HEADER + 2,
    PROCESSED_MARK = 0x02, /* a slave sets this bit of the source address */
    MAX_DATA = LENGTH_MASK
};

static unsigned read_slave(struct slave *slave, uint16_t address, uint8_t *data, unsigned size)
{
    const uint8_t *memory = access_read(slave, address, size);
    if (memory == NULL)
        return 0;
    memcpy(data, memory, size);
    return 1;
}

static unsigned write_slave(struct slave *slave, uint16_t address, const uint8_t *data,
                            unsigned size)
{
    return access_write(slave, address, data, size) ? 1 : 0;
}

/* Returns the address that a read-write command writes: register 0x0108 is added to `address`. */
static uint16_t write_address(const struct slave *slave, uint16_t address)
{
    return (uint16_t)(address + load16(slave->memory + REG_RW_OFFSET));
}

/* Reads memory into the datagram, and writes the data that the datagram had. */
static unsigned swap_slave(struct slave *slave, uint16_t address, uint8_t *data, unsigned size)
{
    uint8_t before[MAX_DATA];
    unsigned count = read_slave(slave, address, before, size);
    unsigned written = write_slave(slave, write_address(slave, address), data, size);
    if (count > 0)
        memcpy(data, before, size);
    return count + 2 * written;
}

static bool can_read_and_write(const struct slave *slave)
{
    return (slave->config.features & FEATURE_NO_READ_WRITE) == 0;
}

static unsigned access_slave(struct slave *slave, uint16_t address, uint8_t *data, unsigned size,
                             bool read, bool write)
{
    if (read && write)
        return can_read_and_write(slave) ? swap_slave(slave, address, data, size) : 0;
    return read ? read_slave(slave, address, data, size) : write_slave(slave, address, data, size);
}

/* Broadcast reads collect the OR of all slaves in the datagram. */
static unsigned broadcast(struct esc_segment *segment, uint16_t address, uint8_t *data,
                          unsigned size, bool read, bool write)
{
    uint8_t written[MAX_DATA];
    unsigned count = 0;
    if (write)
        memcpy(written, data, size);
    const struct route *route = segment->route;
    for (unsigned i = 0; i < route->count; i++) {
        struct slave *slave = segment->slaves[route->order[i]];
        if (read && write && !can_read_and_write(slave))
            continue;
        if (read) {
            const uint8_t *memory = access_read(slave, address, size);
            if (memory != NULL) {
                for (unsigned k = 0; k < size; k++)
                    data[k] |= memory[k];
                count++;
            }
        }
        if (write) {
            uint16_t to = read ? write_address(slave, address) : address;
            count += write_slave(slave, to, written, size) * (read ? 2 : 1);
        }
    }
    return count;
}

static bool has_station(const struct esc_segment *segment, unsigned i, uint16_t station)
{
    return segment->station[i] == station || segment->alias[i] == station;
}

static unsigned by_station(struct esc_segment *segment, uint16_t station, uint16_t address,
                           uint8_t *data, unsigned size, bool read, bool write)
{
    const struct route *route = segment->route;
    unsigned count = 0;
    for (unsigned i = 0; i < route->count; i++)
        if (has_station(segment, route->order[i], station))
            count += access_slave(segment->slaves[route->order[i]], address, data, size, read,
                                  write);
    return count;
}

/* ARMW and FRMW: the addressed slave puts its data into the datagram, and all others write the data
 * of the datagram. Slaves before it on the wire therefore write the data that the master sent. */
static unsigned read_multiple_write(struct esc_segment *segment, unsigned key, bool by_position,
                                    uint16_t address, uint8_t *data, unsigned size)
{
    const struct route *route = segment->route;
    unsigned count = 0;
    for (unsigned i = 0; i < route->count; i++) {
        unsigned number = route->order[i];
        bool reads = by_position ? ((key + i) & 0xFFFF) == 0
                                 : has_station(segment, number, (uint16_t)key);
        count += access_slave(segment->slaves[number], address, data, size, reads, !reads);
    }
    return count;
}

static void datagram_process(struct esc_segment *segment, uint8_t *header, unsigned size)
{
    const struct route *route = segment->route;
    uint8_t *data = header + DATAGRAM_HEADER;
    uint16_t key = load16(header + 2);
    uint16_t address = load16(header + 4);
    unsigned command = header[0];
    unsigned position = (0x10000U - key) & 0xFFFF; /* auto-increment addresses count up to 0 */
    unsigned count = 0;
    bool increments = false;

    /* The IRQ field passes before the data, so it does not show effects of the data. */
    unsigned events = registers_event_word(segment);
    segment->latches_ports = command == CMD_BWR || command == CMD_FPWR;
    switch (command) {
    case CMD_APRD:
    case CMD_APWR:
    case CMD_APRW:
        increments = true;
        if (position < route->count)
            count = access_slave(segment->slaves[route->order[position]], address, data, size,
                                 command != CMD_APWR, command != CMD_APRD);
        break;
    case CMD_FPRD:
    case CMD_FPWR:
    case CMD_FPRW:
        count = by_station(segment, key, address, data, size, command != CMD_FPWR,
                           command != CMD_FPRD);
        break;
    case CMD_BRD:
    case CMD_BWR:
    case CMD_BRW:
        increments = true;
        count = broadcast(segment, address, data, size, command != CMD_BWR, command != CMD_BRD);
        break;
    case CMD_LRD:
    case CMD_LWR:
    case CMD_LRW:
        count = fmmu_access(segment, load32(header + 2), data, size, command != CMD_LWR,
                            command != CMD_LRD);
        break;
    case CMD_ARMW:
    case CMD_FRMW:
        increments = command == CMD_ARMW;
        count = read_multiple_write(segment, key, command == CMD_ARMW, address, data, size);
        break;
    default: /* NOP, and commands that do not exist: passed on untouched */
        return;
    }
    if (increments)
        store16(header + 2, key + route->count);
    store16(header + 8, load16(header + 8) | events);
    store16(data + size, load16(data + size) + count);
}

/* Iterates over the datagrams of a frame. `more` is false after the last one, and if the lengths
 * contradict each other; then `malformed` is true. */
struct cursor {
    uint8_t *datagram;
    unsigned length; /* of its data */
    bool more, malformed;
    uint8_t *next, *end;
    bool last;
};

static void advance(struct cursor *cursor)
{
    size_t left = (size_t)(cursor->end - cursor->next);
    cursor->more = !cursor->last && !cursor->malformed;
    if (!cursor->more)
        return;
    unsigned flags = left < DATAGRAM_OVERHEAD ? 0 : load16(cursor->next + 6);
    cursor->length = flags & LENGTH_MASK;
    if (left < DATAGRAM_OVERHEAD + (size_t)cursor->length) {
        cursor->malformed = true;
        cursor->more = false;
        return;
    }
    cursor->datagram = cursor->next;
    cursor->next += DATAGRAM_OVERHEAD + cursor->length;
    cursor->last = (flags & MORE_FOLLOW) == 0;
}

static struct cursor first_datagram(uint8_t *frame, size_t size)
{
    unsigned header = load16(frame + ETHERNET_HEADER);
    size_t length = header & LENGTH_MASK;
    struct cursor cursor = {.next = frame + FRAME_HEADER,
                            .end = frame + FRAME_HEADER + length,
                            .last = header >> 12 != FRAME_TYPE_DATAGRAMS,
                            .malformed = FRAME_HEADER + length > size};
    advance(&cursor);
    return cursor;
}

static bool is_logical(const uint8_t *datagram)
{
    return datagram[0] == CMD_LRD || datagram[0] == CMD_LWR || datagram[0] == CMD_LRW;
}

/* Whether the frame carries process data. Counts cycles by the process data frames of the first
 * interface. */
static bool look_for_process_data(struct esc_segment *segment, unsigned interface, uint8_t *frame,
                                  size_t size)
{
    for (struct cursor at = first_datagram(frame, size); at.more; advance(&at)) {
        if (!is_logical(at.datagram))
            continue;
        uint32_t address = load32(at.datagram + 2);
        if (interface == 0) {
            if (segment->counters.cycles == 0 || address <= segment->last_address)
                segment->counters.cycles++;
            segment->last_address = address;
        }
        return true;
    }
    return false;
}

static void process_datagrams(struct esc_segment *segment, uint8_t *frame, size_t size)
{
    struct cursor at = first_datagram(frame, size);
    for (; at.more; advance(&at))
        datagram_process(segment, at.datagram, at.length);
    if (at.malformed) {
        segment->counters.malformed++;
        ports_count_malformed(segment);
    }
    frame[6] |= PROCESSED_MARK;
}

void frame_add_to_wkc(uint8_t *frame, size_t size, unsigned value)
{
    for (struct cursor at = first_datagram(frame, size); at.more; advance(&at)) {
        uint8_t *counter = at.datagram + DATAGRAM_HEADER + at.length;
        if (is_logical(at.datagram))
            store16(counter, load16(counter) + value);
    }
}

static int process(struct esc_segment *segment, uint8_t *frame, size_t size)
{
    const struct route *route = segment->route;
    if (route->count > 0)
        process_datagrams(segment, frame, size);
    if (route->exit == LOST)
        topology_wake(segment, route);
    return route->exit;
}

/* The slaves behind the place where the frame was damaged ignore it, and so does the master. */
static int process_damaged(struct esc_segment *segment, struct slave *at, uint8_t *frame,
                           size_t size)
{
    const struct route *route = segment->route;
    struct route *whole = &segment->damaged;
    whole->count = route->before[at->position];
    whole->event_word_known = whole->collected = false;
    memcpy(whole->order, route->order, sizeof route->order);
    memcpy(whole->arrival, route->arrival, sizeof route->arrival);
    segment->route = whole;
    if (whole->count > 0)
        process_datagrams(segment, frame, size);
    ports_count_noise(segment, route, at);
    return LOST;
}

static int process_struck(struct esc_segment *segment, unsigned interface, bool process_data,
                          uint8_t *frame, size_t size, struct esc_passage *passage)
{
    struct strike strike = faults_look(segment, interface, process_data);
    if (strike.drop)
        return LOST;
    if (strike.noise != NULL)
        return process_damaged(segment, strike.noise, frame, size);
    passage->copies = strike.copies;
    passage->delay_ns = strike.delay_ns;
    int exit = process(segment, frame, size);
    faults_damage(&strike, frame, size);
    return strike.drop_answer ? LOST : exit;
}

/* Called with the lock held. */
void frame_process(struct esc_segment *segment, unsigned interface, uint8_t *frame, size_t size,
                   struct esc_passage *passage)
{
    *passage = (struct esc_passage){.exit = LOST, .copies = 1};
    if (size < FRAME_HEADER || (frame[12] << 8 | frame[13]) != ETHERTYPE_ECAT)
        return;
    topology_restore_loops(segment);
    if (segment->topology_stale)
        topology_update(segment);
    segment->route = &segment->routes[interface];
    bool process_data = look_for_process_data(segment, interface, frame, size);
    passage->exit = segment->fault_count == 0
                        ? process(segment, frame, size)
                        : process_struck(segment, interface, process_data, frame, size, passage);
    if (passage->exit == LOST)
        segment->counters.dropped++;
    else
        segment->counters.frames++;
}

int64_t clock_now_ns(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec * INT64_C(1000000000) + now.tv_nsec;
}

int64_t frame_time_ns(struct esc_segment *segment)
{
    if (segment->frame_ns == 0)
        segment->frame_ns = clock_now_ns();
    return segment->frame_ns;
}
