/* Access to one object of a slave through its mailbox, which never delays the model. */
#ifndef ECATM_SDO_H
#define ECATM_SDO_H

#include "ecatm_samples.h"
#include "ecatm_sdo_values.h"

enum ecatm_sdo_state {
  ECATM_SDO_NONE = 0,
  ECATM_SDO_BUSY = 1,
  ECATM_SDO_DONE = 2,
  ECATM_SDO_FAILED = 3
};

enum ecatm_sdo_when {            /* EtherCAT.Types.Request */
  ECATM_TRIGGERED = 1,
  ECATM_SAMPLED = 2,
  ECATM_INITIAL = 3
};

enum ecatm_sdo_value {           /* type of the value in the model */
  ECATM_INTEGER_VALUE = 1,
  ECATM_REAL_VALUE = 2,
  ECATM_STRING_VALUE = 3
};

/* Identifies a slave by its name in the configuration, or by its position if the name is empty. */
typedef struct ecatm_which {
  int position;                  /* on the bus; for a slave with a name, where it was last found */
  char name[32];
} ecatm_which;

/* One transfer at a time. */
typedef struct ecatm_transfer {
  ecatm_node node;
  ecatm_which slave;
  int index, subindex;
  int handle;                    /* of the client, -1: not sent yet */
  unsigned connection;           /* of the master, when it was sent */
  int download;
  unsigned char data[ECAT_REQUEST_BYTES]; /* to be written, or what was read */
  size_t length;
  int abort_code;                /* negative: enum ecat_errno */
  char text[ECATM_TEXT];         /* why the last transfer has failed */
  int told;                      /* `text` is in the log of the simulation */
  int quiet;                     /* a failure is not logged */
} ecatm_transfer;

/* The condition for the start of a transfer. The state before the present time is kept, so that the last
 * of several evaluations at one time counts. For this reason a transfer is sent at the time after its
 * trigger. */
typedef struct ecatm_trigger {
  int when;                      /* enum ecatm_sdo_when */
  double period;
  int stepped;                   /* `time` and `first` are valid */
  double time, first;            /* of the last and of the first call */
  double samples;                /* periods since `first` */
  int input, input_before;
  int due;                       /* sampled or initial requests: it is time to begin */
  int state, state_before;       /* enum ecatm_sdo_state */
} ecatm_trigger;

typedef struct ecatm_sdo {
  ecatm_transfer transfer;
  ecatm_trigger trigger;
  int type, value;               /* CoE data type of the object; enum ecatm_sdo_value */
  double scale, offset;          /* Real value = number * scale + offset */
  int wrong;                     /* the value cannot be written; `mistake` says why */
  char mistake[ECATM_TEXT];
  int count;                     /* transfers that succeeded */
  double number;                 /* last number that was read */
  char text[ECATM_STRING];       /* last string that was read */
} ecatm_sdo;

/* --- Transfers ----------------------------------------------------------------------------- */

/* Whether there is a bus for requests. */
ECATM_FUNCTION int ecatm_sdo_connected(const ecatm_master *master) {
  return master->session.bus != NULL && master->session.outage == 0;
}

ECATM_FUNCTION ecatm_which ecatm_which_slave(int position, const char *name) {
  ecatm_which which;
  which.position = position;
  sprintf(which.name, "%.*s", (int)sizeof which.name - 1, name);
  return which;
}

/* Finds a slave on the bus: 0, or what ecat_session_fail() returns. */
ECATM_FUNCTION int ecatm_find_slave(ecatm_master *master, const char *heading, ecatm_which *which) {
  ecat_session *session = &master->session;
  ecat_slave_info info;
  int position = which->name[0] != '\0' ? ecat_find_name(session->bus, which->name) : which->position;
  int code = position == ECAT_EBUS ? position : ecat_slave(session->bus, position, &info);
  if (code == 0) {
    which->position = position;
    return 0;
  }
  return ecat_session_fail(session, code, "%s%s", heading, ecat_error(session->bus));
}

