/* What a model gives to the bus: writes, commits, and who owns the outputs.
 *
 * The commit of a slave only stages its values; that of the last slave of a domain of the model hands all
 * of them to the daemon. So they leave in the same bus cycle, and 200 slaves cost one commit of the
 * client and not 200. Who the last one is follows from the sample before. A slave that turns out not to
 * commit in every sample is handed over by itself from then on. */
#ifndef ECATM_OUTPUTS_H
#define ECATM_OUTPUTS_H

#include "ecatm_objects.h"

#define ECATM_RECLAIM 0.1        /* seconds between two tries to own outputs again */

/* --- Ownership ----------------------------------------------------------------------------- */

/* Whether this model writes the slave at a position. */
ECATM_FUNCTION const ecatm_slave *ecatm_writer(const ecatm_master *master, int position) {
  const ecatm_slave *slave = master->slaves;
  while (slave != NULL && !(slave->writer && slave->position == position)) slave = slave->next;
  return slave;
}

/* Makes this model the owner of the outputs of all slaves that it writes, in one go. Returns 0 or a code
 * of the client. */
ECATM_FUNCTION int ecatm_claim(ecatm_master *master) {
  int i, code, last = -1, wanted = 0, count = ecat_signal_count(master->bus);
  int *signals = (int *)malloc(((size_t)count + 1) * sizeof *signals);
  size_t found = 0;
  ecat_signal_info info;
  ecatm_slave *slave;
  if (signals == NULL) return ecatm_fail(master, ECAT_ESYS, "out of memory");
  for (i = 0; i < count && ecat_signal(master->bus, i, &info) == 0; i++) {
    if (info.slave != last) wanted = ecatm_writer(master, info.slave) != NULL;
    last = info.slave;
    if (info.output && wanted) signals[found++] = i;
  }
  code = ecatm_client(master, ecat_claim_entries(master->bus, signals, found, master->lease));
  free(signals);
  for (slave = master->slaves; code == 0 && slave != NULL; slave = slave->next)
    slave->claimed = slave->writer;
  return code;
}

/* --- Staging ------------------------------------------------------------------------------- */

/* Gives one of them. An analog quantity is held at its limits; a number beyond them is refused. */
ECATM_FUNCTION int ecatm_stage_value(const ecatm_pdo *pdo) {
  ecat_t *bus = pdo->node.master->bus;
  if (!pdo->analog) return ecat_write(bus, pdo->signal, pdo->value);
  return ecat_write_scaled(bus, pdo->signal, pdo->value, pdo->scale, pdo->offset);
}

/* Gives the written values of a slave to the client. Returns 0 or a code of it: ECAT_ELEASE, too, where it
 * is too early to claim lost outputs again. */
ECATM_FUNCTION int ecatm_stage(ecatm_slave *slave) {
  ecatm_master *master = slave->node.master;
  const ecatm_pdo *pdo;
  int code = slave->claimed                               ? 0
             : ecatm_now() - master->lost < ECATM_RECLAIM ? ECAT_ELEASE
                                                          : ecatm_claim(master);
  for (pdo = slave->outputs; pdo != NULL && code == 0; pdo = pdo->next_output)
    if (pdo->pending) code = ecatm_stage_value(pdo);
  return ecatm_client(master, code);
}

/* After outputs were lost that the model had claimed: claims them again and hands all over, but does not
 * try that too often. Returns 0 or a code of the client. */
ECATM_FUNCTION int ecatm_reclaim(ecatm_master *master) {
  double before = master->lost;
  ecatm_slave *slave;
  int code;
  for (slave = master->slaves; slave != NULL; slave = slave->next) slave->claimed = 0;
  if (ecatm_now() - before < ECATM_RECLAIM) return ECAT_ELEASE;
  if ((code = ecatm_claim(master)) != 0) return code;
  master->lost = ecatm_now();
  for (slave = master->slaves; code == 0 && slave != NULL; slave = slave->next)
    if (slave->writer) code = ecatm_stage(slave);
  if (code == 0) code = ecatm_client(master, ecat_commit(master->bus));
  if (code == 0 && master->lost - before > 1)
    ModelicaFormatMessage("EtherCAT: %s; the model has done so\n", master->problem);
  return code;
}

