/* CAN channels: the clients that send.
 *
 * A client has a queue for each channel in its slot of the .out shared memory, which it may overwrite at any time.
 * So the engine copies each frame once and checks the copy. All clients share the queue of the terminal: each gets
 * an equal part of a batch as long as it has frames. When a client ends, its queue ends with it, and the safe
 * frames are sent. */
#include "can.h"

#include <string.h>
#include <unistd.h>

/* A batch has frames of at most this many clients, since each costs a system call. The next batch begins with the
 * others. */
enum { MOST_SENDERS = 8 };
static const uint64_t PATIENCE_NS = 500000000u; /* that a stop of the daemon has for safe frames */

static off_t in_slot(const cyclic_t *c, uint32_t slot, uint32_t offset) {
  return (off_t)c->out.slots_offset + (off_t)slot * c->out.slot_stride + offset;
}

static int read_headers(const cyclic_t *c, uint32_t slot, ecat_out_can *headers) {
  size_t size = c->cans * sizeof *headers;
  return pread(c->out_fd, headers, size, in_slot(c, slot, c->out.can_offset)) == (ssize_t)size;
}

static ecat_shm_can_sender *published(const cyclic_t *c, const struct can_channel *channel, uint32_t slot) {
  return (ecat_shm_can_sender *)(void *)((uint8_t *)c->header + c->header->can_senders_offset) +
         (size_t)slot * c->header->can_count + channel->number;
}

static void count(uint32_t *counter, uint32_t more) {
  __atomic_store_n(counter, *counter + more, __ATOMIC_RELAXED);
}

static void malformed(cyclic_t *c, uint32_t slot) {
  counter_add(&c->health->malformed, 1);
  if (!c->slot[slot].told_malformed)
    c->slot[slot].told_malformed = cyclic_emit(c, CYCLIC_EVENT_MALFORMED, -1, (int32_t)slot,
                                               c->slot[slot].generation);
}

void cyclic_can_look(cyclic_t *c, uint32_t slot) {
  ecat_out_can headers[ECAT_MAX_CAN];
  uint32_t i;
  if (c->slot[slot].can_sends == 0 || !read_headers(c, slot, headers)) return;
  for (i = 0; i < c->cans; i++) {
    struct can_channel *channel = &c->can[i];
    struct can_sender *sender = &channel->sender[slot];
    if (sender->generation == 0 || headers[i].generation != sender->generation) continue;
    if (headers[i].written - sender->taken > ECAT_CAN_QUEUE) {
      malformed(c, slot);
      continue;
    }
    sender->written = headers[i].written;
    if (sender->written != sender->taken) channel->waiting |= 1u << slot;
  }
}

/* --- what a client may send ------------------------------------------------------------------- */

/* Frames of 29 bits are other frames than those of 11 bits, and remote frames are those of their identifier. */
static int in_ranges(const ecat_can_range *ranges, uint32_t range_count, uint32_t id) {
  uint32_t i;
  id &= ~ECAT_CAN_REMOTE;
  for (i = 0; i < range_count; i++)
    if (id >= ranges[i].first && id <= ranges[i].last) return 1;
  return 0;
}

static int is_sound(const struct can_channel *channel, const struct can_frame *frame) {
  uint32_t id = frame->id & ~ECAT_CAN_REMOTE;
  if (frame->length > 8) return 0;
  if (id & ECAT_CAN_EXTENDED)
    return channel->shared->identifier_bits == 29 && (id & ~ECAT_CAN_EXTENDED) <= ECAT_CAN_ID;
  return id <= 0x7FF;
}

static int is_reserved(const struct can_channel *channel, uint32_t slot, uint32_t id) {
  uint32_t i;
  if (channel->shared->reserved == 0) return 0;
  for (i = 0; i < ECAT_SLOTS; i++) {
    const struct can_sender *other = &channel->sender[i];
    if (i != slot && other->generation != 0 && in_ranges(other->ranges, other->range_count, id)) return 1;
  }
  return 0;
}