ECATM_FUNCTION int ecatm_transfer_check(ecatm_node *node) {
  return ecatm_find_slave(node->master, node->heading, &((ecatm_transfer *)node)->slave);
}

ECATM_FUNCTION void ecatm_transfer_open(ecatm_transfer *transfer, const ecatm_which *slave, int index,
                                        int subindex) {
  transfer->node.check = ecatm_transfer_check;
  transfer->slave = *slave;
  transfer->index = index;
  transfer->subindex = subindex;
  transfer->handle = -1;
}

/* Stops the simulation if no slave can have such an object. */
ECATM_FUNCTION void ecatm_check_range(const char *heading, int position, int index, int subindex) {
  if (position < 0 || index < 0 || index > 0xFFFF || subindex < 0 || subindex > 0xFF) {
    ModelicaFormatError("EtherCAT: %sslave %d, index %d, subindex %d is no object: positions begin with "
                        "0, indices end with 65535 (0xFFFF), subindices with 255", heading, position,
                        index, subindex);
  }
}

/* Stops the simulation if no slave can have such an object, or if there is a bus without such a slave. */
ECATM_FUNCTION void ecatm_check_object(ecatm_master *master, const char *heading, ecatm_which *slave,
                                       int index, int subindex) {
  ecatm_check_range(heading, slave->position, index, subindex);
  if (master->session.bus != NULL) ecatm_check(master, ecatm_find_slave(master, heading, slave));
}

/* Ends a transfer that has failed. The simulation goes on. A message is logged once, unless the master has
 * logged the loss of the bus. */
ECATM_FUNCTION int ecatm_transfer_fail(ecatm_transfer *transfer, int code, const char *why) {
  char text[ECATM_TEXT];
  sprintf(text, "%.*s", ECATM_TEXT - 1, why);
  if (!transfer->quiet && ecatm_sdo_connected(transfer->node.master) &&
      (!transfer->told || strcmp(text, transfer->text) != 0))
    ModelicaFormatMessage("EtherCAT: %s%s object 0x%04X:%02X of slave %d failed: %s\n",
                          transfer->node.heading, transfer->download ? "writing" : "reading",
                          (unsigned)transfer->index, (unsigned)transfer->subindex,
                          transfer->slave.position, text);
  strcpy(transfer->text, text);
  transfer->told = 1;
  transfer->abort_code = code;
  return ECATM_SDO_FAILED;
}

/* Ends a transfer whose bus was lost. */
ECATM_FUNCTION int ecatm_transfer_lose(ecatm_transfer *transfer) {
  ecatm_master *master = transfer->node.master;
  if (transfer->handle >= 0) {
    if (master->session.bus != NULL && transfer->connection == master->session.connections)
      (void)ecat_cancel(master->session.bus, transfer->handle);
    transfer->handle = -1;
    master->requests--;
  }
  if (ecatm_sdo_connected(master))
    return ecatm_transfer_fail(transfer, ECAT_EDOWN, "the bus was lost during the request");
  return ecatm_transfer_fail(transfer,
                             master->session.outage != 0 ? master->session.outage : ECAT_EDOWN,
                             master->session.problem);
}

/* Sends the transfer or asks for its answer. Returns busy, done or failed. While the client has the largest
 * number of requests, the transfer waits for its turn. */
