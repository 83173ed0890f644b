/* One slave controller and the segment it belongs to; shared by the files of this folder. */
#ifndef ECAT_ESC_SLAVE_H
#define ECAT_ESC_SLAVE_H

#include "dc.h"
#include "esc.h"
#include "sync_manager.h"

#include <pthread.h>
#include <stdbool.h>
#include <string.h>

enum esc_register {
    REG_TYPE = 0x0000,
    REG_REVISION = 0x0001,
    REG_BUILD = 0x0002,
    REG_FMMUS = 0x0004,
    REG_SYNC_MANAGERS = 0x0005,
    REG_RAM_SIZE = 0x0006,
    REG_PORTS = 0x0007,
    REG_FEATURES = 0x0008,
    REG_STATION_ADDRESS = 0x0010,
    REG_STATION_ALIAS = 0x0012,
    REG_WRITE_ENABLE = 0x0020,     /* then 0x0021: register write protection */
    REG_ESC_WRITE_ENABLE = 0x0030, /* then 0x0031: write protection of the whole ESC */
    REG_RESET = 0x0040,            /* by the master; 0x0041: by the device */
    REG_DL_CONTROL = 0x0100,
    REG_RW_OFFSET = 0x0108,
    REG_DL_STATUS = 0x0110,
    REG_AL_CONTROL = 0x0120,
    REG_AL_STATUS = 0x0130,
    REG_AL_STATUS_CODE = 0x0134,
    REG_RUN_LED = 0x0138,
    REG_PDI_CONTROL = 0x0140,
    REG_PDI_CONFIGURATION = 0x0150,
    REG_ECAT_EVENT_MASK = 0x0200,
    REG_AL_EVENT_MASK = 0x0204,
    REG_ECAT_EVENT = 0x0210,
    REG_AL_EVENT = 0x0220,
    REG_RX_ERRORS = 0x0300, /* two bytes a port: invalid frames, and errors of the physical layer */
    REG_FORWARDED_ERRORS = 0x0308,
    REG_PROCESSING_ERRORS = 0x030C,
    REG_PDI_ERRORS = 0x030D,
    REG_LOST_LINKS = 0x0310, /* a byte a port */
    REG_WATCHDOG_DIVIDER = 0x0400,
    REG_WATCHDOG_PDI = 0x0410,
    REG_WATCHDOG_DATA = 0x0420,
    REG_WATCHDOG_STATUS = 0x0440,
    REG_WATCHDOG_COUNTERS = 0x0442,
    REG_EEPROM_CONFIG = 0x0500,
    REG_EEPROM_CONTROL = 0x0502,
    REG_EEPROM_ADDRESS = 0x0504,
    REG_EEPROM_DATA = 0x0508,
    REG_EEPROM_END = 0x0510,
    REG_FMMU = 0x0600, /* 16 bytes a channel */
    REG_SM = 0x0800,   /* 8 bytes a channel */
    REG_DC = 0x0900, /* to 0x09FF; receive times of the ports */
    REG_CLOCK = 0x0910, /* system time; from here on only with distributed clocks */
    REG_SYNC = 0x0981,
    REG_SYNC_PULSE = 0x0982,
    REG_LATCH = 0x09A8,
    REG_DC_END = 0x0A00,
    REG_DIGITAL_OUTPUT = 0x0F00,
    REG_DIGITAL_OUTPUT_END = 0x0F04,
    REG_RAM = 0x1000
};

