/* The connection of a session: connecting, the behaviour without a bus, and the return of the bus. */
#include "session.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "internal.h"

/* --- messages ------------------------------------------------------------------------------- */

int ecat_session_fail(ecat_session *session, int code, const char *format, ...) {
  char text[sizeof session->problem]; /* the arguments may contain the old text */
  va_list arguments;
  va_start(arguments, format);
  vsnprintf(text, sizeof text, format, arguments);
  va_end(arguments);
  strcpy(session->problem, text);
  return code;
}

int ecat_session_client(ecat_session *session, int code) {
  return code < 0 ? ecat_session_fail(session, code, "%s", ecat_error(session->bus)) : code;
}

const char *session_heading(const ecat_session_slave *slave) {
  return slave->heading != NULL ? slave->heading : "";
}

void session_tell(ecat_session *session, int warning, const char *format, ...) {
  char text[sizeof session->problem + 100];
  va_list arguments;
  va_start(arguments, format);
  vsnprintf(text, sizeof text, format, arguments);
  va_end(arguments);
  session->settings.tell(session->settings.context, warning, text);
}

/* Fails because the product was generated for another bus. `here` describes the part of the bus that
 * differs, `expected` the need of the product. */
static int another(const ecat_session_slave *slave, const char *here, const char *expected) {
  ecat_session *session = slave->session;
  const char *name = ecat_name(session->bus);
  int usual = strcmp(name, "ecat0") == 0; /* the bus that ecatctl takes without --bus */
  if (slave->vendor == 0) /* written by hand for any slave */
    return ecat_session_fail(session, ECAT_EBUS, "%s%s; correct the name or the position of the slave",
                             session_heading(slave), here);
  return ecat_session_fail(session, ECAT_EBUS, "%s%s, but %s %s; regenerate it with: %s%s%s",
                           session_heading(slave), here, session->settings.product, expected,
                           slave->command, usual ? "" : " --bus ", usual ? "" : name);
}

/* --- expected slaves and entries ------------------------------------------------------------ */

static void identity(char *text, size_t size, const char *name, unsigned vendor, unsigned product,
                     unsigned revision) {
  snprintf(text, size, "%s (vendor 0x%08X, product 0x%08X, revision 0x%08X)", name, vendor, product,
           revision);
}

/* Finds a slave by its given name, or by its position if it has none. Does not check its identity. */
static int locate(ecat_session_slave *slave) {
  ecat_t *bus = slave->session->bus;
  int named = slave->given_name != NULL && slave->given_name[0] != '\0';
  int position = named ? ecat_find_name(bus, slave->given_name) : slave->position;
  char here[300], expected[300];
  if (position == ECAT_EBUS) {
    snprintf(expected, sizeof expected, "was generated for %s", slave->name);
    return another(slave, ecat_error(bus), expected);
  }
  if (position < 0 || position >= ecat_slave_count(bus)) {
    snprintf(here, sizeof here, "bus '%s' has no slave %d (it has %d slaves)", ecat_name(bus), position,
             ecat_slave_count(bus));
    snprintf(expected, sizeof expected, "was generated for %s there", slave->name);
    return another(slave, here, expected);
  }
  slave->position = position;
  return 0;
}

static int find_slave(ecat_session_slave *slave) {
  ecat_session *session = slave->session;
  ecat_t *bus = session->bus;
  ecat_slave_info found;
  char here[300], expected[300], text[400];
  int code = locate(slave);
  if (code != 0) return code;
  if (ecat_slave(bus, slave->position, &found) < 0) return ecat_session_client(session, ECAT_EBUS);
  if (slave->vendor != 0 && (found.vendor != slave->vendor || found.product != slave->product ||
                             (slave->revision != 0 && found.revision != slave->revision))) {
    identity(here, sizeof here, found.name, found.vendor, found.product, found.revision);
    snprintf(text, sizeof text, "slave %d of bus '%s' is %s", slave->position, ecat_name(bus), here);
    strcpy(expected, "was generated for ");
    identity(expected + strlen(expected), sizeof expected - strlen(expected), slave->name,
             slave->vendor, slave->product, slave->revision);
    return another(slave, text, expected);
  }
  snprintf(text, sizeof text, "%016llx", (unsigned long long)ecat_fingerprint(bus));
  slave->same_bus = strcmp(text, slave->fingerprint) == 0;
  slave->claimed = 0;
  slave->domain = found.domain;
  return slave->has_can ? session_can_find(slave) : 0;
}

/* A number with the fewest digits, at least 6, that strtod() reads back as the same number. */
static const char *number(char *text, double value) {
  int digits = 6;
  do sprintf(text, "%.*g", digits, value);
  while (strtod(text, NULL) != value && ++digits <= 17);
  return text;
}