ECATM_FUNCTION int ecatm_transfer_step(ecatm_transfer *transfer) {
  ecatm_master *master = transfer->node.master;
  uint32_t reason = 0;
  int code;
  if (!ecatm_sdo_connected(master) ||
      (transfer->handle >= 0 && transfer->connection != master->session.connections))
    return ecatm_transfer_lose(transfer);
  if (transfer->download && master->session.settings.read_only)
    return ecatm_transfer_fail(transfer, ECAT_ESTATE, "readOnly of the EtherCATMaster is true, so the "
                               "model writes nothing");
  if (transfer->handle < 0) {
    code = ecat_sdo_start(master->session.bus, transfer->slave.position, (unsigned)transfer->index,
                          (unsigned)transfer->subindex,
                          transfer->download ? transfer->data : NULL,
                          transfer->download ? transfer->length : 0);
    if (code == ECAT_EFULL && master->requests > 0) return ECATM_SDO_BUSY;
    if (code == ECAT_EBUS) ecatm_check(master, ecat_session_client(&master->session, code));
    if (code < 0) return ecatm_transfer_fail(transfer, code, ecat_error(master->session.bus));
    transfer->handle = code;
    transfer->connection = master->session.connections;
    master->requests++;
  }
  code = ecat_poll(master->session.bus, transfer->handle, transfer->download ? NULL : transfer->data,
                   sizeof transfer->data, transfer->download ? NULL : &transfer->length, &reason);
  if (code == ECAT_EBUSY) return ECATM_SDO_BUSY;
  transfer->handle = -1;
  master->requests--;
  if (code != 0)
    return ecatm_transfer_fail(transfer, code == ECAT_EABORT ? (int)reason : code,
                               ecat_error(master->session.bus));
  return ECATM_SDO_DONE;
}

/* --- Triggers ------------------------------------------------------------------------------ */

/* Whether `time` is a new time. If so, the present input becomes the input before. */
ECATM_FUNCTION int ecatm_trigger_begin(ecatm_trigger *trigger, double time) {
  double samples = 0;
  int first = !trigger->stepped;
  if (!first && ecatm_same_time(time, trigger->time)) return 0;
  if (first) trigger->first = time;
  if (trigger->when == ECATM_SAMPLED)
    samples = floor((time - trigger->first) / trigger->period + 1e-6);
  trigger->due = trigger->when != ECATM_TRIGGERED && (first || samples > trigger->samples);
  trigger->samples = samples;
  trigger->stepped = 1;
  trigger->time = time;
  trigger->input_before = trigger->input;
  return 1;
}

/* Whether a transfer begins at this time. If so, the state becomes busy, else it stays as before. */
ECATM_FUNCTION int ecatm_trigger_decide(ecatm_trigger *trigger, int input) {
  int edge = trigger->when == ECATM_TRIGGERED && input && !trigger->input_before;
  trigger->input = input;
  trigger->state = trigger->state_before;
  if (trigger->state == ECATM_SDO_BUSY || !(edge || trigger->due)) return 0;
  trigger->state = ECATM_SDO_BUSY;
  return 1;
}

/* --- Objects ------------------------------------------------------------------------------- */

/* Stops the simulation if the block cannot use the type of the object. */
ECATM_FUNCTION void ecatm_sdo_check_type(const char *heading, int type, int value) {
  int fits = value == ECATM_STRING_VALUE ? ecatm_type_is_text(type)
             : value == ECATM_REAL_VALUE ? ecatm_type_bytes(type) > 0
                                         : ecatm_type_bytes(type) > 0 && !ecatm_type_is_real(type);
  if (!fits)
    ModelicaFormatError("EtherCAT: %sthe dataType cannot be 0x%04X: %s", heading, (unsigned)type,
                        value == ECATM_STRING_VALUE ? "a String needs a string type"
                        : value == ECATM_REAL_VALUE ? "a Real needs the type of a number"
                                                    : "an Integer needs an integer type");
}

/* Reads index and subindex from a text such as "0x6060:00"; an empty text changes nothing. */
ECATM_FUNCTION void ecatm_sdo_parse(const char *heading, const char *text, int *index, int *subindex) {
  const char *number = text;
  char *end = NULL;
  unsigned long numbers[2] = {0, 0};
  if (*text == '\0') return;
  numbers[0] = strtoul(number, &end, 16);
  if (end != number && *end == ':') numbers[1] = strtoul(number = end + 1, &end, 16);
  if (end == number || *end != '\0' || numbers[0] > 0xFFFF || numbers[1] > 0xFF) {
    ModelicaFormatError("EtherCAT: %s\"%.40s\" is no object: write it as \"0x6060:00\", index and "
                        "subindex in hexadecimal", heading, text);
    return;
  }
  *index = (int)numbers[0];
  *subindex = (int)numbers[1];
}

