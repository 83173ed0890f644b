/* CAN behind a terminal, in a session: the messages of a program, and their signals. */
#include "session.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "internal.h"

#define RECLAIM_NS 100000000u /* between two claims of one channel */
#define LAST_FRAMES_S 0.2     /* that frames have to be sent in when the session ends */
#define EXACT 1e-9            /* part of a limit that rounding may have changed */

enum { FRAMES = 64 };         /* that are read in one call */

static int fail(const ecat_session_message *message, int code, const char *what) {
  const ecat_session_slave *slave = message->slave;
  char text[ECAT_SESSION_TEXT];
  snprintf(text, sizeof text, "%s", what); /* it may be the error text itself */
  return ecat_session_fail(slave->session, code, "%sCAN message 0x%X%s of slave %d (%s): %s",
                           session_heading(slave), (unsigned)(message->id & ECAT_CAN_ID),
                           message->id & ECAT_CAN_EXTENDED ? " (29 bits)" : "", slave->position, slave->name, text);
}

/* --- bits ------------------------------------------------------------------------------------- */

static uint64_t word_of(const uint8_t data[8], int big_endian) {
  uint64_t word = 0;
  int i;
  for (i = 0; i < 8; i++) word = word << 8 | data[big_endian ? i : 7 - i];
  return word;
}

static void set_word(uint8_t data[8], int big_endian, uint64_t word) {
  int i;
  for (i = 0; i < 8; i++, word >>= 8) data[big_endian ? 7 - i : i] = (uint8_t)word;
}

static uint64_t ones(int bits) { return bits >= 64 ? ~(uint64_t)0 : ((uint64_t)1 << bits) - 1; }

/* Bits from the start of the data to the end of a signal, in the order in which they are counted. */
static int end_of(int start, int length, int big_endian) {
  return (big_endian ? start / 8 * 8 + 7 - start % 8 : start) + length;
}

/* Bytes of the data up to the end of a signal. */
static int bytes_to(int start, int length, int big_endian) { return (end_of(start, length, big_endian) + 7) / 8; }

static int most(int one, int other) { return one > other ? one : other; }

/* The place of the lowest bit of a signal in its word. */
static int shift_of(int start, int length, int big_endian) {
  return big_endian ? 64 - end_of(start, length, 1) : start;
}

static uint64_t get_bits(const uint8_t data[8], int start, int length, int big_endian) {
  return word_of(data, big_endian) >> shift_of(start, length, big_endian) & ones(length);
}

static void put_bits(uint8_t data[8], const ecat_session_signal *signal, uint64_t bits) {
  int shift = shift_of(signal->start, signal->length, signal->big_endian);
  uint64_t mask = ones(signal->length) << shift, word = word_of(data, signal->big_endian);
  set_word(data, signal->big_endian, (word & ~mask) | (bits << shift & mask));
}

/* Whether a frame with these data has the signal. */
static int has(const uint8_t data[8], const ecat_session_signal *signal) {
  double value;
  if (signal->selector.length == 0) return 1;
  value = (double)get_bits(data, signal->selector.start, signal->selector.length, signal->selector.big_endian);
  return value >= signal->selector.low && value <= signal->selector.high;
}

/* --- messages and signals ----------------------------------------------------------------------- */

int session_can_find(ecat_session_slave *slave) {
  ecat_session *session = slave->session;
  int code = ecat_can_find(session->bus, slave->position);
  if (code < 0) return ecat_session_fail(session, code, "%s%s", session_heading(slave), ecat_error(session->bus));
  slave->can = code;
  code = ecat_can_listen(session->bus, slave->can);
  if (code == 0) code = ecat_can(session->bus, slave->can, &session->can[slave->can]);
  return ecat_session_client(session, code);
}

int ecat_session_add_can(ecat_session_slave *slave) {
  if (slave->has_can) return 0;
  slave->has_can = 1;
  return slave->session->bus != NULL ? session_can_find(slave) : 0;
}

