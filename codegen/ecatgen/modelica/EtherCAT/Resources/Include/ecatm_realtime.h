/* The pace of a model without a bus: simulation time follows the clock of the machine. */
#ifndef ECATM_REALTIME_H
#define ECATM_REALTIME_H

#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>

#include "ModelicaUtilities.h"
#include "ecatm_system.h"

/* Numbers of EtherCAT.Types.ProcessPriority. */
enum ecatm_priority {
  ECATM_PRIORITY_IDLE = 1,
  ECATM_PRIORITY_BELOW_NORMAL = 2,
  ECATM_PRIORITY_NORMAL = 3,
  ECATM_PRIORITY_HIGH = 4,
  ECATM_PRIORITY_REALTIME = 5
};

#define ECATM_FIFO 40 /* below interrupt threads (50) and the engine of ecatd (80) */

typedef struct ecatm_realtime {
  int started;                /* the first step was made; the following members are valid from then on */
  double time;                /* simulation time of the last step, s */
  double goal;                /* time at which that step should end, s of ecatm_now() */
  double left;                /* time at which the last step ended, s of ecatm_now() */
  double calculation;         /* results of the last step, see ecatm_realtime_step() */
  double available;
  double lateness;
  int missed;
  int policy, nice;           /* scheduling before this object; to be restored if `changed` */
  struct sched_param parameters;
  int changed;
} ecatm_realtime;

/* Logs that the system refuses a priority; the simulation goes on without it. */
ECATM_FUNCTION void ecatm_priority_refused(int priority) {
  const char *name = priority == ECATM_PRIORITY_REALTIME ? "Realtime" : "High";
  const char *limit = priority == ECATM_PRIORITY_REALTIME ? "rtprio 40" : "nice -20";
  ModelicaFormatMessage("EtherCAT: the simulation keeps its priority, because the system does not "
                        "permit %s (%s); give its user the limit '%s' in "
                        "/etc/security/limits.conf and log in again, or choose Normal\n",
                        name, strerror(errno), limit);
}

/* The nice value of a priority. */
ECATM_FUNCTION int ecatm_priority_nice(int priority) {
  return priority == ECATM_PRIORITY_IDLE ? 19 : priority == ECATM_PRIORITY_BELOW_NORMAL ? 10 : -20;
}

/* Sets the priority of the calling thread, which is the thread of the simulation. If a low priority is
 * wanted and the thread has that or a lower one already, nothing changes. */
ECATM_FUNCTION void ecatm_priority_set(ecatm_realtime *clock, int priority) {
  struct sched_param fifo;
  int failed, wanted = ecatm_priority_nice(priority);
  clock->policy = sched_getscheduler(0);
  sched_getparam(0, &clock->parameters);
  clock->nice = getpriority(PRIO_PROCESS, 0);
  if (priority < ECATM_PRIORITY_IDLE || priority > ECATM_PRIORITY_REALTIME ||
      priority == ECATM_PRIORITY_NORMAL || (wanted > 0 && clock->nice >= wanted))
    return;
  memset(&fifo, 0, sizeof fifo);
  fifo.sched_priority = ECATM_FIFO;
  failed = priority == ECATM_PRIORITY_REALTIME ? sched_setscheduler(0, SCHED_FIFO, &fifo)
                                               : setpriority(PRIO_PROCESS, 0, wanted);
  if (failed)
    ecatm_priority_refused(priority);
  else
    clock->changed = 1;
}

/* Makes a clock, and sets the priority of the simulation (enum ecatm_priority, 0: leave it as it is). */
ECATM_FUNCTION void *ecatm_realtime_open(int priority) {
  ecatm_realtime *clock = (ecatm_realtime *)calloc(1, sizeof *clock);
  if (clock == NULL) {
    ModelicaError("EtherCAT: out of memory");
    return NULL;
  }
  ecatm_priority_set(clock, priority);
  return clock;
}

/* Frees the clock and restores the priority, if the system permits that. */
ECATM_FUNCTION void ecatm_realtime_close(void *object) {
  ecatm_realtime *clock = (ecatm_realtime *)object;
  if (clock == NULL) return;
  if (clock->changed) {
    sched_setscheduler(0, clock->policy, &clock->parameters);
    setpriority(PRIO_PROCESS, 0, clock->nice);
  }
  free(clock);
}

/* Moves the clock on to a new simulation time, and waits until that time. */
ECATM_FUNCTION void ecatm_realtime_advance(ecatm_realtime *clock, double time, double scaling,
                                           double max_delay) {
  double arrived = ecatm_now();
  if (!clock->started || time < clock->time) { /* a tool may begin again with the same object */
    clock->goal = clock->left = arrived;
    clock->missed = 0;
    clock->time = time;
  }
  clock->goal = scaling > 0 ? clock->goal + (time - clock->time) * scaling : arrived;
  clock->calculation = arrived - clock->left;
  clock->available = clock->goal - clock->left;
  clock->lateness = arrived > clock->goal ? arrived - clock->goal : 0;
  clock->missed += clock->lateness > 0;
  if (clock->lateness > max_delay) clock->goal = arrived;
  ecatm_sleep_until(clock->goal);
  clock->started = 1;
  clock->time = time;
  clock->left = ecatm_now();
}

/* Waits until the clock of the machine has advanced by `scaling` times the simulation time since the step
 * before. A step that comes too late does not wait, and the following steps catch up. After a delay of
 * more than `max_delay` seconds they do not catch up: the clock goes on from now. With scaling 0 no step
 * waits. A tool may make the same step twice; the second call has the results of the first:
 *
 * results[0]: time from the end of the step before to this one, s
 * results[1]: upper limit for results[0], s; negative if the delay is longer than the step
 * results[2]: delay of this step, s; 0 if it came in time
 * results[3]: number of steps that came too late */
ECATM_FUNCTION void ecatm_realtime_step(void *object, double time, double scaling, double max_delay,
                                        double *results) {
  ecatm_realtime *clock = (ecatm_realtime *)object;
  if (!(scaling >= 0)) {
    ModelicaFormatError("EtherCAT: the clock cannot be scaled by %g: the input scaling of "
                        "SynchronizeRealtime must not be negative", scaling);
    return;
  }
  if (!clock->started || time != clock->time)
    ecatm_realtime_advance(clock, time, scaling, max_delay);
  results[0] = clock->calculation;
  results[1] = clock->available;
  results[2] = clock->lateness;
  results[3] = clock->missed;
}

#endif
