/* What a model has on the bus: domains, slaves, entries of process data; how they are found there. */
#ifndef ECATM_OBJECTS_H
#define ECATM_OBJECTS_H

#include "ecatm_master.h"

typedef struct ecatm_domain {
  ecatm_node node;
  int id;
} ecatm_domain;

typedef struct ecatm_slave {
  ecatm_node node;
  struct ecatm_slave *next;      /* all slaves of the master */
  struct ecatm_pdo *outputs;     /* entries that this model writes */
  int position;
  uint32_t vendor, product, revision; /* expected; revision 0: any */
  char name[96], command[192];   /* of the slave; command that generates the library again */
  char fingerprint[24];          /* of the bus that the library was generated for */
  int same_bus;                  /* it is that of this bus, too */
  ecatm_group *group;
  int writer;                    /* this model writes its outputs */
  int claimed;                   /* and owns them */
  double time;                   /* of the last commit */
  int alone;                     /* it does not commit whenever its domain is sampled */
  unsigned al_state, al_code;    /* at the last sample: enum ecat_al_state, + 0x10 with an error */
  int domain;                    /* of the bus */
} ecatm_slave;

typedef struct ecatm_pdo {
  ecatm_node node;
  int signal;                    /* handle of the client */
  int pending;                   /* value was written by the model */
  double value;                  /* to be written; or the last one read, raw */
  double scale, offset;          /* physical value = raw value * scale + offset */
  int analog;                    /* it has a physical meaning */
  int index, subindex, output, type, bits;
  ecatm_slave *slave;
  struct ecatm_pdo *next_output;
} ecatm_pdo;

/* --- Domain -------------------------------------------------------------------------------- */

ECATM_FUNCTION void *ecatm_domain_open(void *object, int id) {
  ecatm_master *master = (ecatm_master *)object;
  ecatm_domain *domain;
  if (id < 1 || id > master->domains) {
    ModelicaFormatError("EtherCAT: there is no domain %d: sampleTime of the EtherCATMaster has "
                        "length %d", id, master->domains);
    return NULL;
  }
  domain = (ecatm_domain *)ecatm_new(master, sizeof *domain);
  if (domain != NULL) domain->id = id;
  return domain;
}

ECATM_FUNCTION void ecatm_domain_close(void *object) { ecatm_close(object); }

/* --- Slave --------------------------------------------------------------------------------- */

/* Whether the library was generated for exactly this bus; `fingerprint` has 16 hex digits. */
ECATM_FUNCTION int ecatm_same_bus(const ecat_t *bus, const char *fingerprint) {
  uint64_t found = ecat_fingerprint(bus);
  char text[24];
  sprintf(text, "%08lx%08lx", (unsigned long)(found >> 32), (unsigned long)(found & 0xFFFFFFFFu));
  return strcmp(text, fingerprint) == 0;
}

ECATM_FUNCTION int ecatm_slave_resolve(ecatm_node *node) {
  ecatm_slave *slave = (ecatm_slave *)node;
  ecatm_master *master = node->master;
  ecat_t *bus = master->bus;
  ecat_slave_info found;
  if (slave->position < 0 || slave->position >= ecat_slave_count(bus))
    return ecatm_fail(master, ECAT_EBUS, "bus '%s' has no slave %d (it has %d slaves), but this library "
                      "was generated for %s there; regenerate it with: %s",
                      master->name, slave->position, ecat_slave_count(bus), slave->name,
                      slave->command);
  if (ecat_slave(bus, slave->position, &found) < 0)
    return ecatm_fail(master, ECAT_EBUS, "%s", ecat_error(bus));
  if (found.vendor != slave->vendor || found.product != slave->product ||
      (slave->revision != 0 && found.revision != slave->revision))
    return ecatm_fail(master, ECAT_EBUS, "slave %d of bus '%s' is %s (vendor 0x%08X, product 0x%08X, "
                      "revision 0x%08X), but this library was generated for %s (vendor 0x%08X, "
                      "product 0x%08X, revision 0x%08X); regenerate it with: %s",
                      slave->position, master->name, found.name, (unsigned)found.vendor,
                      (unsigned)found.product, (unsigned)found.revision, slave->name,
                      (unsigned)slave->vendor, (unsigned)slave->product, (unsigned)slave->revision,
                      slave->command);
  slave->same_bus = ecatm_same_bus(bus, slave->fingerprint);
  slave->claimed = 0;
  slave->domain = found.domain;
  return 0;
}

/* The registration of one slave. Stops with one sentence when another slave is found there, now or when
 * the bus appears. Identity numbers are 32 unsigned bits in a Modelica Integer; revision 0 accepts any. */
