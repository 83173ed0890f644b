/* What an entry makes of the values that are written to it: the one rule for rounding, for limits and
 * for what is refused (docs/process-image.md, "What is written"). */
#ifndef ECAT_VALUES_H
#define ECAT_VALUES_H

#include <ecat/ecat.h>

/* What a value of an entry has to keep to. */
struct rule {
  uint64_t low, high;      /* whole numbers that an integer entry may have, as int64_t if it has a sign */
  double minimum, maximum; /* the same of a real one */
  uint8_t bits, sign, real;
};

/* A value that somebody wants to write. */
struct value {
  double real;         /* unless `is_whole` */
  int64_t whole;       /* 64 bits without a sign keep their bits */
  double scale, offset; /* it stands for the raw value (real - offset) / scale */
  int is_whole;
  int analog; /* it is held at the limits, and not refused beyond them */
};

struct rule value_rule(uint32_t type, uint32_t bits, double minimum, double maximum);

/* The bits that an entry gets from a value; ECAT_ERANGE: it is refused. The rounding mode of the thread
 * does not matter. */
int value_encode(const struct rule *rule, const struct value *value, uint64_t *bits);

/* The smallest and the largest value, for messages. */
void value_limits(const struct rule *rule, double *low, double *high);

/* Whether it means something physical, which has limits where a number has an end. */
static inline int value_is_analog(const char *unit, double scale, double offset) {
  return unit[0] != '\0' || scale != 1 || offset != 0;
}

#endif
