/* The connection of a model to a bus: how it begins, what happens while there is none, and how it comes
 * back. */
#ifndef ECATM_MASTER_H
#define ECATM_MASTER_H

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "ModelicaUtilities.h"
#include "ecatm_system.h"
#include <ecat/ecat.h>

#define ECATM_TEXT 720           /* longest sentence, with its end */
#define ECATM_RETRY 0.02         /* seconds between two looks for a bus that is not there */
#define ECATM_SAME_TIME 1e-9     /* seconds; periodic events drift by rounding */

/* Numbers of EtherCAT.Types.BusFailure. */
enum ecatm_failure { ECATM_ERROR = 1, ECATM_WAIT = 2, ECATM_CONTINUE = 3 };

/* Numbers of EtherCAT.Types.BusState. */
enum ecatm_bus_state {
  ECATM_MISSING = 1,
  ECATM_STANDS_STILL = 2,
  ECATM_INCOMPLETE = 3,
  ECATM_NOT_OPERATIONAL = 4,
  ECATM_OPERATIONAL = 5
};

/* The slaves of one domain of the model: what is written to them leaves together. */
typedef struct ecatm_group {
  double time;                   /* of the last commit of a slave */
  int writers;                   /* slaves that commit whenever the domain is sampled */
  int staged;                    /* how many of them have done so at `time` */
} ecatm_group;

/* What every object of a model begins with. */
typedef struct ecatm_node {
  struct ecatm_node *next;       /* all objects of a master, in the order of their constructors */
  struct ecatm_master *master;
  /* Finds on the bus what the object stands for: whenever the model meets a bus. Returns 0, or what
   * ecatm_fail() does. NULL: there is nothing to find. */
  int (*resolve)(struct ecatm_node *node);
  int closed;                    /* a tool that merges equal constructors destroys an object twice */
} ecatm_node;

typedef struct ecatm_master {
  ecat_t *bus;                   /* NULL: there was none yet, or the model has ended */
  char name[64];
  ecatm_node *objects, *last;
  struct ecatm_slave *slaves;
  int users;                     /* this object and all of `objects` that still live */
  int domains;                   /* sample times of the model */
  ecatm_group *groups;           /* as many */
  int wait_for_bus;
  double period, lease;          /* sample time of domain 1; see ecat_claim() */
  int when_missing, when_failed; /* enum ecatm_failure: before the first connection, and after it */
  double patience;               /* of ECATM_WAIT, 0: for ever */

  char problem[ECATM_TEXT];      /* the sentence to the last failure */
  int attached;                  /* there was a bus, and it was the right one */
  unsigned session;              /* counts connections: handles of an earlier one are void */
  uint64_t instance;             /* of the daemon in which all objects were found */
  double tried;                  /* ecatm_now() of the last look for a bus */
  int outage;                    /* code of the failure that the model lives with, 0: none */
  double outage_since;           /* ecatm_now() */

  unsigned stride;               /* bus cycles from wait to wait */
  uint64_t waited_cycle;         /* bus cycle at the last wait */
  int in_step;                   /* `waited_cycle` is one of this bus, and no outage since */
  double origin;                 /* ecatm_now() less simulation time, at the last wait */
  double wait_time, sample_time; /* simulation time of the last wait, of the last sample */
  int waited, sampled;           /* whether there was one */
  int missed;                    /* waits that came too late for their cycle */

  int cycle;                     /* of the last sample, modulo 2^31; as the rest */
  double exchanged, age;         /* when its frames came back, by ecatm_now(); seconds since then */
  int state;                     /* enum ecatm_bus_state */
  int wkc, wkc_expected;         /* sums of all domains of the bus */
  unsigned complete;             /* bit n: all slaves of domain n of the bus took part */
  double lost;                   /* ecatm_now() when outputs were lost that had been claimed */
  int requests;                  /* to mailboxes that the client has not answered yet */
} ecatm_master;

ECATM_FUNCTION int ecatm_same_time(double a, double b) { return fabs(a - b) <= ECATM_SAME_TIME; }

/* --- Errors -------------------------------------------------------------------------------- */

/* Remembers a sentence, and returns `code`: who calls may still hold something that the end of the
 * simulation would leak. */
ECATM_FORMAT(3) int ecatm_fail(ecatm_master *master, int code, const char *format, ...) {
  va_list arguments;
  va_start(arguments, format);
  vsnprintf(master->problem, sizeof master->problem, format, arguments);
  va_end(arguments);
  return code;
}

/* The same with the sentence of the client, if `code` is an error of it. */
ECATM_FUNCTION int ecatm_client(ecatm_master *master, int code) {
  return code < 0 ? ecatm_fail(master, code, "%s", ecat_error(master->bus)) : code;
}

/* Ends the simulation with the remembered sentence. */
ECATM_FUNCTION void ecatm_stop(ecatm_master *master) {
  ModelicaFormatError("EtherCAT: %s", master->problem);
}

