/* A session: the connection of a generated model to a bus. Modelica blocks and FMUs use it; programs use
 * ecat.h.
 *
 *     pace -> sample -> reads -> the model -> writes -> commit
 *
 * A model may run without a bus: slaves and entries hold their expected properties. Whenever a bus is
 * connected, all of them are looked up in it, and identities, layout and meanings are compared.
 * `settings` says what happens while there is no bus.
 *
 * Functions return 0, or a negative code if the program must end; `problem` is the error text then.
 * Slaves and entries are memory of the caller and must live as long as the session, which allocates none
 * for them.
 *
 * C89-clean.
 */
#ifndef ECAT_SESSION_H
#define ECAT_SESSION_H

#include "ecat.h"

#ifdef __cplusplus
extern "C" {
#endif

#define ECAT_SESSION_TEXT 1024 /* longest message, with its NUL */

/* The reaction to a missing bus; the numbers are those of EtherCAT.Types.BusFailure. */
enum ecat_failure { ECAT_FAILURE_ERROR = 1, ECAT_FAILURE_WAIT = 2, ECAT_FAILURE_CONTINUE = 3 };

/* State of the bus; the numbers are those of EtherCAT.Types.BusState. */
enum ecat_session_state {
  ECAT_SESSION_MISSING = 1,
  ECAT_SESSION_STANDS_STILL = 2,
  ECAT_SESSION_INCOMPLETE = 3,
  ECAT_SESSION_NOT_OPERATIONAL = 4,
  ECAT_SESSION_OPERATIONAL = 5
};

/* State of a slave; the numbers are those of EtherCAT.Types.ALState. */
enum ecat_session_al_state {
  ECAT_SESSION_NOT_AVAILABLE = 1,
  ECAT_SESSION_INIT = 2,
  ECAT_SESSION_PREOP = 3,
  ECAT_SESSION_BOOTSTRAP = 4,
  ECAT_SESSION_SAFEOP = 5,
  ECAT_SESSION_OP = 6
};

/* Texts are not copied: they must live as long as the session. */
typedef struct ecat_session_settings {
  const char *bus;               /* name */
  double lease;                  /* see ecat_claim() */
  int when_missing, when_failed; /* enum ecat_failure: before the first connection, and after it */
  double patience;               /* seconds to wait for the bus, 0: for ever */
  int read_only;                 /* nothing is claimed or written, whatever the program stages */
  int require_op;                /* a slave of the session that is not in OP is a failure */
  /* Words for messages: */
  const char *product;           /* the generated product, such as "this library" */
  const char *program;           /* the program that runs, such as "the model" */
  const char *patience_name;     /* the setting that `patience` comes from */
  /* Reports an event that does not end the program; `warning` 0: the bus or a slave is there (again). */
  void (*tell)(void *context, int warning, const char *sentence);
  /* Further checks at each connection: returns 0, or what ecat_session_fail() returns. May be NULL. */
  int (*check)(void *context);
  void *context;                 /* passed to `tell` and `check` */
} ecat_session_settings;

typedef struct ecat_session_slave {
  int position;                  /* on the bus; for a slave with a given name, where it was last found */
  uint32_t vendor, product, revision; /* expected; revision 0: any */
  const char *given_name;        /* name in the configuration to find it by; NULL or empty: by position */
  const char *name;              /* name of the slave in messages */
  const char *command;           /* command that generates the product again */
  const char *heading;           /* beginning of messages about the slave: "Plant.analog: "; may be NULL */
  const char *fingerprint;       /* of the bus that the product was generated for; empty: written by hand */
  int writes;                    /* the program owns its outputs */
  /* Of the last sample: */
  int valid;                     /* all slaves of its domain took part in the exchange, and it was in OP */
  int al_state;                  /* enum ecat_session_al_state */
  int al_code;                   /* AL status code */

  struct ecat_session *session;  /* this member and the following ones are for the session only */
  struct ecat_session_slave *next;
  struct ecat_session_entry *entries;
  int same_bus, claimed, domain;
  int told;                      /* a message has said that the slave is not in OP */
  int missed;                    /* the slave is not in OP, and is not an optional slave that is absent */
} ecat_session_slave;

typedef struct ecat_session_entry {
  ecat_session_slave *slave;
  /* As expected: slave, index, subindex, output, type, bit_length, unit, scale and offset. */
  ecat_signal_info expected;

  struct ecat_session_entry *next; /* of the slave; this and the following ones are for the session only */
  int signal;                    /* handle of the client */
  int pending, is_whole;         /* there is a value to write, in `whole` or else in `real` */
  double real, raw;              /* `raw`: of the last sample */
  int64_t whole;
} ecat_session_entry;

typedef struct ecat_session {
  ecat_t *bus;                   /* NULL: there is none */
  ecat_session_settings settings;
  char problem[ECAT_SESSION_TEXT]; /* the error text of the last failure */
  int outage;                    /* code of the failure that still lasts, 0: none */
  unsigned connections;          /* counts connections: handles of an earlier one are invalid */
  uint64_t missed;               /* bus cycles that the program has missed between two waits */
  int in_step;                   /* there was a wait, and the next wait counts its cycles from there */
  /* Of the last sample: */
  int state;                     /* enum ecat_session_state */
  int cycle;                     /* modulo 2^31 */
  double age;                    /* seconds since its frames came back, or ECAT_AGE_NEVER */
  int wkc, wkc_expected;         /* sums of all domains of the bus */

  ecat_session_slave *slaves;    /* this member and the following ones are for the session only */
  int attached;                  /* the expected bus was connected once */
  uint64_t instance;             /* of the daemon in which slaves and entries were found */
  uint64_t tried_ns, outage_ns;  /* time of the last attempt to connect; start of the outage */
  uint64_t lost_ns;              /* when claimed outputs were lost and claimed again */
  uint64_t waited_cycle;         /* at the last wait */
  double origin;                 /* seconds of CLOCK_MONOTONIC at time 0, since the last wait */
  int paced;                     /* there was a wait */
  uint64_t exchanged_ns;         /* when the frames of the last sample came back */
} ecat_session;

/* Sets `problem` and returns `code`. */
#if defined(__GNUC__)
__attribute__((format(printf, 3, 4)))
#endif
ECAT_API int ecat_session_fail(ecat_session *session, int code, const char *format, ...);
/* The same with the error text of the client, if `code` is one of its errors. */
ECAT_API int ecat_session_client(ecat_session *session, int code);

/* A session without a bus. */
ECAT_API void ecat_session_init(ecat_session *session, const ecat_session_settings *settings);
/* Adds a slave, or an entry to its slave. The caller has set the members that are not for the session
 * only. If a bus is connected, the slave or entry is looked up and checked at once. */
ECAT_API int ecat_session_add_slave(ecat_session *session, ecat_session_slave *slave);
ECAT_API int ecat_session_add_entry(ecat_session_entry *entry);
/* Connects for the first time. Without a bus it fails, waits or goes on, as `when_missing` says. */
ECAT_API int ecat_session_begin(ecat_session *session);
/* Ends the connection: outputs go to their safe values. The session may begin again. */
ECAT_API void ecat_session_end(ecat_session *session);

/* Waits until `cycles` bus cycles have ended since the last wait. Without a bus it waits until the clock
 * has reached `time`, in seconds of the program. */
ECAT_API int ecat_session_pace(ecat_session *session, unsigned cycles, double time);
/* Takes a sample. A slave that has left OP is reported; with `require_op` this is a failure. */
ECAT_API int ecat_session_sample(ecat_session *session);

/* The value of an entry in the last sample, raw value * scale + offset with the expected scale. Without a
 * bus it is the last value; before the first connection it is that of a raw 0. */
ECAT_API int ecat_session_read(ecat_session_entry *entry, double *value);
/* The raw value as an integer, see ecat_read_int(). Without a bus `*value` is unchanged. */
ECAT_API int ecat_session_read_int(ecat_session_entry *entry, int64_t *value);

/* Stores a value for the next stage and commit: a physical one if the entry has a unit, a scale or an
 * offset, else a raw one. */
ECAT_API void ecat_session_write(ecat_session_entry *entry, double value);
/* The same for an integer. If the entry has no unit, scale or offset, unsigned 64-bit values keep their
 * bits. */
ECAT_API void ecat_session_write_int(ecat_session_entry *entry, int64_t value);
/* Stages the stored values of a slave and claims the outputs of all slaves that are written. Sets
 * `writes`. */
ECAT_API int ecat_session_stage(ecat_session_slave *slave);
/* Commits the staged values. */
ECAT_API int ecat_session_commit(ecat_session *session);

#ifdef __cplusplus
}
#endif

#endif
