/* Requests to the mailbox of a slave, which never delay the model. */
#ifndef ECATM_SDO_H
#define ECATM_SDO_H

#include "ecatm_samples.h"

enum ecatm_sdo_state {
  ECATM_SDO_NONE = 0,
  ECATM_SDO_BUSY = 1,
  ECATM_SDO_DONE = 2,
  ECATM_SDO_FAILED = 3
};

typedef struct ecatm_sdo {
  ecatm_node node;
  int position, index, subindex, type;
  int request;                   /* handle of the client, -1: not sent yet */
  int download;                  /* the request writes `value` */
  int value;
  int state, state_before;       /* enum ecatm_sdo_state: now, and when this time began */
  int trigger, trigger_before;   /* now, and at the time before */
  int stepped;                   /* `time` is valid */
  double time;                   /* simulation time of the last call */
  int result;                    /* of the last upload */
  int abort_code;
} ecatm_sdo;

/* Bytes and signedness of the integer types of EtherCAT.Types.DataType. */
ECATM_FUNCTION int ecatm_sdo_bytes(int type) { return type <= 3 ? 1 : type <= 5 ? 2 : 4; }
ECATM_FUNCTION int ecatm_sdo_signed(int type) { return type == 2 || type == 4 || type == 6; }

/* An object of a slave. `type` is the number of an EtherCAT.Types.DataType. */
ECATM_FUNCTION void *ecatm_sdo_open(void *object, int position, int index, int subindex, int type) {
  ecatm_master *master = (ecatm_master *)object;
  ecat_slave_info info;
  ecatm_sdo *sdo;
  if (master->bus != NULL) ecatm_check(master, ecat_slave(master->bus, position, &info));
  sdo = (ecatm_sdo *)ecatm_new(master, sizeof *sdo);
  if (sdo == NULL) return NULL;
  sdo->position = position;
  sdo->index = index;
  sdo->subindex = subindex;
  sdo->type = type;
  sdo->request = -1;
  return sdo;
}

ECATM_FUNCTION void ecatm_sdo_close(void *object) { ecatm_close(object); }

/* Sends the noted request; while all requests of this client are in use it stays noted. */
ECATM_FUNCTION void ecatm_sdo_send(ecatm_sdo *sdo) {
  ecatm_master *master = sdo->node.master;
  int i, code, bytes = ecatm_sdo_bytes(sdo->type);
  double low = ecatm_sdo_signed(sdo->type) ? -ldexp(1, 8 * bytes - 1) : 0;
  double high = sdo->type == 1 ? 1 : ldexp(1, 8 * bytes - ecatm_sdo_signed(sdo->type)) - 1;
  unsigned long bits = (unsigned long)(long)sdo->value;
  unsigned char data[4];
  if (sdo->download && (sdo->value < low || sdo->value > high)) {
    ModelicaFormatError("EtherCAT: %d is out of range for object 0x%04X:%02X of slave %d: %.0f to "
                        "%.0f are allowed", sdo->value, (unsigned)sdo->index,
                        (unsigned)sdo->subindex, sdo->position, low, high);
    return;
  }
  for (i = 0; i < bytes; i++) data[i] = (unsigned char)(bits >> (8 * i) & 0xFF);
  code = ecat_sdo_start(master->bus, sdo->position, (unsigned)sdo->index, (unsigned)sdo->subindex,
                        sdo->download ? data : NULL, sdo->download ? (size_t)bytes : 0);
  if (code == ECAT_EFULL) return;
  ecatm_check(master, code);
  sdo->request = code;
}