enum ecat_event_bits {
    ECAT_EVENT_LATCH = 0x0001,
    ECAT_EVENT_DL = 0x0004,
    ECAT_EVENT_AL = 0x0008,
    ECAT_EVENT_SM0 = 0x0010 /* SM0 to SM7; computed, not kept in `slave.ecat_events` */
};
enum al_event_bits {
    AL_EVENT_CONTROL = 0x0001,
    AL_EVENT_LATCH = 0x0002,
    AL_EVENT_SYNC0 = 0x0004,
    AL_EVENT_SYNC1 = 0x0008,
    AL_EVENT_SM_ACTIVATION = 0x0010,
    AL_EVENT_WATCHDOG = 0x0040,
    AL_EVENT_SM0 = 0x0100 /* SM0 to SM15; computed, not kept in `slave.al_events` */
};
enum feature_bits { /* of register 0x0008 */
    FEATURE_BYTE_FMMUS = 0x0001,
    FEATURE_NO_LRW = 0x0200,
    FEATURE_NO_READ_WRITE = 0x0400
};
enum dl_status_bits { DL_PDI_OPERATIONAL = 0x01, DL_PDI_WATCHDOG = 0x02 };
enum { AL_STATE_MASK = 0x0F, AL_OP = 8, AL_ERROR = 0x10 };
enum { PORTS = 4, NO_PORT = 0xFF, INTERFACES = 2, LOST = -1 };

/* EEPROM interface, see eeprom.c. */
struct eeprom {
    uint8_t *image;
    size_t size;
    int64_t busy_until_ns; /* 0 = idle */
    unsigned command;      /* command under way */
    unsigned errors;       /* error bits of the status register */
    unsigned outcome;      /* error bits once the command has ended */
    uint8_t data[8];       /* result of a read command */
    uint64_t enabled;      /* frame in which writing was enabled, see `frame_number` */
    bool taken;            /* the device has access */
};

/* An active FMMU, decoded. A route has the FMMUs of all its slaves in one array, in wire order. */
struct fmmu {
    uint32_t start, end; /* logical bytes [start, end) */
    uint16_t address;    /* first physical byte */
    uint8_t first_bit, last_bit, physical_bit;
    bool read, write, aligned;
    bool contested; /* FMMUs with lower numbers map some of its logical bytes */
    struct slave *slave;
    struct sync_manager *fast; /* the buffered sync manager with all its bytes, or NULL */
};

/* The far end of the link at a port. */
struct plug {
    enum { PLUG_NONE, PLUG_SLAVE, PLUG_INTERFACE } kind;
    unsigned number; /* of the slave or of the interface */
    unsigned port;   /* of the slave */
    bool broken;     /* set at both ends */
};

struct slave {
    struct esc_segment *segment;
    uint32_t position;
    bool off;       /* without power: no links, no access, memory without meaning */
    bool queued;    /* in the queue of `esc_wait`, even if no event is pending any more */
    struct plug plugs[PORTS];
    uint8_t links;  /* a bit for each port with a link */
    uint8_t open;   /* a bit for each port whose loop is open */
    bool reopen;    /* the master wrote the loop control: ports closed by auto-close may open */
    uint32_t events; /* pending for `esc_wait` */
    uint32_t ram_end;
    unsigned sync_managers, fmmus;
    struct sync_manager sm[ESC_MAX_CHANNELS];
    unsigned ecat_events; /* ECAT event request, without the bits of sync managers */
    unsigned al_events;   /* AL event request, without sync managers and SYNC signals */
    bool sm_interrupts;   /* the ECAT event mask has bits of sync managers */
    bool protected;       /* register or ESC write protection is on */
    bool has_outputs;    /* output data have come since `esc_map` and since OP was left */
    bool awaits_outputs; /* the device has requested ESC_OUTPUTS */
    struct program *program; /* NULL = the images have its process data */
    bool program_due;    /* outputs have come for it */
    bool watchdog;       /* a sync manager triggers the process data watchdog */
    bool fed;            /* process data watchdog: output data have come since the last check */
    bool expired;        /* process data watchdog has expired */
    int64_t deadline_ns; /* process data watchdog; 0 = not started */
    int64_t pdi_ns;      /* PDI watchdog: last access of the device; 0 = none yet */
    bool pdi_expired;    /* PDI watchdog has expired */
    uint8_t reset_step[2]; /* letters of the reset sequence so far: of master and device */
    uint64_t write_enabled, esc_write_enabled; /* numbers of frames, see `frame_number` */
    uint64_t al_controlled;  /* number of the frame that has written AL control last */
    int64_t loops_until_ns;  /* the loop control is temporary until then; 0 = it is not */
    uint8_t loops_before;    /* the loop control that then comes back */
    unsigned area_count;
    struct esc_area areas[ESC_MAX_CHANNELS];
    struct esc_config config;
    struct eeprom eeprom;
    struct dc dc;
    /* Buffers that are not in `memory`, at the addresses of their sync managers. Pages that are
     * not used cost nothing. */
    struct buffers {
        uint8_t newest[ESC_MEMORY]; /* the newest complete data while `memory` is in use */
        uint8_t device[ESC_MEMORY]; /* the buffer that the device is reading or writing */
    } *buffers;
    uint8_t memory[ESC_MEMORY + 0x800]; /* beyond: zeros, which a read may reach */
};

