/* Random frames: wholly random ones, valid ones that masters might send, and mutations of these. */
#ifndef FUZZ_FRAMES_H
#define FUZZ_FRAMES_H

#include "random.h"

enum { MAX_FRAME = 2048 };

/* Makes a frame for a segment of `slaves`; returns its size. */
size_t random_frame(struct source *source, unsigned slaves, uint8_t *frame);

/* A frame that sets a slave up as masters do; `step` counts to SET_UP_STEPS. */
enum { SET_UP_STEPS = 8 };
size_t set_up_frame(unsigned step, unsigned slave, uint8_t *frame);

#endif
