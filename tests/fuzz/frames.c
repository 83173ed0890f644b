/* Random frames against the slave controllers, while the device side does what it may.
 *
 * usage: frames SEED FRAMES SLAVES [threads]
 *
 * With `threads` the device side runs in a thread of its own, else between the frames, so that
 * a run depends on its arguments only. Each frame lies in a buffer of exactly its size, so that the
 * address sanitizer sees every step beyond it. Prints what was reached, as JSON.
 */
#include "fuzz.h"

#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum {
    EPOCH = 250, /* frames; then comes a new segment, for masters can cut one off for good */
    SET_UP_EVERY = 100,
    DEVICE_EVERY = 2
};

struct esc_segment *segment;
unsigned slaves;
struct reached reached;
atomic_bool tampered;
static atomic_bool stop;
static uint64_t digest = 0xCBF29CE484222325U; /* of all frames sent */

static void *device_side(void *argument)
{
    while (!atomic_load(&stop))
        act(argument);
    return NULL;
}

static unsigned load16(const uint8_t *at) { return (unsigned)(at[0] | at[1] << 8); }

/* What no slave may change: where datagrams begin and end, their commands and indices. */
static void check(const uint8_t *before, const uint8_t *after, size_t size)
{
    if (memcmp(before, after, 6) != 0 || memcmp(before + 7, after + 7, 9) != 0 ||
        (after[6] != (before[6] | 0x02) && after[6] != before[6]))
        die("the Ethernet header was changed");
    size_t end = 16 + (load16(before + 14) & 0x7FF);
    if (end > size || load16(before + 14) >> 12 != 1)
        return;
    bool more = true;
    for (size_t at = 16; more && end - at >= 12;) {
        unsigned flags = load16(before + at + 6), length = flags & 0x7FF;
        if (end - at < 12 + (size_t)length)
            return;
        if (memcmp(before + at, after + at, 2) != 0 || load16(after + at + 6) != flags)
            die("the header of a datagram was changed");
        unsigned was = load16(before + at + 10 + length), is = load16(after + at + 10 + length);
        if (((is - was) & 0xFFFF) > 3 * slaves)
            die("the working counter counts more than there are slaves");
        reached.counted += is != was;
        more = (flags & 0x8000) != 0;
        at += 12 + length;
    }
}

/* Most frames come by the first interface; in a ring they leave by the other one. */
static bool pass(struct source *source, uint8_t *frame, size_t size)
{
    struct esc_passage passage;
    if (one_in(source, 8))
        return esc_process(segment, frame, size) == 1;
    if (esc_pass(segment, one_in(source, 8), frame, size, 0, &passage) < 0)
        die("a frame is not taken");
    if (passage.exit < -1 || passage.exit > 1 || passage.delay_ns < 0)
        die("a frame leaves where there is no way out");
    if (passage.exit >= 0 && passage.copies != 1 && passage.copies != 2)
        die("a frame leaves neither once nor twice");
    return passage.exit >= 0;
}

static void send_one(struct source *source, const uint8_t *frame, size_t size)
{
    uint8_t *exact = malloc(size > 0 ? size : 1);
    if (exact == NULL)
        die("no memory");
    memcpy(exact, frame, size);
    for (size_t i = 0; i < size; i++) /* FNV-1a */
        digest = (digest ^ frame[i]) * 0x100000001B3U;
    if (pass(source, exact, size)) {
        if (!atomic_load(&tampered))
            check(frame, exact, size);
        reached.answered++;
    } else {
        reached.refused++;
    }
    free(exact);
}

/* Takes all slaves to OP; without a thread the device side follows in between. Then the master is
 * silent for longer than the watchdogs allow. */
static void set_up(struct source *wire, struct source *devices)
{
    static uint8_t frame[MAX_FRAME];
    for (unsigned step = 0; step < SET_UP_STEPS; step++)
        for (unsigned slave = 0; slave < slaves; slave++) {
            send_one(wire, frame, set_up_frame(step, slave, frame));
            if (devices != NULL)
                wait_for_events(devices);
        }
    for (unsigned i = 0; devices != NULL && i < 8; i++)
        exchange_images(devices);
}

/* The life of one segment. */
static void epoch(struct source *wire, struct source *devices, unsigned long frames, bool threads)
{
    static uint8_t frame[MAX_FRAME];
    pthread_t thread;
    segment = esc_create();
    if (segment == NULL)
        die("no segment");
    add_slaves(wire);
    atomic_store(&stop, false);
    atomic_store(&tampered, false);
    if (threads && pthread_create(&thread, NULL, device_side, devices) != 0)
        die("no thread");
    for (unsigned long i = 0; i < frames; i++) {
        if (i % SET_UP_EVERY == 0)
            set_up(wire, threads ? NULL : devices);
        send_one(wire, frame, random_frame(wire, frame));
        if (!threads && one_in(wire, DEVICE_EVERY))
            act(devices);
    }
    atomic_store(&stop, true);
    if (threads)
        pthread_join(thread, NULL);
    esc_destroy(segment);
}

int main(int count, char **arguments)
{
    if (count < 4) {
        fprintf(stderr, "usage: frames SEED FRAMES SLAVES [threads]\n");
        return 2;
    }
    uint64_t seed = strtoull(arguments[1], NULL, 0);
    unsigned long frames = strtoul(arguments[2], NULL, 0);
    slaves = (unsigned)strtoul(arguments[3], NULL, 0);
    bool threads = count > 4;
    struct source wire = source_from(seed), devices = source_from(seed + 1);
    for (unsigned long done = 0; done < frames; done += EPOCH)
        epoch(&wire, &devices, frames - done < EPOCH ? frames - done : EPOCH, threads);
    printf("{\"answered\": %lu, \"refused\": %lu, \"counted\": %lu, \"mails_taken\": %lu, "
           "\"mails_put\": %lu, \"events\": %lu, \"rewired\": %lu, \"faults\": %lu, "
           "\"event_bits\": %u, \"digest\": %llu}\n",
           reached.answered, reached.refused, reached.counted, reached.mails_taken,
           reached.mails_put, reached.events, reached.rewired, reached.faults,
           (unsigned)reached.event_bits, (unsigned long long)digest);
    return 0;
}
