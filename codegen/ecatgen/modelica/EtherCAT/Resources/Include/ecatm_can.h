/* CAN behind a terminal: messages and signals of a model. */
#ifndef ECATM_CAN_H
#define ECATM_CAN_H

#include "ecatm_samples.h"

typedef struct ecatm_message {
  ecatm_node node;
  ecat_session_message on_bus;
} ecatm_message;

typedef struct ecatm_signal {
  ecatm_node node;
  ecat_session_signal on_bus;
  char name[64], unit[16];       /* texts of `on_bus` */
} ecatm_signal;

/* --- Objects ------------------------------------------------------------------------------- */

/* Registers a message of the CAN bus behind a slave. `length`: bytes of data of a message that the model sends,
 * the fewest of one that it receives. `transmission`: enum ecat_session_transmission. */
ECATM_FUNCTION void *ecatm_can_open(void *object, int identifier, int extended, int remote, int sends, int length,
                                    int transmission, double period, int reserve, double timeout) {
  ecatm_slave *slave = (ecatm_slave *)object;
  ecatm_message *message = (ecatm_message *)ecatm_draft(slave->node.master, sizeof *message);
  if (message == NULL) return NULL;
  message->on_bus.slave = &slave->on_bus;
  message->on_bus.id = (uint32_t)identifier;
  if (identifier >= 0 && extended) message->on_bus.id |= ECAT_CAN_EXTENDED;
  if (identifier >= 0 && remote) message->on_bus.id |= ECAT_CAN_REMOTE;
  message->on_bus.sends = sends;
  message->on_bus.length = length;
  message->on_bus.transmission = transmission;
  message->on_bus.period = period;
  message->on_bus.reserve = reserve;
  message->on_bus.timeout = timeout;
  return ecatm_keep(message, ecat_session_add_message(&message->on_bus));
}

/* Chooses before the first sample when a message that the program sends leaves; else a message of a generated block
 * leaves as its file says. */
ECATM_FUNCTION void ecatm_can_transmission(void *object, int transmission, double period) {
  ecatm_message *message = (ecatm_message *)object;
  message->on_bus.transmission = transmission;
  message->on_bus.period = period;
}

ECATM_FUNCTION void ecatm_can_close(void *object) { ecatm_close(object); }

/* Registers a signal of a message. `selector`: start bit, length, whether it is big endian, lowest and highest value
 * of the signal that says which frames have this one; a length of 0: all have it. */
ECATM_FUNCTION void *ecatm_can_signal_open(void *object, const char *name, int start, int length, int big_endian,
                                           int number, double scale, double offset, double minimum,
                                           double maximum, const char *unit, const int *selector) {
  ecatm_message *message = (ecatm_message *)object;
  ecatm_signal *signal = (ecatm_signal *)ecatm_draft(message->node.master, sizeof *signal);
  if (signal == NULL) return NULL;
  sprintf(signal->name, "%.*s", (int)sizeof signal->name - 1, name);
  sprintf(signal->unit, "%.*s", (int)sizeof signal->unit - 1, unit);
  signal->on_bus.message = &message->on_bus;
  signal->on_bus.name = signal->name;
  signal->on_bus.unit = signal->unit;
  signal->on_bus.start = start;
  signal->on_bus.length = length;
  signal->on_bus.big_endian = big_endian;
  signal->on_bus.number = number;
  signal->on_bus.scale = scale;
  signal->on_bus.offset = offset;
  signal->on_bus.minimum = minimum;
  signal->on_bus.maximum = maximum;
  signal->on_bus.selector.start = selector[0];
  signal->on_bus.selector.length = selector[1];
  signal->on_bus.selector.big_endian = selector[2];
  signal->on_bus.selector.low = selector[3];
  signal->on_bus.selector.high = selector[4];
  return ecatm_keep(signal, ecat_session_add_signal(&signal->on_bus));
}

ECATM_FUNCTION void ecatm_can_signal_close(void *object) { ecatm_close(object); }

/* --- State and reads ----------------------------------------------------------------------- */

ECATM_FUNCTION int ecatm_count(double count) { return (int)fmod(count, 2147483648.0); }

