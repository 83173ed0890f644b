/* The operations of CAN in FMI-LS-BUS 1.0, the layered standard for buses: what virtual ECUs and a bus
 * simulation exchange in binary variables. An operation is its code, its length with code and length (both
 * 32 bits), and its arguments. Numbers are little endian, nothing is aligned.
 *
 * What comes from another FMU is checked here, and only here. C89-clean.
 */
#ifndef LS_OPERATIONS_H
#define LS_OPERATIONS_H

#include <stddef.h>
#include <stdint.h>

enum ls_code {
  LS_FORMAT_ERROR = 0x01,
  LS_TRANSMIT = 0x10,
  LS_TRANSMIT_FD = 0x11,
  LS_TRANSMIT_XL = 0x12,
  LS_CONFIRM = 0x20,
  LS_ARBITRATION_LOST = 0x30,
  LS_BUS_ERROR = 0x31,
  LS_CONFIGURATION = 0x40,
  LS_STATUS = 0x41,
  LS_WAKEUP = 0x42
};

/* What a configuration is about, and the behaviour when arbitration is lost. */
enum ls_configuration { LS_BAUD_RATE = 1, LS_BAUD_RATE_FD = 2, LS_BAUD_RATE_XL = 3, LS_ARBITRATION = 4 };
enum ls_arbitration { LS_BUFFER_AND_RETRANSMIT = 1, LS_DISCARD_AND_NOTIFY = 2 };
enum ls_status { LS_ERROR_ACTIVE = 1, LS_ERROR_PASSIVE = 2, LS_BUS_OFF = 3 };
enum ls_error { LS_BIT_ERROR = 1, LS_STUFFING_ERROR, LS_FORM_ERROR, LS_CRC_ERROR, LS_ACK_ERROR, LS_BROKEN_FRAME };
enum ls_flag { LS_PRIMARY = 1, LS_SECONDARY = 2 };

enum {
  LS_HEAD = 8,               /* bytes of code and length */
  LS_TRANSMIT_BYTES = 16,    /* of a Transmit without its data */
  LS_BATCH = 2048            /* bytes that a node must take at once, as in the examples of the standard */
};

typedef struct ls_operation {
  uint32_t code;
  const uint8_t *bytes; /* the whole operation */
  size_t length;
  /* Of a Transmit: */
  uint32_t id;
  int extended, remote;
  const uint8_t *data; /* also of a Format Error */
  size_t data_length;
  /* Of a Configuration, or a Status: */
  unsigned kind;
  uint32_t value;
} ls_operation;

/* Takes the operation at the beginning of `*length` bytes, and moves `*bytes` behind it. Returns 0 if nothing is
 * left. `*wrong` says what is wrong with the operation, NULL: nothing. If its length cannot be, it is the rest. */
int ls_next(const uint8_t **bytes, size_t *length, ls_operation *operation, const char **wrong);

/* Each writes one operation to `to`, which has room for LS_BATCH bytes, and returns its length. */
size_t ls_transmit(uint8_t *to, uint32_t id, int extended, int remote, const uint8_t *data, size_t length);
size_t ls_confirm(uint8_t *to, uint32_t id);
size_t ls_bus_error(uint8_t *to, uint32_t id, enum ls_error error, enum ls_flag flag, int is_sender);
size_t ls_wakeup(uint8_t *to);
/* An operation that was longer than an answer can be is cut. */
size_t ls_format_error(uint8_t *to, const uint8_t *operation, size_t length);

#endif
