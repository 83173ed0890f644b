/* Shared by the files of the driver: the segment under test, and what is done to it. */
#ifndef FUZZ_H
#define FUZZ_H

#include "esc.h"
#include "random.h"

#include <stdatomic.h>

enum { MAX_FRAME = 2048 };

extern struct esc_segment *segment;
extern unsigned slaves;
extern atomic_bool tampered; /* since a fault may change frames */
extern struct reached {
    unsigned long answered, refused, counted, mails_taken, mails_put, events, rewired, faults;
    uint32_t event_bits;
} reached;

_Noreturn void die(const char *what);

/* devices.c */
void act(struct source *source); /* something, anything */
void wait_for_events(struct source *source);
void exchange_images(struct source *source);

/* slaves.c */
void add_slaves(struct source *source);
void replace_slave(struct source *source, int slave);

/* grammar.c: wholly random frames, valid ones that masters might send, and mutations of these.
 *
 * Makes a frame; returns its size. */
size_t random_frame(struct source *source, uint8_t *frame);

/* A frame that sets a slave up as masters do; `step` counts to SET_UP_STEPS. */
enum { SET_UP_STEPS = 10 };
size_t set_up_frame(unsigned step, unsigned slave, uint8_t *frame);

#endif