static int same_terminal(const ecat_session_slave *one, const ecat_session_slave *other) {
  const char *name = one->given_name != NULL ? one->given_name : "";
  const char *other_name = other->given_name != NULL ? other->given_name : "";
  return one == other || (strcmp(name, other_name) == 0 && (name[0] != '\0' || one->position == other->position));
}

static int same_sending(const ecat_session_message *one, const ecat_session_message *other) {
  return one->length == other->length && one->transmission == other->transmission && one->period == other->period &&
         one->reserve == other->reserve;
}

/* Checks a message against the channel that was found. */
static int check_on_bus(const ecat_session_message *message) {
  const ecat_session *session = message->slave->session;
  const ecat_session_message *other;
  if (message->id & ECAT_CAN_EXTENDED && session->can[message->slave->can].identifier_bits != 29)
    return fail(message, ECAT_EBUS, "the CAN channel of the terminal has identifiers of 11 bits only (identifiers in "
                "[slave.can] of the configuration of the daemon)");
  for (other = session->messages; message->sends && other != NULL && other != message; other = other->next)
    if (other->sends && other->id == message->id && other->frame != message->frame && other->slave->has_can &&
        other->slave->can == message->slave->can)
      return fail(message, ECAT_EARG, "two blocks send it, and one has the terminal by its name, the other one by its "
                  "position; give both the name, or both the position");
  return 0;
}

/* A new connection: what was received and sent before does not count. */
static int begin(ecat_session_message *message) {
  message->fresh = message->told = 0;
  message->triggered = message->trigger;
  return check_on_bus(message);
}

int session_can_resolve(ecat_session *session) {
  ecat_session_message *message = session->messages;
  int code = 0;
  session->can_claimed = 0;
  memset(session->can_claimed_ns, 0, sizeof session->can_claimed_ns);
  for (; message != NULL && code == 0; message = message->next) code = begin(message);
  return code;
}

int ecat_session_add_message(ecat_session_message *message) {
  ecat_session *session = message->slave->session;
  ecat_session_message **last = &session->messages;
  uint32_t id = message->id & ECAT_CAN_ID;
  int code;
  if (message->id & ~(ECAT_CAN_ID | ECAT_CAN_EXTENDED | ECAT_CAN_REMOTE) ||
      (!(message->id & ECAT_CAN_EXTENDED) && id > 0x7FF))
    return fail(message, ECAT_EARG, "this is no identifier: it has 11 bits, or 29 bits if it is extended");
  if (message->length < 0 || message->length > 8)
    return fail(message, ECAT_EARG, "a CAN frame has 0 to 8 bytes of data");
  if (!(message->timeout >= 0) || !(message->period >= 0))
    return fail(message, ECAT_EARG, "neither its period nor its timeout can be negative");
  if (message->sends && message->transmission == ECAT_SESSION_PERIODIC && message->period == 0)
    return fail(message, ECAT_EARG, "it is sent periodically, so it needs a period");
  message->frame = message;
  message->age = ECAT_AGE_NEVER;
  if ((code = ecat_session_add_can(message->slave)) != 0) return code;
  for (; *last != NULL; last = &(*last)->next) {
    ecat_session_message *other = *last;
    if (!message->sends || !other->sends || other->id != message->id || message->frame != message ||
        !same_terminal(other->slave, message->slave))
      continue;
    if (!same_sending(message, other->frame))
      return fail(message, ECAT_EARG, "two blocks send it with different length, transmission, period or reserve; "
                  "they must be equal, since both have signals of the same frame");
    message->frame = other->frame;
  }
  if (session->bus != NULL && (code = check_on_bus(message)) != 0) return code;
  *last = message;
  return 0;
}

/* A limit of a value as a limit of its bits. */
static double raw_limit(const ecat_session_signal *signal, double limit) {
  double raw = ecat_to_raw(limit, signal->scale, signal->offset), whole = ecat_round(raw);
  if (signal->number == ECAT_SESSION_FLOAT) return raw;
  return fabs(raw - whole) <= EXACT * fmax(1, fabs(raw)) ? whole : raw;
}

