/* CAN channels: reading what happens on them, and sending. The records are in the daemon's shared memory, the queue
 * of frames to be sent in the slot of this client. */
#include "internal.h"

#include <stdio.h>
#include <string.h>
#include <time.h>

enum { BEATS_PER_LEASE = 8 };

static int check_channel(ecat_t *bus, int channel) {
  if (channel >= 0 && channel < ecat_can_count(bus)) return 0;
  if (bus->map == NULL) return ecat_memory_check(bus, 0);
  return ecat_fail(bus, ECAT_EARG, "bus '%s' has no CAN channel %d: it has %d", bus->name, channel,
                   ecat_can_count(bus));
}

int ecat_can_count(const ecat_t *bus) { return (int)bus->header->can_count; }

static const char *name_of(const ecat_t *bus, int channel) {
  return ecat_shown(bus->slaves[bus->can[channel].slave].name);
}

int ecat_can_find(ecat_t *bus, int position) {
  int code = ecat_check_position(bus, position), i;
  if (code != 0) return code;
  for (i = 0; i < ecat_can_count(bus); i++)
    if (bus->can[i].slave == position) return i;
  return ecat_fail(bus, ECAT_EBUS,
                   "slave %d (%s) of bus '%s' has no CAN channel: if it is a CAN terminal, add [slave.can] to its "
                   "[[slave]] table in the configuration of the daemon",
                   position, ecat_shown(bus->slaves[position].name), bus->name);
}

/* What the engine says of this client as a sender; NULL: it has not answered yet. */
static const ecat_shm_can_sender *sender_of(const ecat_t *bus, int channel) {
  const ecat_shm_can_sender *sender;
  if (bus->slot < 0) return NULL;
  sender = &bus->can_senders[(size_t)bus->slot * bus->header->can_count + (size_t)channel];
  return __atomic_load_n(&sender->generation, __ATOMIC_ACQUIRE) == bus->generation ? sender : NULL;
}

int ecat_can(ecat_t *bus, int channel, ecat_can_info *info) {
  const ecat_shm_can *from;
  const ecat_shm_can_sender *sender;
  const struct can_use *use;
  int code = ecat_memory_return(bus);
  if (code != 0 || (code = check_channel(bus, channel)) != 0) return code;
  from = &bus->can[channel];
  use = &bus->can_use[channel];
  memset(info, 0, sizeof *info);
  info->slave = from->slave;
  info->bit_rate = from->bit_rate;
  info->identifier_bits = from->identifier_bits;
  info->receive_queue = from->receive_queue;
  info->send_queue = from->send_queue;
  /* What a daemon that has ended has left behind is no state. */
  info->state = ecat_memory_age(bus) != 0 ? ECAT_CAN_STOPPED : (int)__atomic_load_n(&from->state, __ATOMIC_RELAXED);
  info->send_errors = __atomic_load_n(&from->send_errors, __ATOMIC_RELAXED);
  info->receive_errors = __atomic_load_n(&from->receive_errors, __ATOMIC_RELAXED);
  info->reserved = __atomic_load_n(&from->reserved, __ATOMIC_RELAXED);
  info->safe_active = __atomic_load_n(&from->safe_active, __ATOMIC_RELAXED);
#define COUNTER(name) info->name = __atomic_load_n(&from->name, __ATOMIC_RELAXED)
  COUNTER(received);
  COUNTER(sent);
  COUNTER(safe);
  COUNTER(unsent);
  COUNTER(dropped);
  COUNTER(refused);
  COUNTER(overflows);
  COUNTER(bus_offs);
  COUNTER(restarts);
#undef COUNTER
  info->missed = use->missed;
  if (!use->sends || (sender = sender_of(bus, channel)) == NULL) return 0;
  info->waiting = use->written - __atomic_load_n(&sender->taken, __ATOMIC_ACQUIRE);
  info->own_sent = __atomic_load_n(&sender->sent, __ATOMIC_RELAXED);
  info->own_refused = __atomic_load_n(&sender->refused, __ATOMIC_RELAXED);
  info->own_unsent = __atomic_load_n(&sender->unsent, __ATOMIC_RELAXED);
  return 0;
}

