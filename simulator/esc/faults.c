/* Faults of frames, chosen by cycle and by chance, and the same in every run. */
#include "slave.h"

#include <errno.h>

enum { MAX_CORRUPT_BITS = 8 * MAX_FRAME };

/* Returns a number that looks random but depends on the arguments only (splitmix64). */
static uint64_t draw(uint64_t seed, uint64_t cycle, uint64_t frame, uint64_t purpose)
{
    uint64_t words[] = {seed, cycle, frame, purpose}, z = 0;
    for (unsigned i = 0; i < 4; i++) {
        z += words[i] + UINT64_C(0x9E3779B97F4A7C15);
        z = (z ^ z >> 30) * UINT64_C(0xBF58476D1CE4E5B9);
        z = (z ^ z >> 27) * UINT64_C(0x94D049BB133111EB);
        z ^= z >> 31;
    }
    return z;
}

static bool spent(const struct esc_fault *settings)
{
    return settings->count > 0 && settings->struck >= settings->count;
}

/* Whether a fault strikes the current frame. Sets `place` to the place of the frame among those of
 * this cycle that the fault can strike. */
static bool strikes(struct esc_segment *segment, struct fault *fault, unsigned interface,
                    bool process_data, uint64_t *place)
{
    struct esc_fault *settings = &fault->settings;
    uint64_t cycle = segment->counters.cycles;
    bool wants = process_data || settings->process_data_only == 0;
    if (!wants || spent(settings) || cycle < settings->first ||
        (cycle - settings->first) % settings->every != 0)
        return false;
    if (settings->kind == ESC_FAULT_NOISE &&
        segment->route->first_port[settings->slave] == NO_PORT)
        return false; /* the frame does not reach that slave */
    if (fault->cycle != cycle) {
        fault->cycle = cycle;
        memset(fault->frames, 0, sizeof fault->frames);
    }
    *place = fault->frames[interface]++ * (uint64_t)INTERFACES + interface;
    double chance = (double)(draw(settings->seed, cycle, *place, 0) >> 11) / 9007199254740992.0;
    return chance < settings->probability;
}

/* Called before a frame is processed. */
struct strike faults_look(struct esc_segment *segment, unsigned interface, bool process_data)
{
    struct strike strike = {.copies = 1};
    for (unsigned i = 0; i < segment->fault_count; i++) {
        struct fault *fault = &segment->faults[i];
        struct esc_fault *settings = &fault->settings;
        uint64_t place = 0;
        if (!strikes(segment, fault, interface, process_data, &place))
            continue;
        settings->struck++;
        switch (settings->kind) {
        case ESC_FAULT_DROP:
            strike.drop |= settings->value == 0;
            strike.drop_answer |= settings->value != 0;
            break;
        case ESC_FAULT_DELAY:
            strike.delay_ns += settings->value;
            break;
        case ESC_FAULT_DUPLICATE:
            strike.copies = 2;
            break;
        case ESC_FAULT_CORRUPT:
            strike.corrupt_bits = settings->value > 0 ? (uint64_t)settings->value : 1;
            strike.corrupt_draw = draw(settings->seed, segment->counters.cycles, place, 1);
            break;
        case ESC_FAULT_NOISE:
            strike.noise = segment->slaves[settings->slave];
            break;
        default:
            strike.add_to_wkc += (unsigned)settings->value;
        }
    }
    return strike;
}

/* Called with an answer before it leaves. The Ethernet header stays as it is, so that the frame
 * arrives. */
void faults_damage(const struct strike *strike, uint8_t *frame, size_t size)
{
    if (strike->add_to_wkc != 0)
        frame_add_to_wkc(frame, size, strike->add_to_wkc);
    uint64_t bits = 8 * (size - ETHERNET_HEADER);
    for (uint64_t i = 0; i < strike->corrupt_bits && i < bits; i++) {
        uint64_t bit = (strike->corrupt_draw + i) % bits;
        frame[ETHERNET_HEADER + bit / 8] ^= (uint8_t)(1U << bit % 8);
    }
}

static bool valid(const struct esc_fault *fault)
{
    if (fault->kind > ESC_FAULT_WKC || fault->every == 0)
        return false;
    if (!(fault->probability >= 0.0 && fault->probability <= 1.0))
        return false;
    if (fault->kind == ESC_FAULT_DELAY)
        return fault->value >= 0 && fault->value <= ESC_MAX_DELAY_NS;
    return fault->kind != ESC_FAULT_CORRUPT ||
           (fault->value >= 0 && fault->value <= MAX_CORRUPT_BITS);
}

static void erase(struct esc_segment *segment, unsigned i)
{
    segment->fault_count--;
    memmove(&segment->faults[i], &segment->faults[i + 1],
            (segment->fault_count - i) * sizeof segment->faults[0]);
}

/* Makes room by forgetting the oldest fault that will not strike again. */
static void make_room(struct esc_segment *segment)
{
    for (unsigned i = 0; i < segment->fault_count; i++)
        if (spent(&segment->faults[i].settings)) {
            erase(segment, i);
            return;
        }
}

int esc_inject(struct esc_segment *segment, const struct esc_fault *fault)
{
    if (!valid(fault))
        return -EINVAL;
    int result = -ENOSPC;
    pthread_mutex_lock(&segment->lock);
    if (fault->kind == ESC_FAULT_NOISE && fault->slave >= segment->count) {
        result = -ENODEV;
    } else {
        if (segment->fault_count == ESC_MAX_FAULTS)
            make_room(segment);
        if (segment->fault_count < ESC_MAX_FAULTS) {
            struct fault *entry = &segment->faults[segment->fault_count++];
            *entry = (struct fault){.settings = *fault};
            entry->settings.struck = 0;
            result = entry->settings.id = ++segment->next_fault;
        }
    }
    pthread_mutex_unlock(&segment->lock);
    return result;
}

int esc_clear_faults(struct esc_segment *segment, int id)
{
    int result = id < 0 ? 0 : -ENOENT;
    pthread_mutex_lock(&segment->lock);
    if (id < 0)
        segment->fault_count = 0;
    for (unsigned i = 0; i < segment->fault_count; i++)
        if (segment->faults[i].settings.id == id) {
            erase(segment, i);
            result = 0;
            break;
        }
    pthread_mutex_unlock(&segment->lock);
    return result;
}

int esc_get_faults(struct esc_segment *segment, struct esc_fault *faults, int capacity)
{
    pthread_mutex_lock(&segment->lock);
    int count = (int)segment->fault_count;
    for (int i = 0; i < count && i < capacity; i++)
        faults[i] = segment->faults[i].settings;
    pthread_mutex_unlock(&segment->lock);
    return count;
}
