/* Axes that move together: a thread exchanges them in every bus cycle. */
#include "axes.h"

#include <signal.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <time.h>

enum { STACK_BYTES = 256 * 1024 };
#define RECLAIM_NS 100000000u
#define PATIENCE_S 0.1 /* for a cycle, between two looks whether the thread shall end */

static void keep_error(ecat_axes *axes) {
  pthread_mutex_lock(&axes->lock);
  snprintf(axes->error, sizeof axes->error, "%s", ecat_error(axes->bus));
  pthread_mutex_unlock(&axes->lock);
}

static int fail(ecat_axes *axes, int code) {
  if (code < 0) keep_error(axes);
  return code;
}

int ecat_axes_open(ecat_axes **result, const char *bus) {
  ecat_axes *axes = calloc(1, sizeof *axes);
  pthread_condattr_t clock;
  *result = axes;
  if (axes == NULL) return ECAT_ESYS;
  pthread_mutex_init(&axes->lock, NULL);
  pthread_condattr_init(&clock);
  pthread_condattr_setclock(&clock, CLOCK_MONOTONIC);
  pthread_cond_init(&axes->moved, &clock);
  pthread_condattr_destroy(&clock);
  return fail(axes, ecat_open(&axes->bus, bus));
}

const char *ecat_axes_error(const ecat_axes *axes) { return axes == NULL ? "out of memory" : axes->error; }

int ecat_axes_add(ecat_axes *axes, const char *slave, int number) {
  int code;
  if (axes->count == AXES_MAX || axes->running)
    return fail(axes, ecat_fail(axes->bus, ECAT_EARG, axes->running ? "the axes move already: add axes before"
                                                                    : "a group has at most 16 axes"));
  code = ecat_axis_open(&axes->axis[axes->count], axes->bus, slave, number);
  return code < 0 ? fail(axes, code) : axes->count++;
}

ecat_axis *ecat_axes_axis(ecat_axes *axes, int axis) {
  return axis >= 0 && axis < axes->count ? &axes->axis[axis] : NULL;
}

/* --- the thread ------------------------------------------------------------------------------- */

static int claim(ecat_axes *axes) {
  int i, code = 0;
  for (i = 0; i < axes->count && code == 0; i++) code = ecat_claim(axes->bus, axes->axis[i].slave, axes->lease);
  axes->claimed = code == 0;
  axes->claimed_ns = ecat_now();
  return code;
}

/* Whether an axis that was in operation is not any more, although its request has not changed. */
static int has_stopped(const ecat_axis *axis) {
  const ecat_drive *drive = &axis->drive;
  return drive->order.trip != NULL ||
         (drive->view_before.enabled && !drive->view.enabled && axis->request.enable && !axis->request.quick_stop &&
          drive->order.waits != NULL);
}

/* One axis stops, all stop: with a quick stop, until the program wants none of them enabled. */
static void stop_together(ecat_axes *axes) {
  int i, wanted = 0;
  for (i = 0; i < axes->count; i++) {
    wanted |= axes->axis[i].request.enable;
    axes->stopped |= axes->together && has_stopped(&axes->axis[i]);
  }
  if (!wanted) axes->stopped = 0;
}

static int exchange(ecat_axes *axes) {
  int i, code = ecat_sample(axes->bus), written;
  for (i = 0; i < axes->count; i++) {
    int one = ecat_axis_read(&axes->axis[i]);
    if (code == 0) code = one;
  }
  pthread_mutex_lock(&axes->lock);
  for (i = 0; i < axes->count; i++) {
    axes->axis[i].request = axes->wanted[i];
    axes->axis[i].request.quick_stop |= axes->stopped;
    axes->state[i].answered = axes->asked;
  }
  pthread_mutex_unlock(&axes->lock);
  if (axes->observes) return code;
  for (i = 0; i < axes->count; i++) {
    written = ecat_axis_write(&axes->axis[i]);
    if (code == 0) code = written;
  }
  stop_together(axes);
  for (i = 0; i < axes->count; i++)
    if (axes->axis[i].changed) return ECAT_EBUS; /* the outputs stay at their safe values */
  written = axes->claimed ? ecat_commit(axes->bus) : ECAT_ELEASE;
  if (written == ECAT_ELEASE && axes->claimed)
    for (i = 0; i < axes->count; i++) axes->axis[i].losses++;
  if (written < 0) axes->claimed = 0;
  return code != 0 ? code : written;
}

static void publish(ecat_axes *axes, int code) {
  int i;
  pthread_mutex_lock(&axes->lock);
  for (i = 0; i < axes->count; i++) {
    axes->state[i].view = axes->axis[i].drive.view;
    axes->state[i].order = axes->axis[i].drive.order;
    axes->state[i].code = code;
    axes->state[i].cycle = ecat_cycle(axes->bus);
  }
  if (code < 0) snprintf(axes->error, sizeof axes->error, "%s", ecat_error(axes->bus));
  axes->published++;
  pthread_cond_broadcast(&axes->moved);
  pthread_mutex_unlock(&axes->lock);
}

