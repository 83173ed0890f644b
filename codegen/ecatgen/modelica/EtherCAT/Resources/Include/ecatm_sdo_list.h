/* A list of objects of a slave that are written one after the other, such as before a drive is enabled. */
#ifndef ECATM_SDO_LIST_H
#define ECATM_SDO_LIST_H

#include "ecatm_sdo.h"

#define ECATM_LIST_COLUMNS 4     /* index, subindex, CoE data type, value */

typedef struct ecatm_sdo_list {
  ecatm_transfer transfer;       /* of the entry `row` */
  ecatm_trigger trigger;
  int rows, row;
  char text[ECATM_TEXT + 80];    /* which entry has failed, and why */
  int *table;                    /* rows * ECATM_LIST_COLUMNS numbers, which follow the struct in memory */
} ecatm_sdo_list;

/* Makes an entry the next one to be written. */
ECATM_FUNCTION void ecatm_sdo_list_choose(ecatm_sdo_list *list, int row) {
  const int *entry = list->table + ECATM_LIST_COLUMNS * row;
  char text[ECATM_TEXT];
  list->row = row;
  list->transfer.index = entry[0];
  list->transfer.subindex = entry[1];
  list->transfer.download = 1;
  (void)ecatm_encode_number(entry[2], entry[3], list->transfer.data, &list->transfer.length, text);
}

/* Stops the simulation if an entry cannot be written. */
ECATM_FUNCTION void ecatm_sdo_list_check(ecatm_master *master, const char *heading,
                                         ecatm_which *slave, int row, const int *entry) {
  unsigned char data[8];
  size_t length;
  char text[ECATM_TEXT] = "the third column must be an integer data type";
  ecatm_check_object(master, heading, slave, entry[0], entry[1]);
  if (ecatm_type_bytes(entry[2]) == 0 || ecatm_type_is_real(entry[2]) ||
      ecatm_encode_number(entry[2], entry[3], data, &length, text) != 0)
    ModelicaFormatError("EtherCAT: %sentry %d of the start-up list of slave %d (object 0x%04X:%02X) "
                        "cannot be written: %s", heading, row + 1, slave->position,
                        (unsigned)entry[0], (unsigned)entry[1], text);
}

/* Makes the list for one slave. `name`: see ecatm_which; `table` has a row for each object: index,
 * subindex, CoE data type, value; `block`: name of the block's instance. */
ECATM_FUNCTION void *ecatm_sdo_list_open(void *object, int position, const char *name,
                                         const int *table, size_t rows, size_t columns,
                                         const char *block) {
  ecatm_master *master = (ecatm_master *)object;
  ecatm_which slave = ecatm_which_slave(position, name);
  ecatm_sdo_list *list;
  char heading[ECATM_HEADING];
  size_t row, bytes = rows * ECATM_LIST_COLUMNS * sizeof *table;
  ecatm_head(heading, block);
  if (rows > 0 && columns != ECATM_LIST_COLUMNS) {
    ModelicaFormatError("EtherCAT: %sthe start-up list of slave %d has %lu columns instead of %d: index, "
                        "subindex, data type, value", heading, slave.position, (unsigned long)columns,
                        ECATM_LIST_COLUMNS);
    return NULL;
  }
  for (row = 0; row < rows; row++)
    ecatm_sdo_list_check(master, heading, &slave, (int)row, table + ECATM_LIST_COLUMNS * row);
  list = (ecatm_sdo_list *)ecatm_new(master, sizeof *list + bytes);
  if (list == NULL) return NULL;
  strcpy(list->transfer.node.heading, heading);
  ecatm_transfer_open(&list->transfer, &slave, 0, 0);
  list->trigger.when = ECATM_TRIGGERED;
  list->rows = (int)rows;
  list->table = (int *)(list + 1);
  if (rows > 0) memcpy(list->table, table, bytes);
  return list;
}

ECATM_FUNCTION void ecatm_sdo_list_close(void *object) { ecatm_close(object); }

/* Continues to write entries: when one is done, the next one follows at once. Returns the state. */
ECATM_FUNCTION int ecatm_sdo_list_progress(ecatm_sdo_list *list) {
  int state = ECATM_SDO_DONE;
  while (list->row < list->rows) {
    ecatm_sdo_list_choose(list, list->row);
    state = ecatm_transfer_step(&list->transfer);
    if (state == ECATM_SDO_FAILED)
      sprintf(list->text, "entry %d of %d of the start-up list: %s", list->row + 1, list->rows,
              list->transfer.text);
    if (state != ECATM_SDO_DONE) break;
    list->row++;
  }
  return state;
}

/* A rising edge of `trigger` begins the list from its first entry; further edges are ignored until its end.
 * The list ends with the first entry that fails. Returns enum ecatm_sdo_state. */
ECATM_FUNCTION int ecatm_sdo_list_write(void *object, double time, int order, int trigger) {
  ecatm_sdo_list *list = (ecatm_sdo_list *)object;
  (void)order;
  if (ecatm_trigger_begin(&list->trigger, time)) {
    if (list->trigger.state == ECATM_SDO_BUSY) list->trigger.state = ecatm_sdo_list_progress(list);
    list->trigger.state_before = list->trigger.state;
  }
  if (ecatm_trigger_decide(&list->trigger, trigger)) list->row = list->transfer.told = 0;
  return list->trigger.state;
}

ECATM_FUNCTION int ecatm_sdo_list_abort_code(void *object, int order) {
  const ecatm_sdo_list *list = (const ecatm_sdo_list *)object;
  (void)order;
  return list->trigger.state == ECATM_SDO_FAILED ? list->transfer.abort_code : 0;
}

/* Returns which entry has failed, and why; empty if none has. */
ECATM_FUNCTION const char *ecatm_sdo_list_abort_text(void *object, int order) {
  const ecatm_sdo_list *list = (const ecatm_sdo_list *)object;
  (void)order;
  return ecatm_text(list->trigger.state == ECATM_SDO_FAILED ? list->text : "");
}

#endif
