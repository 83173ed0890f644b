/* A session: what a model that was generated for a bus does with it. Modelica blocks and FMUs are made
 * of it; programs use ecat.h.
 *
 *     pace -> sample -> reads -> the model -> writes -> commit
 *
 * A model may live without a bus: slaves and entries note what they stand for. All of it is looked up
 * when there is a bus, and again when that has come back: identities, layout, and what values mean. What
 * happens while there is none says `settings`.
 *
 * Functions return 0, or a negative code if the program must end: `problem` is the sentence. Slaves and
 * entries are memory of the caller, which must live as long as the session; no other memory is used.
 *
 * C89-clean.
 */
#ifndef ECAT_SESSION_H
#define ECAT_SESSION_H

#include "ecat.h"

#ifdef __cplusplus
extern "C" {
#endif

#define ECAT_SESSION_TEXT 1024 /* longest sentence, with its end */

/* What to do without a bus; numbers of EtherCAT.Types.BusFailure. */
enum ecat_failure { ECAT_FAILURE_ERROR = 1, ECAT_FAILURE_WAIT = 2, ECAT_FAILURE_CONTINUE = 3 };

/* How the bus is; numbers of EtherCAT.Types.BusState. */
enum ecat_session_state {
  ECAT_SESSION_MISSING = 1,
  ECAT_SESSION_STANDS_STILL = 2,
  ECAT_SESSION_INCOMPLETE = 3,
  ECAT_SESSION_NOT_OPERATIONAL = 4,
  ECAT_SESSION_OPERATIONAL = 5
};

/* How a slave is; numbers of EtherCAT.Types.ALState. */
enum ecat_session_al_state {
  ECAT_SESSION_NOT_AVAILABLE = 1,
  ECAT_SESSION_INIT = 2,
  ECAT_SESSION_PREOP = 3,
  ECAT_SESSION_BOOTSTRAP = 4,
  ECAT_SESSION_SAFEOP = 5,
  ECAT_SESSION_OP = 6
};

/* Texts must live as long as the session. */
typedef struct ecat_session_settings {
  const char *bus;               /* name */
  double lease;                  /* see ecat_claim() */
  int when_missing, when_failed; /* enum ecat_failure: before the first connection, and after it */
  double patience;               /* seconds to wait for the bus, 0: for ever */
  int read_only;                 /* nothing is written or owned, whatever the program stages */
  int require_op;                /* a slave of the session that is not in OP is a failure */
  /* Words for sentences: */
  const char *product;           /* what was generated: "this library" */
  const char *program;           /* what runs: "the model" */
  const char *patience_name;     /* where `patience` comes from */
  /* Tells what does not end the program; `warning` 0: the bus is there (again). */
  void (*tell)(void *context, int warning, const char *sentence);
  /* Checks more at each connection: 0, or what ecat_session_fail() returns. May be NULL. */
  int (*check)(void *context);
  void *context;                 /* of both */
} ecat_session_settings;

typedef struct ecat_session_slave {
  int position;
  uint32_t vendor, product, revision; /* expected; revision 0: any */
  const char *name;              /* of the slave */
  const char *command;           /* that generates the product again */
  const char *heading;           /* sentences about it begin with that: "Plant.analog: "; may be NULL */
  const char *fingerprint;       /* of the bus that it was generated for; empty: written by hand */
  int writes;                    /* the program owns its outputs */
  /* Of the last sample: */
  int valid;                     /* it took part in the exchange, in OP */
  int al_state;                  /* enum ecat_session_al_state */
  int al_code;                   /* AL status code */

  struct ecat_session *session;  /* this and what follows are for the session only */
  struct ecat_session_slave *next;
  struct ecat_session_entry *entries;
  int same_bus, claimed, domain;
  int told;                      /* that it is not in OP */
} ecat_session_slave;

typedef struct ecat_session_entry {
  ecat_session_slave *slave;
  /* As expected: slave, index, subindex, output, type, bit_length, unit, scale and offset. */
  ecat_signal_info expected;

  struct ecat_session_entry *next; /* of the slave; this and what follows are for the session only */
  int signal;                    /* handle of the client */
  int pending, is_whole;         /* there is a value to write: `whole`, or else `real` */
  double real, raw;              /* `raw`: of the last sample */
  int64_t whole;
} ecat_session_entry;

typedef struct ecat_session {
  ecat_t *bus;                   /* NULL: there is none */
  ecat_session_settings settings;
  char problem[ECAT_SESSION_TEXT]; /* the sentence to the last failure */
  int outage;                    /* code of the failure that the program lives, or ends, with; 0: none */
  unsigned connections;          /* counts them: handles of an earlier one are void */
  uint64_t missed;               /* bus cycles that passed between waits without being waited for */
  int in_step;                   /* waits count from the last one */
  /* Of the last sample: */
  int state;                     /* enum ecat_session_state */
  int cycle;                     /* modulo 2^31 */
  double age;                    /* seconds since its frames came back */
  int wkc, wkc_expected;         /* sums of all domains of the bus */

  ecat_session_slave *slaves;    /* what follows is for the session only */
  int attached;                  /* there was a bus, and it was the right one */
  uint64_t instance;             /* of the daemon in which all was found */
  uint64_t tried_ns, outage_ns;  /* of the last look for a bus, of the begin of the outage */
  uint64_t lost_ns;              /* when outputs were lost that had been claimed */
  uint64_t waited_cycle;         /* at the last wait */
  double origin;                 /* seconds of CLOCK_MONOTONIC at time 0, since the last wait */
  int paced;                     /* there was one */
  uint64_t exchanged_ns;         /* when the frames of the last sample came back */
} ecat_session;

/* Puts a sentence into `problem` and returns `code`. */
#if defined(__GNUC__)
__attribute__((format(printf, 3, 4)))
#endif
ECAT_API int ecat_session_fail(ecat_session *session, int code, const char *format, ...);
/* The same with the sentence of the client, if `code` is an error of it. */
ECAT_API int ecat_session_client(ecat_session *session, int code);

/* A session without a bus. */
ECAT_API void ecat_session_init(ecat_session *session, const ecat_session_settings *settings);
/* Adds a slave, or an entry of it, after the members that are not for the session only were set. If
 * there is a bus, it is found there. */
ECAT_API int ecat_session_add_slave(ecat_session *session, ecat_session_slave *slave);
ECAT_API int ecat_session_add_entry(ecat_session_entry *entry);
/* The first connection; waits for the bus, or goes on without, as it is set. */
ECAT_API int ecat_session_begin(ecat_session *session);
/* The end of the connection: outputs fall to their safe values. It may begin again. */
ECAT_API void ecat_session_end(ecat_session *session);

/* Waits until so many bus cycles have ended since the last wait; without a bus until the clock has gone
 * on to `time`, in seconds of the program. */
ECAT_API int ecat_session_pace(ecat_session *session, unsigned cycles, double time);
/* Takes an image of the bus. A slave that has left OP is told, and is a failure with `require_op`. */
ECAT_API int ecat_session_sample(ecat_session *session);

/* The value of an entry in the last sample, by the scale that it is expected to have: a physical one, or
 * the raw one if there is none. Without a bus the last one; before, that of a raw 0. */
ECAT_API int ecat_session_read(ecat_session_entry *entry, double *value);
/* The raw value as an integer, see ecat_read_int(). */
ECAT_API int ecat_session_read_int(ecat_session_entry *entry, int64_t *value);

/* Remembers a value for the commit: a physical one if the entry has a unit, a scale or an offset, else a
 * raw one. */
ECAT_API void ecat_session_write(ecat_session_entry *entry, double value);
/* The same of an integer; of an entry without all of these unsigned 64-bit values keep their bits. */
ECAT_API void ecat_session_write_int(ecat_session_entry *entry, int64_t value);
/* Gives the values of a slave with `writes` to the client, and owns its outputs. */
ECAT_API int ecat_session_stage(ecat_session_slave *slave);
/* Hands over what is staged. */
ECAT_API int ecat_session_commit(ecat_session *session);

#ifdef __cplusplus
}
#endif

#endif
