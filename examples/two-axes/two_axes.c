/* Two axes in C: they home, move together, and stop.
 *
 *     ecatd --simulate two-axes --config examples/two-axes/two-axes.toml
 *     cc $(ecatctl client-flags) -o two_axes two_axes.c && ./two_axes ecat0 >two_axes.csv
 *
 * Prints time in s, position of x in m, and of y in rad. */
#include <ecat/ecat_axis.h>
#include <stdio.h>
#include <stdlib.h>

static ecat_axes *axes;

static void check(int code) {
  if (code >= 0) return;
  fprintf(stderr, "%s\n", ecat_axes_error(axes));
  ecat_axes_close(axes);
  exit(1);
}

static void print_until_reached(uint64_t begin) {
  while (1) {
    ecat_axis_state x, y;
    int code = ecat_axes_poll(axes, ECAT_AXES_ALL, ECAT_AXES_REACHED);
    ecat_axes_state(axes, 0, &x);
    ecat_axes_state(axes, 1, &y);
    printf("%.3f,%.6f,%.6f\n", (double)(x.cycle - begin) * 0.001, x.view.position, y.view.position);
    if (code != ECAT_EBUSY) {
      check(code);
      return;
    }
    check(ecat_axes_wait(axes, 1.0));
  }
}

int main(int argc, char **argv) {
  const double out[] = {0.05, 2.0}, back[] = {0.0, 0.0}, speeds[] = {0.1, 2.0}, accelerations[] = {0.5, 8.0};
  ecat_axis_state begin;
  check(ecat_axes_open(&axes, argc > 1 ? argv[1] : "ecat0"));
  check(ecat_axes_add(axes, "x", 1));
  check(ecat_axes_add(axes, "y", 1));
  check(ecat_axes_start(axes, 0.2, 1));
  check(ecat_axes_enable(axes, ECAT_AXES_ALL, 5));
  check(ecat_axes_home(axes, ECAT_AXES_ALL, 60));
  check(ecat_axes_move(axes, ECAT_AXES_ALL, back, NULL, NULL, 60));
  check(ecat_axes_state(axes, 0, &begin));
  check(ecat_axes_move(axes, ECAT_AXES_ALL, out, speeds, accelerations, 0));
  print_until_reached(begin.cycle);
  check(ecat_axes_move(axes, ECAT_AXES_ALL, back, speeds, accelerations, 0));
  print_until_reached(begin.cycle);
  check(ecat_axes_stop(axes, ECAT_AXES_ALL, 5));
  ecat_axes_close(axes);
  return 0;
}
