/* The objects of a model: master, domains, slaves, entries of process data; how they begin and end. */
#ifndef ECATM_OBJECTS_H
#define ECATM_OBJECTS_H

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "ModelicaUtilities.h"
#include "ecatm_system.h"
#include <ecat/ecat.h>

#define ECATM_TEXT 640           /* longest sentence, with its end */
#define ECATM_PATIENCE 1.0       /* seconds without a bus cycle until waiting fails */
#define ECATM_SAME_TIME 1e-9     /* seconds; periodic events drift by rounding */

typedef struct ecatm_node {
  struct ecatm_node *next;       /* all objects of a master, to free them together */
  struct ecatm_master *master;
  int closed;                    /* a tool that merges equal constructors destroys an object twice */
} ecatm_node;

typedef struct ecatm_master {
  ecat_t *bus;                   /* NULL after the end */
  ecatm_node *objects;
  struct ecatm_slave *writers;   /* slaves whose outputs this model owns */
  int users;                     /* this object and all of `objects` that still live */
  int domains;                   /* sample times of the model */
  double lease;
  unsigned stride;               /* bus cycles from wait to wait, 0: do not wait */
  uint64_t waited_cycle;         /* bus cycle at the last wait */
  double wait_time, sample_time; /* simulation time of the last wait, of the last sample */
  int waited, sampled;           /* whether there was one */
  unsigned complete;             /* bit n: all slaves of domain n of the bus took part in the sample */
  int cycle;                     /* of the last sample, modulo 2^31 */
} ecatm_master;

typedef struct ecatm_domain {
  ecatm_node node;
  int id;
} ecatm_domain;

typedef struct ecatm_slave {
  ecatm_node node;
  int position;
  int same_bus;                  /* fingerprint of the library and of the bus are equal */
  int claimed;
  struct ecatm_slave *next_writer;
  struct ecatm_pdo *outputs;     /* entries that this model writes */
  char command[160];             /* command that generates the library again */
} ecatm_slave;

typedef struct ecatm_pdo {
  ecatm_node node;
  ecatm_slave *slave;
  struct ecatm_pdo *next_output;
  int signal;                    /* handle of the client */
  int integer;                   /* the entry holds a whole number */
  double scale, offset;          /* physical value = raw value * scale + offset */
  double low, high;              /* raw values that the entry may have */
  int pending;                   /* value was written by the model */
  double value;                  /* raw */
} ecatm_pdo;

/* --- Objects ------------------------------------------------------------------------------- */

/* An object in the master's memory. Call it last in a constructor: it cannot be taken back. */
ECATM_FUNCTION void *ecatm_new(ecatm_master *master, size_t size) {
  ecatm_node *node = (ecatm_node *)calloc(1, size);
  if (node == NULL) {
    ModelicaError("EtherCAT: out of memory");
    return NULL;
  }
  node->master = master;
  node->next = master->objects;
  master->objects = node;
  master->users++;
  return node;
}

/* The end of one object; the last one frees all. */
ECATM_FUNCTION void ecatm_drop(ecatm_master *master) {
  ecatm_node *node;
  if (--master->users > 0) return;
  while ((node = master->objects) != NULL) {
    master->objects = node->next;
    free(node);
  }
  free(master);
}

ECATM_FUNCTION void ecatm_close(void *object) {
  ecatm_node *node = (ecatm_node *)object;
  if (node == NULL || node->closed) return;
  node->closed = 1;
  ecatm_drop(node->master);
}

/* Stops the simulation with the sentence of the client if `code` is an error. */
ECATM_FUNCTION void ecatm_check(const ecatm_master *master, int code) {
  if (code < 0) ModelicaFormatError("EtherCAT: %s", ecat_error(master->bus));
}

/* --- Master -------------------------------------------------------------------------------- */

/* Bus cycles in a sample time, 0 if it is no whole number of them. */
ECATM_FUNCTION unsigned ecatm_stride(double sample_time, double cycle_time) {
  double cycles = floor(sample_time / cycle_time + 0.5);
  if (cycles < 1 || cycles > 1e9) return 0;
  return fabs(cycles * cycle_time - sample_time) <= 1e-6 * sample_time ? (unsigned)cycles : 0;
}

/* Connects to a bus. `sample_time` is that of domain 1, `domains` how many the model has. */
ECATM_FUNCTION void *ecatm_master_open(const char *name, int wait_for_bus, double sample_time,
                                       int domains, double lease) {
  ecat_t *bus = NULL;
  ecatm_master *master;
  unsigned stride = 0;
  char text[ECATM_TEXT];
  if (ecat_open(&bus, name) != 0) {
    sprintf(text, "%.*s", ECATM_TEXT - 1, ecat_error(bus));
    ecat_close(bus);
    ModelicaFormatError("EtherCAT: %s", text);
    return NULL;
  }
  if (wait_for_bus) {
    double cycle_time = ecat_cycle_time(bus);
    stride = ecatm_stride(sample_time, cycle_time);
    if (stride == 0) {
      ecat_close(bus);
      ModelicaFormatError("EtherCAT: the model is to wait for bus '%s', but its sample time of %g s "
                          "is no multiple of the bus cycle of %g s; change sampleTime[1] of the "
                          "EtherCATMaster", name, sample_time, cycle_time);
      return NULL;
    }
  }
  master = (ecatm_master *)calloc(1, sizeof *master);
  if (master == NULL) {
    ecat_close(bus);
    ModelicaError("EtherCAT: out of memory");
    return NULL;
  }
  master->bus = bus;
  master->users = 1;
  master->domains = domains;
  master->lease = lease;
  master->stride = stride;
  return master;
}

