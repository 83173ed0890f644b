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
 * Functions return 0 or a handle (>= 0), or a negative ECAT_E... code; ecat_error() then has the
 * sentence. Times are in seconds as double, time stamps in nanoseconds of CLOCK_MONOTONIC. One
 * ecat_t belongs to one thread at a time; open one in each. After fork() the child may read with it and
 * close it; what it owns stays with the parent, and calls that would change that are ECAT_EARG.
 *
 * Slaves, entries ("signals") and domains are numbered from 0 on without gaps: a slave by its position
 * on the wire, an entry by its handle. So all of them can be asked for in a loop.
 *
 * The path sample - read - write - commit does not enter the kernel (but for a sched_yield when a
 * sample finds the daemon interrupted in the middle of writing), and allocates nothing.
 *
 * When the daemon ends, sampling and waiting return ECAT_EDOWN within 100 ms, and claims and running
 * requests are gone. The handle stays: later calls of ecat_sample(), ecat_wait() and ecat_claim() look
 * for the daemon, at most every 20 ms, and go on with it when it is back. All slaves and entries have
 * their old numbers then; if the bus is another one, these calls return ECAT_EBUS. Cycle numbers begin
 * anew, and ecat_instance() differs.
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
  int has_outputs;      /* 1: the slave has outputs to claim */
  int outputs;          /* enum ecat_outputs */
  int owned;            /* 1: by this client */
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
  int owner;            /* client slot, -1: nobody */
  int owned;            /* 1: by this client */
  int state;            /* enum ecat_outputs */
  int reason;           /* enum ecat_reason: why it is, or was last, at its safe value */
  uint64_t since_cycle; /* of the last change of owner or state */
  double age;           /* seconds since then */
  unsigned pid;         /* of the owner, as it says itself; 0 if this user may not know */
  char program[33];     /* its name, as it says itself, in ASCII */
} ecat_output_info;

typedef struct ecat_domain_info {
  const char *name;      /* valid until ecat_close */
  unsigned divider;      /* exchanged every so many base cycles */
  uint64_t cycle;        /* cycle of the last sample */
  uint64_t time_ns;      /* CLOCK_MONOTONIC when its frames came back */
  double age;            /* seconds since then */
  unsigned wkc;          /* working counter */
  unsigned wkc_expected;
  int wkc_state;         /* enum ecat_wkc_state */
} ecat_domain_info;

/* --- Connecting ------------------------------------------------------------------------------- */

/* Connects to the bus `name` (NULL: "ecat0"). On failure *bus is still set, so that ecat_error()
 * can be asked, and must be closed; it is NULL only when memory is exhausted. */
ECAT_API int ecat_open(ecat_t **bus, const char *name);
/* Releases all claims and forgets the bus. NULL is allowed. */
ECAT_API void ecat_close(ecat_t *bus);

/* The sentence that explains the last failed call of this handle. Never NULL. */
ECAT_API const char *ecat_error(const ecat_t *bus);
/* The general meaning of a code. Never NULL. */
ECAT_API const char *ecat_strerror(int code);

/* --- What is on the bus ----------------------------------------------------------------------- */

ECAT_API int ecat_slave_count(const ecat_t *bus);
ECAT_API int ecat_signal_count(const ecat_t *bus);
ECAT_API int ecat_domain_count(const ecat_t *bus);
ECAT_API const char *ecat_name(const ecat_t *bus);
/* A number for identity and mapping of all slaves: it differs if the bus is another one. */
ECAT_API uint64_t ecat_fingerprint(const ecat_t *bus);
/* Differs after every start of the daemon. */
ECAT_API uint64_t ecat_instance(const ecat_t *bus);
/* Base cycle in seconds. */
ECAT_API double ecat_cycle_time(const ecat_t *bus);
/* One slave: who it is, and how it is now. */
ECAT_API int ecat_slave(ecat_t *bus, int position, ecat_slave_info *info);
/* One entry: where it is, and what its value means. */
ECAT_API int ecat_signal(ecat_t *bus, int signal, ecat_signal_info *info);

/* The position of the `nth` slave (0 first) with this identity, or ECAT_EBUS. */
ECAT_API int ecat_find(ecat_t *bus, uint32_t vendor, uint32_t product, unsigned nth);
/* The position of the only slave with this name. A position as text is taken, too. */
ECAT_API int ecat_find_name(ecat_t *bus, const char *name);
/* Checks that the slave at `position` is the expected one. `revision` 0 accepts any. Returns the
 * position or ECAT_EBUS; the error text names expected and found. */
