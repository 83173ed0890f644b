/* A sample of a drive with the device profile CiA 402, between raw process data and SI units.
 *
 * Call measure() first and then command(). measure() does not depend on a reference, so that a controller
 * between the two makes no algebraic loop. Both compute from the results of the sample before, and may be
 * called again at the same time.
 */
#ifndef ECATM_DRIVE_STEPS_H
#define ECATM_DRIVE_STEPS_H

#include "ecatm_drive.h"

#define ECATM_TWO_PI 6.28318530717958647692
#define ECATM_MODE_PATIENCE 2.0  /* seconds to change the mode; after that a message says so */

/* --- Measure ------------------------------------------------------------------------------- */

/* Reads what the drive says of its motor whenever the drive appears, and compares the parameters with it. */
ECATM_FUNCTION void ecatm_drive_compare(ecatm_drive *drive) {
  const ecatm_drive_settings *s = &drive->settings;
  ecatm_drive_data *data = drive->data;
  const double *values = data->values;
  double turns = values[ECATM_REVOLUTIONS] > 0 ? values[ECATM_REVOLUTIONS] : 1;
  if (!drive->view.connected && data->transfer.handle < 0) {
    data->next = 0;
  } else if (ecatm_drive_data_read(data, 0x800 * (s->axis - 1))) {
    ecatm_drive_data_compare(data, ECATM_INCREMENTS, values[ECATM_INCREMENTS] / turns,
                             1e-6 * s->encoder, "0x608F", "encoderResolution", s->encoder, "");
    ecatm_drive_data_compare(data, ECATM_RATED_TORQUE, values[ECATM_RATED_TORQUE] / 1000, 0.5001e-3,
                             "0x6076", "ratedTorque", s->rated_torque, " N.m");
    ecatm_drive_data_compare(data, ECATM_RATED_CURRENT, values[ECATM_RATED_CURRENT] / 1000, 0.5001e-3,
                             "0x6075", "ratedCurrent", s->rated_current, " A");
  }
}

/* The first call at a new time keeps the results of the sample before. */
ECATM_FUNCTION void ecatm_drive_step(ecatm_drive *drive, double time) {
  if (drive->stepped && ecatm_same_time(time, drive->time)) return;
  drive->elapsed = drive->stepped && time > drive->time ? time - drive->time : 0;
  drive->stepped = 1;
  drive->time = time;
  drive->view_before = drive->view;
  drive->order_before = drive->order;
  ecatm_drive_compare(drive);
}

/* The state in a status word; the bits are those of CiA 402-2, "statusword". */
ECATM_FUNCTION int ecatm_drive_state_of(int status) {
  if (status & 0x08) return status & 0x04 ? ECATM_FAULT_REACTION_ACTIVE : ECATM_FAULT;
  if (status & 0x40) return ECATM_SWITCH_ON_DISABLED;
  if (!(status & 0x01)) return ECATM_NOT_READY_TO_SWITCH_ON;
  if (!(status & 0x20)) return ECATM_QUICK_STOP_ACTIVE;
  if (status & 0x04) return ECATM_OPERATION_ENABLED;
  return status & 0x02 ? ECATM_SWITCHED_ON : ECATM_READY_TO_SWITCH_ON;
}

/* Returns a position as a signed 32-bit counter shows it. */
ECATM_FUNCTION int ecatm_drive_wrap(double position) {
  double rest = fmod(ecat_round(position), 4294967296.0);
  if (rest >= 2147483648.0) rest -= 4294967296.0;
  if (rest < -2147483648.0) rest += 4294967296.0;
  return (int)rest;
}

/* Returns the angle of the output in rad for one increment of the encoder. */
ECATM_FUNCTION double ecatm_drive_angle(const ecatm_drive_settings *s) {
  return ECATM_TWO_PI / (s->encoder * s->gear);
}

