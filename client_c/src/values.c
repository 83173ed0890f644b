/* Encodes a value as the bits of an entry. */
#include "values.h"

#include <fenv.h>
#include <float.h>
#include <math.h>
#include <string.h>

#include "entries.h"

#define TWO_63 9223372036854775808.0
#define TWO_64 18446744073709551616.0
#define SINGLE_END 340282356779733661637539395458142568448.0 /* from here on (float) gives infinity */

/* The only place of these formulas in C. They are not inline: a model that is compiled for the newest
 * processors might use a fused multiply-add, which rounds once, and get other numbers than other programs. */
double ecat_to_physical(double raw, double scale, double offset) { return raw * scale + offset; }

double ecat_to_raw(double value, double scale, double offset) { return (value - offset) / scale; }

double ecat_round(double value) {
  int64_t whole;
  double rest;
  if (!(fabs(value) < 4503599627370496.0)) return value; /* from 2^52 on, a double has no fraction */
  whole = (int64_t)value;
  rest = value - (double)whole; /* exact, so that the rounding mode of the thread does not matter */
  if (rest > 0.5 || (rest == 0.5 && whole % 2 != 0)) whole++;
  if (rest < -0.5 || (rest == -0.5 && whole % 2 != 0)) whole--;
  return (double)whole;
}

/* --- integers ------------------------------------------------------------------------------- */

static int below(uint64_t a, uint64_t b, int sign) {
  return sign ? (int64_t)a < (int64_t)b : a < b;
}

/* A whole number as 64 bits, cut to the range of int64_t or uint64_t. */
static uint64_t nearest_bits(double whole, int sign) {
  if (!sign) return whole >= TWO_64 ? UINT64_MAX : whole > 0 ? (uint64_t)whole : 0;
  return (uint64_t)(whole >= TWO_63 ? INT64_MAX : whole >= -TWO_63 ? (int64_t)whole : INT64_MIN);
}

static int integer(const struct rule *rule, const struct value *value, double raw, uint64_t *bits) {
  int outside = 0;
  if (value->is_whole) {
    *bits = (uint64_t)value->whole;
    outside = !rule->sign && rule->bits < 64 && value->whole < 0;
  } else {
    raw = ecat_round(raw);
    *bits = nearest_bits(raw, rule->sign);
    outside = rule->sign ? raw >= TWO_63 || raw < -TWO_63 : raw >= TWO_64 || raw < 0;
  }
  if (below(*bits, rule->low, rule->sign)) outside = 1, *bits = rule->low;
  if (below(rule->high, *bits, rule->sign)) outside = 1, *bits = rule->high;
  if (rule->bits < 64) *bits &= ((uint64_t)1 << rule->bits) - 1;
  return outside && !value->analog ? ECAT_ERANGE : 0;
}

/* --- floating-point numbers ----------------------------------------------------------------- */

static int real(const struct rule *rule, const struct value *value, double raw, uint64_t *bits) {
  double most = rule->bits == 32 ? (double)FLT_MAX : DBL_MAX, held;
  int outside = fabs(raw) >= (rule->bits == 32 ? SINGLE_END : HUGE_VAL);
  float single = outside || rule->bits == 64 ? 0 : (float)raw;
  held = outside ? (raw > 0 ? most : -most) : rule->bits == 32 ? (double)single : raw;
  if (held < rule->minimum) outside = 1, held = rule->minimum;
  if (held > rule->maximum) outside = 1, held = rule->maximum;
  single = (float)held;
  *bits = 0;
  if (rule->bits == 32)
    memcpy(bits, &single, sizeof single);
  else
    memcpy(bits, &held, sizeof held);
  return outside && !value->analog ? ECAT_ERANGE : 0;
}

/* --- both ----------------------------------------------------------------------------------- */

/* Not inlined, so that the compiler cannot move its arithmetic out of the two calls of fesetenv(). */
__attribute__((noinline)) static int encode(const struct rule *rule, const struct value *value,
                                            uint64_t *bits) {
  double raw = value->is_whole ? (double)value->whole : value->real;
  if (!isfinite(raw)) return ECAT_ERANGE;
  if (value->scale != 1 || value->offset != 0) raw = ecat_to_raw(raw, value->scale, value->offset);
  return rule->real ? real(rule, value, raw, bits) : integer(rule, value, raw, bits);
}

/* Whether this thread rounds to nearest. The addition is cheaper than fegetround(), and also sees a mode
 * that was set without the C library. */
static int rounds_to_nearest(void) {
  volatile double one = 1, little = DBL_EPSILON / 8;
  return one + little == one - little;
}

int value_encode(const struct rule *rule, const struct value *value, uint64_t *bits) {
  fenv_t own;
  int code;
  if (rounds_to_nearest()) return encode(rule, value, bits);
  fegetenv(&own);
  fesetenv(FE_DFL_ENV);
  code = encode(rule, value, bits);
  fesetenv(&own);
  return code;
}

struct rule value_rule(uint32_t type, uint32_t bits, double minimum, double maximum) {
  struct rule rule;
  uint64_t limit;
  rule.bits = (uint8_t)bits;
  rule.sign = (uint8_t)type_is_signed(type);
  rule.real = (uint8_t)type_is_real(type, bits);
  rule.minimum = minimum;
  rule.maximum = maximum;
  rule.high = bits > rule.sign ? ~(uint64_t)0 >> (64 - bits + rule.sign) : 0;
  rule.low = rule.sign ? ~rule.high : 0;
  limit = nearest_bits(ceil(minimum), rule.sign);
  if (below(rule.low, limit, rule.sign)) rule.low = limit;
  limit = nearest_bits(floor(maximum), rule.sign);
  if (below(limit, rule.high, rule.sign)) rule.high = limit;
  return rule;
}

void value_limits(const struct rule *rule, double *low, double *high) {
  double most = rule->bits == 32 ? (double)FLT_MAX : DBL_MAX;
  if (rule->real) {
    *low = rule->minimum > -most ? rule->minimum : -most;
    *high = rule->maximum < most ? rule->maximum : most;
  } else {
    *low = rule->sign ? (double)(int64_t)rule->low : (double)rule->low;
    *high = rule->sign ? (double)(int64_t)rule->high : (double)rule->high;
  }
}

/* --- without a bus -------------------------------------------------------------------------- */

static struct rule rule_of(const ecat_signal_info *entry) {
  return value_rule(entry->type, entry->bit_length, entry->minimum, entry->maximum);
}

static int encode_as(const ecat_signal_info *entry, const struct value *value, uint64_t *bits) {
  struct rule rule = rule_of(entry);
  return value_encode(&rule, value, bits);
}

void ecat_limits(const ecat_signal_info *entry, double *low, double *high) {
  struct rule rule = rule_of(entry);
  value_limits(&rule, low, high);
}

int ecat_encode(const ecat_signal_info *entry, double value, uint64_t *bits) {
  struct value given = {value, 0, 1, 0, 0, 0};
  return encode_as(entry, &given, bits);
}

int ecat_encode_int(const ecat_signal_info *entry, int64_t value, uint64_t *bits) {
  struct value given = {0, value, 1, 0, 1, 0};
  return encode_as(entry, &given, bits);
}

int ecat_encode_physical(const ecat_signal_info *entry, double value, uint64_t *bits) {
  struct value given = {value, 0, entry->scale, entry->offset, 0, 0};
  given.analog = value_is_analog(entry->unit, entry->scale, entry->offset);
  return encode_as(entry, &given, bits);
}
