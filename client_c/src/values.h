/* The conversion of a value to the bits of an entry: the only rule for rounding, limits and refused
 * values (docs/process-image.md, "What is written"). */
#ifndef ECAT_VALUES_H
#define ECAT_VALUES_H

#include <ecat/ecat.h>

/* The values that may be written to an entry. */
struct rule {
  uint64_t low, high;      /* limits of an integer entry; int64_t if `sign` */
  double minimum, maximum; /* limits of a floating-point entry */
  uint8_t bits, sign, real;
};

/* A value that a program writes. */
struct value {
  double real;         /* unless `is_whole` */
  int64_t whole;       /* an unsigned 64-bit value is kept bit by bit */
  double scale, offset; /* the raw value is (real - offset) / scale */
  int is_whole;
  int analog; /* 1: a value beyond the limits is cut to them instead of being refused */
};

struct rule value_rule(uint32_t type, uint32_t bits, double minimum, double maximum);

/* Encodes a value as the bits of an entry. ECAT_ERANGE: the value is refused. The rounding mode of the
 * thread has no effect. */
int value_encode(const struct rule *rule, const struct value *value, uint64_t *bits);

/* The smallest and the largest raw value, for messages. */
void value_limits(const struct rule *rule, double *low, double *high);

/* Whether a value is an analog quantity, which is cut to its limits instead of being refused. */
static inline int value_is_analog(const char *unit, double scale, double offset) {
  return unit[0] != '\0' || scale != 1 || offset != 0;
}

#endif
