/* One slave controller and the segment it belongs to; shared by the files of this folder. */
#ifndef ECAT_ESC_SLAVE_H
#define ECAT_ESC_SLAVE_H

#include "esc.h"

#include <pthread.h>
#include <stdatomic.h>
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
    REG_DL_CONTROL = 0x0100,
    REG_DL_STATUS = 0x0110,
    REG_AL_CONTROL = 0x0120,
    REG_AL_STATUS = 0x0130,
    REG_AL_STATUS_CODE = 0x0134,
    REG_PDI_CONTROL = 0x0140,
    REG_PDI_CONFIGURATION = 0x0150,
    REG_ECAT_EVENT_MASK = 0x0200,
    REG_ECAT_EVENT = 0x0210,
    REG_AL_EVENT = 0x0220,
    REG_ERROR_COUNTERS = 0x0300, /* to 0x0313 */
    REG_LOST_LINKS = 0x0310,     /* a byte a port */
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
    REG_DIGITAL_OUTPUT = 0x0F00,
    REG_RAM = 0x1000
};

enum ecat_event_bits { ECAT_EVENT_DL = 0x0004, ECAT_EVENT_AL = 0x0008 };
enum { AL_STATE_MASK = 0x0F, AL_OP = 8, AL_ERROR = 0x10 };
enum { PORTS = 4, INTERFACES = 2, LOST = -1 };

/* A sync manager, decoded from its registers. */
struct sync_manager {
    uint16_t start, size; /* `size` is 0 while the channel is off */
    bool mailbox;         /* else buffered */
    bool write;           /* the master writes; else it reads */
    bool watchdog;        /* a complete write feeds the process data watchdog */
    bool locked;          /* deactivated by the device */
    bool full;            /* mailbox mode: written and not read yet */
    bool open;            /* mailbox mode: an access began at the first byte */
};

/* An active FMMU, decoded. Channels of all slaves stand in one array, in wire order. */
struct fmmu {
    uint32_t start, end; /* logical bytes [start, end) */
    uint16_t address;    /* first physical byte */
    uint8_t first_bit, last_bit, physical_bit;
    bool read, write, aligned;
    struct slave *slave;
    struct sync_manager *fast; /* the buffered channel that holds all its bytes, else NULL */
};

/* The far end of the link at a port. */
struct plug {
    enum { PLUG_NONE, PLUG_SLAVE, PLUG_INTERFACE } kind;
    unsigned number; /* of the slave or of the interface */
    unsigned port;   /* of the slave */
    bool broken;     /* said at both ends */
};

struct slave {
    struct esc_segment *segment;
    uint32_t position;
    struct plug plugs[PORTS];
    uint8_t links;  /* a bit for each port with a link */
    uint8_t open;   /* a bit for each port whose loop is open */
    bool reopen;    /* the master wrote the loop control: ports closed by auto-close may open */
    uint32_t events; /* pending for `esc_wait`; when not 0, the slave is in the queue */
    uint32_t ram_end;
    uint8_t *sii;
    size_t sii_size;
    unsigned sync_managers, fmmus;
    struct sync_manager sm[ESC_MAX_CHANNELS];
    bool awaits_outputs;
    bool watchdog;       /* a sync manager has the process data watchdog */
    bool fed;            /* process data watchdog: output data since the last look */
    bool expired;        /* process data watchdog */
    int64_t deadline_ns; /* process data watchdog; 0 = not started */
    bool mapped;
    struct esc_process_data map;
    uint8_t memory[ESC_MEMORY];
};

/* The way of a frame that enters by one of the interfaces; follows from links and loops. */
struct route {
    int exit;                                /* the interface by which it leaves, or LOST */
    unsigned count;                          /* processing units that it passes … */
    uint16_t order[ESC_MAX_SLAVES];          /* … and the slaves to which they belong, in order */
    int32_t arrival[ESC_MAX_SLAVES][PORTS];  /* ns after entry, -1 = it does not arrive there */
    struct slave *woken;                     /* it ends at a port that auto-close keeps closed … */
    unsigned woken_port;                     /* … and which a frame opens */
    uint16_t event_word;                     /* see registers_event_word */
    bool event_word_known;
    bool collected; /* `active` holds the active FMMUs of its slaves */
    unsigned active_count;
    struct fmmu active[ESC_MAX_SLAVES * ESC_MAX_CHANNELS];
};

