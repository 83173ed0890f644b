/* Logical addressing: the FMMUs (registers 0x0600 upward) map logical bits to physical memory.
 *
 * The restrictions are those of the ESC data sheet, section I, "Restrictions on FMMU settings" and
 * the text after it. The data sheet does not say what a chip does with a forbidden FMMU. Here it is
 * ignored, so that the working counter shows the mistake.
 */
#include "slave.h"

#include <errno.h>

enum { TYPE_READ = 1, TYPE_WRITE = 2, ACTIVATE = 1, FREE_BYTES = 3, MAX_DATA = 0x07FF };

/* Returns the buffered sync manager that contains all of [from, to), if no other channel overlaps
 * it; else NULL. */
static struct sync_manager *only_buffer(struct slave *slave, uint32_t from, uint32_t to, bool write)
{
    struct sync_manager *found = NULL;
    for (unsigned i = 0; i < slave->sync_managers; i++) {
        struct sync_manager *sm = &slave->sm[i];
        uint32_t end = (uint32_t)sm->start + sm->size;
        if (sm->size == 0 || from >= end || to <= sm->start)
            continue;
        if (found != NULL || sm->mailbox || sm->locked || sm->write != write || from < sm->start ||
            to > end)
            return NULL;
        found = sm;
    }
    bool loaded = (slave->memory[REG_DL_STATUS] & DL_PDI_OPERATIONAL) != 0;
    return from >= REG_RAM && loaded && !slave->protected ? found : NULL;
}

static void decode(struct slave *slave, const uint8_t *reg, struct fmmu *fmmu)
{
    uint32_t size = load16(reg + 4);
    uint8_t type = reg[11];
    fmmu->start = load32(reg);
    fmmu->end = fmmu->start + size < fmmu->start ? UINT32_MAX : fmmu->start + size;
    bool bits = (slave->config.features & FEATURE_BYTE_FMMUS) == 0; /* else whole bytes */
    fmmu->first_bit = bits ? reg[6] & 7 : 0;
    fmmu->last_bit = bits ? reg[7] & 7 : 7;
    fmmu->address = load16(reg + 8);
    fmmu->physical_bit = bits ? reg[10] & 7 : 0;
    fmmu->contested = false;
    fmmu->read = (type & TYPE_READ) != 0;
    fmmu->write = (type & TYPE_WRITE) != 0;
    fmmu->aligned = fmmu->first_bit == 0 && fmmu->last_bit == 7 && fmmu->physical_bit == 0;
    fmmu->slave = slave;
    fmmu->fast = NULL;
    if (fmmu->aligned && fmmu->read != fmmu->write && fmmu->address + size <= slave->ram_end)
        fmmu->fast = only_buffer(slave, fmmu->address, fmmu->address + size, fmmu->write);
}

static bool share_direction(const struct fmmu *a, const struct fmmu *b)
{
    return (a->read && b->read) || (a->write && b->write);
}

/* Whether fewer than `bytes` bytes are between two windows; with 0, whether they overlap. */
static bool are_closer(const struct fmmu *a, const struct fmmu *b, uint32_t bytes)
{
    const struct fmmu *low = a->start <= b->start ? a : b, *high = low == a ? b : a;
    return high->start < (uint64_t)low->end + bytes;
}

/* Decodes the active FMMUs of a slave, except those that its chip does not allow. Returns a bit for
 * each FMMU that is left out. */
static unsigned decode_all(struct slave *slave, struct fmmu *fmmus, unsigned *count)
{
    unsigned numbers[ESC_MAX_CHANNELS], found = 0, refused = 0;
    for (unsigned k = 0; k < slave->fmmus; k++) {
        const uint8_t *reg = slave->memory + REG_FMMU + 16 * k;
        if ((reg[12] & ACTIVATE) == 0 || load16(reg + 4) == 0)
            continue;
        decode(slave, reg, &fmmus[found]);
        numbers[found++] = k;
    }
    for (unsigned i = 0; i < found; i++) {
        for (unsigned k = i + 1; k < found; k++) {
            if (!share_direction(&fmmus[i], &fmmus[k]))
                continue;
            if (!(fmmus[i].aligned && fmmus[k].aligned) &&
                are_closer(&fmmus[i], &fmmus[k], FREE_BYTES))
                refused |= 1U << numbers[i] | 1U << numbers[k];
            else
                fmmus[k].contested |= are_closer(&fmmus[i], &fmmus[k], 0);
        }
    }
    *count = 0;
    for (unsigned i = 0; i < found; i++)
        if ((refused >> numbers[i] & 1) == 0)
            fmmus[(*count)++] = fmmus[i];
    return refused;
}

