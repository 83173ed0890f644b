/* Drives: settings, samples, and what a drive says. */
#include "drive.h"

#include <string.h>

static const double TWO_PI = 6.28318530717958647692;

void ecat_drive_defaults(ecat_drive_settings *settings, double increments) {
  memset(settings, 0, sizeof *settings);
  settings->name = "";
  settings->restart = ECAT_DRIVE_EDGE;
  settings->reference = ECAT_DRIVE_RELATIVE;
  settings->entries = ECAT_DRIVE_HAS_MODE_DISPLAY | ECAT_DRIVE_HAS_POSITION | ECAT_DRIVE_HAS_VELOCITY |
                      ECAT_DRIVE_HAS_TORQUE | ECAT_DRIVE_HAS_CURRENT;
  settings->position_scale = settings->velocity_scale = TWO_PI / increments;
  settings->torque_scale = settings->current_scale = 1e-3;
  settings->max_torque = 1;
  settings->low = 1;
  settings->high = -1;
  settings->approach_speed = 1;
  settings->window = 0.01;
  settings->standstill_speed = 0.5;
  settings->max_dropout = 0.01;
}

static int is_scale(double value) { return value != 0 && drive_finite(value); }

/* Whether it is a number of 0 or more; a NaN is none. */
static int is_amount(double value) { return value >= 0; }

const char *ecat_drive_wrong(const ecat_drive_settings *s) {
  if (s->restart != ECAT_DRIVE_AUTOMATIC && s->restart != ECAT_DRIVE_EDGE) return "restart must be Automatic or Edge";
  if (s->reference != ECAT_DRIVE_RELATIVE && s->reference != ECAT_DRIVE_ABSOLUTE)
    return "reference must be Relative or Absolute";
  if (!is_scale(s->position_scale)) return "the scale of its position must be a number other than 0";
  if (!is_scale(s->velocity_scale)) return "the scale of its velocity must be a number other than 0";
  if (!is_scale(s->torque_scale)) return "the scale of its torque must be a number other than 0";
  if (!is_scale(s->current_scale)) return "the scale of its current must be a number other than 0";
  if (!is_amount(s->max_torque)) return "the largest torque must not be negative";
  if (s->low != s->low || s->high != s->high) return "the limits of the position must be numbers";
  if (!is_amount(s->max_speed)) return "the largest speed must not be negative";
  if (!is_amount(s->max_following_error)) return "the largest following error must not be negative";
  if (!(s->approach_speed > 0)) return "approachSpeed must be positive";
  if (!is_amount(s->approach_acceleration)) return "the acceleration must not be negative";
  if (!is_amount(s->window)) return "the window of the target must not be negative";
  if (!is_amount(s->standstill_speed)) return "standstillSpeed must not be negative";
  if (!is_amount(s->max_dropout)) return "maxDropout must not be negative";
  return NULL;
}

void ecat_drive_init(ecat_drive *drive, const ecat_drive_settings *settings) {
  memset(drive, 0, sizeof *drive);
  drive->settings = *settings;
  drive->view.state = ECAT_DRIVE_NOT_READY;
  drive->order.homing = ECAT_DRIVE_NOT_HOMED;
}

int ecat_drive_positions(int mode) {
  return mode == ECAT_DRIVE_PROFILE_POSITION || mode == ECAT_DRIVE_CYCLIC_POSITION;
}

int ecat_drive_velocities(int mode) {
  return mode == ECAT_DRIVE_PROFILE_VELOCITY || mode == ECAT_DRIVE_CYCLIC_VELOCITY;
}

int ecat_drive_torques(int mode) { return mode == ECAT_DRIVE_PROFILE_TORQUE || mode == ECAT_DRIVE_CYCLIC_TORQUE; }

/* --- samples ---------------------------------------------------------------------------------- */

/* The first call at a new time keeps the results of the sample before. */
void drive_step(ecat_drive *drive, double time) {
  double passed = time - drive->time;
  if (drive->stepped && passed <= DRIVE_SAME_TIME && passed >= -DRIVE_SAME_TIME) return;
  drive->elapsed = drive->stepped && passed > 0 ? passed : 0;
  drive->stepped = 1;
  drive->time = time;
  drive->view_before = drive->view;
  drive->order_before = drive->order;
}

/* The bits are those of CiA 402-2, "statusword". */
int ecat_drive_state_of(int status) {
  if (status & 0x08) return status & 0x04 ? ECAT_DRIVE_FAULT_REACTION : ECAT_DRIVE_FAULT;
  if (status & 0x40) return ECAT_DRIVE_SWITCH_ON_DISABLED;
  if (!(status & 0x01)) return ECAT_DRIVE_NOT_READY;
  if (!(status & 0x20)) return ECAT_DRIVE_QUICK_STOP;
  if (status & 0x04) return ECAT_DRIVE_OPERATION;
  return status & 0x02 ? ECAT_DRIVE_SWITCHED_ON : ECAT_DRIVE_READY;
}

/* Takes over valid data. Values that are not mapped are computed from the mapped ones. */
static void see(ecat_drive *drive, const ecat_drive_inputs *inputs) {
  const ecat_drive_settings *s = &drive->settings;
  const ecat_drive_view *before = &drive->view_before;
  ecat_drive_view *view = &drive->view;
  double elapsed = drive->time - before->seen_at;
  if (!before->seen)
    view->increments = inputs->position;
  else
    view->increments += drive_wrap((double)inputs->position - drive_wrap(before->increments));
  if (s->entries & ECAT_DRIVE_HAS_VELOCITY) {
    view->raw_velocity = inputs->velocity;
    view->speed = inputs->velocity * s->velocity_scale;
  } else if (before->seen && elapsed > 0) {
    view->speed = (view->increments - before->increments) / elapsed * s->position_scale;
    view->raw_velocity = view->speed / s->velocity_scale;
  }
  view->raw_torque = s->entries & ECAT_DRIVE_HAS_TORQUE    ? inputs->torque
                     : s->entries & ECAT_DRIVE_HAS_CURRENT ? inputs->current
                                                           : 0;
  view->position = view->increments * s->position_scale;
  view->torque = view->raw_torque * s->torque_scale;
  view->current = (s->entries & ECAT_DRIVE_HAS_CURRENT ? inputs->current : view->raw_torque) * s->current_scale;
  view->raw = *inputs;
  view->seen = 1;
  view->seen_at = drive->time;
}

void ecat_drive_measure(ecat_drive *drive, double time, const ecat_drive_inputs *inputs) {
  const ecat_drive_settings *s = &drive->settings;
  ecat_drive_view *view = &drive->view;
  drive_step(drive, time);
  *view = drive->view_before;
  if (inputs->valid) see(drive, inputs);
  view->raw.losses = inputs->losses;
  view->raw.valid = inputs->valid;
  view->connected = view->seen && time - view->seen_at <= s->max_dropout + DRIVE_SAME_TIME;
  view->state = view->connected ? ecat_drive_state_of(view->raw.status) : ECAT_DRIVE_NOT_READY;
  view->enabled = view->state == ECAT_DRIVE_OPERATION && drive_is_in_mode(drive, drive->order_before.request.mode) &&
                  (drive->order_before.out.control & 0x0F) == 0x0F;
}
