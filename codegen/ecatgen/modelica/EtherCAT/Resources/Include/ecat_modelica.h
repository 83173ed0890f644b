/* What the Modelica library EtherCAT calls: the objects of a model and their life.
 *
 * Valid C89, static functions only: a Modelica tool may put every external function into a
 * translation unit of its own. So nothing here is shared through global variables; an orphan (older
 * FMU exporters call a constructor twice) costs memory and nothing else, because outputs are claimed
 * by the first commit and not by a constructor.
 *
 *     time t:  wait -> reads -> the model -> writes -> commit
 *
 * Tools may evaluate a when-clause more than once at one time. Hence: the first call at a new time
 * takes the sample, all reads at that time see it; a write only remembers its value, the commit of
 * its slave hands all of them over at once, and doing so twice is harmless.
 *
 * The master owns the memory of all objects, so that they may be destroyed in any order.
 * ModelicaFormatError() does not return; nothing may be held that no object owns when it is called.
 */
#ifndef ECAT_MODELICA_H
#define ECAT_MODELICA_H

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "ModelicaUtilities.h"
#include <ecat/ecat.h>

#if defined(__GNUC__)
#define ECATM_FUNCTION static __attribute__((unused))
#else
#define ECATM_FUNCTION static
#endif

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
  int pending;                   /* value was written by the model */
  double value;
} ecatm_pdo;

enum ecatm_sdo_state {
  ECATM_SDO_NONE = 0,
  ECATM_SDO_BUSY = 1,
  ECATM_SDO_DONE = 2,
  ECATM_SDO_FAILED = 3
};

typedef struct ecatm_sdo {
  ecatm_node node;
  int position, index, subindex, type;
  int request;                   /* handle of the client, -1: not sent yet */
  int download;                  /* the request writes `value` */
  int value;
  int state, state_before;       /* enum ecatm_sdo_state: now, and when this time began */
  int trigger, trigger_before;   /* now, and at the time before */
  int stepped;                   /* `time` is valid */
  double time;                   /* simulation time of the last call */
  int result;                    /* of the last upload */
  int abort_code;
} ecatm_sdo;

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

ECATM_FUNCTION int ecatm_same_time(double a, double b) { return fabs(a - b) <= ECATM_SAME_TIME; }

/* Takes a new image of all domains and remembers its time, and the cycle of the newest one. */
ECATM_FUNCTION void ecatm_take_sample(ecatm_master *master, double time) {
  ecat_domain_info info;
  uint64_t newest = 0;
  int i;
  ecatm_check(master, ecat_sample(master->bus));
  for (i = 0; i < ecat_domain_count(master->bus); i++) {
    ecatm_check(master, ecat_domain(master->bus, i, &info));
    if (info.cycle > newest) newest = info.cycle;
  }
  master->cycle = (int)(newest & 0x7FFFFFFF);
  master->sample_time = time;
  master->sampled = 1;
}

