/* The master of a model: its session with a bus (ecat_session.h), and the memory of all its objects. */
#ifndef ECATM_MASTER_H
#define ECATM_MASTER_H

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "ModelicaUtilities.h"
#include "ecatm_system.h"
#include <ecat/ecat_session.h>

#define ECATM_TEXT ECAT_SESSION_TEXT
#define ECATM_HEADING 160
#define ECATM_SAME_TIME 1e-9     /* seconds; for a tool that evaluates an instant again */

/* The slaves of one domain of the model, whose outputs are committed together. */
typedef struct ecatm_group {
  double time;                   /* of the last commit of a slave */
  int writers;                   /* slaves that commit whenever the domain is sampled */
  int staged;                    /* number of these slaves that have committed at `time` */
} ecatm_group;

/* The first member of every object of a model. */
typedef struct ecatm_node {
  struct ecatm_node *next;       /* all objects of a master, in the order of their constructors */
  struct ecatm_master *master;
  /* Further checks, in addition to those of the session, whenever the model connects to a bus. Returns 0
   * or the result of ecat_session_fail(). May be NULL. */
  int (*check)(struct ecatm_node *node);
  int closed;                    /* a tool that merges equal constructors destroys an object twice */
  char heading[ECATM_HEADING];   /* beginning of messages: the block, "Plant.analog: "; may be empty */
} ecatm_node;

typedef struct ecatm_master {
  ecat_session session;
  char name[64], heading[ECATM_HEADING];
  ecatm_node *objects, *last;
  int users;                     /* number of objects that still live, with this one */
  int domains;                   /* number of sample times of the model */
  ecatm_group *groups;           /* one for each of them */
  int wait_for_bus;
  double period;                 /* time between two samples of the bus: of the base of all domains */
  unsigned stride;               /* bus cycles from wait to wait */
  double wait_time, sample_time; /* simulation time of the last wait, and of the last sample */
  int waited, sampled;           /* whether there was a wait, and a sample */
  int requests;                  /* number of mailbox requests without an answer so far */
} ecatm_master;

ECATM_FUNCTION int ecatm_same_time(double a, double b) { return fabs(a - b) <= ECATM_SAME_TIME; }

/* --- Errors -------------------------------------------------------------------------------- */

/* Ends the simulation with the error text of the session if `code` is an error. */
ECATM_FUNCTION void ecatm_check(ecatm_master *master, int code) {
  if (code < 0) ModelicaFormatError("EtherCAT: %s", master->session.problem);
}

/* Logs a message of the session that does not end the simulation. */
ECATM_FUNCTION void ecatm_tell(void *context, int warning, const char *sentence) {
  (void)context;
  (void)warning;
  ModelicaFormatMessage("EtherCAT: %s\n", sentence);
}