/* Takes over valid data. Values that are not mapped are computed from the mapped ones. */
ECATM_FUNCTION void ecatm_drive_see(ecatm_drive *drive, int position, int velocity, int torque,
                                    int current) {
  const ecatm_drive_settings *s = &drive->settings;
  const ecatm_drive_view *before = &drive->view_before;
  ecatm_drive_view *view = &drive->view;
  double elapsed = drive->time - before->seen_at;
  if (!before->seen)
    view->position = position;
  else
    view->position += ecatm_drive_wrap((double)position - ecatm_drive_wrap(before->position));
  if (s->entries & ECATM_HAS_VELOCITY) {
    view->velocity = velocity;
    view->w = velocity / s->velocity_scale * ECATM_TWO_PI / s->gear;
  } else if (before->seen && elapsed > 0) {
    view->w = (view->position - before->position) / elapsed * ecatm_drive_angle(s);
    view->velocity = view->w * s->gear / ECATM_TWO_PI * s->velocity_scale;
  }
  view->torque = s->entries & ECATM_HAS_TORQUE ? torque : s->entries & ECATM_HAS_CURRENT ? current : 0;
  view->current = s->entries & ECATM_HAS_CURRENT ? current : view->torque;
  view->seen = 1;
  view->seen_at = drive->time;
}

/* Computes the actual values in SI units at the output of the gear, and returns the state. Without valid
 * data the values stay as they were, and so does the state for max_dropout. `order` is any value that
 * must be computed before this call. */
ECATM_FUNCTION int ecatm_drive_measure(void *object, double time, int order, int valid, int status,
                                       int display, int position, int velocity, int torque,
                                       int current, double *phi, double *w, double *tau, double *i,
                                       int *enabled) {
  ecatm_drive *drive = (ecatm_drive *)object;
  const ecatm_drive_settings *s = &drive->settings;
  ecatm_drive_view *view = &drive->view;
  (void)order;
  ecatm_drive_step(drive, time);
  *view = drive->view_before;
  if (valid) {
    ecatm_drive_see(drive, position, velocity, torque, current);
    view->status = status;
    view->display = s->entries & ECATM_HAS_MODE_DISPLAY ? display : s->mode;
  }
  view->connection = drive->node.master->session.connections;
  view->connected = view->seen && time - view->seen_at <= s->max_dropout + ECATM_SAME_TIME;
  view->state = view->connected ? ecatm_drive_state_of(view->status) : ECATM_NOT_READY_TO_SWITCH_ON;
  view->enabled = view->state == ECATM_OPERATION_ENABLED && view->display == s->mode &&
                  (drive->order_before.word & 0x0F) == 0x0F;
  *phi = view->position * ecatm_drive_angle(s);
  *w = view->w;
  *tau = view->torque / 1000 * s->rated_torque * s->gear;
  *i = view->current / 1000 * s->rated_current;
  *enabled = view->enabled;
  return view->state;
}

/* --- Command ------------------------------------------------------------------------------- */

/* Returns the control word that leads towards operation or away from it. */
ECATM_FUNCTION int ecatm_drive_word(const ecatm_drive *drive, int wanted, int quick_stop) {
  enum { OFF = 0x00, QUICK_STOP = 0x02, SHUTDOWN = 0x06, SWITCH_ON = 0x07, OPERATION = 0x0F };
  const ecatm_drive_view *view = &drive->view;
  int in_mode = view->display == drive->settings.mode;
  switch (view->state) {
    case ECATM_NOT_READY_TO_SWITCH_ON:
    case ECATM_FAULT_REACTION_ACTIVE:
      return OFF;
    case ECATM_FAULT:
      return drive->order.reset_pending && drive->order.reset_input ? 0x80 : OFF;
    case ECATM_QUICK_STOP_ACTIVE: /* the drive completes a quick stop in any case */
      return quick_stop || fabs(view->w) > drive->settings.standstill_speed ? QUICK_STOP : OFF;
    default:
      break;
  }
  if (quick_stop) return QUICK_STOP;
  if (view->state == ECATM_SWITCH_ON_DISABLED) return SHUTDOWN;
  if (view->state == ECATM_READY_TO_SWITCH_ON) return wanted ? SWITCH_ON : SHUTDOWN;
  if (view->state == ECATM_SWITCHED_ON && !wanted) return SHUTDOWN;
  return wanted && in_mode ? OPERATION : SWITCH_ON; /* from operation: "disable operation" */
}

/* Returns the mode to write: the mode changes only while the drive is not in operation. */
ECATM_FUNCTION int ecatm_drive_mode_now(const ecatm_drive *drive) {
  const ecatm_drive_view *view = &drive->view;
  int moving = view->state == ECATM_OPERATION_ENABLED || view->state == ECATM_QUICK_STOP_ACTIVE ||
               view->state == ECATM_FAULT_REACTION_ACTIVE;
  return moving ? view->display : drive->settings.mode;
}