int esc_refused_fmmus(struct esc_segment *segment, int position)
{
    struct fmmu fmmus[ESC_MAX_CHANNELS];
    unsigned count;
    int result = -ENODEV;
    pthread_mutex_lock(&segment->lock);
    if (position >= 0 && (unsigned)position < segment->count)
        result = (int)decode_all(segment->slaves[position], fmmus, &count);
    pthread_mutex_unlock(&segment->lock);
    return result;
}

/* Collects the active FMMUs of the slaves on a route, in the order in which a frame passes them. */
static void collect(struct esc_segment *segment, struct route *route)
{
    route->active_count = 0;
    for (unsigned i = 0; i < route->count; i++) {
        unsigned count;
        (void)decode_all(segment->slaves[route->order[i]], route->active + route->active_count,
                         &count);
        route->active_count += count;
    }
    route->collected = true;
}

/* The part of an FMMU that a datagram covers: logical bits [first, last], counted from bit 0 of the
 * first byte of its window. */
struct span {
    uint32_t first, last;
    uint32_t physical;     /* physical bit (from address 0) that belongs to `first` */
    uint32_t datagram_bit; /* bit of the datagram's data that belongs to `first` */
};

static bool clip(const struct fmmu *fmmu, uint32_t from, uint32_t to, uint32_t address,
                 struct span *span)
{
    uint32_t window_last = (fmmu->end - 1 - fmmu->start) * 8 + fmmu->last_bit;
    span->first = (from - fmmu->start) * 8;
    span->last = (to - 1 - fmmu->start) * 8 + 7;
    if (span->first < fmmu->first_bit)
        span->first = fmmu->first_bit;
    if (span->last > window_last)
        span->last = window_last;
    if (span->first > span->last)
        return false;
    span->physical = fmmu->address * 8U + fmmu->physical_bit + span->first - fmmu->first_bit;
    span->datagram_bit = span->first - (address - fmmu->start) * 8;
    return true;
}

static void copy_bit(uint8_t *to, uint32_t to_bit, const uint8_t *from, uint32_t from_bit)
{
    uint8_t mask = (uint8_t)(1U << (to_bit & 7));
    if (from[from_bit >> 3] & 1U << (from_bit & 7))
        to[to_bit >> 3] |= mask;
    else
        to[to_bit >> 3] &= (uint8_t)~mask;
}

/* Accesses any memory at any alignment: merges bits into whole bytes, and accesses these as
 * physical memory. Only digital outputs are written bit by bit. In all other written bytes, the
 * values of bits that are not mapped are undefined. They become ones here, so that they cannot
 * be mistaken for values of the master or the device. */
static bool access_bits(const struct fmmu *fmmu, const struct span *span, uint8_t *data, bool write)
{
    struct slave *slave = fmmu->slave;
    uint32_t from = span->physical / 8;
    uint32_t bits = span->last - span->first + 1;
    uint32_t to = (span->physical + bits + 7) / 8;
    uint32_t shift = span->physical - from * 8;
    if (to > slave->ram_end)
        return false;
    if (write) {
        uint8_t merged[0x800 + 1];
        if (from >= REG_DIGITAL_OUTPUT && to <= REG_DIGITAL_OUTPUT_END)
            memcpy(merged, slave->memory + from, to - from);
        else
            memset(merged, 0xFF, to - from);
        for (uint32_t i = 0; i < bits; i++)
            copy_bit(merged, shift + i, data, span->datagram_bit + i);
        return access_write(slave, (uint16_t)from, merged, to - from);
    }
    const uint8_t *memory = access_read(slave, (uint16_t)from, to - from);
    for (uint32_t i = 0; memory != NULL && i < bits; i++)
        copy_bit(data, span->datagram_bit + i, memory, shift + i);
    return memory != NULL;
}

/* Accesses the logical bytes [from, to) of an FMMU, all of which are in the datagram. */
static bool access_window(const struct fmmu *fmmu, uint32_t address, uint8_t *data, uint32_t from,
                          uint32_t to, bool write)
{
    if (fmmu->fast != NULL) {
        struct slave *slave = fmmu->slave;
        struct sync_manager *sm = fmmu->fast;
        uint32_t physical = fmmu->address + (from - fmmu->start);
        uint8_t *memory = slave->memory + physical;
        if (physical == sm->start && to - from == sm->size) { /* the usual case: a whole buffer */
            if (write) {
                memcpy(memory, data + (from - address), to - from);
                sm_written(slave, sm);
            } else {
                if (!sm->open)
                    sm_begin_read(slave, sm);
                memcpy(data + (from - address), memory, to - from);
                sm_read(slave, sm);
            }
            return true;
        }
    }
    struct span span;
    return clip(fmmu, from, to, address, &span) && access_bits(fmmu, &span, data, write);
}

/* The same if FMMUs with lower numbers (from `first` on) map some of these bytes: each logical byte
 * belongs to the first FMMU that maps it. */
