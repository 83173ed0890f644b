/* What the plant asks of the bus: attaching to the right one, writing, waiting, sampling. */
#include "plant.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define PATIENCE 1.0 /* seconds beside some cycles, after which a cycle that does not come has failed */

static int failed(plant *p, int code) { return plant_note(p, code, "%s", ecat_error(p->bus)); }

/* --- attaching ----------------------------------------------------------------------------- */

static int check_slave(plant *p, plant_slave *slave) {
  ecat_slave_info found;
  slave->claimed = 0;
  if (slave->position >= ecat_slave_count(p->bus))
    return plant_note(p, ECAT_EBUS, "bus '%s' has no slave %d (it has %d slaves), but this FMU was "
                      "generated for %s there; regenerate it with: %s", ecat_name(p->bus),
                      slave->position, ecat_slave_count(p->bus), slave->label, p->command);
  if (ecat_slave(p->bus, slave->position, &found) != 0) return failed(p, ECAT_EBUS);
  if (found.vendor == slave->vendor && found.product == slave->product &&
      found.revision == slave->revision)
    return 0;
  return plant_note(p, ECAT_EBUS, "slave %d of bus '%s' is %s (vendor 0x%08X, product 0x%08X, revision "
                    "0x%08X), but this FMU was generated for %s (vendor 0x%08X, product 0x%08X, "
                    "revision 0x%08X); regenerate it with: %s", slave->position, ecat_name(p->bus),
                    found.name, (unsigned)found.vendor, (unsigned)found.product,
                    (unsigned)found.revision, slave->label, (unsigned)slave->vendor,
                    (unsigned)slave->product, (unsigned)slave->revision, p->command);
}

static int bind_entry(plant *p, plant_variable *v, int same_bus) {
  ecat_signal_info found;
  const plant_slave *slave = &p->slaves[v->slave];
  v->handle = ecat_bind(p->bus, slave->position, v->entry.index, v->entry.subindex,
                        v->role == ROLE_INPUT ? ECAT_OUTPUT : ECAT_INPUT);
  if (v->handle < 0)
    return plant_note(p, ECAT_EBUS, "%s, but this FMU uses it; regenerate it with: %s",
                      ecat_error(p->bus), p->command);
  if (ecat_signal(p->bus, v->handle, &found) != 0) return failed(p, ECAT_EBUS);
  if (same_bus || (found.type == v->entry.type && found.bit_length == v->entry.bit_length)) return 0;
  return plant_note(p, ECAT_EBUS, "entry 0x%04X:%02X of slave %d of bus '%s' has %u bits and data type "
                    "0x%04X, but this FMU was generated for %u bits and data type 0x%04X; regenerate "
                    "it with: %s", v->entry.index, v->entry.subindex, slave->position, ecat_name(p->bus),
                    found.bit_length, found.type, v->entry.bit_length, v->entry.type, p->command);
}

/* Whether this is the bus that the FMU was made for. Other slaves and entries may be there, too. */
static int check_bus(plant *p) {
  char fingerprint[20];
  size_t i;
  int code = 0;
  snprintf(fingerprint, sizeof fingerprint, "%016" PRIx64, ecat_fingerprint(p->bus));
  for (i = 0; i < p->slave_count && code == 0; i++) code = check_slave(p, &p->slaves[i]);
  for (i = 0; i < p->variable_count && code == 0; i++)
    if (p->variables[i].role >= ROLE_INPUT)
      code = bind_entry(p, &p->variables[i], strcmp(fingerprint, p->fingerprint) == 0);
  return code;
}

int bus_attach(plant *p) {
  int code = ecat_open(&p->bus, p->bus_name);
  code = code != 0 ? failed(p, code) : check_bus(p);
  if (code != 0) {
    bus_detach(p);
    return code;
  }
  p->in_step = 0;
  return 0;
}

void bus_detach(plant *p) {
  size_t i;
  ecat_close(p->bus); /* the outputs fall to their safe values */
  p->bus = NULL;
  p->connected = 0;
  for (i = 0; i < p->slave_count; i++) p->slaves[i].claimed = 0;
}

