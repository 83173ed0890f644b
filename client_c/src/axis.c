/* Axes: drives on a bus. */
#include "axes.h"
#include "axis_units.h"

#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>

enum { AXIS_OBJECTS = 0x800 }; /* the second axis has its objects 0x800 higher (ETG.6010) */

/* An object of CiA 402, and where its value is: in the inputs, or in the outputs. */
struct object {
  unsigned index;
  int output;
  size_t member;
  int entry;    /* enum ecat_drive_entries */
  int quantity; /* of its scale, -1: it has none */
};

#define IN(member) 0, offsetof(ecat_drive_inputs, member)
#define OUT(member) 1, offsetof(ecat_drive_outputs, member)
/* Their numbers in the table. */
enum {
  CONTROL, STATUS, MODE, TARGET_POSITION, TARGET_VELOCITY, TARGET_TORQUE, MAX_TORQUE, FIRST_OF_PROFILE,
  POSITION = 11
};

static const struct object OBJECTS[ECAT_AXIS_OBJECTS] = {
    {0x6040, OUT(control), 0, -1},
    {0x6041, IN(status), 0, -1},
    {0x6060, OUT(mode), 0, -1},
    {0x607A, OUT(position), 0, AXIS_POSITION},
    {0x60FF, OUT(velocity), 0, AXIS_VELOCITY},
    {0x6071, OUT(torque), 0, AXIS_TORQUE},
    {0x6072, OUT(max_torque), 0, AXIS_TORQUE},
    {0x6081, OUT(profile_velocity), 0, AXIS_VELOCITY},
    {0x6083, OUT(profile_acceleration), 0, -1},
    {0x6084, OUT(profile_acceleration), 0, -1},
    {0x6061, IN(display), ECAT_DRIVE_HAS_MODE_DISPLAY, -1},
    {0x6064, IN(position), ECAT_DRIVE_HAS_POSITION, AXIS_POSITION},
    {0x606C, IN(velocity), ECAT_DRIVE_HAS_VELOCITY, AXIS_VELOCITY},
    {0x6077, IN(torque), ECAT_DRIVE_HAS_TORQUE, AXIS_TORQUE},
    {0x6078, IN(current), ECAT_DRIVE_HAS_CURRENT, AXIS_CURRENT},
    {0x603F, IN(error), ECAT_DRIVE_HAS_ERROR_CODE, -1},
};

static unsigned index_of(const ecat_axis *axis, int object) {
  return OBJECTS[object].index + AXIS_OBJECTS * (unsigned)(axis->number - 1);
}

/* --- meaning ---------------------------------------------------------------------------------- */

static const struct axis_unit *find_unit(const char *name) {
  size_t i;
  for (i = 0; i < sizeof UNITS / sizeof *UNITS; i++)
    if (strcmp(UNITS[i].name, name) == 0) return &UNITS[i];
  return NULL;
}

static double *scale_of(ecat_axis *axis, int quantity) {
  ecat_drive_settings *settings = &axis->drive.settings;
  double *scales[] = {&settings->position_scale, &settings->velocity_scale, &settings->torque_scale,
                      &settings->current_scale};
  return scales[quantity];
}

/* Takes the scale of an object whose unit is that of its quantity; others (`%` of the rated torque) keep the usual one. */
static int take_scale(ecat_axis *axis, int object, const ecat_signal_info *info, const int *known) {
  int quantity = OBJECTS[object].quantity;
  const struct axis_unit *unit = find_unit(info->unit);
  double scale;
  if (quantity < 0) return 0;
  if (unit == NULL || unit->quantity != quantity) {
    if (*info->unit == '\0' || quantity == AXIS_TORQUE || quantity == AXIS_CURRENT) return 0; /* % of rated values */
    return ecat_fail(axis->bus, ECAT_EARG,
                     "axis %s: 0x%04X of slave %d has the unit %s, which is none of a %s: correct its [[signal]] table in "
                     "the configuration of the daemon", axis->name, index_of(axis, object), axis->slave, info->unit,
                     quantity == AXIS_POSITION ? "position" : "speed");
  }
  if (quantity == AXIS_VELOCITY && known[AXIS_POSITION] != 0 && unit->linear != axis->linear)
    return ecat_fail(axis->bus, ECAT_EARG,
                     "axis %s: 0x%04X of slave %d has the unit %s, but its position is in %s: correct the [[signal]] tables "
                     "in the configuration of the daemon", axis->name, index_of(axis, object), axis->slave, info->unit,
                     axis->linear ? "m" : "rad");
  if (info->offset != 0)
    return ecat_fail(axis->bus, ECAT_EARG, "axis %s: 0x%04X of slave %d has an offset of %g %s: an axis has none",
                     axis->name, index_of(axis, object), axis->slave, info->offset, info->unit);
  scale = info->scale * unit->factor;
  if (known[quantity] != 0 && fabs(scale / *scale_of(axis, quantity) - 1) > 1e-9)
    return ecat_fail(axis->bus, ECAT_EARG,
                     "axis %s: 0x%04X of slave %d has another unit or scale than 0x%04X, but a drive counts both alike: "
                     "correct the [[signal]] tables in the configuration of the daemon",
                     axis->name, index_of(axis, object), axis->slave, index_of(axis, known[quantity] - 1));
  if (quantity == AXIS_POSITION) axis->linear = unit->linear;
  if (quantity == AXIS_TORQUE) axis->torque_unit = unit->linear ? 2 : 1;
  *scale_of(axis, quantity) = scale;
  return 1;
}