static bool access_rest(const struct fmmu *first, const struct fmmu *fmmu, uint32_t address,
                        uint8_t *data, uint32_t from, uint32_t to, bool write)
{
    bool any = false;
    while (from < to) {
        uint32_t end = to;
        bool taken = false;
        for (const struct fmmu *other = first; other < fmmu; other++) {
            if (!(write ? other->write : other->read) || other->end <= from || other->start >= end)
                continue;
            taken = other->start <= from;
            end = !taken ? other->start : other->end < end ? other->end : end;
            if (taken)
                break;
        }
        if (!taken)
            any |= access_window(fmmu, address, data, from, end, write);
        from = end;
    }
    return any;
}

static bool access_channel(const struct fmmu *first, const struct fmmu *fmmu, uint32_t address,
                           uint8_t *data, uint32_t end, bool write)
{
    uint32_t from = address > fmmu->start ? address : fmmu->start;
    uint32_t to = end < fmmu->end ? end : fmmu->end;
    if (fmmu->contested)
        return access_rest(first, fmmu, address, data, from, to, write);
    return access_window(fmmu, address, data, from, to, write);
}

/* Finds the first FMMU that a datagram concerns, and the end of the last one. The memory that they
 * need may be in the cache of another processor, on which the device side runs. Prefetching all of
 * it makes the frame wait once, instead of once for each slave. */
static void find(const struct route *route, uint32_t address, uint32_t end,
                 const struct fmmu **first, const struct fmmu **last)
{
    const struct fmmu *stop = route->active + route->active_count;
    *first = *last = stop;
    for (const struct fmmu *fmmu = route->active; fmmu < stop; fmmu++) {
        if (fmmu->start >= end || address >= fmmu->end)
            continue;
        if (*first == stop)
            *first = fmmu;
        *last = fmmu + 1;
        if (fmmu->fast != NULL) {
            __builtin_prefetch(fmmu->slave->memory + fmmu->address, 1);
            __builtin_prefetch(fmmu->fast, 1);
            __builtin_prefetch(&fmmu->slave->fed, 1);
        }
    }
}

/* The windows of FMMUs that read and write return what the memory had before this datagram, as the
 * other commands that read and write do. Their data goes into `before`. */
static bool read_both(const struct fmmu *first, const struct fmmu *last, uint32_t address,
                      uint8_t *before, uint32_t end)
{
    bool any = false;
    for (const struct fmmu *fmmu = first; fmmu < last && fmmu->slave == first->slave; fmmu++)
        if (fmmu->read && fmmu->write && fmmu->start < end && address < fmmu->end)
            any |= access_channel(first, fmmu, address, before, end, false);
    return any;
}

static bool has_both(const struct fmmu *first, const struct fmmu *last)
{
    for (const struct fmmu *fmmu = first; fmmu < last && fmmu->slave == first->slave; fmmu++)
        if (fmmu->read && fmmu->write)
            return true;
    return false;
}

/* Each slave first takes the data that the master sent, and then puts its own data into the
 * datagram, since both of its windows may have the same logical bytes. The working counter counts
 * each direction of a slave once. */
unsigned fmmu_access(struct esc_segment *segment, uint32_t address, uint8_t *data, unsigned size,
                     bool read, bool write)
{
    unsigned count = 0;
    uint8_t before[MAX_DATA];
    uint32_t end = address + size < address ? UINT32_MAX : address + size;
    struct route *route = segment->route;
    if (segment->fmmus_changed) {
        for (unsigned i = 0; i < INTERFACES; i++)
            segment->routes[i].collected = false;
        segment->fmmus_changed = false;
    }
    if (!route->collected)
        collect(segment, route);
    const struct fmmu *fmmu, *last;
    find(route, address, end, &fmmu, &last);
    while (fmmu < last) {
        const struct slave *slave = fmmu->slave;
        const struct fmmu *first = fmmu;
        bool written = false, was_read = false, both = read && write && has_both(first, last);
        if (read && write && (slave->config.features & FEATURE_NO_LRW) != 0) {
            while (fmmu < last && fmmu->slave == slave)
                fmmu++;
            continue;
        }
        if (both) {
            memcpy(before, data, size);
            was_read = read_both(first, last, address, before, end);
        }
        for (; fmmu < last && fmmu->slave == slave; fmmu++)
            if (write && fmmu->write && fmmu->start < end && address < fmmu->end)
                written |= access_channel(first, fmmu, address, data, end, true);
        if (both)
            memcpy(data, before, size);
        if (read)
            for (fmmu = first; fmmu < last && fmmu->slave == slave; fmmu++)
                if (fmmu->read && !(both && fmmu->write) && fmmu->start < end && address < fmmu->end)
                    was_read |= access_channel(first, fmmu, address, data, end, false);
        count += (unsigned)was_read + (unsigned)written * (read ? 2U : 1U);
    }
    return count;
}
