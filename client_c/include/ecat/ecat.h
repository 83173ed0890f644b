/* ecat: the client of the ecatd daemon. Reads and writes the process image of an EtherCAT bus in
 * shared memory. docs/process-image.md explains it, ecat.hpp is the same for C++.
 *
 *     ecat_t *bus = NULL;
 *     int velocity, target;
 *     if (ecat_open(&bus, "ecat0") != 0) { puts(ecat_error(bus)); ecat_close(bus); return 1; }
 *     velocity = ecat_bind(bus, 0, 0x606C, 0, ECAT_INPUT);
 *     target = ecat_bind(bus, 0, 0x60FF, 0, ECAT_OUTPUT);
 *     ecat_claim(bus, 0, 0.1);
 *     while (ecat_wait(bus, 1, 1.0) == 0) {
 *       double v = 0;
 *       ecat_sample(bus);
 *       ecat_read(bus, velocity, &v);
 *       ecat_write(bus, target, v < 1000 ? 1000 : 0);
 *       ecat_commit(bus);
 *     }
 *     ecat_close(bus);
 *
 * Build with: eval gcc program.c "$(ecatctl client-flags)", with pkg-config or with CMake.
 *
 * Functions return 0 or a handle (>= 0), or a negative ECAT_E... code; ecat_error() then has the error
 * text. Times are in seconds as double, time stamps in nanoseconds of CLOCK_MONOTONIC. One ecat_t belongs
 * to one thread at a time; open one in each. After fork() the child may read with it and close it.
 * Outputs and requests stay with the parent: calls in the child that would change them return ECAT_EARG.
 *
 * Slaves, entries ("signals") and domains are numbered from 0 without gaps: a slave by its position on
 * the wire, an entry by its handle. A loop can therefore visit all of them.
 *
 * Sampling, reading, writing and committing do not enter the kernel and allocate nothing. The exception
 * is sched_yield(), when a sample finds that the daemon was interrupted in the middle of writing.
 *
 * When the daemon ends, sampling and waiting return ECAT_EDOWN within 100 ms, and claims and running
 * requests are lost. The ecat_t stays usable: later calls of ecat_sample(), ecat_wait() and ecat_claim()
 * look for the daemon, at most every 20 ms, and continue when it is back. Slaves and entries then have
 * their old numbers; if the bus has changed, these calls return ECAT_EBUS. Cycle numbers start again, and
 * ecat_instance() differs.
 *
 * C89-clean; usable from C++.
 */
#ifndef ECAT_H
#define ECAT_H

#include <stddef.h>
#include <stdint.h>

/* The enumerations that the daemon publishes, and ECAT_REQUEST_BYTES. */
#include "ecat_shm.h"

#if defined(__GNUC__)
#define ECAT_API __attribute__((visibility("default")))
#else
#define ECAT_API
#endif

