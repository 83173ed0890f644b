/* Opening and closing a connection, error texts, and questions about the bus. */
#include "internal.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

int ecat_fail(ecat_t *bus, int code, const char *format, ...) {
  va_list arguments;
  va_start(arguments, format);
  vsnprintf(bus->error, sizeof bus->error, format, arguments);
  va_end(arguments);
  return code;
}

uint64_t ecat_now(void) {
  struct timespec now;
  clock_gettime(CLOCK_MONOTONIC, &now);
  return (uint64_t)now.tv_sec * NS_PER_S + (uint64_t)now.tv_nsec;
}

uint64_t ecat_ns(double seconds) {
  if (!(seconds > 0)) return 0;
  return seconds > 1e9 ? (uint64_t)1e18 : (uint64_t)(seconds * 1e9);
}

int ecat_open(ecat_t **result, const char *name) {
  /* A handle that is not connected has an empty bus, so that every call fails with an error text. */
  static const ecat_shm_header nothing;
  ecat_t *bus = calloc(1, sizeof *bus);
  int code;
  *result = bus;
  if (bus == NULL) return ECAT_ESYS;
  bus->fd = bus->out_fd = bus->slot = -1;
  bus->header = &nothing;
  if (name == NULL) name = "ecat0";
  if (name[0] == '\0' || strlen(name) >= sizeof bus->name || strchr(name, '/') != NULL)
    return ecat_fail(bus, ECAT_EARG, "'%s' is no bus name: 1 to %zu characters without '/'", name,
                     sizeof bus->name - 1);
  strcpy(bus->name, name);
  code = ecat_memory_open(bus);
  if (code != 0) {
    ecat_memory_close(bus);
    bus->header = &nothing;
  }
  return code;
}

void ecat_close(ecat_t *bus) {
  if (bus == NULL) return;
  ecat_slot_free(bus);
  ecat_memory_close(bus);
  ecat_images_free(bus);
  free(bus);
}

const char *ecat_error(const ecat_t *bus) {
  if (bus == NULL) return "out of memory";
  return bus->error[0] != '\0' ? bus->error : "no error";
}

const char *ecat_strerror(int code) {
  if (code >= 0) return "no error"; /* a handle, or a value of another enumeration */
#define ECAT_VALUE(name, value, comment) \
  if (code == (value)) return comment;
#include <ecat/ecat.def>
  return "unknown error";
}

const char *ecat_name(const ecat_t *bus) { return bus->name; }
int ecat_slave_count(const ecat_t *bus) { return (int)bus->header->slave_count; }
int ecat_signal_count(const ecat_t *bus) { return (int)bus->header->signal_count; }
int ecat_domain_count(const ecat_t *bus) { return (int)bus->header->domain_count; }
uint64_t ecat_fingerprint(const ecat_t *bus) { return bus->header->fingerprint; }
uint64_t ecat_instance(const ecat_t *bus) { return bus->header->instance; }
double ecat_cycle_time(const ecat_t *bus) { return (double)bus->header->cycle_time_ns * 1e-9; }

uint64_t ecat_cycle(const ecat_t *bus) {
  return __atomic_load_n(&bus->header->cycle, __ATOMIC_ACQUIRE);
}

int ecat_check_position(ecat_t *bus, int position) {
  if (position >= 0 && position < ecat_slave_count(bus)) return 0;
  if (bus->map == NULL) return ecat_memory_check(bus, 0);
  return ecat_fail(bus, ECAT_EBUS, "bus '%s' has no slave %d: it has %d slaves, 0 to %d", bus->name,
                   position, ecat_slave_count(bus), ecat_slave_count(bus) - 1);
}

int ecat_no_signal(ecat_t *bus, int number) {
  if (bus->map == NULL) return ecat_memory_check(bus, 0);
  return ecat_fail(bus, ECAT_EARG, "%d is no signal: bus '%s' has %d", number, bus->name,
                   ecat_signal_count(bus));
}

int ecat_check_domain(ecat_t *bus, int number) {
  if (number >= 0 && number < ecat_domain_count(bus)) return 0;
  if (bus->map == NULL) return ecat_memory_check(bus, 0);
  return ecat_fail(bus, ECAT_EARG, "bus '%s' has no domain %d: it has %d", bus->name, number,
                   ecat_domain_count(bus));
}

/* Sets the state of the outputs of a slave as a whole: ACTIVE if one of them is ACTIVE, else the state
 * of the first output that is not SAFE, else SAFE. */