/* --- reading ---------------------------------------------------------------------------------- */

int ecat_can_listen(ecat_t *bus, int channel) {
  int code = ecat_memory_return(bus);
  if (code != 0 || (code = check_channel(bus, channel)) != 0) return code;
  bus->can_use[channel].next = __atomic_load_n(&bus->can[channel].records, __ATOMIC_ACQUIRE);
  bus->can_use[channel].listens = 1;
  return 0;
}

/* Copies a record; 0: the engine has overwritten it meanwhile. */
static int copy_record(const ecat_t *bus, int channel, uint64_t number, ecat_shm_can_record *to) {
  enum { WORDS = sizeof *to / sizeof(uint64_t) };
  const ecat_shm_can *can = &bus->can[channel];
  const uint64_t *from = (const void *)((const ecat_shm_can_record *)(const void *)(bus->map + can->records_offset) +
                                        number % ECAT_CAN_RECORDS);
  uint64_t words[WORDS];
  int i;
  for (i = 0; i < WORDS; i++) words[i] = __atomic_load_n(&from[i], __ATOMIC_RELAXED);
  __atomic_thread_fence(__ATOMIC_ACQUIRE);
  memcpy(to, words, sizeof *to);
  return __atomic_load_n(&can->begun, __ATOMIC_RELAXED) - number <= ECAT_CAN_RECORDS;
}

static uint64_t sender_number(int slot, uint32_t generation) {
  return (uint64_t)generation << 32 | (uint32_t)(slot + 1);
}

uint64_t ecat_can_sender(const ecat_t *bus) {
  return bus->slot >= 0 ? sender_number(bus->slot, bus->generation) : 0;
}

static void fill(const ecat_t *bus, ecat_can_frame *frame, const ecat_shm_can_record *record) {
  frame->id = record->id;
  frame->length = record->length;
  frame->kind = record->kind;
  frame->sender = record->slot >= 0 ? sender_number(record->slot, record->generation) : 0;
  frame->own = frame->sender != 0 && frame->sender == ecat_can_sender(bus);
  frame->safe = record->kind == ECAT_CAN_SENT && record->slot < 0;
  memcpy(frame->data, record->data, sizeof frame->data);
  frame->cycle = record->cycle;
  frame->time_ns = record->time_ns;
  frame->number = record->number;
}

static void beat(ecat_t *bus) {
  if (bus->doorbell != NULL && !ecat_slot_foreign(bus)) ecat_beat(bus);
}

int ecat_can_read(ecat_t *bus, int channel, ecat_can_frame *frames, size_t room, uint64_t until_cycle) {
  struct can_use *use;
  ecat_shm_can_record record;
  uint64_t end;
  size_t used = 0;
  int code = ecat_memory_return(bus);
  if (code != 0 || (code = check_channel(bus, channel)) != 0) return code;
  use = &bus->can_use[channel];
  if (!use->listens && (code = ecat_can_listen(bus, channel)) != 0) return code;
  beat(bus);
  end = __atomic_load_n(&bus->can[channel].records, __ATOMIC_ACQUIRE);
  if (room > INT32_MAX) room = INT32_MAX;
  while (used < room && use->next < end) {
    if (!copy_record(bus, channel, use->next, &record)) {
      /* A sixteenth of the records is left to the engine, so that the next one is still there when it is read. */
      uint64_t oldest = __atomic_load_n(&bus->can[channel].begun, __ATOMIC_RELAXED) -
                        (ECAT_CAN_RECORDS - ECAT_CAN_RECORDS / 16);
      use->missed += oldest - use->next;
      use->next = oldest;
      end = __atomic_load_n(&bus->can[channel].records, __ATOMIC_ACQUIRE);
      continue;
    }
    if (until_cycle != 0 && record.cycle > until_cycle) break;
    fill(bus, &frames[used++], &record);
    use->next++;
  }
  if (used == 0 && (code = ecat_memory_age(bus)) != 0) return code;
  return (int)used;
}

