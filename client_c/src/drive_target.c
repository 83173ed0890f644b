/* Drives: the target of each mode, its limits, and whether it is reached. */
#include "drive.h"

#include <stddef.h>

int drive_hold(double value, double low, double high) {
  value = ecat_round(value);
  return (int)(value < low ? low : value > high ? high : value);
}

static double held(ecat_drive *drive, double value, double low, double high) {
  if (value >= low && value <= high) return value;
  drive->order.limited = 1;
  return value < low ? low : high;
}

static void trip(ecat_drive *drive, const char *why) {
  drive->order.trip = why;
  drive->order.waits = why;
  drive->order.armed = 0;
}

static int has_limits(const ecat_drive_settings *s) { return s->low <= s->high; }

/* --- between two targets of the program ------------------------------------------------------- */

static int is_cyclic(int mode) { return mode >= ECAT_DRIVE_CYCLIC_POSITION; }

/* The target of this sample: on a straight line from the target before, if the program sends targets more seldom than
 * the bus takes them. A line begins where the one before is, so that a target that comes early or late makes no step. */
static void interpolate(ecat_drive *drive) {
  const ecat_drive_order *before = &drive->order_before;
  ecat_drive_order *now = &drive->order;
  double wanted = now->request.target, left;
  if (!(now->request.interval > 0) || !is_cyclic(now->request.mode) || !now->following || !before->following ||
      before->request.mode != now->request.mode) {
    now->line_from = now->line_to = wanted;
    now->line_left = 0;
    return;
  }
  if (wanted != before->line_to) {
    now->line_from = before->request.target; /* where it was in the sample before */
    now->line_to = wanted;
    now->line_left = now->request.interval;
  }
  left = now->line_left - drive->elapsed;
  now->line_left = left > 1e-9 ? left : 0;
  now->request.target = now->line_to - (now->line_to - now->line_from) * (now->line_left / now->request.interval);
}

/* --- positions -------------------------------------------------------------------------------- */

/* Increments for a length in rad. Positions in a drive may count the other way. */
static double increments(const ecat_drive *drive, double angle) { return angle / drive->settings.position_scale; }

/* The next target on the way to `wanted`, with limited speed and acceleration; both in increments. `step` of the order is
 * the speed. The speed from which the axis can still stop at `wanted` is sqrt(2 a d). */
static double approach(ecat_drive *drive, double wanted) {
  const ecat_drive_settings *s = &drive->settings;
  const ecat_drive_request *request = &drive->order.request;
  ecat_drive_order *now = &drive->order;
  double unit = fabs(s->position_scale), from = drive->order_before.target, rest = wanted - from;
  double most = (request->speed > 0 ? request->speed : s->approach_speed) / unit;
  double rate = (request->acceleration > 0 ? request->acceleration : s->approach_acceleration) / unit;
  double sign = rest < 0 ? -1 : 1, speed = most, passed = drive->elapsed;
  if (passed <= 0) return from;
  if (rate > 0) {
    double before = sign * drive->order_before.step;
    /* At the end of this sample it must still be able to stop. */
    double stops = sqrt(rate * (2 * fabs(rest) + 0.25 * rate * passed * passed)) - 0.5 * rate * passed;
    if (speed > stops) speed = stops;
    if (speed > before + rate * passed) speed = before + rate * passed;
    if (speed < before - rate * passed) speed = before - rate * passed;
  }
  if (fabs(rest) < 0.5 || (speed > 0 && fabs(rest) <= speed * passed)) {
    now->arrived = 1;
    now->step = 0;
    return wanted;
  }
  now->step = sign * speed;
  return from + now->step * passed;
}

/* Cuts a goal, so that the way to it is still one with limited speed and acceleration. An axis that is beyond a limit
 * stays there until it is moved back: its limit is where it stands. */
static double within_limits(ecat_drive *drive, double goal) {
  const ecat_drive_settings *s = &drive->settings;
  double from = drive->order_before.target, one, other;
  if (!has_limits(s)) return goal;
  one = increments(drive, s->low);
  other = increments(drive, s->high);
  return held(drive, goal, fmin(fmin(one, other), from), fmax(fmax(one, other), from));
}

