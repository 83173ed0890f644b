/* The life of an instance, and what it does when the bus is missing or fails. */
#ifndef _GNU_SOURCE
#define _GNU_SOURCE
#endif
#include "plant.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#define LOOK_AGAIN_NS 20000000u /* between two looks whether the bus is there */
#define RECLAIM_NS 100000000u /* between two tries to own outputs again */
#define QUIET_NS 1000000000u  /* in which the same is not told twice */
#define ROUNDING 1e-6   /* of a bus cycle, by which a step may be shorter */

/* --- messages ------------------------------------------------------------------------------ */

/* Named in the model description; by status, OK is for events. */
enum { CATEGORIES = PLANT_FATAL + 1 };
static const char *const log_categories[CATEGORIES] = {"logEvents", "logStatusWarning", "logStatusDiscard",
                                             "logStatusError", "logStatusFatal"};

static void log_text(plant *p, enum plant_status status, const char *format, va_list arguments) {
  char text[sizeof p->message];
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

int plant_note(plant *p, int code, const char *format, ...) {
  va_list arguments;
  va_start(arguments, format);
  vsnprintf(p->message, sizeof p->message, format, arguments);
  va_end(arguments);
  return code;
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

/* The end of the simulation by an error: the outputs fall to their safe values at once. */
static int fail(plant *p, int code) {
  p->state = PLANT_FAILED;
  bus_detach(p);
  bus_invalidate(p, code);
  return plant_say(p, PLANT_ERROR, "%s", p->message);
}

/* --- time ---------------------------------------------------------------------------------- */

uint64_t plant_now(void) {
  struct timespec now;
  clock_gettime(CLOCK_MONOTONIC, &now);
  return (uint64_t)now.tv_sec * 1000000000u + (uint64_t)now.tv_nsec;
}

static void sleep_until(uint64_t ns) {
  struct timespec until;
  until.tv_sec = (time_t)(ns / 1000000000u);
  until.tv_nsec = (long)(ns % 1000000000u);
  while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, NULL) != 0) continue;
}

/* Takes the place of the bus cycle while there is none. */
static void pace(plant *p, double step) {
  uint64_t now = plant_now(), length = step < 1e6 ? (uint64_t)(step * 1e9) : (uint64_t)1e15;
  if (!plant_integer(p, ROLE_WAIT_FOR_BUS)) return;
  if (p->pace_ns == 0 || p->pace_ns + length < now) p->pace_ns = now;
  p->pace_ns += length;
  sleep_until(p->pace_ns);
}

/* --- life ---------------------------------------------------------------------------------- */

plant *plant_new(const char *token, const char *resources, plant_log *log, void *context,
                 int events) {
  plant *p = calloc(1, sizeof *p);
  if (p == NULL) return NULL;
  p->log = log;
  p->log_context = context;
  p->log_events = events;
  if (plant_load(p, resources) == 0 && (token == NULL || strcmp(token, p->token) != 0))
    plant_note(p, -1, "the importer asks for a model with token '%s', but resources/plant.txt is of "
               "'%s': files of two FMUs were mixed", token == NULL ? "" : token, p->token);
  if (p->message[0] != '\0') {
    plant_say(p, PLANT_ERROR, "%s", p->message);
    plant_unload(p);
    free(p);
    return NULL;
  }
  plant_start_values(p);
  return p;
}

void plant_free(plant *p) {
  if (p == NULL) return;
  bus_detach(p);
  plant_unload(p);
  free(p->bus_name);
  free(p);
}

int plant_allow(plant *p, const char *call, unsigned states) {
  static const char *const names[] = {"before the initialization", "during the initialization",
                                      "between steps", "after the end", "after an error"};
  if (states >> p->state & 1u) return PLANT_OK;
  return plant_say(p, PLANT_ERROR, "%s is not allowed %s", call, names[p->state]);
}

int plant_terminate(plant *p) {
  bus_detach(p);
  p->state = PLANT_TERMINATED;
  plant_event(p, "the outputs of bus '%s' are released", p->bus_name);
  return PLANT_OK;
}

int plant_reset(plant *p) {
  bus_detach(p);
  p->begun = p->seen = 0;
  p->missed = p->pace_ns = p->exchanged_ns = p->reclaimed_ns = 0;
  p->owed = 0;
  p->lost = 0;
  p->state = PLANT_INSTANTIATED;
  plant_start_values(p);
  return PLANT_OK;
}

/* --- a bus that is missing or fails ---------------------------------------------------------- */

/* Whether time may mend it. A wrong bus, an output of somebody else, or a missing right are not of
 * this kind. */
static int passes(int code) {
  return code == ECAT_EDOWN || code == ECAT_ESTALE || code == ECAT_ETIMEOUT || code == ECAT_ELEASE;
}