/* Describes the meaning of the values of an entry, for messages. */
static void meaning(char *text, size_t size, const ecat_signal_info *entry) {
  char scale[32], offset[32] = "";
  if (!value_is_analog(entry->unit, entry->scale, entry->offset)) {
    snprintf(text, size, "raw values");
    return;
  }
  if (entry->offset != 0) {
    strcpy(offset, entry->offset < 0 ? " - " : " + ");
    number(offset + 3, entry->offset < 0 ? -entry->offset : entry->offset);
  }
  snprintf(text, size, "values %s%s (raw value * %s%s)",
           entry->unit[0] != '\0' ? "in " : "without a unit", entry->unit,
           number(scale, entry->scale), offset);
}

/* Checks that an entry is the expected one. Its layout is compared only if the fingerprint differs. The
 * meaning of its values is not a part of the fingerprint and is always compared, unless there is no
 * fingerprint (product written by hand). */
static int compare_entry(const ecat_session_entry *entry, const ecat_signal_info *found) {
  const ecat_session_slave *slave = entry->slave;
  const ecat_signal_info *expected = &entry->expected;
  char here[440], place[300], values[120], wanted[160];
  snprintf(place, sizeof place, "entry 0x%04X:%02X (%s) of slave %d (%s) of bus '%s'",
           expected->index, expected->subindex, found->name, slave->position, slave->name,
           ecat_name(slave->session->bus));
  if (!slave->same_bus &&
      (found->type != expected->type || found->bit_length != expected->bit_length)) {
    snprintf(here, sizeof here, "%s has %u bits and data type 0x%04X", place, found->bit_length,
             found->type);
    snprintf(wanted, sizeof wanted, "was generated for %u bits and data type 0x%04X",
             expected->bit_length, expected->type);
    return another(slave, here, wanted);
  }
  if (slave->fingerprint[0] == '\0' ||
      (strcmp(found->unit, expected->unit) == 0 && found->scale == expected->scale &&
       found->offset == expected->offset))
    return 0;
  meaning(values, sizeof values, found);
  snprintf(here, sizeof here, "%s has %s", place, values);
  strcpy(wanted, "was generated for ");
  meaning(wanted + strlen(wanted), sizeof wanted - strlen(wanted), expected);
  return another(slave, here, wanted);
}

static int find_entry(ecat_session_entry *entry) {
  const ecat_signal_info *expected = &entry->expected;
  ecat_t *bus = entry->slave->session->bus;
  ecat_signal_info found;
  entry->signal = ecat_bind(bus, entry->slave->position, expected->index, expected->subindex,
                            expected->output ? ECAT_OUTPUT : ECAT_INPUT);
  if (entry->signal < 0 || ecat_signal(bus, entry->signal, &found) < 0)
    return another(entry->slave, ecat_error(bus), "uses it");
  return compare_entry(entry, &found);
}

int ecat_session_add_slave(ecat_session *session, ecat_session_slave *slave) {
  ecat_session_slave **last = &session->slaves;
  int code;
  slave->session = session;
  slave->al_state = ECAT_SESSION_NOT_AVAILABLE;
  if (session->bus != NULL && (code = find_slave(slave)) != 0) return code;
  while (*last != NULL) last = &(*last)->next;
  *last = slave;
  return 0;
}

int ecat_session_add_entry(ecat_session_entry *entry) {
  ecat_session_entry **last = &entry->slave->entries;
  int code;
  entry->signal = -1;
  if (entry->slave->session->bus != NULL && (code = find_entry(entry)) != 0) return code;
  while (*last != NULL) last = &(*last)->next;
  *last = entry;
  return 0;
}

/* --- connecting ----------------------------------------------------------------------------- */

/* Checks that this is the expected bus, and finds all slaves and entries on it. */
static int resolve(ecat_session *session) {
  ecat_session_slave *slave;
  ecat_session_entry *entry;
  int code = 0;
  for (slave = session->slaves; slave != NULL && code == 0; slave = slave->next) {
    code = find_slave(slave);
    for (entry = slave->entries; entry != NULL && code == 0; entry = entry->next)
      code = find_entry(entry);
  }
  if (code == 0) code = session_can_resolve(session);
  if (code == 0 && session->settings.check != NULL)
    code = session->settings.check(session->settings.context);
  if (code != 0) return code;
  session->instance = ecat_instance(session->bus);
  session->losses++;
  session->attached = 1;
  session->in_step = 0;
  return 0;
}

static void disconnect(ecat_session *session) {
  ecat_close(session->bus);
  session->bus = NULL;
}

