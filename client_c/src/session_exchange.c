/* The exchange of a session with the bus: outputs and their claims, samples and their state. */
#include "session.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "internal.h"

#define RECLAIM_NS 100000000u /* between two attempts to claim outputs again */
#define QUIET_NS 1000000000u  /* the same message is not repeated within this time */
#define PATIENCE 1.0          /* a missing cycle is a failure after this time in s plus 10 cycles */
#define BEHIND 0.1            /* largest delay in s that a program without a bus makes up for */

/* --- owning outputs ------------------------------------------------------------------------- */

static int writes(const ecat_session *session, int position) {
  const ecat_session_slave *slave = session->slaves;
  while (slave != NULL && !(slave->writes && slave->position == position)) slave = slave->next;
  return slave != NULL;
}

static int owns_outputs(const ecat_session *session) {
  const ecat_session_slave *slave = session->slaves;
  while (slave != NULL && !slave->writes) slave = slave->next;
  return slave != NULL;
}

void session_forget_claims(ecat_session *session) {
  ecat_session_slave *slave;
  for (slave = session->slaves; slave != NULL; slave = slave->next) slave->claimed = 0;
  session->can_claimed = 0;
}

/* Sets the error text of a refused claim: it names the slave of the session, and a remedy. */
static int owned_by_another(ecat_session *session, const int *signals, size_t count) {
  char text[sizeof session->problem];
  const ecat_session_slave *slave;
  ecat_output_info output;
  ecat_signal_info info;
  size_t i;
  snprintf(text, sizeof text, "%s", ecat_error(session->bus));
  for (i = 0; i < count; i++)
    if (ecat_output(session->bus, signals[i], &output) == 0 && output.owner >= 0 && !output.owned &&
        ecat_signal(session->bus, signals[i], &info) == 0)
      break;
  if (i == count) return ecat_session_fail(session, ECAT_EOWNED, "%s", text); /* released since */
  slave = session->slaves;
  while (!(slave->writes && slave->position == info.slave)) slave = slave->next;
  return ecat_session_fail(
      session, ECAT_EOWNED, "%s%s%s", session_heading(slave), text,
      output.pid == (unsigned)getpid() ? "" : ", or set readOnly where nothing is to be written");
}

/* Claims all outputs of all slaves that the program writes: all of them or none. */
static int claim(ecat_session *session) {
  int i, code, last = -1, wanted = 0, count = ecat_signal_count(session->bus);
  int *signals = malloc(((size_t)count + 1) * sizeof *signals);
  size_t found = 0;
  ecat_signal_info info;
  ecat_session_slave *slave;
  if (signals == NULL) return ecat_session_fail(session, ECAT_ESYS, "out of memory");
  for (i = 0; i < count && ecat_signal(session->bus, i, &info) == 0; i++) {
    if (info.slave != last) wanted = writes(session, info.slave);
    last = info.slave;
    if (info.output && wanted && !ecat_is_reserved(session->bus, i)) signals[found++] = i;
  }
  code = ecat_claim_entries(session->bus, signals, found, session->settings.lease);
  if (code == ECAT_EOWNED) {
    code = owned_by_another(session, signals, found);
    free(signals);
    return code;
  }
  free(signals);
  for (slave = session->slaves; code == 0 && slave != NULL; slave = slave->next)
    slave->claimed = slave->writes;
  return ecat_session_client(session, code);
}

/* --- writing -------------------------------------------------------------------------------- */

void ecat_session_write(ecat_session_entry *entry, double value) {
  entry->real = value;
  entry->is_whole = 0;
  entry->pending = 1;
}

void ecat_session_write_int(ecat_session_entry *entry, int64_t value) {
  const ecat_signal_info *expected = &entry->expected;
  entry->whole = value;
  entry->real = (double)value;
  entry->is_whole = !value_is_analog(expected->unit, expected->scale, expected->offset);
  entry->pending = 1;
}

/* Stages one value. An analog quantity is cut to the limits of the entry; any other value beyond the
 * limits is refused. */
static int stage_entry(ecat_t *bus, const ecat_session_entry *entry) {
  const ecat_signal_info *expected = &entry->expected;
  if (entry->is_whole) return ecat_write_int(bus, entry->signal, entry->whole);
  if (!value_is_analog(expected->unit, expected->scale, expected->offset))
    return ecat_write(bus, entry->signal, entry->real);
  return ecat_write_scaled(bus, entry->signal, entry->real, expected->scale, expected->offset);
}

