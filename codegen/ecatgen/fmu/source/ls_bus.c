/* The bus simulation of FMI-LS-BUS whose bus is real. */
#ifndef _GNU_SOURCE
#define _GNU_SOURCE
#endif
#include "ls_bus.h"

#include <stdlib.h>
#include <string.h>

#include "ls_operations.h"

enum {
  BACKLOG = 1 << 16,  /* bytes of operations that wait for an ECU, and that it may send at once */
  WAITING = 256,      /* frames of an ECU that wait for room in the queue of the client */
  SENT = 1024,        /* frames of all ECUs without an answer; more than the client and the terminal hold */
  RECORDS = 128       /* records that are read at once */
};

#define FLUSH 0.2 /* s */

/* What an ECU has been told in words. Each is said once, and counted always: the ECU may be hostile. */
enum {
  TOLD_WRONG = 1 << 0,
  TOLD_FULL = 1 << 1,
  TOLD_LATE = 1 << 2,
  TOLD_LONG = 1 << 3,
  TOLD_BAUD_RATE = 1 << 4,
  TOLD_ARBITRATION = 1 << 5,
  TOLD_WAKEUP = 1 << 6,
  TOLD_ITS_ERROR = 1 << 7,
  TOLD_REFUSED = 1 << 8,
  TOLD_OFF = 1 << 9
};

typedef struct ls_ecu {
  unsigned number; /* 0 first; users count from 1 */
  unsigned told;
  int off; /* it says that it is bus-off */
  uint32_t bit_rate; /* that it has configured, 0: none */
  int rx_active, tx_active;  /* its clocks, in this event */
  int tx_seen;               /* a Tx_Clock that is an output has ticked, and the importer has seen it */
  int changed;               /* the importer does not know yet when Tx_Clock is to tick */
  size_t received, backlog, taken; /* bytes; `taken`: of the backlog, which the importer takes in this event */
  uint8_t from[BACKLOG], to[BACKLOG];
  size_t first, waiting;
  ecat_can_frame frames[WAITING];
} ls_ecu;

/* A frame that was given to the client. */
typedef struct ls_sent {
  uint64_t sender; /* of the client then; 0: no frame */
  uint32_t number;
  ls_ecu *ecu;
  int answered; /* its ECU has a Confirm or an error, or waits for none */
  ecat_can_frame frame;
} ls_sent;

struct ls_bus {
  ls_ecu *ecus;
  size_t count;
  int channel;
  unsigned listens;      /* connection of the session that is listened to */
  uint64_t sender;       /* of the claim; 0: none */
  uint32_t last, oldest; /* number of the frame that was given last, and of the first that may be open */
  size_t turn;           /* the ECU whose frame is next */
  uint64_t reclaimed_cycle, settled_cycle;
  ls_sent sent[SENT];
  ecat_can_info info;
  unsigned send_errors; /* of the last record of the state */
  uint64_t missed;
  uint32_t frames_sent, frames_received, refused, lost;
};

/* --- memory ------------------------------------------------------------------------------------ */

ls_bus *ls_bus_new(size_t count) {
  ls_bus *b = calloc(1, sizeof *b);
  if (b == NULL) return NULL;
  b->ecus = calloc(count, sizeof *b->ecus);
  b->count = count;
  if (b->ecus == NULL) {
    free(b);
    return NULL;
  }
  ls_bus_clear(b);
  return b;
}

void ls_bus_free(ls_bus *b) {
  if (b == NULL) return;
  free(b->ecus);
  free(b);
}

void ls_bus_clear(ls_bus *b) {
  ls_ecu *ecus = b->ecus;
  size_t i, count = b->count;
  memset(b, 0, sizeof *b);
  b->ecus = ecus;
  b->count = count;
  for (i = 0; i < count; i++) {
    ls_ecu *e = &ecus[i];
    e->number = (unsigned)i;
    e->told = 0;
    e->off = e->rx_active = e->tx_active = e->tx_seen = 0;
    e->bit_rate = 0;
    e->changed = 1;
    e->received = e->backlog = e->taken = e->first = e->waiting = 0;
  }
}

/* --- to the ECUs ------------------------------------------------------------------------------- */

