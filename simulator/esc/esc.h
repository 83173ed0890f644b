/* The slave controllers of a simulated segment: interface for the device side (the PDI).
 *
 * A segment is a tree of slave controllers (ESC) behind one Ethernet interface, or a ring between
 * two interfaces. A thread receives frames, lets the slaves on their path process every datagram,
 * and sends the frames back. The device side waits for events, and reads and writes the memory of
 * the slaves. Register addresses and meanings are those of ETG.1000.4 and of the public data sheets
 * of the ESCs.
 *
 * Functions return a negative errno value on failure. Every function may be called from any thread.
 */
#ifndef ECAT_ESC_H
#define ECAT_ESC_H

#include <stddef.h>
#include <stdint.h>

#define ESC_API __attribute__((visibility("default")))

enum {
    ESC_MAX_SLAVES = 1024,
    ESC_MEMORY = 0x10000, /* bytes of address space of one slave */
    ESC_MAX_CHANNELS = 16, /* FMMUs, and sync managers, of one slave */
    ESC_MAX_FAULTS = 32,
    ESC_MAX_PROGRAM_DATA = 4096 /* bytes of outputs, and of inputs, of a slave with a program */
};
#define ESC_MAX_DELAY_NS INT64_C(10000000000)

/* Events of a slave since the last `esc_wait`. */
enum esc_event_bits {
    ESC_AL_CONTROL = 0x01,   /* AL control (0x0120) was written */
    ESC_MAILBOX_IN = 0x02,   /* the master wrote a mail (SM0 became full) */
    ESC_MAILBOX_OUT = 0x04,  /* the master read a mail (SM1 became empty) */
    ESC_MAILBOX_AGAIN = 0x08, /* the master toggled the repeat request of SM1 */
    ESC_OUTPUTS = 0x10,      /* there are process data outputs, see `esc_await_outputs` */
    ESC_WATCHDOG = 0x20,     /* the process data watchdog expired in OP */
    ESC_EEPROM = 0x40,       /* the master changed the SII image */
    ESC_RESET = 0x80,        /* the controller was reset: registers are as at power-on */
    ESC_SYNC0 = 0x100,       /* there were SYNC0 pulses of the distributed clock */
    ESC_SYNC1 = 0x200        /* there were SYNC1 pulses */
};

struct esc_event {
    uint32_t position;
    uint32_t bits;
};

/* Properties of the chip, registers 0x0000 to 0x0009. */
struct esc_config {
    uint8_t type;
    uint8_t revision;
    uint16_t build;
    uint8_t fmmus;         /* at most ESC_MAX_CHANNELS */
    uint8_t sync_managers; /* at most ESC_MAX_CHANNELS */
    uint8_t ram_kib;       /* process data RAM from 0x1000 */
    uint8_t ports;         /* port descriptor: 2 bits a port, 2 = EBUS, 3 = MII */
    uint8_t dc_bits;       /* width of the distributed clock: 0 = none, 32, 64 */
    uint8_t eeprom_bytes;  /* bytes that one read of the EEPROM returns: 4 or 8 */
    uint8_t dc_by_sii;     /* SII word 0 switches the units of the clock on (bits 10 and 11) */
    uint16_t features;     /* register 0x0008; bit 0: FMMUs map whole bytes only, 2 and 3: as
                              `dc_bits`, 9: no LRW, 10: no BRW, APRW and FPRW */
    uint16_t watchdog_divider, watchdog_pdi, watchdog_data; /* 0x0400, 0x0410, 0x0420 at power-on */
    uint32_t eeprom_read_us, eeprom_write_us; /* how long the EEPROM is busy */
};

/* The place of the process data of a sync manager in the memory of a slave, and in the output image
 * or the input image of the device side. */
struct esc_area {
    uint16_t address;
    uint16_t size;
    uint32_t offset;
    uint32_t output;
};

struct esc_counters {
    uint64_t frames;    /* EtherCAT frames answered */
    uint64_t malformed; /* frames whose lengths contradict each other */
    uint64_t dropped;   /* frames that did not come back: faults, open or broken links, no slaves */
    uint64_t cycles;    /* cycles of process data that have begun */
};

/* The result of passing a frame through the segment. */
struct esc_passage {
    int32_t exit;     /* the interface through which it leaves, or -1 */
    int32_t copies;   /* how many times it leaves: 1, or 2 with ESC_FAULT_DUPLICATE */
    int64_t delay_ns; /* delay by ESC_FAULT_DELAY */
};

enum esc_fault_kind {
    ESC_FAULT_DROP,      /* lost: on the way to the first slave, or (value 1) on the way back */
    ESC_FAULT_DELAY,     /* comes back `value` ns late; other frames may overtake it */
    ESC_FAULT_DUPLICATE, /* comes back twice */
    ESC_FAULT_CORRUPT,   /* comes back with `value` adjacent bits (0 = 1) inverted */
    ESC_FAULT_NOISE,     /* damaged on its way to `slave`, which counts the error; then lost */
    ESC_FAULT_WKC        /* comes back with `value` added to the working counters of process data */
};

