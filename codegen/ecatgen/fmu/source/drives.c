/* Drives with the device profile CiA 402: their variables in SI units, beside the raw ones of the slave. A drive
 * becomes active when the importer enables it for the first time; then it writes the raw inputs of its axis. */
#include "plant.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

enum { AXIS_OBJECTS = 0x800 }; /* the second axis has its objects 0x800 higher (ETG.6010) */

/* The objects of an axis, and where their raw values are. */
struct object {
  unsigned index;
  size_t member;
  int entry; /* enum ecat_drive_entries, of inputs of the drive */
};

#define IN(member) offsetof(ecat_drive_inputs, member)
#define OUT(member) offsetof(ecat_drive_outputs, member)

static const struct object WRITTEN[PLANT_DRIVE_WRITTEN] = {
    {0x6040, OUT(control), 0},          {0x6060, OUT(mode), 0},
    {0x607A, OUT(position), 0},         {0x60FF, OUT(velocity), 0},
    {0x6071, OUT(torque), 0},           {0x6072, OUT(max_torque), 0},
    {0x6081, OUT(profile_velocity), 0}, {0x6083, OUT(profile_acceleration), 0},
    {0x6084, OUT(profile_acceleration), 0},
};
static const struct object READ[PLANT_DRIVE_READ] = {
    {0x6041, IN(status), 0},
    {0x6061, IN(display), ECAT_DRIVE_HAS_MODE_DISPLAY},
    {0x6064, IN(position), ECAT_DRIVE_HAS_POSITION},
    {0x606C, IN(velocity), ECAT_DRIVE_HAS_VELOCITY},
    {0x6077, IN(torque), ECAT_DRIVE_HAS_TORQUE},
    {0x6078, IN(current), ECAT_DRIVE_HAS_CURRENT},
    {0x603F, IN(error), ECAT_DRIVE_HAS_ERROR_CODE},
};

static plant_variable *find(plant *p, const plant_drive *drive, unsigned index, enum plant_role role) {
  size_t i;
  for (i = 0; i < p->variable_count; i++) {
    plant_variable *v = &p->variables[i];
    if (v->role == role && v->slave == drive->slave && v->on_bus.expected.subindex == 0 &&
        v->on_bus.expected.index == index + AXIS_OBJECTS * (unsigned)(drive->axis - 1))
      return v;
  }
  return NULL;
}

static void settings_of(const plant *p, const plant_drive *drive, ecat_drive_settings *settings) {
  int i;
  ecat_drive_defaults(settings, 1);
  settings->name = p->slaves[drive->slave].label;
  settings->reference = ECAT_DRIVE_ABSOLUTE;
  settings->entries = 0;
  for (i = 0; i < PLANT_DRIVE_READ; i++)
    if (drive->read[i] != NULL) settings->entries |= READ[i].entry;
  settings->changes_mode = 1;
  settings->position_scale = drive->scales[0];
  settings->velocity_scale = drive->scales[1];
  settings->torque_scale = drive->scales[2];
  settings->current_scale = drive->scales[3];
  settings->max_torque = 1000 * fabs(drive->scales[2]); /* the rated torque (CiA 402-2, object 0x6072) */
  settings->approach_speed = drive->linear ? 0.1 : 1;
  settings->approach_acceleration = drive->linear ? 1 : 10;
  settings->window = drive->linear ? 1e-4 : 0.01;
  settings->standstill_speed = drive->linear ? 1e-3 : 0.05;
  settings->max_dropout = 0.1;
}

int drives_found(plant *p) {
  size_t n;
  int i;
  for (n = 0; n < p->drive_count; n++) {
    plant_drive *drive = &p->drives[n];
    for (i = 0; i < PLANT_DRIVE_WRITTEN; i++) {
      drive->written[i] = find(p, drive, WRITTEN[i].index, ROLE_INPUT);
      if (drive->written[i] != NULL) drive->written[i]->drive = (int)n + 1;
    }
    for (i = 0; i < PLANT_DRIVE_READ; i++) drive->read[i] = find(p, drive, READ[i].index, ROLE_OUTPUT);
    if (drive->written[0] == NULL || drive->written[1] == NULL || drive->read[0] == NULL || drive->read[2] == NULL)
      return -1;
  }
  return 0;
}

void drives_begin(plant *p) {
  ecat_drive_settings settings;
  size_t n;
  for (n = 0; n < p->drive_count; n++) {
    settings_of(p, &p->drives[n], &settings);
    ecat_drive_init(&p->drives[n].drive, &settings);
    p->drives[n].active = p->drives[n].told = 0;
  }
}

/* --- the request ------------------------------------------------------------------------------ */

static const int MODES[] = {ECAT_DRIVE_PROFILE_POSITION, ECAT_DRIVE_PROFILE_VELOCITY, ECAT_DRIVE_PROFILE_TORQUE,
                            ECAT_DRIVE_CYCLIC_POSITION, ECAT_DRIVE_CYCLIC_VELOCITY, ECAT_DRIVE_CYCLIC_TORQUE};