/* Sets the beginning of messages about an instance of a block: its name, unless that is empty. */
ECATM_FUNCTION void ecatm_head(char heading[ECATM_HEADING], const char *block) {
  sprintf(heading, "%.*s%s", ECATM_HEADING - 3, block, *block != '\0' ? ": " : "");
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

/* Returns memory for an object that no master owns yet, so that a refused object can be freed. */
ECATM_FUNCTION void *ecatm_draft(ecatm_master *master, size_t size) {
  ecatm_node *node = (ecatm_node *)calloc(1, size);
  if (node == NULL)
    ModelicaError("EtherCAT: out of memory");
  else
    node->master = master;
  return node;
}

/* Gives an object to its master. If `code` is an error, ends the simulation instead. */
ECATM_FUNCTION void *ecatm_keep(void *object, int code) {
  ecatm_node *node = (ecatm_node *)object;
  ecatm_master *master = node->master;
  if (code < 0) {
    free(node);
    ecatm_check(master, code);
    return NULL;
  }
  if (master->last != NULL)
    master->last->next = node;
  else
    master->objects = node;
  master->last = node;
  master->users++;
  return node;
}

/* Returns an object in the master's memory. Constructors call it after all checks, since the object then
 * lives as long as the master. */
ECATM_FUNCTION void *ecatm_new(ecatm_master *master, size_t size) {
  void *object = ecatm_draft(master, size);
  return object != NULL ? ecatm_keep(object, 0) : NULL;
}

/* Counts the end of one object; the last end frees all memory. */
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

/* --- The object ---------------------------------------------------------------------------- */

/* Returns the bus cycles in a sample time, 0 if this is not a whole number. */
ECATM_FUNCTION unsigned ecatm_stride(double sample_time, double cycle_time) {
  double cycles = floor(sample_time / cycle_time + 0.5);
  if (!(cycles >= 1 && cycles <= 1e9)) return 0;
  return fabs(cycles * cycle_time - sample_time) <= 1e-6 * sample_time ? (unsigned)cycles : 0;
}

/* The checks that the session does not make: of the sample time, and of objects with mailbox requests. */
ECATM_FUNCTION int ecatm_check_more(void *context) {
  ecatm_master *master = (ecatm_master *)context;
  double cycle_time = ecat_cycle_time(master->session.bus);
  ecatm_node *node;
  int code = 0;
  master->stride = ecatm_stride(master->period, cycle_time);
  if (master->wait_for_bus && master->stride == 0)
    return ecat_session_fail(&master->session, ECAT_EARG, "%sthe model is to wait for bus '%s', but its "
                             "sample time of %g s%s is no multiple of the bus cycle of %g s; change "
                             "sampleTime of the EtherCATMaster", master->heading, master->name,
                             master->period, master->domains > 1 ? " (the base of its domains)" : "",
                             cycle_time);
  for (node = master->objects; node != NULL && code == 0; node = node->next)
    if (!node->closed && node->check != NULL) code = node->check(node);
  return code;
}

/* Connects to a bus. `sample_time` is the time between two calls of ecatm_wait(), which all
 * sample times of the model are multiples of, `domains` the number of its domains, `block` the name of the block's instance. For the others see ecat_session_settings. */
ECATM_FUNCTION void *ecatm_master_open(const char *name, int wait_for_bus, double sample_time,
                                       int domains, double lease, int when_missing, int when_failed,
                                       double patience, int read_only, int require_op,
                                       const char *block) {
  ecatm_master *master = (ecatm_master *)calloc(1, sizeof *master);
  ecatm_group *groups = (ecatm_group *)calloc((size_t)(domains > 0 ? domains : 1), sizeof *groups);
  ecat_session_settings settings;
  char text[ECATM_TEXT];
  if (master == NULL || groups == NULL) {
    free(master);
    free(groups);
    ModelicaError("EtherCAT: out of memory");
    return NULL;
  }
  sprintf(master->name, "%.*s", (int)sizeof master->name - 1, name);
  ecatm_head(master->heading, block);
  master->users = 1;
  master->domains = domains;
  master->groups = groups;
  master->wait_for_bus = wait_for_bus;
  master->period = sample_time;
  settings.bus = master->name;
  settings.lease = lease;
  settings.when_missing = when_missing;
  settings.when_failed = when_failed;
  settings.patience = patience;
  settings.read_only = read_only;
  settings.require_op = require_op;
  settings.product = "this library";
  settings.program = "the model";
  settings.patience_name = "patience of the EtherCATMaster";
  settings.tell = ecatm_tell;
  settings.check = ecatm_check_more;
  settings.context = master;
  ecat_session_init(&master->session, &settings);
  if (ecat_session_begin(&master->session) != 0) { /* the tool gets no object that it would destroy */
    strcpy(text, master->session.problem);
    ecatm_drop(master);
    ModelicaFormatError("EtherCAT: %s", text);
    return NULL;
  }
  return master;
}

/* Ends the connection: the outputs go to their safe values. */
ECATM_FUNCTION void ecatm_master_close(void *object) {
  ecatm_master *master = (ecatm_master *)object;
  if (master == NULL) return;
  ecat_session_end(&master->session);
  ecatm_drop(master);
}

#endif