int ecat_can_wait(ecat_t *bus, int channel, double timeout) {
  struct can_use *use;
  int code = ecat_memory_return(bus);
  if (!(timeout >= 0)) return ecat_fail(bus, ECAT_EARG, "%g s is no time to wait", timeout);
  if (code != 0 || (code = check_channel(bus, channel)) != 0) return code;
  use = &bus->can_use[channel];
  if (!use->listens && (code = ecat_can_listen(bus, channel)) != 0) return code;
  code = ecat_wait_until(bus, &bus->can[channel].records, use->next + 1, 1u << (ECAT_WAKE_CAN + channel), timeout);
  if (code == ECAT_ETIMEOUT)
    return ecat_fail(bus, code, "no frame on the CAN channel of slave %d (%s) within %g s",
                     bus->can[channel].slave, name_of(bus, channel), timeout);
  return code;
}

/* --- being a sender --------------------------------------------------------------------------- */

static ecat_out_can *header_of(const ecat_t *bus, int channel) {
  return (ecat_out_can *)(void *)((uint8_t *)bus->out + bus->layout.can_offset) + channel;
}

static ecat_out_can_frame *entry_of(const ecat_t *bus, int channel, uint32_t number) {
  return (ecat_out_can_frame *)(void *)((uint8_t *)bus->out + bus->layout.can_queues_offset) +
         (size_t)channel * ECAT_CAN_QUEUE + number % ECAT_CAN_QUEUE;
}

void ecat_can_lose(ecat_t *bus) {
  int i;
  for (i = 0; i < ecat_can_count(bus); i++) {
    struct can_use *use = &bus->can_use[i];
    if (use->sends) use->lost = 1;
    use->sends = 0;
    use->written = use->range_count = 0;
  }
}

void ecat_can_begin(ecat_t *bus) {
  ecat_can_lose(bus);
  (void)ecat_life_beat(bus, 0); /* else the lease of outputs that are claimed next would never end */
  memset(header_of(bus, 0), 0, bus->header->can_count * sizeof(ecat_out_can));
}

void ecat_can_want(ecat_t *bus) {
  int i;
  for (i = 0; i < ecat_can_count(bus); i++) {
    const struct can_use *use = &bus->can_use[i];
    ecat_out_can *header = header_of(bus, i);
    header->sends = (uint32_t)use->sends;
    header->generation = bus->generation;
    header->range_count = use->range_count;
    memcpy(header->ranges, use->ranges, sizeof header->ranges);
  }
}

int ecat_can_beats(const ecat_t *bus) {
  int i;
  for (i = 0; i < ecat_can_count(bus); i++)
    if (bus->can_use[i].sends && bus->can_use[i].lease_ns == 0) return 1;
  return 0;
}

uint64_t ecat_can_lease(const ecat_t *bus) {
  uint64_t longest = 0;
  int i;
  if (ecat_can_beats(bus)) return bus->header->lease_max_ns;
  for (i = 0; i < ecat_can_count(bus); i++)
    if (bus->can_use[i].sends && bus->can_use[i].lease_ns > longest) longest = bus->can_use[i].lease_ns;
  return longest;
}

/* Starts or ends the signs of life that a thread gives. */
static int keep_beating(ecat_t *bus) {
  uint64_t period = bus->header->lease_max_ns / BEATS_PER_LEASE;
  if (!ecat_can_beats(bus)) period = 0;
  if (ecat_life_beat(bus, period) == 0) return 0;
  return ecat_fail(bus, ECAT_ESYS, "the thread that gives signs of life does not run, so the claim needs a lease");
}

static int check_ranges(ecat_t *bus, int channel, const ecat_can_range *ranges, size_t count) {
  size_t i;
  if (count > ECAT_CAN_RANGES)
    return ecat_fail(bus, ECAT_EARG, "%zu ranges of identifiers: a client can reserve %d on a CAN channel", count,
                     ECAT_CAN_RANGES);
  for (i = 0; i < count; i++) {
    uint32_t extended = ranges[i].first & ECAT_CAN_EXTENDED, most = extended ? ECAT_CAN_ID : 0x7FF;
    if ((ranges[i].last & ECAT_CAN_EXTENDED) != extended || ranges[i].first > ranges[i].last ||
        (ranges[i].last & ~ECAT_CAN_EXTENDED) > most)
      return ecat_fail(bus, ECAT_EARG,
                       "0x%X to 0x%X is no range of identifiers: both have 11 or both 29 bits, and the first is not "
                       "greater than the last",
                       (unsigned)(ranges[i].first & ~ECAT_CAN_EXTENDED),
                       (unsigned)(ranges[i].last & ~ECAT_CAN_EXTENDED));
    if (extended && bus->can[channel].identifier_bits != 29)
      return ecat_fail(bus, ECAT_EARG, "the CAN channel of slave %d (%s) has identifiers of 11 bits only",
                       bus->can[channel].slave, name_of(bus, channel));
  }
  return 0;
}