static void describe_outputs(const ecat_t *bus, const ecat_shm_slave *slave, ecat_slave_info *info) {
  uint32_t i;
  info->outputs = ECAT_OUTPUTS_SAFE;
  info->owned = 0;
  if (slave->output_bytes == 0) return;
  for (i = slave->signals_first; i < slave->signals_first + slave->signals_count; i++) {
    int state;
    if (!bus->signal[i].output) continue;
    state = (int)__atomic_load_n(&bus->outputs[i].state, __ATOMIC_RELAXED);
    if (state == ECAT_OUTPUTS_ACTIVE || info->outputs == ECAT_OUTPUTS_SAFE) info->outputs = state;
    info->owned |= set_has(bus->claims, i);
  }
  if (info->owned && ecat_slot_lapsed(bus)) info->owned = 0;
}

int ecat_slave(ecat_t *bus, int position, ecat_slave_info *info) {
  const ecat_shm_slave *slave;
  const ecat_shm_slave_status *status;
  int code = ecat_check_position(bus, position);
  if (code != 0) return code;
  slave = &bus->slaves[position];
  status = &bus->slave_status[position];
  info->vendor = slave->vendor;
  info->product = slave->product;
  info->revision = slave->revision;
  info->serial = slave->serial;
  info->name = slave->name;
  info->al_state = __atomic_load_n(&status->al_state, __ATOMIC_RELAXED);
  info->al_code = __atomic_load_n(&status->al_code, __ATOMIC_RELAXED);
  info->domain = slave->domain;
  info->optional = slave->group >= 0;
  info->absent = info->optional && (bus->snapshot[slave->domain].absent >> slave->group & 1) != 0;
  info->has_outputs = slave->output_bytes > 0;
  describe_outputs(bus, slave, info);
  return 0;
}

int ecat_signal(ecat_t *bus, int number, ecat_signal_info *info) {
  const ecat_shm_signal *signal;
  int code = ecat_check_signal(bus, number);
  if (code != 0) return code;
  signal = &bus->signals[number];
  info->slave = signal->slave;
  info->index = signal->index;
  info->subindex = signal->subindex;
  info->output = signal->output;
  info->type = signal->type;
  info->bit_length = signal->bit_length;
  info->domain = signal->domain;
  info->bit_offset = signal->bit_offset;
  info->scale = signal->scale;
  info->offset = signal->offset;
  info->minimum = signal->minimum;
  info->maximum = signal->maximum;
  info->pdo = signal->pdo;
  info->pdo_name = signal->pdo_name;
  info->name = signal->name;
  info->unit = signal->unit;
  return 0;
}

int ecat_find(ecat_t *bus, uint32_t vendor, uint32_t product, unsigned nth) {
  unsigned seen = 0;
  int i;
  if (bus->map == NULL) return ecat_memory_check(bus, 0);
  for (i = 0; i < ecat_slave_count(bus); i++)
    if (bus->slaves[i].vendor == vendor && bus->slaves[i].product == product && seen++ == nth)
      return i;
  return ecat_fail(bus, ECAT_EBUS,
                   "bus '%s' has %u slaves with vendor 0x%08X, product 0x%08X; number %u was asked "
                   "for, 0 is the first",
                   bus->name, seen, (unsigned)vendor, (unsigned)product, nth);
}

int ecat_expect(ecat_t *bus, int position, uint32_t vendor, uint32_t product, uint32_t revision) {
  const ecat_shm_slave *slave;
  int code = ecat_check_position(bus, position);
  if (code != 0) return code;
  slave = &bus->slaves[position];
  if (slave->vendor != vendor || slave->product != product)
    return ecat_fail(bus, ECAT_EBUS,
                     "slave %d of bus '%s' is %s (vendor 0x%08X, product 0x%08X), but expected is "
                     "vendor 0x%08X, product 0x%08X",
                     position, bus->name, slave->name, (unsigned)slave->vendor,
                     (unsigned)slave->product, (unsigned)vendor, (unsigned)product);
  if (revision != 0 && slave->revision != revision)
    return ecat_fail(bus, ECAT_EBUS,
                     "slave %d of bus '%s' (%s) has revision 0x%08X, but expected is 0x%08X",
                     position, bus->name, ecat_shown(slave->name), (unsigned)slave->revision,
                     (unsigned)revision);
  return position;
}

int ecat_bind(ecat_t *bus, int position, unsigned index, unsigned subindex, int direction) {
  const ecat_shm_slave *slave;
  uint32_t i;
  int code = ecat_check_position(bus, position);
  if (code != 0) return code;
  slave = &bus->slaves[position];
  for (i = slave->signals_first; i < slave->signals_first + slave->signals_count; i++) {
    const ecat_shm_signal *signal = &bus->signals[i];
    if (signal->index == index && signal->subindex == subindex &&
        (direction == ECAT_ANY || signal->output == direction))
      return (int)i;
  }
  return ecat_fail(bus, ECAT_ESIGNAL, "slave %d (%s) of bus '%s' has no %s 0x%04X:%02X in its process data",
                   position, ecat_shown(slave->name), bus->name,
                   direction == ECAT_INPUT ? "input" : direction == ECAT_OUTPUT ? "output" : "entry",
                   index, subindex);
}