/* The target position in increments, without overflow, before the limit of its speed. */
static double position_target(ecat_drive *drive) {
  const ecat_drive_order *before = &drive->order_before;
  ecat_drive_order *now = &drive->order;
  double wanted = increments(drive, now->request.target);
  if (!before->following || before->request.mode != now->request.mode) {
    now->offset = drive->view.increments - wanted;
    return drive->view.increments;
  }
  if (now->request.hold) {
    now->arrived = 1;
    return before->target;
  }
  if (before->request.hold) now->arrived = 0;
  if (drive->settings.reference == ECAT_DRIVE_RELATIVE) wanted += now->offset;
  wanted = within_limits(drive, wanted);
  if (drive->settings.reference == ECAT_DRIVE_RELATIVE) return wanted;
  if (now->request.mode == ECAT_DRIVE_PROFILE_POSITION) return wanted; /* the drive makes the way */
  if (now->request.speed > 0 && now->request.target != before->request.target) now->arrived = 0;
  return now->arrived ? wanted : approach(drive, wanted);
}

static double within_speed(ecat_drive *drive, double target) {
  const ecat_drive_settings *s = &drive->settings;
  if (s->max_speed > 0 && drive->order.request.mode == ECAT_DRIVE_CYCLIC_POSITION && drive->order_before.following) {
    double most = s->max_speed / fabs(s->position_scale) * drive->elapsed, from = drive->order_before.target;
    target = held(drive, target, from - most, from + most);
  }
  return target;
}

#define NEW_SET_POINT 0x10
#define AT_ONCE 0x20
#define ACKNOWLEDGED 0x1000
#define TARGET_REACHED 0x0400

/* Profile position: a new set-point is offered by bit 4 until the drive acknowledges it by bit 12. */
static void offer(ecat_drive *drive) {
  const ecat_drive_order *before = &drive->order_before;
  ecat_drive_order *now = &drive->order;
  int acknowledged = (drive->view.raw.status & ACKNOWLEDGED) != 0, wanted = drive_wrap(now->target);
  now->offered = before->offered < 1000 ? before->offered + 1 : before->offered;
  if (!now->following || !before->following) {
    now->out.position = wanted;
    now->strobe = 0;
    now->offered = 0;
  } else if (before->strobe) {
    now->strobe = !acknowledged;
    now->offered = 0;
  } else if (!acknowledged && wanted != before->out.position) {
    now->out.position = wanted;
    now->strobe = 1;
    now->offered = 0;
  }
  if (now->following) now->out.control |= now->strobe ? NEW_SET_POINT | AT_ONCE : AT_ONCE;
  /* Bit 10 may be that of the set-point before for some cycles. */
  now->reached = now->following && !now->strobe && !acknowledged && now->offered > 10 &&
                 wanted == now->out.position && (drive->view.raw.status & TARGET_REACHED) != 0;
}

static void watch_following_error(ecat_drive *drive) {
  const ecat_drive_settings *s = &drive->settings;
  double lag = fabs((drive->order.target - drive->view.increments) * s->position_scale);
  if (s->max_following_error > 0 && drive->order.following && lag > s->max_following_error)
    trip(drive, "its following error was beyond its limit");
}

static void set_position(ecat_drive *drive) {
  ecat_drive_order *now = &drive->order;
  now->target = drive->view.increments;
  if (!now->following) {
    now->arrived = 0;
    now->step = 0;
  } else if (ecat_drive_positions(now->request.mode)) {
    int halts = now->request.halt && drive->order_before.following;
    now->target = halts ? drive->order_before.target : within_speed(drive, position_target(drive));
  }
  if (now->request.mode == ECAT_DRIVE_PROFILE_POSITION) {
    offer(drive);
    return;
  }
  now->out.position = drive_wrap(now->target);
  if (now->request.mode != ECAT_DRIVE_CYCLIC_POSITION) return;
  watch_following_error(drive);
  now->reached = now->following && !now->limited && fabs(drive->view.speed) <= drive->settings.standstill_speed &&
                 (now->arrived || drive->settings.reference == ECAT_DRIVE_RELATIVE) &&
                 fabs((now->target - drive->view.increments) * drive->settings.position_scale) <= drive->settings.window;
}

