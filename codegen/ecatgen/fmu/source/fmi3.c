/* The functions of FMI 3.0 (co-simulation). */
#include <stdlib.h>

#include "ls_bus.h"
#include "fmi/fmi3Functions.h"

#define STATE(name) (1u << PLANT_##name)
#define ALWAYS (SETTINGS | STATE(TERMINATED) | STATE(FAILED))
#define SETTINGS (STATE(INSTANTIATED) | STATE(INITIALIZATION) | STATE(STEPS) | STATE(EVENTS))

typedef struct instance {
  plant *plant; /* first: fmi3_refused.c relies on it */
  fmi3LogMessageCallback log;
  fmi3InstanceEnvironment environment;
} instance;

static void write_log(void *context, enum plant_status status, const char *category,
                      const char *message) {
  const instance *self = context;
  if (self->log != NULL) self->log(self->environment, (fmi3Status)status, category, message);
}

/* Returns the plant if the call is allowed now, else NULL after a message. */
static plant *allowed(fmi3Instance c, const char *call, unsigned states) {
  const instance *self = c;
  if (self == NULL) return NULL;
  return plant_allow(self->plant, call, states) == PLANT_OK ? self->plant : NULL;
}

static plant *listed(fmi3Instance c, const char *call, unsigned states, size_t count,
                     const void *references, const void *values, size_t value_count) {
  plant *p = allowed(c, call, states);
  if (p == NULL) return NULL;
  if (value_count != count) {
    plant_say(p, PLANT_ERROR, "%s: %lu value references, but %lu values: all variables are scalar",
              call, (unsigned long)count, (unsigned long)value_count);
    return NULL;
  }
  if (count == 0 || (references != NULL && values != NULL)) return p;
  plant_say(p, PLANT_ERROR, "%s: a list is a null pointer", call);
  return NULL;
}

static fmi3Status worse(fmi3Status a, int b) { return b > (int)a ? (fmi3Status)b : a; }

/* --- life ---------------------------------------------------------------------------------- */

const char *fmi3GetVersion(void) { return fmi3Version; }

fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean logging, fmi3Boolean event_mode, fmi3Boolean early_return,
    const fmi3ValueReference intermediate[], size_t intermediate_count,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
    fmi3IntermediateUpdateCallback update) {
  instance *self = calloc(1, sizeof *self);
  (void)name, (void)visible, (void)early_return, (void)intermediate, (void)update;
  if (self == NULL) return NULL;
  self->log = log;
  self->environment = environment;
  if (intermediate_count > 0)
    write_log(self, PLANT_ERROR, "logStatusError", "this FMU has no intermediate variables");
  else
    self->plant = plant_new(token, resources, write_log, self, logging);
  if (self->plant != NULL && event_mode == (self->plant->ls_bus != NULL)) return self;
  if (self->plant != NULL)
    write_log(self, PLANT_ERROR, "logStatusError",
              event_mode ? "this FMU has no event mode" : "this FMU has clocks, so it needs the event mode");
  plant_free(self->plant);
  free(self);
  return NULL;
}

void fmi3FreeInstance(fmi3Instance c) {
  instance *self = c;
  if (self == NULL) return;
  plant_free(self->plant);
  free(self);
}

fmi3Status fmi3SetDebugLogging(fmi3Instance c, fmi3Boolean logging, size_t count,
                               const fmi3String categories[]) {
  plant *p = listed(c, "fmi3SetDebugLogging", ALWAYS, count, categories, categories, count);
  return p == NULL ? fmi3Error : (fmi3Status)plant_log_categories(p, logging, count, categories);
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean has_tolerance,
                                       fmi3Float64 tolerance, fmi3Float64 start,
                                       fmi3Boolean has_stop, fmi3Float64 stop) {
  plant *p = allowed(c, "fmi3EnterInitializationMode", STATE(INSTANTIATED));
  (void)has_tolerance, (void)tolerance, (void)has_stop, (void)stop;
  if (p == NULL) return fmi3Error;
  p->state = PLANT_INITIALIZATION;
  p->time = start;
  return fmi3OK;
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance c) {
  plant *p = allowed(c, "fmi3ExitInitializationMode", STATE(INITIALIZATION));
  return p == NULL ? fmi3Error : (fmi3Status)plant_leave_initialization(p);
}

