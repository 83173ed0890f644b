/* Turns the drive at position 0 until it is killed. With -DBLOCKS it makes the calls of a Modelica model with
 * EtherCAT.Drives.CiA402, and SPEED is in rad/s.
 *
 * usage: turning BUS SPEED LEASE [MEGABYTES]
 * MEGABYTES: memory that it writes to first. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#ifdef BLOCKS
#include "drive_calls.c"

int main(int argc, char **argv) {
  ecatm_drive_settings settings;
  double time, step;
  ecat_t *bus;
  axis *a;
  (void)argc;
  ecatm_drive_defaults(&settings, 9, 65536);
  settings.max_dropout = 30; /* a busy machine loses frames */
  if (ecat_open(&bus, argv[1]) != 0) return 1;
  step = ecat_cycle_time(bus);
  ecat_close(bus);
  a = axis_open(argv[1], step, atof(argv[3]), ECAT_FAILURE_CONTINUE, 0, 0x9A, 0x30924, &settings, NULL, 0);
  for (time = 0;; time += step) {
    axis_measure(a, time, 1);
    axis_command(a, time, 1, 0, 0, 0, atof(argv[2]));
  }
}
#else
#include <ecat/ecat.h>

static ecat_t *bus;

static int check(int code) {
  if (code >= 0) return code;
  fprintf(stderr, "%s\n", ecat_error(bus));
  exit(1);
}

static int entry(int index, int output) {
  return check(ecat_bind(bus, 0, (unsigned)index, 0, output ? ECAT_OUTPUT : ECAT_INPUT));
}

int main(int argc, char **argv) {
  int control, mode, target, status;
  size_t memory = argc > 4 ? (size_t)atol(argv[4]) << 20 : 0;
  void *volatile block = malloc(memory + 1);
  memset(block, 1, memory + 1);
  check(ecat_open(&bus, argv[1]));
  control = entry(0x6040, 1);
  mode = entry(0x6060, 1);
  target = entry(0x60FF, 1);
  status = entry(0x6041, 0);
  check(ecat_claim(bus, 0, atof(argv[3])));
  for (;;) {
    double word;
    int state;
    (void)ecat_wait(bus, 1, 1.0);
    if (ecat_sample(bus) != 0) continue;
    check(ecat_read(bus, status, &word));
    state = (int)word & 0x6F;
    check(ecat_write(bus, mode, 9));
    check(ecat_write(bus, target, atof(argv[2])));
    check(ecat_write(bus, control, state == 0x21 ? 7 : state == 0x23 || state == 0x27 ? 15 : 6));
    check(ecat_commit(bus));
  }
}
#endif