/* A fault of frames. It can strike frames in the cycles `first`, `first + every`, and so on. A
 * cycle begins with a frame at the first interface whose first logical address is not above that of
 * the previous process data frame. Frames before cycle 1 belong to cycle 0. The random number that
 * decides about a frame follows from `seed`, the cycle and the place of the frame in the cycle. */
struct esc_fault {
    int32_t id;
    uint32_t kind;
    uint64_t first, every;
    uint64_t count; /* largest number of frames that it strikes; 0 = no limit */
    double probability;
    uint64_t seed;
    int64_t value;
    uint32_t slave;
    uint32_t process_data_only; /* leaves frames without logical datagrams alone */
    uint64_t struck;            /* number of frames struck so far */
};

/* The distributed clock of a slave, in ns. */
struct esc_clock {
    int64_t local_ns;      /* since power-on */
    int64_t system_ns;     /* local copy of the system time: local time and offset */
    int64_t offset_ns;     /* register 0x0920 */
    uint32_t delay_ns;     /* register 0x0928 */
    int64_t difference_ns; /* mean lead over the reference clock, register 0x092C */
    double drift_ppm;      /* error of its oscillator; positive is fast */
    double trim_ppm;       /* correction of the rate by its time control loop */
};

/* A device in C. It takes the outputs (NULL unless the slave is in OP and its watchdog has not
 * expired) and changes the inputs, which keep what it has written before. */
typedef void (*esc_program_function)(void *context, int64_t now_ns, const uint8_t *outputs,
                                     size_t output_size, uint8_t *inputs, size_t input_size);

struct esc_segment;

/* Creates an empty segment; NULL if memory or file descriptors are short. Add the slaves before
 * `esc_start`. */
ESC_API struct esc_segment *esc_create(void);
/* Stops the segment and frees it. No other call may be under way. */
ESC_API void esc_destroy(struct esc_segment *segment);

/* Appends a slave and loads its SII image (copied) as at power-on. Returns its position. */
ESC_API int esc_add_slave(struct esc_segment *segment, const struct esc_config *config,
                          const uint8_t *sii, size_t sii_size);

/* Exchanges what is plugged into the ports 0 and 1 of a slave. Called after all other links are made.
 * Returns 0, -ENODEV, or -ENXIO if the slave lacks one of these ports. */
ESC_API int esc_exchange_ports(struct esc_segment *segment, int slave);

/* Wiring. The first slave is at the first interface. A further slave is at port 1 of the slave
 * added before it, if that port exists and is free. `esc_connect` moves port 0 of a slave to a port
 * of another one. `esc_close_ring` plugs the second interface into a port. They fail with -ENODEV
 * (no such slave), -ENXIO (no such port), -EADDRINUSE (the port is taken) or -ELOOP (the parent is
 * the slave itself or behind it). */
ESC_API int esc_connect(struct esc_segment *segment, int slave, int parent, int port);
ESC_API int esc_close_ring(struct esc_segment *segment, int slave, int port);
/* Breaks or heals the link at a port; -ENOTCONN if nothing is plugged in there. */
ESC_API int esc_break_link(struct esc_segment *segment, int slave, int port, int broken);
/* Sets whether an interface (0 or 1) has a carrier. Without a carrier its link is down. */
ESC_API int esc_set_carrier(struct esc_segment *segment, int interface, int carrier);
/* Serves an interface (0 or 1) again after it was deleted and made again. */
ESC_API int esc_reopen(struct esc_segment *segment, int interface, const char *name);
/* Copies the positions of the slaves that process a frame from an interface, in order. Returns
 * their number. */
ESC_API int esc_order(struct esc_segment *segment, int interface, uint16_t *order, int capacity);

/* Power off: the links at all ports go down. Power on: everything is as at the first power-on. */
ESC_API int esc_power(struct esc_segment *segment, int slave, int on);
/* Replaces a slave by another one at the same links; the new one powers on. */
ESC_API int esc_replace(struct esc_segment *segment, int slave, const struct esc_config *config,
                        const uint8_t *sii, size_t sii_size);

/* Serves one interface, or two if `second` is not NULL, in a thread of its own until `esc_stop`. */
ESC_API int esc_start(struct esc_segment *segment, const char *first, const char *second);
ESC_API int esc_stop(struct esc_segment *segment);

/* Processes one frame in place, as the thread does with a frame from the first interface. Returns 1
 * if the frame comes back there, else 0. */
ESC_API int esc_process(struct esc_segment *segment, uint8_t *frame, size_t size);
/* The same for either interface and any time `now_ns` (CLOCK_MONOTONIC; 0 = now). */
ESC_API int esc_pass(struct esc_segment *segment, int interface, uint8_t *frame, size_t size,
                     int64_t now_ns, struct esc_passage *passage);

/* Waits at most `timeout_ns` for events and moves up to `capacity` of them to `events`.
 * Returns their number, 0 after the timeout, -EINTR after a signal. */
ESC_API int esc_wait(struct esc_segment *segment, int64_t timeout_ns, struct esc_event *events,
                     int capacity);

