/* The life of an instance, and its steps. */
#ifndef _GNU_SOURCE
#define _GNU_SOURCE
#endif
#include "plant.h"
#include "ls_bus.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define ROUNDING 1e-6 /* a step may be shorter by this part of a bus cycle */

/* --- messages ------------------------------------------------------------------------------ */

/* The log categories of the model description, by status; events have the status OK. */
enum { CATEGORIES = PLANT_FATAL + 1 };
static const char *const log_categories[CATEGORIES] = {"logEvents", "logStatusWarning", "logStatusDiscard",
                                             "logStatusError", "logStatusFatal"};

static void log_text(plant *p, enum plant_status status, const char *format, va_list arguments) {
  char text[sizeof p->session.problem];
  vsnprintf(text, sizeof text, format, arguments);
  if (p->log != NULL) p->log(p->log_context, status, log_categories[status], text);
}

int plant_say(plant *p, enum plant_status status, const char *format, ...) {
  va_list arguments;
  va_start(arguments, format);
  log_text(p, status, format, arguments);
  va_end(arguments);
  return (int)status;
}

void plant_event(plant *p, const char *format, ...) {
  va_list arguments;
  va_start(arguments, format);
  if (p->log_events) log_text(p, PLANT_OK, format, arguments);
  va_end(arguments);
}

static void tell(void *context, int warning, const char *sentence) {
  if (warning)
    plant_say(context, PLANT_WARNING, "%s", sentence);
  else
    plant_event(context, "%s", sentence);
}

int plant_log_categories(plant *p, int on, size_t count, const char *const categories[]) {
  int events = count == 0;
  size_t i, known;
  for (i = 0; i < count; i++) {
    for (known = 0; known < CATEGORIES; known++)
      if (categories[i] != NULL && strcmp(categories[i], log_categories[known]) == 0) break;
    if (known == CATEGORIES)
      return plant_say(p, PLANT_ERROR, "'%s' is no log category of this FMU",
                       categories[i] == NULL ? "" : categories[i]);
    events |= known == 0;
  }
  if (events) p->log_events = on;
  return PLANT_OK;
}

/* --- life ---------------------------------------------------------------------------------- */

plant *plant_new(const char *token, const char *resources, plant_log *log, void *context,
                 int events) {
  static const ecat_session_settings settings = {
      NULL, 0, 0, 0, 0, 0, 0, "this FMU", "the FMU", "'patience'", tell, NULL, NULL};
  plant *p = calloc(1, sizeof *p);
  if (p == NULL) return NULL;
  p->log = log;
  p->log_context = context;
  p->log_events = events;
  ecat_session_init(&p->session, &settings);
  p->session.settings.context = p;
  if (plant_load(p, resources) == 0 && (token == NULL || strcmp(token, p->token) != 0))
    ecat_session_fail(&p->session, -1, "the importer asks for a model with token '%s', but "
                      "resources/plant.txt is of '%s': files of two FMUs were mixed",
                      token == NULL ? "" : token, p->token);
  if (p->session.problem[0] == '\0' && drives_found(p) != 0)
    ecat_session_fail(&p->session, -1, "resources/plant.txt has a drive without its objects; generate the FMU again");
  if (p->session.problem[0] == '\0' && p->ecu_count > 0) {
    p->session.settings.check = ls_bus_found;
    if ((p->ls_bus = ls_bus_new(p->ecu_count)) == NULL) ecat_session_fail(&p->session, -1, "out of memory");
  }
  if (p->session.problem[0] != '\0') {
    plant_say(p, PLANT_ERROR, "%s", p->session.problem);
    plant_unload(p);
    free(p);
    return NULL;
  }
  plant_start_values(p);
  return p;
}

void plant_free(plant *p) {
  if (p == NULL) return;
  ecat_session_end(&p->session);
  ls_bus_free(p->ls_bus);
  plant_unload(p);
  free(p->bus_name);
  free(p);
}

