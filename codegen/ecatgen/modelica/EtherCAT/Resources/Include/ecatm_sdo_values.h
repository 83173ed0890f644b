/* Conversion between the numbers and texts of a model and SDO data (ETG.1000.6, little endian). */
#ifndef ECATM_SDO_VALUES_H
#define ECATM_SDO_VALUES_H

#include "ecatm_objects.h"

/* A type is its CoE index, which is also the number of its EtherCAT.Types.DataType. */
#define ECATM_REAL32 0x08
#define ECATM_VISIBLE_STRING 0x09
#define ECATM_OCTET_STRING 0x0A
#define ECATM_UNICODE_STRING 0x0B
#define ECATM_REAL64 0x11

#define ECATM_STRING (4 * ECAT_REQUEST_BYTES + 1) /* longest text of an object: each byte as \xNN */

/* Returns the bytes of a number as SDO data, 0 if the type is not a number. */
ECATM_FUNCTION int ecatm_type_bytes(int type) {
  static const signed char bytes[] = {0, 1, 1, 2, 4, 1, 2, 4, 4, 0, 0, 0, 0, 0,
                                      0, 0, 3, 8, 5, 6, 7, 8, 3, 0, 5, 6, 7, 8};
  return type >= 0 && type < (int)sizeof bytes ? bytes[type] : 0;
}

ECATM_FUNCTION int ecatm_type_is_real(int type) {
  return type == ECATM_REAL32 || type == ECATM_REAL64;
}

ECATM_FUNCTION int ecatm_type_is_text(int type) {
  return type >= ECATM_VISIBLE_STRING && type <= ECATM_UNICODE_STRING;
}

/* --- Numbers ------------------------------------------------------------------------------- */

/* Whether a type has a sign: INTEGER8, 16, 32, 24, 40, 48, 56, 64. */
ECATM_FUNCTION int ecatm_signed(int type) {
  return (type >= 0x02 && type <= 0x04) || type == 0x10 || (type >= 0x12 && type <= 0x15);
}

/* The number in the bits of a floating-point type. */
ECATM_FUNCTION double ecatm_bits_real(int type, uint64_t bits) {
  uint32_t word = (uint32_t)bits;
  float single;
  double value;
  memcpy(&value, &bits, sizeof value);
  memcpy(&single, &word, sizeof single);
  return type == ECATM_REAL64 ? value : single;
}

/* Makes SDO data of a number. Rounding and range check are those of process data. Returns 0, or ECAT_ERANGE
 * and a text. */
ECATM_FUNCTION int ecatm_encode_number(int type, double value, unsigned char *data, size_t *length,
                                       char *text) {
  ecat_signal_info entry;
  double low, high;
  uint64_t bits;
  int i, bytes = ecatm_type_bytes(type);
  memset(&entry, 0, sizeof entry);
  entry.type = (unsigned)type;
  entry.bit_length = type == 0x01 ? 1 : 8 * (unsigned)bytes;
  entry.maximum = HUGE_VAL;
  entry.minimum = -HUGE_VAL;
  if (ecat_encode(&entry, value, &bits) != 0) {
    ecat_limits(&entry, &low, &high);
    sprintf(text, "%.15g is out of range: %.15g to %.15g are allowed", value, low, high);
    return ECAT_ERANGE;
  }
  for (i = 0; i < bytes; i++) data[i] = (unsigned char)(bits >> (8 * i) & 0xFF);
  *length = (size_t)bytes;
  return 0;
}

/* Reads the number in SDO data; integers beyond 2^53 are rounded. Returns 0, or ECAT_EARG and a text. */
ECATM_FUNCTION int ecatm_decode_number(int type, const unsigned char *data, size_t length,
                                       double *value, char *text) {
  uint64_t bits = 0;
  int i, bytes = ecatm_type_bytes(type);
  if (length != (size_t)bytes) {
    sprintf(text, "the object has %lu bytes, but the dataType has %d", (unsigned long)length, bytes);
    return ECAT_EARG;
  }
  for (i = bytes - 1; i >= 0; i--) bits = bits << 8 | data[i];
  if (type == 0x01) *value = bits != 0;
  else if (ecatm_type_is_real(type)) *value = ecatm_bits_real(type, bits);
  else if (!ecatm_signed(type) || bits >> (8 * bytes - 1) == 0) *value = (double)bits;
  else *value = -(double)((~bits + 1) & (~(uint64_t)0 >> (64 - 8 * bytes)));
  return 0;
}