/* Takes over what was uploaded. */
ECATM_FUNCTION void ecatm_sdo_decode(ecatm_sdo *sdo, const unsigned char *data, size_t length) {
  int i, bytes = ecatm_sdo_bytes(sdo->type);
  double value = 0;
  if (length != (size_t)bytes) {
    ModelicaFormatError("EtherCAT: object 0x%04X:%02X of slave %d has %lu bytes, but the dataType of "
                        "its block has %d", (unsigned)sdo->index, (unsigned)sdo->subindex,
                        sdo->position, (unsigned long)length, bytes);
    return;
  }
  for (i = bytes - 1; i >= 0; i--) value = value * 256 + data[i];
  if (ecatm_sdo_signed(sdo->type) && value >= ldexp(1, 8 * bytes - 1)) value -= ldexp(1, 8 * bytes);
  if (value > 2147483647.0) {
    ModelicaFormatError("EtherCAT: object 0x%04X:%02X of slave %d is %.0f, which is too large for a "
                        "Modelica Integer", (unsigned)sdo->index, (unsigned)sdo->subindex,
                        sdo->position, value);
    return;
  }
  sdo->result = (int)value;
}

/* Sends the request or asks for its answer. A slave that refuses does not end the simulation: it
 * leaves a message and an abort code, negative if there was no answer at all. */
ECATM_FUNCTION void ecatm_sdo_progress(ecatm_sdo *sdo) {
  ecatm_master *master = sdo->node.master;
  unsigned char data[8];
  size_t length = 0;
  uint32_t reason = 0;
  int code;
  if (master->bus == NULL) return;
  if (sdo->request < 0) ecatm_sdo_send(sdo);
  if (sdo->request < 0) return;
  code = ecat_poll(master->bus, sdo->request, data, sizeof data, &length, &reason);
  if (code == ECAT_EBUSY) return;
  if (code == ECAT_EDOWN || code == ECAT_ESTALE) ecatm_check(master, code);
  sdo->request = -1;
  sdo->state = code == 0 ? ECATM_SDO_DONE : ECATM_SDO_FAILED;
  sdo->abort_code = code == ECAT_EABORT ? (int)reason : code;
  if (code == 0 && !sdo->download) ecatm_sdo_decode(sdo, data, length);
  if (code != 0)
    ModelicaFormatMessage("EtherCAT: %s of object 0x%04X:%02X of slave %d failed: %s\n",
                          sdo->download ? "download" : "upload", (unsigned)sdo->index,
                          (unsigned)sdo->subindex, sdo->position, ecat_error(master->bus));
}

/* One sample of a request. It is sent at the time after its trigger, so that the last of several
 * evaluations at one time counts. Triggers of a busy request are ignored. */
ECATM_FUNCTION int ecatm_sdo_step(ecatm_sdo *sdo, double time, int trigger, int download,
                                  int value) {
  if (!sdo->stepped || !ecatm_same_time(time, sdo->time)) {
    sdo->stepped = 1;
    sdo->time = time;
    sdo->trigger_before = sdo->trigger;
    if (sdo->state == ECATM_SDO_BUSY) ecatm_sdo_progress(sdo);
    sdo->state_before = sdo->state;
  }
  sdo->trigger = trigger;
  sdo->state = sdo->state_before;
  if (trigger && !sdo->trigger_before && sdo->state != ECATM_SDO_BUSY) {
    sdo->state = ECATM_SDO_BUSY;
    sdo->download = download;
    sdo->value = value;
    sdo->abort_code = 0;
  }
  return sdo->state;
}

ECATM_FUNCTION int ecatm_sdo_read(void *object, double time, int order, int trigger) {
  (void)order;
  return ecatm_sdo_step((ecatm_sdo *)object, time, trigger, 0, 0);
}

ECATM_FUNCTION int ecatm_sdo_write(void *object, double time, int order, int trigger, int value) {
  (void)order;
  return ecatm_sdo_step((ecatm_sdo *)object, time, trigger, 1, value);
}

ECATM_FUNCTION int ecatm_sdo_value(void *object, int order) {
  (void)order;
  return ((ecatm_sdo *)object)->result;
}

ECATM_FUNCTION int ecatm_sdo_abort_code(void *object, int order) {
  (void)order;
  return ((ecatm_sdo *)object)->abort_code;
}

#endif
