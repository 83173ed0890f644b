/* The objects for the parts of a bus: domains, slaves, entries of process data. */
#ifndef ECATM_OBJECTS_H
#define ECATM_OBJECTS_H

#include "ecatm_master.h"

typedef struct ecatm_domain {
  ecatm_node node;
  int id;
} ecatm_domain;

typedef struct ecatm_slave {
  ecatm_node node;
  ecat_session_slave on_bus;
  char given_name[32], name[96], command[192], fingerprint[24]; /* texts of `on_bus` */
  ecatm_group *group;
  double time;                   /* of the last commit */
  int alone;                     /* 1: it does not commit in every sample of its domain */
} ecatm_slave;

typedef struct ecatm_pdo {
  ecatm_node node;
  ecat_session_entry on_bus;
  char unit[16];                 /* text of `on_bus` */
} ecatm_pdo;

/* --- Domain -------------------------------------------------------------------------------- */

ECATM_FUNCTION void *ecatm_domain_open(void *object, int id, const char *block) {
  ecatm_master *master = (ecatm_master *)object;
  ecatm_domain *domain;
  char heading[ECATM_HEADING];
  if (id < 1 || id > master->domains) {
    ecatm_head(heading, block);
    ModelicaFormatError("EtherCAT: %sthere is no domain %d: sampleTime of the EtherCATMaster has "
                        "length %d; change domainID of the block, or add a sample time", heading, id,
                        master->domains);
    return NULL;
  }
  domain = (ecatm_domain *)ecatm_new(master, sizeof *domain);
  if (domain != NULL) domain->id = id;
  return domain;
}

ECATM_FUNCTION void ecatm_domain_close(void *object) { ecatm_close(object); }

/* --- Slave --------------------------------------------------------------------------------- */

/* Registers one slave. Ends the simulation with a message if the bus has another slave, now or when the
 * bus appears. Identity numbers are 32 unsigned bits in a Modelica Integer; revision 0 accepts any.
 * `given_name`: name in the configuration, to find the slave at any position; empty: by position.
 * `fingerprint`: empty if the block was written by hand. `block`: name of the block's instance. */
ECATM_FUNCTION void *ecatm_slave_open(void *object, int position, const char *given_name, int vendor,
                                      int product, int revision, const char *name,
                                      const char *fingerprint, const char *command,
                                      const char *block) {
  const ecatm_domain *domain = (const ecatm_domain *)object;
  ecatm_master *master = domain->node.master;
  ecatm_slave *slave = (ecatm_slave *)ecatm_draft(master, sizeof *slave);
  if (slave == NULL) return NULL;
  sprintf(slave->given_name, "%.*s", (int)sizeof slave->given_name - 1, given_name);
  sprintf(slave->name, "%.*s", (int)sizeof slave->name - 1, name);
  sprintf(slave->fingerprint, "%.*s", (int)sizeof slave->fingerprint - 1, fingerprint);
  sprintf(slave->command, "%.*s", (int)sizeof slave->command - 1, command);
  ecatm_head(slave->node.heading, block);
  slave->group = &master->groups[domain->id - 1];
  slave->on_bus.position = position;
  slave->on_bus.vendor = (uint32_t)vendor;
  slave->on_bus.product = (uint32_t)product;
  slave->on_bus.revision = (uint32_t)revision;
  slave->on_bus.given_name = slave->given_name;
  slave->on_bus.name = slave->name;
  slave->on_bus.fingerprint = slave->fingerprint;
  slave->on_bus.command = slave->command;
  slave->on_bus.heading = slave->node.heading;
  return ecatm_keep(slave, ecat_session_add_slave(&master->session, &slave->on_bus));
}

ECATM_FUNCTION void ecatm_slave_close(void *object) { ecatm_close(object); }

/* --- PDO entries --------------------------------------------------------------------------- */

ECATM_FUNCTION int ecatm_finite(double value) { return value - value == 0; }

/* Whether physical values can be computed with these numbers. */
ECATM_FUNCTION int ecatm_is_scale(double scale, double offset) {
  return scale != 0 && ecatm_finite(scale) && ecatm_finite(offset);
}

/* Registers an entry in the process data of a slave. `type` (CoE data type) and `bits` are those of the
 * bus that the library was generated for. A physical value in `unit` is raw value * scale + offset. */
ECATM_FUNCTION void *ecatm_pdo_open(void *object, int index, int subindex, int output, int type,
                                    int bits, double scale, double offset, const char *unit) {
  ecatm_slave *slave = (ecatm_slave *)object;
  ecatm_pdo *pdo;
  ecat_signal_info *expected;
  if (!ecatm_is_scale(scale, offset)) {
    ModelicaFormatError("EtherCAT: %sentry 0x%04X:%02X of slave %d cannot be scaled by %g with an offset "
                        "of %g: the scale must be a finite number other than 0", slave->node.heading,
                        (unsigned)index, (unsigned)subindex, slave->on_bus.position, scale, offset);
    return NULL;
  }
  pdo = (ecatm_pdo *)ecatm_draft(slave->node.master, sizeof *pdo);
  if (pdo == NULL) return NULL;
  sprintf(pdo->unit, "%.*s", (int)sizeof pdo->unit - 1, unit);
  pdo->on_bus.slave = &slave->on_bus;
  expected = &pdo->on_bus.expected;
  expected->slave = slave->on_bus.position;
  expected->index = (unsigned)index;
  expected->subindex = (unsigned)subindex;
  expected->output = output;
  expected->type = (unsigned)type;
  expected->bit_length = (unsigned)bits;
  expected->unit = pdo->unit;
  expected->scale = scale;
  expected->offset = offset;
  return ecatm_keep(pdo, ecat_session_add_entry(&pdo->on_bus));
}

ECATM_FUNCTION void ecatm_pdo_close(void *object) { ecatm_close(object); }

#endif
