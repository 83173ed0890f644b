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
    ETHERNET_HEADER = 14,
    ETHERTYPE = 0x88A4,
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

/* Reads into the datagram what was there before the datagram's data are written. */
static unsigned swap_slave(struct slave *slave, uint16_t address, uint8_t *data, unsigned size)
{
    uint8_t before[MAX_DATA];
    unsigned count = read_slave(slave, address, before, size);
    unsigned written = write_slave(slave, address, data, size);
    if (count > 0)
        memcpy(data, before, size);
    return count + 2 * written;
}

static unsigned access_slave(struct slave *slave, uint16_t address, uint8_t *data, unsigned size,
                             bool read, bool write)
{
    if (read && write)
        return swap_slave(slave, address, data, size);
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
        if (read) {
            const uint8_t *memory = access_read(slave, address, size);
            if (memory != NULL) {
                for (unsigned k = 0; k < size; k++)
                    data[k] |= memory[k];
                count++;
            }
        }
        if (write)
            count += write_slave(slave, address, written, size) * (read ? 2 : 1);
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

/* ARMW and FRMW: the addressed slave reads, all others write what it read. Those before it on the
 * wire write what the master sent. */
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

    /* The events pass before the data, so they do not know yet what the data will do. */
    unsigned events = registers_event_word(segment);
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

static void process_datagrams(struct esc_segment *segment, uint8_t *frame, size_t size)
{
    unsigned header = load16(frame + ETHERNET_HEADER);
    size_t end = FRAME_HEADER + (header & LENGTH_MASK);
    bool more = header >> 12 == FRAME_TYPE_DATAGRAMS;
    if (end > size) {
        segment->counters.malformed++;
        more = false;
    }
    for (size_t at = FRAME_HEADER; more;) {
        unsigned flags = end - at < DATAGRAM_OVERHEAD ? 0 : load16(frame + at + 6);
        unsigned length = flags & LENGTH_MASK;
        if (end - at < DATAGRAM_OVERHEAD + (size_t)length) {
            segment->counters.malformed++;
            break;
        }
        datagram_process(segment, frame + at, length);
        at += DATAGRAM_OVERHEAD + length;
        more = (flags & MORE_FOLLOW) != 0;
    }
    frame[6] |= PROCESSED_MARK;
}

int frame_process(struct esc_segment *segment, unsigned interface, uint8_t *frame, size_t size)
{
    if (size < FRAME_HEADER || (frame[12] << 8 | frame[13]) != ETHERTYPE)
        return LOST;
    if (segment->topology_stale)
        topology_update(segment);
    const struct route *route = &segment->routes[interface];
    segment->route = &segment->routes[interface];
    segment->frame_ns = 0;
    if (segment->drop > 0) {
        segment->drop--;
        segment->counters.dropped++;
        return LOST;
    }
    if (route->count > 0)
        process_datagrams(segment, frame, size);
    if (route->exit == LOST)
        segment->counters.dropped++;
    else
        segment->counters.frames++;
    return route->exit;
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
