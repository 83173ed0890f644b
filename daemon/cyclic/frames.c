/* Frames: their layout, their contents, and the data that they bring back.
 *
 * The first datagram of a cycle is a broadcast read of the AL status. It needs no separate frame, and
 * its working counter is the number of slaves. With distributed clocks, the second datagram reads the
 * reference clock, and all slaves behind this clock take its time over (FRMW). The datagrams of the
 * domains that are due follow, in as few frames as their order allows. The layout changes only when
 * other domains are due than in the cycle before. Otherwise only indices, time and outputs are written.
 *
 * The outputs or inputs of a slave that do not fit into one datagram are a split: several datagrams, in
 * the order of their bytes. The inputs are taken over when all pieces have come back in one cycle. If
 * outputs are split, the datagrams with the last byte of a sync manager leave in frames of a second turn.
 */
#include "engine.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>

enum { NOP = 0, BRD = 7, FRMW = 14, AL_STATUS = 0x0130, SYSTEM_TIME = 0x0910, MORE = 0x8000 };

static void describe(struct datagram *d, int kind, int command, uint32_t address, uint32_t length) {
  memset(d, 0, sizeof *d);
  d->kind = (uint8_t)kind;
  d->length = length;
  d->header[0] = (uint8_t)command;
  put32(d->header + 2, address);
  put16(d->header + 6, length);
}

void cyclic_frames_init(cyclic_t *c) {
  describe(&c->datagram[0], STATUS_DATAGRAM, BRD, AL_STATUS << 16, STATUS_BYTES);
  c->datagram[0].wkc_expected = c->header->slave_count;
  c->datagrams = 1;
}

/* Makes a datagram the next piece of a split; its first piece begins the split. */
static int add_piece(cyclic_t *c, struct datagram *d, uint32_t number, int closes) {
  struct split *split = &c->split[number - 1];
  uint32_t length = split->length + d->length;
  uint8_t *inputs = NULL;
  if (number > c->splits + 1 || (d->outputs != 0 && d->outputs != d->length)) return -EINVAL;
  if (split->pieces > 0 &&
      (split->domain != d->domain || split->offset + split->length != d->offset))
    return -EINVAL;
  if (d->outputs == 0 && (inputs = realloc(split->inputs, length)) == NULL) return -ENOMEM;
  if (split->pieces++ == 0) {
    c->splits = number;
    split->domain = d->domain;
    split->offset = d->offset;
  }
  split->inputs = inputs;
  split->length = length;
  split->opening += !closes;
  c->closing += closes != 0;
  d->split = number;
  d->closes = closes;
  return 0;
}

int cyclic_add_datagram(cyclic_t *c, uint32_t domain, int command, uint32_t address,
                        uint32_t offset, uint32_t length, uint32_t wkc_expected, int group,
                        uint32_t split, int closes) {
  struct datagram *d = &c->datagram[c->datagrams];
  uint32_t output_bytes;
  if (domain >= c->domains || group >= ECAT_MAX_GROUPS || length == 0 || length > DOMAIN_DATAGRAM_MAX ||
      offset > c->domain[domain].image_bytes || length > c->domain[domain].image_bytes - offset ||
      split > MAX_SPLITS)
    return -EINVAL;
  if (c->datagrams == MAX_DATAGRAMS - 1) return -ENOSPC; /* one for the clock */
  output_bytes = c->domain[domain].output_bytes;
  describe(d, DOMAIN_DATAGRAM, command, address + offset, length);
  d->domain = domain;
  d->offset = offset;
  d->outputs = offset >= output_bytes           ? 0
               : length < output_bytes - offset ? length
                                                : output_bytes - offset;
  d->wkc_expected = wkc_expected;
  d->group = group < 0 ? 0 : (uint64_t)1 << group;
  if (split > 0) {
    int code = add_piece(c, d, split, closes);
    if (code != 0) return code;
  }
  c->datagrams++;
  return 0;
}

void cyclic_frames_free(cyclic_t *c) {
  uint32_t i;
  for (i = 0; i < c->splits; i++) free(c->split[i].inputs);
}

void cyclic_set_clock(cyclic_t *c, const cyclic_clock *clock) {
  struct datagram *d = &c->datagram[1];
  memmove(d + 1, d, (c->datagrams - 1) * sizeof *d);
  describe(d, TIME_DATAGRAM, FRMW, (clock->address & 0xFFFF) | SYSTEM_TIME << 16, TIME_BYTES);
  c->datagrams++;
  c->clock.enabled = 1;
  c->clock.phase_ns = clock->phase_ns;
  c->clock.lock_ns = clock->lock_ns;
  c->clock.state = c->clock.told_state = ECAT_DC_LOCKING;
  c->health->dc_state = ECAT_DC_LOCKING;
  c->health->dc_reference = clock->position;
}