/* Connects again. The client itself goes on with a bus that came back as it was. */
static int reconnect(plant *p) {
  int code;
  if (p->bus != NULL) {
    code = ecat_sample(p->bus);
    if (code == 0) return 0;
    if (code != ECAT_EBUS) return plant_note(p, code, "%s", ecat_error(p->bus));
    bus_detach(p); /* it came back otherwise: perhaps what this FMU uses is still the same */
  }
  return bus_attach(p);
}

/* Hands the inputs over. Outputs that were lost are claimed again, but not too often: what is written
 * until then goes nowhere. */
static int write_inputs(plant *p) {
  uint64_t now = plant_now(), since = now - p->reclaimed_ns;
  int code;
  if (p->lost && since < RECLAIM_NS) return 0;
  code = bus_write(p);
  if (code == ECAT_ELEASE && plant_integer(p, ROLE_WHEN_FAILED) != FAILURE_ERROR) {
    p->lost = 1;
    if (since < RECLAIM_NS) return 0;
    if (since > QUIET_NS) plant_say(p, PLANT_WARNING, "%s; this FMU does so", p->message);
    p->reclaimed_ns = now;
    code = bus_write(p);
    if (code == ECAT_ELEASE) return 0;
  }
  if (code == 0) p->lost = 0;
  return code;
}

/* What a step does with the bus. */
static int exchange(plant *p, uint64_t cycles) {
  int code = p->connected ? 0 : reconnect(p);
  if (code == 0) code = write_inputs(p);
  if (code == 0) code = bus_wait(p, cycles);
  return code == 0 ? bus_sample(p) : code;
}

/* Tries until it succeeds or the patience is at its end. */
static int wait_for_bus(plant *p, int code) {
  double patience = plant_real(p, ROLE_PATIENCE), waited = 0;
  uint64_t since = plant_now();
  plant_say(p, PLANT_WARNING, "%s; waiting for it", p->message);
  while (passes(code) && (patience <= 0 || waited < patience)) {
    sleep_until(plant_now() + LOOK_AGAIN_NS);
    p->connected = 0;
    code = p->begun ? exchange(p, 0) : reconnect(p);
    if (code == 0 && !p->begun) code = bus_sample(p);
    waited = (double)(plant_now() - since) * 1e-9;
  }
  if (passes(code)) {
    char why[sizeof p->message / 2];
    snprintf(why, sizeof why, "%.*s", (int)sizeof why - 1, p->message);
    plant_note(p, code, "%s; it was waited for %.1f s, as long as 'patience' allows", why, waited);
  }
  return code;
}

/* Notes that the bus delivers. */
static int delivered(plant *p) {
  if (!p->connected)
    plant_event(p, "attached to bus '%s', cycle %ld", p->bus_name,
                (long)plant_integer(p, ROLE_CYCLE));
  p->connected = p->seen = 1;
  p->pace_ns = 0;
  return PLANT_OK;
}

/* Goes on without the bus. */
static int go_on(plant *p, int code, double step) {
  if (p->connected || !p->begun)
    plant_say(p, PLANT_WARNING, "%s; going on without it", p->message);
  p->connected = 0;
  bus_invalidate(p, code);
  pace(p, step);
  return PLANT_OK;
}

/* What comes of an exchange that ended with `code`, by the parameters. */
static int settle(plant *p, int code, double step) {
  int64_t wanted = plant_integer(p, p->seen ? ROLE_WHEN_FAILED : ROLE_WHEN_MISSING);
  if (passes(code) && wanted == FAILURE_WAIT) code = wait_for_bus(p, code);
  if (code == 0) return delivered(p);
  return passes(code) && wanted == FAILURE_CONTINUE ? go_on(p, code, step) : fail(p, code);
}

/* --- initialization and steps ---------------------------------------------------------------- */

int plant_begin(plant *p) {
  int code = bus_attach(p), status;
  if (code == 0) code = bus_sample(p);
  status = settle(p, code, 0);
  p->begun = 1;
  return status;
}

int plant_leave_initialization(plant *p) {
  int status = p->begun ? PLANT_OK : plant_begin(p);
  if (status == PLANT_OK) p->state = PLANT_STEPS;
  return status;
}

int plant_step(plant *p, double time, double step) {
  double cycles = 0;
  int status;
  if (!(isfinite(time) && isfinite(step) && step > 0))
    return plant_say(p, PLANT_ERROR, "doStep: from %g s, for %g s, is no communication step", time,
                     step);
  if (p->connected && plant_integer(p, ROLE_WAIT_FOR_BUS)) {
    p->owed += fmin(step / ecat_cycle_time(p->bus), 1e15);
    cycles = fmax(floor(p->owed + ROUNDING), 0);
    p->owed -= cycles;
  }
  status = settle(p, exchange(p, (uint64_t)cycles), step);
  if (status == PLANT_OK) p->time = time + step;
  return status;
}