static int overlap(const ecat_can_range *one, const ecat_can_range *other) {
  return one->first <= other->last && other->first <= one->last;
}

/* The slot of another client with a range that overlaps; -1: none. */
static int reserved_by(const ecat_t *bus, int channel, const ecat_can_range *range) {
  uint32_t slot, k;
  if (__atomic_load_n(&bus->can[channel].reserved, __ATOMIC_RELAXED) == 0) return -1;
  for (slot = 0; slot < bus->header->slot_count; slot++) {
    const ecat_shm_can_sender *other = &bus->can_senders[(size_t)slot * bus->header->can_count + (size_t)channel];
    uint32_t count = __atomic_load_n(&other->range_count, __ATOMIC_RELAXED);
    if ((int)slot == bus->slot || __atomic_load_n(&other->generation, __ATOMIC_ACQUIRE) == 0) continue;
    for (k = 0; k < count && k < ECAT_CAN_RANGES; k++)
      if (overlap(range, &other->ranges[k])) return (int)slot;
  }
  return -1;
}

static int refuse_reserved(ecat_t *bus, int channel, const ecat_can_range *range, int slot) {
  const ecat_shm_can_sender *other = &bus->can_senders[(size_t)slot * bus->header->can_count + (size_t)channel];
  uint32_t id = range->first, i;
  char name[96];
  for (i = 0; i < other->range_count && i < ECAT_CAN_RANGES; i++)
    if (overlap(range, &other->ranges[i]) && other->ranges[i].first > id) id = other->ranges[i].first;
  ecat_client_name(bus, slot, name);
  return ecat_fail(bus, ECAT_EOWNED,
                   "identifier 0x%X of the CAN channel of slave %d (%s) is reserved by %s: end it first, or use "
                   "another identifier",
                   (unsigned)(id & ~(ECAT_CAN_EXTENDED | ECAT_CAN_REMOTE)), bus->can[channel].slave,
                   name_of(bus, channel), name[0] != '\0' ? name : "another client");
}

static int refused(ecat_t *bus, int channel, int conflict) {
  const struct can_use *use = &bus->can_use[channel];
  uint32_t i;
  if (conflict == -2) return ecat_fail(bus, ECAT_EDOWN, "the daemon of bus '%s' is stopping", bus->name);
  for (i = 0; i < use->range_count; i++) {
    int slot = reserved_by(bus, channel, &use->ranges[i]);
    if (slot >= 0) return refuse_reserved(bus, channel, &use->ranges[i], slot);
  }
  return ecat_fail(bus, ECAT_EOWNED,
                   "another client had reserved identifiers of the CAN channel of slave %d (%s) a moment ago; try "
                   "again", bus->can[channel].slave, name_of(bus, channel));
}

/* Claims what `bus->can_use` says now; if that is refused, the channel is as `before` again. */
static int carry_out(ecat_t *bus, int channel, const struct can_use *before) {
  int conflict, code = ecat_claims_ring(bus, &conflict);
  if (code == 0 && conflict != -1) code = refused(bus, channel, conflict);
  if (code == 0) return keep_beating(bus);
  if (bus->slot < 0) return code; /* there is no daemon any more */
  bus->can_use[channel] = *before;
  ecat_claims_withdraw(bus);
  return code;
}

