/* Operations of FMI-LS-BUS to and from bytes. */
#include "ls_operations.h"

#include <string.h>

/* --- from bytes ------------------------------------------------------------------------------- */

static uint32_t number(const uint8_t *from, int bytes) {
  uint32_t value = 0;
  while (bytes-- > 0) value = value << 8 | from[bytes];
  return value;
}

static const char *read_transmit(ls_operation *o) {
  if (o->length < LS_TRANSMIT_BYTES) return "a Transmit is shorter than its arguments";
  o->id = number(o->bytes + 8, 4);
  o->extended = o->bytes[12];
  o->remote = o->bytes[13];
  o->data_length = number(o->bytes + 14, 2);
  o->data = o->bytes + LS_TRANSMIT_BYTES;
  if (o->length - LS_TRANSMIT_BYTES != o->data_length) return "the lengths in a Transmit contradict each other";
  if (o->extended > 1 || o->remote > 1) return "Ide or Rtr of a Transmit is neither 0 nor 1";
  if (o->data_length > 8) return "a CAN frame has at most 8 bytes of data";
  if (o->id > (o->extended ? 0x1FFFFFFFu : 0x7FFu)) return "an ID has more bits than its kind of frame";
  return NULL;
}

static const char *read_configuration(ls_operation *o) {
  size_t value;
  if (o->length < LS_HEAD + 1) return "a Configuration is shorter than its arguments";
  o->kind = o->bytes[LS_HEAD];
  if (o->kind < LS_BAUD_RATE || o->kind > LS_ARBITRATION) return "a Configuration is about nothing that the standard has";
  value = o->kind == LS_ARBITRATION ? 1 : 4;
  if (o->length != LS_HEAD + 1 + value) return "a Configuration has another length than its parameter";
  o->value = number(o->bytes + LS_HEAD + 1, (int)value);
  if (o->kind == LS_ARBITRATION && (o->value < LS_BUFFER_AND_RETRANSMIT || o->value > LS_DISCARD_AND_NOTIFY))
    return "an unknown behaviour when arbitration is lost";
  return NULL;
}

static const char *read_arguments(ls_operation *o) {
  switch (o->code) {
    case LS_TRANSMIT:
      return read_transmit(o);
    case LS_CONFIGURATION:
      return read_configuration(o);
    case LS_STATUS:
      if (o->length != LS_HEAD + 1) return "a Status has another length than its argument";
      o->value = o->bytes[LS_HEAD];
      return o->value < LS_ERROR_ACTIVE || o->value > LS_BUS_OFF ? "a Status that the standard does not have" : NULL;
    case LS_WAKEUP:
      return o->length != LS_HEAD ? "a Wakeup has arguments" : NULL;
    case LS_FORMAT_ERROR:
      return NULL; /* never answered, so that two FMUs cannot answer each other for ever */
    case LS_TRANSMIT_FD:
      return "the terminal has no CAN FD";
    case LS_TRANSMIT_XL:
      return "the terminal has no CAN XL";
    case LS_CONFIRM:
    case LS_ARBITRATION_LOST:
    case LS_BUS_ERROR:
      return "only a bus simulation sends this operation";
    default:
      return "an unknown operation";
  }
}

int ls_next(const uint8_t **bytes, size_t *length, ls_operation *operation, const char **wrong) {
  size_t all;
  memset(operation, 0, sizeof *operation);
  *wrong = NULL;
  if (*length == 0) return 0;
  operation->bytes = *bytes;
  operation->length = *length;
  if (*length < LS_HEAD) {
    *wrong = "what is left is shorter than an operation";
  } else {
    operation->code = number(*bytes, 4);
    all = number(*bytes + 4, 4);
    if (all < LS_HEAD || all > *length)
      *wrong = "the length of an operation is wrong";
    else
      operation->length = all;
  }
  *bytes += operation->length;
  *length -= operation->length;
  if (*wrong == NULL) *wrong = read_arguments(operation);
  return 1;
}

/* --- to bytes --------------------------------------------------------------------------------- */

static void put(uint8_t *to, uint32_t value, int bytes) {
  int i;
  for (i = 0; i < bytes; i++) to[i] = (uint8_t)(value >> 8 * i);
}

static size_t begin(uint8_t *to, enum ls_code code, size_t length) {
  put(to, (uint32_t)code, 4);
  put(to + 4, (uint32_t)length, 4);
  return length;
}

size_t ls_transmit(uint8_t *to, uint32_t id, int extended, int remote, const uint8_t *data, size_t length) {
  put(to + 8, id, 4);
  to[12] = extended != 0;
  to[13] = remote != 0;
  put(to + 14, (uint32_t)length, 2);
  memcpy(to + LS_TRANSMIT_BYTES, data, length);
  return begin(to, LS_TRANSMIT, LS_TRANSMIT_BYTES + length);
}

size_t ls_confirm(uint8_t *to, uint32_t id) {
  put(to + 8, id, 4);
  return begin(to, LS_CONFIRM, 12);
}

size_t ls_bus_error(uint8_t *to, uint32_t id, enum ls_error error, enum ls_flag flag, int is_sender) {
  put(to + 8, id, 4);
  to[12] = (uint8_t)error;
  to[13] = (uint8_t)flag;
  to[14] = is_sender != 0;
  return begin(to, LS_BUS_ERROR, 15);
}

size_t ls_wakeup(uint8_t *to) { return begin(to, LS_WAKEUP, LS_HEAD); }

size_t ls_format_error(uint8_t *to, const uint8_t *operation, size_t length) {
  if (length > LS_BATCH - 10) length = LS_BATCH - 10;
  put(to + 8, (uint32_t)length, 2);
  memcpy(to + 10, operation, length);
  return begin(to, LS_FORMAT_ERROR, 10 + length);
}
