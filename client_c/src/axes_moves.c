/* Axes: movements, and what can be waited for. */
#include "axes.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#define CYCLE_PATIENCE 1.0 /* seconds for a cycle */
#define SETTLE_CYCLES 3    /* in which a drive has seen a request, and has answered */
#define STANDS 0.05        /* rad/s or m/s */

static int is_meant(const ecat_axes *axes, unsigned which, int axis) {
  return axis < axes->count && (which >> axis & 1) != 0;
}

static int fail_axis(ecat_axes *axes, int axis, int code, const char *why) {
  char text[ECAT_DRIVE_TEXT];
  ecat_axes_explain(axes, axis, text);
  pthread_mutex_lock(&axes->lock);
  (void)snprintf(axes->error, sizeof axes->error, "%s: %s", text, why);
  pthread_mutex_unlock(&axes->lock);
  return code;
}

/* --- what can be waited for ------------------------------------------------------------------- */

static int is_so(const ecat_axis_state *state, int goal) {
  const ecat_drive_view *view = &state->view;
  switch (goal) {
    case ECAT_AXES_ENABLED:
      return view->enabled;
    case ECAT_AXES_OFF:
      return !view->connected || view->state == ECAT_DRIVE_FAULT ||
             (view->state < ECAT_DRIVE_SWITCHED_ON && view->state != ECAT_DRIVE_NOT_READY);
    case ECAT_AXES_WELL:
      return view->connected && view->state < ECAT_DRIVE_FAULT_REACTION;
    case ECAT_AXES_HOMED:
      return state->order.homing == ECAT_DRIVE_HOMED;
    case ECAT_AXES_REACHED:
      return state->order.reached;
    default:
      return view->state != ECAT_DRIVE_OPERATION && fabs(view->speed) < STANDS;
  }
}

/* Whether the axis must be in operation meanwhile. */
static int needs_operation(int goal) {
  return goal == ECAT_AXES_ENABLED || goal == ECAT_AXES_HOMED || goal == ECAT_AXES_REACHED;
}

static const char *const NOT_YET[] = {"", "it is not enabled", "it is not switched off", "it has a fault",
                                      "it is not homed", "it is not at its target", "it does not stand"};

int ecat_axes_poll(ecat_axes *axes, unsigned which, int goal) {
  int i, busy = 0, lost = -1, failed = -1, ended = -1, code = 0;
  pthread_mutex_lock(&axes->lock);
  for (i = 0; i < axes->count; i++) {
    const ecat_axis_state *state = &axes->state[i];
    if (!is_meant(axes, which, i)) continue;
    if (state->code == ECAT_EBUS) code = ECAT_EBUS;
    if (goal == ECAT_AXES_HOMED && !axes->wanted[i].home) ended = i; /* by another thread */
    if (state->answered < axes->asked) {
      busy = 1;
    } else if (!is_so(state, goal)) {
      busy = 1;
      if (needs_operation(goal) && (state->order.waits != NULL || state->order.trip != NULL)) lost = i;
      if (goal == ECAT_AXES_HOMED && state->order.homing == ECAT_DRIVE_HOMING_FAILED) failed = i;
    }
  }
  pthread_mutex_unlock(&axes->lock);
  if (code != 0) return code;
  if (ended >= 0) return fail_axis(axes, ended, ECAT_ESTATE, "homing was ended by another request");
  if (failed >= 0) return fail_axis(axes, failed, ECAT_ESTATE, "homing has failed");
  if (lost >= 0) return fail_axis(axes, lost, ECAT_ESTATE, NOT_YET[goal]);
  return busy ? ECAT_EBUSY : 0;
}

/* Waits, unless the caller wants to look itself. */
static int finish(ecat_axes *axes, unsigned which, int goal, double timeout) {
  return timeout > 0 ? ecat_axes_await(axes, which, goal, timeout) : 0;
}

int ecat_axes_await(ecat_axes *axes, unsigned which, int goal, double timeout) {
  uint64_t end = ecat_now() + ecat_ns(timeout);
  int i, code;
  while ((code = ecat_axes_poll(axes, which, goal)) == ECAT_EBUSY && ecat_now() < end)
    (void)ecat_axes_wait(axes, 0.1);
  if (code != ECAT_EBUSY) return code;
  for (i = 0; i < axes->count; i++)
    if (is_meant(axes, which, i) && !is_so(&axes->state[i], goal)) break;
  return fail_axis(axes, i < axes->count ? i : 0, ECAT_ETIMEOUT, NOT_YET[goal]);
}

/* --- requests --------------------------------------------------------------------------------- */

static void copy_requests(ecat_axes *axes, ecat_drive_request *requests) {
  pthread_mutex_lock(&axes->lock);
  memcpy(requests, axes->wanted, sizeof axes->wanted);
  pthread_mutex_unlock(&axes->lock);
}