static int find_objects(ecat_axis *axis) {
  ecat_drive_settings *settings = &axis->drive.settings;
  int i, code, known[4] = {0, 0, 0, 0}; /* 1 + the object that has told the scale */
  ecat_signal_info info;
  settings->entries = 0;
  for (i = 0; i < ECAT_AXIS_OBJECTS; i++) {
    axis->signals[i] = ecat_bind(axis->bus, axis->slave, index_of(axis, i), 0,
                                 OBJECTS[i].output ? ECAT_OUTPUT : ECAT_INPUT);
    if (axis->signals[i] < 0) continue;
    settings->entries |= OBJECTS[i].entry;
    if ((code = ecat_signal(axis->bus, axis->signals[i], &info)) < 0 || (code = take_scale(axis, i, &info, known)) < 0)
      return code;
    if (code > 0) known[OBJECTS[i].quantity] = i + 1;
  }
  if (axis->signals[CONTROL] < 0 || axis->signals[STATUS] < 0)
    return ecat_fail(axis->bus, ECAT_ESIGNAL,
                     "axis %s: slave %d has no %s (0x%04X) in its process data: it is no drive of the profile CiA 402, or "
                     "its pdos lack it", axis->name, axis->slave,
                     axis->signals[CONTROL] < 0 ? "controlword" : "statusword",
                     index_of(axis, axis->signals[CONTROL] < 0 ? CONTROL : STATUS));
  /* A velocity without a unit counts in increments per second, as CiA 402 has it by default. */
  if (known[AXIS_POSITION] && !known[AXIS_VELOCITY]) settings->velocity_scale = settings->position_scale;
  if (!known[AXIS_POSITION]) settings->position_scale = 0;
  settings->max_torque = 1000 * fabs(settings->torque_scale); /* the rated torque (CiA 402-2, object 0x6072) */
  if (axis->linear) { /* usual values in m; those in rad are set by ecat_axis_open() */
    settings->approach_speed = 0.1;
    settings->approach_acceleration = 1;
    settings->window = 1e-4;
    settings->standstill_speed = 1e-3;
  }
  return 0;
}

int ecat_axis_open(ecat_axis *axis, ecat_t *bus, const char *slave, int number) {
  ecat_drive_settings settings;
  ecat_slave_info info;
  int i, code;
  ecat_drive_defaults(&settings, 1);
  memset(axis, 0, sizeof *axis);
  ecat_drive_init(&axis->drive, &settings);
  axis->bus = bus;
  axis->number = number;
  axis->slave = ecat_find_name(bus, slave);
  if (axis->slave < 0) return axis->slave;
  if (number < 1 || number > 8)
    return ecat_fail(bus, ECAT_EARG, "an axis of a drive is 1 to 8, not %d", number);
  if ((code = ecat_slave(bus, axis->slave, &info)) < 0) return code;
  (void)snprintf(axis->place, sizeof axis->place, "%s", slave);
  (void)snprintf(axis->name, sizeof axis->name, number > 1 ? "%.40s/%d" : "%.40s", slave, number);
  axis->drive.settings.name = axis->name;
  axis->drive.settings.changes_mode = 1;
  axis->drive.settings.reference = ECAT_DRIVE_ABSOLUTE;
  axis->drive.settings.max_dropout = 0.1;
  axis->drive.settings.standstill_speed = 0.05;
  axis->drive.settings.approach_acceleration = 10;
  axis->request.mode = ECAT_DRIVE_CYCLIC_POSITION;
  axis->request.ready = 1;
  axis->instance = ecat_instance(bus);
  if ((code = find_objects(axis)) != 0) return code;
  for (i = 0; i < 4; i++) axis->found[i] = *scale_of(axis, i);
  return 0;
}

unsigned axis_lacks(const ecat_axis *axis, int mode) {
  int needed = ecat_drive_positions(mode) ? TARGET_POSITION : ecat_drive_velocities(mode) ? TARGET_VELOCITY
               : ecat_drive_torques(mode) ? TARGET_TORQUE : CONTROL;
  if (axis->signals[needed] < 0) return index_of(axis, needed);
  if (axis->signals[MODE] < 0) return index_of(axis, MODE);
  return ecat_drive_positions(mode) && axis->signals[POSITION] < 0 ? index_of(axis, POSITION) : 0;
}

