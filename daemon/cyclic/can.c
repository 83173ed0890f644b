/* CAN channels: the handshake with terminals that have a CAN bus behind them.
 *
 * Such a terminal has CAN frames in its process data, and counters of batches. It delivers received frames and
 * counts `receive_counter`; it delivers the next ones when the outputs repeat this number in `receive_echo`. The
 * engine gives it frames to send and counts `send_counter`; it gives the next ones when the inputs repeat this
 * number in `send_echo`. `transaction` says which frame was sent last. Where the numbers lie is data
 * (ecatd/etg/can_terminals.py), since each vendor has its own layout.
 *
 * The engine does this itself, between two exchanges: another thread would have to wake up in each cycle,
 * would be one cycle later, and would miss cycles on a busy machine. The work is bounded by the queues of the
 * terminal. All that happens on a channel goes into its records in the shared memory, for any number of readers. */
#include "can.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>

/* A real terminal may need four cycles for each step of the handshake. Both sides agree on the numbers for twice
 * as long before the first frame is sent. */
enum { SETTLE_EXCHANGES = 8, ERROR_WARNING = 96, ERROR_PASSIVE = 128 };
static const uint64_t TELL_AGAIN_NS = 1000000000u;

static uint32_t get(const uint8_t *from, const cyclic_can_field *field) {
  uint32_t word = 0, i;
  if (field->mask == 0) return 0;
  for (i = 0; i < field->bytes; i++) word |= (uint32_t)from[field->at + i] << (8 * i);
  return word >> field->shift & field->mask;
}

static void put(uint8_t *to, const cyclic_can_field *field, uint32_t value) {
  uint32_t i, mask = field->mask << field->shift;
  value = (value & field->mask) << field->shift;
  for (i = 0; i < field->bytes; i++) {
    uint8_t *byte = &to[field->at + i];
    *byte = (uint8_t)((*byte & ~(mask >> (8 * i))) | (value >> (8 * i)));
  }
}

/* --- records ---------------------------------------------------------------------------------- */

/* Word by word with relaxed atomics: readers may copy a record while it is overwritten. */
static void write_record(cyclic_t *c, struct can_channel *channel, ecat_shm_can_record *record) {
  enum { WORDS = sizeof *record / sizeof(uint64_t) };
  uint64_t words[WORDS], number = channel->shared->records;
  uint64_t *to = (uint64_t *)(void *)&channel->records[number % ECAT_CAN_RECORDS];
  uint32_t i;
  record->cycle = c->cycle;
  memcpy(words, record, sizeof words);
  __atomic_store_n(&channel->shared->begun, number + 1, __ATOMIC_RELAXED);
  __atomic_thread_fence(__ATOMIC_RELEASE);
  for (i = 0; i < WORDS; i++) __atomic_store_n(&to[i], words[i], __ATOMIC_RELAXED);
  __atomic_store_n(&channel->shared->records, number + 1, __ATOMIC_RELEASE);
  c->can_news |= 1u << (ECAT_WAKE_CAN + channel->number);
}

static void record_own(cyclic_t *c, struct can_channel *channel, const struct can_frame *frame, int sent,
                       uint64_t time_ns) {
  ecat_shm_can_record record = {.time_ns = time_ns,
                                .id = frame->id,
                                .kind = sent ? ECAT_CAN_SENT : ECAT_CAN_UNSENT,
                                .length = (uint8_t)frame->length,
                                .slot = (int16_t)frame->slot,
                                .generation = frame->generation,
                                .number = frame->number};
  memcpy(record.data, frame->data, sizeof record.data);
  write_record(c, channel, &record);
  if (sent)
    counter_add(&channel->shared->sent, 1);
  else
    counter_add(&channel->shared->unsent, 1);
  cyclic_can_conclude(c, channel, frame, sent);
}

static void set_state(cyclic_t *c, struct can_channel *channel, uint32_t state, uint32_t sending,
                      uint32_t receiving, uint64_t time_ns) {
  ecat_shm_can *shared = channel->shared;
  ecat_shm_can_record record = {.time_ns = time_ns, .kind = ECAT_CAN_STATE, .length = 3, .slot = -1};
  __atomic_store_n(&shared->send_errors, sending, __ATOMIC_RELAXED);
  __atomic_store_n(&shared->receive_errors, receiving, __ATOMIC_RELAXED);
  if (state == shared->state) return;
  if (state == ECAT_CAN_BUS_OFF) counter_add(&shared->bus_offs, 1);
  __atomic_store_n(&shared->state, state, __ATOMIC_RELAXED);
  record.data[0] = (uint8_t)state;
  record.data[1] = (uint8_t)(sending < 255 ? sending : 255);
  record.data[2] = (uint8_t)(receiving < 255 ? receiving : 255);
  write_record(c, channel, &record);
  (void)cyclic_emit(c, CYCLIC_EVENT_CAN_STATE, (int32_t)channel->terminal.slave, -1, state);
}