/* The path of a frame that enters through an interface; it follows from links and loops. */
struct route {
    int exit;                                /* the interface through which it leaves, or LOST */
    unsigned count;                          /* number of processing units that it passes */
    uint16_t order[ESC_MAX_SLAVES];          /* positions of their slaves, in order */
    int32_t arrival[ESC_MAX_SLAVES][PORTS];  /* ns after entry, -1 = it does not arrive there */
    uint16_t before[ESC_MAX_SLAVES];         /* processing units passed before it reaches a slave */
    uint8_t first_port[ESC_MAX_SLAVES];      /* the port at which it first arrives there */
    struct slave *woken;                     /* it ends at a port of this slave, or NULL: … */
    unsigned woken_port;                     /* … auto-close has closed this port, which it opens */
    uint16_t event_word;                     /* see registers_event_word */
    bool event_word_known;
    bool collected; /* `active` holds the active FMMUs of its slaves */
    unsigned active_count;
    struct fmmu active[ESC_MAX_SLAVES * ESC_MAX_CHANNELS];
};

/* A frame fault and its state. */
struct fault {
    struct esc_fault settings;
    uint64_t cycle;              /* the last cycle with frames that it could strike */
    uint32_t frames[INTERFACES]; /* number of these frames in that cycle, by interface */
};

/* The effects of faults on the current frame. */
struct strike {
    bool drop, drop_answer;
    struct slave *noise; /* the frame is damaged in front of this slave, or NULL */
    int copies;
    int64_t delay_ns;
    unsigned add_to_wkc;
    uint64_t corrupt_bits; /* number of bits to invert */
    uint64_t corrupt_draw; /* random number that chooses the first of them */
};

struct esc_segment {
    pthread_mutex_t lock; /* guards everything below except `notify` and `server` */
    unsigned count;
    struct slave *slaves[ESC_MAX_SLAVES];
    uint16_t station[ESC_MAX_SLAVES]; /* copies, so that a look-up touches few cache lines */
    uint32_t alias[ESC_MAX_SLAVES];   /* 0x10000 = not enabled */
    bool event_word_stale;            /* event words of the routes must be computed again */
    bool fmmus_changed;               /* FMMUs must be collected again */
    bool programs_due;                /* a slave has `program_due` */
    bool temporary_loops;             /* a slave may have a temporary loop control */
    bool topology_stale;              /* loops may have changed; updated before the next frame */
    struct plug interfaces[INTERFACES];
    bool no_carrier[INTERFACES]; /* nothing is plugged in there, or its other end is switched off */
    struct route routes[INTERFACES];
    struct route damaged; /* the part of a route on which the current frame is still whole */
    struct route *route;  /* of the current frame */
    int64_t frame_ns;     /* see frame_time_ns; 0 = not read yet */
    bool latches_ports;     /* the datagram under way is a BWR or FPWR, see dc.c */
    unsigned syncs_running; /* slaves whose SYNC unit runs */
    unsigned queue_head, queue_count;
    uint32_t queue[ESC_MAX_SLAVES]; /* positions of slaves with pending events */
    bool signal_due;                /* the queue became non-empty since the last signal */
    uint32_t last_address; /* logical address of the last process data frame */
    unsigned fault_count;
    struct fault faults[ESC_MAX_FAULTS];
    int next_fault; /* identifier of the fault added last */
    struct esc_counters counters;
    int notify; /* eventfd, readable while the queue may hold something */
    struct server *server; /* NULL = none runs */
};

/* Called when the state of a sync manager has changed: the bits that its slave adds to the IRQ
 * field of datagrams may change, too. */