static void describe(ecat_session_signal *signal) {
  ecat_signal_info *entry = &signal->as_entry;
  double one = raw_limit(signal, signal->minimum), other = raw_limit(signal, signal->maximum);
  entry->type = signal->number == ECAT_SESSION_FLOAT    ? (signal->length == 32 ? 0x0008 : 0x0011)
                : signal->number == ECAT_SESSION_SIGNED ? 0x0015
                                                        : 0x001B;
  entry->bit_length = (unsigned)signal->length;
  entry->scale = signal->scale;
  entry->offset = signal->offset;
  entry->unit = signal->unit != NULL ? signal->unit : "";
  entry->minimum = fmin(one, other);
  entry->maximum = fmax(one, other);
}

/* The bits of a signal in a frame, the first byte being the lowest. */
static uint64_t mask_of(const ecat_session_signal *signal) {
  uint8_t data[8] = {0};
  put_bits(data, signal, ~(uint64_t)0);
  return word_of(data, 0);
}

/* Whether no frame has both signals, since they need different values of the same other one. */
static int exclude(const ecat_session_signal *one, const ecat_session_signal *other) {
  return one->selector.length > 0 && one->selector.length == other->selector.length &&
         one->selector.start == other->selector.start && one->selector.big_endian == other->selector.big_endian &&
         (one->selector.high < other->selector.low || other->selector.high < one->selector.low);
}

static int fits(int start, int length, int big_endian, int bytes) {
  return start >= 0 && start < 64 && length >= 1 && length <= 64 && end_of(start, length, big_endian) <= 8 * bytes;
}

static int fail_signal(const ecat_session_signal *signal, const char *why) {
  char text[300];
  snprintf(text, sizeof text, "signal %.100s (start bit %d, %d bits) %s", signal->name, signal->start, signal->length,
           why);
  return fail(signal->message, ECAT_EARG, text);
}

int ecat_session_add_signal(ecat_session_signal *signal) {
  ecat_session_message *message = signal->message, *frame = message->frame;
  const ecat_session_signal *other;
  ecat_session_signal **last = &frame->signals;
  int bytes = message->sends ? message->length : 8;
  if (!fits(signal->start, signal->length, signal->big_endian, bytes) ||
      (signal->selector.length != 0 &&
       !fits(signal->selector.start, signal->selector.length, signal->selector.big_endian, bytes)))
    return fail_signal(signal, "does not lie within the data of the message: look at its length");
  if (signal->number == ECAT_SESSION_FLOAT && signal->length != 32 && signal->length != 64)
    return fail_signal(signal, "is no floating-point number: these have 32 or 64 bits");
  if (!(signal->scale < 0 || signal->scale > 0) || !isfinite(signal->scale) || !isfinite(signal->offset))
    return fail_signal(signal, "cannot be scaled: its scale must be a finite number other than 0, its offset finite");
  if (!(signal->minimum <= signal->maximum)) return fail_signal(signal, "has a minimum above its maximum");
  describe(signal);
  signal->mask = mask_of(signal);
  for (other = frame->signals; message->sends && other != NULL; other = other->next)
    if ((other->mask & signal->mask) != 0 && !exclude(other, signal)) {
      char why[160];
      snprintf(why, sizeof why, "has bits of signal %.100s, too", other->name);
      return fail_signal(signal, why);
    }
  if (!message->sends && signal->selector.length == 0)
    message->length = most(message->length, bytes_to(signal->start, signal->length, signal->big_endian));
  while (*last != NULL) last = &(*last)->next;
  *last = signal;
  return 0;
}

void session_can_flush(ecat_session *session) {
  int i;
  if (session->outage != 0) return;
  for (i = 0; i < ECAT_MAX_CAN; i++)
    if (session->can_claimed >> i & 1) (void)ecat_can_flush(session->bus, i, LAST_FRAMES_S);
}