/* Registers an object of a slave. `name`: see ecatm_which; `type`: CoE data type; `value`: enum
 * ecatm_sdo_value; `when`: enum ecatm_sdo_when, with `period` in s if sampled; `scale` and `offset` for a
 * Real; `address`: index and subindex as text, instead of the numbers; `block`: name of the block's
 * instance. */
ECATM_FUNCTION void *ecatm_sdo_open(void *object, int position, const char *name, int index,
                                    int subindex, int type, int value, int when, double period,
                                    double scale, double offset, const char *address,
                                    const char *block) {
  ecatm_master *master = (ecatm_master *)object;
  ecatm_which slave = ecatm_which_slave(position, name);
  ecatm_sdo *sdo;
  char heading[ECATM_HEADING];
  ecatm_head(heading, block);
  ecatm_sdo_parse(heading, address, &index, &subindex);
  ecatm_check_object(master, heading, &slave, index, subindex);
  ecatm_sdo_check_type(heading, type, value);
  if (when == ECATM_SAMPLED && !(period > 0)) {
    ModelicaFormatError("EtherCAT: %sobject 0x%04X:%02X of slave %d cannot be requested every %g s: the "
                        "period must be positive", heading, (unsigned)index, (unsigned)subindex,
                        slave.position, period);
    return NULL;
  }
  if (!ecatm_is_scale(scale, offset)) {
    ModelicaFormatError("EtherCAT: %sobject 0x%04X:%02X of slave %d cannot be scaled by %g with an offset "
                        "of %g: the scale must be a finite number other than 0", heading,
                        (unsigned)index, (unsigned)subindex, slave.position, scale, offset);
    return NULL;
  }
  sdo = (ecatm_sdo *)ecatm_new(master, sizeof *sdo);
  if (sdo == NULL) return NULL;
  strcpy(sdo->transfer.node.heading, heading);
  ecatm_transfer_open(&sdo->transfer, &slave, index, subindex);
  sdo->trigger.when = when;
  sdo->trigger.period = period;
  sdo->type = type;
  sdo->value = value;
  sdo->scale = scale;
  sdo->offset = offset;
  return sdo;
}

ECATM_FUNCTION void ecatm_sdo_close(void *object) { ecatm_close(object); }

/* Takes over the value that was read. If the model cannot hold the value, the request has failed. */
ECATM_FUNCTION int ecatm_sdo_decode(ecatm_sdo *sdo) {
  ecatm_transfer *transfer = &sdo->transfer;
  double number = 0;
  char text[ECATM_TEXT];
  if (sdo->value == ECATM_STRING_VALUE) {
    ecatm_decode_text(sdo->type, transfer->data, transfer->length, sdo->text);
    return ECATM_SDO_DONE;
  }
  if (ecatm_decode_number(sdo->type, transfer->data, transfer->length, &number, text) != 0)
    return ecatm_transfer_fail(transfer, ECAT_EARG, text);
  if (sdo->value == ECATM_INTEGER_VALUE && ecatm_check_integer(number, text) != 0)
    return ecatm_transfer_fail(transfer, ECAT_ERANGE, text);
  sdo->number =
      sdo->value == ECATM_REAL_VALUE ? ecat_to_physical(number, sdo->scale, sdo->offset) : number;
  return ECATM_SDO_DONE;
}

/* One sample: at a new time continues a running transfer, then begins another one if it is time to.
 * Returns whether one begins. */