static int may_send(cyclic_t *c, struct can_channel *channel, const struct can_frame *frame) {
  uint32_t slot = (uint32_t)frame->slot;
  struct can_sender *sender = &channel->sender[slot];
  if (is_sound(channel, frame) && !is_reserved(channel, slot, frame->id)) return 1;
  counter_add(&channel->shared->refused, 1);
  count(&published(c, channel, slot)->refused, 1);
  if (!sender->told_refused)
    sender->told_refused = cyclic_emit(c, CYCLIC_EVENT_CAN_REFUSED, (int32_t)channel->terminal.slave,
                                       frame->slot, frame->id);
  return 0;
}

/* What a client sends ends the safe frames about it, and has them sent when the client ends. */
static void touch(struct can_channel *channel, struct can_sender *sender, uint32_t id) {
  uint32_t i;
  for (i = 0; i < channel->safes; i++) {
    struct can_safe *safe = &channel->safe[i];
    if (safe->frame.range_count > 0 &&
        !in_ranges((const ecat_can_range *)(const void *)safe->frame.ranges, safe->frame.range_count, id))
      continue;
    sender->touched |= 1u << i;
    safe->active = safe->waits = 0;
  }
}

/* --- batches ---------------------------------------------------------------------------------- */

/* Takes at most `most` frames of one client; those that it may not send are left out. Returns how many. */
static uint32_t take(cyclic_t *c, struct can_channel *channel, uint32_t slot, struct can_frame *frames,
                     uint32_t most) {
  struct can_sender *sender = &channel->sender[slot];
  ecat_out_can_frame read[CAN_BATCH];
  uint32_t first = (sender->taken + 1) % ECAT_CAN_QUEUE, left = sender->written - sender->taken, i, used = 0;
  off_t at = in_slot(c, slot, c->out.can_queues_offset) +
             (off_t)((channel->number * ECAT_CAN_QUEUE + first) * sizeof *read);
  if (most > left) most = left;
  if (most > ECAT_CAN_QUEUE - first) most = ECAT_CAN_QUEUE - first; /* the rest lies at the start of the queue */
  if (pread(c->out_fd, read, most * sizeof *read, at) != (ssize_t)(most * sizeof *read)) {
    sender->taken = sender->written; /* truncated: the client ends with the next look at its doorbell */
    most = 0;
  }
  for (i = 0; i < most; i++) {
    struct can_frame *frame = &frames[used];
    frame->id = read[i].id;
    frame->length = read[i].length;
    memcpy(frame->data, read[i].data, sizeof frame->data);
    frame->slot = (int32_t)slot;
    frame->generation = sender->generation;
    frame->number = ++sender->taken;
    if (!may_send(c, channel, frame)) continue;
    if (channel->safes > 0) touch(channel, sender, frame->id);
    used++;
  }
  if (sender->taken == sender->written) channel->waiting &= ~(1u << slot);
  __atomic_store_n(&published(c, channel, slot)->taken, sender->taken, __ATOMIC_RELEASE);
  return used;
}

/* The slots from `turn` on, as bits whose lowest one is `turn`. */
static uint32_t from_turn(uint32_t slots, uint32_t turn) {
  return turn == 0 ? slots : slots >> turn | slots << (32 - turn);
}

uint32_t cyclic_can_collect(cyclic_t *c, struct can_channel *channel, struct can_frame *frames, uint32_t room) {
  uint32_t used = 0, calls;
  for (calls = 0; calls < 2 * MOST_SENDERS && used < room && channel->waiting != 0; calls++) {
    uint32_t left = from_turn(channel->waiting, channel->turn);
    uint32_t slot = (channel->turn + (uint32_t)__builtin_ctz(left)) % ECAT_SLOTS;
    uint32_t clients = (uint32_t)__builtin_popcount(channel->waiting);
    uint32_t share = (room - used + clients - 1) / clients;
    used += take(c, channel, slot, frames + used, share);
    channel->turn = (slot + 1) % ECAT_SLOTS;
  }
  return used;
}

