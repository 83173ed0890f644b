/* What a model takes from the bus: waits, samples, reads. */
#ifndef ECATM_SAMPLES_H
#define ECATM_SAMPLES_H

#include "ecatm_outputs.h"

#define ECATM_PATIENCE 1.0       /* seconds without a bus cycle until waiting fails */
#define ECATM_BEHIND 0.1         /* seconds that a model without a bus may catch up */

/* --- Samples ------------------------------------------------------------------------------- */

/* What the new image is worth: cycle and working counters of all domains of the bus. */
ECATM_FUNCTION void ecatm_observe_domains(ecatm_master *master) {
  ecat_domain_info info;
  uint64_t newest = 0;
  int i;
  master->complete = 0;
  master->wkc = master->wkc_expected = 0;
  for (i = 0; i < ecat_domain_count(master->bus); i++) {
    ecatm_check(master, ecat_domain(master->bus, i, &info));
    if (info.wkc_state == ECAT_WKC_COMPLETE) master->complete |= 1u << i;
    master->wkc += (int)info.wkc;
    master->wkc_expected += (int)info.wkc_expected;
    if (info.cycle <= newest) continue;
    newest = info.cycle;
    master->exchanged = (double)info.time_ns * 1e-9;
  }
  master->cycle = (int)(newest & 0x7FFFFFFF);
}

/* How a slave is. An output is valid in OP only, and to ask for that costs a fifth. */
ECATM_FUNCTION void ecatm_observe_slave(ecatm_slave *slave) {
  ecatm_master *master = slave->node.master;
  ecat_slave_info info;
  if (slave->outputs != NULL && ecat_validity(master->bus, slave->outputs->signal) == ECAT_VALID) {
    slave->al_state = ECAT_AL_OP;
    slave->al_code = 0;
    return;
  }
  ecatm_check(master, ecat_slave(master->bus, slave->position, &info));
  slave->al_state = info.al_state;
  slave->al_code = info.al_code;
}

/* How all slaves are that the model uses. Returns whether they are in OP. */
ECATM_FUNCTION int ecatm_observe_slaves(ecatm_master *master) {
  ecatm_slave *slave;
  int operational = 1;
  for (slave = master->slaves; slave != NULL; slave = slave->next) {
    ecatm_observe_slave(slave);
    operational &= slave->al_state == ECAT_AL_OP;
  }
  return operational;
}

/* Nothing is known any more but the last values. */
ECATM_FUNCTION void ecatm_observe_nothing(ecatm_master *master) {
  ecatm_slave *slave;
  master->complete = 0;
  master->wkc = 0;
  master->state = master->outage == ECAT_EDOWN ? ECATM_MISSING : ECATM_STANDS_STILL;
  for (slave = master->slaves; slave != NULL; slave = slave->next)
    slave->al_state = slave->al_code = ECAT_AL_NONE;
}

/* Takes a new image of all domains and remembers its time. */
ECATM_FUNCTION void ecatm_take_sample(ecatm_master *master, double time) {
  int code;
  ecatm_settle(master);
  code = ecatm_refresh(master);
  if (code != 0)
    code = ecatm_endure(master, code);
  else
    ecatm_end_outage(master);
  master->sample_time = time;
  master->sampled = 1;
  if (code == 0) {
    int operational = ecatm_observe_slaves(master);
    ecatm_observe_domains(master);
    master->state = master->complete != (1u << ecat_domain_count(master->bus)) - 1 ? ECATM_INCOMPLETE
                    : operational ? ECATM_OPERATIONAL : ECATM_NOT_OPERATIONAL;
  } else {
    ecatm_observe_nothing(master);
  }
  if (master->exchanged > 0) master->age = ecatm_now() - master->exchanged;
}

/* The sample of this time, which is taken by whoever asks first. */
ECATM_FUNCTION void ecatm_at(ecatm_master *master, double time) {
  if (!master->sampled || !ecatm_same_time(time, master->sample_time))
    ecatm_take_sample(master, time);
}

/* --- Pace ---------------------------------------------------------------------------------- */

/* Waits until so many cycles have ended since the last wait as a sample time has. Returns 0 or what
 * ecatm_fail() does. */