ECATM_FUNCTION int ecatm_sdo_step(ecatm_sdo *sdo, double time, int input, int download) {
  ecatm_trigger *trigger = &sdo->trigger;
  ecatm_transfer *transfer = &sdo->transfer;
  if (ecatm_trigger_begin(trigger, time)) {
    if (trigger->state == ECATM_SDO_BUSY) {
      if (sdo->wrong)
        ModelicaFormatError("EtherCAT: %sobject 0x%04X:%02X of slave %d cannot be written: %s",
                            transfer->node.heading, (unsigned)transfer->index,
                            (unsigned)transfer->subindex, transfer->slave.position, sdo->mistake);
      trigger->state = ecatm_transfer_step(transfer);
      if (trigger->state == ECATM_SDO_DONE && !transfer->download)
        trigger->state = ecatm_sdo_decode(sdo);
      if (trigger->state == ECATM_SDO_DONE) sdo->count++, transfer->told = 0;
    } else if (trigger->when == ECATM_INITIAL && trigger->state == ECATM_SDO_FAILED &&
               (transfer->abort_code == ECAT_EDOWN || transfer->abort_code == ECAT_ESTALE) &&
               ecatm_sdo_connected(transfer->node.master)) {
      trigger->due = 1; /* the bus has appeared after the start */
    }
    trigger->state_before = trigger->state;
  }
  if (!ecatm_trigger_decide(trigger, input)) return 0;
  transfer->download = download;
  sdo->wrong = 0;
  return 1;
}

/* --- Requests of the model ----------------------------------------------------------------- */

/* Each function returns enum ecatm_sdo_state. `order` only makes the tool call the function after the call
 * that has returned it. */
ECATM_FUNCTION int ecatm_sdo_read(void *object, double time, int order, int trigger) {
  ecatm_sdo *sdo = (ecatm_sdo *)object;
  (void)order;
  ecatm_sdo_step(sdo, time, trigger, 0);
  return sdo->trigger.state;
}

ECATM_FUNCTION int ecatm_sdo_write_real(void *object, double time, int order, int trigger,
                                        double value) {
  ecatm_sdo *sdo = (ecatm_sdo *)object;
  (void)order;
  if (ecatm_sdo_step(sdo, time, trigger, 1))
    sdo->wrong = ecatm_encode_number(sdo->type, ecat_to_raw(value, sdo->scale, sdo->offset),
                                     sdo->transfer.data, &sdo->transfer.length, sdo->mistake);
  return sdo->trigger.state;
}

ECATM_FUNCTION int ecatm_sdo_write_integer(void *object, double time, int order, int trigger,
                                           int value) {
  return ecatm_sdo_write_real(object, time, order, trigger, (double)value);
}

ECATM_FUNCTION int ecatm_sdo_write_string(void *object, double time, int order, int trigger,
                                          const char *value) {
  ecatm_sdo *sdo = (ecatm_sdo *)object;
  (void)order;
  if (ecatm_sdo_step(sdo, time, trigger, 1))
    sdo->wrong = ecatm_encode_text(sdo->type, value, sdo->transfer.data, &sdo->transfer.length,
                                   sdo->mistake);
  return sdo->trigger.state;
}

/* --- Results of requests ------------------------------------------------------------------- */

ECATM_FUNCTION double ecatm_sdo_real(void *object, int order) {
  (void)order;
  return ((ecatm_sdo *)object)->number;
}

ECATM_FUNCTION int ecatm_sdo_integer(void *object, int order) {
  return (int)ecatm_sdo_real(object, order);
}

/* A copy of a text in memory of the tool. */
ECATM_FUNCTION const char *ecatm_text(const char *text) {
  char *copy = ModelicaAllocateString(strlen(text));
  strcpy(copy, text);
  return copy;
}

ECATM_FUNCTION const char *ecatm_sdo_string(void *object, int order) {
  (void)order;
  return ecatm_text(((ecatm_sdo *)object)->text);
}

ECATM_FUNCTION int ecatm_sdo_count(void *object, int order) {
  (void)order;
  return ((ecatm_sdo *)object)->count;
}

ECATM_FUNCTION int ecatm_sdo_abort_code(void *object, int order) {
  const ecatm_sdo *sdo = (const ecatm_sdo *)object;
  (void)order;
  return sdo->trigger.state == ECATM_SDO_FAILED ? sdo->transfer.abort_code : 0;
}

ECATM_FUNCTION const char *ecatm_sdo_abort_text(void *object, int order) {
  const ecatm_sdo *sdo = (const ecatm_sdo *)object;
  (void)order;
  return ecatm_text(sdo->trigger.state == ECATM_SDO_FAILED ? sdo->transfer.text : "");
}

#endif