uint32_t cyclic_can_collect_safe(cyclic_t *c, struct can_channel *channel, struct can_frame *frames,
                                 uint32_t room) {
  uint32_t i, used = 0;
  for (i = 0; i < channel->safes && used < room; i++) {
    struct can_safe *safe = &channel->safe[i];
    struct can_frame *frame = &frames[used];
    if (!safe->active || safe->in_flight || c->cycle < safe->next_cycle) continue;
    *frame = (struct can_frame){.id = safe->frame.id, .length = safe->frame.length, .slot = -1, .number = i};
    memcpy(frame->data, safe->frame.data, sizeof frame->data);
    safe->in_flight = 1;
    safe->next_cycle = c->cycle + safe->frame.period_cycles;
    used++;
  }
  return used;
}

void cyclic_can_conclude(cyclic_t *c, struct can_channel *channel, const struct can_frame *frame, int sent) {
  if (frame->slot < 0) {
    struct can_safe *safe = &channel->safe[frame->number];
    safe->in_flight = 0;
    if (!sent) return; /* it is sent again */
    safe->waits = 0;
    if (safe->frame.period_cycles == 0) safe->active = 0;
    counter_add(&channel->shared->safe, 1);
  } else {
    ecat_shm_can_sender *sender = published(c, channel, (uint32_t)frame->slot);
    if (sender->generation != frame->generation) return; /* the client has ended meanwhile */
    count(sent ? &sender->sent : &sender->unsent, 1);
  }
}

void cyclic_can_count_waiting(cyclic_t *c) {
  uint32_t i, k, waiting = 0;
  for (i = 0; i < c->cans; i++) {
    struct can_channel *channel = &c->can[i];
    uint32_t active = 0;
    for (k = 0; k < channel->safes; k++) {
      const struct can_safe *safe = &channel->safe[k];
      active += (uint32_t)safe->active;
      waiting += (uint32_t)(safe->active && safe->waits && c->now_ns - safe->since_ns < PATIENCE_NS);
    }
    __atomic_store_n(&channel->shared->safe_active, active, __ATOMIC_RELAXED);
  }
  __atomic_store_n(&c->can_stopping, waiting, __ATOMIC_RELEASE);
}

/* --- claims, and the end of clients ------------------------------------------------------------ */

static int ranges_are_sound(const ecat_out_can *header) {
  uint32_t i;
  if (header->range_count > ECAT_CAN_RANGES) return 0;
  for (i = 0; i < header->range_count; i++)
    if (header->ranges[i].first > header->ranges[i].last ||
        (header->ranges[i].first & ECAT_CAN_EXTENDED) != (header->ranges[i].last & ECAT_CAN_EXTENDED))
      return 0;
  return 1;
}

/* The slot of another client that has reserved one of the identifiers; -1: none. */
static int32_t find_conflict(const struct can_channel *channel, uint32_t slot, const ecat_out_can *header) {
  uint32_t i, k, n;
  for (i = 0; i < ECAT_SLOTS; i++) {
    const struct can_sender *other = &channel->sender[i];
    if (i == slot || other->generation == 0) continue;
    for (k = 0; k < header->range_count; k++)
      for (n = 0; n < other->range_count; n++)
        if (header->ranges[k].first <= other->ranges[n].last && other->ranges[n].first <= header->ranges[k].last)
          return (int32_t)i;
  }
  return -1;
}

/* Publishes what the engine knows of a sender, and counts the ranges of the channel. */
static void publish(cyclic_t *c, struct can_channel *channel, uint32_t slot) {
  const struct can_sender *sender = &channel->sender[slot];
  ecat_shm_can_sender *to = published(c, channel, slot);
  uint32_t i, reserved = 0;
  if (to->generation != sender->generation) {
    __atomic_store_n(&to->generation, 0, __ATOMIC_RELEASE);
    to->sent = to->refused = to->unsent = 0;
    to->taken = sender->taken;
  }
  for (i = 0; i < ECAT_CAN_RANGES; i++) {
    __atomic_store_n(&to->ranges[i].first, sender->ranges[i].first, __ATOMIC_RELAXED);
    __atomic_store_n(&to->ranges[i].last, sender->ranges[i].last, __ATOMIC_RELAXED);
  }
  __atomic_store_n(&to->range_count, sender->range_count, __ATOMIC_RELAXED);
  __atomic_store_n(&to->generation, sender->generation, __ATOMIC_RELEASE);
  for (i = 0; i < ECAT_SLOTS; i++) reserved += channel->sender[i].range_count;
  __atomic_store_n(&channel->shared->reserved, reserved, __ATOMIC_RELAXED);
}