/* Tries once to connect, without waiting. During an outage it tries at most every RETURN_PAUSE_NS. */
static int attach(ecat_session *session) {
  uint64_t now = ecat_now();
  int code;
  if (session->outage != 0 && now - session->tried_ns < RETURN_PAUSE_NS) return session->outage;
  session->tried_ns = now;
  code = ecat_session_client(session, ecat_open(&session->bus, session->settings.bus));
  if (code == 0) {
    session->connections++;
    session->bus->program = session->settings.program;
    code = resolve(session);
  }
  if (code != 0) disconnect(session);
  return code;
}

int session_refresh(ecat_session *session) {
  int code;
  if (session->bus == NULL && (code = attach(session)) != 0) return code;
  code = ecat_session_client(session, ecat_sample(session->bus));
  if (code == ECAT_EBUS) { /* the bus came back with other slaves: check the slaves of the program again */
    disconnect(session);
    if ((code = attach(session)) != 0) return code;
    return ecat_session_client(session, ecat_sample(session->bus));
  }
  if (code == 0 && ecat_instance(session->bus) != session->instance) code = resolve(session);
  return code;
}

void ecat_session_init(ecat_session *session, const ecat_session_settings *settings) {
  memset(session, 0, sizeof *session);
  session->settings = *settings;
  session->state = ECAT_SESSION_MISSING;
  session->age = ECAT_AGE_NEVER;
}

void ecat_session_end(ecat_session *session) {
  ecat_session_slave *slave;
  if (session->bus != NULL) {
    session_can_flush(session);
    ecat_can_end(session->bus);
  }
  disconnect(session);
  session_observe_nothing(session);
  for (slave = session->slaves; slave != NULL; slave = slave->next) slave->claimed = slave->told = 0;
  session->attached = session->outage = session->paced = session->in_step = 0;
  session->missed = session->lost_ns = session->exchanged_ns = 0;
  session->age = ECAT_AGE_NEVER;
  session_can_forget(session);
}

/* --- failures ------------------------------------------------------------------------------- */

void session_sleep_until(uint64_t ns) {
  struct timespec until;
  until.tv_sec = (time_t)(ns / NS_PER_S);
  until.tv_nsec = (long)(ns % NS_PER_S);
  while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, NULL) != 0 && ecat_now() < ns) continue;
}

int session_passes(int code) {
  return code == ECAT_EDOWN || code == ECAT_ESTALE || code == ECAT_ETIMEOUT;
}

int session_wish(const ecat_session *session, int code) {
  if (!session_passes(code)) return ECAT_FAILURE_ERROR;
  return session->attached ? session->settings.when_failed : session->settings.when_missing;
}

/* Reports the beginning of an outage and its cause, once. */
static void begin_outage(ecat_session *session, int code, const char *what) {
  if (session->outage == 0) {
    session->outage_ns = ecat_now();
    session_tell(session, 1, "%s; %s %s", session->problem, session->settings.program, what);
  }
  session->outage = code;
  session->in_step = 0;
}

void session_end_outage(ecat_session *session) {
  if (session->outage == 0) return;
  session->outage = 0;
  session_tell(session, 0, "bus '%s' is there, %.1f s later", session->settings.bus,
               (double)(ecat_now() - session->outage_ns) * 1e-9);
}

/* Waits until the bus, which has failed with `code`, is there again: at most `patience` seconds, or for
 * ever if `patience` is 0. */
static int await(ecat_session *session, int code) {
  double patience = session->settings.patience;
  char what[60] = "waits for it";
  if (patience > 0) sprintf(what, "waits for it, at most %g s", patience);
  begin_outage(session, code, what);
  do {
    uint64_t now = ecat_now();
    double waited = (double)(now - session->outage_ns) * 1e-9;
    if (!session_passes(code)) return code;
    if (patience > 0 && waited >= patience)
      return ecat_session_fail(session, code, "%s; %s has waited for %.1f s, as long as %s allows",
                               session->problem, session->settings.program, waited,
                               session->settings.patience_name);
    session_sleep_until(now + RETURN_PAUSE_NS);
  } while ((code = session_refresh(session)) != 0);
  session_end_outage(session);
  return 0;
}

int session_endure(ecat_session *session, int code) {
  switch (session_wish(session, code)) {
    case ECAT_FAILURE_WAIT:
      return await(session, code);
    case ECAT_FAILURE_CONTINUE:
      begin_outage(session, code, "goes on without it");
      return 0;
    default:
      if (session_passes(code)) session->outage = code;
      return code;
  }
}

int ecat_session_begin(ecat_session *session) {
  int code = attach(session);
  return code != 0 ? session_endure(session, code) : 0;
}