/* --- writing ------------------------------------------------------------------------------- */

/* Claims all outputs of the slaves of which an input was set, at once or not at all. Slaves that
 * nobody writes to stay free for others. */
static int claim(plant *p) {
  size_t i, wanted = 0;
  int code = 0, signal, count = 0, *list;
  for (i = 0; i < p->slave_count; i++) wanted += p->slaves[i].wanted && !p->slaves[i].claimed;
  if (wanted == 0) return 0;
  list = malloc(((size_t)ecat_signal_count(p->bus) + 1) * sizeof *list);
  if (list == NULL) return plant_note(p, ECAT_ESYS, "out of memory");
  for (signal = 0; signal < ecat_signal_count(p->bus); signal++) {
    ecat_signal_info info;
    if (ecat_signal(p->bus, signal, &info) != 0 || !info.output) continue;
    for (i = 0; i < p->slave_count; i++)
      if (p->slaves[i].wanted && !p->slaves[i].claimed && p->slaves[i].position == info.slave)
        list[count++] = signal;
  }
  code = ecat_claim_entries(p->bus, list, (size_t)count, plant_real(p, ROLE_LEASE));
  free(list);
  if (code < 0) return failed(p, code);
  for (i = 0; i < p->slave_count; i++) p->slaves[i].claimed |= p->slaves[i].wanted;
  return 0;
}

static int write_variable(plant *p, const plant_variable *v) {
  if (v->type != PLANT_REAL) return ecat_write_int(p->bus, v->handle, v->value.integer);
  if (!v->analog) return ecat_write(p->bus, v->handle, v->value.real);
  return ecat_write_scaled(p->bus, v->handle, v->value.real, v->entry.scale, v->entry.offset);
}

int bus_write(plant *p) {
  size_t i;
  int code;
  if (plant_integer(p, ROLE_READ_ONLY)) return 0;
  if ((code = claim(p)) != 0) return code;
  for (i = 0; i < p->variable_count && code == 0; i++)
    if (p->variables[i].set) code = write_variable(p, &p->variables[i]);
  if (code == 0) code = ecat_commit(p->bus);
  if (code == ECAT_ELEASE)
    for (i = 0; i < p->slave_count; i++) p->slaves[i].claimed = 0;
  return code != 0 ? failed(p, code) : 0;
}

/* --- waiting and sampling ------------------------------------------------------------------ */

int bus_wait(plant *p, uint64_t cycles) {
  uint64_t goal, now = ecat_cycle(p->bus);
  double timeout = PATIENCE + 10 * ecat_cycle_time(p->bus);
  int code;
  if (cycles == 0) return 0;
  if (ecat_instance(p->bus) != p->instance) p->in_step = 0; /* it counts anew */
  goal = (p->in_step ? p->last_cycle : now) + cycles;
  p->missed += now > goal;
  p->instance = ecat_instance(p->bus);
  while (now < goal && ecat_instance(p->bus) == p->instance) {
    if ((code = ecat_wait(p->bus, 1, timeout)) != 0) return failed(p, code);
    now = ecat_cycle(p->bus);
    /* Keeps the lease: who waits is alive, however long the step is. */
    if (now < goal && (code = ecat_sample(p->bus)) != 0) return failed(p, code);
  }
  p->last_cycle = now;
  p->in_step = 1;
  return 0;
}

static void publish_age(plant *p) {
  uint64_t now = plant_now();
  if (p->exchanged_ns == 0) return;
  plant_publish(p, ROLE_AGE, now > p->exchanged_ns ? (double)(now - p->exchanged_ns) * 1e-9 : 0, 0);
}

