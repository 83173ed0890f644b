/* The outputs of a model: writes and commits.
 *
 * The commit of a slave only stages its values. The commit of the last slave of a domain of the model hands
 * all staged values to the daemon. So they leave in the same bus cycle, and 200 slaves need one commit of
 * the client and not 200. The number of committing slaves is known from the sample before. If a slave does
 * not commit in every sample, its values are handed over separately from then on. */
#ifndef ECATM_OUTPUTS_H
#define ECATM_OUTPUTS_H

#include "ecatm_objects.h"

/* The slave of an object of the session. */
ECATM_FUNCTION ecatm_slave *ecatm_slave_of(ecat_session_slave *on_bus) {
  return (ecatm_slave *)(void *)((char *)on_bus - offsetof(ecatm_slave, on_bus));
}

/* Ends the commits of a sample: hands over staged values that wait for other slaves of their domain. */
ECATM_FUNCTION void ecatm_settle(ecatm_master *master) {
  ecat_session_slave *on_bus;
  int i, waiting = 0;
  for (i = 0; i < master->domains; i++) {
    ecatm_group *group = &master->groups[i];
    if (group->staged == 0 || group->staged == group->writers) continue;
    for (on_bus = master->session.slaves; on_bus != NULL; on_bus = on_bus->next) {
      ecatm_slave *slave = ecatm_slave_of(on_bus);
      if (slave->group == group && on_bus->writes && !ecatm_same_time(slave->time, group->time))
        slave->alone = 1;
    }
    group->writers = group->staged;
    waiting = 1;
  }
  if (waiting) ecatm_check(master, ecat_session_commit(&master->session));
}

/* Whether the commit of a slave at this time hands all values of its domain over. */
ECATM_FUNCTION int ecatm_is_last(ecatm_slave *slave, double time) {
  ecatm_group *group = slave->group;
  if (slave->alone) return 1;
  if (!slave->on_bus.writes)
    group->writers++;
  else if (ecatm_same_time(slave->time, time)) /* the tool evaluates this time again */
    return group->staged == group->writers;
  if (!ecatm_same_time(group->time, time)) {
    ecatm_settle(slave->node.master);
    group->staged = 0;
  }
  group->time = slave->time = time;
  return ++group->staged == group->writers;
}

/* Returns another block of this model that writes the slave, or NULL. */
ECATM_FUNCTION const ecat_session_slave *ecatm_rival(const ecatm_slave *slave) {
  const ecat_session_slave *other = slave->node.master->session.slaves;
  if (slave->on_bus.writes) return NULL;
  while (other != NULL && !(other->writes && other->position == slave->on_bus.position))
    other = other->next;
  return other;
}

/* Hands the written values of this slave over; drops them while there is no bus. Returns `order`, which
 * makes the tool call this function after the writes that have returned it. */
ECATM_FUNCTION int ecatm_commit(void *object, double time, int order) {
  ecatm_slave *slave = (ecatm_slave *)object;
  ecatm_master *master = slave->node.master;
  const ecat_session_slave *rival = ecatm_rival(slave);
  int last;
  if (master->session.bus == NULL || master->session.outage != 0) {
    slave->group->staged = 0;
    return order;
  }
  if (rival != NULL) {
    ModelicaFormatError("EtherCAT: %s%stwo blocks of this model write the outputs of slave %d of bus "
                        "'%s'; remove one of them", rival->heading, slave->node.heading,
                        slave->on_bus.position, master->name);
    return order;
  }
  last = ecatm_is_last(slave, time);
  ecatm_check(master, ecat_session_stage(&slave->on_bus));
  if (last) ecatm_check(master, ecat_session_commit(&master->session));
  return order;
}

/* Stores a value for the commit. It is a physical value if the entry has a unit, a scale or an offset. */
ECATM_FUNCTION int ecatm_write_real(void *object, double time, int order, double value) {
  (void)time;
  ecat_session_write(&((ecatm_pdo *)object)->on_bus, value);
  return order;
}

ECATM_FUNCTION int ecatm_write_integer(void *object, double time, int order, int value) {
  (void)time;
  ecat_session_write_int(&((ecatm_pdo *)object)->on_bus, value);
  return order;
}

ECATM_FUNCTION int ecatm_write_boolean(void *object, double time, int order, int value) {
  return ecatm_write_integer(object, time, order, value != 0);
}

#endif