int plant_allow(plant *p, const char *call, unsigned states) {
  static const char *const names[] = {"before the initialization", "during the initialization",
                                      "between steps", "in event mode", "after the end", "after an error"};
  if (states >> p->state & 1u) return PLANT_OK;
  return plant_say(p, PLANT_ERROR, "%s is not allowed %s", call, names[p->state]);
}

void plant_detach(plant *p) {
  ecat_session_end(&p->session);
  p->begun = 0;
}

int plant_terminate(plant *p) {
  if (p->ls_bus != NULL) ls_bus_flush(p);
  plant_detach(p);
  p->state = PLANT_TERMINATED;
  plant_event(p, "the outputs of bus '%s' are released", p->bus_name);
  return PLANT_OK;
}

int plant_reset(plant *p) {
  plant_detach(p);
  p->owed = 0;
  p->state = PLANT_INSTANTIATED;
  plant_start_values(p);
  return PLANT_OK;
}

/* --- outputs of the FMU -------------------------------------------------------------------- */

static int publish_entry(plant_variable *v) {
  int code;
  if (v->type == PLANT_REAL) return ecat_session_read(&v->on_bus, &v->value.real);
  code = ecat_session_read_int(&v->on_bus, &v->value.integer);
  if (v->type == PLANT_BOOLEAN) v->value.integer = v->value.integer != 0;
  return code;
}

static void publish_can(plant *p, plant_variable *v) {
  const ecat_session_message *message = &p->messages[v->message].on_bus;
  ecat_can_info info;
  int state = ecat_session_can_state(&p->slaves[v->slave].on_bus, &info);
  if (v->role == ROLE_CAN_STATE) v->value.integer = state;
  if (v->role == ROLE_CAN_SEND_ERRORS) v->value.integer = info.send_errors;
  if (v->role == ROLE_CAN_RECEIVE_ERRORS) v->value.integer = info.receive_errors;
  if (v->role == ROLE_CAN_VALID) v->value.integer = message->valid;
  if (v->role == ROLE_CAN_AGE) v->value.real = message->age;
  if (v->role == ROLE_CAN_COUNT) v->value.integer = (int64_t)(message->count & 0x7FFFFFFF);
  if (v->role != ROLE_CAN_OUTPUT) return;
  v->value.real = ecat_session_can_read(&v->signal);
  v->value.integer = ecat_session_can_read_int(&v->signal);
  if (v->type == PLANT_BOOLEAN) v->value.integer = v->value.integer != 0;
}

/* Updates all outputs. Without a bus, entries keep their last values, and the diagnostics say that there
 * is no bus. */
static int publish(plant *p) {
  const ecat_session *session = &p->session;
  int code = 0;
  size_t i;
  plant_publish(p, ROLE_CONNECTED, 0, session->state >= ECAT_SESSION_INCOMPLETE);
  plant_publish(p, ROLE_STATE, 0, session->state);
  plant_publish(p, ROLE_CYCLE, 0, session->cycle);
  plant_publish(p, ROLE_AGE, session->age, 0);
  plant_publish(p, ROLE_MISSED, 0, (int64_t)(session->missed & 0x7FFFFFFF));
  plant_publish(p, ROLE_WORKING_COUNTER, 0, session->wkc);
  plant_publish(p, ROLE_WORKING_COUNTER_EXPECTED, 0, session->wkc_expected);
  for (i = 0; i < p->variable_count && code == 0; i++) {
    plant_variable *v = &p->variables[i];
    const ecat_session_slave *slave = &p->slaves[v->slave].on_bus;
    if (v->role == ROLE_VALID) v->value.integer = slave->valid;
    if (v->role == ROLE_AL_STATE) v->value.integer = slave->al_state;
    if (v->role == ROLE_AL_STATUS_CODE) v->value.integer = slave->al_code;
    if (v->role >= ROLE_CAN_STATE && v->role <= ROLE_CAN_OUTPUT) publish_can(p, v);
    if (v->role == ROLE_OUTPUT) code = publish_entry(v);
  }
  if (p->ls_bus != NULL) ls_bus_publish(p);
  return code;
}

