/* The functions of FMI 2.0 (co-simulation). */
#include <stdlib.h>

#include "plant.h"
#include "fmi/fmi2Functions.h"

#define STATE(name) (1u << PLANT_##name)
#define ALWAYS (STATE(INSTANTIATED) | STATE(INITIALIZATION) | STATE(STEPS) | STATE(TERMINATED) | \
                STATE(FAILED))
#define SETTINGS (STATE(INSTANTIATED) | STATE(INITIALIZATION) | STATE(STEPS))

typedef struct instance {
  plant *plant; /* first: fmi2_refused.c relies on it */
  char *name;
  fmi2CallbackLogger logger;
  fmi2ComponentEnvironment environment;
} instance;

static void write_log(void *context, enum plant_status status, const char *category,
                      const char *message) {
  const instance *self = context;
  if (self->logger != NULL)
    self->logger(self->environment, self->name, (fmi2Status)status, category, "%s", message);
}

static char *copy(const char *text) {
  size_t length = 0;
  char *result;
  if (text == NULL) text = "";
  while (text[length] != '\0') length++;
  result = malloc(length + 1);
  if (result != NULL)
    do result[length] = text[length];
    while (length-- > 0);
  return result;
}

/* Returns the plant if the call is allowed now, else NULL after a message. */
static plant *allowed(fmi2Component c, const char *call, unsigned states) {
  const instance *self = c;
  if (self == NULL) return NULL;
  return plant_allow(self->plant, call, states) == PLANT_OK ? self->plant : NULL;
}

static plant *listed(fmi2Component c, const char *call, unsigned states, size_t count,
                     const void *references, const void *values) {
  plant *p = allowed(c, call, states);
  if (p == NULL || count == 0 || (references != NULL && values != NULL)) return p;
  plant_say(p, PLANT_ERROR, "%s: a list is a null pointer", call);
  return NULL;
}

static fmi2Status worse(fmi2Status a, int b) { return b > (int)a ? (fmi2Status)b : a; }

/* --- life ---------------------------------------------------------------------------------- */

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid,
                              fmi2String resources, const fmi2CallbackFunctions *functions,
                              fmi2Boolean visible, fmi2Boolean logging) {
  instance *self = calloc(1, sizeof *self);
  (void)visible;
  if (self == NULL) return NULL;
  self->name = copy(name);
  if (functions != NULL) {
    self->logger = functions->logger;
    self->environment = functions->componentEnvironment;
  }
  if (type != fmi2CoSimulation)
    write_log(self, PLANT_ERROR, "logStatusError", "this FMU is for co-simulation only");
  else if (self->name != NULL)
    self->plant = plant_new(guid, resources, write_log, self, logging != fmi2False);
  if (self->plant != NULL) return self;
  free(self->name);
  free(self);
  return NULL;
}

void fmi2FreeInstance(fmi2Component c) {
  instance *self = c;
  if (self == NULL) return;
  plant_free(self->plant);
  free(self->name);
  free(self);
}

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean logging, size_t count,
                               const fmi2String categories[]) {
  plant *p = listed(c, "fmi2SetDebugLogging", ALWAYS, count, categories, categories);
  return p == NULL ? fmi2Error
                   : (fmi2Status)plant_log_categories(p, logging != fmi2False, count, categories);
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean has_tolerance, fmi2Real tolerance,
                               fmi2Real start, fmi2Boolean has_stop, fmi2Real stop) {
  plant *p = allowed(c, "fmi2SetupExperiment", STATE(INSTANTIATED));
  (void)has_tolerance, (void)tolerance, (void)has_stop, (void)stop;
  if (p == NULL) return fmi2Error;
  p->time = start;
  return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c) {
  plant *p = allowed(c, "fmi2EnterInitializationMode", STATE(INSTANTIATED));
  if (p == NULL) return fmi2Error;
  p->state = PLANT_INITIALIZATION;
  return fmi2OK;
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
  plant *p = allowed(c, "fmi2ExitInitializationMode", STATE(INITIALIZATION));
  return p == NULL ? fmi2Error : (fmi2Status)plant_leave_initialization(p);
}

fmi2Status fmi2Terminate(fmi2Component c) {
  plant *p = allowed(c, "fmi2Terminate", STATE(STEPS) | STATE(FAILED));
  return p == NULL ? fmi2Error : (fmi2Status)plant_terminate(p);
}

fmi2Status fmi2Reset(fmi2Component c) {
  plant *p = allowed(c, "fmi2Reset", ALWAYS);
  return p == NULL ? fmi2Error : (fmi2Status)plant_reset(p);
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean no_set_state) {
  plant *p = allowed(c, "fmi2DoStep", STATE(STEPS));
  (void)no_set_state;
  return p == NULL ? fmi2Error : (fmi2Status)plant_step(p, time, step);
}

/* --- values -------------------------------------------------------------------------------- */

#define ACCESS(Name, CType, TYPE, member, stored)                                                 \
  fmi2Status fmi2Get##Name(fmi2Component c, const fmi2ValueReference references[], size_t count,  \
                           CType values[]) {                                                      \
    plant *p = listed(c, "fmi2Get" #Name, ALWAYS, count, references, values);                     \
    fmi2Status status = p == NULL ? fmi2Error : fmi2OK;                                           \
    size_t i;                                                                                     \
    for (i = 0; i < count && status < fmi2Error; i++) {                                           \
      plant_value value = {0, 0};                                                                 \
      status = worse(status, plant_get(p, references[i], TYPE, &value));                          \
      if (status < fmi2Error) values[i] = (CType)value.member;                                    \
    }                                                                                             \
    return status;                                                                                \
  }                                                                                               \
  fmi2Status fmi2Set##Name(fmi2Component c, const fmi2ValueReference references[], size_t count,  \
                           const CType values[]) {                                                \
    plant *p = listed(c, "fmi2Set" #Name, SETTINGS, count, references, values);                   \
    fmi2Status status = p == NULL ? fmi2Error : fmi2OK;                                           \
    size_t i;                                                                                     \
    for (i = 0; i < count && status < fmi2Error; i++) {                                           \
      plant_value value = {0, 0};                                                                 \
      value.member = stored;                                                                      \
      status = worse(status, plant_set(p, references[i], TYPE, value));                           \
    }                                                                                             \
    return status;                                                                                \
  }

ACCESS(Real, fmi2Real, PLANT_REAL, real, values[i])
ACCESS(Integer, fmi2Integer, PLANT_INTEGER, integer, values[i])
ACCESS(Boolean, fmi2Boolean, PLANT_BOOLEAN, integer, values[i] != fmi2False)

fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference references[], size_t count,
                         fmi2String values[]) {
  plant *p = listed(c, "fmi2GetString", ALWAYS, count, references, values);
  fmi2Status status = p == NULL ? fmi2Error : fmi2OK;
  size_t i;
  for (i = 0; i < count && status < fmi2Error; i++)
    status = worse(status, plant_get_string(p, references[i], &values[i]));
  return status;
}

fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference references[], size_t count,
                         const fmi2String values[]) {
  plant *p = listed(c, "fmi2SetString", SETTINGS, count, references, values);
  fmi2Status status = p == NULL ? fmi2Error : fmi2OK;
  size_t i;
  for (i = 0; i < count && status < fmi2Error; i++)
    status = worse(status, plant_set_string(p, references[i], values[i]));
  return status;
}