/* Fills in what is known about the exchange: cycle and age are those of the newest domain. */
static int publish_domains(plant *p) {
  ecat_domain_info info;
  uint64_t newest = 0;
  unsigned found = 0, expected = 0;
  int i, code, all = 1;
  p->complete = 0;
  for (i = 0; i < ecat_domain_count(p->bus); i++) {
    if ((code = ecat_domain(p->bus, i, &info)) != 0) return failed(p, code);
    if (info.cycle >= newest) newest = info.cycle, p->exchanged_ns = info.time_ns;
    found += info.wkc;
    expected += info.wkc_expected;
    if (info.wkc_state == ECAT_WKC_COMPLETE)
      p->complete |= (uint64_t)1 << i;
    else
      all = 0;
  }
  plant_publish(p, ROLE_CYCLE, 0, (int64_t)(newest & 0x7FFFFFFF));
  publish_age(p);
  plant_publish(p, ROLE_WORKING_COUNTER, 0, found);
  plant_publish(p, ROLE_WORKING_COUNTER_EXPECTED, 0, expected);
  plant_publish(p, ROLE_STATE, 0, all ? BUS_OPERATIONAL : BUS_INCOMPLETE);
  plant_publish(p, ROLE_CONNECTED, 0, 1);
  plant_publish(p, ROLE_MISSED, 0, (int64_t)(p->missed & 0x7FFFFFFF));
  return 0;
}

/* The AL status register: state in the lower bits, 0x10 tells an error. */
static int al_state(unsigned status) {
  switch (status & 0x0F) {
    case ECAT_AL_INIT: return AL_INIT;
    case ECAT_AL_PREOP: return AL_PREOP;
    case ECAT_AL_BOOT: return AL_BOOTSTRAP;
    case ECAT_AL_SAFEOP: return AL_SAFEOP;
    case ECAT_AL_OP: return AL_OP;
    default: return AL_NOT_AVAILABLE;
  }
}

static int publish_slave(plant *p, plant_variable *v) {
  ecat_slave_info info;
  int code = ecat_slave(p->bus, p->slaves[v->slave].position, &info);
  if (code != 0) return failed(p, code);
  if (v->role == ROLE_AL_STATE)
    v->value.integer = al_state(info.al_state);
  else if (v->role == ROLE_AL_STATUS_CODE)
    v->value.integer = info.al_code;
  else
    v->value.integer = info.al_state == ECAT_AL_OP && (p->complete >> info.domain & 1) != 0;
  if (info.al_state != ECAT_AL_OP && plant_integer(p, ROLE_STATE) == BUS_OPERATIONAL)
    plant_publish(p, ROLE_STATE, 0, BUS_NOT_OPERATIONAL);
  return 0;
}

static int read_entry(plant *p, plant_variable *v) {
  int code = v->type == PLANT_REAL ? ecat_read(p->bus, v->handle, &v->value.real)
                                   : ecat_read_int(p->bus, v->handle, &v->value.integer);
  v->value.real = v->value.real * v->entry.scale + v->entry.offset;
  if (v->type == PLANT_BOOLEAN) v->value.integer = v->value.integer != 0;
  return code != 0 ? failed(p, code) : 0;
}

int bus_sample(plant *p) {
  size_t i;
  int code = ecat_sample(p->bus);
  if (code != 0) return failed(p, code);
  code = publish_domains(p);
  for (i = 0; i < p->variable_count && code == 0; i++) {
    plant_variable *v = &p->variables[i];
    if (v->role >= ROLE_VALID && v->role <= ROLE_AL_STATUS_CODE)
      code = publish_slave(p, v);
    else if (v->role == ROLE_OUTPUT)
      code = read_entry(p, v);
  }
  return code;
}

/* Entries keep their last values, or their start values; all else tells that nothing is delivered. */
void bus_invalidate(plant *p, int code) {
  size_t i;
  plant_publish(p, ROLE_CONNECTED, 0, 0);
  plant_publish(p, ROLE_STATE, 0, code == ECAT_ESTALE || code == ECAT_ETIMEOUT ? BUS_STANDS_STILL
                                                                              : BUS_MISSING);
  plant_publish(p, ROLE_WORKING_COUNTER, 0, 0);
  publish_age(p);
  for (i = 0; i < p->variable_count; i++) {
    plant_variable *v = &p->variables[i];
    if (v->role == ROLE_VALID) v->value.integer = 0;
    if (v->role == ROLE_AL_STATE) v->value.integer = AL_NOT_AVAILABLE;
  }
}