/* The state of the CAN channel of a slave in the sample: enum ecat_session_can_state. All counts are modulo 2^31. */
ECATM_FUNCTION int ecatm_can_state(void *object, double time, int order, int *send_errors, int *receive_errors,
                                   int *received, int *sent, int *waiting, int *overflows, int *bus_offs) {
  ecatm_slave *slave = (ecatm_slave *)object;
  ecatm_master *master = slave->node.master;
  ecat_can_info info;
  int state;
  (void)order;
  ecatm_check(master, ecat_session_add_can(&slave->on_bus));
  ecatm_at(master, time);
  state = ecat_session_can_state(&slave->on_bus, &info);
  *send_errors = (int)info.send_errors;
  *receive_errors = (int)info.receive_errors;
  *received = ecatm_count((double)info.received);
  *sent = ecatm_count((double)info.sent);
  *waiting = (int)info.waiting;
  *overflows = ecatm_count((double)info.overflows);
  *bus_offs = ecatm_count((double)info.bus_offs);
  return state;
}

/* Whether a received message is valid in the sample. Counts are modulo 2^31. */
ECATM_FUNCTION int ecatm_can_message(void *object, double time, int order, double *age, int *count, int *missed,
                                     int *length) {
  const ecat_session_message *message = ((ecatm_message *)object)->on_bus.frame;
  (void)order;
  ecatm_at(((ecatm_message *)object)->node.master, time);
  *age = message->age;
  *count = ecatm_count((double)message->count);
  *missed = ecatm_count((double)message->missed);
  *length = message->data_length;
  return message->valid;
}

/* Byte `number`, 1 first, of the last frame of a received message. */
ECATM_FUNCTION int ecatm_can_read_byte(void *object, double time, int order, int number) {
  ecatm_message *message = (ecatm_message *)object;
  (void)order;
  ecatm_at(message->node.master, time);
  return number >= 1 && number <= 8 ? message->on_bus.data[number - 1] : 0;
}

ECATM_FUNCTION double ecatm_can_read_real(void *object, double time, int order) {
  ecatm_signal *signal = (ecatm_signal *)object;
  (void)order;
  ecatm_at(signal->node.master, time);
  return ecat_session_can_read(&signal->on_bus);
}

ECATM_FUNCTION int ecatm_can_read_integer(void *object, double time, int order) {
  return ecatm_nearest_integer(ecatm_can_read_real(object, time, order));
}

ECATM_FUNCTION int ecatm_can_read_boolean(void *object, double time, int order) {
  return ecatm_can_read_real(object, time, order) != 0;
}

/* --- Writes -------------------------------------------------------------------------------- */

/* Stores the value of a signal for ecatm_can_send(). */
ECATM_FUNCTION int ecatm_can_write_real(void *object, double time, int order, double value) {
  (void)time;
  ecat_session_can_write(&((ecatm_signal *)object)->on_bus, value);
  return order;
}

ECATM_FUNCTION int ecatm_can_write_integer(void *object, double time, int order, int value) {
  (void)time;
  ecat_session_can_write_int(&((ecatm_signal *)object)->on_bus, value);
  return order;
}

ECATM_FUNCTION int ecatm_can_write_boolean(void *object, double time, int order, int value) {
  return ecatm_can_write_integer(object, time, order, value != 0);
}

/* Stores the data of a message, the bytes of which are numbers from 0 to 255. */
ECATM_FUNCTION int ecatm_can_write_frame(void *object, double time, int order, const int *data) {
  ecatm_message *message = (ecatm_message *)object;
  uint8_t bytes[8];
  int i;
  (void)time;
  for (i = 0; i < message->on_bus.length; i++) {
    if (data[i] < 0 || data[i] > 255) {
      ModelicaFormatError("EtherCAT: %sbyte %d of CAN message 0x%X is %d, but a byte is a number from 0 to 255",
                          ecatm_slave_of(message->on_bus.slave)->node.heading, i + 1,
                          (unsigned)(message->on_bus.id & ECAT_CAN_ID), data[i]);
      return order;
    }
    bytes[i] = (uint8_t)data[i];
  }
  ecat_session_can_data(&message->on_bus, bytes, message->on_bus.length);
  return order;
}

/* Sends a message if it is due: when all of its signals were written at this time, else before the next sample.
 * `trigger`: a count, see ecat_session_can_trigger(). Returns how many were handed over so far, modulo 2^31. */
ECATM_FUNCTION int ecatm_can_send(void *object, double time, int order, int trigger) {
  ecatm_message *message = (ecatm_message *)object;
  (void)time;
  (void)order;
  ecat_session_can_trigger(&message->on_bus, trigger);
  ecatm_check(message->node.master, ecat_session_can_send(&message->on_bus, 1));
  return ecatm_count((double)message->on_bus.frame->count);
}

#endif
