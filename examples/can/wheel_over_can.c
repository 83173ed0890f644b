/* The experiment of Figure 9 of the paper with a CANopen drive: node 5 on the CAN bus behind the
 * terminal `can` of the rig `troll-can`, paced by the EtherCAT bus.
 *
 *     wheel_over_can [BUS [SECONDS [FILE.csv]]]        (ecat0, 10, figure9-can.csv)
 *
 * It makes the same calls, in the same order, as the model WheelOverCAN.mo. Build it against a
 * generated library only:
 *
 *     gcc -O2 -I OUT/EtherCAT/Resources/Include -I OUT/EtherCAT/Resources/Source/standalone \
 *         -I OUT/TrollPlant/Resources/Source wheel_over_can.c \
 *         OUT/EtherCAT/Resources/Library/linux64/libecat.a -lm -o wheel_over_can
 */
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#include "TrollPlant.h"

#define SAMPLE_TIME 0.001
#ifndef LEASE
#define LEASE 0.1 /* seconds without samples until ecatd stops the drive */
#endif

/* Parameters of the model: the drive, and the component `reference`, in rad of the motor. */
static const double resolution = 65536, rated_current = 5, two_pi = 6.283185307179586;
static const double distance = 471.24, max_speed = 62.832, max_acceleration = 125.66, start_time = 1;
static const int cyclic_velocity = 9;

typedef struct row {
  double time, w_ref, w_m, i_m, age;
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

/* WheelOverCAN.command: the control word that leads from a state towards "Operation enabled" (CiA 402). */
static int command(int status) {
  if (status & 0x08) return 0x80; /* fault reset */
  if (status & 0x40) return 0x06; /* shutdown */
  return status & 0x02 ? 0x0F : 0x07;
}

static void write_rows(void) {
  int n;
  FILE *file = run.count > 0 ? fopen(run.file, "w") : NULL;
  if (file == NULL) {
    if (run.count > 0) perror(run.file);
    return;
  }
  fprintf(file, "time,w_ref,w_m,i_m,age_m\n");
  for (n = 0; n < run.count; n++) {
    const row *r = &run.rows[n];
    fprintf(file, "%.6f,%.6f,%.6f,%.6f,%.9g\n", r->time, r->w_ref, r->w_m, r->i_m, r->age);
  }
  if (fclose(file) != 0) perror(run.file);
}

/* Runs at every end of the program: ecatd stops the drive first. */
static void clean_up(void) {
  ecatm_master_close(run.master);
  write_rows();
}

static void show_progress(double time, double seconds, double speed) {
  static const char *const end[] = {"\n", "\r"};
  fprintf(stderr, "  %4.1f of %g s, speed %6.2f rad/s%s", time, seconds, speed,
          end[isatty(STDERR_FILENO) != 0]);
}

static void experiment(double seconds) {
  static const int start_node[8] = {1, 5}, nothing[8] = {0};
  TrollPlant_Can can;
  void *start, *sync;
  int n, samples = (int)(seconds / SAMPLE_TIME + 0.5), skipped = 0, last = 0;
  int every = isatty(STDERR_FILENO) ? 100 : 1000;

  TrollPlant_Can_open(&can, run.master, 1);
  ecatm_can_transmission(can.message_2, ECAT_SESSION_ON_TRIGGER, 0);
  ecatm_can_transmission(can.message_3, ECAT_SESSION_EACH_SAMPLE, 0);
  ecatm_can_transmission(can.message_4, ECAT_SESSION_ON_TRIGGER, 0);
  start = ecatm_can_open(can.slave, 0x000, 0, 0, 1, 2, ECAT_SESSION_ON_CHANGE, 0, 0, 0);
  sync = ecatm_can_open(can.slave, 0x080, 0, 0, 1, 0, ECAT_SESSION_EACH_SAMPLE, 0, 0, 0);

  for (n = 0; n <= samples && !interrupted; n++) {
    double time = n * SAMPLE_TIME;
    row *r = &run.rows[n];
    int cycle = ecatm_wait(run.master, time);
    TrollPlant_Can_read(&can, time, cycle);
    r->time = time;
    r->w_ref = point_to_point(time);
    r->w_m = can.node5TPDO3VelocityActualValue * two_pi / resolution;
    r->i_m = can.node5TPDO4TorqueActualValue * rated_current / 1000;
    r->age = can.node5TPDO3Age;
    run.count = n + 1;

    ecatm_can_write_frame(start, time, cycle, start_node);
    ecatm_can_send(start, time, cycle, 0);
    can.node5RPDO1ModesOfOperation = cyclic_velocity;
    can.node5RPDO1Controlword = can.node5RPDO3Controlword =
      can.node5TPDO4Valid ? command(can.node5TPDO4Statusword) : 0;
    can.node5RPDO3TargetVelocity = ecatm_nearest_integer(r->w_ref * resolution / two_pi);
    TrollPlant_Can_write(&can, time, cycle);
    ecatm_can_write_frame(sync, time, cycle, nothing);
    ecatm_can_send(sync, time, cycle, 0);

    if (n > 0 && cycle - last > 1) skipped += cycle - last - 1;
    last = cycle;
    if (n % every == 0) show_progress(time, seconds, r->w_m);
  }
  /* Each sample waits for the next cycle: a machine that is too busy takes longer than the model's time. */
  fprintf(stderr, "\n%s: %d samples in %d bus cycles, %d of which were left out\n",
          interrupted ? "interrupted" : "finished", run.count, run.count + skipped, skipped);

  ecatm_can_close(sync);
  ecatm_can_close(start);
  TrollPlant_Can_close(&can);
}

int main(int argc, char **argv) {
  const char *bus = argc > 1 ? argv[1] : "ecat0";
  double seconds = argc > 2 ? atof(argv[2]) : 10;
  run.file = argc > 3 ? argv[3] : "figure9-can.csv";
  if (argc > 4 || !(seconds > 0 && seconds <= 3600)) {
    fprintf(stderr, "usage: wheel_over_can [BUS [SECONDS [FILE.csv]]]\n");
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
