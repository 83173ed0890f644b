/* The experiment of Figures 8 and 9 of the paper, in C: a point-to-point reference drives the motor
 * of the rig `troll` in velocity mode, paced by the bus.
 *
 *     figure9 [BUS [SECONDS [FILE.csv]]]        (ecat0, 10, figure9.csv)
 *
 * It makes the same calls, in the same order, as the generated model
 * TrollPlant.Examples.PointToPointMovement. Build it against a generated library only:
 *
 *     gcc -O2 -I OUT/EtherCAT/Resources/Include -I OUT/EtherCAT/Resources/Source/standalone \
 *         -I OUT/TrollPlant/Resources/Source figure9.c \
 *         OUT/EtherCAT/Resources/Library/linux64/libecat.a -lm -o figure9
 */
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "TrollPlant.h"

#define SAMPLE_TIME 0.001
#ifndef LEASE
#define LEASE 0.1 /* seconds without samples until the outputs become safe */
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

/* Runs at every end of the program: the outputs of the drive become safe first. */
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
  TrollPlant_Drives_GoldGCONDrive drive;
  ecatm_drive_settings settings;
  int n, samples = (int)(seconds / SAMPLE_TIME + 0.5), skipped = 0, last = 0;
  int every = isatty(STDERR_FILENO) ? 100 : 1000;

  ecatm_drive_defaults(&settings, ECAT_DRIVE_CYCLIC_VELOCITY, 65536);
  settings.rated_torque = settings.max_torque = 0.4;
  settings.rated_current = 5;
  TrollPlant_Drives_GoldGCONDrive_open(&drive, run.master, 1, &settings, NULL, 0);

  for (n = 0; n <= samples && !interrupted; n++) {
    double time = n * SAMPLE_TIME;
    row *r = &run.rows[n];
    int cycle = ecatm_wait(run.master, time);
    TrollPlant_Drives_GoldGCONDrive_read(&drive, time, cycle);
    drive.enable = drive.faultReset = 1;
    drive.reference = point_to_point(time);
    TrollPlant_Drives_GoldGCONDrive_write(&drive, time, cycle);

    r->time = time;
    r->w_ref = drive.reference;
    r->w_m = drive.w;
    r->i_m = drive.i;
    run.count = n + 1;
    if (n > 0 && cycle - last > 1) skipped += cycle - last - 1;
    last = cycle;
    if (n % every == 0) show_progress(time, seconds, r->w_m);
  }
  /* Each sample waits for the next cycle: a machine that is too busy takes longer than the model's time. */
  fprintf(stderr, "\n%s: %d samples in %d bus cycles, %d of which were left out\n",
          interrupted ? "interrupted" : "finished", run.count, run.count + skipped, skipped);

  TrollPlant_Drives_GoldGCONDrive_close(&drive);
}

int main(int argc, char **argv) {
  const char *bus = argc > 1 ? argv[1] : "ecat0";
  double seconds = argc > 2 ? atof(argv[2]) : 10;
  run.file = argc > 3 ? argv[3] : "figure9.csv";
  if (argc > 4 || !(seconds > 0 && seconds <= 3600)) {
    fprintf(stderr, "usage: figure9 [BUS [SECONDS [FILE.csv]]]\n");
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
