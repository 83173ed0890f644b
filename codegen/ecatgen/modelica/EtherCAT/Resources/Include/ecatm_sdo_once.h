/* Functions that read or write one object and wait for the answer. They are for scripts, not for a running
 * model. */
#ifndef ECATM_SDO_ONCE_H
#define ECATM_SDO_ONCE_H

#include "ecatm_sdo.h"

#define ECATM_ONCE_TIMEOUT 20.0  /* seconds, more than the daemon takes to give up */

/* Carries a request out over a separate connection. Writes `*length` bytes of `data` to the object, or, if
 * `*length` is 0, reads the object into `data`. Stops with a message if that fails. */
ECATM_FUNCTION void ecatm_once(const char *name, int position, const char *object,
                               unsigned char *data, size_t *length) {
  ecat_t *bus = NULL;
  char text[ECATM_TEXT];
  int index = -1, subindex = -1, request, code, download = *length > 0;
  ecatm_sdo_parse("", object, &index, &subindex);
  ecatm_check_range("", position, index, subindex);
  code = request = ecat_open(&bus, name);
  if (code == 0)
    code = request = ecat_sdo_start(bus, position, (unsigned)index, (unsigned)subindex,
                                    download ? data : NULL, *length);
  if (request >= 0) code = ecat_wait_request(bus, request, ECATM_ONCE_TIMEOUT);
  if (code == 0)
    do code = ecat_poll(bus, request, data, ECAT_REQUEST_BYTES, length, NULL);
    while (code == ECAT_EBUSY);
  sprintf(text, "%.*s", ECATM_TEXT - 1, ecat_error(bus));
  ecat_close(bus);
  if (code < 0)
    ModelicaFormatError("EtherCAT: %s object 0x%04X:%02X of slave %d of bus '%s' failed: %s",
                        download ? "writing" : "reading", (unsigned)index, (unsigned)subindex,
                        position, name, text);
}

/* Stops with `text` if the value cannot be converted (`code` is not 0). */
ECATM_FUNCTION void ecatm_once_check(int code, const char *object, const char *text) {
  if (code != 0) ModelicaFormatError("EtherCAT: object %s: %s", object, text);
}

ECATM_FUNCTION double ecatm_once_number(const char *name, int position, const char *object, int type,
                                        int value) {
  unsigned char data[ECAT_REQUEST_BYTES];
  char text[ECATM_TEXT];
  double number = 0;
  size_t length = 0;
  ecatm_sdo_check_type("", type, value);
  ecatm_once(name, position, object, data, &length);
  ecatm_once_check(ecatm_decode_number(type, data, length, &number, text), object, text);
  return number;
}

ECATM_FUNCTION double ecatm_once_read_real(const char *name, int position, const char *object,
                                           int type) {
  return ecatm_once_number(name, position, object, type, ECATM_REAL_VALUE);
}

ECATM_FUNCTION int ecatm_once_read_integer(const char *name, int position, const char *object,
                                           int type) {
  double number = ecatm_once_number(name, position, object, type, ECATM_INTEGER_VALUE);
  char text[ECATM_TEXT];
  ecatm_once_check(ecatm_check_integer(number, text), object, text);
  return (int)number;
}

ECATM_FUNCTION const char *ecatm_once_read_string(const char *name, int position,
                                                  const char *object, int type) {
  unsigned char data[ECAT_REQUEST_BYTES];
  char text[ECATM_STRING];
  size_t length = 0;
  ecatm_sdo_check_type("", type, ECATM_STRING_VALUE);
  ecatm_once(name, position, object, data, &length);
  ecatm_decode_text(type, data, length, text);
  return ecatm_text(text);
}

ECATM_FUNCTION void ecatm_once_write_real(const char *name, int position, const char *object, int type,
                                          double value) {
  unsigned char data[ECAT_REQUEST_BYTES];
  char text[ECATM_TEXT];
  size_t length;
  ecatm_sdo_check_type("", type, ECATM_REAL_VALUE);
  ecatm_once_check(ecatm_encode_number(type, value, data, &length, text), object, text);
  ecatm_once(name, position, object, data, &length);
}

ECATM_FUNCTION void ecatm_once_write_integer(const char *name, int position, const char *object,
                                             int type, int value) {
  ecatm_sdo_check_type("", type, ECATM_INTEGER_VALUE);
  ecatm_once_write_real(name, position, object, type, value);
}

ECATM_FUNCTION void ecatm_once_write_string(const char *name, int position, const char *object,
                                            int type, const char *value) {
  unsigned char data[ECAT_REQUEST_BYTES];
  char text[ECATM_TEXT];
  size_t length;
  ecatm_sdo_check_type("", type, ECATM_STRING_VALUE);
  ecatm_once_check(ecatm_encode_text(type, value, data, &length, text), object, text);
  ecatm_once(name, position, object, data, &length);
}

#endif