static int shall_end(ecat_axes *axes) {
  int end;
  pthread_mutex_lock(&axes->lock);
  end = axes->end;
  pthread_mutex_unlock(&axes->lock);
  return end;
}

static void *run(void *argument) {
  ecat_axes *axes = argument;
  prctl(PR_SET_NAME, "ecat-axes");
  while (!shall_end(axes)) {
    struct timespec pause = {0, 10000000};
    int code = ecat_wait(axes->bus, 1, PATIENCE_S);
    if (!axes->claimed && !axes->observes && ecat_now() - axes->claimed_ns > RECLAIM_NS && code == 0) (void)claim(axes);
    publish(axes, exchange(axes));
    if (code != 0 && code != ECAT_ETIMEOUT) nanosleep(&pause, NULL); /* no daemon: it may come back */
  }
  return NULL;
}

static int begin(ecat_axes *axes) {
  pthread_attr_t attributes;
  sigset_t all, before;
  int i;
  for (i = 0; i < axes->count; i++) axes->wanted[i] = axes->axis[i].request;
  sigfillset(&all);
  pthread_attr_init(&attributes);
  pthread_attr_setstacksize(&attributes, STACK_BYTES);
  pthread_sigmask(SIG_SETMASK, &all, &before); /* signals are for the program */
  axes->running = pthread_create(&axes->thread, &attributes, run, axes) == 0;
  pthread_sigmask(SIG_SETMASK, &before, NULL);
  pthread_attr_destroy(&attributes);
  return axes->running ? 0 : fail(axes, ecat_fail(axes->bus, ECAT_ESYS, "the thread of the axes cannot be started"));
}

static int check_start(ecat_axes *axes) {
  if (axes->running) return fail(axes, ecat_fail(axes->bus, ECAT_EARG, "the axes move already"));
  return axes->count > 0 ? 0 : fail(axes, ecat_fail(axes->bus, ECAT_EARG, "there is no axis to start"));
}

int ecat_axes_observe(ecat_axes *axes) {
  int code = check_start(axes);
  axes->observes = 1;
  return code != 0 ? code : begin(axes);
}

int ecat_axes_start(ecat_axes *axes, double lease, int together) {
  int i, code = check_start(axes);
  for (i = 0; i < axes->count && code == 0; i++)
    code = fail(axes, ecat_axis_check(&axes->axis[i], axes->axis[i].request.mode));
  if (code != 0) return code;
  axes->lease = lease;
  axes->together = together;
  return (code = claim(axes)) < 0 ? fail(axes, code) : begin(axes);
}

/* --- the program ------------------------------------------------------------------------------ */

uint64_t ecat_axes_request(ecat_axes *axes, const ecat_drive_request *requests) {
  uint64_t number;
  pthread_mutex_lock(&axes->lock);
  memcpy(axes->wanted, requests, (size_t)axes->count * sizeof *requests);
  number = ++axes->asked;
  pthread_mutex_unlock(&axes->lock);
  return number;
}

int ecat_axes_state(ecat_axes *axes, int axis, ecat_axis_state *state) {
  if (axis < 0 || axis >= axes->count) return ECAT_EARG;
  pthread_mutex_lock(&axes->lock);
  *state = axes->state[axis];
  pthread_mutex_unlock(&axes->lock);
  return 0;
}

int ecat_axes_wait(ecat_axes *axes, double timeout) {
  struct timespec until;
  uint64_t end = ecat_now() + (uint64_t)(timeout > 0 ? timeout * 1e9 : 0);
  int code = 0;
  until.tv_sec = (time_t)(end / 1000000000u);
  until.tv_nsec = (long)(end % 1000000000u);
  pthread_mutex_lock(&axes->lock);
  while (code == 0 && axes->published == axes->seen)
    code = pthread_cond_timedwait(&axes->moved, &axes->lock, &until);
  axes->seen = axes->published;
  pthread_mutex_unlock(&axes->lock);
  return code == 0 ? 0 : ECAT_ETIMEOUT;
}

char *ecat_axes_explain(ecat_axes *axes, int axis, char text[ECAT_DRIVE_TEXT]) {
  ecat_drive drive;
  text[0] = '\0';
  if (axis < 0 || axis >= axes->count) return text;
  drive.settings = axes->axis[axis].drive.settings; /* nobody changes them */
  pthread_mutex_lock(&axes->lock);
  drive.view = axes->state[axis].view;
  drive.order = axes->state[axis].order;
  pthread_mutex_unlock(&axes->lock);
  return ecat_drive_explain(&drive, text);
}

void ecat_axes_close(ecat_axes *axes) {
  int i;
  if (axes == NULL) return;
  if (axes->running) {
    pthread_mutex_lock(&axes->lock);
    axes->end = 1;
    pthread_mutex_unlock(&axes->lock);
    pthread_join(axes->thread, NULL);
  }
  /* In order, so that the daemon does not take the next client of this slot for the end of this one. */
  for (i = 0; axes->claimed && i < axes->count; i++) (void)ecat_release(axes->bus, axes->axis[i].slave);
  ecat_close(axes->bus);
  pthread_cond_destroy(&axes->moved);
  pthread_mutex_destroy(&axes->lock);
  free(axes);
}