/* Whether something is to be said to this ECU for the first time. */
static int first_time(ls_ecu *e, unsigned what) {
  int first = (e->told & what) == 0;
  e->told |= what;
  return first;
}

static void give(plant *p, ls_ecu *e, const uint8_t *operation, size_t length) {
  if (length <= BACKLOG - e->backlog) {
    memcpy(e->to + e->backlog, operation, length);
    e->backlog += length;
    return;
  }
  p->ls_bus->lost++;
  if (first_time(e, TOLD_LATE))
    plant_say(p, PLANT_WARNING, "Ecu%u: %d bytes of operations wait for this ECU, and further ones are lost: the "
              "importer does not activate its Tx_Clock often enough ('interval', or its step)", e->number + 1, BACKLOG);
}

static void refuse(plant *p, ls_ecu *e, const uint8_t *operation, size_t length) {
  uint8_t answer[LS_BATCH];
  p->ls_bus->refused++;
  give(p, e, answer, ls_format_error(answer, operation, length));
}

static uint32_t id_of(const ecat_can_frame *frame) {
  return frame->id & ~(uint32_t)(ECAT_CAN_EXTENDED | ECAT_CAN_REMOTE);
}

static size_t transmit(uint8_t *to, const ecat_can_frame *frame) {
  static const uint8_t nothing[8];
  int remote = (frame->id & ECAT_CAN_REMOTE) != 0;
  return ls_transmit(to, id_of(frame), (frame->id & ECAT_CAN_EXTENDED) != 0, remote, remote ? nothing : frame->data,
                     frame->length <= 8 ? frame->length : 8);
}

static void refuse_frame(plant *p, ls_ecu *e, const ecat_can_frame *frame, const char *why) {
  uint8_t operation[LS_TRANSMIT_BYTES + 8];
  refuse(p, e, operation, transmit(operation, frame));
  if (first_time(e, TOLD_REFUSED))
    plant_say(p, PLANT_WARNING, "Ecu%u: a frame was not sent: %s; this ECU is told by Format Error, here and later",
              e->number + 1, why);
}

static void transmit_to_all_but(plant *p, const ls_ecu *sender, const ecat_can_frame *frame) {
  uint8_t operation[LS_TRANSMIT_BYTES + 8];
  size_t i, length = transmit(operation, frame);
  for (i = 0; i < p->ls_bus->count; i++)
    if (&p->ls_bus->ecus[i] != sender) give(p, &p->ls_bus->ecus[i], operation, length);
}

static void confirm(plant *p, ls_ecu *e, const ecat_can_frame *frame) {
  uint8_t operation[LS_BATCH];
  p->ls_bus->frames_sent++;
  give(p, e, operation, ls_confirm(operation, id_of(frame)));
}

/* Nobody has acknowledged a frame. A terminal does not say which error it was. */
static void bus_error(plant *p, const ls_ecu *sender, const ecat_can_frame *frame) {
  uint8_t operation[LS_BATCH];
  size_t i;
  for (i = 0; i < p->ls_bus->count; i++) {
    ls_ecu *e = &p->ls_bus->ecus[i];
    give(p, e, operation, ls_bus_error(operation, id_of(frame), LS_ACK_ERROR, e == sender ? LS_PRIMARY : LS_SECONDARY,
                                       e == sender));
  }
}

/* --- frames without an answer ------------------------------------------------------------------ */

static ls_sent *sent_as(ls_bus *b, uint64_t sender, uint32_t number) {
  ls_sent *s = &b->sent[number % SENT];
  return sender != 0 && s->sender == sender && s->number == number ? s : NULL;
}

/* A frame is refused by the daemon if another client has reserved its identifier meanwhile. There is no record
 * of it, but frames are sent in their order. */
static void refuse_until(plant *p, uint32_t end) {
  ls_bus *b = p->ls_bus;
  for (; b->oldest != end; b->oldest++) {
    ls_sent *s = sent_as(b, b->sender, b->oldest);
    if (s == NULL || s->answered) continue;
    s->answered = 1;
    refuse_frame(p, s->ecu, &s->frame, "another client has reserved its identifier");
  }
}

static const ls_sent *first_open(ls_bus *b) {
  uint32_t number;
  for (number = b->oldest; number != b->last + 1; number++) {
    const ls_sent *s = sent_as(b, b->sender, number);
    if (s != NULL && !s->answered) return s;
  }
  return NULL;
}

