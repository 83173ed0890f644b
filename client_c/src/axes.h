/* A group of axes, for its own parts only. */
#ifndef ECAT_AXES_INTERNAL_H
#define ECAT_AXES_INTERNAL_H

#include "internal.h"

#include <ecat/ecat_axis.h>
#include <pthread.h>

enum { AXES_MAX = 16 };

struct ecat_axes {
  ecat_t *bus;
  int count, together, running, observes;
  double lease;
  ecat_axis axis[AXES_MAX];        /* of the thread, once it runs */
  uint64_t claimed_ns;             /* when it has claimed the outputs again */
  int claimed, stopped;            /* an axis has stopped without a request, so all do until `enable` of all is 0 */
  pthread_t thread;
  pthread_mutex_t lock;
  pthread_cond_t moved;
  /* Behind the lock: */
  int end;
  ecat_drive_request wanted[AXES_MAX];
  uint64_t asked;                  /* number of the last request */
  uint64_t published, seen;        /* exchanges, and those that were waited for */
  ecat_axis_state state[AXES_MAX];
  char error[512];
};

/* axis.c: the index of an object that a mode needs and that is not in the process data; 0: there is none. */
unsigned axis_lacks(const ecat_axis *axis, int mode);

#endif
