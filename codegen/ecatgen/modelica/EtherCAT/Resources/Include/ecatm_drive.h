/* A drive with the device profile CiA 402 (IEC 61800-7-201): its parameters and its memory. */
#ifndef ECATM_DRIVE_H
#define ECATM_DRIVE_H

#include "ecatm_drive_data.h"
#include "ecatm_sdo_list.h"
#include <ecat/ecat_drive.h>

#define ECATM_TWO_PI 6.28318530717958647692

/* The parameters of EtherCAT.Drives.CiA402. */
typedef struct ecatm_drive_settings {
  int mode;                      /* enum ecat_drive_mode */
  int reference;                 /* enum ecat_drive_reference, of positions */
  int restart;                   /* enum ecat_drive_restart: after a loss or a fault */
  int axis;                      /* 1 first: 0x800 * (axis - 1) is added to the indices of its objects */
  int entries;                   /* enum ecat_drive_entries, added up */
  int homing_method;             /* written to 0x6098, 0: nothing is written */
  int mode_object;               /* index of the object to write the mode by SDO, 0: in the process data */
  double encoder;                /* increments per revolution of the motor */
  double gear;                   /* revolutions of the motor per revolution of the output */
  double velocity_scale;         /* raw velocity at one revolution of the motor per second */
  double rated_torque;           /* of the motor in N.m, 1000 in 0x6071, 0x6072 and 0x6077 */
  double rated_current;          /* in A, 1000 in 0x6078 */
  double max_torque;             /* of the motor in N.m, for 0x6072 and targets */
  double approach_speed;         /* rad/s of the output, on the way to an absolute position */
  double standstill_speed;       /* rad/s of the output: a quick stop ends below it */
  double max_dropout;            /* the state is kept for so many seconds without valid data */
} ecatm_drive_settings;

typedef struct ecatm_drive {
  ecatm_node node;
  ecatm_drive_settings settings;
  ecatm_sdo_list *list;          /* objects to write before the drive is enabled */
  ecatm_drive_data *data;        /* what the drive says of its motor */
  ecat_drive drive;
  int start_up, start_up_before; /* enum ecatm_sdo_state of the start-up list */
  double time;                   /* of the last sample, -1: there was none */
  int told;                      /* a message has said that the drive does not change to the mode */
  int told_lost;                 /* a message has said that a new edge of `enable` is needed */
} ecatm_drive;

/* --- Life ---------------------------------------------------------------------------------- */

/* Sets usual values: increments per second as unit of the velocity, and all entries mapped. */
ECATM_FUNCTION void ecatm_drive_defaults(ecatm_drive_settings *settings, int mode, double encoder) {
  settings->mode = mode;
  settings->reference = ECAT_DRIVE_RELATIVE;
  settings->restart = ECAT_DRIVE_EDGE;
  settings->axis = 1;
  settings->entries = ECAT_DRIVE_HAS_MODE_DISPLAY | ECAT_DRIVE_HAS_POSITION | ECAT_DRIVE_HAS_VELOCITY |
                      ECAT_DRIVE_HAS_TORQUE | ECAT_DRIVE_HAS_CURRENT;
  settings->mode_object = settings->homing_method = 0;
  settings->encoder = settings->velocity_scale = encoder;
  settings->gear = 1;
  settings->rated_torque = settings->rated_current = settings->max_torque = 1;
  settings->approach_speed = 1;
  settings->standstill_speed = 0.5;
  settings->max_dropout = 0.01;
}

/* Returns a message about the first invalid parameter, or NULL if all are valid. */
ECATM_FUNCTION const char *ecatm_drive_wrong(const ecatm_drive_settings *s) {
  if (!ecat_drive_positions(s->mode) && !ecat_drive_velocities(s->mode) &&
      !ecat_drive_torques(s->mode))
    return "mode must be profile or cyclic position, velocity or torque";
  if (s->axis < 1 || s->axis > 8) return "axis must be 1 to 8";
  if (ecat_drive_positions(s->mode) && !(s->entries & ECAT_DRIVE_HAS_POSITION))
    return "a position mode needs the actual position 0x6064 in the process data";
  if (!(s->encoder > 0) || !ecatm_finite(s->encoder)) return "encoderResolution must be positive";
  if (s->gear == 0 || !ecatm_finite(s->gear)) return "gearRatio must not be 0";
  if (!(s->velocity_scale > 0) || !ecatm_finite(s->velocity_scale))
    return "velocityScale must be positive";
  if (!(s->rated_torque > 0) || !ecatm_finite(s->rated_torque))
    return "ratedTorque must be positive";
  if (!(s->rated_current > 0) || !ecatm_finite(s->rated_current))
    return "ratedCurrent must be positive";
  if (!(s->max_torque >= 0)) return "tau_max must not be negative";
  return NULL;
}

/* The settings at the output of the gear. */
ECATM_FUNCTION void ecatm_drive_convert(const ecatm_drive_settings *s, ecat_drive_settings *to) {
  ecat_drive_defaults(to, s->encoder);
  to->restart = s->restart;
  to->reference = s->reference;
  to->entries = s->entries;
  to->changes_mode = 1;          /* to homing and back, at standstill */
  to->position_scale = ECATM_TWO_PI / (s->encoder * s->gear);
  to->velocity_scale = ECATM_TWO_PI / (s->velocity_scale * s->gear);
  to->torque_scale = s->rated_torque * s->gear / 1000;
  to->current_scale = s->rated_current / 1000;
  to->max_torque = s->max_torque * fabs(s->gear);
  to->approach_speed = s->approach_speed;
  to->standstill_speed = s->standstill_speed;
  to->max_dropout = s->max_dropout;
}

