/* The values of variables, which importers get and set. */
#include "plant.h"
#include "ls_bus.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static int is_parameter(const plant_variable *v) {
  return (v->role >= ROLE_BUS && v->role <= ROLE_REQUIRE_OPERATIONAL) || v->role == ROLE_INTERVAL;
}

static plant_variable *by_role(const plant *p, enum plant_role role) {
  size_t i = 0;
  while (p->variables[i].role != role) i++; /* ends: plant_load() has checked that these roles exist */
  return &p->variables[i];
}

double plant_real(const plant *p, enum plant_role role) { return by_role(p, role)->value.real; }

int64_t plant_integer(const plant *p, enum plant_role role) {
  return by_role(p, role)->value.integer;
}

void plant_publish(plant *p, enum plant_role role, double real, int64_t integer) {
  plant_value *value = &by_role(p, role)->value;
  value->real = real;
  value->integer = integer;
}

/* The entry of an input, or what is like one. */
static const ecat_signal_info *entry_of(const plant_variable *v) {
  return v->role == ROLE_CAN_INPUT ? &v->signal.as_entry : &v->on_bus.expected;
}

static void write_signal(plant_variable *v) {
  if (v->type == PLANT_REAL)
    ecat_session_can_write(&v->signal, v->value.real);
  else
    ecat_session_can_write_int(&v->signal, v->value.integer);
}

void plant_start_values(plant *p) {
  size_t i;
  for (i = 0; i < p->variable_count; i++) {
    p->variables[i].value = p->variables[i].start;
    p->variables[i].on_bus.pending = 0;
    if (p->variables[i].role == ROLE_CAN_INPUT) write_signal(&p->variables[i]);
    if (p->variables[i].role == ROLE_CAN_AGE) p->variables[i].value.real = ECAT_AGE_NEVER;
  }
  for (i = 0; i < p->message_count; i++) p->messages[i].active = 0;
  drives_begin(p);
  plant_publish(p, ROLE_AGE, ECAT_AGE_NEVER, 0);
  for (i = 0; i < p->slave_count; i++) p->slaves[i].on_bus.writes = 0;
  if (p->ls_bus != NULL) ls_bus_clear(p->ls_bus);
  free(p->bus_name);
  p->bus_name = strdup(p->bus_start);
}

/* Returns the variable, or NULL after a message. */
static plant_variable *find(plant *p, unsigned reference, enum plant_type type, const char *call) {
  plant_variable *v = reference < p->variable_count ? &p->variables[reference] : NULL;
  if (v == NULL)
    plant_say(p, PLANT_ERROR, "%s: there is no variable with value reference %u; the last one is %lu",
              call, reference, (unsigned long)p->variable_count - 1);
  else if (v->type != type) {
    plant_say(p, PLANT_ERROR, "%s: the variable '%s' (value reference %u) has another type", call,
              v->name, reference);
    v = NULL;
  }
  return v;
}

static int is_input(const plant_variable *v) {
  return v->role == ROLE_INPUT || v->role == ROLE_CAN_INPUT ||
         (v->role >= ROLE_DRIVE_ENABLE && v->role <= ROLE_DRIVE_TORQUE_REFERENCE);
}

/* Connects to the bus during the initialization, if necessary: outputs have values from then on. */
static int ready(plant *p) {
  return p->state == PLANT_INITIALIZATION && !p->begun ? plant_begin(p) : PLANT_OK;
}

int plant_get(plant *p, unsigned reference, enum plant_type type, plant_value *value) {
  const plant_variable *v = find(p, reference, type, "get");
  if (v == NULL) return PLANT_ERROR;
  if (!is_parameter(v) && v->role != ROLE_TIME && !is_input(v) && ready(p) != PLANT_OK)
    return PLANT_ERROR;
  *value = v->value;
  if (v->role == ROLE_TIME) value->real = p->time;
  return PLANT_OK;
}

int plant_get_string(plant *p, unsigned reference, const char **value) {
  if (find(p, reference, PLANT_STRING, "get") == NULL) return PLANT_ERROR;
  *value = p->bus_name;
  return PLANT_OK;
}

/* Whether a variable may be set now. Setting a parameter ends the connection, if there is one. */
static int settable(plant *p, const plant_variable *v) {
  if (is_input(v)) return PLANT_OK;
  if (!is_parameter(v))
    return plant_say(p, PLANT_ERROR, "set: '%s' cannot be set: it is no input and no parameter",
                     v->name);
  if (p->state != PLANT_INSTANTIATED && p->state != PLANT_INITIALIZATION)
    return plant_say(p, PLANT_ERROR, "set: the parameter '%s' is fixed: it can be set until the "
                     "initialization ends", v->name);
  plant_detach(p);
  return PLANT_OK;
}

