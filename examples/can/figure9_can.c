/* The paper's next step, in C: the experiment of its Figures 8 and 9 with a CANopen drive behind an EL6751.
 *
 *     figure9_can [BUS [SECONDS [FILE.csv]]]        (ecat0, 10, figure9_can.csv)
 *
 * It makes the same calls, in the same order, as the model CanopenDrive.mo: EtherCAT.Drives.CiA402 leads the drive with the
 * PDOs of its EDS file. examples/can/README.md has all commands.
 */
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "CanPlant.h"

#define SAMPLE_TIME 0.001
#ifndef LEASE
#define LEASE 0.1 /* seconds without samples until the daemon stops the node */
#endif

/* Parameters of the component `reference`, in rad of the motor. */
static const double distance = 471.24, max_speed = 62.832, max_acceleration = 125.66, start_time = 1;

typedef struct row {
  double time, w_ref, w_m, i_m;
} row;

/* All that must be put right when the program ends, however it does. */
static struct {
  void *master;
  const char *file;
  row *rows;
  int count;
} run;

static volatile sig_atomic_t interrupted;

static void interrupt(int number) {
  (void)number;
  interrupted = 1;
}

/* EtherCAT.Sources.PointToPoint */
static double point_to_point(double time) {
  double ramp = max_speed / max_acceleration;
  double duration = distance > max_speed * ramp ? distance / max_speed + ramp
                                                : 2 * sqrt(distance / max_acceleration);
  double left = fmin(time - start_time, start_time + duration - time);
  return fmax(0, fmin(max_speed, max_acceleration * left));
}

static void write_rows(void) {
  int n;
  FILE *file = run.count > 0 ? fopen(run.file, "w") : NULL;
  if (file == NULL) {
    if (run.count > 0) perror(run.file);
    return;
  }
  fprintf(file, "time,w_ref,w_m,i_m\n");
  for (n = 0; n < run.count; n++) {
    const row *r = &run.rows[n];
    fprintf(file, "%.6f,%.6f,%.6f,%.6f\n", r->time, r->w_ref, r->w_m, r->i_m);
  }
  if (fclose(file) != 0) perror(run.file);
}

/* Runs at every end of the program. */
static void clean_up(void) {
  ecatm_master_close(run.master);
  write_rows();
}

static void experiment(double seconds) {
  static const int start[8] = {1, 5}, nothing[8] = {0}; /* NMT: start node 5 */
  CanPlant_CanDrives can;
  ecatm_drive_settings settings;
  void *drive, *nmt, *sync;
  int state = 1, enabled = 0, start_up, valid, n, samples = (int)(seconds / SAMPLE_TIME + 0.5);

  CanPlant_CanDrives_open(&can, run.master, 1);
  nmt = ecatm_can_open(can.slave, 0, 0, 0, 1, 2, ECAT_SESSION_ON_CHANGE, 0.5, 0, 0);
  sync = ecatm_can_open(can.slave, 0x80, 0, 0, 1, 0, ECAT_SESSION_EACH_SAMPLE, 0, 0, 0);
  ecatm_drive_defaults(&settings, ECATM_CYCLIC_VELOCITY, 65536);
  settings.rated_torque = settings.max_torque = 0.4;
  settings.rated_current = 5;
  settings.entries = ECATM_HAS_MODE_DISPLAY | ECATM_HAS_POSITION | ECATM_HAS_VELOCITY | ECATM_HAS_TORQUE;
  drive = ecatm_drive_new(run.master, 6, "can-drives", &settings, NULL, 0, "");

  for (n = 0; n <= samples && !interrupted; n++) {
    double time = n * SAMPLE_TIME, phi, tau;
    row *r = &run.rows[n];
    int mode, position, velocity, torque, most, word, cycle = ecatm_wait(run.master, time);
    CanPlant_CanDrives_read(&can, time, cycle);
    valid = can.node5TPDO2Valid && can.node5TPDO3Valid; /* which come with each SYNC */
    state = ecatm_drive_measure(drive, time, cycle, valid, can.node5TPDO2Statusword,
                                can.node5TPDO1ModesOfOperationDisplay,
                                can.node5TPDO3PositionActualValue, can.node5TPDO3VelocityActualValue,
                                can.node5TPDO4TorqueActualValue, 0, &phi, &r->w_m, &tau, &r->i_m, &enabled);
    r->time = time;
    r->w_ref = point_to_point(time);
    word = ecatm_drive_command(drive, time, state, 1, 0, 1, r->w_ref, &mode, &position, &velocity, &torque,
                               &most, &start_up);
    can.node5RPDO1Controlword = can.node5RPDO2Controlword = word;
    can.node5RPDO3Controlword = can.node5RPDO4Controlword = word;
    can.node5RPDO1ModesOfOperation = mode;
    can.node5RPDO2TargetPosition = position;
    can.node5RPDO3TargetVelocity = velocity;
    can.node5RPDO4TargetTorque = torque;
    CanPlant_CanDrives_write(&can, time, cycle);
    ecatm_can_send(nmt, time, ecatm_can_write_frame(nmt, time, cycle, start), 0);
    ecatm_can_send(sync, time, ecatm_can_write_frame(sync, time, cycle, nothing), 0);
    run.count = n + 1;
    if (n % 1000 == 0) fprintf(stderr, "  %4.1f of %g s, speed %6.2f rad/s\n", time, seconds, r->w_m);
  }
  ecatm_drive_close(drive);
  CanPlant_CanDrives_close(&can);
}

int main(int argc, char **argv) {
  const char *bus = argc > 1 ? argv[1] : "ecat0";
  double seconds = argc > 2 ? atof(argv[2]) : 10;
  run.file = argc > 3 ? argv[3] : "figure9_can.csv";
  if (argc > 4 || !(seconds > 0 && seconds <= 3600)) {
    fprintf(stderr, "usage: figure9_can [BUS [SECONDS [FILE.csv]]]\n");
    return 2;
  }
  run.rows = calloc((size_t)(seconds / SAMPLE_TIME) + 2, sizeof *run.rows);
  if (run.rows == NULL) {
    fprintf(stderr, "out of memory\n");
    return EXIT_FAILURE;
  }
  atexit(clean_up);
  signal(SIGINT, interrupt);
  signal(SIGTERM, interrupt);
  run.master = ecatm_master_open(bus, 1, SAMPLE_TIME, 1, LEASE, ECAT_FAILURE_ERROR,
                                 ECAT_FAILURE_ERROR, 0, 0, 0, "");
  experiment(seconds);
  return interrupted ? 130 : 0;
}
