/* Random frames against the slave controllers, while the device side does what it may.
 *
 * usage: frames SEED FRAMES SLAVES [threads]
 *
 * With `threads` the device side runs in a thread of its own, else between the frames, so that
 * a run depends on its arguments only. Each frame lies in a buffer of exactly its size, so that the
 * address sanitizer sees every step beyond it. Prints what was reached, as JSON.
 */
#include "esc.h"
#include "frames.h"

#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum {
    MAIL = 128,
    IMAGE = 4096,
    EPOCH = 500, /* frames; then comes a new segment, for masters can cut one off for good */
    SET_UP_EVERY = 100,
    DEVICE_EVERY = 2,
    MAX_EVENTS = 16
};

static struct esc_segment *segment;
static unsigned slaves;
static atomic_bool stop;
static struct {
    unsigned long answered, refused, counted, mails_taken, mails_put, events;
    uint32_t event_bits;
} reached;

static void die(const char *what)
{
    fprintf(stderr, "frames: %s\n", what);
    abort();
}

/* --- the device side ---------------------------------------------------------------------- */

/* As a device does: it follows the master, and from SAFEOP on it has process data. */
static void follow(unsigned position)
{
    uint8_t control[2];
    uint32_t at = 32 * (position % (IMAGE / 32));
    struct esc_process_data where = {0x1100, 16, at, 0x1200, 16, at + 16};
    if (esc_read(segment, (int)position, 0x0120, control, 2) != 0)
        die("AL control cannot be read");
    unsigned state = control[0] & 0x0FU;
    (void)esc_map(segment, (int)position, state >= 4 ? &where : NULL);
    (void)esc_set_al_status(segment, (int)position, (uint16_t)state, 0);
}

static void wait_for_events(struct source *source)
{
    struct esc_event events[MAX_EVENTS];
    int count = esc_wait(segment, 0, events, 1 + (int)below(source, MAX_EVENTS));
    for (int i = 0; i < count; i++) {
        if (events[i].position >= slaves || events[i].bits == 0)
            die("an event of no slave");
        reached.event_bits |= events[i].bits;
        reached.events++;
        if ((events[i].bits & ESC_AL_CONTROL) != 0 && !one_in(source, 8))
            follow(events[i].position);
    }
}

static int any_slave(struct source *source)
{
    return one_in(source, 64) ? (int)below(source, 3000) - 1 : (int)below(source, slaves);
}

static void take_mail(struct source *source)
{
    uint8_t mail[MAIL];
    int size = esc_mailbox_take(segment, any_slave(source), mail, 1 + below(source, MAIL));
    if (size > MAIL)
        die("a mail larger than asked for");
    reached.mails_taken += size > 0;
}

static void put_mail(struct source *source)
{
    uint8_t mail[MAIL];
    fill(source, mail, sizeof mail);
    int put = esc_mailbox_put(segment, any_slave(source), mail, below(source, MAIL + 1),
                              one_in(source, 8));
    reached.mails_put += put > 0;
}

static void exchange_images(struct source *source)
{
    static uint8_t image[IMAGE];
    static int64_t now;
    size_t size = one_in(source, 16) ? below(source, IMAGE) : IMAGE;
    now += below(source, 100000000);
    (void)esc_get_outputs(segment, image, size, now);
    fill(source, image, 64);
    (void)esc_put_inputs(segment, image, size);
}

static void map(struct source *source)
{
    int slave = any_slave(source);
    struct esc_process_data where = {0x1100, 16, 32U * (uint32_t)slave,
                                     0x1200, 16, 32U * (uint32_t)slave + 16};
    if (one_in(source, 4))
        where.output_address = (uint16_t)draw(source);
    if (one_in(source, 4))
        where.input_size = (uint16_t)draw(source);
    (void)esc_map(segment, slave, one_in(source, 8) ? NULL : &where);
    (void)esc_await_outputs(segment, slave);
}

static void set_state(struct source *source)
{
    static const uint16_t states[] = {1, 2, 4, 8, 0x11, 0x12, 0x14};
    (void)esc_set_al_status(segment, any_slave(source), states[below(source, 7)],
                            (uint16_t)below(source, 0x40));
    (void)esc_lock_sync_manager(segment, any_slave(source), (int)below(source, 18) - 1,
                                one_in(source, 4));
}

static void touch_memory(struct source *source)
{
    uint8_t data[300];
    uint16_t address = (uint16_t)draw(source);
    (void)esc_read(segment, any_slave(source), address, data, below(source, sizeof data));
    fill(source, data, sizeof data);
    address = one_in(source, 8) ? (uint16_t)draw(source) : (uint16_t)(0x1000 + below(source, 0x400));
    (void)esc_write(segment, any_slave(source), address, data, below(source, sizeof data));
}