/* Ends a call of the session that has returned `code`. After an error the simulation ends, and the outputs
 * of the bus go to their safe values at once. */
static int settle(plant *p, int code) {
  if (code == 0) code = publish(p);
  if (code == 0) return PLANT_OK;
  p->state = PLANT_FAILED;
  ecat_session_end(&p->session);
  publish(p);
  return plant_say(p, PLANT_ERROR, "%s", p->session.problem);
}

/* --- initialization and steps ---------------------------------------------------------------- */

int plant_begin(plant *p) {
  ecat_session *session = &p->session;
  int code;
  session->settings.bus = p->bus_name;
  session->settings.lease = plant_real(p, ROLE_LEASE);
  session->settings.when_missing = (int)plant_integer(p, ROLE_WHEN_MISSING);
  session->settings.when_failed = (int)plant_integer(p, ROLE_WHEN_FAILED);
  session->settings.patience = plant_real(p, ROLE_PATIENCE);
  session->settings.read_only = plant_integer(p, ROLE_READ_ONLY) != 0;
  session->settings.require_op = plant_integer(p, ROLE_REQUIRE_OPERATIONAL) != 0;
  code = ecat_session_begin(session);
  if (code == 0) code = ecat_session_sample(session);
  if (code == 0) drives_measure(p, p->time);
  if (code == 0 && p->ls_bus != NULL) code = ls_bus_exchange(p);
  p->begun = 1;
  if (code == 0 && session->outage == 0)
    plant_event(p, "attached to bus '%s', cycle %d", p->bus_name, session->cycle);
  return settle(p, code);
}

int plant_leave_initialization(plant *p) {
  int status = p->begun ? PLANT_OK : plant_begin(p);
  if (status == PLANT_OK) p->state = p->ls_bus != NULL ? PLANT_EVENTS : PLANT_STEPS;
  return status;
}

/* Hands the inputs that were set over to the bus. */
static int write_inputs(plant *p) {
  size_t i;
  int code = 0;
  for (i = 0; i < p->slave_count && code == 0; i++)
    if (p->slaves[i].on_bus.writes) code = ecat_session_stage(&p->slaves[i].on_bus);
  if (code == 0) code = ecat_session_commit(&p->session);
  for (i = 0; i < p->message_count && code == 0; i++)
    if (p->messages[i].active) code = ecat_session_can_send(&p->messages[i].on_bus, 0);
  return code;
}

/* Waits for as many bus cycles as a step has, and keeps the remaining part of a cycle for the next step. */
static int pace(plant *p, double time, double step) {
  double cycles = 0;
  if (!plant_integer(p, ROLE_WAIT_FOR_BUS)) return 0;
  if (p->session.bus != NULL && p->session.outage == 0) {
    p->owed += fmin(step / ecat_cycle_time(p->session.bus), 1e9);
    cycles = fmax(floor(p->owed + ROUNDING), 0);
    p->owed -= cycles;
  }
  return ecat_session_pace(&p->session, (unsigned)cycles, time + step);
}

int plant_step(plant *p, double time, double step) {
  int code, status;
  if (!(isfinite(time) && isfinite(step) && step > 0))
    return plant_say(p, PLANT_ERROR, "doStep: from %g s, for %g s, is no communication step", time,
                     step);
  drives_command(p);
  code = write_inputs(p);
  if (code == 0) code = pace(p, time, step);
  if (code == 0) code = ecat_session_sample(&p->session);
  if (code == 0) drives_measure(p, time + step);
  if (code == 0 && p->ls_bus != NULL) code = ls_bus_exchange(p);
  status = settle(p, code);
  if (status == PLANT_OK) p->time = time + step;
  return status;
}

int plant_update(plant *p) { return settle(p, ls_bus_event(p)); }