typedef struct ecatm_drive_table {
  ecatm_node node;
  int rows[1][ECATM_LIST_COLUMNS]; /* further rows follow in the same memory */
} ecatm_drive_table;

ECATM_FUNCTION void ecatm_drive_row(int *row, int index, int value) {
  row[0] = index;
  row[2] = 2; /* INTEGER8 */
  row[3] = value;
}

/* Makes the list of objects to write before the drive is enabled: the mode, unless it is in the process
 * data, then the rows of `table` with index, subindex, data type and value. */
ECATM_FUNCTION void *ecatm_drive_list(void *object, int position, const char *name,
                                      const ecatm_drive_settings *settings, const int *table,
                                      size_t rows, const char *block) {
  size_t row = sizeof(int) * ECATM_LIST_COLUMNS, first = 0;
  ecatm_drive_table *all =
      (ecatm_drive_table *)ecatm_new((ecatm_master *)object, sizeof *all + (rows + 1) * row);
  void *list;
  if (all == NULL) return NULL;
  if (settings->mode_object != 0)
    ecatm_drive_row(all->rows[0] + ECATM_LIST_COLUMNS * first++, settings->mode_object, settings->mode);
  if (settings->homing_method != 0)
    ecatm_drive_row(all->rows[0] + ECATM_LIST_COLUMNS * first++, 0x6098 + 0x800 * (settings->axis - 1),
                    settings->homing_method);
  if (rows > 0) memcpy((char *)all->rows + first * row, table, rows * row);
  list = ecatm_sdo_list_open(object, position, name, all->rows[0], rows + first, ECATM_LIST_COLUMNS,
                             block);
  ecatm_close(all);
  return list;
}

/* Makes a drive with a start-up list of `rows` rows: index, subindex, data type, value. `name` is the name
 * of the slave, see ecatm_which. */
ECATM_FUNCTION void *ecatm_drive_new(void *object, int position, const char *name,
                                     const ecatm_drive_settings *settings, const int *table,
                                     size_t rows, const char *block) {
  const char *wrong = ecatm_drive_wrong(settings);
  ecat_drive_settings converted;
  ecatm_drive *drive;
  char heading[ECATM_HEADING];
  void *list, *data;
  ecatm_head(heading, block);
  if (wrong == NULL) {
    ecatm_drive_convert(settings, &converted);
    wrong = ecat_drive_wrong(&converted);
  }
  if (wrong != NULL) {
    ModelicaFormatError("EtherCAT: %sthe drive of slave %d cannot work: %s", heading, position, wrong);
    return NULL;
  }
  list = ecatm_drive_list(object, position, name, settings, table, rows, block);
  data = ecatm_drive_data_open(object, position, name, block);
  drive = (ecatm_drive *)ecatm_new((ecatm_master *)object, sizeof *drive);
  if (drive == NULL) return NULL;
  drive->data = (ecatm_drive_data *)data;
  strcpy(drive->node.heading, heading);
  drive->list = (ecatm_sdo_list *)list;
  drive->settings = *settings;
  drive->time = -1;
  ecat_drive_init(&drive->drive, &converted);
  return drive;
}

/* The constructor in Modelica; see ecatm_drive_settings. `mode` is the number of an
 * EtherCAT.Types.DriveMode. */
ECATM_FUNCTION void *ecatm_drive_open(void *master, int position, const char *name, int axis, int mode,
                                      int reference, int restart, int entries, int mode_object,
                                      int homing_method, double encoder, double gear,
                                      double velocity_scale, double rated_torque,
                                      double rated_current, double max_torque,
                                      double approach_speed, double standstill_speed,
                                      double max_dropout, const int *table, size_t rows,
                                      size_t columns, const char *block) {
  static const int modes[] = {ECAT_DRIVE_PROFILE_POSITION, ECAT_DRIVE_PROFILE_VELOCITY, ECAT_DRIVE_PROFILE_TORQUE,
                              ECAT_DRIVE_CYCLIC_POSITION, ECAT_DRIVE_CYCLIC_VELOCITY, ECAT_DRIVE_CYCLIC_TORQUE};
  ecatm_drive_settings settings;
  settings.mode = mode >= 1 && mode <= 6 ? modes[mode - 1] : 0;
  settings.reference = reference;
  settings.restart = restart;
  settings.axis = axis;
  settings.entries = entries;
  settings.mode_object = mode_object;
  settings.homing_method = homing_method;
  settings.encoder = encoder;
  settings.gear = gear;
  settings.velocity_scale = velocity_scale;
  settings.rated_torque = rated_torque;
  settings.rated_current = rated_current;
  settings.max_torque = max_torque;
  settings.approach_speed = approach_speed;
  settings.standstill_speed = standstill_speed;
  settings.max_dropout = max_dropout;
  (void)columns; /* 4, as declared */
  return ecatm_drive_new(master, position, name, &settings, table, rows, block);
}

ECATM_FUNCTION void ecatm_drive_close(void *object) {
  ecatm_drive *drive = (ecatm_drive *)object;
  if (drive == NULL || drive->node.closed) return;
  ecatm_close(drive->list);
  ecatm_close(drive->data);
  ecatm_close(drive);
}

#endif