ECATM_FUNCTION void *ecatm_slave_open(void *object, int position, int vendor, int product,
                                      int revision, const char *name, const char *fingerprint,
                                      const char *command) {
  const ecatm_domain *domain = (const ecatm_domain *)object;
  ecatm_master *master = domain->node.master;
  ecatm_slave draft, *slave;
  memset(&draft, 0, sizeof draft);
  draft.node.resolve = ecatm_slave_resolve;
  draft.group = &master->groups[domain->id - 1];
  draft.position = position;
  draft.vendor = (uint32_t)vendor;
  draft.product = (uint32_t)product;
  draft.revision = (uint32_t)revision;
  sprintf(draft.name, "%.*s", (int)sizeof draft.name - 1, name);
  sprintf(draft.fingerprint, "%.*s", (int)sizeof draft.fingerprint - 1, fingerprint);
  sprintf(draft.command, "%.*s", (int)sizeof draft.command - 1, command);
  slave = (ecatm_slave *)ecatm_register(master, &draft.node, sizeof draft);
  if (slave == NULL) return NULL;
  slave->next = master->slaves;
  master->slaves = slave;
  return slave;
}

ECATM_FUNCTION void ecatm_slave_close(void *object) { ecatm_close(object); }

/* --- PDO entries --------------------------------------------------------------------------- */

ECATM_FUNCTION int ecatm_pdo_resolve(ecatm_node *node) {
  ecatm_pdo *pdo = (ecatm_pdo *)node;
  const ecatm_slave *slave = pdo->slave;
  ecatm_master *master = node->master;
  ecat_t *bus = master->bus;
  ecat_signal_info found;
  pdo->signal = ecat_bind(bus, slave->position, (unsigned)pdo->index, (unsigned)pdo->subindex,
                          pdo->output ? ECAT_OUTPUT : ECAT_INPUT);
  if (pdo->signal < 0 || ecat_signal(bus, pdo->signal, &found) < 0)
    return ecatm_fail(master, ECAT_EBUS, "%s, but this library uses it; regenerate it with: %s",
                      ecat_error(bus), slave->command);
  if (!slave->same_bus &&
      (found.type != (unsigned)pdo->type || found.bit_length != (unsigned)pdo->bits))
    return ecatm_fail(master, ECAT_EBUS, "entry 0x%04X:%02X of slave %d of bus '%s' has %u bits and "
                      "data type 0x%04X, but this library was generated for %d bits and data type "
                      "0x%04X; regenerate it with: %s",
                      (unsigned)pdo->index, (unsigned)pdo->subindex, slave->position, master->name,
                      found.bit_length, found.type, pdo->bits, (unsigned)pdo->type, slave->command);
  return 0;
}

ECATM_FUNCTION int ecatm_finite(double value) { return value - value == 0; }

/* Whether physical values can be computed with these numbers. */
ECATM_FUNCTION int ecatm_is_scale(double scale, double offset) {
  return scale != 0 && ecatm_finite(scale) && ecatm_finite(offset);
}

/* An entry in the process data of a slave. `type` (CoE data type) and `bits` are those of the bus
 * that the library was generated for; a physical value in `unit` is raw value * scale + offset. */
ECATM_FUNCTION void *ecatm_pdo_open(void *object, int index, int subindex, int output, int type,
                                    int bits, double scale, double offset, const char *unit) {
  ecatm_slave *slave = (ecatm_slave *)object;
  ecatm_pdo draft, *pdo;
  memset(&draft, 0, sizeof draft);
  draft.node.resolve = ecatm_pdo_resolve;
  draft.slave = slave;
  draft.index = index;
  draft.subindex = subindex;
  draft.output = output;
  draft.type = type;
  draft.bits = bits;
  draft.signal = -1;
  draft.scale = scale;
  draft.offset = offset;
  draft.analog = scale != 1 || offset != 0 || unit[0] != '\0';
  if (!ecatm_is_scale(scale, offset)) {
    ModelicaFormatError("EtherCAT: entry 0x%04X:%02X of slave %d cannot be scaled by %g with an offset "
                        "of %g: the scale must be a finite number other than 0",
                        (unsigned)index, (unsigned)subindex, slave->position, scale, offset);
    return NULL;
  }
  pdo = (ecatm_pdo *)ecatm_register(slave->node.master, &draft.node, sizeof draft);
  if (pdo == NULL || !output) return pdo;
  pdo->next_output = slave->outputs;
  slave->outputs = pdo;
  return pdo;
}

ECATM_FUNCTION void ecatm_pdo_close(void *object) { ecatm_close(object); }

#endif
