/* The plant behind an FMU: its variables, and the actions of a communication step on the bus. The front
 * ends fmi2.c and fmi3.c give it the names and types of their version of FMI.
 *
 *     doStep:  commit all inputs of the FMU -> wait for the bus -> take one image of all outputs
 *
 * With bus terminals, ls_bus.h goes on from there.
 *
 * The file resources/plant.txt lists the variables (table.c), so that one binary serves every bus.
 * Instances share nothing. No function here ends the process or changes the locale.
 */
#ifndef PLANT_H
#define PLANT_H

#include <stddef.h>
#include <stdint.h>

#include <ecat/ecat_drive.h>
#include <ecat/ecat_session.h>

/* fmi2Status and fmi3Status have the same numbers. */
enum plant_status { PLANT_OK, PLANT_WARNING, PLANT_DISCARD, PLANT_ERROR, PLANT_FATAL };

enum plant_state {
  PLANT_INSTANTIATED,
  PLANT_INITIALIZATION,
  PLANT_STEPS,
  PLANT_EVENTS, /* the event mode, of an FMU with bus terminals */
  PLANT_TERMINATED,
  PLANT_FAILED /* only reading values, reset and freeing are possible */
};

/* Types of variables. An FMU uses only the types of its version. Enumerations are INTEGER in FMI 2 and
 * INT64 in FMI 3. */
enum plant_type {
  PLANT_REAL,
  PLANT_BOOLEAN,
  PLANT_STRING,
  PLANT_INTEGER,
  PLANT_INT8,
  PLANT_UINT8,
  PLANT_INT16,
  PLANT_UINT16,
  PLANT_INT32,
  PLANT_UINT32,
  PLANT_INT64,
  PLANT_UINT64,
  PLANT_BINARY,
  PLANT_CLOCK,
  PLANT_TYPES
};

/* The purpose of a variable. The roles from BUS to READ_ONLY are parameters. */
enum plant_role {
  ROLE_TIME,
  ROLE_BUS,
  ROLE_WAIT_FOR_BUS,
  ROLE_LEASE,
  ROLE_WHEN_MISSING,
  ROLE_WHEN_FAILED,
  ROLE_PATIENCE,
  ROLE_READ_ONLY,
  ROLE_REQUIRE_OPERATIONAL,
  ROLE_CONNECTED,
  ROLE_STATE,
  ROLE_CYCLE,
  ROLE_AGE,
  ROLE_MISSED,
  ROLE_WORKING_COUNTER,
  ROLE_WORKING_COUNTER_EXPECTED,
  ROLE_VALID, /* this role and the next five belong to a slave */
  ROLE_AL_STATE,
  ROLE_AL_STATUS_CODE,
  ROLE_CAN_STATE,
  ROLE_CAN_SEND_ERRORS,
  ROLE_CAN_RECEIVE_ERRORS,
  ROLE_CAN_VALID, /* this role and the next two belong to a CAN message */
  ROLE_CAN_AGE,
  ROLE_CAN_COUNT,
  ROLE_CAN_INPUT,  /* CAN signal that the FMU sends */
  ROLE_CAN_OUTPUT, /* CAN signal that the FMU receives */
  ROLE_INPUT,  /* entry that the FMU writes to the bus */
  ROLE_OUTPUT, /* entry that the FMU reads from the bus */
  ROLE_DRIVE_ENABLE, /* this role and those to ROLE_DRIVE_ERROR_CODE belong to a drive; inputs first */
  ROLE_DRIVE_QUICK_STOP,
  ROLE_DRIVE_FAULT_RESET,
  ROLE_DRIVE_HOME,
  ROLE_DRIVE_MODE,
  ROLE_DRIVE_POSITION_REFERENCE,
  ROLE_DRIVE_SPEED_REFERENCE,
  ROLE_DRIVE_TORQUE_REFERENCE,
  ROLE_DRIVE_POSITION,
  ROLE_DRIVE_SPEED,
  ROLE_DRIVE_TORQUE,
  ROLE_DRIVE_ENABLED,
  ROLE_DRIVE_HOMED,
  ROLE_DRIVE_REACHED,
  ROLE_DRIVE_STATE,
  ROLE_DRIVE_ERROR_CODE,
  ROLE_INTERVAL, /* a parameter; this role and those below are of an FMU with bus terminals (ls_bus.h) */
  ROLE_FRAMES_SENT,
  ROLE_FRAMES_RECEIVED,
  ROLE_OPERATIONS_REFUSED,
  ROLE_OPERATIONS_LOST,
  ROLE_BUS_NOTIFICATIONS, /* this role and those below belong to an ECU */
  ROLE_RX_CLOCK,
  ROLE_RX_DATA,
  ROLE_TX_CLOCK,
  ROLE_TX_DATA,
  ROLES
};

/* A value: `real` for the type REAL, `integer` for all other types except STRING. */
typedef struct plant_value {
  double real;
  int64_t integer; /* UINT64: its bits */
} plant_value;

