/* The start-up state machine EtherCAT.Drives.StartUp, with its EtherCAT.SDOWrite, in C. */
#ifndef START_UP_H
#define START_UP_H

#include "ecat_modelica.h"

enum drive_mode { PROFILE_VELOCITY = 3, CYCLIC_VELOCITY = 9 };

enum drive_state {
  NOT_READY_TO_SWITCH_ON,
  SWITCH_ON_DISABLED,
  READY_TO_SWITCH_ON,
  SWITCHED_ON,
  OPERATION_ENABLED,
  QUICK_STOP_ACTIVE,
  FAULT_REACTION_ACTIVE,
  FAULT
};

typedef struct start_up {
  void *sdo;
  int mode;
  int abort_code; /* of the SDO that writes the mode */
  enum drive_state state;
  int control_word;
  int enabled;
} start_up;

/* EtherCAT.Functions.driveState */
static enum drive_state drive_state_of(int status_word) {
  if (status_word & 0x08) return status_word & 0x04 ? FAULT_REACTION_ACTIVE : FAULT;
  if (status_word & 0x40) return SWITCH_ON_DISABLED;
  if (!(status_word & 0x01)) return NOT_READY_TO_SWITCH_ON;
  if (!(status_word & 0x20)) return QUICK_STOP_ACTIVE;
  if (status_word & 0x04) return OPERATION_ENABLED;
  return status_word & 0x02 ? SWITCHED_ON : READY_TO_SWITCH_ON;
}

/* EtherCAT.Functions.driveControl, with resetFault = true */
static int drive_control(enum drive_state state, int enable, int last) {
  switch (state) {
    case FAULT: return enable && last != 0x80 ? 0x80 : 0;
    case NOT_READY_TO_SWITCH_ON:
    case FAULT_REACTION_ACTIVE:
    case QUICK_STOP_ACTIVE: return 0;
    default: break;
  }
  if (!enable || state == SWITCH_ON_DISABLED) return 0x06;
  return state == READY_TO_SWITCH_ON ? 0x07 : 0x0F;
}

static void start_up_open(start_up *start, void *master, int position, enum drive_mode mode) {
  memset(start, 0, sizeof *start);
  start->mode = mode;
  start->sdo = ecatm_sdo_open(master, position, 0, 0, 2 /* INTEGER8 */, ECATM_INTEGER_VALUE,
                             ECATM_TRIGGERED, 0, 1, 0, "0x6060:00");
}

static void start_up_step(start_up *start, double time, int cycle, int enable,
                          int status_word) {
  int state = ecatm_sdo_write_integer(start->sdo, time, cycle, enable, start->mode);
  start->abort_code = ecatm_sdo_abort_code(start->sdo, state);
  start->state = drive_state_of(status_word);
  start->control_word = drive_control(start->state, enable && state == ECATM_SDO_DONE,
                                      start->control_word);
  start->enabled = start->state == OPERATION_ENABLED;
}

static void start_up_close(start_up *start) { ecatm_sdo_close(start->sdo); }

#endif
