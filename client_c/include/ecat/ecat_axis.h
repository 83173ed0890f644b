/* An axis: a drive (ecat_drive.h) on a bus (ecat.h). It finds the objects of CiA 402 in the process data of a slave, and
 * takes units from the bus description.
 *
 * In each cycle:
 *
 *     ecat_wait(bus, 1, 1.0);
 *     ecat_sample(bus);
 *     ecat_axis_read(&axis);                  // axis.drive.view has position, speed, torque and state
 *     axis.request.enable = 1;
 *     axis.request.target = ...;
 *     ecat_axis_write(&axis);
 *     ecat_commit(bus);
 *
 * Several axes that move together, without a loop of the program: ecat_axes.
 *
 * C89-clean.
 */
#ifndef ECAT_AXIS_H
#define ECAT_AXIS_H

#include "ecat_drive.h"

#ifdef __cplusplus
extern "C" {
#endif

#define ECAT_AXIS_OBJECTS 16
#define ECAT_AXIS_NAME 48

typedef struct ecat_axis {
  ecat_drive drive;              /* `drive.view`: what the axis does; `drive.order`: what becomes of the request */
  ecat_drive_request request;    /* set by the program */
  int linear;                    /* positions are in m, not in rad */
  int torque_unit;               /* 1: torques are in N.m, 2: in N; 0: 1 is the rated torque, since the bus has no unit */
  int slave, number;             /* its position on the bus, and its axis, 1 first */
  ecat_t *bus;                   /* this member and the following ones are for ecat_axis_*() only */
  char name[ECAT_AXIS_NAME];
  int signals[ECAT_AXIS_OBJECTS]; /* handles of its objects, -1: not in the process data */
  char place[ECAT_AXIS_NAME];    /* of its slave, as the program has named it */
  double found[4];               /* its scales, as the bus has them */
  int changed;                   /* the daemon came back with other slaves or units, so that nothing is written */
  double time;                   /* seconds of bus cycles */
  uint64_t cycle, instance, now_ns;
  unsigned losses;
  int status_signal;
} ecat_axis;

/* Finds an axis: `slave` is a position or a name, `number` 1 for the first axis. `settings` of `axis->drive` are then
 * those of the bus; the program may change them until the first ecat_axis_read().
 * ECAT_ESIGNAL: it is no drive, or lacks controlword or statusword. ECAT_EARG: a unit that is none of a position, a
 * velocity, a torque or a current. */
ECAT_API int ecat_axis_open(ecat_axis *axis, ecat_t *bus, const char *slave, int number);
/* Checks the settings, and that the process data have what a mode needs. */
ECAT_API int ecat_axis_check(ecat_axis *axis, int mode);
/* Takes the last sample. */
ECAT_API int ecat_axis_read(ecat_axis *axis);
/* Stages what the request makes of it. The program has claimed the slave. ECAT_ELEASE: the claim is lost; when the slave is
 * claimed again, the axis needs an edge of `enable`, as its `restart` says. ECAT_EBUS: the daemon was started again,
 * and this axis is another one now, or counts in other units: open it again. */
ECAT_API int ecat_axis_write(ecat_axis *axis);

/* --- Axes that move together: a thread of the library exchanges them in every bus cycle, over a connection of its
 * own. The program says what it wants, and looks at what they do. --- */

typedef struct ecat_axes ecat_axes;

typedef struct ecat_axis_state {
  ecat_drive_view view;
  ecat_drive_order order;
  int code;                      /* of the last exchange: 0, or an error of ecat.h */
  uint64_t cycle;                /* bus cycle */
  uint64_t answered;             /* number of the last request that is in effect */
} ecat_axis_state;

/* Connects. After a failure *axes is set for ecat_axes_error(), and must be closed. */
ECAT_API int ecat_axes_open(ecat_axes **axes, const char *bus);
/* The text of the last failure; never NULL. */
ECAT_API const char *ecat_axes_error(const ecat_axes *axes);
/* Adds an axis before the start, and returns its number in the group, 0 first. */
ECAT_API int ecat_axes_add(ecat_axes *axes, const char *slave, int number);
/* The axis, whose settings may be changed before the start; NULL if there is none. */
ECAT_API ecat_axis *ecat_axes_axis(ecat_axes *axes, int axis);
/* Claims the outputs of all axes, and begins. With `together`, all axes stop when one of them stops without a request,
 * and each needs an edge of `enable` then. */
ECAT_API int ecat_axes_start(ecat_axes *axes, double lease, int together);
/* Begins to look only: nothing is claimed or written, so that another program may move the axes. */
ECAT_API int ecat_axes_observe(ecat_axes *axes);
/* Replaces the requests of all axes at once: `requests` has one for each. Returns their number, see `answered`. */
ECAT_API uint64_t ecat_axes_request(ecat_axes *axes, const ecat_drive_request *requests);
/* The axis in the last cycle. */
ECAT_API int ecat_axes_state(ecat_axes *axes, int axis, ecat_axis_state *state);
/* Waits until there is a cycle after the last call, or returns ECAT_ETIMEOUT. */
ECAT_API int ecat_axes_wait(ecat_axes *axes, double timeout);
/* A sentence about an axis, see ecat_drive_explain(). */
ECAT_API char *ecat_axes_explain(ecat_axes *axes, int axis, char text[ECAT_DRIVE_TEXT]);
/* --- Movements. `which` has a bit for each axis that is meant, ECAT_AXES_ALL for all of them. These calls wait until it is
 * done, or return ECAT_ETIMEOUT; ECAT_ESTATE: an axis has stopped, or has failed. ecat_axes_error() then has a sentence
 * with axis, state, statusword and error code. With a timeout of 0 they begin only, and ecat_axes_poll() says when it
 * is done. --- */

#define ECAT_AXES_ALL 0xFFFFu

/* What axes can be waited for. */
enum ecat_axes_goal {
  ECAT_AXES_ENABLED = 1,         /* they follow their targets */
  ECAT_AXES_OFF,                 /* they are switched off */
  ECAT_AXES_WELL,                /* they have no fault */
  ECAT_AXES_HOMED,
  ECAT_AXES_REACHED,             /* they are at their targets */
  ECAT_AXES_STOPPED              /* they are out of operation, or stand in a quick stop */
};

/* Whether it is so in the last cycle, and the last request is in effect: 0, ECAT_EBUSY, or ECAT_ESTATE: it will not be. */
ECAT_API int ecat_axes_poll(ecat_axes *axes, unsigned which, int goal);
/* Waits for it. */
ECAT_API int ecat_axes_await(ecat_axes *axes, unsigned which, int goal, double timeout);
/* Takes axes into operation, where they stand. */
ECAT_API int ecat_axes_enable(ecat_axes *axes, unsigned which, double timeout);
ECAT_API int ecat_axes_disable(ecat_axes *axes, unsigned which, double timeout);
/* Resets their faults. */
ECAT_API int ecat_axes_reset(ecat_axes *axes, unsigned which, double timeout);
/* Homes axes in operation by the methods that the drives have in 0x6098; ecat_sdo_start() sets another one before. */
ECAT_API int ecat_axes_home(ecat_axes *axes, unsigned which, double timeout);
/* Ends homing that was begun with a timeout of 0: back to mode CSP. */
ECAT_API int ecat_axes_leave_home(ecat_axes *axes, unsigned which, double timeout);
/* Moves axes in operation to positions, one for each axis that is meant. They go in step, on a straight
 * line of positions, and arrive together: as fast as all of them may. `speeds` and `accelerations` have a number for each, too; NULL: those of the settings. */
ECAT_API int ecat_axes_move(ecat_axes *axes, unsigned which, const double *positions, const double *speeds,
                            const double *accelerations, double timeout);
/* Begins to move axes in operation with speeds (mode CSV) or torques (mode CST), and returns at once. */
ECAT_API int ecat_axes_run(ecat_axes *axes, unsigned which, const double *speeds);
/* Has axes in operation follow positions that the program sends again and again, at most `interval` seconds apart, as a
 * controller does. The axes approach the first one. With `interval` 0 each position goes out at once; else the axes get
 * straight lines between them, one interval late. Returns at once. */
ECAT_API int ecat_axes_follow(ecat_axes *axes, unsigned which, const double *positions, double interval);
ECAT_API int ecat_axes_push(ecat_axes *axes, unsigned which, const double *torques);
/* Stops axes by their quick stop. */
ECAT_API int ecat_axes_stop(ecat_axes *axes, unsigned which, double timeout);

/* Ends: the outputs go to their safe values. */
ECAT_API void ecat_axes_close(ecat_axes *axes);

#ifdef __cplusplus
}
#endif

#endif
