/* Reads resources/plant.txt, the list of the slaves and variables of the FMU. Its lines consist of words:
 *
 *     ecatd-plant 1
 *     token TOKEN                        GUID or instantiation token of the model description
 *     fingerprint HEX                    of the bus
 *     bus NAME                           start value of the parameter
 *     command TEXT                       command that makes the FMU again
 *     slaves COUNT
 *     slave POSITION VENDOR PRODUCT REVISION NAME LABEL    NAME: in the configuration, or -
 *     messages COUNT                     of CAN buses behind slaves
 *     message SLAVE ID SENDS LENGTH TRANSMISSION PERIOD TIMEOUT    ID: as in ecat_can_frame
 *     drives COUNT
 *     drive SLAVE AXIS LINEAR POSITION VELOCITY TORQUE CURRENT    scales, as in ecat_drive_settings
 *     variables COUNT                    in the order of their value references, 0 first
 *     variable TYPE ROLE START NAME [SLAVE [WHAT SCALE OFFSET MINIMUM MAXIMUM UNIT]]
 *     variable TYPE ROLE START NAME SLAVE DRIVE    of a drive
 *     variable TYPE ROLE START NAME ECU    of a bus terminal; the CAN bus is that of the first slave. START of
 *                                          Tx_Clock: 0 countdown, 1 triggered
 *
 * WHAT is INDEX SUBINDEX DATATYPE BITS of an entry; MESSAGE of a variable of a CAN message, and of a CAN signal
 * MESSAGE START BITS ENDIAN NUMBER and five numbers of its selector, as in ecat_session_signal. The unit is the rest of
 * the line, and may be empty.
 *
 * Floating-point numbers are the 16 hexadecimal digits of their IEEE 754 bits: exact, and the same in
 * every locale.
 */
#ifndef _GNU_SOURCE
#define _GNU_SOURCE
#endif
#include "plant.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

enum { MAX_BYTES = 64 << 20, MAX_ITEMS = 1 << 20, MAX_ECUS = 64 };

static const char *const type_names[PLANT_TYPES] = {
    "Real",   "Boolean", "String", "Integer", "Int8",  "UInt8",
    "Int16",  "UInt16",  "Int32",  "UInt32",  "Int64", "UInt64", "Binary", "Clock"};

static const char *const role_names[ROLES] = {
    "time",           "bus",       "waitForBus", "lease",  "whenMissing",    "whenFailed",
    "patience",       "readOnly",  "requireOperational",   "connected",      "state",   "cycle",
    "age",
    "missed",         "workingCounter", "workingCounterExpected", "valid",   "alState",
    "alStatusCode",   "canState",  "canSendErrors", "canReceiveErrors", "canValid", "canAge", "canCount",
    "canInput",       "canOutput", "input",     "output",    "driveEnable", "driveQuickStop", "driveFaultReset",
    "driveHome", "driveMode", "drivePositionReference", "driveSpeedReference", "driveTorqueReference", "drivePosition",
    "driveSpeed", "driveTorque", "driveEnabled", "driveHomed", "driveReached", "driveState", "driveErrorCode", "interval",  "framesSent",  "framesReceived",
    "operationsRefused", "operationsLost", "BusNotifications", "Rx_Clock", "Rx_Data",    "Tx_Clock", "Tx_Data"};

/* --- words --------------------------------------------------------------------------------- */

/* The text that is left to read, and whether the text so far was as expected. */
typedef struct reader {
  char *line; /* rest of the line */
  char *next; /* the lines after it */
  int number;
  int wrong;
  char nothing[8]; /* an empty word, returned in place of a missing one */
} reader;

static int next_line(reader *r) {
  char *end;
  if (r->next == NULL || *r->next == '\0') return 0;
  r->line = r->next;
  end = strchr(r->line, '\n');
  if (end != NULL) *end = '\0';
  r->next = end == NULL ? NULL : end + 1;
  r->number++;
  return 1;
}

static char *word(reader *r) {
  char *found = strsep(&r->line, " ");
  if (found != NULL && *found != '\0') return found;
  r->wrong = 1;
  r->nothing[0] = '\0';
  return r->nothing;
}