/* Ends a sender. Its frames that wait are dropped, and the safe frames about what it has sent are sent. */
static void end(cyclic_t *c, struct can_channel *channel, uint32_t slot, uint32_t reason) {
  struct can_sender *sender = &channel->sender[slot];
  uint32_t i, left = sender->written - sender->taken;
  if (left > 0) counter_add(&channel->shared->dropped, left);
  for (i = 0; i < channel->safes; i++) {
    struct can_safe *safe = &channel->safe[i];
    if (!(sender->touched >> i & 1) || (reason == ECAT_REASON_RELEASED && !safe->frame.ended)) continue;
    safe->active = safe->waits = 1;
    safe->next_cycle = c->cycle;
    safe->since_ns = c->now_ns;
  }
  (void)cyclic_emit(c, CYCLIC_EVENT_CAN_ENDED, (int32_t)channel->terminal.slave, (int32_t)slot, reason);
  memset(sender, 0, sizeof *sender);
  channel->waiting &= ~(1u << slot);
  publish(c, channel, slot);
}

static void grant(cyclic_t *c, struct can_channel *channel, uint32_t slot, const ecat_out_can *header) {
  struct can_sender *sender = &channel->sender[slot];
  if (sender->generation != c->slot[slot].generation) {
    memset(sender, 0, sizeof *sender);
    sender->generation = c->slot[slot].generation;
    sender->taken = sender->written = header->written;
  }
  sender->range_count = header->range_count;
  memcpy(sender->ranges, header->ranges, sizeof sender->ranges);
  publish(c, channel, slot);
}

/* Whether the ranges of a client are others than those that it has. */
static int has_changed(const struct can_sender *sender, const ecat_out_can *header) {
  return sender->range_count != header->range_count ||
         memcmp(sender->ranges, header->ranges, header->range_count * sizeof *header->ranges) != 0;
}

int32_t cyclic_can_claim(cyclic_t *c, uint32_t slot) {
  ecat_out_can headers[ECAT_MAX_CAN];
  uint32_t i, sends = 0;
  int32_t conflict = CYCLIC_CONFLICT_NONE, other;
  if (c->cans == 0 || !read_headers(c, slot, headers)) return conflict;
  for (i = 0; i < c->cans && conflict == CYCLIC_CONFLICT_NONE; i++) {
    struct can_channel *channel = &c->can[i];
    if (headers[i].sends != 1) continue;
    if (!ranges_are_sound(&headers[i])) {
      malformed(c, slot);
      headers[i].range_count = 0;
    }
    if (__atomic_load_n(&c->make_safe, __ATOMIC_RELAXED)) {
      conflict = CYCLIC_CONFLICT_STOPPING;
    } else if ((other = find_conflict(channel, slot, &headers[i])) >= 0) {
      conflict = CYCLIC_CONFLICT_CAN - (int32_t)i;
      counter_add(&c->health->conflicts, 1);
      (void)cyclic_emit(c, CYCLIC_EVENT_CAN_CONFLICT, (int32_t)channel->terminal.slave, (int32_t)slot,
                        (uint32_t)other);
    }
  }
  for (i = 0; i < c->cans; i++) {
    struct can_channel *channel = &c->can[i];
    struct can_sender *sender = &channel->sender[slot];
    if (headers[i].sends != 1 && sender->generation != 0) end(c, channel, slot, ECAT_REASON_RELEASED);
    if (headers[i].sends == 1 && conflict == CYCLIC_CONFLICT_NONE &&
        (sender->generation != c->slot[slot].generation || has_changed(sender, &headers[i])))
      grant(c, channel, slot, &headers[i]);
    if (sender->generation != 0) sends |= 1u << i;
  }
  c->slot[slot].can_sends = sends;
  return conflict;
}

int cyclic_can_drop(cyclic_t *c, uint32_t slot, uint32_t reason) {
  uint32_t left = c->slot[slot].can_sends;
  int sent = left != 0;
  for (; left != 0; left &= left - 1) end(c, &c->can[__builtin_ctz(left)], slot, reason);
  c->slot[slot].can_sends = 0;
  return sent;
}
