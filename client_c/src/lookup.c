/* Finds entries by name, "slave/entry", as a person writes it. */
#include "internal.h"

#include <ctype.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static int is_text(const char *part, size_t length, const char *text) {
  return strlen(text) == length && strncmp(part, text, length) == 0;
}

/* Finds a slave by its position as digits, or by its name if only one slave has it. Returns the
 * position. */
static int find_slave(ecat_t *bus, const char *part, size_t length) {
  char *end = NULL;
  long position = strtol(part, &end, 10);
  int i, found = -1;
  if (bus->map == NULL) return ecat_memory_check(bus, 0);
  if (length > 0 && part[0] >= '0' && part[0] <= '9' && end == part + length)
    return ecat_check_position(bus, position > 65535 ? 65535 : (int)position) == 0
               ? (int)position
               : ECAT_EBUS;
  for (i = 0; i < ecat_slave_count(bus); i++) {
    if (!is_text(part, length, bus->slaves[i].name)) continue;
    if (found >= 0)
      return ecat_fail(bus, ECAT_EBUS, "slaves %d and %d of bus '%s' are both called '%.*s': give "
                       "the position instead of the name", found, i, bus->name, (int)length, part);
    found = i;
  }
  if (found >= 0) return found;
  return ecat_fail(bus, ECAT_EBUS, "bus '%s' has no slave '%.*s'; 'ecatctl slaves' lists its slaves",
                   bus->name, (int)length, part);
}

int ecat_find_name(ecat_t *bus, const char *name) {
  return find_slave(bus, name != NULL ? name : "", name != NULL ? strlen(name) : 0);
}

/* Reads up to `most` hexadecimal digits, and 0x in front of them if it is there. Returns what follows, or
 * NULL if there are none; `*marked` says whether there was 0x. */
static const char *read_hexadecimal(const char *text, int most, unsigned *value, int *marked) {
  int n = 0;
  *marked = text[0] == '0' && (text[1] == 'x' || text[1] == 'X');
  if (*marked) text += 2;
  for (*value = 0; n < most && isxdigit((unsigned char)text[n]); n++) {
    int digit = tolower((unsigned char)text[n]);
    *value = 16 * *value + (unsigned)(digit <= '9' ? digit - '0' : digit - 'a' + 10);
  }
  return n > 0 ? text + n : NULL;
}

/* Parses an address: 0x6060:00 or 6060:00, in which both parts are hexadecimal, or 0x6060, whose subindex is
 * 0. The notation is that of the commands (daemon/ecatd/base/addresses.py). */
static int is_address(const char *text, unsigned *index, unsigned *subindex) {
  int marked, any;
  const char *rest = read_hexadecimal(text, 4, index, &marked);
  *subindex = 0;
  if (rest != NULL && rest[0] == ':') rest = read_hexadecimal(rest + 1, 2, subindex, &any);
  else if (!marked) return 0;
  return rest != NULL && rest[0] == '\0';
}

/* Whether `name` is "entry" or "PDO/entry" of this signal. */
static int has_name(const ecat_shm_signal *signal, const char *name) {
  size_t length = strlen(signal->pdo_name);
  if (strcmp(signal->name, name) == 0) return 1;
  return length > 0 && strncmp(name, signal->pdo_name, length) == 0 && name[length] == '/' &&
         strcmp(signal->name, name + length + 1) == 0;
}

int ecat_lookup(ecat_t *bus, const char *name, int direction) {
  const char *slash = name != NULL ? strchr(name, '/') : NULL;
  const ecat_shm_slave *slave;
  unsigned index, subindex;
  int position, found = -1;
  uint32_t i;
  if (slash == NULL)
    return ecat_fail(bus, ECAT_EARG, "'%s' names no entry: write 'slave/entry', as in "
                     "'0/Statusword' or '0/0x6041:00'", name != NULL ? name : "");
  position = find_slave(bus, name, (size_t)(slash - name));
  if (position < 0) return position;
  if (is_address(slash + 1, &index, &subindex))
    return ecat_bind(bus, position, index, subindex, direction);
  slave = &bus->slaves[position];
  for (i = slave->signals_first; i < slave->signals_first + slave->signals_count; i++) {
    const ecat_shm_signal *signal = &bus->signals[i], *other;
    if ((direction != ECAT_ANY && signal->output != direction) || !has_name(signal, slash + 1))
      continue;
    if (found < 0) {
      found = (int)i;
      continue;
    }
    other = &bus->signals[found];
    return ecat_fail(bus, ECAT_ESIGNAL,
                     "slave %d (%s) of bus '%s' has more than one entry '%s': name the PDO, as in "
                     "'%d/%s/%s', or the address, as in '%d/0x%04X:%02X'",
                     position, ecat_shown(slave->name), bus->name, slash + 1, position, other->pdo_name,
                     other->name, position, other->index, other->subindex);
  }
  if (found >= 0) return found;
  return ecat_fail(bus, ECAT_ESIGNAL, "slave %d (%s) of bus '%s' has no %s '%s' in its process data; "
                   "'ecatctl pdos %d' lists its entries", position, ecat_shown(slave->name), bus->name,
                   direction == ECAT_INPUT ? "input" : direction == ECAT_OUTPUT ? "output" : "entry",
                   slash + 1, position);
}