/* PDI access to the memory of a slave, with the effects that it has for a real device. Reading a
 * buffered sync manager returns the newest complete outputs. Writing one must begin at the first
 * byte, else it fails with -EACCES; the last byte hands the inputs to the master. Writing the
 * EEPROM interface fails with -EACCES if it is busy or does not belong to the device. */
ESC_API int esc_read(struct esc_segment *segment, int position, uint16_t address, uint8_t *data,
                     size_t size);
ESC_API int esc_write(struct esc_segment *segment, int position, uint16_t address,
                      const uint8_t *data, size_t size);
/* Reads memory as an observer, without side effects. */
ESC_API int esc_peek(struct esc_segment *segment, int position, uint16_t address, uint8_t *data,
                     size_t size);

/* Sets AL status (0x0130) and AL status code (0x0134). */
ESC_API int esc_set_al_status(struct esc_segment *segment, int position, uint16_t status,
                              uint16_t code);

/* Deactivates (SM control of the PDI, 0x0807 bit 0) or releases a sync manager. */
ESC_API int esc_lock_sync_manager(struct esc_segment *segment, int position, int channel,
                                  int locked);

/* Takes the mail in SM0. Returns its size (that of the sync manager), 0 if there is none. */
ESC_API int esc_mailbox_take(struct esc_segment *segment, int position, uint8_t *mail,
                             size_t capacity);
/* Puts a mail into SM1 and pads it with zeros. Returns 1, or 0 while the last one is unread.
 * `again` overwrites an unread mail and acknowledges the master's repeat request. */
ESC_API int esc_mailbox_put(struct esc_segment *segment, int position, const uint8_t *mail,
                            size_t size, int again);

/* Sets the areas of the process data of a slave, at most ESC_MAX_CHANNELS; NULL removes them. */
ESC_API int esc_map(struct esc_segment *segment, int position, const struct esc_area *areas,
                    unsigned count);
/* Requests ESC_OUTPUTS for the moment when the master has written complete output data. It comes at
 * once if the master has done so since the last `esc_map` and since the slave last left OP. */
ESC_API int esc_await_outputs(struct esc_segment *segment, int position);

/* Copies the outputs of all mapped slaves to the image, and runs the process data watchdogs up to
 * `now_ns` (CLOCK_MONOTONIC). The outputs of a slave are zero unless it is in OP and its watchdog
 * has not expired. */
ESC_API int esc_get_outputs(struct esc_segment *segment, uint8_t *image, size_t size,
                            int64_t now_ns);
/* Copies the image to the inputs of all mapped slaves. Inputs stay as they are if the master has
 * moved their sync manager so that it begins before them. */
ESC_API int esc_put_inputs(struct esc_segment *segment, const uint8_t *image, size_t size);

/* Gives a slave a program, which has its process data instead of the images; NULL takes it away. It
 * runs after each frame that has completed the outputs, with the lock of the segment, and from
 * `esc_get_outputs` if none has since the call before. */
ESC_API int esc_set_program(struct esc_segment *segment, int position,
                            esc_program_function function, void *context);

/* Returns the FMMUs of a slave that are ignored, one bit for each. Two FMMUs of the same direction
 * are ignored if there are fewer than three bytes between them and one of them maps bits. */
ESC_API int esc_refused_fmmus(struct esc_segment *segment, int position);

/* Copies the SII image. Returns its size. */
ESC_API int esc_sii(struct esc_segment *segment, int position, uint8_t *image, size_t capacity);

/* Replaces the SII image, as a programming tool would. The registers loaded from it change with the
 * next reload, reset or power-on. */
ESC_API int esc_set_sii(struct esc_segment *segment, int position, const uint8_t *image,
                        size_t size);

/* Sets the error of a slave's oscillator (ppm, positive is fast) and its local time at power-on;
 * the clock jumps by the change. NULL leaves a value as it is. */
ESC_API int esc_set_clock(struct esc_segment *segment, int position, const double *drift_ppm,
                          const int64_t *offset_ns);
/* Steps the local time by `step_ns`, forward or back, as a fault. */
ESC_API int esc_step_clock(struct esc_segment *segment, int position, int64_t step_ns);
/* Copies the clocks of up to `capacity` slaves, all read at one moment. Returns their number. */
ESC_API int esc_clocks(struct esc_segment *segment, struct esc_clock *clocks, int capacity);
/* Makes an edge at latch input 0 or 1 of a slave, now. */
ESC_API int esc_latch(struct esc_segment *segment, int position, int unit, int rising);

/* Adds a fault; its `id` and `struck` are ignored. Returns its identifier, or -ENOSPC if there are
 * ESC_MAX_FAULTS faults that may still strike. */
ESC_API int esc_inject(struct esc_segment *segment, const struct esc_fault *fault);
/* Removes a fault, or all (-1). -ENOENT if there is no such fault. */
ESC_API int esc_clear_faults(struct esc_segment *segment, int id);
/* Copies the faults. Returns their number. */
ESC_API int esc_get_faults(struct esc_segment *segment, struct esc_fault *faults, int capacity);
ESC_API void esc_get_counters(struct esc_segment *segment, struct esc_counters *counters);

#endif