int ecat_axis_check(ecat_axis *axis, int mode) {
  const char *wrong;
  unsigned lacks;
  if (ecat_drive_mode_text(mode)[0] == '\0')
    return ecat_fail(axis->bus, ECAT_EARG, "axis %s: %d is no mode of operation that an axis can have", axis->name, mode);
  if (axis->drive.settings.position_scale == 0)
    return ecat_fail(axis->bus, ECAT_EARG,
                     "axis %s: the position of slave %d (0x%04X) has no unit: write one into the configuration of the "
                     "daemon, with [[signal]] unit = \"rad\" (or \"m\") and scale for one increment",
                     axis->name, axis->slave, index_of(axis, POSITION));
  if (axis->drive.settings.position_scale * axis->drive.settings.velocity_scale < 0)
    return ecat_fail(axis->bus, ECAT_EARG,
                     "axis %s: the scales of its position and its speed have different signs, so it would turn the wrong "
                     "way: correct the [[signal]] tables in the configuration of the daemon", axis->name);
  wrong = ecat_drive_wrong(&axis->drive.settings);
  if (wrong != NULL) return ecat_fail(axis->bus, ECAT_EARG, "axis %s: %s", axis->name, wrong);
  lacks = axis_lacks(axis, mode);
  return lacks == 0 ? 0
                    : ecat_fail(axis->bus, ECAT_ESIGNAL,
                                "axis %s: mode %s needs 0x%04X, which is not in the process data of slave %d: add it to "
                                "its pdos", axis->name, ecat_drive_mode_text(mode), lacks, axis->slave);
}

/* --- exchange --------------------------------------------------------------------------------- */

/* Whether the axis of a daemon that was started again is another one than the program has opened. */
static int is_another(const ecat_axis *axis) {
  ecat_axis fresh;
  return ecat_axis_open(&fresh, axis->bus, axis->place, axis->number) != 0 || fresh.slave != axis->slave ||
         memcmp(fresh.signals, axis->signals, sizeof fresh.signals) != 0 ||
         memcmp(fresh.found, axis->found, sizeof fresh.found) != 0;
}

/* The time of the sample: bus cycles, or the clock while there are none. */
static void advance(ecat_axis *axis) {
  uint64_t cycle = ecat_cycle(axis->bus), now = ecat_now(), instance = ecat_instance(axis->bus);
  uint64_t cycles = cycle - axis->cycle;
  if (instance != axis->instance) {
    axis->losses++;
    axis->changed |= is_another(axis);
  }
  if (axis->now_ns == 0)
    axis->time = 0;
  else if (instance == axis->instance && cycle > axis->cycle && cycles < 1000000)
    axis->time += (double)cycles * ecat_cycle_time(axis->bus);
  else
    axis->time += (double)(now - axis->now_ns) * 1e-9;
  axis->cycle = cycle;
  axis->instance = instance;
  axis->now_ns = now;
}

int ecat_axis_read(ecat_axis *axis) {
  ecat_drive_inputs inputs;
  int i, code = 0;
  int64_t value;
  memset(&inputs, 0, sizeof inputs);
  advance(axis);
  for (i = 0; i < ECAT_AXIS_OBJECTS && code == 0; i++) {
    if (OBJECTS[i].output || axis->signals[i] < 0) continue;
    value = 0;
    code = ecat_read_int(axis->bus, axis->signals[i], &value);
    *(int *)(void *)((char *)&inputs + OBJECTS[i].member) = (int)value;
  }
  inputs.valid = code == 0 && ecat_validity(axis->bus, axis->signals[STATUS]) == ECAT_VALID;
  inputs.losses = axis->losses;
  ecat_drive_measure(&axis->drive, axis->time, &inputs);
  return code;
}

int ecat_axis_write(ecat_axis *axis) {
  ecat_drive_outputs outputs;
  int i, code;
  if (axis->changed)
    return ecat_fail(axis->bus, ECAT_EBUS,
                     "axis %s: the daemon was started again, and has another axis there, or other units: open it again",
                     axis->name);
  code = ecat_drive_command(&axis->drive, axis->time, &axis->request, &outputs);
  if (code != 0)
    return ecat_fail(axis->bus, code, "axis %s: the target %g is no number, or mode %d is none", axis->name,
                     axis->request.target, axis->request.mode);
  for (i = 0; i < ECAT_AXIS_OBJECTS && code == 0; i++) {
    int value;
    if (!OBJECTS[i].output || axis->signals[i] < 0) continue;
    value = *(const int *)(const void *)((const char *)&outputs + OBJECTS[i].member);
    if (i >= FIRST_OF_PROFILE && value == 0) continue; /* the drive keeps its own profile */
    code = ecat_write_int(axis->bus, axis->signals[i], value);
  }
  if (code == ECAT_ELEASE) axis->losses++;
  return code;
}