/* Nobody knows what became of the frames that were sent. */
static void forget_sent(plant *p) {
  ls_bus *b = p->ls_bus;
  size_t i;
  for (i = 0; i < SENT; i++) {
    ls_sent *s = &b->sent[i];
    if (s->sender == 0 || s->answered) continue;
    s->answered = 1;
    bus_error(p, s->ecu, &s->frame);
  }
  b->oldest = b->last + 1;
}

static ls_ecu *next_in_turn(ls_bus *b) {
  size_t i;
  for (i = 0; i < b->count; i++) {
    ls_ecu *e = &b->ecus[(b->turn + i) % b->count];
    if (e->waiting == 0) continue;
    b->turn = (b->turn + i + 1) % b->count;
    return e;
  }
  return NULL;
}

static void unqueue(ls_ecu *e) {
  e->first = (e->first + 1) % WAITING;
  e->waiting--;
}

/* The claim has ended, or the bus. Frames that wait are not sent later, when nobody expects them any more. */
static void lose_claim(plant *p) {
  ls_ecu *e;
  forget_sent(p);
  while ((e = next_in_turn(p->ls_bus)) != NULL) {
    bus_error(p, e, &e->frames[e->first]);
    unqueue(e);
  }
  p->ls_bus->sender = 0;
}

/* --- what happens on the channel --------------------------------------------------------------- */

static void take_state(plant *p, const ecat_can_frame *record) {
  static const char *const states[] = {"the terminal is not in OP", "error active again", "an error counter has reached 96",
                                       "error passive: check the cable, the termination and the bit rate",
                                       "bus-off: check the cable, the termination and the bit rate"};
  ls_bus *b = p->ls_bus;
  unsigned state = record->data[0], errors = record->data[1] / 8u;
  const ls_sent *open = first_open(b);
  /* Each error of the sender counts 8, and each ECU counts for itself. Only what an ECU has sent can have an error
   * that is told, because it needs an identifier. */
  if (state != ECAT_CAN_STOPPED && open != NULL)
    for (; b->send_errors < errors; b->send_errors++) bus_error(p, open->ecu, &open->frame);
  b->send_errors = errors;
  if (state < sizeof states / sizeof *states)
    (state == ECAT_CAN_ACTIVE) ? plant_event(p, "CAN bus: %s", states[state])
                               : (void)plant_say(p, PLANT_WARNING, "CAN bus: %s", states[state]);
}

static void take(plant *p, const ecat_can_frame *record) {
  ls_bus *b = p->ls_bus;
  ls_sent *own = NULL;
  switch (record->kind) {
    case ECAT_CAN_RECEIVED:
      b->frames_received++;
      transmit_to_all_but(p, NULL, record);
      break;
    case ECAT_CAN_SENT:
    case ECAT_CAN_UNSENT:
      own = sent_as(b, record->sender, record->number);
      if (own != NULL && own->sender == b->sender) refuse_until(p, own->number);
      if (record->kind == ECAT_CAN_SENT) {
        if (own == NULL) b->frames_received++;
        transmit_to_all_but(p, own != NULL ? own->ecu : NULL, record);
        if (own != NULL && !own->answered) confirm(p, own->ecu, record);
      } else if (own == NULL || !own->answered) {
        bus_error(p, own != NULL ? own->ecu : NULL, record);
      }
      if (own != NULL) own->answered = 1;
      break;
    case ECAT_CAN_STATE:
      take_state(p, record);
      break;
    case ECAT_CAN_OVERFLOW:
      plant_say(p, PLANT_WARNING, "the terminal has lost CAN frames that it received");
      break;
    default:
      break;
  }
}

/* Whether the bit rate that an ECU has configured is that of the bus, as far as both are known. */
static int check_bit_rate(plant *p, ls_ecu *e) {
  unsigned bit_rate = p->ls_bus->info.bit_rate;
  if (bit_rate == 0 || e->bit_rate == 0 || e->bit_rate == bit_rate) return 1;
  if (first_time(e, TOLD_BAUD_RATE))
    plant_say(p, PLANT_WARNING, "Ecu%u: it is made for %lu bit/s, but the CAN bus has %u bit/s, which counts: set the ECU, "
              "or bit_rate in [slave.can] in the configuration of the daemon", e->number + 1, (unsigned long)e->bit_rate,
              bit_rate);
  return 0;
}