/* --- the terminal ----------------------------------------------------------------------------- */

/* Gives up the frames that the terminal had: nobody knows which of them it has sent. */
static void lose_flights(cyclic_t *c, struct can_channel *channel, uint64_t time_ns) {
  for (; channel->flight_tail != channel->flight_head; channel->flight_tail++)
    record_own(c, channel, &channel->flight[channel->flight_tail % CAN_FLIGHTS], 0, time_ns);
}

/* The terminal has left OP. Its counters begin anew when it comes back; until then the outputs hold nothing that
 * it could take for a new batch. */
static void stop(cyclic_t *c, struct can_channel *channel, uint64_t time_ns) {
  lose_flights(c, channel, time_ns);
  memset(channel->outputs, 0, channel->output_bytes);
  channel->runs = 0;
  set_state(c, channel, ECAT_CAN_STOPPED, 0, 0, time_ns);
}

/* Takes over the counters of the terminal. What it delivers now is from before, and not reported. */
static void begin(struct can_channel *channel) {
  const cyclic_can *terminal = &channel->terminal;
  channel->receive_counter = get(channel->inputs, &terminal->receive_counter);
  channel->send_counter = get(channel->inputs, &terminal->send_echo);
  put(channel->outputs, &terminal->receive_echo, channel->receive_counter);
  put(channel->outputs, &terminal->send_counter, channel->send_counter);
  put(channel->outputs, &terminal->send_count, 0);
  channel->runs = 1;
  channel->settle = SETTLE_EXCHANGES;
  channel->accepted = 0;
}

static void take_state(cyclic_t *c, struct can_channel *channel, uint64_t time_ns) {
  const cyclic_can *terminal = &channel->terminal;
  const uint8_t *inputs = channel->inputs;
  uint32_t sending = get(inputs, &terminal->send_errors), receiving = get(inputs, &terminal->receive_errors);
  uint32_t most = sending > receiving ? sending : receiving, state = ECAT_CAN_ACTIVE;
  int overflow = get(inputs, &terminal->overflow) != 0;
  if (most >= ERROR_WARNING || get(inputs, &terminal->warning)) state = ECAT_CAN_WARNING;
  if (most >= ERROR_PASSIVE || get(inputs, &terminal->passive)) state = ECAT_CAN_PASSIVE;
  if (get(inputs, &terminal->bus_off)) state = ECAT_CAN_BUS_OFF;
  if (state == ECAT_CAN_BUS_OFF && channel->shared->state != state) lose_flights(c, channel, time_ns);
  set_state(c, channel, state, sending, receiving, time_ns);
  if (overflow && !channel->overflow) {
    ecat_shm_can_record record = {.time_ns = time_ns, .kind = ECAT_CAN_OVERFLOW, .slot = -1};
    write_record(c, channel, &record);
    counter_add(&channel->shared->overflows, 1);
    if (time_ns - channel->overflow_told_ns >= TELL_AGAIN_NS &&
        cyclic_emit(c, CYCLIC_EVENT_CAN_OVERFLOW, (int32_t)terminal->slave, -1, 0))
      channel->overflow_told_ns = time_ns;
  }
  channel->overflow = overflow;
}

/* The frames up to the one that the terminal has sent last. Without such a number, a batch counts as sent when
 * the terminal has taken it. */
static void take_confirmations(cyclic_t *c, struct can_channel *channel, uint64_t time_ns) {
  uint32_t end = channel->flight_tail, at;
  if (channel->terminal.transaction.mask == 0) {
    if (channel->accepted) end = channel->flight_head;
  } else {
    uint32_t last = get(channel->inputs, &channel->terminal.transaction);
    for (at = channel->flight_tail; at != channel->flight_head; at++)
      if (channel->flight[at % CAN_FLIGHTS].transaction == last) {
        end = at + 1;
        break;
      }
  }
  for (; channel->flight_tail != end; channel->flight_tail++)
    record_own(c, channel, &channel->flight[channel->flight_tail % CAN_FLIGHTS], 1, time_ns);
}

static void take_frame(cyclic_t *c, struct can_channel *channel, const uint8_t *from, uint64_t time_ns) {
  const cyclic_can_messages *layout = &channel->terminal.received;
  ecat_shm_can_record record = {.time_ns = time_ns, .kind = ECAT_CAN_RECEIVED, .slot = -1};
  uint32_t length = get(from, &layout->length), id = get(from, &layout->identifier);
  int remote = get(from, &layout->remote) != 0;
  if (get(from, &layout->extended))
    id |= ECAT_CAN_EXTENDED;
  else
    id &= 0x7FF;
  record.id = id | (remote ? ECAT_CAN_REMOTE : 0);
  record.length = (uint8_t)(length < 8 ? length : 8);
  if (!remote) memcpy(record.data, from + layout->data, record.length);
  write_record(c, channel, &record);
}

