/* What the device side of a segment may do at any time, at random. */
#include "fuzz.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { MAIL = 128, IMAGE = 4096, MAX_EVENTS = 16, MAX_ORDER = 64 };

void die(const char *what)
{
    fprintf(stderr, "frames: %s\n", what);
    abort();
}

/* As a device does: it follows the master, and from SAFEOP on it has process data. */
static void follow(unsigned position)
{
    uint8_t control[2];
    uint32_t at = 32 * (position % (IMAGE / 32));
    struct esc_area where[] = {{0x1100, 16, at, 1}, {0x1200, 16, at + 16, 0}};
    if (esc_read(segment, (int)position, 0x0120, control, 2) != 0)
        die("AL control cannot be read");
    unsigned state = control[0] & 0x0FU;
    (void)esc_map(segment, (int)position, where, state >= 4 ? 2 : 0);
    (void)esc_set_al_status(segment, (int)position, (uint16_t)state, 0);
}

void wait_for_events(struct source *source)
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

void exchange_images(struct source *source)
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
    uint32_t at = 32U * (uint32_t)slave;
    struct esc_area where[] = {
        {0x1100, 16, at, 1}, {0x1200, 16, at + 16, 0}, {0x1300, 4, at + 8, one_in(source, 2)}};
    if (one_in(source, 4))
        where[0].address = (uint16_t)draw(source);
    if (one_in(source, 4))
        where[1].size = (uint16_t)draw(source);
    (void)esc_map(segment, slave, where, below(source, 4));
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
    (void)esc_peek(segment, any_slave(source), (uint16_t)draw(source), image, below(source, 600));
    uint16_t order[MAX_ORDER];
    (void)esc_order(segment, (int)below(source, 2), order, 1 + (int)below(source, MAX_ORDER));
}

static void tell_time(struct source *source)
{
    struct esc_clock clocks[8];
    static const uint8_t all[4] = {0xFF, 0xFF, 0xFF, 0xFF};
    int slave = any_slave(source);
    (void)esc_write(segment, slave, 0x0204, all, sizeof all); /* every event interrupts */
    double drift = (double)below(source, 2000) - 1000;
    int64_t offset = (int64_t)((uint64_t)draw(source) << below(source, 33));
    if (one_in(source, 4))
        (void)esc_set_clock(segment, slave, one_in(source, 2) ? &drift : NULL,
                            one_in(source, 2) ? &offset : NULL);
    if (one_in(source, 4))
        (void)esc_step_clock(segment, slave, offset);
    (void)esc_clocks(segment, clocks, (int)below(source, 9));
    (void)esc_latch(segment, slave, (int)below(source, 3), (int)below(source, 2));
}

/* Links, rings and power; most of it is put right again, or little would be left to test. */
static void rewire(struct source *source)
{
    if (!one_in(source, 8))
        return;
    int slave = any_slave(source), port = (int)below(source, 4);
    switch (below(source, 8)) {
    case 0:
        (void)esc_connect(segment, slave, any_slave(source), port);
        break;
    case 1:
        (void)esc_close_ring(segment, slave, port);
        break;
    case 2:
    case 3:
        (void)esc_break_link(segment, slave, port, one_in(source, 4));
        break;
    case 4:
        replace_slave(source, slave);
        break;
    default:
        (void)esc_power(segment, slave, !one_in(source, 4));
    }
    reached.rewired++;
}

/* Once a fault may change what comes back, nobody can say what must not have changed. */
static void inject(struct source *source)
{
    struct esc_fault fault = {.kind = below(source, 7),
                              .first = below(source, 50),
                              .every = 1 + below(source, 5),
                              .count = below(source, 20),
                              .probability = one_in(source, 2) ? 1.0 : 0.3,
                              .seed = draw(source),
                              .value = below(source, 40),
                              .slave = below(source, slaves + 1),
                              .process_data_only = below(source, 2)};
    struct esc_fault found[4];
    if (!one_in(source, 8))
        return;
    if (fault.kind == ESC_FAULT_CORRUPT || fault.kind == ESC_FAULT_WKC)
        atomic_store(&tampered, true);
    if (fault.kind == ESC_FAULT_DROP && !one_in(source, 4))
        fault.count = 1 + below(source, 3);
    int id = esc_inject(segment, &fault);
    if (esc_get_faults(segment, found, (int)below(source, 5)) > ESC_MAX_FAULTS)
        die("more faults than there may be");
    if (id > 0)
        reached.faults++;
    if (one_in(source, 2))
        (void)esc_clear_faults(segment, one_in(source, 8) ? -1 : id);
}

void act(struct source *source)
{
    static void (*const actions[])(struct source *) = {
        wait_for_events, wait_for_events, take_mail, take_mail,    put_mail, put_mail,
        exchange_images, map,             set_state, touch_memory, look,     look,
        look,            wait_for_events, rewire,    inject,
        tell_time,
    };
    actions[below(source, sizeof actions / sizeof actions[0])](source);
}