/* Waits until the last request is in effect, and the drives have seen it. */
static int settle(ecat_axes *axes) {
  uint64_t end = ecat_now() + ecat_ns(CYCLE_PATIENCE);
  int i, asked = 1;
  while (asked) {
    int code = ecat_axes_wait(axes, CYCLE_PATIENCE);
    if (code != 0 || ecat_now() > end) return fail_axis(axes, 0, ECAT_ETIMEOUT, "the bus takes no requests");
    pthread_mutex_lock(&axes->lock);
    asked = axes->state[0].answered < axes->asked;
    pthread_mutex_unlock(&axes->lock);
  }
  for (i = 0; i < SETTLE_CYCLES; i++) (void)ecat_axes_wait(axes, CYCLE_PATIENCE);
  return 0;
}

static double position_of(ecat_axes *axes, int axis) {
  ecat_axis_state state;
  (void)ecat_axes_state(axes, axis, &state);
  return state.view.position;
}

int ecat_axes_enable(ecat_axes *axes, unsigned which, double timeout) {
  ecat_drive_request requests[AXES_MAX];
  ecat_axis_state state;
  int i, code;
  for (i = 0; i < axes->count; i++) /* what is in operation already goes on */
    if (ecat_axes_state(axes, i, &state) == 0 && state.view.enabled && state.order.waits == NULL &&
        axes->wanted[i].enable && !axes->wanted[i].quick_stop)
      which &= ~(1u << i);
  copy_requests(axes, requests);
  for (i = 0; i < axes->count; i++)
    if (is_meant(axes, which, i))
      requests[i].enable = requests[i].quick_stop = requests[i].halt = requests[i].home = requests[i].fault_reset = 0;
  (void)ecat_axes_request(axes, requests);
  if ((code = settle(axes)) != 0) return code;
  for (i = 0; i < axes->count; i++) {
    if (!is_meant(axes, which, i)) continue;
    (void)ecat_axes_state(axes, i, &state);
    if (state.view.state >= ECAT_DRIVE_FAULT_REACTION)
      return fail_axis(axes, i, ECAT_ESTATE, "remove its cause, and reset it");
    requests[i].mode = ECAT_DRIVE_CYCLIC_POSITION;
    requests[i].hold = requests[i].enable = 1;
  }
  (void)ecat_axes_request(axes, requests);
  code = finish(axes, which, ECAT_AXES_ENABLED, timeout);
  if (code != 0) { /* it must not take effect later */
    for (i = 0; i < axes->count; i++)
      if (is_meant(axes, which, i)) requests[i].enable = 0;
    (void)ecat_axes_request(axes, requests);
  }
  return code;
}

int ecat_axes_disable(ecat_axes *axes, unsigned which, double timeout) {
  ecat_drive_request requests[AXES_MAX];
  int i;
  copy_requests(axes, requests);
  for (i = 0; i < axes->count; i++)
    if (is_meant(axes, which, i)) requests[i].enable = requests[i].home = 0;
  (void)ecat_axes_request(axes, requests);
  return finish(axes, which, ECAT_AXES_OFF, timeout);
}

int ecat_axes_reset(ecat_axes *axes, unsigned which, double timeout) {
  ecat_drive_request requests[AXES_MAX];
  int i, step, code = 0;
  for (step = 0; step < 2 && code == 0; step++) { /* a change from 0 to 1 */
    copy_requests(axes, requests);
    for (i = 0; i < axes->count; i++) {
      if (!is_meant(axes, which, i)) continue;
      requests[i].enable = 0;
      requests[i].fault_reset = step;
    }
    (void)ecat_axes_request(axes, requests);
    code = settle(axes);
  }
  return code != 0 ? code : finish(axes, which, ECAT_AXES_WELL, timeout);
}

static int check_enabled(ecat_axes *axes, unsigned which) {
  ecat_axis_state state;
  int i;
  for (i = 0; i < axes->count; i++)
    if (is_meant(axes, which, i) && ecat_axes_state(axes, i, &state) == 0 && !state.view.enabled)
      return fail_axis(axes, i, ECAT_ESTATE, "enable it first");
  return 0;
}

static int begin_home(ecat_axes *axes, unsigned which) {
  ecat_drive_request requests[AXES_MAX];
  int i, code = check_enabled(axes, which);
  if (code != 0) return code;
  copy_requests(axes, requests);
  for (i = 0; i < axes->count; i++) {
    if (!is_meant(axes, which, i)) continue;
    requests[i].mode = ECAT_DRIVE_HOMING;
    requests[i].home = 1;
  }
  (void)ecat_axes_request(axes, requests);
  return 0;
}

int ecat_axes_leave_home(ecat_axes *axes, unsigned which, double timeout) {
  ecat_drive_request requests[AXES_MAX];
  int i, code;
  copy_requests(axes, requests);
  for (i = 0; i < axes->count; i++) {
    if (!is_meant(axes, which, i)) continue;
    requests[i].mode = ECAT_DRIVE_CYCLIC_POSITION;
    requests[i].home = 0;
    requests[i].hold = 1; /* where it has come to rest */
  }
  (void)ecat_axes_request(axes, requests);
  code = settle(axes);
  return code != 0 ? code : finish(axes, which, ECAT_AXES_ENABLED, timeout);
}