/* Waits for the bus where asked to, then samples; returns the cycle of the sample. */
ECATM_FUNCTION int ecatm_wait(void *object, double time) {
  ecatm_master *master = (ecatm_master *)object;
  if (master->waited && ecatm_same_time(time, master->wait_time)) return master->cycle;
  if (master->stride > 0) {
    uint64_t goal = master->waited ? master->waited_cycle + master->stride
                                   : ecat_cycle(master->bus) + 1;
    while (ecat_cycle(master->bus) < goal) {
      ecatm_check(master, ecat_wait(master->bus, 1, ECATM_PATIENCE));
      /* Keeps the lease: who waits is alive, however long the sample time is. */
      if (ecat_cycle(master->bus) < goal) ecatm_check(master, ecat_sample(master->bus));
    }
    master->waited_cycle = ecat_cycle(master->bus);
  }
  master->wait_time = time;
  master->waited = 1;
  ecatm_take_sample(master, time);
  return master->cycle;
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

/* Makes this model the owner of the outputs, once. */
ECATM_FUNCTION void ecatm_claim(ecatm_slave *slave) {
  ecatm_master *master = slave->node.master;
  const ecatm_slave *other;
  if (slave->claimed) return;
  for (other = master->writers; other != NULL; other = other->next_writer)
    if (other->position == slave->position) {
      ModelicaFormatError("EtherCAT: two blocks of this model write the outputs of slave %d of bus "
                          "'%s'; remove one of them", slave->position, ecat_name(master->bus));
      return;
    }
  ecatm_check(master, ecat_claim(master->bus, slave->position, master->lease));
  slave->claimed = 1;
  slave->next_writer = master->writers;
  master->writers = slave;
}

/* Hands the written values of this slave over, all at once. `order` is only there to be returned:
 * it makes the tool call this after the writes that it came from. */
ECATM_FUNCTION int ecatm_commit(void *object, double time, int order) {
  ecatm_slave *slave = (ecatm_slave *)object;
  ecat_t *bus = slave->node.master->bus;
  ecatm_pdo *pdo;
  (void)time;
  ecatm_claim(slave);
  for (pdo = slave->outputs; pdo != NULL; pdo = pdo->next_output)
    if (pdo->pending) ecatm_check(slave->node.master, ecat_write(bus, pdo->signal, pdo->value));
  ecatm_check(slave->node.master, ecat_commit(bus));
  return order;
}

/* --- PDO entries --------------------------------------------------------------------------- */

/* An entry in the process data of a slave. `type` (CoE data type) and `bits` are those of the bus
 * that the library was generated for. */
ECATM_FUNCTION void *ecatm_pdo_open(void *object, int index, int subindex, int output, int type,
                                    int bits) {
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
  if (output) {
    pdo->next_output = slave->outputs;
    slave->outputs = pdo;
  }
  return pdo;
}

ECATM_FUNCTION void ecatm_pdo_close(void *object) { ecatm_close(object); }

/* `order` makes the tool call reads after the wait that it came from. */
ECATM_FUNCTION double ecatm_read_real(void *object, double time, int order) {
  ecatm_pdo *pdo = (ecatm_pdo *)object;
  ecatm_master *master = pdo->node.master;
  double value = 0;
  (void)order;
  if (!master->sampled || !ecatm_same_time(time, master->sample_time))
    ecatm_take_sample(master, time);
  ecatm_check(master, ecat_read(master->bus, pdo->signal, &value));
  return value;
}

ECATM_FUNCTION int ecatm_read_integer(void *object, double time, int order) {
  return (int)ecatm_read_real(object, time, order);
}

ECATM_FUNCTION int ecatm_read_boolean(void *object, double time, int order) {
  return ecatm_read_real(object, time, order) != 0;
}

/* Remembers a value for the commit. Values of integer entries are rounded. */
ECATM_FUNCTION int ecatm_write_real(void *object, double time, int order, double value) {
  ecatm_pdo *pdo = (ecatm_pdo *)object;
  (void)time;
  pdo->value = pdo->integer && fabs(value) < 4503599627370496.0 ? floor(value + 0.5) : value;
  pdo->pending = 1;
  return order;
}

ECATM_FUNCTION int ecatm_write_integer(void *object, double time, int order, int value) {
  return ecatm_write_real(object, time, order, (double)value);
}

ECATM_FUNCTION int ecatm_write_boolean(void *object, double time, int order, int value) {
  return ecatm_write_real(object, time, order, value ? 1.0 : 0.0);
}

/* --- SDO ----------------------------------------------------------------------------------- */

/* Bytes and signedness of the integer types of EtherCAT.Types.DataType. */
ECATM_FUNCTION int ecatm_sdo_bytes(int type) { return type <= 3 ? 1 : type <= 5 ? 2 : 4; }
ECATM_FUNCTION int ecatm_sdo_signed(int type) { return type == 2 || type == 4 || type == 6; }

/* An object of a slave. `type` is the number of an EtherCAT.Types.DataType. */
ECATM_FUNCTION void *ecatm_sdo_open(void *object, int position, int index, int subindex, int type) {
  ecatm_master *master = (ecatm_master *)object;
  ecat_slave_info info;
  ecatm_sdo *sdo;
  ecatm_check(master, ecat_slave(master->bus, position, &info));
  sdo = (ecatm_sdo *)ecatm_new(master, sizeof *sdo);
  if (sdo == NULL) return NULL;
  sdo->position = position;
  sdo->index = index;
  sdo->subindex = subindex;
  sdo->type = type;
  sdo->request = -1;
  return sdo;
}

ECATM_FUNCTION void ecatm_sdo_close(void *object) { ecatm_close(object); }

/* Sends the noted request; while all requests of this client are in use it stays noted. */
ECATM_FUNCTION void ecatm_sdo_send(ecatm_sdo *sdo) {
  ecatm_master *master = sdo->node.master;
  int i, code, bytes = ecatm_sdo_bytes(sdo->type);
  double low = ecatm_sdo_signed(sdo->type) ? -ldexp(1, 8 * bytes - 1) : 0;
  double high = sdo->type == 1 ? 1 : ldexp(1, 8 * bytes - ecatm_sdo_signed(sdo->type)) - 1;
  unsigned long bits = (unsigned long)(long)sdo->value;
  unsigned char data[4];
  if (sdo->download && (sdo->value < low || sdo->value > high)) {
    ModelicaFormatError("EtherCAT: %d is out of range for object 0x%04X:%02X of slave %d: %.0f to "
                        "%.0f are allowed", sdo->value, (unsigned)sdo->index,
                        (unsigned)sdo->subindex, sdo->position, low, high);
    return;
  }
  for (i = 0; i < bytes; i++) data[i] = (unsigned char)(bits >> (8 * i) & 0xFF);
  code = ecat_sdo_start(master->bus, sdo->position, (unsigned)sdo->index, (unsigned)sdo->subindex,
                        sdo->download ? data : NULL, sdo->download ? (size_t)bytes : 0);
  if (code == ECAT_EFULL) return;
  ecatm_check(master, code);
  sdo->request = code;
}

/* Takes over what was uploaded. */
ECATM_FUNCTION void ecatm_sdo_decode(ecatm_sdo *sdo, const unsigned char *data, size_t length) {
  int i, bytes = ecatm_sdo_bytes(sdo->type);
  double value = 0;
  if (length != (size_t)bytes) {
    ModelicaFormatError("EtherCAT: object 0x%04X:%02X of slave %d has %lu bytes, but the dataType of "
                        "its block has %d", (unsigned)sdo->index, (unsigned)sdo->subindex,
                        sdo->position, (unsigned long)length, bytes);
    return;
  }
  for (i = bytes - 1; i >= 0; i--) value = value * 256 + data[i];
  if (ecatm_sdo_signed(sdo->type) && value >= ldexp(1, 8 * bytes - 1)) value -= ldexp(1, 8 * bytes);
  if (value > 2147483647.0) {
    ModelicaFormatError("EtherCAT: object 0x%04X:%02X of slave %d is %.0f, which is too large for a "
                        "Modelica Integer", (unsigned)sdo->index, (unsigned)sdo->subindex,
                        sdo->position, value);
    return;
  }
  sdo->result = (int)value;
}

/* Sends the request or asks for its answer. A slave that refuses does not end the simulation: it
 * leaves a message and an abort code, negative if there was no answer at all. */
ECATM_FUNCTION void ecatm_sdo_progress(ecatm_sdo *sdo) {
  ecatm_master *master = sdo->node.master;
  unsigned char data[8];
  size_t length = 0;
  uint32_t reason = 0;
  int code;
  if (sdo->request < 0) ecatm_sdo_send(sdo);
  if (sdo->request < 0) return;
  code = ecat_poll(master->bus, sdo->request, data, sizeof data, &length, &reason);
  if (code == ECAT_EBUSY) return;
  if (code == ECAT_EDOWN || code == ECAT_ESTALE) ecatm_check(master, code);
  sdo->request = -1;
  sdo->state = code == 0 ? ECATM_SDO_DONE : ECATM_SDO_FAILED;
  sdo->abort_code = code == ECAT_EABORT ? (int)reason : code;
  if (code == 0 && !sdo->download) ecatm_sdo_decode(sdo, data, length);
  if (code != 0)
    ModelicaFormatMessage("EtherCAT: %s of object 0x%04X:%02X of slave %d failed: %s\n",
                          sdo->download ? "download" : "upload", (unsigned)sdo->index,
                          (unsigned)sdo->subindex, sdo->position, ecat_error(master->bus));
}

/* One sample of a request. It is sent at the time after its trigger, so that the last of several
 * evaluations at one time counts. Triggers of a busy request are ignored. */
ECATM_FUNCTION int ecatm_sdo_step(ecatm_sdo *sdo, double time, int trigger, int download,
                                  int value) {
  if (!sdo->stepped || !ecatm_same_time(time, sdo->time)) {
    sdo->stepped = 1;
    sdo->time = time;
    sdo->trigger_before = sdo->trigger;
    if (sdo->state == ECATM_SDO_BUSY) ecatm_sdo_progress(sdo);
    sdo->state_before = sdo->state;
  }
  sdo->trigger = trigger;
  sdo->state = sdo->state_before;
  if (trigger && !sdo->trigger_before && sdo->state != ECATM_SDO_BUSY) {
    sdo->state = ECATM_SDO_BUSY;
    sdo->download = download;
    sdo->value = value;
    sdo->abort_code = 0;
  }
  return sdo->state;
}

ECATM_FUNCTION int ecatm_sdo_read(void *object, double time, int order, int trigger) {
  (void)order;
  return ecatm_sdo_step((ecatm_sdo *)object, time, trigger, 0, 0);
}

ECATM_FUNCTION int ecatm_sdo_write(void *object, double time, int order, int trigger, int value) {
  (void)order;
  return ecatm_sdo_step((ecatm_sdo *)object, time, trigger, 1, value);
}

ECATM_FUNCTION int ecatm_sdo_value(void *object, int order) {
  (void)order;
  return ((ecatm_sdo *)object)->result;
}

ECATM_FUNCTION int ecatm_sdo_abort_code(void *object, int order) {
  (void)order;
  return ((ecatm_sdo *)object)->abort_code;
}

#endif