/* Whether a call may fail so: the next sample of the session sees it, too, and does what is to be done. */
static int is_for_the_session(int code) {
  return code == ECAT_EDOWN || code == ECAT_ESTALE || code == ECAT_ETIMEOUT || code == ECAT_EBUS;
}

/* The channel has answered all frames, and none of them is in a record that was not read. */
static int is_settled(ls_bus *b, uint64_t cycle) {
  const ecat_can_info *info = &b->info;
  if (b->sender == 0 || info->own_sent + info->own_refused + info->own_unsent != b->last) {
    b->settled_cycle = 0;
    return 0;
  }
  if (b->settled_cycle == 0) b->settled_cycle = cycle;
  return cycle > b->settled_cycle + 1;
}

static int receive(plant *p) {
  ls_bus *b = p->ls_bus;
  ecat_t *bus = p->session.bus;
  ecat_can_frame records[RECORDS];
  int i, count, settled, is_first = b->info.bit_rate == 0, code = ecat_can(bus, b->channel, &b->info);
  if (code != 0) return is_for_the_session(code) ? 0 : ecat_session_client(&p->session, code);
  for (i = 0; is_first && i < (int)b->count; i++) (void)check_bit_rate(p, &b->ecus[i]);
  settled = is_settled(b, ecat_cycle(bus));
  while ((count = ecat_can_read(bus, b->channel, records, RECORDS, 0)) > 0)
    for (i = 0; i < count; i++) take(p, &records[i]);
  if (count < 0) return is_for_the_session(count) ? 0 : ecat_session_client(&p->session, count);
  if (b->info.missed > b->missed) {
    b->lost += (uint32_t)(b->info.missed - b->missed);
    b->missed = b->info.missed;
    plant_say(p, PLANT_WARNING, "%llu records of the CAN bus are lost, because there was no step for too long",
              (unsigned long long)b->missed);
    forget_sent(p);
  } else if (settled) {
    refuse_until(p, b->last + 1);
  }
  return 0;
}

/* --- sending ----------------------------------------------------------------------------------- */

static int claim(plant *p) {
  ls_bus *b = p->ls_bus;
  double lease = p->session.settings.lease;
  /* With a lease of 0 a thread would give signs of life, also for an importer that hangs. */
  int code = ecat_can_claim(p->session.bus, b->channel, lease > 0 ? lease : 1e-9, NULL, 0);
  if (code != 0) return code;
  b->sender = ecat_can_sender(p->session.bus);
  b->last = 0;
  b->oldest = 1;
  b->settled_cycle = 0;
  return 0;
}

/* The claim is lost: the importer stood still for the lease, or the daemon has ended. */
static int lost(plant *p, int code) {
  uint64_t cycle = ecat_cycle(p->session.bus);
  lose_claim(p);
  if (p->session.settings.when_failed == ECAT_FAILURE_ERROR)
    return ecat_session_fail(&p->session, code, "%s; with another whenFailed than Error the FMU claims it again and goes "
                             "on", ecat_error(p->session.bus));
  if (p->ls_bus->reclaimed_cycle == 0 || cycle - p->ls_bus->reclaimed_cycle > 1000 || cycle < p->ls_bus->reclaimed_cycle)
    plant_say(p, PLANT_WARNING, "%s; the FMU does so", ecat_error(p->session.bus));
  p->ls_bus->reclaimed_cycle = cycle;
  return 0;
}

static void drop_all(plant *p, const char *why) {
  ls_ecu *e;
  while ((e = next_in_turn(p->ls_bus)) != NULL) {
    refuse_frame(p, e, &e->frames[e->first], why);
    unqueue(e);
  }
}