/* --- velocities and torques ------------------------------------------------------------------- */

/* Whether the axis is at a limit of its position, or beyond it, and `direction` leads further. */
static int leads_out(const ecat_drive *drive, double direction) {
  const ecat_drive_settings *s = &drive->settings;
  if (!has_limits(s)) return 0;
  return (drive->view.position >= s->high && direction > 0) || (drive->view.position <= s->low && direction < 0);
}

/* A speed with which the axis can still stop at the limit of its position. */
static double braked(ecat_drive *drive, double speed) {
  const ecat_drive_settings *s = &drive->settings;
  double rest = speed > 0 ? s->high - drive->view.position : drive->view.position - s->low, most;
  if (!has_limits(s) || speed == 0) return speed;
  most = rest <= 0 ? 0 : s->approach_acceleration > 0 ? sqrt(2 * s->approach_acceleration * rest) : HUGE_VAL;
  return held(drive, speed, -most, most);
}

static void set_velocity(ecat_drive *drive) {
  const ecat_drive_settings *s = &drive->settings;
  ecat_drive_order *now = &drive->order;
  double speed = now->request.target;
  if (!ecat_drive_velocities(now->request.mode) || !now->following) {
    now->out.velocity = ecat_drive_velocities(now->request.mode)
                            ? drive_hold(drive->view.raw_velocity, -2147483647.0, 2147483647.0) : 0;
    return;
  }
  if (now->request.halt) speed = 0;
  if (s->max_speed > 0) speed = held(drive, speed, -s->max_speed, s->max_speed);
  speed = braked(drive, speed);
  now->reached = fabs(drive->view.speed - speed) <= s->standstill_speed;
  if (fabs(speed / s->velocity_scale) > 2147483647.0) now->limited = 1;
  now->out.velocity = drive_hold(speed / s->velocity_scale, -2147483647.0, 2147483647.0);
}

/* Also the largest torque is observed here, since not every drive has 0x6072 in its process data. */
static void set_torque(ecat_drive *drive) {
  const ecat_drive_settings *s = &drive->settings;
  ecat_drive_order *now = &drive->order;
  double most = s->max_torque / fabs(s->torque_scale), wanted;
  now->out.torque = 0;
  if (!now->following || !ecat_drive_torques(now->request.mode)) return;
  if (leads_out(drive, drive->view.speed)) trip(drive, "it went beyond the limits of its position");
  if (s->max_speed > 0 && fabs(drive->view.speed) > s->max_speed) trip(drive, "it was faster than its limit");
  if (most > 32767) most = 32767;
  wanted = now->request.halt ? 0 : now->request.target / s->torque_scale;
  if (wanted > most || wanted < -most) now->limited = 1;
  now->out.torque = drive_hold(wanted, -most, most);
  now->reached = 1;
}

/* 0x6081, 0x6083 and 0x6084 are those of the request, else those of the settings. */
static void set_profile(ecat_drive *drive) {
  const ecat_drive_settings *s = &drive->settings;
  const ecat_drive_request *request = &drive->order.request;
  double speed = request->speed > 0 ? request->speed : s->approach_speed;
  double acceleration = request->acceleration > 0 ? request->acceleration : s->approach_acceleration;
  if (s->max_speed > 0 && speed > s->max_speed) speed = s->max_speed;
  drive->order.out.profile_velocity = drive_hold(fabs(speed / s->velocity_scale), 0, 2147483647.0);
  drive->order.out.profile_acceleration = drive_hold(fabs(acceleration / s->velocity_scale), 0, 2147483647.0);
}

void drive_target(ecat_drive *drive) {
  interpolate(drive);
  set_position(drive);
  set_velocity(drive);
  set_torque(drive);
  set_profile(drive);
}
