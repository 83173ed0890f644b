/* The inputs of a model: waits, samples, reads. */
#ifndef ECATM_SAMPLES_H
#define ECATM_SAMPLES_H

#include "ecatm_outputs.h"

/* --- Samples ------------------------------------------------------------------------------- */

/* Takes a new image of all domains and remembers its time. */
ECATM_FUNCTION void ecatm_take_sample(ecatm_master *master, double time) {
  ecatm_settle(master);
  ecatm_check(master, ecat_session_sample(&master->session));
  master->sample_time = time;
  master->sampled = 1;
}

/* Takes the sample of this time, unless an earlier call at this time has done so. */
ECATM_FUNCTION void ecatm_at(ecatm_master *master, double time) {
  if (!master->sampled || !ecatm_same_time(time, master->sample_time))
    ecatm_take_sample(master, time);
}

/* Logs that no block uses a master. Blocks use the master with the name etherCATMaster. If the model has
 * none, tools add one, and a master with another name has no blocks. */
ECATM_FUNCTION void ecatm_tell_unused(const ecatm_master *master) {
  if (master->objects != NULL) return;
  ModelicaFormatMessage("EtherCAT: %sno block uses this connection to bus '%s'. Blocks use the component with "
                        "the name etherCATMaster that is declared inner; a tool that finds none adds one with "
                        "default parameters. If that was not meant, rename this component to "
                        "etherCATMaster\n", master->heading, master->name);
}

/* Waits for the bus if the model wants that, then takes a sample. Returns the cycle of the sample. */
ECATM_FUNCTION int ecatm_wait(void *object, double time) {
  ecatm_master *master = (ecatm_master *)object;
  ecat_session *session = &master->session;
  if (master->waited && ecatm_same_time(time, master->wait_time)) return session->cycle;
  if (!master->waited) ecatm_tell_unused(master);
  if (master->wait_for_bus)
    ecatm_check(master, ecat_session_pace(session, session->in_step ? master->stride : 1, time));
  master->wait_time = time;
  master->waited = 1;
  ecatm_take_sample(master, time);
  return session->cycle;
}

/* --- State of the bus and its slaves ------------------------------------------------------- */

/* The state of the bus in the last sample. Returns whether the bus delivered. `order` makes the tool call
 * this function after the wait that has returned it.
 *
 * age: since the frames of the sample came back, s, or ECAT_AGE_NEVER
 * missed: bus cycles in addition to those that the model waited for, because the model was too slow
 * state: enum ecat_session_state
 * wkc, wkc_expected: working counters, sums of all domains of the bus */
ECATM_FUNCTION int ecatm_master_state(void *object, double time, int order, double *age, int *missed,
                                      int *state, int *wkc, int *wkc_expected) {
  ecatm_master *master = (ecatm_master *)object;
  const ecat_session *session = &master->session;
  (void)order;
  ecatm_at(master, time);
  *age = session->age;
  *missed = (int)(session->missed & 0x7FFFFFFF);
  *state = session->state;
  *wkc = session->wkc;
  *wkc_expected = session->wkc_expected;
  return session->state >= ECAT_SESSION_INCOMPLETE;
}

/* Whether the values of this slave in the sample are those of a cycle in which it took part in OP. */
ECATM_FUNCTION int ecatm_slave_state(void *object, double time, int order, int *al_state,
                                     int *al_status_code) {
  ecatm_slave *slave = (ecatm_slave *)object;
  (void)order;
  ecatm_at(slave->node.master, time);
  *al_state = slave->on_bus.al_state;
  *al_status_code = slave->on_bus.al_code;
  return slave->on_bus.valid;
}

/* --- Reads --------------------------------------------------------------------------------- */

/* Returns the physical value; without a bus the last value, or at first that of a raw 0. `order` makes the
 * tool call reads after the wait that has returned it. */
ECATM_FUNCTION double ecatm_read_real(void *object, double time, int order) {
  ecatm_pdo *pdo = (ecatm_pdo *)object;
  double value = 0;
  (void)order;
  ecatm_at(pdo->node.master, time);
  ecatm_check(pdo->node.master, ecat_session_read(&pdo->on_bus, &value));
  return value;
}

ECATM_FUNCTION int ecatm_read_integer(void *object, double time, int order) {
  const ecat_signal_info *entry = &((ecatm_pdo *)object)->on_bus.expected;
  double value = ecatm_read_real(object, time, order);
  if (ecatm_is_integer(value)) return ecatm_nearest_integer(value);
  ModelicaFormatError("EtherCAT: %sentry 0x%04X:%02X of slave %d is %g, which no Modelica Integer can "
                      "hold; read it as a Real",
                      ecatm_slave_of(((ecatm_pdo *)object)->on_bus.slave)->node.heading, entry->index,
                      entry->subindex, entry->slave, value);
  return 0;
}

ECATM_FUNCTION int ecatm_read_boolean(void *object, double time, int order) {
  return ecatm_read_real(object, time, order) != 0;
}

#endif