#ifdef __cplusplus
extern "C" {
#endif

typedef struct ecat_client ecat_t;

/* enum ecat_errno, ecat_direction (ECAT_INPUT, ECAT_OUTPUT, ECAT_ANY), ecat_validity and
 * ecat_al_state, with what each value means. */
#define ECAT_ENUM(name, comment) enum name {
#define ECAT_FIRST(name, value, comment) name = value
#define ECAT_VALUE(name, value, comment) , name = value
#define ECAT_END_ENUM(name) };
#include "ecat.def"

typedef struct ecat_slave_info {
  uint32_t vendor;      /* vendor ID */
  uint32_t product;     /* product code */
  uint32_t revision;    /* revision number */
  uint32_t serial;      /* serial number */
  const char *name;     /* from SII; the pointer is valid until ecat_close */
  unsigned al_state;    /* AL status register: enum ecat_al_state, + 0x10 with an error */
  unsigned al_code;     /* AL status code */
  int domain;           /* 0 first */
  int optional;         /* 1: it may come and go while the bus runs */
  int absent;           /* 1: it is optional, and it or its group did not take part in the last sample */
  int has_outputs;      /* 1: the slave has outputs to claim */
  int outputs;          /* enum ecat_outputs */
  int owned;            /* 1: this client owns outputs of the slave */
} ecat_slave_info;

typedef struct ecat_signal_info {
  int slave;            /* position */
  unsigned index;       /* object index */
  unsigned subindex;    /* object subindex */
  int output;           /* 1: output, 0: input */
  unsigned type;        /* CoE data type */
  unsigned bit_length;
  int domain;           /* 0 first */
  unsigned bit_offset;  /* first bit in the image of the domain */
  double scale;         /* physical value = raw value * scale + offset */
  double offset;
  double minimum;       /* smallest raw value of an output, -HUGE_VAL: as the type allows */
  double maximum;       /* largest one, HUGE_VAL: as the type allows */
  unsigned pdo;         /* object index of its PDO */
  const char *pdo_name; /* may be empty; this one and those below are valid until ecat_close */
  const char *name;
  const char *unit;     /* of the physical value */
} ecat_signal_info;

typedef struct ecat_output_info {
  int owner;            /* client slot, -1: none */
  int owned;            /* 1: this client is the owner */
  int state;            /* enum ecat_outputs */
  int reason;           /* enum ecat_reason: why it is, or last was, at its safe value */
  uint64_t since_cycle; /* of the last change of owner or state */
  double age;           /* seconds since then */
  unsigned pid;         /* process ID that the owner wrote; 0 if this user may not know it, or if it is one of
                           another PID namespace (a container) */
  char program[33];     /* program name that the owner wrote, in ASCII */
} ecat_output_info;

#define ECAT_AGE_NEVER 1e9 /* seconds: an age before there was an exchange, which is never fresh */

typedef struct ecat_domain_info {
  const char *name;      /* valid until ecat_close */
  unsigned divider;      /* exchanged every so many base cycles */
  uint64_t cycle;        /* cycle of the last sample */
  uint64_t time_ns;      /* CLOCK_MONOTONIC when its frames came back, 0: never */
  double age;            /* seconds since then, or ECAT_AGE_NEVER */
  unsigned wkc;          /* working counter */
  unsigned wkc_expected;
  int wkc_state;         /* enum ecat_wkc_state */
} ecat_domain_info;

/* The values of an entry during some cycles. */
typedef struct {
  double minimum;
  double maximum;
  double mean;
  double last;
  uint64_t count; /* samples in which the value could be trusted */
} ecat_summary;

/* A frame of a CAN channel, or another of its records. */
typedef struct ecat_can_frame {
  uint32_t id;          /* identifier with ECAT_CAN_EXTENDED (29 bits), ECAT_CAN_REMOTE */
  uint8_t length;       /* bytes of data, 0 to 8; of a remote frame those that are asked for */
  uint8_t kind;         /* enum ecat_can_kind; this member and those below are set by ecat_can_read() */
  uint8_t own;          /* 1: this client has sent it */
  uint8_t safe;         /* 1: the daemon has sent it, since the client that sends else has ended */
  uint8_t data[8];
  uint64_t cycle;       /* in which the terminal delivered it, or said that it was sent */
  uint64_t time_ns;     /* CLOCK_MONOTONIC of this cycle */
  uint64_t sender;      /* see ecat_can_sender(); 0: no client has sent it */
  uint32_t number;      /* of a frame of a client: see ecat_can_send() */
} ecat_can_frame;

/* A CAN channel: a terminal with a CAN bus behind it. */
typedef struct ecat_can_info {
  int slave;            /* position of the terminal */
  unsigned bit_rate;    /* bits in a second */
  unsigned identifier_bits; /* 11, or 29: both kinds of frames */
  unsigned receive_queue, send_queue; /* frames in one batch */
  int state;            /* enum ecat_can_state */
  unsigned send_errors, receive_errors; /* counters of the CAN controller */
  unsigned reserved;    /* ranges of identifiers that clients have reserved */
  unsigned safe_active; /* safe frames that are being sent */
  /* Since the start of the daemon, see ecat_shm_can: */
  uint64_t received, sent, safe, unsent, dropped, refused, overflows, bus_offs, restarts;
  /* Of this client: */
  uint64_t missed;      /* records that it has read too late */
  unsigned waiting;     /* frames in its queue */
  unsigned own_sent, own_refused, own_unsent; /* frames since it has claimed the channel */
} ecat_can_info;

/* --- Connecting ------------------------------------------------------------------------------- */

/* Connects to the bus `name` (NULL: "ecat0"). After a failure *bus is still set, for ecat_error(), and
 * must be closed. It is NULL only if memory is exhausted. */
ECAT_API int ecat_open(ecat_t **bus, const char *name);
/* Releases all claims and closes the connection. NULL is allowed. A client that still sends on a
 * CAN channel counts as lost. */
ECAT_API void ecat_close(ecat_t *bus);

/* The text that explains the last failed call of this handle; never NULL. */
ECAT_API const char *ecat_error(const ecat_t *bus);
/* The general meaning of a code; never NULL. */
ECAT_API const char *ecat_strerror(int code);

/* --- Contents of the bus ---------------------------------------------------------------------- */

ECAT_API int ecat_slave_count(const ecat_t *bus);
ECAT_API int ecat_signal_count(const ecat_t *bus);
ECAT_API int ecat_domain_count(const ecat_t *bus);
ECAT_API const char *ecat_name(const ecat_t *bus);
/* A number for identity and mapping of all slaves; it differs on another bus. */
ECAT_API uint64_t ecat_fingerprint(const ecat_t *bus);
/* A number for one start of the daemon: it differs after every start. */
ECAT_API uint64_t ecat_instance(const ecat_t *bus);
/* Base cycle in seconds. */
ECAT_API double ecat_cycle_time(const ecat_t *bus);
/* One slave: its identity, and its state now. */
ECAT_API int ecat_slave(ecat_t *bus, int position, ecat_slave_info *info);
/* One entry: where it is, and what its value means. */
ECAT_API int ecat_signal(ecat_t *bus, int signal, ecat_signal_info *info);

/* The position of the `nth` slave (0 first) with this identity, or ECAT_EBUS. */
ECAT_API int ecat_find(ecat_t *bus, uint32_t vendor, uint32_t product, unsigned nth);
/* The position of the only slave with this name. A position written as text is accepted, too. */
ECAT_API int ecat_find_name(ecat_t *bus, const char *name);
/* Checks that the slave at `position` is the expected one. `revision` 0 accepts any. Returns the
 * position or ECAT_EBUS; the error text names the expected and the found slave. */
ECAT_API int ecat_expect(ecat_t *bus, int position, uint32_t vendor, uint32_t product,
                         uint32_t revision);
/* The handle of a PDO entry; `direction`: enum ecat_direction. */
ECAT_API int ecat_bind(ecat_t *bus, int position, unsigned index, unsigned subindex,
                       int direction);
/* The handle of an entry by name: "slave/entry". The slave is given by its position, or by its name if
 * only one slave has it. The entry is given by its name, by "PDO/entry" if several have that name, or by
 * its address, as 0x6041:00. */
ECAT_API int ecat_lookup(ecat_t *bus, const char *name, int direction);

/* --- Owning outputs --------------------------------------------------------------------------- */

/* Makes this client the owner of all outputs of a slave, or of none if another client owns one of them.
 * `lease` is the time in seconds without ecat_sample() or ecat_commit() after which they go to their safe
 * values. 0 takes the daemon's default, which is also the shortest lease; a lease above the daemon's
 * maximum is cut to it. The longest lease of all claims applies to all outputs, until its claim is
 * released. An output keeps its safe value until the first ecat_commit() after it was written. After
 * ECAT_ELEASE all claims and running requests are lost; claim again. Claiming an output again does
 * nothing, unless the lease is longer. */
ECAT_API int ecat_claim(ecat_t *bus, int position, double lease);
/* Releases the outputs of a slave; they go to their safe values. */
ECAT_API int ecat_release(ecat_t *bus, int position);
/* Claim and release for one output. */
ECAT_API int ecat_claim_entry(ecat_t *bus, int signal, double lease);
ECAT_API int ecat_release_entry(ecat_t *bus, int signal);
/* Claim and release for `count` outputs, which may be of several slaves. All of them are granted at once,
 * or none. If a claim fails, this client keeps the outputs that it owned before, and its lease. An
 * output may be in the list twice; an empty list does nothing. */
ECAT_API int ecat_claim_entries(ecat_t *bus, const int *signals, size_t count, double lease);
ECAT_API int ecat_release_entries(ecat_t *bus, const int *signals, size_t count);
/* Releases all outputs, drops all requests, and frees the client's slot. Reading is still possible. */
ECAT_API void ecat_release_all(ecat_t *bus);
/* The owner and the state of an output now, and since when. */
ECAT_API int ecat_output(ecat_t *bus, int signal, ecat_output_info *info);

/* --- Reading ---------------------------------------------------------------------------------- */

/* Takes one consistent image of every domain; all reads until the next call see it. Returns ECAT_ESTALE
 * or ECAT_EDOWN if the daemon no longer delivers; the values stay readable. If the daemon was killed
 * while it wrote the image, the call returns ECAT_ESTALE, and the values may be of two cycles. */
ECAT_API int ecat_sample(ecat_t *bus);
/* The same for one domain. */
ECAT_API int ecat_sample_domain(ecat_t *bus, int domain);
/* Age, cycle and working counter of the last sample of a domain. */
ECAT_API int ecat_domain(ecat_t *bus, int domain, ecat_domain_info *info);

/* The last sample of a domain as bytes: outputs first, then inputs. The next sample overwrites them. 8
 * more bytes after the `*size` bytes may be read, so that any entry can be loaded as a word. The address
 * is valid until ecat_close(); ask again when ecat_instance() differs. NULL if there is no such
 * domain. */
ECAT_API const void *ecat_image(ecat_t *bus, int domain, size_t *size);

/* enum ecat_validity of an entry of the last sample, or a negative code. */
ECAT_API int ecat_validity(ecat_t *bus, int signal);

/* Raw value of an entry of the last sample: exact for up to 53 bits. */
ECAT_API int ecat_read(ecat_t *bus, int signal, double *value);
/* Raw value as integer. Unsigned 64-bit values keep their bits. Floating-point numbers are rounded by
 * ecat_round(); ECAT_ERANGE if the result is no 64-bit integer. */
ECAT_API int ecat_read_int(ecat_t *bus, int signal, int64_t *value);
/* Raw value * scale + offset. */
ECAT_API int ecat_read_physical(ecat_t *bus, int signal, double *value);

/* Waits for `cycles` cycles, at least one, and takes a sample in each, as ecat_sample() does. Summarizes
 * the physical values of `count` entries: minimum, maximum, mean and last value. `timeout` is the time in
 * seconds for which a cycle may be late. A cycle is missed if this thread gets no processor.
 * `summaries[i].count` is the number of samples in which the value could be trusted. If there are none,
 * minimum is HUGE_VAL and maximum -HUGE_VAL. */
ECAT_API int ecat_summarize(ecat_t *bus, const int *signals, size_t count, unsigned cycles,
                            double timeout, ecat_summary *summaries);

/* --- Writing ---------------------------------------------------------------------------------- */

/* No value leaves the process before ecat_commit(). A value is rounded to the nearest one that the entry
 * can have, halfway cases to the even one; the rounding mode of the thread has no effect. Infinity and
 * NaN are refused with ECAT_ERANGE, and so is a number that the entry cannot hold or that is beyond its
 * declared range. A refused value is not staged. ECAT_ELEASE: the claim has ended with the daemon; claim
 * again. */

/* Stages a raw value of an output. */
ECAT_API int ecat_write(ecat_t *bus, int signal, double value);
/* The same for an integer; unsigned 64-bit values keep their bits. */
ECAT_API int ecat_write_int(ecat_t *bus, int signal, int64_t value);
/* Stages the raw value (value - offset) / scale. An analog quantity, whose entry has a unit, a scale or
 * an offset, is cut to the limits of the entry instead of being refused. */
ECAT_API int ecat_write_physical(ecat_t *bus, int signal, double value);
/* The same with scale and offset of the program, always as an analog quantity. */
ECAT_API int ecat_write_scaled(ecat_t *bus, int signal, double value, double scale, double offset);
/* Publishes all staged outputs at once; they go out with the next cycle. ECAT_ELEASE: the outputs are no
 * longer owned, because the lease is over or the daemon has ended. Every commit returns it until an
 * output is claimed again. */
ECAT_API int ecat_commit(ecat_t *bus);

/* The bits that the calls above would make of a value, without a bus. Type, length and range are those of
 * `entry`; ecat_encode_physical() also uses its unit, scale and offset. Returns 0 or ECAT_ERANGE. */
ECAT_API int ecat_encode(const ecat_signal_info *entry, double value, uint64_t *bits);
ECAT_API int ecat_encode_int(const ecat_signal_info *entry, int64_t value, uint64_t *bits);
ECAT_API int ecat_encode_physical(const ecat_signal_info *entry, double value, uint64_t *bits);
/* The smallest and the largest raw value of an entry, by its type and its range. Those of 64 bits are
 * rounded. */
ECAT_API void ecat_limits(const ecat_signal_info *entry, double *low, double *high);
/* The physical value of a raw one, raw * scale + offset, and its inverse, which is neither rounded nor held
 * within limits. */
ECAT_API double ecat_to_physical(double raw, double scale, double offset);
ECAT_API double ecat_to_raw(double value, double scale, double offset);
/* The nearest whole number; halfway cases go to the even one. */
ECAT_API double ecat_round(double value);

/* --- Waiting ---------------------------------------------------------------------------------- */

/* Waits until `cycles` cycles have ended since the last sample or wait. 0 only checks whether the daemon
 * delivers. Returns ECAT_EDOWN at once when the daemon ends; later calls wait for its return. */
ECAT_API int ecat_wait(ecat_t *bus, unsigned cycles, double timeout);
/* Waits until a domain was exchanged `exchanges` times since its last sample or wait. */
ECAT_API int ecat_wait_domain(ecat_t *bus, int domain, unsigned exchanges, double timeout);
/* Number of the last finished cycle. */
ECAT_API uint64_t ecat_cycle(const ecat_t *bus);

/* --- CAN behind a terminal -------------------------------------------------------------------- */

/* Any number of clients read all frames of a channel, and all of those that have claimed it send: their
 * frames go into one queue in fair turns. All of this is docs/can.md. None of these calls but ecat_can_wait(),
 * ecat_can_flush() and the claims wait, or enter the kernel. */

/* Channels are numbered from 0 without gaps, in the order of their terminals. */
ECAT_API int ecat_can_count(const ecat_t *bus);
/* The channel of the terminal at a position, or ECAT_EBUS. */
ECAT_API int ecat_can_find(ecat_t *bus, int position);
ECAT_API int ecat_can(ecat_t *bus, int channel, ecat_can_info *info);

/* Begins to read: the first record is the next one. ecat_can_read() does the same if there was no call. */
ECAT_API int ecat_can_listen(ecat_t *bus, int channel);
/* Reads the records since the last call, at most `room`, and returns how many; 0: nothing new. If this
 * client is so late that records are gone, it goes on with the oldest that are there, and `missed` of
 * ecat_can_info counts the others. After a restart of the daemon it goes on with the first record of the new
 * one. With `until_cycle` not 0 it leaves records of later cycles for the next call, so that a program sees
 * frames of the cycle of its sample. */
ECAT_API int ecat_can_read(ecat_t *bus, int channel, ecat_can_frame *frames, size_t room,
                           uint64_t until_cycle);
/* What `sender` of ecat_can_frame says of frames of this client; 0: it sends none. */
ECAT_API uint64_t ecat_can_sender(const ecat_t *bus);
/* Waits until there is something to read, or returns ECAT_ETIMEOUT. */
ECAT_API int ecat_can_wait(ecat_t *bus, int channel, double timeout);

/* Makes this client a sender of a channel. With `count` ranges (at most ECAT_CAN_RANGES) nobody else can send
 * these identifiers; ECAT_EOWNED if another client has reserved one of them. A range of all identifiers of one
 * length is the whole channel. `lease` is the time in seconds without a sample, a commit, ecat_can_send() or
 * ecat_can_read() after which the client counts as lost: its frames that wait are dropped, and the safe frames
 * of the channel are sent ([[slave.can.safe]] in the configuration). With `lease` 0 a thread of the library gives
 * the signs of life, so that only the end or a stop of the process counts; this connection can own no outputs
 * then. Claiming again replaces ranges and lease. */
ECAT_API int ecat_can_claim(ecat_t *bus, int channel, double lease, const ecat_can_range *ranges, size_t count);
/* Ends it in order: what waits is not sent, so call ecat_can_flush() before. A client that ends without this call
 * counts as lost. */
ECAT_API int ecat_can_release(ecat_t *bus, int channel);
/* Puts frames into the queue of this client, and returns how many. ECAT_EFULL: there is no room, because the CAN
 * bus is slower than the program, or does not work; the error text says which. ECAT_EOWNED: another client has
 * reserved the identifier of the first frame. ECAT_ERANGE: it is no frame that this channel can send. If such a
 * frame is behind the first one, the call returns how many are in front of it. `number` (may be NULL) becomes the
 * number of the last frame: the record that says that it was sent has the same. */
ECAT_API int ecat_can_send(ecat_t *bus, int channel, const ecat_can_frame *frames, size_t count,
                           uint32_t *number);
/* Waits until all frames of this client were sent, refused or lost, also while the cycle stands still. */
ECAT_API int ecat_can_flush(ecat_t *bus, int channel, double timeout);

/* --- Requests: only ecat_wait_request() waits -------------------------------------------------- */

/* Starts an SDO upload (data NULL) or download of up to ECAT_REQUEST_BYTES, and returns the handle of
 * the request. ECAT_REQUESTS may run at the same time. */
ECAT_API int ecat_sdo_start(ecat_t *bus, int position, unsigned index, unsigned subindex,
                            const void *data, size_t length);
/* Requests an AL state of a slave (enum ecat_al_state), and returns the handle of the request. */
ECAT_API int ecat_state_start(ecat_t *bus, int position, unsigned state);
/* ECAT_EBUSY while the request runs. Any other result ends it and frees its handle; then `data` (up to
 * `size` bytes) and `*length` hold the uploaded bytes. With ECAT_EABORT, `*abort_code` is the SDO abort
 * code. All three pointers may be NULL. If a client ends, its requests that have not begun are
 * dropped. If the daemon ends, requests return ECAT_EDOWN. */
ECAT_API int ecat_poll(ecat_t *bus, int request, void *data, size_t size, size_t *length,
                       uint32_t *abort_code);
/* Waits until ecat_poll() has an answer, or returns ECAT_ETIMEOUT. It takes no samples, so the lease of a
 * claim may end meanwhile. */
ECAT_API int ecat_wait_request(ecat_t *bus, int request, double timeout);
/* Gives up a request and frees its handle. The slave may have carried it out already. */
ECAT_API int ecat_cancel(ecat_t *bus, int request);

#ifdef __cplusplus
}
#endif

#endif