static int is_due(const cyclic_t *c, const struct datagram *d) {
  return d->kind != DOMAIN_DATAGRAM || (c->due >> d->domain & 1);
}

static void begin_frame(cyclic_t *c, struct frame *frame, uint32_t first) {
  static const uint8_t broadcast[6] = {0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF};
  memset(frame, 0, sizeof *frame);
  memcpy(frame->bytes, broadcast, sizeof broadcast);
  memcpy(frame->bytes + 6, c->source, sizeof c->source);
  frame->bytes[12] = ETHERTYPE >> 8;
  frame->bytes[13] = ETHERTYPE & 0xFF;
  frame->first = first;
  frame->length = FIRST_DATAGRAM;
}

static void end_frame(struct frame *frame) {
  put16(frame->bytes + ETHERNET_HEADER, (frame->length - FIRST_DATAGRAM) | 0x1000u);
  if (frame->length < ETHERNET_MIN) frame->length = ETHERNET_MIN;
}

/* Whether a datagram still fits into a frame with this many bytes of datagrams. */
static int has_room(uint32_t payload, const struct datagram *d) {
  return payload + d->length + DATAGRAM_FRAMING <= PAYLOAD_MAX;
}

static uint32_t frames_of_turn(const cyclic_t *c, int closes) {
  uint32_t i, frames = 0, payload = PAYLOAD_MAX;
  for (i = 0; i < c->datagrams; i++) {
    if (c->datagram[i].closes != closes) continue;
    if (!has_room(payload, &c->datagram[i])) frames++, payload = 0;
    payload += c->datagram[i].length + DATAGRAM_FRAMING;
  }
  return frames;
}

int cyclic_frames_fit(const cyclic_t *c) {
  return frames_of_turn(c, 0) + frames_of_turn(c, 1) <= MAX_FRAMES;
}

/* Puts the datagrams of a turn into frames; `placed` datagrams are in frames already. */
static uint32_t pack_turn(cyclic_t *c, int closes, uint32_t placed) {
  struct frame *frame = NULL;
  uint32_t i;
  for (i = 0; i < c->datagrams; i++) {
    const struct datagram *d = &c->datagram[i];
    if (!is_due(c, d) || d->closes != closes) continue;
    if (frame == NULL || !has_room(frame->length - FIRST_DATAGRAM, d)) {
      if (frame != NULL) end_frame(frame);
      frame = &c->frame[c->frames++];
      begin_frame(c, frame, placed);
    } else {
      frame->bytes[c->position[placed - 1] + 7] |= MORE >> 8;
    }
    memcpy(frame->bytes + frame->length, d->header, DATAGRAM_HEADER);
    c->position[placed] = (uint16_t)frame->length;
    c->order[placed++] = (uint16_t)i;
    if (d->kind == DOMAIN_DATAGRAM) frame->domains |= 1u << d->domain;
    frame->length += d->length + DATAGRAM_FRAMING;
    frame->count++;
  }
  if (frame != NULL) end_frame(frame);
  return placed;
}

static void pack(cyclic_t *c) {
  uint32_t placed;
  c->frames = 0;
  placed = pack_turn(c, 0, 0);
  c->first_turn = c->frames;
  if (c->closing > 0) (void)pack_turn(c, 1, placed);
  c->packed = c->due;
}

/* Fills in index, time and outputs. The index of the first datagram selects the socket and has 7 bits
 * for a count of frames. The higher bits of this count are in the last byte of the source address and
 * in the indices of the other datagrams, so that a very late frame is not taken for a new one. */
static void fill(cyclic_t *c, struct frame *frame) {
  uint32_t i;
  uint8_t tag = (uint8_t)(c->sent >> 7);
  frame->bytes[SOURCE_PORT_AT] = (uint8_t)(tag << 1);
  for (i = 0; i < frame->count; i++) {
    const struct datagram *d = &c->datagram[c->order[frame->first + i]];
    uint8_t *at = frame->bytes + c->position[frame->first + i];
    at[1] = i == 0 ? (uint8_t)(CYCLIC_INDEX_ENGINE | c->sent) : tag;
    if (d->kind == DOMAIN_DATAGRAM)
      memcpy(at + DATAGRAM_HEADER, c->domain[d->domain].image + d->offset, d->outputs);
    else if (d->kind == TIME_DATAGRAM)
      put64(at + DATAGRAM_HEADER, cyclic_clock_estimate(c));
  }
  frame->pending = frame->copies = 0;
  c->lost[c->sent & 0x7F] = 0;
  c->sent++;
}

void cyclic_frames_fill(cyclic_t *c) {
  uint32_t i;
  if (c->due != c->packed || c->frames == 0) pack(c);
  for (i = 0; i < c->frames; i++) fill(c, &c->frame[i]);
  for (i = 0; i < c->splits; i++) c->split[i].taken = 0;
}