ECATM_FUNCTION int ecatm_wait_cycles(ecatm_master *master) {
  ecat_t *bus = master->bus;
  uint64_t goal = master->in_step ? master->waited_cycle + master->stride : ecat_cycle(bus) + 1;
  if (ecat_cycle(bus) > goal) master->missed++;
  /* A daemon that starts again counts anew. */
  while (ecat_cycle(bus) < goal && ecat_instance(bus) == master->instance) {
    int code = ecat_wait(bus, 1, ECATM_PATIENCE);
    /* Keeps the lease: who waits is alive, however long the sample time is. */
    if (code == 0 && ecat_cycle(bus) < goal) code = ecat_sample(bus);
    if (code != 0) return ecatm_client(master, code);
  }
  master->waited_cycle = ecat_cycle(bus);
  master->in_step = 1;
  return 0;
}

/* Without a bus, by the clock: a model that is paced by the bus is not to race. */
ECATM_FUNCTION void ecatm_wait_clock(ecatm_master *master, double time) {
  if (master->waited && master->origin + time > ecatm_now() - ECATM_BEHIND)
    ecatm_sleep_until(master->origin + time);
  else
    master->origin = ecatm_now() - time;
}

/* What paces the samples of domain 1. */
ECATM_FUNCTION void ecatm_pace(ecatm_master *master, double time) {
  if (master->bus == NULL || master->outage != 0) {
    ecatm_wait_clock(master, time);
    return;
  }
  /* What passes is left to the sample that follows: it finds the same, unless it has passed. */
  if (ecatm_wait_cycles(master) < 0 && ecatm_wish(master, ECAT_EDOWN) == ECATM_ERROR)
    ecatm_stop(master);
  master->origin = ecatm_now() - time;
}

/* Waits for the bus where asked to, then samples; returns the cycle of the sample. */
ECATM_FUNCTION int ecatm_wait(void *object, double time) {
  ecatm_master *master = (ecatm_master *)object;
  if (master->waited && ecatm_same_time(time, master->wait_time)) return master->cycle;
  if (master->wait_for_bus) ecatm_pace(master, time);
  master->wait_time = time;
  master->waited = 1;
  ecatm_take_sample(master, time);
  return master->cycle;
}

/* --- How the bus and its slaves are -------------------------------------------------------- */

/* Of the last sample; returns whether the bus delivered. `order` makes the tool call this after the wait
 * that it came from.
 *
 * age: since the frames of the sample came back, s
 * missed: samples that came too late for the bus cycle they waited for
 * state: enum ecatm_bus_state
 * wkc, wkc_expected: working counters, sums of all domains of the bus */
ECATM_FUNCTION int ecatm_master_state(void *object, double time, int order, double *age, int *missed,
                                      int *state, int *wkc, int *wkc_expected) {
  ecatm_master *master = (ecatm_master *)object;
  (void)order;
  ecatm_at(master, time);
  *age = master->age;
  *missed = master->missed;
  *state = master->state;
  *wkc = master->wkc;
  *wkc_expected = master->wkc_expected;
  return master->state >= ECATM_INCOMPLETE;
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
  (void)order;
  ecatm_at(master, time);
  *al_state = ecatm_al_state(slave->al_state);
  *al_status_code = (int)slave->al_code;
  return slave->al_state == ECAT_AL_OP && (master->complete >> slave->domain & 1) != 0;
}

/* --- Reads --------------------------------------------------------------------------------- */

/* The physical value; while there is no bus, the last one, or that of a raw 0. `order` makes the tool
 * call reads after the wait that it came from. */
ECATM_FUNCTION double ecatm_read_real(void *object, double time, int order) {
  ecatm_pdo *pdo = (ecatm_pdo *)object;
  ecatm_master *master = pdo->node.master;
  (void)order;
  ecatm_at(master, time);
  if (master->outage == 0) ecatm_check(master, ecat_read(master->bus, pdo->signal, &pdo->value));
  return pdo->value * pdo->scale + pdo->offset;
}

ECATM_FUNCTION int ecatm_read_integer(void *object, double time, int order) {
  double value = ecatm_read_real(object, time, order);
  if (ecatm_is_integer(value)) return ecatm_nearest_integer(value);
  ModelicaFormatError("EtherCAT: entry 0x%04X:%02X of slave %d is %g, which no Modelica Integer can "
                      "hold; read it as a Real", (unsigned)((ecatm_pdo *)object)->index,
                      (unsigned)((ecatm_pdo *)object)->subindex,
                      ((ecatm_pdo *)object)->slave->position, value);
  return 0;
}

ECATM_FUNCTION int ecatm_read_boolean(void *object, double time, int order) {
  return ecatm_read_real(object, time, order) != 0;
}

#endif