/* Hands frames of the ECUs over to the client, in turns. */
static int send_waiting(plant *p) {
  ls_bus *b = p->ls_bus;
  ecat_t *bus = p->session.bus;
  ls_ecu *e;
  int code = 0;
  if (p->session.settings.read_only) {
    drop_all(p, "'readOnly' is set");
    return 0;
  }
  if (b->sender != 0 && (code = ecat_can_send(bus, b->channel, NULL, 0, NULL)) < 0)
    return is_for_the_session(code) ? 0 : lost(p, code);
  while ((e = next_in_turn(b)) != NULL) {
    const ecat_can_frame *frame = &e->frames[e->first];
    ls_sent *s;
    if (b->sender == 0 && (code = claim(p)) != 0) break;
    s = &b->sent[(b->last + 1) % SENT];
    if (s->sender == b->sender && !s->answered) break;
    code = ecat_can_send(bus, b->channel, frame, 1, &b->last);
    if (code == 1) {
      s->sender = b->sender;
      s->number = b->last;
      s->ecu = e;
      s->answered = 0;
      s->frame = *frame;
      unqueue(e);
    } else if (code == ECAT_EOWNED || code == ECAT_ERANGE) {
      refuse_frame(p, e, frame, ecat_error(bus));
      unqueue(e);
    } else {
      break;
    }
    code = 0;
  }
  if (code == ECAT_EFULL || is_for_the_session(code)) return 0; /* tried again later */
  if (code == ECAT_ELEASE || code == ECAT_ECLAIM) return lost(p, code);
  return code < 0 ? ecat_session_client(&p->session, code) : 0;
}

static int has_bus(const plant *p) { return p->session.bus != NULL && p->session.outage == 0; }

int ls_bus_found(void *context) {
  plant *p = context;
  ls_bus *b = p->ls_bus;
  int code = ecat_can_find(p->session.bus, p->slaves[0].on_bus.position);
  if (code < 0) return ecat_session_client(&p->session, code);
  b->channel = code;
  b->info.bit_rate = 0;
  lose_claim(p); /* it was one of an earlier daemon, if there was one */
  b->last = b->oldest = 0;
  if (b->listens == p->session.connections) return 0;
  b->listens = p->session.connections;
  b->missed = 0;
  code = ecat_can_listen(p->session.bus, b->channel);
  return ecat_session_client(&p->session, code);
}

int ls_bus_exchange(plant *p) {
  int code;
  if (!has_bus(p)) return 0;
  code = receive(p);
  return code != 0 ? code : send_waiting(p);
}

void ls_bus_flush(plant *p) {
  if (has_bus(p) && p->ls_bus->sender != 0) (void)ecat_can_flush(p->session.bus, p->ls_bus->channel, FLUSH);
}

/* --- from the ECUs ----------------------------------------------------------------------------- */

static void queue(plant *p, ls_ecu *e, const ls_operation *o) {
  ecat_can_frame *frame = &e->frames[(e->first + e->waiting) % WAITING];
  if (e->off) {
    refuse(p, e, o->bytes, o->length);
    if (first_time(e, TOLD_OFF))
      plant_say(p, PLANT_WARNING, "Ecu%u: it sends frames, but has said that it is bus-off", e->number + 1);
    return;
  }
  if (e->waiting == WAITING) {
    refuse(p, e, o->bytes, o->length);
    if (first_time(e, TOLD_FULL))
      plant_say(p, PLANT_WARNING, "Ecu%u: %d frames wait, and further ones are refused by Format Error: the CAN bus is "
                "slower than this ECU, or does not work", e->number + 1, WAITING);
    return;
  }
  memset(frame, 0, sizeof *frame);
  frame->id = o->id | (o->extended ? (uint32_t)ECAT_CAN_EXTENDED : 0) | (o->remote ? (uint32_t)ECAT_CAN_REMOTE : 0);
  frame->length = (uint8_t)o->data_length;
  memcpy(frame->data, o->data, o->data_length);
  if (has_bus(p))
    e->waiting++;
  else
    bus_error(p, e, frame);
}