void session_can_forget(ecat_session *session) {
  ecat_session_message *message;
  ecat_session_signal *signal;
  session->can_claimed = 0;
  session->samples = session->exchanged_cycle = 0;
  for (message = session->messages; message != NULL; message = message->next) {
    message->fresh = message->told = message->valid = message->trigger = message->triggered = 0;
    message->count = message->missed = 0;
    message->asked = message->handed = message->time_ns = 0;
    message->age = ECAT_AGE_NEVER;
    memset(message->data, 0, sizeof message->data);
    for (signal = message->signals; signal != NULL; signal = signal->next) signal->raw = 0;
  }
}

/* --- receiving -------------------------------------------------------------------------------- */

/* The fewest bytes of a frame with these data that have all its signals: multiplexed ones count if it has them. */
static int needed(const ecat_session_message *message, const uint8_t data[8]) {
  const ecat_session_signal *signal;
  int bytes = message->length;
  for (signal = message->signals; signal != NULL; signal = signal->next) {
    if (signal->selector.length == 0) continue; /* it is in the length of the message */
    bytes = most(bytes, bytes_to(signal->selector.start, signal->selector.length, signal->selector.big_endian));
    if (has(data, signal)) bytes = most(bytes, bytes_to(signal->start, signal->length, signal->big_endian));
  }
  return bytes;
}

static void take(ecat_session_message *message, const ecat_can_frame *frame) {
  ecat_session_signal *signal;
  uint8_t data[8] = {0};
  int least;
  if (!(frame->id & ECAT_CAN_REMOTE)) memcpy(data, frame->data, frame->length);
  least = needed(message, data);
  if (frame->length < least) {
    message->missed++;
    if (!message->told)
      session_tell(message->slave->session, 1, "%sCAN message 0x%X of slave %d (%s) has %d bytes, but at least %d are "
                   "needed; such frames are left out", session_heading(message->slave),
                   (unsigned)(message->id & ECAT_CAN_ID), message->slave->position, message->slave->name,
                   (int)frame->length, least);
    message->told = 1;
    return;
  }
  memcpy(message->data, data, sizeof message->data);
  message->data_length = frame->length;
  message->count++;
  message->time_ns = frame->time_ns;
  message->fresh = 1;
  for (signal = message->signals; signal != NULL; signal = signal->next)
    if (has(data, signal))
      signal->raw = get_bits(data, signal->start, signal->length, signal->big_endian);
}

/* Reads the frames of a channel up to the cycle of the sample. Those of this session are no news to it. */
static int read_channel(ecat_session *session, int channel) {
  ecat_can_frame frames[FRAMES];
  ecat_session_message *message;
  int i, count;
  do {
    count = ecat_can_read(session->bus, channel, frames, FRAMES, session->exchanged_cycle);
    if (count < 0) return session_passes(count) ? 0 : ecat_session_client(session, count); /* the next sample finds it */
    for (i = 0; i < count; i++) {
      const ecat_can_frame *frame = &frames[i];
      if (frame->own || (frame->kind != ECAT_CAN_RECEIVED && frame->kind != ECAT_CAN_SENT)) continue;
      for (message = session->messages; message != NULL; message = message->next)
        if (message->id == frame->id && !message->sends && message->slave->can == channel) take(message, frame);
    }
  } while (count == FRAMES);
  return ecat_session_client(session, ecat_can(session->bus, channel, &session->can[channel]));
}

/* Whether frames go to and from the CAN bus of a message. */
static int works(const ecat_session_message *message) {
  const ecat_session_slave *slave = message->slave;
  int state = slave->session->can[slave->can].state;
  return slave->al_state == ECAT_SESSION_OP && state != ECAT_CAN_STOPPED && state != ECAT_CAN_BUS_OFF;
}

static void grow_old(ecat_session_message *message, uint64_t now) {
  if (message->sends || message->time_ns == 0) return;
  message->age = now > message->time_ns ? (double)(now - message->time_ns) * 1e-9 : 0;
}