static inline void sm_changed(struct slave *slave)
{
    if (slave->sm_interrupts)
        slave->segment->event_word_stale = true;
}

static inline uint16_t load16(const uint8_t *p) { return (uint16_t)(p[0] | p[1] << 8); }

static inline uint32_t load32(const uint8_t *p)
{
    return (uint32_t)load16(p) | (uint32_t)load16(p + 2) << 16;
}

static inline bool touches(uint32_t from, uint32_t to, uint32_t reg, uint32_t size)
{
    return from < reg + size && to > reg;
}

/* Returns the number of the current frame, which is never 0. A setting that lasts until the end of
 * a frame is stored as this number. */
static inline uint64_t frame_number(const struct esc_segment *segment)
{
    return segment->counters.frames + segment->counters.dropped + 1;
}

static inline void store16(uint8_t *p, unsigned value)
{
    p[0] = (uint8_t)(value & 0xFF);
    p[1] = (uint8_t)(value >> 8 & 0xFF);
}

/* frame.c: processes all datagrams of a frame that enters through an interface. */
enum { ETHERNET_HEADER = 14, ETHERTYPE_ECAT = 0x88A4, MAX_FRAME = 2048 };
void frame_process(struct esc_segment *segment, unsigned interface, uint8_t *frame, size_t size,
                   struct esc_passage *passage);
/* Adds `value` to the working counters of the logical datagrams. */
void frame_add_to_wkc(uint8_t *frame, size_t size, unsigned value);
/* Returns when the current frame entered, or the device side called (CLOCK_MONOTONIC). Only the
 * first call for a frame reads the clock. */
int64_t frame_time_ns(struct esc_segment *segment);
int64_t clock_now_ns(void);

/* faults.c: chooses the faults of a frame before it is processed, and damages it afterwards. */
struct strike faults_look(struct esc_segment *segment, unsigned interface, bool process_data);
void faults_damage(const struct strike *strike, uint8_t *frame, size_t size);

/* ports.c: DL status and the counters 0x0300 to 0x0313. */
void ports_set(struct slave *slave, uint8_t links, uint8_t open);
bool ports_clear_counters(struct slave *slave, uint32_t from, uint32_t to);
void ports_count_malformed(struct esc_segment *segment);
void ports_count_noise(struct esc_segment *segment, const struct route *route, struct slave *at);

/* topology.c */
void topology_plug_next(struct slave *slave);
void topology_update(struct esc_segment *segment);
void topology_refresh(struct esc_segment *segment);
/* Called when the master has written DL control; `before` is the loop control until now. */
void topology_set_loops(struct slave *slave, uint8_t before);
/* Ends temporary loop controls whose time is over. */
void topology_restore_loops(struct esc_segment *segment);
void topology_wake(struct esc_segment *segment, const struct route *route);
/* Returns when the current frame arrives at a port, in ns after it entered; -1 if it does not. */
int64_t topology_arrival(const struct slave *slave, unsigned port);

/* Times of clocks wrap, as in the chip. Sums and differences are taken modulo 2^64, so that no
 * value that a master writes can overflow them. */
static inline int64_t time_after(int64_t time, int64_t ns)
{
    return (int64_t)((uint64_t)time + (uint64_t)ns);
}

static inline int64_t time_between(int64_t from, int64_t to)
{
    return (int64_t)((uint64_t)to - (uint64_t)from);
}

static inline uint64_t load64(const uint8_t *p)
{
    return load32(p) | (uint64_t)load32(p + 4) << 32;
}

static inline void store32(uint8_t *p, uint32_t value)
{
    store16(p, value & 0xFFFF);
    store16(p + 2, value >> 16);
}

static inline void store64(uint8_t *p, uint64_t value)
{
    store32(p, (uint32_t)value);
    store32(p + 4, (uint32_t)(value >> 32));
}

/* access.c: physical access of the master. Returns NULL or false if the access is refused; it then
 * does not count in the working counter. */
const uint8_t *access_read(struct slave *slave, uint16_t address, size_t size);
bool access_write(struct slave *slave, uint16_t address, const uint8_t *data, size_t size);