int ecat_can_claim(ecat_t *bus, int channel, double lease, const ecat_can_range *ranges, size_t count) {
  struct can_use *use, before;
  int code;
  if (!(lease >= 0)) return ecat_fail(bus, ECAT_EARG, "%g s is no lease", lease);
  if ((code = ecat_slot_take(bus)) != 0 || (code = check_channel(bus, channel)) != 0 ||
      (code = check_ranges(bus, channel, ranges, count)) != 0)
    return code;
  if (ecat_slot_lapsed(bus)) ecat_slot_begin(bus);
  if (lease == 0 && bus->bytes > 0)
    return ecat_fail(bus, ECAT_EARG, "this connection owns outputs: claim the CAN channel with a lease, or with a "
                     "connection of its own");
  use = &bus->can_use[channel];
  before = *use;
  use->sends = 1;
  use->lost = 0;
  use->lease_ns = ecat_ns(lease);
  use->range_count = (uint32_t)count;
  memset(use->ranges, 0, sizeof use->ranges);
  if (count > 0) memcpy(use->ranges, ranges, count * sizeof *ranges);
  return carry_out(bus, channel, &before);
}

int ecat_can_release(ecat_t *bus, int channel) {
  struct can_use *use, before;
  int code = check_channel(bus, channel);
  if (code != 0 || (code = ecat_slot_check_home(bus)) != 0) return code;
  use = &bus->can_use[channel];
  use->lost = 0;
  if (!use->sends || ecat_slot_lapsed(bus)) return 0;
  before = *use;
  use->sends = 0;
  use->range_count = 0;
  code = carry_out(bus, channel, &before);
  if (code == 0) use->written = 0;
  return code;
}

void ecat_can_end(ecat_t *bus) {
  int i, conflict;
  if (bus->slot < 0 || ecat_can_lease(bus) == 0 || ecat_slot_foreign(bus) || ecat_slot_lapsed(bus) ||
      ecat_memory_age(bus) != 0)
    return;
  for (i = 0; i < ecat_can_count(bus); i++) {
    bus->can_use[i].sends = 0;
    bus->can_use[i].range_count = 0;
  }
  (void)ecat_claims_ring(bus, &conflict);
}

/* --- sending ---------------------------------------------------------------------------------- */

static int check_sender(ecat_t *bus, int channel) {
  int code = ecat_memory_return(bus);
  if (code != 0 || (code = check_channel(bus, channel)) != 0 || (code = ecat_slot_check_home(bus)) != 0) return code;
  if (ecat_memory_age(bus) == ECAT_EDOWN) return ECAT_EDOWN; /* its frames would be lost */
  if (bus->can_use[channel].lost || (bus->can_use[channel].sends && ecat_slot_lapsed(bus)))
    return ecat_fail(bus, ECAT_ELEASE,
                     "%s no longer sends on the CAN channel of slave %d (%s): it gave no sign of life for its lease, "
                     "or the daemon has ended%s", bus->program != NULL ? bus->program : "this client",
                     bus->can[channel].slave, name_of(bus, channel),
                     bus->program != NULL ? "" : "; claim the channel again");
  if (bus->can_use[channel].sends) return 0;
  return ecat_fail(bus, ECAT_ECLAIM, "the CAN channel of slave %d (%s) must be claimed before frames are sent",
                   bus->can[channel].slave, name_of(bus, channel));
}

static int check_frame(ecat_t *bus, int channel, const ecat_can_frame *frame) {
  uint32_t id = frame->id & ~ECAT_CAN_REMOTE;
  ecat_can_range range;
  int slot, extended = (id & ECAT_CAN_EXTENDED) != 0;
  if (frame->length > 8)
    return ecat_fail(bus, ECAT_ERANGE, "a CAN frame has at most 8 bytes of data, not %d", (int)frame->length);
  if ((id & ~ECAT_CAN_EXTENDED) > (extended ? ECAT_CAN_ID : 0x7FFu))
    return ecat_fail(bus, ECAT_ERANGE, "0x%X is no identifier of %d bits", (unsigned)(id & ~ECAT_CAN_EXTENDED),
                     extended ? 29 : 11);
  if (extended && bus->can[channel].identifier_bits != 29)
    return ecat_fail(bus, ECAT_ERANGE,
                     "the CAN channel of slave %d (%s) has identifiers of 11 bits: set identifiers = 29 in its "
                     "[slave.can] in the configuration of the daemon",
                     bus->can[channel].slave, name_of(bus, channel));
  range.first = range.last = id;
  slot = reserved_by(bus, channel, &range);
  return slot < 0 ? 0 : refuse_reserved(bus, channel, &range, slot);
}