/* Checks that a Modelica Integer can hold a number. Returns 0, or ECAT_ERANGE and a text. */
ECATM_FUNCTION int ecatm_check_integer(double number, char *text) {
  if (number >= -2147483648.0 && number <= 2147483647.0) return 0;
  sprintf(text, "%.0f is too large for a Modelica Integer: read it as Real", number);
  return ECAT_ERANGE;
}

/* --- Texts --------------------------------------------------------------------------------- */

/* Bytes of the UTF-8 character at `data`, 0 if there is none (overlong, surrogate, cut). */
ECATM_FUNCTION int ecatm_utf8_bytes(const unsigned char *data, size_t length) {
  unsigned long code, least;
  int i, more;
  if (length == 0) return 0;
  if (data[0] < 0x80) return 1;
  more = data[0] >= 0xF0 ? 3 : data[0] >= 0xE0 ? 2 : 1;
  if (data[0] < 0xC2 || data[0] > 0xF4 || length <= (size_t)more) return 0;
  code = data[0] & (0x3Fu >> more);
  least = more == 1 ? 0x80 : more == 2 ? 0x800 : 0x10000;
  for (i = 1; i <= more; i++) {
    if ((data[i] & 0xC0) != 0x80) return 0;
    code = code << 6 | (data[i] & 0x3F);
  }
  return code < least || code > 0x10FFFF || (code >= 0xD800 && code < 0xE000) ? 0 : more + 1;
}

/* Appends a character in UTF-8, or a question mark for a character that cannot be printed. */
ECATM_FUNCTION char *ecatm_utf8(char *out, unsigned long code) {
  if (code < 0x20 || (code >= 0x7F && code < 0xA0) || (code >= 0xD800 && code < 0xE000)) code = '?';
  if (code < 0x80) {
    *out++ = (char)code;
    return out;
  }
  if (code < 0x800) {
    *out++ = (char)(0xC0 | code >> 6);
  } else {
    if (code < 0x10000) {
      *out++ = (char)(0xE0 | code >> 12);
    } else {
      *out++ = (char)(0xF0 | code >> 18);
      *out++ = (char)(0x80 | (code >> 12 & 0x3F));
    }
    *out++ = (char)(0x80 | (code >> 6 & 0x3F));
  }
  *out++ = (char)(0x80 | (code & 0x3F));
  return out;
}

/* A VISIBLE_STRING ends with its first zero. The standard requires ASCII; vendors use UTF-8 or Latin-1. */
ECATM_FUNCTION char *ecatm_decode_visible(const unsigned char *data, size_t length, char *out) {
  size_t i, end = 0;
  int utf8 = 1, n;
  while (end < length && data[end] != 0) end++;
  for (i = 0; i < end; i += (size_t)n)
    if ((n = ecatm_utf8_bytes(data + i, end - i)) == 0) utf8 = 0, n = 1;
  for (i = 0; i < end; i++) {
    if (utf8 && data[i] >= 0x80) *out++ = (char)data[i];
    else out = ecatm_utf8(out, data[i]);
  }
  return out;
}

/* An OCTET_STRING may hold any bytes. The backslash and all that is not printable ASCII become \xNN. */
ECATM_FUNCTION char *ecatm_decode_octets(const unsigned char *data, size_t length, char *out) {
  size_t i;
  while (length > 0 && data[length - 1] == 0) length--;
  for (i = 0; i < length; i++) {
    if (data[i] >= 0x20 && data[i] < 0x7F && data[i] != '\\') *out++ = (char)data[i];
    else out += sprintf(out, "\\x%02X", (unsigned)data[i]);
  }
  return out;
}