static int64_t number(reader *r, int base, int64_t low, int64_t high) {
  char *text = word(r), *end = text;
  int64_t value;
  errno = 0;
  value = strtoll(text, &end, base);
  if (*end != '\0' || errno != 0 || value < low || value > high) {
    r->wrong = 1;
    return low;
  }
  return value;
}

static double real(reader *r) {
  char *text = word(r), *end = text;
  uint64_t bits = strtoull(text, &end, 16);
  double value;
  if (strlen(text) != 16 || *end != '\0') r->wrong = 1;
  memcpy(&value, &bits, sizeof value);
  return value;
}

static int name(reader *r, const char *const *names, int count) {
  const char *text = word(r);
  int i;
  for (i = 0; i < count; i++)
    if (strcmp(text, names[i]) == 0) return i;
  r->wrong = 1;
  return 0;
}

static char *copy(reader *r, const char *text) {
  char *found = text == NULL ? NULL : strdup(text);
  if (found == NULL) r->wrong = 1;
  return found;
}

/* The rest of a line that begins with `key`. */
static char *keyed(reader *r, const char *key) {
  if (!next_line(r) || strcmp(word(r), key) != 0) r->wrong = 1;
  return r->wrong ? NULL : copy(r, r->line);
}

static size_t count(reader *r, const char *key) {
  if (!next_line(r) || strcmp(word(r), key) != 0) r->wrong = 1;
  return r->wrong ? 0 : (size_t)number(r, 10, 0, MAX_ITEMS);
}

/* --- lines --------------------------------------------------------------------------------- */

static void read_slave(reader *r, plant_slave *slave) {
  const char *given_name;
  if (!next_line(r) || strcmp(word(r), "slave") != 0) r->wrong = 1;
  if (r->wrong) return;
  slave->on_bus.position = (int)number(r, 10, 0, 65535);
  slave->on_bus.vendor = (uint32_t)number(r, 16, 0, UINT32_MAX);
  slave->on_bus.product = (uint32_t)number(r, 16, 0, UINT32_MAX);
  slave->on_bus.revision = (uint32_t)number(r, 16, 0, UINT32_MAX);
  given_name = word(r);
  slave->given_name = copy(r, strcmp(given_name, "-") == 0 ? "" : given_name);
  slave->label = copy(r, r->line);
}

static void read_message(reader *r, plant_message *message, plant_slave *slaves, size_t count) {
  ecat_session_message *on_bus = &message->on_bus;
  if (!next_line(r) || strcmp(word(r), "message") != 0 || count == 0) r->wrong = 1;
  if (r->wrong) return;
  on_bus->slave = &slaves[number(r, 10, 0, (int64_t)count - 1)].on_bus;
  on_bus->id = (uint32_t)number(r, 16, 0, UINT32_MAX);
  on_bus->sends = (int)number(r, 10, 0, 1);
  on_bus->length = (int)number(r, 10, 0, 8);
  on_bus->transmission = (int)number(r, 10, ECAT_SESSION_ON_CHANGE, ECAT_SESSION_ON_TRIGGER);
  on_bus->period = real(r);
  on_bus->timeout = real(r);
}

static void read_signal(reader *r, plant_variable *variable) {
  ecat_session_signal *signal = &variable->signal;
  signal->name = variable->name;
  signal->start = (int)number(r, 10, 0, 63);
  signal->length = (int)number(r, 10, 1, 64);
  signal->big_endian = (int)number(r, 10, 0, 1);
  signal->number = (int)number(r, 10, ECAT_SESSION_UNSIGNED, ECAT_SESSION_FLOAT);
  signal->selector.start = (int)number(r, 10, 0, 63);
  signal->selector.length = (int)number(r, 10, 0, 31);
  signal->selector.big_endian = (int)number(r, 10, 0, 1);
  signal->selector.low = (double)number(r, 10, 0, INT32_MAX);
  signal->selector.high = (double)number(r, 10, 0, INT32_MAX);
  signal->scale = real(r);
  signal->offset = real(r);
  signal->minimum = real(r);
  signal->maximum = real(r);
  signal->unit = variable->unit = copy(r, r->line == NULL ? "" : r->line);
}