int ecat_axes_home(ecat_axes *axes, unsigned which, double timeout) {
  int code = begin_home(axes, which), left;
  if (code != 0 || timeout <= 0) return code;
  code = ecat_axes_await(axes, which, ECAT_AXES_HOMED, timeout);
  if (code == 0) return ecat_axes_leave_home(axes, which, timeout);
  left = ecat_axes_leave_home(axes, which, 0); /* the error text is that of the homing */
  (void)left;
  return code;
}

int ecat_axes_move(ecat_axes *axes, unsigned which, const double *positions, const double *speeds,
                   const double *accelerations, double timeout) {
  ecat_drive_request requests[AXES_MAX];
  double ways[AXES_MAX], speed = HUGE_VAL, acceleration = HUGE_VAL; /* of the part of the way, 0 to 1, that all have gone */
  int i, n = 0, code = check_enabled(axes, which);
  if (code != 0) return code;
  copy_requests(axes, requests);
  for (i = 0; i < axes->count; i++) {
    const ecat_drive_settings *settings = &axes->axis[i].drive.settings;
    if (!is_meant(axes, which, i)) continue;
    requests[i].target = positions[n];
    requests[i].speed = speeds != NULL ? speeds[n] : settings->approach_speed;
    requests[i].acceleration = accelerations != NULL ? accelerations[n] : settings->approach_acceleration;
    n++;
    if (!(requests[i].speed > 0) || !(requests[i].acceleration > 0))
      return fail_axis(axes, i, ECAT_EARG, "speed and acceleration must be positive");
    if (requests[i].target - requests[i].target != 0)
      return fail_axis(axes, i, ECAT_EARG, "its target is no finite number");
    ways[i] = fabs(requests[i].target - position_of(axes, i));
    speed = fmin(speed, requests[i].speed / ways[i]);
    acceleration = fmin(acceleration, requests[i].acceleration / ways[i]);
  }
  for (i = 0; i < axes->count; i++) {
    if (!is_meant(axes, which, i)) continue;
    if (ways[i] * acceleration > 0 && ways[i] > axes->axis[i].drive.settings.window) {
      requests[i].speed = ways[i] * speed;
      requests[i].acceleration = ways[i] * acceleration;
    } /* else it is there already */
    requests[i].mode = ECAT_DRIVE_CYCLIC_POSITION;
    requests[i].interval = 0;
    requests[i].halt = requests[i].home = requests[i].hold = 0;
  }
  (void)ecat_axes_request(axes, requests);
  return finish(axes, which, ECAT_AXES_REACHED, timeout);
}

static int follow(ecat_axes *axes, unsigned which, int mode, const double *targets, double interval) {
  ecat_drive_request requests[AXES_MAX];
  int i, code = check_enabled(axes, which);
  if (code != 0) return code;
  copy_requests(axes, requests);
  for (i = 0; i < axes->count; i++) {
    if (!is_meant(axes, which, i)) continue;
    if (axis_lacks(&axes->axis[i], mode) != 0) {
      char why[96];
      (void)snprintf(why, sizeof why, "mode %s needs 0x%04X, which is not in its process data", ecat_drive_mode_text(mode),
                     axis_lacks(&axes->axis[i], mode));
      return fail_axis(axes, i, ECAT_ESIGNAL, why);
    }
    requests[i].mode = mode;
    requests[i].target = *targets++;
    requests[i].speed = requests[i].acceleration = 0;
    requests[i].interval = interval;
    requests[i].halt = requests[i].home = requests[i].hold = 0;
    if (requests[i].target - requests[i].target != 0)
      return fail_axis(axes, i, ECAT_EARG, "its target is no finite number");
  }
  (void)ecat_axes_request(axes, requests);
  return 0;
}

int ecat_axes_run(ecat_axes *axes, unsigned which, const double *speeds) {
  return follow(axes, which, ECAT_DRIVE_CYCLIC_VELOCITY, speeds, 0);
}

int ecat_axes_follow(ecat_axes *axes, unsigned which, const double *positions, double interval) {
  return follow(axes, which, ECAT_DRIVE_CYCLIC_POSITION, positions, interval > 0 ? interval : 0);
}

int ecat_axes_push(ecat_axes *axes, unsigned which, const double *torques) {
  return follow(axes, which, ECAT_DRIVE_CYCLIC_TORQUE, torques, 0);
}

int ecat_axes_stop(ecat_axes *axes, unsigned which, double timeout) {
  ecat_drive_request requests[AXES_MAX];
  int i;
  copy_requests(axes, requests);
  for (i = 0; i < axes->count; i++) {
    if (!is_meant(axes, which, i)) continue;
    requests[i].quick_stop = 1;
    requests[i].home = 0;
  }
  (void)ecat_axes_request(axes, requests);
  return finish(axes, which, ECAT_AXES_STOPPED, timeout);
}