/* Logs once that the drive stays in another mode, since no other message says why it does not move. */
ECATM_FUNCTION void ecatm_drive_watch_mode(ecatm_drive *drive) {
  int waits = drive->view.state == ECATM_SWITCHED_ON && drive->order.word == 0x07 &&
              drive->view.display != drive->settings.mode;
  drive->order.waiting = waits ? drive->order_before.waiting + drive->elapsed : 0;
  if (drive->order.waiting < ECATM_MODE_PATIENCE || drive->told) return;
  drive->told = 1;
  ModelicaFormatMessage("EtherCAT: %sthe drive of slave %d is not enabled: it stays in mode of operation "
                        "%d (0x6061) and does not take %d; choose a mode of its object 0x6502, or "
                        "write 0x6060 in startUp\n",
                        drive->node.heading, drive->list->transfer.slave.position, drive->view.display,
                        drive->settings.mode);
}

/* Returns the target position in increments, without overflow. */
ECATM_FUNCTION double ecatm_drive_target(ecatm_drive *drive, double reference) {
  const ecatm_drive_settings *s = &drive->settings;
  const ecatm_drive_order *before = &drive->order_before;
  ecatm_drive_order *now = &drive->order;
  double wanted = reference / ecatm_drive_angle(s), step, rest;
  if (!now->following) return drive->view.position;
  if (!before->following) {
    now->offset = drive->view.position - wanted;
    return drive->view.position;
  }
  if (s->reference == ECATM_RELATIVE) return wanted + now->offset;
  if (now->arrived || s->mode == ECATM_PROFILE_POSITION) return wanted; /* the drive limits the speed */
  step = fabs(s->approach_speed / ecatm_drive_angle(s)) * drive->elapsed;
  rest = wanted - before->target;
  now->arrived = fabs(rest) <= step;
  return now->arrived ? wanted : before->target + (rest > 0 ? step : -step);
}

/* Profile position: a new set-point is offered by bit 4 until the drive acknowledges it by bit 12. */
ECATM_FUNCTION void ecatm_drive_offer(ecatm_drive *drive) {
  const ecatm_drive_order *before = &drive->order_before;
  ecatm_drive_order *now = &drive->order;
  int acknowledged = (drive->view.status & 0x1000) != 0;
  int wanted = ecatm_drive_wrap(now->target);
  if (!now->following || !before->following) {
    now->set_point = wanted;
    now->strobe = 0;
  } else if (before->strobe) {
    now->strobe = !acknowledged;
  } else if (!acknowledged && wanted != before->set_point) {
    now->set_point = wanted;
    now->strobe = 1;
  }
  if (now->following) now->word |= now->strobe ? 0x30 : 0x20; /* bit 5: change immediately */
}

ECATM_FUNCTION int ecatm_drive_hold(double value, double low, double high) {
  value = ecat_round(value);
  return (int)(value < low ? low : value > high ? high : value);
}

/* Returns the target torque in 1/1000 of the rated torque, limited to the largest torque, since not every
 * drive has 0x6072 in its process data. */
ECATM_FUNCTION int ecatm_drive_torque(const ecatm_drive_settings *s, double reference) {
  double most = s->max_torque / s->rated_torque * 1000;
  if (most > 32767) most = 32767;
  return ecatm_drive_hold(reference / s->gear / s->rated_torque * 1000, -most, most);
}

/* What has ended the operation of the drive at this sample without a command of the model, or would have; NULL:
 * nothing. */
ECATM_FUNCTION const char *ecatm_drive_loss(const ecatm_drive *drive) {
  const ecatm_drive_view *before = &drive->view_before, *view = &drive->view;
  if (!before->connected) return NULL;
  if (!view->connected || view->connection != before->connection) return "it was lost";
  if (view->state >= ECATM_FAULT_REACTION_ACTIVE && before->state < ECATM_FAULT_REACTION_ACTIVE)
    return "it had a fault";
  if (before->state == ECATM_OPERATION_ENABLED && view->state != ECATM_OPERATION_ENABLED &&
      (drive->order_before.word & 0x8F) == 0x0F)
    return "it left its operation by itself";
  return NULL;
}

/* Whether the model wants the drive in operation. After a loss or a fault, only a new edge of `enable` says so,
 * unless the drive is to restart by itself. An `enable` that is true when the model begins is an edge. */