static void read_drive(reader *r, plant_drive *drive, size_t slaves) {
  int i;
  if (!next_line(r) || strcmp(word(r), "drive") != 0 || slaves == 0) r->wrong = 1;
  if (r->wrong) return;
  drive->slave = (int)number(r, 10, 0, (int64_t)slaves - 1);
  drive->axis = (int)number(r, 10, 1, 8);
  drive->linear = (int)number(r, 10, 0, 1);
  for (i = 0; i < 4; i++) {
    drive->scales[i] = real(r);
    if (!(drive->scales[i] < 0 || drive->scales[i] > 0)) r->wrong = 1;
  }
}

static void read_variable(reader *r, plant_variable *variable, size_t slaves, size_t messages, size_t drives) {
  ecat_signal_info *entry = &variable->on_bus.expected;
  if (!next_line(r) || strcmp(word(r), "variable") != 0) r->wrong = 1;
  if (r->wrong) return;
  variable->type = (enum plant_type)name(r, type_names, PLANT_TYPES);
  variable->role = (enum plant_role)name(r, role_names, ROLES);
  if (variable->type == PLANT_REAL)
    variable->start.real = real(r);
  else if (variable->type == PLANT_STRING)
    (void)word(r);
  else
    variable->start.integer = number(r, 10, INT64_MIN, INT64_MAX);
  variable->name = copy(r, word(r));
  if (variable->role < ROLE_VALID || (variable->role >= ROLE_INTERVAL && variable->role < ROLE_BUS_NOTIFICATIONS)) return;
  if (variable->role >= ROLE_BUS_NOTIFICATIONS) {
    variable->ecu = (int)number(r, 10, 0, MAX_ECUS - 1);
    return;
  }
  variable->slave = (int)number(r, 10, 0, (int64_t)slaves - 1);
  if (variable->role > ROLE_OUTPUT) {
    variable->drive = 1 + (int)number(r, 10, 0, (int64_t)drives - 1);
    if (drives == 0) r->wrong = 1;
    return;
  }
  if (variable->role < ROLE_CAN_VALID) return;
  if (variable->role < ROLE_INPUT) {
    variable->message = (int)number(r, 10, 0, (int64_t)messages - 1);
    if (variable->role >= ROLE_CAN_INPUT) read_signal(r, variable);
    return;
  }
  entry->index = (unsigned)number(r, 16, 1, 0xFFFF);
  entry->subindex = (unsigned)number(r, 16, 0, 0xFF);
  entry->type = (unsigned)number(r, 16, 0, 0xFFFF);
  entry->bit_length = (unsigned)number(r, 10, 1, 64);
  entry->scale = real(r);
  entry->offset = real(r);
  entry->minimum = real(r);
  entry->maximum = real(r);
  entry->unit = variable->unit = copy(r, r->line == NULL ? "" : r->line);
  entry->output = variable->role == ROLE_INPUT;
  if (!(entry->scale < 0 || entry->scale > 0)) r->wrong = 1;
}

#define ROLE_BIT(role) ((uint64_t)1 << (role))