/* A UNICODE_STRING is UTF-16; single halves of surrogate pairs become question marks. */
ECATM_FUNCTION char *ecatm_decode_unicode(const unsigned char *data, size_t length, char *out) {
  size_t i;
  for (i = 0; i + 1 < length; i += 2) {
    unsigned long code = (unsigned long)data[i] | (unsigned long)data[i + 1] << 8, next = 0;
    if (code == 0) break;
    if (i + 3 < length) next = (unsigned long)data[i + 2] | (unsigned long)data[i + 3] << 8;
    if (code >= 0xD800 && code < 0xDC00 && next >= 0xDC00 && next < 0xE000) {
      code = 0x10000 + ((code - 0xD800) << 10) + (next - 0xDC00);
      i += 2;
    }
    out = ecatm_utf8(out, code);
  }
  return out;
}

/* The text in SDO data, in UTF-8, without the zeros that fill it up. `out` has ECATM_STRING bytes. */
ECATM_FUNCTION void ecatm_decode_text(int type, const unsigned char *data, size_t length, char *out) {
  if (type == ECATM_OCTET_STRING) out = ecatm_decode_octets(data, length, out);
  else if (type == ECATM_UNICODE_STRING) out = ecatm_decode_unicode(data, length, out);
  else out = ecatm_decode_visible(data, length, out);
  *out = '\0';
}

ECATM_FUNCTION int ecatm_hex_digit(int c) {
  const char *digits = "0123456789ABCDEFabcdef", *found = c != 0 ? strchr(digits, c) : NULL;
  return found == NULL ? -1 : (int)(found - digits) - (found - digits > 15 ? 6 : 0);
}

/* Makes the next one to four bytes of SDO data for a text, and moves the text on. Returns their number, or
 * 0 if the text is not valid. */
ECATM_FUNCTION int ecatm_encode_character(int type, const unsigned char **text,
                                          unsigned char data[4]) {
  const unsigned char *from = *text;
  int bytes = ecatm_utf8_bytes(from, strlen((const char *)from)), i;
  unsigned long code, pair;
  if (type == ECATM_OCTET_STRING && from[0] == '\\') {
    int high = from[1] == 'x' ? ecatm_hex_digit(from[2]) : -1;
    int low = high >= 0 ? ecatm_hex_digit(from[3]) : -1;
    if (low < 0) return 0;
    *text += 4;
    data[0] = (unsigned char)(16 * high + low);
    return 1;
  }
  if (type != ECATM_UNICODE_STRING || bytes == 0) {
    *text += 1;
    data[0] = from[0];
    return type != ECATM_UNICODE_STRING;
  }
  *text += bytes;
  code = bytes == 1 ? from[0] : from[0] & (0x7Fu >> bytes);
  for (i = 1; i < bytes; i++) code = code << 6 | (from[i] & 0x3F);
  pair = code < 0x10000 ? code : 0xD800 + ((code - 0x10000) >> 10);
  data[0] = (unsigned char)(pair & 0xFF), data[1] = (unsigned char)(pair >> 8);
  if (code < 0x10000) return 2;
  pair = 0xDC00 + (code & 0x3FF);
  data[2] = (unsigned char)(pair & 0xFF), data[3] = (unsigned char)(pair >> 8);
  return 4;
}

/* Makes SDO data of a text. An empty text becomes one zero, since a download needs at least one byte.
 * `data` has ECAT_REQUEST_BYTES. Returns 0, or ECAT_ERANGE and a text. */
ECATM_FUNCTION int ecatm_encode_text(int type, const char *value, unsigned char *data,
                                     size_t *length, char *text) {
  const unsigned char *from = (const unsigned char *)value;
  unsigned char part[4];
  size_t used = 0;
  while (*from != '\0') {
    int bytes = ecatm_encode_character(type, &from, part);
    if (bytes == 0) {
      strcpy(text, type == ECATM_OCTET_STRING
                       ? "a backslash in the text is not followed by x and two hexadecimal digits; the "
                         "backslash itself is \\x5C"
                       : "the text is not valid UTF-8");
      return ECAT_ERANGE;
    }
    if (used + (size_t)bytes > ECAT_REQUEST_BYTES) {
      sprintf(text, "the text has more than the %d bytes that can be written", ECAT_REQUEST_BYTES);
      return ECAT_ERANGE;
    }
    memcpy(data + used, part, (size_t)bytes);
    used += (size_t)bytes;
  }
  if (used == 0) data[used++] = 0;
  *length = used;
  return 0;
}

#endif