/* Ends the connection: the outputs fall to their safe values. */
ECATM_FUNCTION void ecatm_master_close(void *object) {
  ecatm_master *master = (ecatm_master *)object;
  if (master == NULL) return;
  ecat_close(master->bus);
  master->bus = NULL;
  ecatm_drop(master);
}

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

/* The registration of one slave. Stops with one sentence when another slave is found there.
 * Identity numbers are 32 unsigned bits in a Modelica Integer; revision 0 accepts any. */
ECATM_FUNCTION void *ecatm_slave_open(void *object, int position, int vendor, int product,
                                      int revision, const char *name, const char *fingerprint,
                                      const char *command) {
  ecatm_master *master = ((ecatm_domain *)object)->node.master;
  ecat_t *bus = master->bus;
  ecat_slave_info found;
  ecatm_slave *slave;
  if (position < 0 || position >= ecat_slave_count(bus)) {
    ModelicaFormatError("EtherCAT: bus '%s' has no slave %d (it has %d slaves), but this library was "
                        "generated for %s there; regenerate it with: %s",
                        ecat_name(bus), position, ecat_slave_count(bus), name, command);
    return NULL;
  }
  ecatm_check(master, ecat_slave(bus, position, &found));
  if (found.vendor != (uint32_t)vendor || found.product != (uint32_t)product ||
      (revision != 0 && found.revision != (uint32_t)revision)) {
    ModelicaFormatError("EtherCAT: slave %d of bus '%s' is %s (vendor 0x%08X, product 0x%08X, "
                        "revision 0x%08X), but this library was generated for %s (vendor 0x%08X, "
                        "product 0x%08X, revision 0x%08X); regenerate it with: %s",
                        position, ecat_name(bus), found.name, (unsigned)found.vendor,
                        (unsigned)found.product, (unsigned)found.revision, name, (unsigned)vendor,
                        (unsigned)product, (unsigned)revision, command);
    return NULL;
  }
  slave = (ecatm_slave *)ecatm_new(master, sizeof *slave);
  if (slave == NULL) return NULL;
  slave->position = position;
  slave->same_bus = ecatm_same_bus(bus, fingerprint);
  sprintf(slave->command, "%.*s", (int)sizeof slave->command - 1, command);
  return slave;
}

ECATM_FUNCTION void ecatm_slave_close(void *object) { ecatm_close(object); }

/* --- PDO entries --------------------------------------------------------------------------- */

/* Whether a CoE data type has a sign: INTEGER8, 16, 32, 24, 40, 48, 56, 64. */
ECATM_FUNCTION int ecatm_signed(int type) {
  return (type >= 0x02 && type <= 0x04) || type == 0x10 || (type >= 0x12 && type <= 0x15);
}

/* The raw values that an integer entry can hold, and may hold by the configuration of the daemon. */
ECATM_FUNCTION void ecatm_limits(ecatm_pdo *pdo, const ecat_signal_info *found, int type, int bits) {
  double size = ldexp(1, bits);
  pdo->low = ecatm_signed(type) ? -size / 2 : 0;
  pdo->high = (ecatm_signed(type) ? size / 2 : size) - 1;
  if (!pdo->integer) pdo->low = -HUGE_VAL, pdo->high = HUGE_VAL;
  if (found->minimum > pdo->low) pdo->low = found->minimum;
  if (found->maximum < pdo->high) pdo->high = found->maximum;
}

/* An entry in the process data of a slave. `type` (CoE data type) and `bits` are those of the bus
 * that the library was generated for; a physical value is raw value * scale + offset. */
ECATM_FUNCTION void *ecatm_pdo_open(void *object, int index, int subindex, int output, int type,
                                    int bits, double scale, double offset) {
  ecatm_slave *slave = (ecatm_slave *)object;
  ecatm_master *master = slave->node.master;
  ecat_t *bus = master->bus;
  ecat_signal_info found;
  ecatm_pdo *pdo;
  int signal = ecat_bind(bus, slave->position, (unsigned)index, (unsigned)subindex,
                         output ? ECAT_OUTPUT : ECAT_INPUT);
  if (signal < 0) {
    ModelicaFormatError("EtherCAT: %s, but this library uses it; regenerate it with: %s",
                        ecat_error(bus), slave->command);
    return NULL;
  }
  ecatm_check(master, ecat_signal(bus, signal, &found));
  if (!(fabs(scale) > 0) || scale - scale != 0 || offset - offset != 0) {
    ModelicaFormatError("EtherCAT: entry 0x%04X:%02X of slave %d cannot be scaled by %g with an offset "
                        "of %g: the scale must be a finite number other than 0",
                        (unsigned)index, (unsigned)subindex, slave->position, scale, offset);
    return NULL;
  }
  if (!slave->same_bus && (found.type != (unsigned)type || found.bit_length != (unsigned)bits)) {
    ModelicaFormatError("EtherCAT: entry 0x%04X:%02X of slave %d of bus '%s' has %u bits and data "
                        "type 0x%04X, but this library was generated for %d bits and data type "
                        "0x%04X; regenerate it with: %s",
                        (unsigned)index, (unsigned)subindex, slave->position, ecat_name(bus),
                        found.bit_length, found.type, bits, (unsigned)type, slave->command);
    return NULL;
  }
  pdo = (ecatm_pdo *)ecatm_new(master, sizeof *pdo);
  if (pdo == NULL) return NULL;
  pdo->slave = slave;
  pdo->signal = signal;
  pdo->integer = type != 0x0008 && type != 0x0011; /* REAL32, REAL64 */
  pdo->scale = scale;
  pdo->offset = offset;
  ecatm_limits(pdo, &found, type, bits);
  if (output) {
    pdo->next_output = slave->outputs;
    slave->outputs = pdo;
  }
  return pdo;
}

ECATM_FUNCTION void ecatm_pdo_close(void *object) { ecatm_close(object); }

#endif