static void take_frames(cyclic_t *c, struct can_channel *channel, uint64_t time_ns) {
  const cyclic_can *terminal = &channel->terminal;
  uint32_t counter = get(channel->inputs, &terminal->receive_counter), count, i;
  if (counter == channel->receive_counter) return;
  count = get(channel->inputs, &terminal->receive_count);
  if (count > channel->shared->receive_queue) { /* the first ones may be sound */
    counter_add(&channel->shared->malformed, 1);
    if (time_ns - channel->malformed_told_ns >= TELL_AGAIN_NS &&
        cyclic_emit(c, CYCLIC_EVENT_CAN_MALFORMED, (int32_t)terminal->slave, -1, count))
      channel->malformed_told_ns = time_ns;
    count = channel->shared->receive_queue;
  }
  for (i = 0; i < count; i++)
    take_frame(c, channel, channel->inputs + terminal->received.first + (size_t)i * terminal->received.stride,
               time_ns);
  counter_add(&channel->shared->received, count);
  channel->receive_counter = counter;
  put(channel->outputs, &terminal->receive_echo, counter);
}

static int takes_part(const cyclic_t *c, const struct can_channel *channel) {
  return (c->domain[channel->domain].absent & channel->group) == 0 &&
         __atomic_load_n(channel->al_state, __ATOMIC_RELAXED) == 8;
}

static void receive(cyclic_t *c, struct can_channel *channel, uint64_t time_ns) {
  const cyclic_can *terminal = &channel->terminal;
  if (!takes_part(c, channel)) {
    if (channel->runs) stop(c, channel, time_ns);
    return;
  }
  /* The terminal has datagrams of its own. Unless they were whole, its inputs are older ones, whose counters are
   * known. Without a handshake nobody would notice that. */
  if (!terminal->handshake && c->domain[channel->domain].wkc_state != ECAT_WKC_COMPLETE) return;
  if (!channel->runs) {
    begin(channel);
    if (channel->was_running) counter_add(&channel->shared->restarts, 1);
    channel->was_running = 1;
  }
  if (!terminal->handshake || get(channel->inputs, &terminal->send_echo) == channel->send_counter) {
    channel->accepted = 1;
    if (channel->settle > 0) channel->settle--;
  }
  take_confirmations(c, channel, time_ns); /* first: what was received may be an answer */
  take_frames(c, channel, time_ns);
  take_state(c, channel, time_ns);
}

void cyclic_can_receive(cyclic_t *c, uint64_t time_ns) {
  uint32_t i;
  for (i = 0; i < c->cans; i++)
    if (c->due >> c->can[i].domain & 1) receive(c, &c->can[i], time_ns);
  cyclic_can_count_waiting(c);
}

static void put_frame(uint8_t *to, const cyclic_can_messages *layout, const struct can_frame *frame) {
  memset(to, 0, layout->stride);
  put(to, &layout->identifier, frame->id & ECAT_CAN_ID);
  put(to, &layout->extended, (frame->id & ECAT_CAN_EXTENDED) != 0);
  put(to, &layout->remote, (frame->id & ECAT_CAN_REMOTE) != 0);
  put(to, &layout->length, frame->length);
  put(to, &layout->transaction, frame->transaction);
  memcpy(to + layout->data, frame->data, 8);
}

/* The next number of a transaction, which is never 0: the terminal says 0 before it has sent any. */
static uint32_t next_transaction(struct can_channel *channel) {
  uint32_t mask = channel->terminal.sent.transaction.mask;
  do channel->transaction = (channel->transaction + 1) & mask;
  while (channel->transaction == 0 && mask != 0);
  return channel->transaction;
}

static void send(cyclic_t *c, struct can_channel *channel) {
  const cyclic_can *terminal = &channel->terminal;
  uint32_t room = CAN_FLIGHTS - (channel->flight_head - channel->flight_tail), count, i;
  if (!channel->runs || channel->settle > 0 || !channel->accepted ||
      channel->shared->state == ECAT_CAN_BUS_OFF)
    return;
  if (room > channel->shared->send_queue) room = channel->shared->send_queue;
  count = cyclic_can_collect_safe(c, channel, channel->batch, room);
  count += cyclic_can_collect(c, channel, channel->batch + count, room - count);
  if (count == 0) return;
  for (i = 0; i < count; i++) {
    struct can_frame *frame = &channel->batch[i];
    frame->transaction = next_transaction(channel);
    put_frame(channel->outputs + terminal->sent.first + (size_t)i * terminal->sent.stride, &terminal->sent,
              frame);
    channel->flight[channel->flight_head++ % CAN_FLIGHTS] = *frame;
  }
  channel->send_counter = (channel->send_counter + 1) & terminal->send_counter.mask;
  put(channel->outputs, &terminal->send_count, count);
  put(channel->outputs, &terminal->send_counter, channel->send_counter);
  channel->accepted = 0;
}

