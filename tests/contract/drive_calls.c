/* The calls of a slave block with EtherCAT.Drives.CiA402 behind it, as a library for the tests. */
#include "ecat_modelica.h"

typedef struct {
  int index, type, bits;
} entry;

static const entry writes[] = {{0x6040, 6, 16}, {0x6060, 2, 8}, {0x607A, 4, 32}, {0x60FF, 4, 32},
                               {0x6071, 3, 16}, {0x6072, 6, 16}};
static const entry reads[] = {{0x6041, 6, 16}, {0x6061, 2, 8}, {0x6064, 4, 32}, {0x606C, 4, 32},
                              {0x6077, 3, 16}, {0x6078, 3, 16}};

typedef struct axis {
  void *master, *domain, *slave, *drive;
  void *outputs[6], *inputs[6];
  /* Of the last step. */
  int cycle, raw[6], state, enabled, command[6], start_up, homing, reached;
  double phi, w, tau, i;
} axis;

/* The entries 0x6072 and 0x6078 are mapped in the Elmo Gold only. */
axis *axis_open(const char *bus, double sample_time, double lease, int failure, int position, int vendor, int product,
                const ecatm_drive_settings *settings, const int *start_up, int rows) {
  axis *a = calloc(1, sizeof *a);
  int n, count = settings->entries & ECAT_DRIVE_HAS_CURRENT ? 6 : 5;
  a->master = ecatm_master_open(bus, 1, sample_time, 1, lease, ECAT_FAILURE_ERROR, failure, 0, 0, 0, "");
  a->domain = ecatm_domain_open(a->master, 1, "");
  a->slave = ecatm_slave_open(a->domain, position, "", vendor, product, 0, "a drive", "", "nothing", "");
  for (n = 0; n < count; n++) {
    a->outputs[n] = ecatm_pdo_open(a->slave, writes[n].index, 0, 1, writes[n].type, writes[n].bits, 1, 0, "");
    a->inputs[n] = ecatm_pdo_open(a->slave, reads[n].index, 0, 0, reads[n].type, reads[n].bits, 1, 0, "");
  }
  a->drive = ecatm_drive_new(a->master, position, "", settings, start_up, (size_t)rows, "");
  return a;
}

/* `valid`: whether to believe the slave that its values are valid. */
void axis_measure(axis *a, double time, int valid) {
  int n, state, code;
  a->cycle = ecatm_wait(a->master, time);
  valid = ecatm_slave_state(a->slave, time, a->cycle, &state, &code) && valid;
  for (n = 0; n < 6; n++)
    a->raw[n] = a->inputs[n] ? ecatm_read_integer(a->inputs[n], time, a->cycle) : 0;
  a->state = ecatm_drive_measure(a->drive, time, a->cycle, valid, a->raw[0], a->raw[1], a->raw[2],
                                 a->raw[3], a->raw[4], a->raw[5], &a->phi, &a->w, &a->tau, &a->i,
                                 &a->enabled);
}

void axis_command(axis *a, double time, int enable, int quick_stop, int fault_reset, int home, double reference) {
  int n, order = a->cycle;
  a->command[0] = ecatm_drive_command(a->drive, time, a->state, enable, quick_stop, fault_reset, home, reference,
                                      &a->command[1], &a->command[2], &a->command[3], &a->command[4],
                                      &a->command[5], &a->start_up, &a->homing, &a->reached);
  for (n = 0; n < 6; n++)
    if (a->outputs[n]) order = ecatm_write_integer(a->outputs[n], time, order, a->command[n]);
  ecatm_commit(a->slave, time, order);
}

void axis_close(axis *a) {
  ecatm_master_close(a->master);
  ecatm_drive_close(a->drive);
  free(a);
}

/* The logic alone: a drive of no bus. */
void *logic_open(const ecatm_drive_settings *settings) {
  ecatm_master *master = calloc(1, sizeof *master);
  return ecatm_drive_new(master, 0, "", settings, NULL, 0, "");
}

/* One evaluation of the logic; `in`: valid, status, display, position, velocity, torque, current,
 * enable, quick stop, fault reset, losses of the session; `out`: control word, mode, targets, max torque, state, enabled. */
void logic_step(void *drive, double time, const int *in, double reference, int *out, double *values) {
  int start_up, homing, reached;
  ((ecatm_drive *)drive)->node.master->session.losses = (unsigned)in[10];
  out[6] = ecatm_drive_measure(drive, time, 0, in[0], in[1], in[2], in[3], in[4], in[5], in[6],
                               &values[0], &values[1], &values[2], &values[3], &out[7]);
  out[0] = ecatm_drive_command(drive, time, out[6], in[7], in[8], in[9], 0, reference, &out[1], &out[2],
                               &out[3], &out[4], &out[5], &start_up, &homing, &reached);
}
