/* The experiment of Figures 8 and 9 of the paper, in C: a point-to-point reference drives the motor
 * of the rig `troll` in velocity mode, paced by the bus; inputs of the terminals are read as well.
 *
 *     figure9 [BUS [SECONDS [FILE.csv]]]        (ecat0, 10, figure9.csv)
 *
 * It makes the same calls, in the same order, as the generated model
 * TrollPlant.Examples.PointToPointMovement, and reads the resolution of the encoder and the rated
 * current before. Build it against a generated library only:
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
#include "start_up.h"

#define SAMPLE_TIME 0.001
#define LEASE 0.1 /* seconds without samples until the outputs become safe */

/* Parameters of the component `reference`, in increments of the encoder. */
static const double distance = 4915200, max_speed = 655360, max_acceleration = 1310720,
                    start_time = 1;

typedef struct row {
  double time, w_ref;
  int w_m, i_m, digital[8];
  double analog; /* in V */
} row;

/* All that must be put right when the program ends, however it does. */
static struct {
  void *master;
  const char *file;
  row *rows;
  int count;
  int encoder, revolutions, rated_current; /* 0: the drive does not tell */
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

/* Reads an object of the drive before the experiment; 0 if the drive has none. */
static int read_object(int index, int subindex) {
  static double time = -1e6; /* of its own: the experiment begins at 0 */
  void *sdo = ecatm_sdo_open(run.master, 0, index, subindex, 7 /* UNSIGNED32 */, ECATM_INTEGER_VALUE,
                             ECATM_TRIGGERED, 0, 1, 0, "");
  int value, state = ECATM_SDO_BUSY;
  while (state == ECATM_SDO_BUSY && !interrupted) {
    int cycle = ecatm_wait(run.master, time += SAMPLE_TIME);
    state = ecatm_sdo_read(sdo, time, cycle, 1);
  }
  value = ecatm_sdo_integer(sdo, state);
  ecatm_sdo_close(sdo);
  return state == ECATM_SDO_DONE ? value : 0;
}

static void write_rows(void) {
  int n, channel;
  FILE *file = run.count > 0 ? fopen(run.file, "w") : NULL;
  if (file == NULL) {
    if (run.count > 0) perror(run.file);
    return;
  }
  fprintf(file, "# encoder increments: %d, per revolutions: %d, rated current in mA: %d\n",
          run.encoder, run.revolutions, run.rated_current);
  fprintf(file, "time,w_ref,w_m,i_m,di1,di2,di3,di4,di5,di6,di7,di8,ai1\n");
  for (n = 0; n < run.count; n++) {
    const row *r = &run.rows[n];
    fprintf(file, "%.6f,%.3f,%d,%d", r->time, r->w_ref, r->w_m, r->i_m);
    for (channel = 0; channel < 8; channel++) fprintf(file, ",%d", r->digital[channel]);
    fprintf(file, ",%.9g\n", r->analog);
  }
  if (fclose(file) != 0) perror(run.file);
}

/* Runs at every end of the program: the outputs of the drive become safe first. */
static void clean_up(void) {
  ecatm_master_close(run.master);
  write_rows();
}

static void show_progress(double time, double seconds, int speed) {
  static const char *const end[] = {"\n", "\r"};
  fprintf(stderr, "  %4.1f of %g s, speed %7d increments/s%s", time, seconds, speed,
          end[isatty(STDERR_FILENO) != 0]);
}

static void experiment(double seconds) {
  TrollPlant_GoldGCONDrive drive;
  TrollPlant_EL1018 el1018;
  TrollPlant_EL3008 el3008;
  TrollPlant_EL3008_2 el3008_2;
  start_up start;
  int n, samples = (int)(seconds / SAMPLE_TIME + 0.5), skipped = 0, last = 0;
  int every = isatty(STDERR_FILENO) ? 100 : 1000;

  TrollPlant_GoldGCONDrive_open(&drive, run.master, 1);
  start_up_open(&start, run.master, 0, CYCLIC_VELOCITY);
  TrollPlant_EL1018_open(&el1018, run.master, 1);
  TrollPlant_EL3008_open(&el3008, run.master, 1);
  TrollPlant_EL3008_2_open(&el3008_2, run.master, 1);
  run.encoder = read_object(0x608F, 1);
  run.revolutions = read_object(0x608F, 2);
  run.rated_current = read_object(0x6075, 0);

  for (n = 0; n <= samples && !interrupted; n++) {
    double time = n * SAMPLE_TIME;
    row *r = &run.rows[n];
    int cycle = ecatm_wait(run.master, time);
    TrollPlant_GoldGCONDrive_read(&drive, time, cycle);
    TrollPlant_EL1018_read(&el1018, time, cycle);
    TrollPlant_EL3008_read(&el3008, time, cycle);
    TrollPlant_EL3008_2_read(&el3008_2, time, cycle);

    start_up_step(&start, time, cycle, 1, drive.statusWord);
    r->w_ref = start.enabled ? point_to_point(time) : 0;
    drive.targetVelocity = (int)floor(r->w_ref + 0.5);
    drive.maxTorque = 1000;
    drive.controlWord = start.control_word;
    drive.modeOfOperation = start.mode;
    TrollPlant_GoldGCONDrive_write(&drive, time, cycle);

    r->time = time;
    r->w_m = drive.velocityActualValue;
    r->i_m = drive.currentActualValue;
    r->digital[0] = el1018.channel1Input;
    r->digital[1] = el1018.channel2Input;
    r->digital[2] = el1018.channel3Input;
    r->digital[3] = el1018.channel4Input;
    r->digital[4] = el1018.channel5Input;
    r->digital[5] = el1018.channel6Input;
    r->digital[6] = el1018.channel7Input;
    r->digital[7] = el1018.channel8Input;
    r->analog = el3008.aiStandardChannel1Value;
    run.count = n + 1;
    if (n > 0 && cycle - last > 1) skipped += cycle - last - 1;
    last = cycle;
    if (n % every == 0) show_progress(time, seconds, r->w_m);
  }
  fprintf(stderr, "\n%s after %.3f s: %d samples, %d bus cycles left out\n",
          interrupted ? "interrupted" : "finished", run.count * SAMPLE_TIME, run.count, skipped);

  TrollPlant_EL3008_2_close(&el3008_2);
  TrollPlant_EL3008_close(&el3008);
  TrollPlant_EL1018_close(&el1018);
  start_up_close(&start);
  TrollPlant_GoldGCONDrive_close(&drive);
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

  run.master = ecatm_master_open(bus, 1, SAMPLE_TIME, 1, LEASE, ECATM_ERROR, ECATM_ERROR, 0);
  experiment(seconds);
  return interrupted ? 130 : 0;
}
