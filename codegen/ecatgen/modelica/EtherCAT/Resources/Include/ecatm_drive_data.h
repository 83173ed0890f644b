/* What a drive says of its motor, read from its objects to compare parameters of a model with it. */
#ifndef ECATM_DRIVE_DATA_H
#define ECATM_DRIVE_DATA_H

#include "ecatm_sdo.h"

enum ecatm_drive_datum {
  ECATM_INCREMENTS,              /* 0x608F:01, encoder increments ... */
  ECATM_REVOLUTIONS,             /* 0x608F:02, ... in this number of revolutions of the motor */
  ECATM_RATED_TORQUE,            /* 0x6076, mN.m */
  ECATM_RATED_CURRENT,           /* 0x6075, mA */
  ECATM_DRIVE_DATA
};

typedef struct ecatm_drive_data {
  ecatm_transfer transfer;       /* of the datum `next` */
  int next;                      /* enum ecatm_drive_datum; ECATM_DRIVE_DATA: all were read */
  double values[ECATM_DRIVE_DATA]; /* 0: the drive does not say */
  double told[ECATM_DRIVE_DATA]; /* values that a message has named */
} ecatm_drive_data;

ECATM_FUNCTION void *ecatm_drive_data_open(void *object, int position, const char *name,
                                           const char *block) {
  ecatm_drive_data *data = (ecatm_drive_data *)ecatm_new((ecatm_master *)object, sizeof *data);
  ecatm_which slave = ecatm_which_slave(position, name);
  if (data == NULL) return NULL;
  ecatm_head(data->transfer.node.heading, block);
  ecatm_transfer_open(&data->transfer, &slave, 0, 0);
  data->transfer.quiet = 1;      /* not every drive has these objects */
  return data;
}

/* Continues to read, one object after the other. Returns whether the last one has come at this call.
 * `offset` is added to all indices: that of the axis. */
ECATM_FUNCTION int ecatm_drive_data_read(ecatm_drive_data *data, int offset) {
  static const int objects[ECATM_DRIVE_DATA][2] = {{0x608F, 1}, {0x608F, 2}, {0x6076, 0}, {0x6075, 0}};
  char text[ECATM_TEXT];
  double *value = &data->values[data->next];
  int state;
  if (data->next == ECATM_DRIVE_DATA) return 0;
  data->transfer.index = objects[data->next][0] + offset;
  data->transfer.subindex = objects[data->next][1];
  state = ecatm_transfer_step(&data->transfer);
  if (state == ECATM_SDO_BUSY) return 0;
  *value = 0;
  if (state == ECATM_SDO_DONE)   /* UNSIGNED32 */
    (void)ecatm_decode_number(7, data->transfer.data, data->transfer.length, value, text);
  return ++data->next == ECATM_DRIVE_DATA;
}

/* Logs that a parameter of the model differs from what the drive says, once for each value. `object`,
 * `parameter`: names of both; `unit`: of both values; `resolution`: difference that is none. */
ECATM_FUNCTION void ecatm_drive_data_compare(ecatm_drive_data *data, int datum, double value,
                                             double resolution, const char *object,
                                             const char *parameter, double given, const char *unit) {
  if (value == 0 || value == data->told[datum] || fabs(value - given) <= resolution) return;
  data->told[datum] = value;
  ModelicaFormatMessage("EtherCAT: %s%s is %g%s, but the drive of slave %d says %g%s (object %s): one of both "
                        "is wrong, and so may be what the model reads and commands, by the factor "
                        "%g; correct %s, or the object\n",
                        data->transfer.node.heading, parameter, given, unit,
                        data->transfer.slave.position, value, unit, object, value / given, parameter);
}

#endif