ECATM_FUNCTION int ecatm_drive_wanted(ecatm_drive *drive, int enable) {
  const char *loss = ecatm_drive_loss(drive);
  ecatm_drive_order *now = &drive->order;
  if (loss != NULL || !enable) now->armed = 0;
  if (loss != NULL) now->lost = loss;
  now->enable = enable;
  if (enable && !drive->order_before.enable) now->armed = 1;
  if (now->armed) now->lost = NULL;
  return enable && (now->armed || drive->settings.restart == ECATM_AUTOMATIC);
}

/* Logs once that the drive waits for an edge of `enable`. */
ECATM_FUNCTION void ecatm_drive_watch_edge(ecatm_drive *drive) {
  const ecatm_drive_order *before = &drive->order_before;
  int waits = drive->settings.restart != ECATM_AUTOMATIC && before->enable && before->lost != NULL;
  if (waits && !drive->told_lost)
    ModelicaFormatMessage("EtherCAT: %sthe drive of slave %d stays off until enable is switched off and on "
                          "again, because %s; with restart = Automatic it starts by itself\n",
                          drive->node.heading, drive->list->transfer.slave.position, before->lost);
  drive->told_lost = waits;
}

/* The trigger of the start-up list, which is written at a rising edge: when the drive is connected
 * (again), and after a refusal when the model enables the drive again. */
ECATM_FUNCTION int ecatm_drive_asks(const ecatm_drive *drive, int enable) {
  return drive->view.connected && (enable || drive->order_before.start_up != ECATM_SDO_FAILED);
}

/* Computes mode and targets for a reference in SI units at the output of the gear, and returns the control
 * word. The reference is an angle in position modes, a speed in velocity modes, a torque in torque modes.
 * Until the drive is enabled, the targets follow its actual values. `start_up` is the enum
 * ecatm_sdo_state of the start-up list. `order` is a result of measure(). */
ECATM_FUNCTION int ecatm_drive_command(void *object, double time, int order, int enable,
                                       int quick_stop, int fault_reset, double reference, int *mode,
                                       int *position, int *velocity, int *torque, int *max_torque,
                                       int *start_up) {
  ecatm_drive *drive = (ecatm_drive *)object;
  const ecatm_drive_settings *s = &drive->settings;
  ecatm_drive_order *now = &drive->order;
  double speed;
  int wanted;
  ecatm_drive_step(drive, time);
  *now = drive->order_before;
  now->reset_input = fault_reset;
  if (fault_reset && !drive->order_before.reset_input) now->reset_pending = 1;
  if (drive->view.connected && drive->view.state < ECATM_FAULT_REACTION_ACTIVE)
    now->reset_pending = 0;
  now->start_up = ecatm_sdo_list_write(drive->list, time, order, ecatm_drive_asks(drive, enable));
  /* Even a short request lasts until the drive leaves its operation. */
  now->stopping = quick_stop || (drive->order_before.stopping &&
                                 drive->view.state == ECATM_OPERATION_ENABLED);
  wanted = ecatm_drive_wanted(drive, enable);
  ecatm_drive_watch_edge(drive);
  now->word = ecatm_drive_word(drive, wanted && now->start_up == ECATM_SDO_DONE, now->stopping);
  now->following = drive->view.enabled && now->word == 0x0F;
  if (now->following && !ecatm_finite(reference)) {
    ModelicaFormatError("EtherCAT: %sthe reference of the drive of slave %d is not a finite number",
                        drive->node.heading, drive->list->transfer.slave.position);
    return 0;
  }
  if (!now->following) now->arrived = 0;
  ecatm_drive_watch_mode(drive);
  now->target = drive->view.position;
  if (ecatm_drive_positions(s->mode)) now->target = ecatm_drive_target(drive, reference);
  if (s->mode == ECATM_PROFILE_POSITION)
    ecatm_drive_offer(drive);
  else
    now->set_point = ecatm_drive_wrap(now->target);
  speed = ecatm_drive_velocities(s->mode) ? drive->view.velocity : 0;
  if (now->following && ecatm_drive_velocities(s->mode))
    speed = reference * s->gear / ECATM_TWO_PI * s->velocity_scale;
  *mode = ecatm_drive_mode_now(drive);
  *position = now->set_point;
  *velocity = ecatm_drive_hold(speed, -2147483647.0, 2147483647.0);
  *torque = now->following && ecatm_drive_torques(s->mode) ? ecatm_drive_torque(s, reference) : 0;
  *start_up = now->start_up;
  *max_torque = ecatm_drive_hold(s->max_torque / s->rated_torque * 1000, 0, 65535);
  return now->word;
}

#endif