void cyclic_frames_close(cyclic_t *c) {
  uint32_t k, i;
  for (k = c->first_turn; k < c->frames; k++) {
    struct frame *frame = &c->frame[k];
    for (i = 0; i < frame->count; i++) {
      const struct datagram *d = &c->datagram[c->order[frame->first + i]];
      const struct split *split = &c->split[d->split - 1];
      frame->bytes[c->position[frame->first + i]] = split->taken < split->opening ? NOP : d->header[0];
    }
  }
}

int cyclic_frame_is_answer(const cyclic_t *c, const struct frame *frame, const uint8_t *bytes,
                           size_t length) {
  uint32_t i;
  if (length < frame->length) return 0;
  if (((bytes[SOURCE_PORT_AT] ^ frame->bytes[SOURCE_PORT_AT]) & ~1u) != 0) return 0;
  for (i = 0; i < frame->count; i++) {
    uint32_t at = c->position[frame->first + i];
    uint64_t sent = get64(frame->bytes + at), back = get64(bytes + at);
    /* Compares command, index, address and length. Each slave increments the position of a broadcast. */
    if (c->order[frame->first + i] == 0) sent &= ~0xFFFF0000ull, back &= ~0xFFFF0000ull;
    if (sent != back) return 0;
  }
  return 1;
}

int cyclic_frame_complete(const cyclic_t *c, const struct frame *frame, const uint8_t *bytes) {
  uint32_t i;
  for (i = 0; i < frame->count; i++) {
    const struct datagram *d = &c->datagram[c->order[frame->first + i]];
    uint32_t at = c->position[frame->first + i] + DATAGRAM_HEADER + d->length;
    if (d->kind != TIME_DATAGRAM && get16(bytes + at) != d->wkc_expected) return 0;
  }
  return 1;
}

/* Inputs are sent as zeros, and at most one slave writes each bit. ORing therefore gives the inputs of
 * both sides of a break. The time comes from the side with the reference clock. */
void cyclic_frame_merge(const cyclic_t *c, struct frame *frame, const uint8_t *bytes) {
  uint32_t i, k;
  if (frame->copies++ == 0) {
    memcpy(frame->answer, bytes, frame->length);
    return;
  }
  for (i = 0; i < frame->count; i++) {
    const struct datagram *d = &c->datagram[c->order[frame->first + i]];
    uint32_t at = c->position[frame->first + i] + DATAGRAM_HEADER;
    uint8_t *merged = frame->answer + at;
    const uint8_t *more = bytes + at;
    put16(merged + d->length, get16(merged + d->length) + get16(more + d->length));
    if (d->kind != TIME_DATAGRAM)
      for (k = 0; k < d->length; k++) merged[k] |= more[k];
    else if (get64(merged) == get64(frame->bytes + at))
      memcpy(merged, more, TIME_BYTES);
  }
}

static void take_piece(cyclic_t *c, const struct datagram *d, const uint8_t *data) {
  struct split *split = &c->split[d->split - 1];
  split->taken++;
  if (split->inputs == NULL) return;
  memcpy(split->inputs + (d->offset - split->offset), data, d->length);
  if (split->taken == split->pieces)
    memcpy(c->domain[d->domain].image + split->offset, split->inputs, split->length);
}

static void take_domain(cyclic_t *c, const struct datagram *d, const uint8_t *data, uint32_t wkc) {
  struct domain *domain = &c->domain[d->domain];
  domain->wkc += wkc;
  if (wkc == d->wkc_expected && d->split > 0) {
    take_piece(c, d, data);
  } else if (wkc == d->wkc_expected) {
    memcpy(domain->image + d->offset + d->outputs, data + d->outputs, d->length - d->outputs);
  } else if (d->group != 0) {
    domain->absent |= d->group;
  } else {
    domain->complete = 0;
    __atomic_store_n(&domain->status->wrong_offset, d->offset, __ATOMIC_RELAXED);
    __atomic_store_n(&domain->status->wrong_by, (int32_t)(wkc - d->wkc_expected), __ATOMIC_RELAXED);
  }
}

void cyclic_frame_take(cyclic_t *c, const struct frame *frame, const uint8_t *bytes) {
  uint32_t i;
  for (i = 0; i < frame->count; i++) {
    const struct datagram *d = &c->datagram[c->order[frame->first + i]];
    uint32_t at = c->position[frame->first + i] + DATAGRAM_HEADER;
    uint32_t wkc = get16(bytes + at + d->length);
    if (d->kind == DOMAIN_DATAGRAM) {
      take_domain(c, d, bytes + at, wkc);
    } else if (d->kind == STATUS_DATAGRAM) {
      c->found = wkc;
      c->al_status = get16(bytes + at);
      c->silent = 0;
    } else if (get64(bytes + at) != get64(frame->bytes + at)) {
      cyclic_clock_measure(c, get64(bytes + at)); /* unchanged: the frame has not met the clock */
    }
  }
}