/* Checks the bus terminals, which have all of their variables once, and counts them. */
static void check_ecus(reader *r, plant *p, uint64_t found) {
  const uint64_t fixed = (ROLE_BIT(ROLE_BUS_NOTIFICATIONS) - ROLE_BIT(ROLE_FRAMES_SENT)) | ROLE_BIT(ROLE_CAN_STATE) |
                         ROLE_BIT(ROLE_CAN_SEND_ERRORS) | ROLE_BIT(ROLE_CAN_RECEIVE_ERRORS);
  unsigned members[MAX_ECUS] = {0};
  size_t i;
  for (i = 0; i < p->variable_count; i++) {
    const plant_variable *v = &p->variables[i];
    int clock = v->role == ROLE_RX_CLOCK || v->role == ROLE_TX_CLOCK;
    int binary = v->role == ROLE_RX_DATA || v->role == ROLE_TX_DATA;
    if (clock != (v->type == PLANT_CLOCK) || binary != (v->type == PLANT_BINARY)) r->wrong = 1;
    if (v->role == ROLE_INTERVAL && (v->type != PLANT_REAL || !(v->start.real > 0))) r->wrong = 1;
    if (v->role == ROLE_TX_CLOCK) p->triggered |= v->start.integer != 0;
    if (v->role < ROLE_BUS_NOTIFICATIONS) continue;
    members[v->ecu] += 1u << 4 * (v->role - ROLE_BUS_NOTIFICATIONS);
    if ((size_t)v->ecu >= p->ecu_count) p->ecu_count = (size_t)v->ecu + 1;
  }
  for (i = 0; i < p->ecu_count; i++)
    if (members[i] != 0x11111) r->wrong = 1;
  if (p->ecu_count > 0 && ((found & fixed) != fixed || p->slave_count == 0)) r->wrong = 1;
  if (p->ecu_count > 0 && !p->triggered && !(found & ROLE_BIT(ROLE_INTERVAL))) r->wrong = 1;
}

/* Checks that all parameters and diagnostics exist, since the plant looks them up by role, and that only
 * the bus name is a string. */
static void check_roles(reader *r, plant *p) {
  uint64_t found = 0, needed = ROLE_BIT(ROLE_VALID) - 1u - ROLE_BIT(ROLE_TIME);
  size_t i;
  for (i = 0; i < p->variable_count; i++) {
    const plant_variable *variable = &p->variables[i];
    if ((variable->role == ROLE_BUS) != (variable->type == PLANT_STRING)) r->wrong = 1;
    found |= ROLE_BIT(variable->role);
  }
  if ((found & needed) != needed) r->wrong = 1;
  check_ecus(r, p, found);
}

static void read_table(reader *r, plant *p) {
  size_t i, n;
  char *text = keyed(r, "ecatd-plant");
  if (text == NULL || strcmp(text, "1") != 0) r->wrong = 1;
  free(text);
  p->token = keyed(r, "token");
  text = keyed(r, "fingerprint");
  if (text == NULL || strlen(text) != 16) r->wrong = 1;
  if (!r->wrong) memcpy(p->fingerprint, text, 17);
  free(text);
  p->bus_start = keyed(r, "bus");
  p->command = keyed(r, "command");
  n = count(r, "slaves");
  p->slaves = calloc(n + 1, sizeof *p->slaves);
  for (i = 0; p->slaves != NULL && i < n && !r->wrong; i++) read_slave(r, &p->slaves[p->slave_count++]);
  n = count(r, "messages");
  p->messages = calloc(n + 1, sizeof *p->messages);
  for (i = 0; p->messages != NULL && i < n && !r->wrong; i++)
    read_message(r, &p->messages[p->message_count++], p->slaves, p->slave_count);
  n = count(r, "drives");
  p->drives = calloc(n + 1, sizeof *p->drives);
  for (i = 0; p->drives != NULL && i < n && !r->wrong; i++)
    read_drive(r, &p->drives[p->drive_count++], p->slave_count);
  n = count(r, "variables");
  p->variables = calloc(n + 1, sizeof *p->variables);
  for (i = 0; p->variables != NULL && i < n && !r->wrong; i++)
    read_variable(r, &p->variables[p->variable_count++], p->slave_count, p->message_count, p->drive_count);
  if (p->slaves == NULL || p->messages == NULL || p->drives == NULL || p->variables == NULL) r->wrong = 1;
  if (!r->wrong) check_roles(r, p);
}

