/* Drives: the controlword and the mode, and when a drive may be in operation. */
#include "drive.h"

#include <stddef.h>

enum { OFF = 0x00, QUICK_STOP = 0x02, SHUTDOWN = 0x06, SWITCH_ON = 0x07, OPERATION = 0x0F, RESET = 0x80, HALT = 0x100 };

static int is_fault(int state) { return state == ECAT_DRIVE_FAULT || state == ECAT_DRIVE_FAULT_REACTION; }

static int moves(int state) {
  return state == ECAT_DRIVE_OPERATION || state == ECAT_DRIVE_QUICK_STOP || state == ECAT_DRIVE_FAULT_REACTION;
}

static int stands(const ecat_drive *drive) { return fabs(drive->view.speed) <= drive->settings.standstill_speed; }

/* --- whether it may be in operation ----------------------------------------------------------- */

/* What has ended the operation of the drive at this sample without a command of the program, or would have; NULL:
 * nothing. */
static const char *find_loss(const ecat_drive *drive) {
  const ecat_drive_view *before = &drive->view_before, *view = &drive->view;
  if (!before->connected) return NULL;
  if (!view->connected || view->raw.losses != before->raw.losses) return "it was lost";
  if (is_fault(view->state) && !is_fault(before->state)) return "it had a fault";
  if (before->state == ECAT_DRIVE_OPERATION && view->state != ECAT_DRIVE_OPERATION &&
      (drive->order_before.out.control & (RESET | OPERATION)) == OPERATION)
    return "it left its operation by itself";
  return NULL;
}

/* Why the drive may not start although `enable` is 1 since before the drive was seen; NULL: it may. */
static const char *find_obstacle(const ecat_drive *drive) {
  if (is_fault(drive->view.state)) return "it had a fault at the start";
  return moves(drive->view.state) ? "it was in operation at the start" : NULL;
}

/* Whether the program wants the drive in operation, and may have it. */
static int is_wanted(ecat_drive *drive, const char *loss) {
  const ecat_drive_order *before = &drive->order_before;
  ecat_drive_order *now = &drive->order;
  int enable = now->request.enable, changed = enable && !(before->begun && before->request.enable);
  if (changed) now->armed = 1, now->met = 0;
  if (loss == NULL && now->stopping && now->armed) loss = "of a quick stop";
  if (!now->met && drive->view.connected) {
    now->met = 1;
    if (!before->begun || !drive->view_before.connected) {
      const char *obstacle = find_obstacle(drive);
      if (obstacle != NULL) loss = obstacle;
    }
  }
  if (loss != NULL || !enable) now->armed = 0;
  if (loss != NULL) now->waits = loss;
  if (!enable) now->trip = NULL;
  if (now->armed) now->waits = NULL;
  return enable && now->trip == NULL && (now->armed || drive->settings.restart == ECAT_DRIVE_AUTOMATIC);
}

/* --- controlword and mode --------------------------------------------------------------------- */

/* Whether the mode may change in operation: the drive can, and the program wants it there. */
static int changes_mode(const ecat_drive *drive) {
  return drive->settings.changes_mode && (drive->order.armed || drive->settings.restart == ECAT_DRIVE_AUTOMATIC);
}

/* Whether the mode may be written now: in operation only at standstill, and only if the drive allows that. */
static int may_change_mode(const ecat_drive *drive) {
  if (drive->view.state == ECAT_DRIVE_OPERATION && changes_mode(drive)) return stands(drive);
  return !moves(drive->view.state);
}

static int word(const ecat_drive *drive, int wanted) {
  const ecat_drive_order *now = &drive->order;
  int in_mode = drive_is_in_mode(drive, now->request.mode);
  switch (drive->view.state) {
    case ECAT_DRIVE_NOT_READY:
    case ECAT_DRIVE_FAULT_REACTION:
      return OFF;
    case ECAT_DRIVE_FAULT:
      return now->reset_pending && now->request.fault_reset ? RESET : OFF;
    case ECAT_DRIVE_QUICK_STOP: /* the drive completes a quick stop in any case */
      return now->stopping || !stands(drive) ? QUICK_STOP : OFF;
    default:
      break;
  }
  if (now->stopping) return QUICK_STOP;
  if (drive->view.state == ECAT_DRIVE_SWITCH_ON_DISABLED) return SHUTDOWN;
  if (drive->view.state == ECAT_DRIVE_READY) return wanted ? SWITCH_ON : SHUTDOWN;
  if (drive->view.state == ECAT_DRIVE_SWITCHED_ON && !wanted) return SHUTDOWN;
  if (wanted && drive->view.state == ECAT_DRIVE_OPERATION && !in_mode && changes_mode(drive))
    return stands(drive) ? OPERATION : OPERATION | HALT; /* it stops in the mode that it has, and then changes it */
  return wanted && in_mode ? OPERATION : SWITCH_ON; /* from operation: "disable operation" */
}

