/* A drive with the device profile CiA 402 (IEC 61800-7-201 and -301): its state machine, and conversions between raw
 * process data and SI units at the output of the gear. This header knows no bus: ecat_axis.h connects a drive with
 * the entries of a slave.
 *
 * Call in each sample ecat_drive_measure(), and then ecat_drive_command(). measure() does not depend on a target, so
 * that a controller between the two makes no algebraic loop. Both compute from the results of the sample before, and
 * may be called again at the same time, as simulation tools do.
 *
 * Angles are in rad, speeds in rad/s, torques in N.m; of a linear axis in m, m/s, N.
 *
 * C89-clean.
 */
#ifndef ECAT_DRIVE_H
#define ECAT_DRIVE_H

#include "ecat.h"

#ifdef __cplusplus
extern "C" {
#endif

/* The numbers are those of EtherCAT.Types.DriveState. */
enum ecat_drive_state {
  ECAT_DRIVE_NOT_READY = 1,      /* not ready to switch on, or not connected */
  ECAT_DRIVE_SWITCH_ON_DISABLED,
  ECAT_DRIVE_READY,              /* ready to switch on */
  ECAT_DRIVE_SWITCHED_ON,
  ECAT_DRIVE_OPERATION,          /* operation enabled */
  ECAT_DRIVE_QUICK_STOP,         /* quick stop active */
  ECAT_DRIVE_FAULT_REACTION,
  ECAT_DRIVE_FAULT
};

/* Modes of operation, object 0x6060. */
enum ecat_drive_mode {
  ECAT_DRIVE_PROFILE_POSITION = 1,
  ECAT_DRIVE_PROFILE_VELOCITY = 3,
  ECAT_DRIVE_PROFILE_TORQUE = 4,
  ECAT_DRIVE_HOMING = 6,
  ECAT_DRIVE_CYCLIC_POSITION = 8,
  ECAT_DRIVE_CYCLIC_VELOCITY = 9,
  ECAT_DRIVE_CYCLIC_TORQUE = 10
};

/* What enables a drive again after a loss or a quick stop; the numbers are those of EtherCAT.Types.DriveRestart. A fault
 * is reset by an edge of `fault_reset` in both cases. */
enum ecat_drive_restart {
  ECAT_DRIVE_AUTOMATIC = 1,      /* it starts by itself as soon as it can */
  ECAT_DRIVE_EDGE                /* `enable` must change from 0 to 1. 1 in the first sample counts as a change if
                                    the drive is switched off without a fault */
};

/* Meaning of a target position; the numbers are those of EtherCAT.Types.DriveReference. */
enum ecat_drive_reference {
  ECAT_DRIVE_RELATIVE = 1,       /* the axis moves by as much as the target since it was enabled */
  ECAT_DRIVE_ABSOLUTE            /* the axis approaches the target, and then follows it */
};

/* Objects in the process data, in addition to controlword and statusword. */
enum ecat_drive_entries {
  ECAT_DRIVE_HAS_MODE_DISPLAY = 1,  /* 0x6061 */
  ECAT_DRIVE_HAS_POSITION = 2,      /* 0x6064 */
  ECAT_DRIVE_HAS_VELOCITY = 4,      /* 0x606C */
  ECAT_DRIVE_HAS_TORQUE = 8,        /* 0x6077 */
  ECAT_DRIVE_HAS_CURRENT = 16,      /* 0x6078 */
  ECAT_DRIVE_HAS_ERROR_CODE = 32    /* 0x603F */
};

/* How homing goes (IEC 61800-7-201, mode HM); the numbers are those of EtherCAT.Types.DriveHoming. */
enum ecat_drive_homing {
  ECAT_DRIVE_NOT_HOMED = 1,
  ECAT_DRIVE_HOMES,
  ECAT_DRIVE_HOMED,
  ECAT_DRIVE_HOMING_FAILED
};

typedef struct ecat_drive_settings {
  const char *name;              /* of the axis, for messages */
  int restart;                   /* enum ecat_drive_restart */
  int reference;                 /* enum ecat_drive_reference */
  int entries;                   /* enum ecat_drive_entries, added up */
  int changes_mode;              /* the mode may change in operation, at standstill; else the drive is switched off for
                                    it */
  double position_scale;         /* rad for 1 in 0x6064 and 0x607A; negative if the output turns the other way */
  double velocity_scale;         /* rad/s for 1 in 0x606C, 0x60FF, 0x6081, and rad/s^2 for 1 in 0x6083, 0x6084 */
  double torque_scale;           /* N.m for 1 in 0x6071, 0x6072, 0x6077 */
  double current_scale;          /* A for 1 in 0x6078 */
  /* Limits of what is sent to the drive. */
  double max_torque;
  double low, high;              /* of positions; low > high: none */
  double max_speed;              /* 0: none */
  double max_following_error;    /* of cyclic positions: beyond it the drive is stopped; 0: none */
  /* The way to an absolute position in cyclic position mode, unless the request says otherwise. */
  double approach_speed, approach_acceleration; /* acceleration 0: none is observed */
  double window;                 /* an axis has reached its target within so many rad */
  double standstill_speed;       /* below it, a quick stop is over */
  double max_dropout;            /* seconds for which the state is kept without valid data */
} ecat_drive_settings;

/* What a drive says, raw. */
typedef struct ecat_drive_inputs {
  int valid;                     /* the values are those of the last cycle */
  unsigned losses;               /* counts losses of the bus and of the claim: another number is a loss */
  int status;                    /* 0x6041 */
  int display;                   /* 0x6061 */
  int position, velocity;        /* 0x6064, 0x606C */
  int torque, current;           /* 0x6077, 0x6078 */
  int error;                     /* 0x603F */
} ecat_drive_inputs;

/* What the program wants. */
typedef struct ecat_drive_request {
  int mode;                      /* enum ecat_drive_mode */
  int ready;                     /* the drive may be enabled: its parameters were written */
  int enable;                    /* it shall be in operation */
  int quick_stop;                /* it shall stop quickly */
  int halt;                      /* it shall stand still, in operation */
  int fault_reset;               /* a change from 0 to 1 resets a fault */
  int hold;                      /* position modes: the axis stays where it stands when it begins; `target` is not used */
  int home;                      /* in mode HOMING: it homes while this is 1 */
  double target;                 /* rad, rad/s or N.m, as the mode says */
  double speed, acceleration;    /* of the way to a position; 0: those of the settings, or of the drive */
  double interval;               /* cyclic modes: seconds from one target to the next one. The drive gets straight lines
                                    between them, one interval late; 0: each target at once */
} ecat_drive_request;

/* What is written to a drive, raw. */
typedef struct ecat_drive_outputs {
  int control;                   /* 0x6040 */
  int mode;                      /* 0x6060 */
  int position, velocity, torque; /* 0x607A, 0x60FF, 0x6071 */
  int max_torque;                /* 0x6072 */
  int profile_velocity;          /* 0x6081; 0: the drive's own */
  int profile_acceleration;      /* 0x6083 and 0x6084; 0: the drive's own */
} ecat_drive_outputs;

/* The memory of measure(); positions are increments, without overflow. */
typedef struct ecat_drive_view {
  int state;                     /* enum ecat_drive_state */
  int enabled;                   /* the drive follows its target */
  int connected;                 /* there were valid data within `max_dropout` */
  double position, speed, torque, current; /* rad, rad/s, N.m, A; as they were while there are no valid data */
  int seen;                      /* this and the following members are for ecat_drive_*() only */
  double seen_at;
  double increments, raw_velocity, raw_torque;
  ecat_drive_inputs raw;
} ecat_drive_view;

/* The memory of command(). */
typedef struct ecat_drive_order {
  int reached;                   /* the axis has reached its target, or its target speed */
  int limited;                   /* a limit has changed the target */
  int homing;                    /* enum ecat_drive_homing */
  const char *waits;             /* why `enable` must change from 0 to 1 before the drive is enabled; NULL: it need not */
  const char *trip;              /* why the drive was stopped by a limit; NULL: it was not */
  ecat_drive_outputs out;        /* this and the following members are for ecat_drive_*() only */
  ecat_drive_request request;
  int begun;                     /* there was a sample */
  int met;                       /* the drive was connected once since `enable` changed */
  int armed;                     /* `enable` has changed since the last loss, fault or quick stop */
  int stopping;                  /* a quick stop is wanted, or the drive has not reacted to one yet */
  int reset_pending;             /* a fault may be reset */
  int following, arrived;        /* the target comes from the request; it was reached once */
  double offset;                 /* target - request, of relative targets, in increments */
  double target, step;           /* increments, and change of it per second */
  double line_from, line_to, line_left; /* the straight line between two targets of the request, and its rest in seconds */
  int strobe, offered;           /* profile position: bit 4; samples since the set-point was accepted */
  int home_seen;                 /* the drive has shown that homing is under way */
  double homing_for;             /* seconds since homing has begun */
  double mode_for;               /* seconds for which the drive has not changed to the mode */
} ecat_drive_order;

typedef struct ecat_drive {
  ecat_drive_settings settings;
  int stepped;                   /* `time` is valid */
  double time, elapsed;          /* of this sample, and since the one before */
  ecat_drive_view view, view_before;
  ecat_drive_order order, order_before;
} ecat_drive;

#define ECAT_DRIVE_TEXT 256      /* longest text of ecat_drive_explain(), with its NUL */
#define ECAT_DRIVE_MODE_PATIENCE 2.0 /* seconds that a drive has to change its mode */

/* Settings of a drive that counts so many increments per revolution, in increments per second and 1/1000 of a torque
 * and a current of 1, with all objects that a drive usually has in its process data. */
ECAT_API void ecat_drive_defaults(ecat_drive_settings *settings, double increments);
/* A sentence about the first setting that cannot be; NULL: all can. */
ECAT_API const char *ecat_drive_wrong(const ecat_drive_settings *settings);
ECAT_API void ecat_drive_init(ecat_drive *drive, const ecat_drive_settings *settings);

/* Takes what the drive says. `time` is in seconds, of any clock. */
ECAT_API void ecat_drive_measure(ecat_drive *drive, double time, const ecat_drive_inputs *inputs);
/* Computes what is written to the drive. Until it is enabled, its targets follow the actual values. Returns 0 or
 * ECAT_EARG: the target is no finite number, or the mode none of the above. */
ECAT_API int ecat_drive_command(ecat_drive *drive, double time, const ecat_drive_request *request,
                                ecat_drive_outputs *outputs);

/* Whether a mode has a target position, velocity or torque. */
ECAT_API int ecat_drive_positions(int mode);
ECAT_API int ecat_drive_velocities(int mode);
ECAT_API int ecat_drive_torques(int mode);
/* The state in a statusword. */
ECAT_API int ecat_drive_state_of(int status);
/* Names as CiA 402 has them: "operation enabled", "cyclic synchronous position", "motor blocked". Of an error code
 * that is not known, its class. */
ECAT_API const char *ecat_drive_state_text(int state);
ECAT_API const char *ecat_drive_mode_text(int mode);
ECAT_API const char *ecat_drive_error_text(int code);
/* Writes a sentence: name of the axis, state, statusword, error code, and why it is not in operation. Returns `text`. */
ECAT_API char *ecat_drive_explain(const ecat_drive *drive, char text[ECAT_DRIVE_TEXT]);

#ifdef __cplusplus
}
#endif

#endif