/* registers.c: writes to registers; power-on and reset. */
void registers_power_on(struct slave *slave);
void registers_reset(struct slave *slave);
/* Has the RUN LED show the AL state, unless the master has taken it over. Another AL status takes it
 * back. */
void registers_show_state(struct slave *slave, bool changed);
bool registers_write(struct slave *slave, uint32_t address, const uint8_t *data, size_t size);
bool registers_device_write(struct slave *slave, uint32_t from, uint32_t to, const uint8_t *data);
bool registers_exist(const struct slave *slave, uint32_t from, uint32_t to);
bool registers_may_write(const struct slave *slave, uint32_t from, uint32_t to);

/* live.c: registers that are computed when they are read, and acknowledgement by reading. */
void live_refresh(struct slave *slave, uint32_t from, uint32_t to, bool by_device);
void live_was_read(struct slave *slave, uint32_t from, uint32_t to, bool by_device);
void registers_set_event(struct slave *slave, unsigned bits, bool on);
uint16_t registers_event_word(struct esc_segment *segment);
void registers_set_dl_status(struct slave *slave, unsigned bits, bool on);

/* eeprom.c */
void eeprom_load(struct slave *slave, bool power_on);
bool eeprom_accepts(struct slave *slave, bool by_device);
void eeprom_assigned(struct slave *slave);
void eeprom_command(struct slave *slave, bool by_device);
void eeprom_refresh(struct slave *slave);

/* dc.c */
void dc_power_on(struct slave *slave);
int64_t dc_local_time(const struct slave *slave, int64_t now_ns);
int64_t dc_system_time(const struct slave *slave, int64_t now_ns);
void dc_store_time(struct slave *slave, uint32_t reg, int64_t time);
void dc_refresh(struct slave *slave, uint32_t from, uint32_t to, bool by_device);
void dc_write(struct slave *slave, uint32_t from, uint32_t to, const uint8_t *data);
void dc_set_clock(struct slave *slave, const double *drift, const int64_t *offset_ns);
void dc_get_clock(struct slave *slave, int64_t now_ns, struct esc_clock *clock);

/* sync.c */
void sync_stop(struct slave *slave);
void sync_write(struct slave *slave, uint32_t from, uint32_t to, const uint8_t *data,
                bool by_device);
void sync_refresh(struct slave *slave, uint32_t from, uint32_t to, int64_t time);
void sync_was_read(struct slave *slave, uint32_t from, uint32_t to, bool by_device);
void sync_latch(struct slave *slave, unsigned unit, bool rising);
void sync_latch_events(struct slave *slave);
unsigned sync_al_events(const struct slave *slave);
int64_t sync_run(struct slave *slave);

/* watchdog.c */
void watchdog_run(struct slave *slave, int64_t now_ns);
void watchdog_check_pdi(struct slave *slave, int64_t now_ns);
bool watchdog_has_pdi(const struct slave *slave);
void watchdog_feed_pdi(struct slave *slave, int64_t now_ns);

/* buffers.c: access of the device to buffered sync managers. */
void buffers_read(struct slave *slave, uint32_t from, uint32_t to, uint8_t *data);
bool buffers_write(struct slave *slave, uint32_t from, uint32_t to, const uint8_t *data);
bool buffers_turn(struct slave *slave, const struct esc_area *area);

/* fmmu.c: logical access; returns the increment of the working counter. */
unsigned fmmu_access(struct esc_segment *segment, uint32_t address, uint8_t *data, unsigned size,
                     bool read, bool write);

/* program.c */
void program_run_due(struct esc_segment *segment);
void program_run_idle(struct slave *slave, int64_t now_ns);
void program_clear(struct slave *slave);
void program_remove(struct slave *slave);

/* pdi.c */
/* Whether the outputs of a slave count: it is in OP, and its watchdog has not expired. */
bool pdi_outputs_count(const struct slave *slave);
void pdi_event(struct slave *slave, uint32_t bits);
bool pdi_signal_due(struct esc_segment *segment);
void pdi_signal(struct esc_segment *segment);

#endif
