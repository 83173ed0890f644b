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

/* When a CAN message is sent; the numbers are those of EtherCAT.Types.CANTransmission. */
enum ecat_session_transmission {
  ECAT_SESSION_ON_CHANGE = 1,    /* when its data differ from those that were sent; with a period, also then */
  ECAT_SESSION_PERIODIC = 2,
  ECAT_SESSION_EACH_SAMPLE = 3,
  ECAT_SESSION_ON_TRIGGER = 4    /* see ecat_session_can_trigger() */
};

/* State of the CAN controller of a terminal; the numbers are those of EtherCAT.Types.CANState, and 1 greater than
 * those of ecat_can_state. */
enum ecat_session_can_state {
  ECAT_SESSION_CAN_STOPPED = 1,
  ECAT_SESSION_CAN_ACTIVE = 2,
  ECAT_SESSION_CAN_WARNING = 3,
  ECAT_SESSION_CAN_PASSIVE = 4,
  ECAT_SESSION_CAN_BUS_OFF = 5
};

/* What the bits of a CAN signal are; the numbers are those of EtherCAT.Types.CANNumber. */
enum ecat_session_number { ECAT_SESSION_UNSIGNED = 1, ECAT_SESSION_SIGNED = 2, ECAT_SESSION_FLOAT = 3 };

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
  uint32_t vendor, product, revision; /* expected; vendor 0: any slave; revision 0: any */
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
  int has_can, can;              /* the program uses its CAN channel, which is number `can` of the bus */
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

/* A CAN message: all frames with one identifier. Several messages that are sent and have the same slave and identifier
 * are one, the frame of which has the signals of all. */
typedef struct ecat_session_message {
  ecat_session_slave *slave;     /* the terminal */
  uint32_t id;                   /* as in ecat_can_frame */
  int sends;                     /* 1: the program sends it, 0: it receives it */
  int length;                    /* bytes of data; of a received message: the fewest that make it valid */
  double timeout;                /* received: seconds after which it is no longer valid, 0: never */
  int transmission;              /* sent: enum ecat_session_transmission */
  double period;                 /* sent: seconds */
  int reserve;                   /* sent: no other client may send it */
  /* Received: of the last sample. */
  int valid;                     /* there was a frame within `timeout`, and the terminal takes part in both buses */
  double age;                    /* seconds since the last frame, or ECAT_AGE_NEVER */
  uint8_t data[8];               /* of the last frame; of a message that is sent: of the next one */
  int data_length;
  uint32_t count;                /* frames that were received, or handed over to be sent */
  uint32_t missed;               /* frames that were too short, or could not be sent */

  struct ecat_session_message *next; /* this member and the following ones are for the session only */
  struct ecat_session_message *frame; /* the first message of this frame, or itself */
  struct ecat_session_signal *signals; /* of all messages of the frame, if it is the first one */
  int fresh;                     /* there was a frame since the terminal took part in both buses */
  int told;                      /* a message has said that it was too short, or that the queue is full */
  uint64_t time_ns;              /* of the last frame */
  uint64_t asked, handed;        /* sample in which the program wanted to send it, and in which it was decided */
  int complete;                  /* the program wants it sent when all of its signals were written */
  uint8_t sent[8];               /* data of the last frame that was sent, with `fresh` */
  int sent_length;
  double due;                    /* seconds of bus cycles: time of the next periodic frame */
  int trigger, triggered;        /* count now, and at the last frame */
} ecat_session_message;