int session_can_observe(ecat_session *session) {
  ecat_session_slave *slave;
  ecat_session_message *message;
  unsigned done = 0;
  uint64_t now;
  int code = 0;
  for (slave = session->slaves; slave != NULL && code == 0; slave = slave->next) {
    if (!slave->has_can || done >> slave->can & 1) continue;
    done |= 1u << slave->can;
    code = read_channel(session, slave->can);
  }
  if (done == 0) return code;
  now = ecat_now();
  for (message = session->messages; message != NULL; message = message->next) {
    if (!works(message)) message->fresh = 0;
    grow_old(message, now);
    message->valid = !message->sends && message->fresh && message->slave->valid &&
                     (message->timeout == 0 || message->age <= message->timeout);
  }
  return code;
}

void session_can_observe_nothing(ecat_session *session) {
  ecat_session_message *message;
  uint64_t now = ecat_now();
  int i;
  for (i = 0; i < ECAT_MAX_CAN; i++) session->can[i].state = ECAT_CAN_STOPPED;
  for (message = session->messages; message != NULL; message = message->next) {
    message->valid = message->fresh = 0;
    grow_old(message, now);
  }
}

int ecat_session_can_state(const ecat_session_slave *slave, ecat_can_info *info) {
  *info = slave->session->can[slave->can];
  return info->state + 1;
}

int64_t ecat_session_can_read_int(const ecat_session_signal *signal) {
  if (signal->number == ECAT_SESSION_FLOAT) return (int64_t)ecat_session_can_read(signal);
  return signal->number == ECAT_SESSION_SIGNED ? sign_extended(signal->raw, (uint32_t)signal->length)
                                               : (int64_t)signal->raw;
}

double ecat_session_can_read(const ecat_session_signal *signal) {
  double raw = raw_to_double(signal->raw, (uint32_t)signal->length, signal->number == ECAT_SESSION_SIGNED,
                             signal->number == ECAT_SESSION_FLOAT);
  return ecat_to_physical(raw, signal->scale, signal->offset);
}

/* --- sending ---------------------------------------------------------------------------------- */

static void note(ecat_session_signal *signal) {
  signal->written = signal->message->slave->session->samples + 1;
}

void ecat_session_can_write(ecat_session_signal *signal, double value) {
  signal->real = value;
  signal->is_whole = 0;
  note(signal);
}

void ecat_session_can_write_int(ecat_session_signal *signal, int64_t value) {
  signal->whole = value;
  signal->real = (double)value;
  signal->is_whole = !value_is_analog(signal->as_entry.unit, signal->scale, signal->offset);
  note(signal);
}

void ecat_session_can_data(ecat_session_message *message, const uint8_t *data, int length) {
  ecat_session_message *frame = message->frame;
  memset(frame->data, 0, sizeof frame->data);
  memcpy(frame->data, data, (size_t)length);
  frame->data_length = length;
}

void ecat_session_can_trigger(ecat_session_message *message, int count) { message->frame->trigger = count; }

static int put_signal(uint8_t data[8], const ecat_session_signal *signal) {
  char text[300];
  double low, high, first, last;
  uint64_t bits;
  int code = signal->is_whole ? ecat_encode_int(&signal->as_entry, signal->whole, &bits)
                              : ecat_encode_physical(&signal->as_entry, signal->real, &bits);
  if (code == 0) {
    put_bits(data, signal, bits);
    return 0;
  }
  ecat_limits(&signal->as_entry, &low, &high);
  first = ecat_to_physical(low, signal->scale, signal->offset);
  last = ecat_to_physical(high, signal->scale, signal->offset);
  snprintf(text, sizeof text, "%.15g is out of range for signal %.100s: %.15g to %.15g are allowed", signal->real,
           signal->name, fmin(first, last), fmax(first, last));
  return fail(signal->message, code, text);
}