static void look(struct source *source)
{
    uint8_t image[600];
    struct esc_counters counters;
    (void)esc_sii(segment, any_slave(source), image, below(source, sizeof image));
    esc_get_counters(segment, &counters);
    fill(source, image, sizeof image);
    if (one_in(source, 32))
        (void)esc_set_sii(segment, any_slave(source), image, below(source, sizeof image));
    if (one_in(source, 64))
        esc_drop(segment, below(source, 3));
}

static void act(struct source *source)
{
    static void (*const actions[])(struct source *) = {
        wait_for_events, wait_for_events, take_mail, take_mail,    put_mail, put_mail,
        exchange_images, map,             set_state, touch_memory, look,
    };
    actions[below(source, sizeof actions / sizeof actions[0])](source);
}

static void *device_side(void *argument)
{
    struct source *source = argument;
    while (!atomic_load(&stop))
        act(source);
    return NULL;
}

/* --- the wire ----------------------------------------------------------------------------- */

static unsigned load16(const uint8_t *at) { return (unsigned)(at[0] | at[1] << 8); }

/* What no slave may change: where datagrams begin and end, their commands and indices. */
static void check(const uint8_t *before, const uint8_t *after, size_t size)
{
    if (memcmp(before, after, 6) != 0 || memcmp(before + 7, after + 7, 9) != 0 ||
        after[6] != (before[6] | 0x02))
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

static void send_one(const uint8_t *frame, size_t size)
{
    uint8_t *exact = malloc(size > 0 ? size : 1);
    if (exact == NULL)
        die("no memory");
    memcpy(exact, frame, size);
    int answered = esc_process(segment, exact, size);
    if (answered != 0 && answered != 1)
        die("neither answered nor refused");
    if (answered) {
        check(frame, exact, size);
        reached.answered++;
    } else {
        reached.refused++;
    }
    free(exact);
}

/* Takes all slaves to OP; without a thread the device side follows in between. Then the master is
 * silent for longer than the watchdogs allow. */
static void set_up(struct source *devices)
{
    static uint8_t frame[MAX_FRAME];
    for (unsigned step = 0; step < SET_UP_STEPS; step++)
        for (unsigned slave = 0; slave < slaves; slave++) {
            send_one(frame, set_up_frame(step, slave, frame));
            if (devices != NULL)
                wait_for_events(devices);
        }
    for (unsigned i = 0; devices != NULL && i < 8; i++)
        exchange_images(devices);
}

/* SII images of every kind: none, too short, random, and (half of them) with a right checksum,
 * without which the ESC does not let masters touch the process data. */
static void add_slave(struct source *source, unsigned number)
{
    static const uint8_t good[16] = {0x0C, 0x05, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0x5a, 0};
    static uint8_t image[4096];
    size_t size = number % 4 == 3 ? below(source, 32) : 64 + below(source, sizeof image - 64);
    fill(source, image, sizeof image);
    if (number % 4 < 2)
        memcpy(image, good, sizeof good);
    struct esc_config config = {.type = 0x11,
                                .fmmus = (uint8_t)(number % 5 == 4 ? below(source, 17) : 8),
                                .sync_managers = (uint8_t)(number % 7 == 6 ? below(source, 17) : 8),
                                .ram_kib = (uint8_t)(number % 3 == 2 ? 60 : 8),
                                .ports = 0x0F,
                                .dc_bits = number % 4 == 1 ? 32 : number % 4 == 2 ? 0 : 64,
                                .eeprom_bytes = number % 2 == 0 ? 8 : 4,
                                .eeprom_read_us = number % 3 == 1 ? 20 : 0,
                                .eeprom_write_us = number % 3 == 2 ? 50 : 0};
    if (esc_add_slave(segment, &config, image, size) != (int)number)
        die("a slave is not taken");
}

/* The life of one segment. */
static void epoch(struct source *wire, struct source *devices, unsigned long frames, bool threads)
{
    static uint8_t frame[MAX_FRAME];
    pthread_t thread;
    segment = esc_create();
    if (segment == NULL)
        die("no segment");
    for (unsigned i = 0; i < slaves; i++)
        add_slave(wire, i);
    atomic_store(&stop, false);
    if (threads && pthread_create(&thread, NULL, device_side, devices) != 0)
        die("no thread");
    for (unsigned long i = 0; i < frames; i++) {
        if (i % SET_UP_EVERY == 0)
            set_up(threads ? NULL : devices);
        send_one(frame, random_frame(wire, slaves, frame));
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
           "\"mails_put\": %lu, \"events\": %lu, \"event_bits\": %u}\n",
           reached.answered, reached.refused, reached.counted, reached.mails_taken,
           reached.mails_put, reached.events, (unsigned)reached.event_bits);
    return 0;
}