/* Ends it with the sentence of the client if `code` is an error. */
ECATM_FUNCTION void ecatm_check(ecatm_master *master, int code) {
  if (ecatm_client(master, code) < 0) ecatm_stop(master);
}

/* --- Numbers ------------------------------------------------------------------------------- */

/* Whether a Modelica Integer can hold a number when it is rounded. */
ECATM_FUNCTION int ecatm_is_integer(double value) {
  return value >= -2147483648.5 && value < 2147483647.5;
}

ECATM_FUNCTION int ecatm_nearest_integer(double value) {
  if (ecatm_is_integer(value)) return (int)ecat_round(value);
  ModelicaFormatError("EtherCAT: %g is no number that a Modelica Integer can hold", value);
  return 0;
}

/* --- Memory -------------------------------------------------------------------------------- */

/* An object in the master's memory. Call it last in a constructor: it cannot be taken back. */
ECATM_FUNCTION void *ecatm_new(ecatm_master *master, size_t size) {
  ecatm_node *node = (ecatm_node *)calloc(1, size);
  if (node == NULL) {
    ModelicaError("EtherCAT: out of memory");
    return NULL;
  }
  node->master = master;
  if (master->last != NULL)
    master->last->next = node;
  else
    master->objects = node;
  master->last = node;
  master->users++;
  return node;
}

/* The same as a copy of `draft`, once that was found on the bus, if there is one already. Stops with one
 * sentence if it is not there. */
ECATM_FUNCTION void *ecatm_register(ecatm_master *master, ecatm_node *draft, size_t size) {
  void *object;
  draft->master = master;
  if (master->bus != NULL && draft->resolve(draft) != 0) {
    ecatm_stop(master);
    return NULL;
  }
  object = ecatm_new(master, size);
  if (object != NULL) memcpy(object, draft, size);
  return object;
}

/* The end of one object; the last one frees all. */
ECATM_FUNCTION void ecatm_drop(ecatm_master *master) {
  ecatm_node *node;
  if (--master->users > 0) return;
  while ((node = master->objects) != NULL) {
    master->objects = node->next;
    free(node);
  }
  free(master->groups);
  free(master);
}

ECATM_FUNCTION void ecatm_close(void *object) {
  ecatm_node *node = (ecatm_node *)object;
  if (node == NULL || node->closed) return;
  node->closed = 1;
  ecatm_drop(node->master);
}

/* --- Connecting ---------------------------------------------------------------------------- */

/* Bus cycles in a sample time, 0 if it is no whole number of them. */
ECATM_FUNCTION unsigned ecatm_stride(double sample_time, double cycle_time) {
  double cycles = floor(sample_time / cycle_time + 0.5);
  if (!(cycles >= 1 && cycles <= 1e9)) return 0;
  return fabs(cycles * cycle_time - sample_time) <= 1e-6 * sample_time ? (unsigned)cycles : 0;
}

/* Checks that this is the bus that the model is made for, and finds all its objects there. */
ECATM_FUNCTION int ecatm_resolve(ecatm_master *master) {
  ecatm_node *node;
  int code;
  master->stride = ecatm_stride(master->period, ecat_cycle_time(master->bus));
  if (master->wait_for_bus && master->stride == 0)
    return ecatm_fail(master, ECAT_EARG, "the model is to wait for bus '%s', but its sample time of %g s "
                      "is no multiple of the bus cycle of %g s; change sampleTime[1] of the "
                      "EtherCATMaster", master->name, master->period, ecat_cycle_time(master->bus));
  for (node = master->objects; node != NULL; node = node->next)
    if (!node->closed && node->resolve != NULL && (code = node->resolve(node)) != 0) return code;
  master->instance = ecat_instance(master->bus);
  master->attached = 1;
  master->in_step = 0;
  return 0;
}

/* One try to connect, which does not wait. Returns 0 or what ecatm_fail() does: ECAT_EDOWN while there is
 * no bus. */
ECATM_FUNCTION int ecatm_attach(ecatm_master *master) {
  int code;
  if (master->outage != 0 && ecatm_now() - master->tried < ECATM_RETRY) return master->outage;
  master->tried = ecatm_now();
  code = ecatm_client(master, ecat_open(&master->bus, master->name));
  if (code == 0) {
    master->session++;
    code = ecatm_resolve(master);
  }
  if (code == 0) return 0;
  ecat_close(master->bus);
  master->bus = NULL;
  return code;
}