static int refuse(plant *p, const plant_variable *v, double value) {
  double low, high;
  ecat_limits(entry_of(v), &low, &high);
  return plant_say(p, PLANT_DISCARD, "set: '%s' cannot be %.15g: %.15g to %.15g are allowed; it keeps "
                   "its value", v->name, value, low, high);
}

/* Whether a parameter can have this value. */
static int acceptable_parameter(plant *p, const plant_variable *v, double number) {
  int failure = v->role == ROLE_WHEN_MISSING || v->role == ROLE_WHEN_FAILED;
  if (failure && (number < ECAT_FAILURE_ERROR || number > ECAT_FAILURE_CONTINUE))
    return plant_say(p, PLANT_DISCARD, "set: '%s' cannot be %g: 1 is Error, 2 Wait, 3 Continue",
                     v->name, number);
  if (number < 0 || (v->role == ROLE_INTERVAL && number == 0))
    return plant_say(p, PLANT_DISCARD, "set: '%s' cannot be %g: it is a time", v->name, number);
  return PLANT_OK;
}

/* Whether an entry, or a parameter, can have this value. */
static int acceptable(plant *p, const plant_variable *v, plant_value value) {
  double number = v->type == PLANT_REAL     ? value.real
                  : v->type == PLANT_UINT64 ? (double)(uint64_t)value.integer
                                            : (double)value.integer;
  uint64_t bits;
  int code;
  if (v->type == PLANT_REAL && !isfinite(number))
    return plant_say(p, PLANT_DISCARD, "set: '%s' cannot be %g: it is no finite number; it keeps its "
                     "value", v->name, number);
  if (is_parameter(v)) return acceptable_parameter(p, v, number);
  if (v->role == ROLE_DRIVE_MODE && !drives_can(&p->drives[v->drive - 1], value.integer))
    return plant_say(p, PLANT_DISCARD, "set: '%s' cannot be %g: the process data of the slave have no target for it; it "
                     "keeps its value", v->name, number);
  if (v->role >= ROLE_DRIVE_ENABLE && v->role <= ROLE_DRIVE_TORQUE_REFERENCE) return PLANT_OK;
  if (v->type != PLANT_REAL)
    code = ecat_encode_int(entry_of(v), value.integer, &bits);
  else
    code = ecat_encode_physical(entry_of(v), number, &bits);
  return code == 0 ? PLANT_OK : refuse(p, v, number);
}

int plant_set(plant *p, unsigned reference, enum plant_type type, plant_value value) {
  plant_variable *v = find(p, reference, type, "set");
  int status;
  if (v == NULL) return PLANT_ERROR;
  if ((status = settable(p, v)) != PLANT_OK || (status = acceptable(p, v, value)) != PLANT_OK)
    return status;
  v->value = value;
  if (v->role == ROLE_CAN_INPUT) {
    write_signal(v);
    p->messages[v->message].active = 1;
  }
  if (v->role != ROLE_INPUT) {
    /* Not by any input: Simulink sets all of them from the first step on, also for a model that uses the raw ones. */
    if (v->role == ROLE_DRIVE_ENABLE && value.integer != 0) p->drives[v->drive - 1].active = 1;
    return PLANT_OK;
  }
  if (v->drive > 0 && p->drives[v->drive - 1].active) {
    if (!p->drives[v->drive - 1].told)
      plant_say(p, PLANT_WARNING, "set: '%s' has no effect, since the inputs of the drive decide about it: set only one of "
                "both kinds", v->name);
    p->drives[v->drive - 1].told = 1;
    return PLANT_OK;
  }
  if (type == PLANT_REAL)
    ecat_session_write(&v->on_bus, value.real);
  else
    ecat_session_write_int(&v->on_bus, value.integer);
  p->slaves[v->slave].on_bus.writes = 1;
  return PLANT_OK;
}

int plant_set_string(plant *p, unsigned reference, const char *value) {
  const plant_variable *v = find(p, reference, PLANT_STRING, "set");
  char *copy;
  int status;
  if (v == NULL) return PLANT_ERROR;
  if (value == NULL) return plant_say(p, PLANT_ERROR, "set: '%s' is a null pointer", v->name);
  if ((status = settable(p, v)) != PLANT_OK) return status;
  if ((copy = strdup(value)) == NULL) return plant_say(p, PLANT_FATAL, "out of memory");
  free(p->bus_name);
  p->bus_name = copy;
  return PLANT_OK;
}