static void configure(plant *p, ls_ecu *e, const ls_operation *o) {
  if (o->kind == LS_BAUD_RATE && o->value != 0) {
    e->bit_rate = o->value;
    if (check_bit_rate(p, e)) return;
  }
  if (o->kind == LS_ARBITRATION && o->value == LS_BUFFER_AND_RETRANSMIT) return;
  refuse(p, e, o->bytes, o->length);
  if (o->kind == LS_ARBITRATION && first_time(e, TOLD_ARBITRATION))
    plant_say(p, PLANT_WARNING, "Ecu%u: it wants to be told when a frame loses arbitration, but no terminal tells it: "
              "frames are sent again until they win, as with BUFFER_AND_RETRANSMIT", e->number + 1);
  if (o->kind == LS_BAUD_RATE && o->value == 0 && first_time(e, TOLD_BAUD_RATE))
    plant_say(p, PLANT_WARNING, "Ecu%u: it configures a bit rate of 0, which no CAN bus has: set the ECU", e->number + 1);
  if ((o->kind == LS_BAUD_RATE_FD || o->kind == LS_BAUD_RATE_XL) && first_time(e, TOLD_WRONG))
    plant_say(p, PLANT_WARNING, "Ecu%u: it configures CAN FD or CAN XL, which the terminal does not have", e->number + 1);
}

static void wake_up(plant *p, const ls_ecu *from) {
  ls_bus *b = p->ls_bus;
  uint8_t operation[LS_BATCH];
  size_t i;
  for (i = 0; i < b->count; i++)
    if (&b->ecus[i] != from) give(p, &b->ecus[i], operation, ls_wakeup(operation));
}

static void carry_out(plant *p, ls_ecu *e, const ls_operation *o) {
  switch (o->code) {
    case LS_TRANSMIT:
      queue(p, e, o);
      break;
    case LS_CONFIGURATION:
      configure(p, e, o);
      break;
    case LS_STATUS:
      e->off = o->value == LS_BUS_OFF;
      break;
    case LS_WAKEUP:
      wake_up(p, e);
      if (first_time(e, TOLD_WAKEUP))
        plant_say(p, PLANT_WARNING, "Ecu%u: its Wakeup goes to the other ECUs of this FMU only, because a terminal cannot "
                  "wake up the nodes of a CAN bus", e->number + 1);
      break;
    default: /* LS_FORMAT_ERROR */
      if (first_time(e, TOLD_ITS_ERROR))
        plant_say(p, PLANT_WARNING, "Ecu%u: it answers an operation of this FMU with Format Error", e->number + 1);
  }
}

static void take_operations(plant *p, ls_ecu *e) {
  const uint8_t *bytes = e->from;
  const char *wrong;
  size_t length = e->received;
  ls_operation operation;
  while (ls_next(&bytes, &length, &operation, &wrong)) {
    if (wrong == NULL) {
      carry_out(p, e, &operation);
      continue;
    }
    refuse(p, e, operation.bytes, operation.length);
    if (first_time(e, TOLD_WRONG))
      plant_say(p, PLANT_WARNING, "Ecu%u: an operation (code 0x%02lX, %lu bytes) is refused by Format Error, as all like "
                "it: %s", e->number + 1, (unsigned long)operation.code, (unsigned long)operation.length, wrong);
  }
}

int ls_bus_event(plant *p) {
  size_t i;
  for (i = 0; i < p->ls_bus->count; i++) {
    ls_ecu *e = &p->ls_bus->ecus[i];
    if (e->tx_active) {
      memmove(e->to, e->to + e->taken, e->backlog - e->taken);
      e->backlog -= e->taken;
      e->changed = 1;
      if (e->backlog == 0) e->told &= ~(unsigned)TOLD_LATE;
    }
    if (e->rx_active) take_operations(p, e);
    e->rx_active = e->tx_active = e->tx_seen = 0;
    e->received = e->taken = 0;
  }
  return has_bus(p) ? send_waiting(p) : 0;
}

/* --- values of variables ----------------------------------------------------------------------- */

static ls_ecu *find(plant *p, unsigned reference, enum plant_role one, enum plant_role other, const char *call) {
  const plant_variable *v = reference < p->variable_count ? &p->variables[reference] : NULL;
  if (v != NULL && p->ls_bus != NULL && (v->role == one || v->role == other)) return &p->ls_bus->ecus[v->ecu];
  plant_say(p, PLANT_ERROR, "%s: this is not for the variable with value reference %u", call, reference);
  return NULL;
}

static int is_role(const plant *p, unsigned reference, enum plant_role role) {
  return p->variables[reference].role == role;
}

/* The longest beginning of the backlog that has whole operations only, and that a node must be able to take. */
static size_t batch(const ls_ecu *e) {
  const uint8_t *bytes = e->to;
  const char *wrong;
  size_t left = e->backlog, length = 0;
  ls_operation operation;
  while (ls_next(&bytes, &left, &operation, &wrong) && length + operation.length <= LS_BATCH) length += operation.length;
  return length;
}

