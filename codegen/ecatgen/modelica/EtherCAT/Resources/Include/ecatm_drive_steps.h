/* A sample of a drive with the device profile CiA 402: the calls of EtherCAT.Drives.CiA402. ecat_drive.h has the
 * state machine and the conversions.
 *
 * Call measure() first and then command(). measure() does not depend on a reference, so that a controller
 * between the two makes no algebraic loop. Both compute from the results of the sample before, and may be
 * called again at the same time.
 */
#ifndef ECATM_DRIVE_STEPS_H
#define ECATM_DRIVE_STEPS_H

#include "ecatm_drive.h"

/* Reads what the drive says of its motor whenever the drive appears, and compares the parameters with it. */
ECATM_FUNCTION void ecatm_drive_compare(ecatm_drive *drive) {
  const ecatm_drive_settings *s = &drive->settings;
  ecatm_drive_data *data = drive->data;
  const double *values = data->values;
  double turns = values[ECATM_REVOLUTIONS] > 0 ? values[ECATM_REVOLUTIONS] : 1;
  if (!drive->drive.view.connected && data->transfer.handle < 0) {
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
ECATM_FUNCTION void ecatm_drive_begin(ecatm_drive *drive, double time) {
  if (drive->time >= 0 && ecatm_same_time(time, drive->time)) return;
  drive->time = time;
  drive->start_up_before = drive->start_up;
  ecatm_drive_compare(drive);
}

/* Computes the actual values in SI units at the output of the gear, and returns the state. Without valid
 * data the values stay as they were, and so does the state for max_dropout. `order` is any value that
 * must be computed before this call. */
ECATM_FUNCTION int ecatm_drive_measure(void *object, double time, int order, int valid, int status,
                                       int display, int position, int velocity, int torque,
                                       int current, double *phi, double *w, double *tau, double *i,
                                       int *enabled) {
  ecatm_drive *drive = (ecatm_drive *)object;
  const ecat_drive_view *view = &drive->drive.view;
  ecat_drive_inputs inputs;
  (void)order;
  ecatm_drive_begin(drive, time);
  memset(&inputs, 0, sizeof inputs);
  inputs.valid = valid;
  inputs.losses = drive->node.master->session.losses;
  inputs.status = status;
  inputs.display = display;
  inputs.position = position;
  inputs.velocity = velocity;
  inputs.torque = torque;
  inputs.current = current;
  ecat_drive_measure(&drive->drive, time, &inputs);
  *phi = view->position;
  *w = view->speed;
  *tau = view->torque;
  *i = view->current;
  *enabled = view->enabled && drive->drive.order_before.request.mode == drive->settings.mode;
  return view->state;
}

/* Logs once that the drive stays in another mode, since no other message says why it does not move. */
ECATM_FUNCTION void ecatm_drive_watch_mode(ecatm_drive *drive) {
  if (drive->drive.order.mode_for < ECAT_DRIVE_MODE_PATIENCE || drive->told) return;
  drive->told = 1;
  ModelicaFormatMessage("EtherCAT: %sthe drive of slave %d is not enabled: it stays in mode of operation "
                        "%d (0x6061) and does not take %d; choose a mode of its object 0x6502, or "
                        "write 0x6060 in startUp\n",
                        drive->node.heading, drive->list->transfer.slave.position,
                        drive->drive.view.raw.display, drive->settings.mode);
}

/* Logs once that the drive waits for an edge of `enable`; of the sample before, since a tool may evaluate this one
 * again with another `enable`. */
ECATM_FUNCTION void ecatm_drive_watch_edge(ecatm_drive *drive) {
  const ecat_drive_order *before = &drive->drive.order_before;
  int waits = drive->settings.restart != ECAT_DRIVE_AUTOMATIC && before->request.enable && before->waits != NULL;
  if (waits && !drive->told_lost)
    ModelicaFormatMessage("EtherCAT: %sthe drive of slave %d stays off until enable is switched off and on "
                          "again, because %s; with restart = Automatic it starts by itself\n",
                          drive->node.heading, drive->list->transfer.slave.position, before->waits);
  drive->told_lost = waits;
}

/* The trigger of the start-up list, which is written at a rising edge: when the drive is connected
 * (again), and after a refusal when the model enables the drive again. */
ECATM_FUNCTION int ecatm_drive_asks(const ecatm_drive *drive, int enable) {
  return drive->drive.view.connected && (enable || drive->start_up_before != ECATM_SDO_FAILED);
}

/* Computes mode and targets for a reference in SI units at the output of the gear, and returns the control
 * word. The reference is an angle in position modes, a speed in velocity modes, a torque in torque modes.
 * Until the drive is enabled, the targets follow its actual values. `start_up` is the enum
 * ecatm_sdo_state of the start-up list. `order` is a result of measure(). */
ECATM_FUNCTION int ecatm_drive_command(void *object, double time, int order, int enable,
                                       int quick_stop, int fault_reset, int home, double reference, int *mode,
                                       int *position, int *velocity, int *torque, int *max_torque,
                                       int *start_up, int *homing, int *reached) {
  ecatm_drive *drive = (ecatm_drive *)object;
  ecat_drive_request request;
  ecat_drive_outputs outputs;
  ecatm_drive_begin(drive, time);
  drive->start_up = ecatm_sdo_list_write(drive->list, time, order, ecatm_drive_asks(drive, enable));
  memset(&request, 0, sizeof request);
  request.mode = home && drive->drive.view.state == ECAT_DRIVE_OPERATION ? ECAT_DRIVE_HOMING : drive->settings.mode;
  request.home = home;
  request.ready = drive->start_up == ECATM_SDO_DONE;
  request.enable = enable;
  request.quick_stop = quick_stop;
  request.fault_reset = fault_reset;
  request.target = reference;
  if (ecat_drive_command(&drive->drive, time, &request, &outputs) != 0) {
    ModelicaFormatError("EtherCAT: %sthe reference of the drive of slave %d is not a finite number",
                        drive->node.heading, drive->list->transfer.slave.position);
    return 0;
  }
  ecatm_drive_watch_edge(drive);
  ecatm_drive_watch_mode(drive);
  *mode = outputs.mode;
  *position = outputs.position;
  *velocity = outputs.velocity;
  *torque = outputs.torque;
  *max_torque = outputs.max_torque;
  *start_up = drive->start_up;
  *homing = drive->drive.order.homing;
  *reached = drive->drive.order.reached;
  return outputs.control;
}

#endif