fmi3Status fmi3Terminate(fmi3Instance c) {
  plant *p = allowed(c, "fmi3Terminate", STATE(STEPS) | STATE(EVENTS) | STATE(FAILED));
  return p == NULL ? fmi3Error : (fmi3Status)plant_terminate(p);
}

fmi3Status fmi3Reset(fmi3Instance c) {
  plant *p = allowed(c, "fmi3Reset", ALWAYS);
  return p == NULL ? fmi3Error : (fmi3Status)plant_reset(p);
}

fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 time, fmi3Float64 step, fmi3Boolean no_set_state,
                      fmi3Boolean *events, fmi3Boolean *terminate, fmi3Boolean *early,
                      fmi3Float64 *reached) {
  plant *p = allowed(c, "fmi3DoStep", STATE(STEPS));
  int status;
  (void)no_set_state;
  if (p == NULL) return fmi3Error;
  status = plant_step(p, time, step);
  if (events != NULL) *events = status == PLANT_OK && ls_bus_has_event(p);
  if (terminate != NULL) *terminate = fmi3False;
  if (early != NULL) *early = fmi3False;
  if (reached != NULL) *reached = p->time;
  return (fmi3Status)status;
}

/* --- values -------------------------------------------------------------------------------- */

#define ACCESS(Name, TYPE, member, stored)                                                         \
  fmi3Status fmi3Get##Name(fmi3Instance c, const fmi3ValueReference references[], size_t count,    \
                           fmi3##Name values[], size_t value_count) {                              \
    plant *p = listed(c, "fmi3Get" #Name, ALWAYS, count, references, values, value_count);         \
    fmi3Status status = p == NULL ? fmi3Error : fmi3OK;                                            \
    size_t i;                                                                                      \
    for (i = 0; i < count && status < fmi3Error; i++) {                                            \
      plant_value value = {0, 0};                                                                  \
      status = worse(status, plant_get(p, references[i], TYPE, &value));                           \
      if (status < fmi3Error) values[i] = (fmi3##Name)value.member;                                \
    }                                                                                              \
    return status;                                                                                 \
  }                                                                                                \
  fmi3Status fmi3Set##Name(fmi3Instance c, const fmi3ValueReference references[], size_t count,    \
                           const fmi3##Name values[], size_t value_count) {                        \
    plant *p = listed(c, "fmi3Set" #Name, SETTINGS, count, references, values, value_count);       \
    fmi3Status status = p == NULL ? fmi3Error : fmi3OK;                                            \
    size_t i;                                                                                      \
    for (i = 0; i < count && status < fmi3Error; i++) {                                            \
      plant_value value = {0, 0};                                                                  \
      value.member = stored;                                                                       \
      status = worse(status, plant_set(p, references[i], TYPE, value));                            \
    }                                                                                              \
    return status;                                                                                 \
  }

ACCESS(Float64, PLANT_REAL, real, values[i])
ACCESS(Boolean, PLANT_BOOLEAN, integer, values[i] != 0)
ACCESS(Int8, PLANT_INT8, integer, values[i])
ACCESS(UInt8, PLANT_UINT8, integer, values[i])
ACCESS(Int16, PLANT_INT16, integer, values[i])
ACCESS(UInt16, PLANT_UINT16, integer, values[i])
ACCESS(Int32, PLANT_INT32, integer, values[i])
ACCESS(UInt32, PLANT_UINT32, integer, values[i])
ACCESS(Int64, PLANT_INT64, integer, values[i])
ACCESS(UInt64, PLANT_UINT64, integer, (int64_t)values[i])

fmi3Status fmi3GetString(fmi3Instance c, const fmi3ValueReference references[], size_t count,
                         fmi3String values[], size_t value_count) {
  plant *p = listed(c, "fmi3GetString", ALWAYS, count, references, values, value_count);
  fmi3Status status = p == NULL ? fmi3Error : fmi3OK;
  size_t i;
  for (i = 0; i < count && status < fmi3Error; i++)
    status = worse(status, plant_get_string(p, references[i], &values[i]));
  return status;
}

fmi3Status fmi3SetString(fmi3Instance c, const fmi3ValueReference references[], size_t count,
                         const fmi3String values[], size_t value_count) {
  plant *p = listed(c, "fmi3SetString", SETTINGS, count, references, values, value_count);
  fmi3Status status = p == NULL ? fmi3Error : fmi3OK;
  size_t i;
  for (i = 0; i < count && status < fmi3Error; i++)
    status = worse(status, plant_set_string(p, references[i], values[i]));
  return status;
}