/* A signal: bits of a CAN message with a meaning. */
typedef struct ecat_session_signal {
  ecat_session_message *message;
  const char *name;              /* for messages of the session */
  int start;                     /* first bit, as in a DBC file: the lowest one, or with `big_endian` the highest; bit
                                    0 is the lowest of the first byte, 15 the highest of the second */
  int length;                    /* bits */
  int big_endian;                /* the first byte has the highest bits */
  int number;                    /* enum ecat_session_number */
  double scale, offset;          /* value = bits * scale + offset */
  double minimum, maximum;       /* of a value that is written */
  const char *unit;              /* with one, a scale or an offset, a written value is cut to the limits */
  /* A multiplexed signal is in a frame only if another, unsigned signal has such a value; `length` 0: it always is. */
  struct {
    int start, length, big_endian;
    double low, high;
  } selector;

  struct ecat_session_signal *next; /* of the frame; this and the following ones are for the session only */
  ecat_signal_info as_entry;     /* the same for ecat_encode_physical() and other functions that encode values */
  uint64_t mask;                 /* the bits in the frame, the first byte being the lowest */
  uint64_t raw;                  /* bits of the last frame */
  double real;                   /* value to be sent, or if `is_whole` the next member */
  int64_t whole;
  int is_whole;
  uint64_t written;              /* 1 + number of samples before it was written, 0: never */
} ecat_session_signal;

typedef struct ecat_session {
  ecat_t *bus;                   /* NULL: there is none */
  ecat_session_settings settings;
  char problem[ECAT_SESSION_TEXT]; /* the error text of the last failure */
  int outage;                    /* code of the failure that still lasts, 0: none */
  unsigned connections;          /* counts connections: handles of an earlier one are invalid */
  unsigned losses;               /* counts connections and losses of claims: drives must not go on after one */
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
  uint64_t exchanged_cycle;      /* its number */
  uint64_t samples;              /* counts samples */
  ecat_session_message *messages;
  unsigned can_claimed;          /* bit for each CAN channel on which this session sends */
  uint64_t can_claimed_ns[ECAT_MAX_CAN];
  ecat_can_info can[ECAT_MAX_CAN]; /* of the channels that the program uses, in the last sample */
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

/* --- CAN behind a terminal. A sample reads all frames up to its cycle, those that other clients have sent, too. The
 * first message that is sent claims the channel with the lease of the session. A CAN bus that does not work
 * is no failure: `valid` and the state of the channel say so, and messages are sent again when it works. --- */

/* Says that the program uses the CAN channel of a slave. Adding a message does the same. */
ECAT_API int ecat_session_add_can(ecat_session_slave *slave);
/* Adds a message, or a signal to its message. The caller has set the members that are not for the session only.
 * Refused, as an error: what no frame can hold, and signals to be sent that have the same bits. */
ECAT_API int ecat_session_add_message(ecat_session_message *message);
ECAT_API int ecat_session_add_signal(ecat_session_signal *signal);
/* The state of the channel in the last sample (enum ecat_session_can_state), with all that is known about it. */
ECAT_API int ecat_session_can_state(const ecat_session_slave *slave, ecat_can_info *info);

/* The value of a signal in the last frame; before the first one, that of bits that are 0. */
ECAT_API double ecat_session_can_read(const ecat_session_signal *signal);
/* Its bits as a whole number. */
ECAT_API int64_t ecat_session_can_read_int(const ecat_session_signal *signal);

/* Stores a value to be sent: a physical one, or the bits as a whole number if there is no unit, scale or offset. */
ECAT_API void ecat_session_can_write(ecat_session_signal *signal, double value);
ECAT_API void ecat_session_can_write_int(ecat_session_signal *signal, int64_t value);
/* Stores the data of a message without signals. */
ECAT_API void ecat_session_can_data(ecat_session_message *message, const uint8_t *data, int length);
/* Has a message with ECAT_SESSION_ON_TRIGGER sent if the count differs from that of the last frame, 0 at first. */
ECAT_API void ecat_session_can_trigger(ecat_session_message *message, int count);
/* Sends a message if it is due, at most once in a sample. With `complete` it waits for all signals of the frame to be
 * written in this sample; if they are not, it is sent before the next one. */
ECAT_API int ecat_session_can_send(ecat_session_message *message, int complete);

#ifdef __cplusplus
}
#endif

#endif
