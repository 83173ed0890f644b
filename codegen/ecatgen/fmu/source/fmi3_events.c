/* The functions of FMI 3.0 for events, clocks and binary variables. Only an FMU with bus terminals has them. */
#include <math.h>
#include <stddef.h>

#include "ls_bus.h"
#include "fmi/fmi3Functions.h"

#define STATE(name) (1u << PLANT_##name)
#define ANY (STATE(INSTANTIATED) | STATE(INITIALIZATION) | STATE(STEPS) | STATE(EVENTS))
#define NS 1000000000u

/* Returns the plant if it has bus terminals and the call is allowed now, else NULL after a message. */
static plant *allowed(fmi3Instance c, const char *call, unsigned states) {
  plant *const *self = c; /* the first member of an instance */
  if (self == NULL) return NULL;
  if ((*self)->ls_bus != NULL) return plant_allow(*self, call, states) == PLANT_OK ? *self : NULL;
  plant_say(*self, PLANT_ERROR, "%s is not supported by this FMU", call);
  return NULL;
}

static plant *listed(fmi3Instance c, const char *call, unsigned states, size_t count, const void *references,
                     const void *values, const void *others) {
  plant *p = allowed(c, call, states);
  if (p == NULL || count == 0 || (references != NULL && values != NULL && others != NULL)) return p;
  plant_say(p, PLANT_ERROR, "%s: a list is a null pointer", call);
  return NULL;
}

/* --- modes ------------------------------------------------------------------------------------ */

static fmi3Status enter(fmi3Instance c, const char *call, enum plant_state from, enum plant_state to) {
  plant *p = allowed(c, call, 1u << from);
  if (p == NULL) return fmi3Error;
  p->state = to;
  return fmi3OK;
}

fmi3Status fmi3EnterEventMode(fmi3Instance c) { return enter(c, "fmi3EnterEventMode", PLANT_STEPS, PLANT_EVENTS); }

fmi3Status fmi3EnterStepMode(fmi3Instance c) { return enter(c, "fmi3EnterStepMode", PLANT_EVENTS, PLANT_STEPS); }

fmi3Status fmi3EvaluateDiscreteStates(fmi3Instance c) { /* no output of an event depends on an input of it */
  return allowed(c, "fmi3EvaluateDiscreteStates", STATE(INITIALIZATION) | STATE(EVENTS)) == NULL ? fmi3Error : fmi3OK;
}

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance c, fmi3Boolean *need_update, fmi3Boolean *terminate,
                                    fmi3Boolean *nominals_changed, fmi3Boolean *values_changed,
                                    fmi3Boolean *next_defined, fmi3Float64 *next) {
  plant *p = allowed(c, "fmi3UpdateDiscreteStates", STATE(EVENTS));
  (void)next;
  if (p == NULL) return fmi3Error;
  if (need_update != NULL) *need_update = fmi3False;
  if (terminate != NULL) *terminate = fmi3False;
  if (nominals_changed != NULL) *nominals_changed = fmi3False;
  if (values_changed != NULL) *values_changed = fmi3False;
  if (next_defined != NULL) *next_defined = fmi3False;
  return (fmi3Status)plant_update(p);
}

/* --- values ------------------------------------------------------------------------------------ */

/* Carries out `action` for each of `count` variables, until one fails. */
#define FOR_ALL(p, count, action)                                                 \
  do {                                                                            \
    int status = PLANT_OK;                                                        \
    size_t i;                                                                     \
    if ((p) == NULL) return fmi3Error;                                            \
    for (i = 0; i < (count) && status == PLANT_OK; i++) { action; }               \
    return (fmi3Status)status;                                                    \
  } while (0)

fmi3Status fmi3GetClock(fmi3Instance c, const fmi3ValueReference references[], size_t count, fmi3Clock values[]) {
  plant *p = listed(c, "fmi3GetClock", STATE(INITIALIZATION) | STATE(EVENTS), count, references, values, values);
  int active = 0;
  FOR_ALL(p, count, status = ls_bus_get_clock(p, references[i], &active); values[i] = active != 0);
}

fmi3Status fmi3SetClock(fmi3Instance c, const fmi3ValueReference references[], size_t count,
                        const fmi3Clock values[]) {
  plant *p = listed(c, "fmi3SetClock", STATE(EVENTS), count, references, values, values);
  FOR_ALL(p, count, status = ls_bus_set_clock(p, references[i], values[i] != fmi3ClockInactive));
}

static plant *scalar(plant *p, const char *call, size_t count, size_t value_count) {
  if (p == NULL || count == value_count) return p;
  plant_say(p, PLANT_ERROR, "%s: %lu value references, but %lu values: all variables are scalar", call,
            (unsigned long)count, (unsigned long)value_count);
  return NULL;
}

fmi3Status fmi3GetBinary(fmi3Instance c, const fmi3ValueReference references[], size_t count, size_t sizes[],
                         fmi3Binary values[], size_t value_count) {
  plant *p = listed(c, "fmi3GetBinary", ANY | STATE(TERMINATED) | STATE(FAILED), count, references, sizes, values);
  p = scalar(p, "fmi3GetBinary", count, value_count);
  FOR_ALL(p, count, status = ls_bus_get_binary(p, references[i], &values[i], &sizes[i]));
}

fmi3Status fmi3SetBinary(fmi3Instance c, const fmi3ValueReference references[], size_t count, const size_t sizes[],
                         const fmi3Binary values[], size_t value_count) {
  plant *p = listed(c, "fmi3SetBinary", ANY, count, references, sizes, values);
  p = scalar(p, "fmi3SetBinary", count, value_count);
  FOR_ALL(p, count, status = values[i] == NULL && sizes[i] > 0
                                 ? plant_say(p, PLANT_ERROR, "fmi3SetBinary: a value is a null pointer")
                                 : ls_bus_set_binary(p, references[i], values[i], sizes[i]));
}

/* --- when a Tx_Clock is to tick ---------------------------------------------------------------- */

fmi3Status fmi3GetIntervalDecimal(fmi3Instance c, const fmi3ValueReference references[], size_t count,
                                  fmi3Float64 intervals[], fmi3IntervalQualifier qualifiers[]) {
  plant *p = listed(c, "fmi3GetIntervalDecimal", ANY, count, references, intervals, qualifiers);
  int changed = 0;
  FOR_ALL(p, count, status = ls_bus_get_interval(p, references[i], &intervals[i], &changed);
          qualifiers[i] = changed ? fmi3IntervalChanged : fmi3IntervalUnchanged);
}

fmi3Status fmi3GetIntervalFraction(fmi3Instance c, const fmi3ValueReference references[], size_t count,
                                   fmi3UInt64 counters[], fmi3UInt64 resolutions[],
                                   fmi3IntervalQualifier qualifiers[]) {
  plant *p = listed(c, "fmi3GetIntervalFraction", ANY, count, references, counters, resolutions);
  double interval = 0;
  int changed = 0;
  if (p != NULL) p = listed(c, "fmi3GetIntervalFraction", ANY, count, references, qualifiers, qualifiers);
  FOR_ALL(p, count, status = ls_bus_get_interval(p, references[i], &interval, &changed);
          counters[i] = (fmi3UInt64)llround(fmin(interval, 1e9) * NS); resolutions[i] = NS;
          qualifiers[i] = changed ? fmi3IntervalChanged : fmi3IntervalUnchanged);
}