/* One try to take a new image of the bus as it is now. Returns 0 or what ecatm_fail() does. */
ECATM_FUNCTION int ecatm_refresh(ecatm_master *master) {
  int code;
  if (master->bus == NULL && (code = ecatm_attach(master)) != 0) return code;
  code = ecatm_client(master, ecat_sample(master->bus));
  if (code == ECAT_EBUS) { /* it came back with other slaves, which the model may have no need of */
    ecat_close(master->bus);
    master->bus = NULL;
    if ((code = ecatm_attach(master)) != 0) return code;
    return ecatm_client(master, ecat_sample(master->bus));
  }
  if (code == 0 && ecat_instance(master->bus) != master->instance) code = ecatm_resolve(master);
  return code;
}

/* --- Failures ------------------------------------------------------------------------------ */

/* Whether it may end by itself. */
ECATM_FUNCTION int ecatm_passes(int code) {
  return code == ECAT_EDOWN || code == ECAT_ESTALE || code == ECAT_ETIMEOUT;
}

/* What the model wants in this failure: enum ecatm_failure. */
ECATM_FUNCTION int ecatm_wish(const ecatm_master *master, int code) {
  if (!ecatm_passes(code)) return ECATM_ERROR;
  return master->attached ? master->when_failed : master->when_missing;
}

/* Tells once that, and why, there is no bus. */
ECATM_FUNCTION void ecatm_begin_outage(ecatm_master *master, int code, const char *what) {
  if (master->outage == 0) {
    master->outage_since = ecatm_now();
    ModelicaFormatMessage("EtherCAT: %s; %s\n", master->problem, what);
  }
  master->outage = code;
  master->in_step = 0;
}

ECATM_FUNCTION void ecatm_end_outage(ecatm_master *master) {
  if (master->outage == 0) return;
  master->outage = 0;
  ModelicaFormatMessage("EtherCAT: bus '%s' is there, %.1f s later\n", master->name,
                        ecatm_now() - master->outage_since);
}

/* Waits for the bus. Returns 0 or what ecatm_fail() does. */
ECATM_FUNCTION int ecatm_await(ecatm_master *master, int code) {
  char what[80] = "the model waits for it";
  if (master->patience > 0) sprintf(what + strlen(what), ", at most %g s", master->patience);
  ecatm_begin_outage(master, code, what);
  do {
    double now = ecatm_now(), waited = now - master->outage_since;
    if (!ecatm_passes(code)) return code;
    if (master->patience > 0 && waited >= master->patience) {
      char why[ECATM_TEXT / 2];
      sprintf(why, "%.*s", (int)sizeof why - 1, master->problem);
      return ecatm_fail(master, code, "%s; the model has waited for %.1f s, as long as patience of the "
                        "EtherCATMaster allows", why, waited);
    }
    ecatm_sleep_until(now + ECATM_RETRY);
  } while ((code = ecatm_refresh(master)) != 0);
  ecatm_end_outage(master);
  return 0;
}

/* Does in a failure what the model wants. Returns 0 when the bus is there again, else the code with which
 * the model goes on. */
ECATM_FUNCTION int ecatm_endure(ecatm_master *master, int code) {
  switch (ecatm_wish(master, code)) {
    case ECATM_WAIT: code = ecatm_await(master, code); break;
    case ECATM_CONTINUE:
      ecatm_begin_outage(master, code, "the model goes on without it");
      return code;
    default: break;
  }
  if (code != 0) ecatm_stop(master);
  return code;
}

/* --- The object ---------------------------------------------------------------------------- */

/* Connects to a bus. `sample_time` is that of domain 1, `domains` how many the model has; for the rest
 * see ecatm_master. */
ECATM_FUNCTION void *ecatm_master_open(const char *name, int wait_for_bus, double sample_time,
                                       int domains, double lease, int when_missing, int when_failed,
                                       double patience) {
  ecatm_master *master = (ecatm_master *)calloc(1, sizeof *master);
  ecatm_group *groups = (ecatm_group *)calloc((size_t)(domains > 0 ? domains : 1), sizeof *groups);
  char text[ECATM_TEXT];
  int code;
  if (master == NULL || groups == NULL) {
    free(master);
    free(groups);
    ModelicaError("EtherCAT: out of memory");
    return NULL;
  }
  sprintf(master->name, "%.*s", (int)sizeof master->name - 1, name);
  master->users = 1;
  master->domains = domains;
  master->groups = groups;
  master->wait_for_bus = wait_for_bus;
  master->period = sample_time;
  master->lease = lease;
  master->when_missing = when_missing;
  master->when_failed = when_failed;
  master->patience = patience;
  master->state = ECATM_MISSING;
  code = ecatm_attach(master);
  if (ecatm_wish(master, code) == ECATM_WAIT) code = ecatm_await(master, code);
  if (code != 0 && ecatm_wish(master, code) == ECATM_CONTINUE)
    ecatm_begin_outage(master, code, "the model goes on without it");
  else if (code != 0) { /* nobody would destroy it: a constructor that fails has no object */
    strcpy(text, master->problem);
    ecatm_drop(master);
    ModelicaFormatError("EtherCAT: %s", text);
    return NULL;
  }
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

#endif
