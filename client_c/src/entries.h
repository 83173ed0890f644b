/* The places of PDO entries in a process image, and the conversion of their bits to numbers. Client and
 * engine share this file. Bit 0 is the lowest bit of the first byte (ETG.1000.6). Images need padding,
 * since up to 9 bytes are read from the first byte of an entry on. */
#ifndef ECAT_ENTRIES_H
#define ECAT_ENTRIES_H

#include <stdint.h>
#include <string.h>

static inline uint64_t bits_get(const uint8_t *image, uint32_t bit, uint32_t bits) {
  uint32_t shift = bit % 8;
  uint64_t word;
  memcpy(&word, image + bit / 8, 8);
  word >>= shift;
  if (shift + bits > 64) word |= (uint64_t)image[bit / 8 + 8] << (64 - shift);
  return bits == 64 ? word : word & ((1ull << bits) - 1);
}

static inline void bits_put(uint8_t *image, uint32_t bit, uint32_t bits, uint64_t value) {
  while (bits > 0) {
    uint32_t shift = bit % 8, count = 8 - shift < bits ? 8 - shift : bits;
    uint8_t mask = (uint8_t)(((1u << count) - 1) << shift);
    image[bit / 8] = (uint8_t)((image[bit / 8] & ~mask) | ((uint8_t)(value << shift) & mask));
    value >>= count;
    bit += count;
    bits -= count;
  }
}

/* CoE data types (ETG.1000.6): INTEGER8/16/32 are 0x0002 to 0x0004, INTEGER24 is 0x0010, INTEGER40 to
 * INTEGER64 are 0x0012 to 0x0015; REAL32 is 0x0008, REAL64 is 0x0011. */
static inline int type_is_signed(uint32_t type) {
  return (type >= 0x0002 && type <= 0x0004) || type == 0x0010 ||
         (type >= 0x0012 && type <= 0x0015);
}

static inline int type_is_real(uint32_t type, uint32_t bits) {
  return (type == 0x0008 && bits == 32) || (type == 0x0011 && bits == 64);
}

static inline int64_t sign_extended(uint64_t raw, uint32_t bits) {
  if (bits < 64 && (raw >> (bits - 1) & 1)) raw |= ~0ull << bits;
  return (int64_t)raw;
}

static inline double raw_to_double(uint64_t raw, uint32_t bits, int sign, int real) {
  if (real && bits == 32) {
    uint32_t half = (uint32_t)raw;
    float value;
    memcpy(&value, &half, sizeof value);
    return (double)value;
  }
  if (real) {
    double value;
    memcpy(&value, &raw, sizeof value);
    return value;
  }
  return sign ? (double)sign_extended(raw, bits) : (double)raw;
}

/* Sets of signals: one bit each, in words of 64 bits. */
static inline int set_has(const uint64_t *set, uint32_t n) { return (int)(set[n / 64] >> (n % 64) & 1); }
static inline void set_add(uint64_t *set, uint32_t n) { set[n / 64] |= 1ull << (n % 64); }
static inline void set_drop(uint64_t *set, uint32_t n) { set[n / 64] &= ~(1ull << (n % 64)); }

#endif