/* A change of `fault_reset` asks for a reset. What is 1 in the first sample is no change, unless the drive is to
 * start by itself. */
static void note_reset(ecat_drive *drive) {
  const ecat_drive_order *before = &drive->order_before;
  ecat_drive_order *now = &drive->order;
  int first = !before->begun && drive->settings.restart == ECAT_DRIVE_AUTOMATIC;
  if (now->request.fault_reset && (before->begun ? !before->request.fault_reset : first)) now->reset_pending = 1;
  if (drive->view.connected && !is_fault(drive->view.state)) now->reset_pending = 0;
}

static void watch_mode(ecat_drive *drive) {
  ecat_drive_order *now = &drive->order;
  int waits = drive->view.state == ECAT_DRIVE_SWITCHED_ON && now->out.control == SWITCH_ON &&
              !drive_is_in_mode(drive, now->request.mode);
  now->mode_for = waits ? drive->order_before.mode_for + drive->elapsed : 0;
}

/* --- homing ----------------------------------------------------------------------------------- */

#define HOMING_START 0x10
#define TARGET_REACHED 0x0400
#define HOMING_ATTAINED 0x1000
#define HOMING_ERROR 0x2000
#define HOMING_PATIENCE 0.25 /* seconds in which a drive shows that it homes, or has done so at once */

/* Holds bit 4 while the axis homes, and reads bits 10, 12 and 13. Bits that are left from an earlier homing do not
 * count: they go when the drive begins. */
static void go_home(ecat_drive *drive) {
  const ecat_drive_order *before = &drive->order_before;
  ecat_drive_order *now = &drive->order;
  int status = drive->view.raw.status, attained = (status & HOMING_ATTAINED) != 0;
  int is_over = attained && (status & TARGET_REACHED);
  if (drive->view.connected && drive->view.raw.losses != drive->view_before.raw.losses) now->homing = ECAT_DRIVE_NOT_HOMED;
  if (now->request.mode != ECAT_DRIVE_HOMING || !now->request.home || !now->following) {
    if (now->homing == ECAT_DRIVE_HOMES) now->homing = ECAT_DRIVE_NOT_HOMED;
    now->home_seen = 0;
    return;
  }
  if (!(before->following && before->request.home && before->request.mode == ECAT_DRIVE_HOMING)) {
    now->homing = ECAT_DRIVE_HOMES;
    now->homing_for = 0;
    now->home_seen = 0;
  } else if (now->homing == ECAT_DRIVE_HOMES) {
    now->homing_for = before->homing_for + drive->elapsed;
    if (!is_over && !(status & HOMING_ERROR)) now->home_seen = 1;
    if (now->home_seen || now->homing_for > HOMING_PATIENCE) {
      if (status & HOMING_ERROR) now->homing = ECAT_DRIVE_HOMING_FAILED;
      else if (is_over) now->homing = ECAT_DRIVE_HOMED;
    }
  }
  if (now->homing != ECAT_DRIVE_HOMING_FAILED) now->out.control |= HOMING_START;
  now->reached = now->homing == ECAT_DRIVE_HOMED;
}

/* --- a sample --------------------------------------------------------------------------------- */

static int is_mode(int mode) {
  return ecat_drive_positions(mode) || ecat_drive_velocities(mode) || ecat_drive_torques(mode) ||
         mode == ECAT_DRIVE_HOMING;
}

int ecat_drive_command(ecat_drive *drive, double time, const ecat_drive_request *request,
                       ecat_drive_outputs *outputs) {
  ecat_drive_order *now = &drive->order;
  const ecat_drive_settings *s = &drive->settings;
  int wanted;
  if (!is_mode(request->mode)) return ECAT_EARG;
  drive_step(drive, time);
  *now = drive->order_before;
  now->request = *request;
  now->reached = now->limited = 0;
  note_reset(drive);
  /* Even a short request lasts until the drive leaves its operation. */
  now->stopping = request->quick_stop || now->trip != NULL ||
                  (drive->order_before.stopping && drive->view.state == ECAT_DRIVE_OPERATION);
  wanted = is_wanted(drive, find_loss(drive));
  now->out.control = word(drive, wanted && request->ready);
  now->following = drive->view.enabled && drive_is_in_mode(drive, request->mode) && now->out.control == OPERATION;
  if (now->following && request->mode != ECAT_DRIVE_HOMING && !drive_finite(request->target)) return ECAT_EARG;
  watch_mode(drive);
  now->out.mode = may_change_mode(drive) ? request->mode : drive->view.raw.display;
  drive_target(drive);
  go_home(drive);
  if (request->halt && now->following) now->out.control |= HALT;
  now->out.max_torque = drive_hold(s->max_torque / fabs(s->torque_scale), 0, 65535);
  now->begun = 1;
  *outputs = now->out;
  return 0;
}