/* Stages all pending values of a slave, and claims its outputs first if needed. Also returns ECAT_ELEASE
 * if it is too early to claim lost outputs again. */
static int stage(ecat_session_slave *slave) {
  ecat_session *session = slave->session;
  const ecat_session_entry *entry;
  int code = 0;
  if (!slave->claimed) {
    if (ecat_now() - session->lost_ns < RECLAIM_NS) return ECAT_ELEASE;
    code = claim(session);
  }
  for (entry = slave->entries; entry != NULL && code == 0; entry = entry->next)
    if (entry->pending && !ecat_is_reserved(session->bus, entry->signal) &&
        (code = stage_entry(session->bus, entry)) < 0)
      ecat_session_fail(session, code, "%s%s", session_heading(slave), ecat_error(session->bus));
  return code;
}

/* Whether a slave is a drive: it has a controlword, 0x6040 of the first axis (ETG.6010). */
static int is_drive(const ecat_session_slave *slave) {
  const ecat_session_entry *entry = slave->entries;
  while (entry != NULL && !(entry->expected.output && entry->expected.index >= 0x6040 &&
                            (entry->expected.index - 0x6040) % 0x800 == 0))
    entry = entry->next;
  return entry != NULL;
}

/* Claims lost outputs again and commits all values, at most every RECLAIM_NS. The values of drives are of before the
 * loss, and could start them: the next sample writes others. CAN channels are claimed by the next message. */
static int reclaim(ecat_session *session) {
  uint64_t before = session->lost_ns;
  ecat_session_slave *slave;
  int code = 0;
  session_forget_claims(session);
  if (ecat_now() - before < RECLAIM_NS) return ECAT_ELEASE;
  if (owns_outputs(session) && (code = claim(session)) != 0) return code;
  session->lost_ns = ecat_now();
  session->losses++;
  if (session->lost_ns - before > QUIET_NS)
    session_tell(session, 1, "%s; %s %s", session->problem, session->settings.program,
                 owns_outputs(session) ? "has claimed them again" : "sends again");
  if (!owns_outputs(session)) return 0;
  for (slave = session->slaves; code == 0 && slave != NULL; slave = slave->next)
    if (slave->writes && !is_drive(slave)) code = stage(slave);
  return code != 0 ? code : ecat_session_client(session, ecat_commit(session->bus));
}

int session_not_written(ecat_session *session, int code) {
  int lost = code == ECAT_ELEASE && session->settings.when_failed != ECAT_FAILURE_ERROR;
  if (lost) code = reclaim(session);
  if (code == 0 || (lost && code == ECAT_ELEASE)) return 0;              /* tried again later */
  if (code == ECAT_ELEASE)
    ecat_session_fail(session, code, "%s; with another whenFailed than Error %s claims them again and "
                      "goes on", session->problem, session->settings.program);
  if (session_wish(session, code) == ECAT_FAILURE_WAIT) return 0; /* the next sample waits */
  return session_endure(session, code);
}

int ecat_session_stage(ecat_session_slave *slave) {
  ecat_session *session = slave->session;
  int code;
  if (session->settings.read_only) return 0;
  slave->writes = 1;
  if (session->bus == NULL || session->outage != 0) return 0;
  code = stage(slave);
  return code != 0 ? session_not_written(session, code) : 0;
}

int ecat_session_commit(ecat_session *session) {
  int code;
  if (session->settings.read_only || session->bus == NULL || session->outage != 0) return 0;
  code = ecat_session_client(session, ecat_commit(session->bus));
  return code != 0 ? session_not_written(session, code) : 0;
}

/* --- waiting -------------------------------------------------------------------------------- */

static int wait_cycles(ecat_session *session, unsigned cycles) {
  ecat_t *bus = session->bus;
  uint64_t now = ecat_cycle(bus), goal = (session->in_step ? session->waited_cycle : now) + cycles;
  double timeout = PATIENCE + 10 * ecat_cycle_time(bus);
  /* Cycle numbers start again when the daemon is restarted. */
  while (ecat_cycle(bus) < goal && ecat_instance(bus) == session->instance) {
    int code = ecat_wait(bus, 1, timeout);
    /* A sample keeps the lease alive while the program waits for many cycles. */
    if (code == 0 && ecat_cycle(bus) < goal) code = ecat_sample(bus);
    if (code != 0) return ecat_session_client(session, code);
  }
  session->waited_cycle = ecat_cycle(bus);
  if (ecat_instance(bus) == session->instance && session->waited_cycle > goal)
    session->missed += session->waited_cycle - goal;
  session->in_step = 1;
  return 0;
}