int drives_can(const plant_drive *drive, int64_t mode) {
  int number;
  if (mode < 1 || mode > (int64_t)(sizeof MODES / sizeof *MODES)) return 0;
  number = MODES[mode - 1];
  return drive->written[ecat_drive_positions(number) ? 2 : ecat_drive_velocities(number) ? 3 : 4] != NULL;
}

static void ask(const plant *p, size_t n, ecat_drive_request *request) {
  double targets[3] = {0, 0, 0};
  size_t i;
  int home = 0;
  memset(request, 0, sizeof *request);
  request->ready = 1;
  for (i = 0; i < p->variable_count; i++) {
    const plant_variable *v = &p->variables[i];
    if (v->role < ROLE_DRIVE_ENABLE || v->role > ROLE_DRIVE_TORQUE_REFERENCE || v->drive != (int)n + 1) continue;
    if (v->role == ROLE_DRIVE_ENABLE) request->enable = v->value.integer != 0;
    if (v->role == ROLE_DRIVE_QUICK_STOP) request->quick_stop = v->value.integer != 0;
    if (v->role == ROLE_DRIVE_FAULT_RESET) request->fault_reset = v->value.integer != 0;
    if (v->role == ROLE_DRIVE_HOME) home = v->value.integer != 0;
    if (v->role == ROLE_DRIVE_MODE) request->mode = MODES[v->value.integer - 1];
    if (v->role >= ROLE_DRIVE_POSITION_REFERENCE) targets[v->role - ROLE_DRIVE_POSITION_REFERENCE] = v->value.real;
  }
  request->target = targets[ecat_drive_positions(request->mode) ? 0 : ecat_drive_velocities(request->mode) ? 1 : 2];
  request->home = home;
  if (home && p->drives[n].drive.view.state == ECAT_DRIVE_OPERATION) request->mode = ECAT_DRIVE_HOMING;
}

static void write_raw(plant_variable *v, int raw) {
  const ecat_signal_info *expected = &v->on_bus.expected;
  if (v->type == PLANT_REAL) {
    v->value.real = ecat_to_physical(raw, expected->scale, expected->offset);
    ecat_session_write(&v->on_bus, v->value.real);
  } else {
    v->value.integer = raw;
    ecat_session_write_int(&v->on_bus, raw);
  }
}

void drives_command(plant *p) {
  size_t n;
  int i;
  for (n = 0; n < p->drive_count; n++) {
    plant_drive *drive = &p->drives[n];
    ecat_drive_request request;
    ecat_drive_outputs outputs;
    if (!drive->active) continue;
    ask(p, n, &request);
    if (ecat_drive_command(&drive->drive, p->time, &request, &outputs) != 0) continue; /* no finite number is set */
    for (i = 0; i < PLANT_DRIVE_WRITTEN; i++) {
      int raw = *(const int *)(const void *)((const char *)&outputs + WRITTEN[i].member);
      if (drive->written[i] != NULL) write_raw(drive->written[i], raw);
    }
    p->slaves[drive->slave].on_bus.writes = 1;
  }
}

/* --- what drives say -------------------------------------------------------------------------- */

static void publish(plant *p, size_t n, const ecat_drive *drive) {
  size_t i;
  for (i = 0; i < p->variable_count; i++) {
    plant_variable *v = &p->variables[i];
    if (v->role < ROLE_DRIVE_POSITION || v->role > ROLE_DRIVE_ERROR_CODE || v->drive != (int)n + 1) continue;
    if (v->role == ROLE_DRIVE_POSITION) v->value.real = drive->view.position;
    if (v->role == ROLE_DRIVE_SPEED) v->value.real = drive->view.speed;
    if (v->role == ROLE_DRIVE_TORQUE) v->value.real = drive->view.torque;
    if (v->role == ROLE_DRIVE_ENABLED)
      v->value.integer = drive->view.enabled && drive->order.request.mode != ECAT_DRIVE_HOMING;
    if (v->role == ROLE_DRIVE_HOMED) v->value.integer = drive->order.homing == ECAT_DRIVE_HOMED;
    if (v->role == ROLE_DRIVE_REACHED) v->value.integer = drive->order.reached;
    if (v->role == ROLE_DRIVE_STATE) v->value.integer = drive->view.state;
    if (v->role == ROLE_DRIVE_ERROR_CODE) v->value.integer = drive->view.raw.error & 0xFFFF;
  }
}

void drives_measure(plant *p, double time) {
  size_t n;
  int i;
  for (n = 0; n < p->drive_count; n++) {
    plant_drive *drive = &p->drives[n];
    ecat_drive_inputs inputs;
    memset(&inputs, 0, sizeof inputs);
    inputs.valid = p->slaves[drive->slave].on_bus.valid;
    inputs.losses = p->session.losses;
    for (i = 0; i < PLANT_DRIVE_READ; i++) {
      int64_t raw = 0;
      if (drive->read[i] == NULL) continue;
      if (ecat_session_read_int(&drive->read[i]->on_bus, &raw) != 0) inputs.valid = 0;
      *(int *)(void *)((char *)&inputs + READ[i].member) = (int)raw;
    }
    ecat_drive_measure(&drive->drive, time, &inputs);
    publish(p, n, &drive->drive);
  }
}