/* Makes the data of a frame of the values of its signals: first of those that are in every frame, since they say
 * which of the others are in this one. */
static int pack(ecat_session_message *frame) {
  const ecat_session_signal *signal;
  int selected, code = 0;
  if (frame->signals == NULL) return 0;
  memset(frame->data, 0, sizeof frame->data);
  frame->data_length = frame->length;
  for (selected = 0; selected < 2; selected++)
    for (signal = frame->signals; signal != NULL && code == 0; signal = signal->next)
      if (signal->written != 0 && (signal->selector.length > 0) == selected && has(frame->data, signal))
        code = put_signal(frame->data, signal);
  return code;
}

static double bus_time(const ecat_session *session) {
  return (double)session->exchanged_cycle * ecat_cycle_time(session->bus);
}

static int is_due(const ecat_session_message *frame) {
  const ecat_session *session = frame->slave->session;
  int in_time = frame->period > 0 && bus_time(session) >= frame->due - ecat_cycle_time(session->bus) / 2;
  switch (frame->transmission) {
    case ECAT_SESSION_ON_CHANGE:
      return !frame->fresh || in_time || frame->data_length != frame->sent_length ||
             memcmp(frame->data, frame->sent, sizeof frame->data) != 0;
    case ECAT_SESSION_PERIODIC: return !frame->fresh || in_time;
    case ECAT_SESSION_ON_TRIGGER: return frame->trigger != frame->triggered;
    default: return 1;
  }
}

static int by_number(const void *one, const void *other) {
  uint32_t a = *(const uint32_t *)one, b = *(const uint32_t *)other;
  return (a > b) - (a < b);
}

/* The identifiers that this session reserves on a channel, in at most ECAT_CAN_RANGES ranges. Returns how many, or
 * an error code. */
static int reserved(const ecat_session_message *frame, ecat_can_range *ranges) {
  const ecat_session_message *message;
  uint32_t ids[256];
  int i, count = 0, used = 0;
  for (message = frame->slave->session->messages; message != NULL && count < 256; message = message->next)
    if (message->sends && message->reserve && message->slave->can == frame->slave->can)
      ids[count++] = message->id & ~ECAT_CAN_REMOTE;
  qsort(ids, (size_t)count, sizeof *ids, by_number);
  for (i = 0; i < count; i++) {
    if (used > 0 && ids[i] <= ranges[used - 1].last + 1) {
      ranges[used - 1].last = ids[i];
    } else if (used < ECAT_CAN_RANGES) {
      ranges[used].first = ranges[used].last = ids[i];
      used++;
    } else {
      return fail(frame, ECAT_EARG, "its identifier cannot be reserved: the identifiers that the program reserves are "
                  "more than 8 ranges; reserve fewer");
    }
  }
  return used;
}

/* Becomes a sender of the channel. ECAT_ELEASE: it is too early to claim it again. */
static int claim(const ecat_session_message *frame) {
  ecat_session *session = frame->slave->session;
  int channel = frame->slave->can, code;
  uint64_t now = ecat_now();
  ecat_can_range ranges[ECAT_CAN_RANGES];
  if (session->can_claimed_ns[channel] != 0 && now - session->can_claimed_ns[channel] < RECLAIM_NS) return ECAT_ELEASE;
  session->can_claimed_ns[channel] = now;
  if (ecat_slot_lapsed(session->bus)) session_forget_claims(session); /* the next stage claims outputs again */
  if ((code = reserved(frame, ranges)) < 0) return code;
  /* With a lease of 0 a thread would give signs of life, also for a program that hangs; the engine makes the
   * shortest lease of this one. */
  code = ecat_can_claim(session->bus, channel, session->settings.lease > 0 ? session->settings.lease : 1e-9, ranges,
                        (size_t)code);
  if (code == 0)
    session->can_claimed |= 1u << channel;
  else
    fail(frame, code, ecat_error(session->bus));
  return code;
}

