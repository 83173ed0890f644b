/* What happens in a sample: wait, reads, writes, commits. */
#ifndef ECATM_SAMPLES_H
#define ECATM_SAMPLES_H

#include "ecatm_objects.h"

ECATM_FUNCTION int ecatm_same_time(double a, double b) { return fabs(a - b) <= ECATM_SAME_TIME; }

/* Takes a new image of all domains and remembers its time, and the cycle of the newest one. */
ECATM_FUNCTION void ecatm_take_sample(ecatm_master *master, double time) {
  ecat_domain_info info;
  uint64_t newest = 0;
  int i;
  ecatm_check(master, ecat_sample(master->bus));
  master->complete = 0;
  for (i = 0; i < ecat_domain_count(master->bus); i++) {
    ecatm_check(master, ecat_domain(master->bus, i, &info));
    if (info.cycle > newest) newest = info.cycle;
    if (info.wkc_state == ECAT_WKC_COMPLETE) master->complete |= 1u << i;
  }
  master->cycle = (int)(newest & 0x7FFFFFFF);
  master->sample_time = time;
  master->sampled = 1;
}

/* Waits for the bus where asked to, then samples; returns the cycle of the sample. */
ECATM_FUNCTION int ecatm_wait(void *object, double time) {
  ecatm_master *master = (ecatm_master *)object;
  if (master->waited && ecatm_same_time(time, master->wait_time)) return master->cycle;
  if (master->stride > 0) {
    uint64_t goal = master->waited ? master->waited_cycle + master->stride
                                   : ecat_cycle(master->bus) + 1;
    while (ecat_cycle(master->bus) < goal) {
      ecatm_check(master, ecat_wait(master->bus, 1, ECATM_PATIENCE));
      /* Keeps the lease: who waits is alive, however long the sample time is. */
      if (ecat_cycle(master->bus) < goal) ecatm_check(master, ecat_sample(master->bus));
    }
    master->waited_cycle = ecat_cycle(master->bus);
  }
  master->wait_time = time;
  master->waited = 1;
  ecatm_take_sample(master, time);
  return master->cycle;
}

/* Makes this model the owner of the outputs, once. */
ECATM_FUNCTION void ecatm_claim(ecatm_slave *slave) {
  ecatm_master *master = slave->node.master;
  const ecatm_slave *other;
  if (slave->claimed) return;
  for (other = master->writers; other != NULL; other = other->next_writer)
    if (other->position == slave->position) {
      ModelicaFormatError("EtherCAT: two blocks of this model write the outputs of slave %d of bus "
                          "'%s'; remove one of them", slave->position, ecat_name(master->bus));
      return;
    }
  ecatm_check(master, ecat_claim(master->bus, slave->position, master->lease));
  slave->claimed = 1;
  slave->next_writer = master->writers;
  master->writers = slave;
}

/* Hands the written values of this slave over, all at once. `order` is only there to be returned:
 * it makes the tool call this after the writes that it came from. */
ECATM_FUNCTION int ecatm_commit(void *object, double time, int order) {
  ecatm_slave *slave = (ecatm_slave *)object;
  ecat_t *bus = slave->node.master->bus;
  ecatm_pdo *pdo;
  (void)time;
  ecatm_claim(slave);
  for (pdo = slave->outputs; pdo != NULL; pdo = pdo->next_output)
    if (pdo->pending) ecatm_check(slave->node.master, ecat_write(bus, pdo->signal, pdo->value));
  ecatm_check(slave->node.master, ecat_commit(bus));
  return order;
}

/* The sample of this time, which is taken by whoever asks first. */
ECATM_FUNCTION void ecatm_at(ecatm_master *master, double time) {
  if (!master->sampled || !ecatm_same_time(time, master->sample_time))
    ecatm_take_sample(master, time);
}

/* Numbers of EtherCAT.Types.ALState. */
ECATM_FUNCTION int ecatm_al_state(unsigned al_status) {
  switch (al_status & 0x0F) { /* 0x10 is the error flag */
    case ECAT_AL_INIT: return 2;
    case ECAT_AL_PREOP: return 3;
    case ECAT_AL_BOOT: return 4;
    case ECAT_AL_SAFEOP: return 5;
    case ECAT_AL_OP: return 6;
    default: return 1;
  }
}

/* Whether the values of this slave in the sample are those of a cycle in which it took part in OP. */
ECATM_FUNCTION int ecatm_slave_state(void *object, double time, int order, int *al_state,
                                     int *al_status_code) {
  ecatm_slave *slave = (ecatm_slave *)object;
  ecatm_master *master = slave->node.master;
  ecat_slave_info info;
  (void)order;
  ecatm_at(master, time);
  ecatm_check(master, ecat_slave(master->bus, slave->position, &info));
  *al_state = ecatm_al_state(info.al_state);
  *al_status_code = (int)info.al_code;
  return info.al_state == ECAT_AL_OP && (master->complete >> info.domain & 1) != 0;
}

/* The physical value. `order` makes the tool call reads after the wait that it came from. */
ECATM_FUNCTION double ecatm_read_real(void *object, double time, int order) {
  ecatm_pdo *pdo = (ecatm_pdo *)object;
  ecatm_master *master = pdo->node.master;
  double value = 0;
  (void)order;
  ecatm_at(master, time);
  ecatm_check(master, ecat_read(master->bus, pdo->signal, &value));
  return value * pdo->scale + pdo->offset;
}

ECATM_FUNCTION int ecatm_read_integer(void *object, double time, int order) {
  return (int)ecatm_read_real(object, time, order);
}

ECATM_FUNCTION int ecatm_read_boolean(void *object, double time, int order) {
  return ecatm_read_real(object, time, order) != 0;
}

/* Remembers a value for the commit. Values of integer entries are rounded. An entry with a scale is
 * held at its limits, as an analog output does; raw values out of range are an error of the commit. */
ECATM_FUNCTION int ecatm_write_real(void *object, double time, int order, double value) {
  ecatm_pdo *pdo = (ecatm_pdo *)object;
  (void)time;
  value = (value - pdo->offset) / pdo->scale;
  if (pdo->integer && fabs(value) < 4503599627370496.0) value = floor(value + 0.5);
  if (pdo->scale != 1 || pdo->offset != 0) {
    if (value < pdo->low) value = pdo->low;
    if (value > pdo->high) value = pdo->high;
  }
  pdo->value = value;
  pdo->pending = 1;
  return order;
}

ECATM_FUNCTION int ecatm_write_integer(void *object, double time, int order, int value) {
  return ecatm_write_real(object, time, order, (double)value);
}

ECATM_FUNCTION int ecatm_write_boolean(void *object, double time, int order, int value) {
  return ecatm_write_real(object, time, order, value ? 1.0 : 0.0);
}

#endif