struct esc_segment {
    pthread_mutex_t lock; /* guards everything below except `stop`, `thread` and the descriptors */
    unsigned count;
    struct slave *slaves[ESC_MAX_SLAVES];
    uint16_t station[ESC_MAX_SLAVES]; /* copies, so that a look-up touches few cache lines */
    uint32_t alias[ESC_MAX_SLAVES];   /* 0x10000 = not enabled */
    bool event_word_stale;            /* event words of the routes have to be made again */
    bool fmmus_changed;               /* FMMUs have to be collected again */
    bool topology_stale;              /* loops may have changed; takes effect before the next frame */
    struct plug interfaces[INTERFACES];
    struct route routes[INTERFACES];
    struct route *route; /* of the current frame */
    int64_t frame_ns;    /* see frame_time_ns; 0 = not asked for yet */
    unsigned queue_head, queue_count;
    uint32_t queue[ESC_MAX_SLAVES]; /* positions of slaves with pending events */
    bool signal_due;                /* the queue became non-empty since the last signal */
    uint32_t drop;
    struct esc_counters counters;
    int notify; /* eventfd, readable while the queue may hold something */
    int socket;
    bool running;
    atomic_bool stop;
    pthread_t thread;
};

static inline uint16_t load16(const uint8_t *p) { return (uint16_t)(p[0] | p[1] << 8); }

static inline uint32_t load32(const uint8_t *p)
{
    return (uint32_t)load16(p) | (uint32_t)load16(p + 2) << 16;
}

static inline void store16(uint8_t *p, unsigned value)
{
    p[0] = (uint8_t)(value & 0xFF);
    p[1] = (uint8_t)(value >> 8 & 0xFF);
}

/* frame.c: all datagrams of a frame that enters by an interface. Returns the interface by which it
 * leaves, or LOST. */
int frame_process(struct esc_segment *segment, unsigned interface, uint8_t *frame, size_t size);
/* When the current frame entered: CLOCK_MONOTONIC, read once a frame and only if asked for. */
int64_t frame_time_ns(struct esc_segment *segment);

/* topology.c */
void topology_plug_next(struct slave *slave);
void topology_update(struct esc_segment *segment);
/* When the current frame arrives at a port, in ns after it entered; -1 where it does not. */
int64_t topology_arrival(const struct slave *slave, unsigned port);

/* access.c: physical access of the master. NULL or false: refused, no working counter. */
const uint8_t *access_read(struct slave *slave, uint16_t address, size_t size);
bool access_write(struct slave *slave, uint16_t address, const uint8_t *data, size_t size);

/* registers.c */
void registers_power_on(struct slave *slave, const struct esc_config *config);
bool registers_write(struct slave *slave, uint32_t address, const uint8_t *data, size_t size);
void registers_set_event(struct slave *slave, unsigned bits, bool on);
uint16_t registers_event_word(struct esc_segment *segment);
void registers_set_links(struct slave *slave, uint8_t links, uint8_t open);

/* eeprom.c */
void eeprom_load(struct slave *slave, bool power_on);
void eeprom_command(struct slave *slave);

/* sync_manager.c */
void sm_decode(struct slave *slave, unsigned channel);
void sm_write_status(struct slave *slave, unsigned channel);
bool sm_may_access(const struct slave *slave, uint32_t from, uint32_t to, bool write);
void sm_accessed(struct slave *slave, uint32_t from, uint32_t to, bool write);
void sm_outputs_complete(struct slave *slave, const struct sync_manager *sm);

/* fmmu.c: logical access; returns what is added to the working counter. */
unsigned fmmu_access(struct esc_segment *segment, uint32_t address, uint8_t *data, unsigned size,
                     bool read, bool write);

/* pdi.c */
void pdi_event(struct slave *slave, uint32_t bits);
bool pdi_signal_due(struct esc_segment *segment);
void pdi_signal(struct esc_segment *segment);

#endif