/* Whether this session still sends on the channel, 0 or an error code. Messages begin anew after a loss. */
static int check_claim(const ecat_session_message *frame) {
  ecat_session *session = frame->slave->session;
  ecat_session_message *message;
  int channel = frame->slave->can, code = 0;
  if (session->can_claimed >> channel & 1) {
    code = ecat_session_client(session, ecat_can_send(session->bus, channel, NULL, 0, NULL));
    if (code == 0) return 0;
    session->can_claimed &= ~(1u << channel);
  }
  for (message = session->messages; message != NULL; message = message->next)
    if (message->sends && message->slave->can == channel) message->fresh = 0;
  return code;
}

static void cannot_send(ecat_session_message *frame, const char *why) {
  if (frame->transmission != ECAT_SESSION_ON_CHANGE) frame->missed++; /* else it is sent later */
  frame->triggered = frame->trigger;
  if (why != NULL && !frame->told)
    session_tell(frame->slave->session, 1, "%s%s; messages of %s are not sent", session_heading(frame->slave), why,
                 frame->slave->session->settings.program);
  if (why != NULL) frame->told = 1;
}

static int put(ecat_session_message *frame) {
  ecat_session *session = frame->slave->session;
  ecat_can_frame out;
  double now = bus_time(session), next = frame->due + frame->period;
  int code;
  memset(&out, 0, sizeof out);
  out.id = frame->id;
  out.length = (uint8_t)frame->data_length;
  memcpy(out.data, frame->data, sizeof out.data);
  code = ecat_can_send(session->bus, frame->slave->can, &out, 1, NULL);
  if (code == ECAT_EFULL) {
    cannot_send(frame, ecat_error(session->bus));
    return 0;
  }
  if (code < 0) return fail(frame, code, ecat_error(session->bus));
  frame->due = frame->fresh && now < next ? next : now + frame->period;
  frame->fresh = 1;
  frame->told = 0;
  frame->count++;
  frame->triggered = frame->trigger;
  memcpy(frame->sent, frame->data, sizeof frame->sent);
  frame->sent_length = frame->data_length;
  return 0;
}

/* Decides, once in a sample, whether a frame is sent, and sends it. */
static int hand_over(ecat_session_message *frame) {
  ecat_session *session = frame->slave->session;
  int code;
  frame->handed = session->samples;
  if ((code = pack(frame)) != 0) return code;
  if ((code = check_claim(frame)) != 0) return session_not_written(session, code);
  if (!is_due(frame)) return 0;
  if (!works(frame)) {
    cannot_send(frame, NULL);
    return 0;
  }
  if (!(session->can_claimed >> frame->slave->can & 1)) {
    code = claim(frame);
    /* The next sample tries again, or finds out that the daemon has ended. */
    if (code == ECAT_ELEASE || code == ECAT_EDOWN) return 0;
  }
  if (code == 0) code = put(frame);
  return code != 0 ? session_not_written(session, code) : 0;
}

static int is_complete(const ecat_session_message *frame) {
  const ecat_session_signal *signal = frame->signals;
  while (signal != NULL && signal->written == frame->slave->session->samples + 1) signal = signal->next;
  return signal == NULL;
}

static int is_possible(const ecat_session *session) {
  return session->bus != NULL && session->outage == 0 && !session->settings.read_only;
}

int ecat_session_can_send(ecat_session_message *message, int complete) {
  ecat_session_message *frame = message->frame;
  ecat_session *session = frame->slave->session;
  if (!is_possible(session)) {
    frame->triggered = frame->trigger;
    return 0;
  }
  if (frame->handed == session->samples) return 0;
  frame->asked = session->samples;
  return complete && !is_complete(frame) ? 0 : hand_over(frame);
}

int session_can_settle(ecat_session *session) {
  ecat_session_message *frame = session->messages;
  int code = 0;
  for (; frame != NULL && code == 0 && is_possible(session); frame = frame->next)
    if (frame->asked == session->samples && frame->handed != session->samples) code = hand_over(frame);
  return code;
}