int ecat_session_pace(ecat_session *session, unsigned cycles, double time) {
  double now = (double)ecat_now() * 1e-9;
  int code = 0;
  if (session->bus != NULL && session->outage == 0) {
    if (cycles > 0) code = wait_cycles(session, cycles);
    /* A failure that may end by itself is left to the next sample. If the failure still lasts, the
     * sample finds it, too. */
    if (code != 0 && session_wish(session, ECAT_EDOWN) == ECAT_FAILURE_ERROR)
      return session_endure(session, code);
    session->origin = (double)ecat_now() * 1e-9 - time;
  } else if (session->paced && session->origin + time > now - BEHIND) {
    if (session->origin + time > now) session_sleep_until(ecat_ns(session->origin + time));
  } else {
    session->origin = now - time;
  }
  session->paced = 1;
  return 0;
}

/* --- samples -------------------------------------------------------------------------------- */

/* Evaluates the new sample of every domain. Sets bit i of `*complete` if all slaves took part in the
 * exchange of domain i. */
static int observe_domains(ecat_session *session, uint32_t *complete) {
  ecat_domain_info info;
  uint64_t newest = 0;
  int i, code;
  *complete = 0;
  session->wkc = session->wkc_expected = 0;
  for (i = 0; i < ecat_domain_count(session->bus); i++) {
    if ((code = ecat_session_client(session, ecat_domain(session->bus, i, &info))) != 0) return code;
    if (info.wkc_state == ECAT_WKC_COMPLETE) *complete |= 1u << i;
    session->wkc += (int)info.wkc;
    session->wkc_expected += (int)info.wkc_expected;
    if (info.cycle <= newest) continue;
    newest = info.cycle;
    session->exchanged_ns = info.time_ns;
  }
  session->cycle = (int)(newest & 0x7FFFFFFF);
  session->exchanged_cycle = newest;
  return 0;
}

/* 0x10 is the error flag of the AL status. */
static int al_state(unsigned al_status) {
  switch (al_status & 0x0F) {
    case ECAT_AL_INIT: return ECAT_SESSION_INIT;
    case ECAT_AL_PREOP: return ECAT_SESSION_PREOP;
    case ECAT_AL_BOOT: return ECAT_SESSION_BOOTSTRAP;
    case ECAT_AL_SAFEOP: return ECAT_SESSION_SAFEOP;
    case ECAT_AL_OP: return ECAT_SESSION_OP;
    default: return ECAT_SESSION_NOT_AVAILABLE;
  }
}

/* Whether an earlier slave of the session is the same one, so that it is reported once. */
static int is_told_elsewhere(const ecat_session_slave *slave) {
  const ecat_session_slave *other = slave->session->slaves;
  while (other != slave && other->position != slave->position) other = other->next;
  return slave->vendor == 0 && other != slave;
}

/* Reports, once, that a slave is not in OP. A single lost frame is not reported here: `valid` shows
 * it. */
static int tell_state(ecat_session_slave *slave, int optional) {
  static const char *const names[] = {"", "", "INIT", "PREOP", "BOOT", "SAFEOP", "OP"};
  ecat_session *session = slave->session;
  char text[300], where[80], reason[60] = "";
  if (is_told_elsewhere(slave)) return 0;
  if ((slave->al_state == ECAT_SESSION_OP) != slave->told) return 0;
  slave->told = !slave->told;
  snprintf(text, sizeof text, "%sslave %d (%s) of bus '%s'", session_heading(slave), slave->position,
           slave->name, session->settings.bus);
  if (!slave->told) {
    session_tell(session, 0, "%s is in OP again", text);
    return 0;
  }
  if (optional && slave->al_state == ECAT_SESSION_NOT_AVAILABLE) {
    session_tell(session, 0, "%s is optional, and not there; its values are not valid until it is in OP",
                 text);
    return 0;
  }
  if (slave->al_state == ECAT_SESSION_NOT_AVAILABLE)
    strcpy(where, "does not answer");
  else
    sprintf(where, "is not in OP, but in %s", names[slave->al_state]);
  if (slave->al_code != 0) sprintf(reason, " (AL status code 0x%04X)", (unsigned)slave->al_code);
  if (session->settings.require_op)
    return ecat_session_fail(session, ECAT_ESTATE, "%s %s%s; %s ends, as requireOperational asks",
                             text, where, reason, session->settings.program);
  session_tell(session, 1, "%s %s%s; its values are not valid until it is", text, where, reason);
  return 0;
}

