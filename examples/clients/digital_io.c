/* A light that runs over the digital outputs of one slave, while the inputs of another are printed as
 * they change.
 *
 *     digital_io [BUS [OUTPUTS [INPUTS [SECONDS]]]]
 *
 * OUTPUTS and INPUTS are slaves by name or position: EL2008 and EL1018, as on the simulated bus of
 * `ecatd --simulate troll`. Ctrl-C ends it, which puts the outputs to their safe values. It goes on when
 * the daemon was started again, and when it lost its outputs because the machine was too busy.
 */
#include <ecat/ecat.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { MOST = 64 };     /* channels */
static const double STEP = 0.25; /* seconds that each light is on */
static const double LEASE = 0.1; /* seconds without us until the outputs are safe */

struct terminal {
  int position;
  int count;
  int signal[MOST];     /* handles */
};

static volatile sig_atomic_t stop;

static void on_signal(int number) {
  (void)number;
  stop = 1;
}

/* Finds all outputs, or all inputs, of a slave that have one bit. */
static int find(ecat_t *bus, const char *name, int output, struct terminal *terminal) {
  ecat_signal_info info;
  int i;
  terminal->count = 0;
  terminal->position = ecat_find_name(bus, name);
  if (terminal->position < 0) return terminal->position;
  for (i = 0; i < ecat_signal_count(bus) && terminal->count < MOST; i++)
    if (ecat_signal(bus, i, &info) == 0 && info.slave == terminal->position &&
        info.output == output && info.bit_length == 1)
      terminal->signal[terminal->count++] = i;
  return 0;
}

/* Prints the inputs where they are others than before: "1.234 s  01000010". */
static void show(ecat_t *bus, const struct terminal *inputs, double time) {
  static char before[MOST + 1];
  char now[MOST + 1];
  int i, changed = 0;
  for (i = 0; i < inputs->count; i++) {
    int64_t level = 0;
    /* A value that is not valid is the last good one: say so instead of showing it. */
    if (ecat_validity(bus, inputs->signal[i]) != ECAT_VALID)
      now[i] = '?';
    else
      now[i] = ecat_read_int(bus, inputs->signal[i], &level) == 0 && level ? '1' : '0';
    changed |= now[i] != before[i];
    before[i] = now[i];
  }
  now[inputs->count] = '\0';
  if (!changed) return;
  printf("%.3f s  %s\n", time, now);
  fflush(stdout);
}

/* One cycle: 0, or what is in the way. */
static int step(ecat_t *bus, const struct terminal *outputs, const struct terminal *inputs,
                double time) {
  int i, code, on = outputs->count > 0 ? (int)(time / STEP) % outputs->count : 0;
  if ((code = ecat_wait(bus, 1, 1.0)) != 0 || (code = ecat_sample(bus)) != 0) return code;
  show(bus, inputs, time);
  /* Does nothing while they are ours; claims again what was lost. */
  if ((code = ecat_claim(bus, outputs->position, LEASE)) != 0) return code;
  for (i = 0; i < outputs->count; i++)
    if ((code = ecat_write_int(bus, outputs->signal[i], i == on)) != 0) return code;
  return ecat_commit(bus);
}

/* Whether it is worth while to go on: the daemon may come back, outputs may be claimed again. */
static int passes(int code) {
  return code == ECAT_EDOWN || code == ECAT_ESTALE || code == ECAT_ETIMEOUT || code == ECAT_ELEASE;
}

static int run(ecat_t *bus, const struct terminal *outputs, const struct terminal *inputs,
               double seconds) {
  double time = 0;
  int before = 0;
  while (!stop && time < seconds) {
    int code = step(bus, outputs, inputs, time);
    if (code != 0 && !passes(code)) return code;
    if (code != 0 && code != before) fprintf(stderr, "digital_io: %s\n", ecat_error(bus));
    before = code;
    time += ecat_cycle_time(bus);
  }
  return 0;
}

int main(int argc, char **argv) {
  const char *name = argc > 1 ? argv[1] : "ecat0";
  const char *output_name = argc > 2 ? argv[2] : "EL2008", *input_name = argc > 3 ? argv[3] : "EL1018";
  struct terminal outputs, inputs;
  ecat_t *bus = NULL;
  int code;
  if (name[0] == '-') {
    puts("usage: digital_io [BUS [OUTPUTS [INPUTS [SECONDS]]]]\n"
         "Runs a light along the outputs of a terminal, and prints the inputs of another one.");
    return strcmp(name, "--help") != 0;
  }
  code = ecat_open(&bus, name);
  signal(SIGINT, on_signal);
  signal(SIGTERM, on_signal);
  if (code == 0) code = find(bus, output_name, 1, &outputs);
  if (code == 0) code = find(bus, input_name, 0, &inputs);
  if (code == 0) code = run(bus, &outputs, &inputs, argc > 4 ? atof(argv[4]) : 1e9);
  if (code != 0) fprintf(stderr, "digital_io: %s\n", ecat_error(bus));
  ecat_close(bus); /* the outputs go to their safe values */
  return code != 0;
}