/* A slave that the bus must have. */
typedef struct plant_slave {
  ecat_session_slave on_bus;
  char *given_name, *label;
} plant_slave;

/* A message of the CAN bus behind a slave. */
typedef struct plant_message {
  ecat_session_message on_bus;
  int active; /* the importer has set one of its signals, so that it is sent */
} plant_message;

typedef struct plant_variable {
  enum plant_type type;
  enum plant_role role;
  char *name;
  int slave; /* index in `slaves` */
  int ecu;   /* of a bus terminal */
  int message; /* index in `messages` */
  int drive;   /* 1 + index in `drives` of its drive, or of the drive that writes this raw input; 0: there is none */
  ecat_session_entry on_bus; /* of an entry; its range is as it was when the FMU was made */
  ecat_session_signal signal; /* of a CAN signal */
  char *unit;
  plant_value start, value;
} plant_variable;

enum { PLANT_DRIVE_WRITTEN = 9, PLANT_DRIVE_READ = 7 };

/* A drive of a slave, in SI units (drives.c). */
typedef struct plant_drive {
  int slave, axis; /* 1 first */
  int linear;      /* in m, not in rad */
  double scales[4]; /* of position, velocity, torque and current, as in ecat_drive_settings */
  plant_variable *written[PLANT_DRIVE_WRITTEN], *read[PLANT_DRIVE_READ]; /* its raw variables; NULL: it has none */
  ecat_drive drive;
  int active; /* the importer has enabled it once */
  int told;   /* a message has said that it writes a raw input that the importer has set */
} plant_drive;

typedef void plant_log(void *context, enum plant_status status, const char *category,
                       const char *message);

typedef struct plant {
  plant_log *log;
  void *log_context;
  int log_events;
  enum plant_state state;

  double time; /* simulation time at the end of the last step */

  /* From the table. */
  char *token, *command;
  char fingerprint[20];
  plant_slave *slaves;
  size_t slave_count;
  plant_message *messages;
  size_t message_count;
  plant_drive *drives;
  size_t drive_count;
  plant_variable *variables; /* by value reference */
  size_t variable_count;

  /* The parameter `bus`; the other parameters are values of variables. */
  char *bus_name, *bus_start;

  size_t ecu_count;
  int triggered; /* their Tx_Clocks are outputs, and not countdowns of the importer */
  struct ls_bus *ls_bus; /* NULL: no bus terminals */

  ecat_session session;
  int begun;   /* 1: initialization has connected to the bus, or decided to go on without it */
  double owed; /* bus cycles of steps shorter than a cycle */
} plant;

/* table.c: plant_load() returns a negative value on failure, with the error text in `session.problem`. */
int plant_load(plant *p, const char *resources);
void plant_unload(plant *p);

/* drives.c: in each step, drives_command() before the inputs are handed over, and drives_measure() after the sample.
 * drives_found() returns a negative value if an object of a drive is not among the variables. */
int drives_found(plant *p);
void drives_begin(plant *p);
int drives_can(const plant_drive *drive, int64_t mode);
void drives_command(plant *p);
void drives_measure(plant *p, double time);

/* variables.c: access by value reference. */
double plant_real(const plant *p, enum plant_role role);
int64_t plant_integer(const plant *p, enum plant_role role);
void plant_publish(plant *p, enum plant_role role, double real, int64_t integer);
int plant_get(plant *p, unsigned reference, enum plant_type type, plant_value *value);
int plant_set(plant *p, unsigned reference, enum plant_type type, plant_value value);
int plant_get_string(plant *p, unsigned reference, const char **value);
int plant_set_string(plant *p, unsigned reference, const char *value);
void plant_start_values(plant *p);

/* plant.c: the life of an instance. */
plant *plant_new(const char *token, const char *resources, plant_log *log, void *context,
                 int events);
void plant_free(plant *p);
int plant_allow(plant *p, const char *call, unsigned states); /* bits 1 << enum plant_state */
int plant_begin(plant *p); /* connects to the bus and takes a first sample */
int plant_leave_initialization(plant *p);
int plant_step(plant *p, double time, double step);
int plant_update(plant *p); /* ends an event, with bus terminals */
void plant_detach(plant *p); /* ends the connection: the outputs go to their safe values */
int plant_terminate(plant *p);
/* Switches the logging of events on or off; a list without categories means all of them. Errors and
 * warnings are always logged. */
int plant_log_categories(plant *p, int on, size_t count, const char *const categories[]);
int plant_reset(plant *p);

/* Logs one sentence and returns `status`. */
__attribute__((format(printf, 3, 4))) int plant_say(plant *p, enum plant_status status,
                                                    const char *format, ...);
/* Logs an event, if the importer has asked for events. */
__attribute__((format(printf, 2, 3))) void plant_event(plant *p, const char *format, ...);

#endif