static int observe_slave(ecat_session_slave *slave, uint32_t complete) {
  const ecat_session_entry *entry = slave->entries;
  ecat_t *bus = slave->session->bus;
  ecat_slave_info info = {0};
  int code;
  /* An output entry is valid only in OP. Asking for the validity costs a fifth of ecat_slave(). */
  if (entry != NULL && entry->expected.output && ecat_validity(bus, entry->signal) == ECAT_VALID) {
    slave->al_state = ECAT_SESSION_OP;
    slave->al_code = 0;
  } else {
    code = ecat_slave(bus, slave->position, &info);
    if (code != 0) return ecat_session_client(slave->session, code);
    slave->al_state = al_state(info.al_state);
    slave->al_code = (int)info.al_code;
  }
  slave->valid = slave->al_state == ECAT_SESSION_OP && (complete >> slave->domain & 1) != 0 && !info.absent;
  slave->missed = slave->al_state != ECAT_SESSION_OP &&
                  !(info.optional && slave->al_state == ECAT_SESSION_NOT_AVAILABLE);
  return tell_state(slave, info.optional);
}

static int observe(ecat_session *session) {
  ecat_session_slave *slave;
  uint32_t complete = 0, all = (1u << ecat_domain_count(session->bus)) - 1;
  int code = observe_domains(session, &complete);
  session->state = ECAT_SESSION_OPERATIONAL;
  for (slave = session->slaves; slave != NULL && code == 0; slave = slave->next) {
    code = observe_slave(slave, complete);
    if (slave->missed) session->state = ECAT_SESSION_NOT_OPERATIONAL;
  }
  if (complete != all) session->state = ECAT_SESSION_INCOMPLETE;
  return code == 0 ? session_can_observe(session) : code;
}

void session_observe_nothing(ecat_session *session) {
  ecat_session_slave *slave;
  session->wkc = 0;
  session->state = session->outage == ECAT_ESTALE || session->outage == ECAT_ETIMEOUT
                       ? ECAT_SESSION_STANDS_STILL
                       : ECAT_SESSION_MISSING;
  for (slave = session->slaves; slave != NULL; slave = slave->next) {
    slave->valid = slave->al_code = 0;
    slave->al_state = ECAT_SESSION_NOT_AVAILABLE;
  }
  session_can_observe_nothing(session);
}

int ecat_session_sample(ecat_session *session) {
  int code = session_can_settle(session);
  uint64_t now;
  if (code != 0) return code;
  session->samples++;
  code = session_refresh(session);
  if (code == 0)
    session_end_outage(session);
  else if ((code = session_endure(session, code)) != 0)
    return code;
  if (session->outage != 0)
    session_observe_nothing(session);
  else if ((code = observe(session)) != 0)
    return code;
  now = ecat_now();
  if (session->exchanged_ns > 0)
    session->age = now > session->exchanged_ns ? (double)(now - session->exchanged_ns) * 1e-9 : 0;
  return 0;
}

int ecat_session_read(ecat_session_entry *entry, double *value) {
  ecat_session *session = entry->slave->session;
  int code = 0;
  if (session->bus != NULL && session->outage == 0)
    code = ecat_session_client(session, ecat_read(session->bus, entry->signal, &entry->raw));
  *value = ecat_to_physical(entry->raw, entry->expected.scale, entry->expected.offset);
  return code;
}

int ecat_session_read_int(ecat_session_entry *entry, int64_t *value) {
  ecat_session *session = entry->slave->session;
  int code;
  if (session->bus == NULL || session->outage != 0) return 0;
  code = ecat_read_int(session->bus, entry->signal, value);
  return ecat_session_client(session, code);
}