static void activate(ls_ecu *e, int active) {
  e->tx_active = active;
  e->taken = active ? batch(e) : 0;
}

int ls_bus_has_event(const plant *p) {
  size_t i;
  for (i = 0; p->ls_bus != NULL && p->triggered && i < p->ls_bus->count; i++)
    if (p->ls_bus->ecus[i].backlog > 0) return 1;
  return 0;
}

int ls_bus_get_clock(plant *p, unsigned reference, int *active) {
  ls_ecu *e = find(p, reference, ROLE_RX_CLOCK, ROLE_TX_CLOCK, "get a clock");
  if (e == NULL) return PLANT_ERROR;
  if (is_role(p, reference, ROLE_RX_CLOCK)) {
    *active = e->rx_active;
  } else if (!p->triggered || p->state != PLANT_EVENTS) {
    *active = e->tx_active;
  } else { /* an output is active once in an event */
    if (!e->tx_active && e->backlog > 0) activate(e, 1);
    *active = e->tx_active && !e->tx_seen;
    e->tx_seen = e->tx_active;
  }
  return PLANT_OK;
}

int ls_bus_set_clock(plant *p, unsigned reference, int active) {
  ls_ecu *e = find(p, reference, ROLE_RX_CLOCK, p->triggered ? ROLE_RX_CLOCK : ROLE_TX_CLOCK, "set a clock");
  if (e == NULL) return PLANT_ERROR;
  if (is_role(p, reference, ROLE_RX_CLOCK))
    e->rx_active = active;
  else
    activate(e, active);
  return PLANT_OK;
}

int ls_bus_get_binary(plant *p, unsigned reference, const uint8_t **bytes, size_t *length) {
  const ls_ecu *e = find(p, reference, ROLE_RX_DATA, ROLE_TX_DATA, "get a binary");
  if (e == NULL) return PLANT_ERROR;
  *bytes = is_role(p, reference, ROLE_RX_DATA) ? e->from : e->to;
  *length = is_role(p, reference, ROLE_RX_DATA) ? e->received : e->taken;
  return PLANT_OK;
}

int ls_bus_set_binary(plant *p, unsigned reference, const uint8_t *bytes, size_t length) {
  ls_ecu *e = find(p, reference, ROLE_RX_DATA, ROLE_RX_DATA, "set a binary");
  if (e == NULL) return PLANT_ERROR;
  if (length > BACKLOG) {
    p->ls_bus->lost++;
    if (first_time(e, TOLD_LONG))
      plant_say(p, PLANT_WARNING, "Ecu%u: it sends %lu bytes at once, and the FMU takes %d", e->number + 1,
                (unsigned long)length, BACKLOG);
    length = BACKLOG;
  }
  if (length > 0) memcpy(e->from, bytes, length);
  e->received = length;
  return PLANT_OK;
}

int ls_bus_get_interval(plant *p, unsigned reference, double *interval, int *changed) {
  enum plant_role role = p->triggered ? ROLES : ROLE_TX_CLOCK;
  ls_ecu *e = find(p, reference, role, role, "get an interval");
  if (e == NULL) return PLANT_ERROR;
  *interval = plant_real(p, ROLE_INTERVAL);
  *changed = e->changed;
  e->changed = 0;
  return PLANT_OK;
}

void ls_bus_publish(plant *p) {
  const ls_bus *b = p->ls_bus;
  plant_publish(p, ROLE_CAN_STATE, 0, 1 + (has_bus(p) ? b->info.state : ECAT_CAN_STOPPED)); /* 1 first in FMI */
  plant_publish(p, ROLE_CAN_SEND_ERRORS, 0, b->info.send_errors);
  plant_publish(p, ROLE_CAN_RECEIVE_ERRORS, 0, b->info.receive_errors);
  plant_publish(p, ROLE_FRAMES_SENT, 0, b->frames_sent);
  plant_publish(p, ROLE_FRAMES_RECEIVED, 0, b->frames_received);
  plant_publish(p, ROLE_OPERATIONS_REFUSED, 0, b->refused);
  plant_publish(p, ROLE_OPERATIONS_LOST, 0, b->lost);
}