/* Deals with a failure to stage or commit. */
ECATM_FUNCTION void ecatm_not_written(ecatm_master *master, int code) {
  int lost = code == ECAT_ELEASE && master->when_failed != ECATM_ERROR;
  if (lost) code = ecatm_reclaim(master);
  if (code == 0 || (lost && code == ECAT_ELEASE)) return; /* until the next try */
  if (ecatm_wish(master, code) == ECATM_WAIT) return;     /* the next sample does */
  ecatm_endure(master, code);
}

/* Hands over what is staged. */
ECATM_FUNCTION void ecatm_hand_over(ecatm_master *master) {
  int code = ecatm_client(master, ecat_commit(master->bus));
  if (code != 0) ecatm_not_written(master, code);
}

/* The end of the commits of a sample: hands over what has waited in vain for other slaves of its domain. */
ECATM_FUNCTION void ecatm_settle(ecatm_master *master) {
  ecatm_slave *slave;
  int i, waiting = 0;
  for (i = 0; i < master->domains; i++) {
    ecatm_group *group = &master->groups[i];
    if (group->staged == 0 || group->staged == group->writers) continue;
    for (slave = master->slaves; slave != NULL; slave = slave->next)
      if (slave->group == group && slave->writer && !ecatm_same_time(slave->time, group->time))
        slave->alone = 1;
    group->writers = group->staged;
    waiting = 1;
  }
  if (waiting && master->bus != NULL && master->outage == 0) ecatm_hand_over(master);
}

/* --- Calls of the model -------------------------------------------------------------------- */

/* Whether the commit of a slave at this time is the one that hands over. */
ECATM_FUNCTION int ecatm_is_last(ecatm_slave *slave, double time) {
  ecatm_group *group = slave->group;
  if (slave->alone) return 1;
  if (!slave->writer)
    group->writers++;
  else if (ecatm_same_time(slave->time, time)) /* the tool does so once more */
    return group->staged == group->writers;
  if (!ecatm_same_time(group->time, time)) {
    ecatm_settle(slave->node.master);
    group->staged = 0;
  }
  group->time = slave->time = time;
  return ++group->staged == group->writers;
}

/* Hands the written values of this slave over; drops them while there is no bus. `order` is only there to
 * be returned: it makes the tool call this after the writes that it came from. */
ECATM_FUNCTION int ecatm_commit(void *object, double time, int order) {
  ecatm_slave *slave = (ecatm_slave *)object;
  ecatm_master *master = slave->node.master;
  int code, last;
  if (master->bus == NULL || master->outage != 0) {
    slave->group->staged = 0;
    return order;
  }
  if (!slave->writer && ecatm_writer(master, slave->position) != NULL) {
    ModelicaFormatError("EtherCAT: two blocks of this model write the outputs of slave %d of bus '%s'; "
                        "remove one of them", slave->position, master->name);
    return order;
  }
  last = ecatm_is_last(slave, time);
  slave->writer = 1;
  if ((code = ecatm_stage(slave)) != 0)
    ecatm_not_written(master, code);
  else if (last)
    ecatm_hand_over(master);
  return order;
}

/* Remembers a value, which is physical if the entry has a scale, for the commit. */
ECATM_FUNCTION int ecatm_write_real(void *object, double time, int order, double value) {
  ecatm_pdo *pdo = (ecatm_pdo *)object;
  (void)time;
  pdo->value = value;
  pdo->pending = 1;
  return order;
}

ECATM_FUNCTION int ecatm_write_integer(void *object, double time, int order, int value) {
  return ecatm_write_real(object, time, order, (double)value);
}

ECATM_FUNCTION int ecatm_write_boolean(void *object, double time, int order, int value) {
  return ecatm_write_integer(object, time, order, value != 0);
}

#endif