ECAT_API int ecat_expect(ecat_t *bus, int position, uint32_t vendor, uint32_t product,
                         uint32_t revision);
/* The handle of a PDO entry; `direction`: enum ecat_direction. */
ECAT_API int ecat_bind(ecat_t *bus, int position, unsigned index, unsigned subindex,
                       int direction);
/* The handle of an entry by name: "slave/entry". The slave is its position, or its name where only
 * one has it; the entry is its name, "PDO/entry" where several have it, or 0x6041:00. */
ECAT_API int ecat_lookup(ecat_t *bus, const char *name, int direction);

/* --- Owning outputs --------------------------------------------------------------------------- */

/* Makes this client the owner of all outputs of a slave, or of none if another client has one of
 * them. `lease` is the time without ecat_sample() or ecat_commit() after which they fall to their
 * safe values; 0 takes the daemon's default, which is also the shortest lease, and a lease above the
 * daemon's maximum is cut to it. The longest lease of all claims counts for all outputs, until its
 * claim is released. An output stays safe until the first ecat_commit() after it was written. After
 * ECAT_ELEASE all claims and running requests are gone; claim again. Claiming an output again does
 * nothing, unless the lease is longer. */
ECAT_API int ecat_claim(ecat_t *bus, int position, double lease);
/* Gives the outputs of a slave back; they go to their safe values. */
ECAT_API int ecat_release(ecat_t *bus, int position);
/* The same for one output. */
ECAT_API int ecat_claim_entry(ecat_t *bus, int signal, double lease);
ECAT_API int ecat_release_entry(ecat_t *bus, int signal);
/* The same for `count` outputs, which may be of several slaves: all of them are granted at once, or
 * none. If a claim fails, this client keeps what it owned before, and its lease. An output may be in
 * the list twice; an empty list does nothing. */
ECAT_API int ecat_claim_entries(ecat_t *bus, const int *signals, size_t count, double lease);
ECAT_API int ecat_release_entries(ecat_t *bus, const int *signals, size_t count);
/* Gives all outputs back, drops all requests, and leaves the client's slot to others. Reading goes
 * on. */
ECAT_API void ecat_release_all(ecat_t *bus);
/* Who decides an output now, and since when. */
ECAT_API int ecat_output(ecat_t *bus, int signal, ecat_output_info *info);

/* --- Reading ---------------------------------------------------------------------------------- */

/* Takes one consistent image of every domain; all reads until the next call see it. Returns
 * ECAT_ESTALE or ECAT_EDOWN (the values stay readable) when the daemon no longer delivers; if it was
 * killed while it wrote and this call read, ECAT_ESTALE, and the values may then be of two cycles. */
ECAT_API int ecat_sample(ecat_t *bus);
/* The same for one domain. */
ECAT_API int ecat_sample_domain(ecat_t *bus, int domain);
/* What is known about the last sample of a domain. */
ECAT_API int ecat_domain(ecat_t *bus, int domain, ecat_domain_info *info);

/* The last sample of a domain as bytes: outputs first, then inputs. The next sample changes what is
 * there. Behind the `*size` bytes are 8 more that may be read, so that any entry can be loaded as a
 * word. The address is valid until ecat_close(); when ecat_instance() differs, ask again. NULL if there
 * is no such domain. */
ECAT_API const void *ecat_image(ecat_t *bus, int domain, size_t *size);

/* enum ecat_validity of an entry of the last sample, or a negative code. */
ECAT_API int ecat_validity(ecat_t *bus, int signal);

/* Raw value of an entry of the last sample: exact for up to 53 bits. */
ECAT_API int ecat_read(ecat_t *bus, int signal, double *value);
/* Raw value as integer; unsigned 64-bit values keep their bits, and floating-point numbers are rounded
 * as those that are written, or ECAT_ERANGE. */
ECAT_API int ecat_read_int(ecat_t *bus, int signal, int64_t *value);
/* Raw value * scale + offset. */
ECAT_API int ecat_read_physical(ecat_t *bus, int signal, double *value);

/* --- Writing ---------------------------------------------------------------------------------- */