void cyclic_can_send(cyclic_t *c) {
  uint32_t i;
  for (i = 0; i < c->cans; i++) send(c, &c->can[i]);
}

/* --- before the start ------------------------------------------------------------------------- */

static int fits(const cyclic_can_field *field, uint32_t bytes) {
  return field->mask == 0 || (field->bytes <= 4 && field->shift < 32 && field->at + field->bytes <= bytes);
}

static int messages_fit(const cyclic_can_messages *messages, uint32_t count, uint32_t bytes) {
  return messages->data + 8 <= messages->stride && messages->first + count * messages->stride <= bytes &&
         fits(&messages->identifier, messages->stride) && fits(&messages->extended, messages->stride) &&
         fits(&messages->remote, messages->stride) && fits(&messages->length, messages->stride) &&
         fits(&messages->transaction, messages->stride);
}

static int terminal_fits(const cyclic_can *terminal, const ecat_shm_can *shared, const ecat_shm_slave *slave) {
  const cyclic_can_field *inputs = &terminal->send_echo, *outputs = &terminal->send_counter;
  int i, good = 1;
  for (i = 0; i < 10; i++) good &= fits(&inputs[i], slave->input_bytes);
  for (i = 0; i < 3; i++) good &= fits(&outputs[i], slave->output_bytes);
  return good && shared->send_queue > 0 && shared->send_queue <= CAN_BATCH &&
         messages_fit(&terminal->received, shared->receive_queue, slave->input_bytes) &&
         messages_fit(&terminal->sent, shared->send_queue, slave->output_bytes);
}

/* Nobody else writes the outputs of the terminal. */
static void reserve_outputs(cyclic_t *c, const ecat_shm_slave *slave) {
  uint32_t i;
  for (i = slave->signals_first; i < slave->signals_first + slave->signals_count; i++) {
    if (!c->signals[i].output) continue;
    set_drop(c->claimable, i);
    set_add(c->reserved, i);
    c->output[i].state = ECAT_OUTPUTS_CAN;
  }
}

int cyclic_add_can(cyclic_t *c, const cyclic_can *terminal) {
  const ecat_shm_slave_status *status = (const void *)((const uint8_t *)c->header + c->header->slave_status_offset);
  ecat_shm_can *shared = (ecat_shm_can *)(void *)((uint8_t *)c->header + c->header->can_offset) + c->cans;
  const ecat_shm_slave *slave;
  struct can_channel *grown, *channel;
  if (c->started || c->cans >= c->header->can_count || c->cans >= ECAT_MAX_CAN ||
      terminal->slave >= c->header->slave_count)
    return -EINVAL;
  slave = &c->slaves[terminal->slave];
  if (!terminal_fits(terminal, shared, slave)) return -EINVAL;
  grown = realloc(c->can, (c->cans + 1) * sizeof *grown);
  if (grown == NULL) return -ENOMEM;
  c->can = grown;
  channel = &c->can[c->cans];
  memset(channel, 0, sizeof *channel);
  channel->terminal = *terminal;
  channel->number = c->cans++;
  channel->shared = shared;
  channel->records = (void *)((uint8_t *)c->header + shared->records_offset);
  channel->domain = slave->domain;
  channel->group = slave->group < 0 ? 0 : (uint64_t)1 << slave->group;
  channel->al_state = &status[terminal->slave].al_state;
  channel->inputs = c->domain[slave->domain].image + slave->input_offset;
  channel->outputs = c->outputs + c->domain[slave->domain].output_base + slave->output_offset;
  channel->output_bytes = slave->output_bytes;
  reserve_outputs(c, slave);
  return 0;
}

int cyclic_add_can_safe(cyclic_t *c, const cyclic_can_safe *frame) {
  struct can_channel *channel;
  if (c->started || c->cans == 0 || frame->length > 8 || 
      frame->range_count > sizeof frame->ranges / sizeof *frame->ranges)
    return -EINVAL;
  channel = &c->can[c->cans - 1];
  if (channel->safes == CAN_SAFE) return -ENOSPC;
  channel->safe[channel->safes++].frame = *frame;
  return 0;
}

void cyclic_can_prefault(cyclic_t *c, void (*prefault)(void *memory, size_t size)) {
  prefault(c->can, c->cans * sizeof *c->can);
}