static int full(ecat_t *bus, int channel) {
  static const char *const why[] = {"the terminal is not in OP", "the CAN bus is slower than this program",
                                    "the CAN bus has errors", "the CAN controller is error passive: check the cable, "
                                    "the termination and the bit rate", "the CAN controller is bus-off: check the "
                                    "cable, the termination and the bit rate"};
  uint32_t state = __atomic_load_n(&bus->can[channel].state, __ATOMIC_RELAXED);
  return ecat_fail(bus, ECAT_EFULL, "%d CAN frames of this client wait for slave %d (%s), which is all that may: %s",
                   ECAT_CAN_QUEUE, bus->can[channel].slave, name_of(bus, channel), why[state < 5 ? state : 2]);
}

int ecat_can_send(ecat_t *bus, int channel, const ecat_can_frame *frames, size_t count, uint32_t *number) {
  const ecat_shm_can_sender *sender;
  struct can_use *use;
  uint32_t room, done;
  int code = check_sender(bus, channel);
  if (code != 0) return code;
  use = &bus->can_use[channel];
  beat(bus);
  sender = sender_of(bus, channel);
  if (sender == NULL && __atomic_load_n(&bus->header->state, __ATOMIC_RELAXED) == ECAT_BUS_STOPPING)
    return ecat_fail(bus, ECAT_EDOWN, "the daemon of bus '%s' is stopping", bus->name);
  if (sender == NULL) return ecat_fail(bus, ECAT_ELEASE, "the slot of this client was taken; claim the channel again");
  room = ECAT_CAN_QUEUE - (use->written - __atomic_load_n(&sender->taken, __ATOMIC_ACQUIRE));
  if (room > ECAT_CAN_QUEUE || (room == 0 && count > 0)) return full(bus, channel);
  for (done = 0; done < room && done < count; done++) {
    ecat_out_can_frame *to = entry_of(bus, channel, use->written + 1);
    if ((code = check_frame(bus, channel, &frames[done])) != 0) break;
    to->id = frames[done].id;
    to->length = frames[done].length;
    memset(to->data, 0, sizeof to->data);
    if (!(to->id & ECAT_CAN_REMOTE)) memcpy(to->data, frames[done].data, to->length);
    use->written++;
  }
  if (done == 0) return code;
  __atomic_store_n(&header_of(bus, channel)->written, use->written, __ATOMIC_RELEASE);
  __atomic_store_n(&bus->doorbell->can_seq, bus->doorbell->can_seq + 1, __ATOMIC_RELEASE);
  if (number != NULL) *number = use->written;
  return (int)done;
}

int ecat_can_flush(ecat_t *bus, int channel, double timeout) {
  const struct timespec pause = {0, RETURN_PAUSE_NS};
  uint64_t start = ecat_now(), limit = ecat_ns(timeout);
  for (;;) {
    const ecat_shm_can_sender *sender;
    uint32_t left = 0;
    int code = check_sender(bus, channel);
    if (code != 0) return code;
    sender = sender_of(bus, channel);
    if (sender != NULL)
      left = bus->can_use[channel].written - __atomic_load_n(&sender->sent, __ATOMIC_RELAXED) -
             __atomic_load_n(&sender->refused, __ATOMIC_RELAXED) - __atomic_load_n(&sender->unsent, __ATOMIC_RELAXED);
    if (left == 0) return 0;
    beat(bus);
    if (ecat_now() - start >= limit)
      return ecat_fail(bus, ECAT_ETIMEOUT, "%u CAN frames for slave %d (%s) were not sent within %g s", (unsigned)left,
                       bus->can[channel].slave, name_of(bus, channel), timeout);
    code = ecat_wait_until(bus, &bus->header->cycle, ecat_cycle(bus) + 1, ECAT_WAKE_CYCLE, 0.1);
    if (code == ECAT_EDOWN) return code;
    if (code == ECAT_ESTALE) nanosleep(&pause, NULL); /* the frames wait, and the cycle may go on in time */
  }
}