/* Adds all slaves, entries, CAN messages and CAN signals to the session. */
static void add_all(plant *p) {
  size_t i;
  for (i = 0; i < p->slave_count; i++) {
    ecat_session_slave *slave = &p->slaves[i].on_bus;
    slave->given_name = p->slaves[i].given_name;
    slave->name = p->slaves[i].label;
    slave->command = p->command;
    slave->fingerprint = p->fingerprint;
    ecat_session_add_slave(&p->session, slave);
  }
  for (i = 0; i < p->message_count; i++)
    if (ecat_session_add_message(&p->messages[i].on_bus) != 0) return;
  for (i = 0; i < p->variable_count; i++) {
    plant_variable *variable = &p->variables[i];
    if (variable->role == ROLE_CAN_INPUT || variable->role == ROLE_CAN_OUTPUT) {
      variable->signal.message = &p->messages[variable->message].on_bus;
      if (ecat_session_add_signal(&variable->signal) != 0) return;
    }
    if (variable->role != ROLE_INPUT && variable->role != ROLE_OUTPUT) continue;
    variable->on_bus.slave = &p->slaves[variable->slave].on_bus;
    ecat_session_add_entry(&variable->on_bus);
  }
}

/* --- the file ------------------------------------------------------------------------------ */

static int hex_digit(char c) {
  return c >= '0' && c <= '9' ? c - '0' : (c | 32) >= 'a' && (c | 32) <= 'f' ? (c | 32) - 'a' + 10 : -1;
}

/* Returns the path of a file in the folder of resources. FMI 2 gives this folder as a URI (RFC 3986, file
 * scheme), FMI 3 as a path. */
static char *path_of(const char *resources, const char *file) {
  const char *from = resources;
  char *path = malloc(strlen(resources) + strlen(file) + 2), *to = path;
  int uri = strncasecmp(from, "file:", 5) == 0;
  if (path == NULL) return NULL;
  if (uri) {
    from += 5;
    if (strncmp(from, "//", 2) == 0) { /* an authority follows, which is empty or this machine */
      from += 2;
      while (*from != '\0' && *from != '/') from++;
    }
  }
  while (*from != '\0') {
    int high = uri && from[0] == '%' ? hex_digit(from[1]) : -1;
    int low = high >= 0 ? hex_digit(from[2]) : -1;
    *to++ = low >= 0 ? (char)(high << 4 | low) : *from;
    from += low >= 0 ? 3 : 1;
  }
  sprintf(to, "%s%s", to > path && to[-1] == '/' ? "" : "/", file);
  return path;
}

static char *contents(plant *p, const char *path) {
  FILE *file = fopen(path, "rb");
  char *text = NULL;
  long size = -1;
  if (file != NULL && fseek(file, 0, SEEK_END) == 0) size = ftell(file);
  if (size >= 0 && size < MAX_BYTES && (text = calloc(1, (size_t)size + 1)) != NULL) {
    rewind(file);
    if (fread(text, 1, (size_t)size, file) != (size_t)size) {
      free(text);
      text = NULL;
    }
  }
  if (text == NULL)
    ecat_session_fail(&p->session, -1, "%s cannot be read (%s): the importer must unpack the FMU as a whole and say "
               "where its resources are", path, strerror(errno));
  if (file != NULL) fclose(file);
  return text;
}

int plant_load(plant *p, const char *resources) {
  reader r = {NULL, NULL, 0, 0, ""};
  char *text, *path;
  if (resources == NULL)
    return ecat_session_fail(&p->session, -1, "the importer does not say where the resources of the FMU are");
  path = path_of(resources, "plant.txt");
  if (path == NULL) return ecat_session_fail(&p->session, -1, "out of memory");
  text = contents(p, path);
  if (text != NULL) {
    r.next = text;
    read_table(&r, p);
    if (!r.wrong)
      add_all(p);
    else
      ecat_session_fail(&p->session, -1, "%s, line %d: this is not what ecatctl has written; generate the FMU again",
                 path, r.number);
  }
  r.wrong |= text == NULL;
  free(text);
  free(path);
  return r.wrong ? -1 : 0;
}

void plant_unload(plant *p) {
  size_t i;
  for (i = 0; i < p->slave_count; i++) free(p->slaves[i].given_name), free(p->slaves[i].label);
  for (i = 0; i < p->variable_count; i++) {
    free(p->variables[i].name);
    free(p->variables[i].unit);
  }
  free(p->slaves);
  free(p->messages);
  free(p->drives);
  free(p->variables);
  free(p->token);
  free(p->command);
  free(p->bus_start);
}