/* Nothing leaves the process before ecat_commit(). Values are rounded to the nearest that the entry can
 * have, of two equally near ones to the even one, whatever the rounding mode of the thread is. Infinity
 * and NaN are ECAT_ERANGE, and so is a number that the entry cannot hold, or beyond its declared range:
 * then nothing is staged. ECAT_ELEASE when the claim has ended with the daemon: claim again. */

/* Stages a raw value of an output. */
ECAT_API int ecat_write(ecat_t *bus, int signal, double value);
/* The same of an integer; unsigned 64-bit values keep their bits. */
ECAT_API int ecat_write_int(ecat_t *bus, int signal, int64_t value);
/* Stages the raw value (value - offset) / scale. An analog quantity, whose entry has a unit, a scale
 * or an offset, is held at the limits of its entry and not refused beyond them. */
ECAT_API int ecat_write_physical(ecat_t *bus, int signal, double value);
/* The same with a meaning of the program's own, always as an analog quantity. */
ECAT_API int ecat_write_scaled(ecat_t *bus, int signal, double value, double scale, double offset);
/* Publishes all staged outputs at once; they go out with the next cycle. ECAT_ELEASE, until something
 * is claimed again, when they are no longer owned: the lease is over, or the daemon has ended. */
ECAT_API int ecat_commit(ecat_t *bus);

/* What the calls above make of a value, without a bus: the bits of an entry with this type, length,
 * range and, for ecat_encode_physical(), this unit, scale and offset. 0 or ECAT_ERANGE. */
ECAT_API int ecat_encode(const ecat_signal_info *entry, double value, uint64_t *bits);
ECAT_API int ecat_encode_int(const ecat_signal_info *entry, int64_t value, uint64_t *bits);
ECAT_API int ecat_encode_physical(const ecat_signal_info *entry, double value, uint64_t *bits);
/* The smallest and the largest raw value of such an entry, by its type and its range; those of 64 bits
 * are rounded. */
ECAT_API void ecat_limits(const ecat_signal_info *entry, double *low, double *high);
/* The nearest whole number, of two equally near ones the even one. */
ECAT_API double ecat_round(double value);

/* --- Waiting ---------------------------------------------------------------------------------- */

/* Waits until `cycles` more cycles than at the last sample or wait have ended. 0 checks only. Returns
 * ECAT_EDOWN at once when the daemon ends; the calls after that wait for its return. */
ECAT_API int ecat_wait(ecat_t *bus, unsigned cycles, double timeout);
/* Waits until a domain was exchanged `exchanges` more times than at its last sample or wait. */
ECAT_API int ecat_wait_domain(ecat_t *bus, int domain, unsigned exchanges, double timeout);
/* Number of the last finished cycle. */
ECAT_API uint64_t ecat_cycle(const ecat_t *bus);

/* --- Requests: nothing here but ecat_wait_request() waits ------------------------------------- */

/* Starts an SDO upload (data NULL) or download of up to ECAT_REQUEST_BYTES, and returns the handle of
 * the request. ECAT_REQUESTS may run at the same time. */
ECAT_API int ecat_sdo_start(ecat_t *bus, int position, unsigned index, unsigned subindex,
                            const void *data, size_t length);
/* Asks for an AL state of a slave (enum ecat_al_state), and returns the handle of the request. */
ECAT_API int ecat_state_start(ecat_t *bus, int position, unsigned state);
/* ECAT_EBUSY while the request runs; else it is finished, its handle is free again, and
 * `data` (up to `size` bytes) and `*length` hold what was uploaded. With ECAT_EABORT,
 * `*abort_code` tells why. All three pointers may be NULL. Requests of a client that ends are
 * dropped, unless they have begun. If the daemon ends, requests return ECAT_EDOWN. */
ECAT_API int ecat_poll(ecat_t *bus, int request, void *data, size_t size, size_t *length,
                       uint32_t *abort_code);
/* Waits until ecat_poll() has an answer, or returns ECAT_ETIMEOUT. Takes no samples meanwhile: the
 * lease of a claim goes on running. */
ECAT_API int ecat_wait_request(ecat_t *bus, int request, double timeout);
/* Gives the handle back without an answer. The slave may have been asked already. */
ECAT_API int ecat_cancel(ecat_t *bus, int request);

#ifdef __cplusplus
}
#endif

#endif
