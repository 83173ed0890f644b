/* The shared memory of a bus: structs and constants. See ecat_shm.def for who writes what.
 *
 * C89-clean. Programs use ecat.h; this header is for the daemon, for tools and for those who
 * write a client in another language.
 */
#ifndef ECAT_SHM_H
#define ECAT_SHM_H

#include <stdint.h>

#define ECAT_SHM_MAGIC 0x314D485354414345u /* "ECATSHM1" */
#define ECAT_OUT_MAGIC 0x3154554F54414345u /* "ECATOUT1" */
#define ECAT_SHM_LAYOUT_MAJOR 1u
#define ECAT_SHM_LAYOUT_MINOR 0u
#define ECAT_SHM_LAYOUT ((ECAT_SHM_LAYOUT_MAJOR << 16) | ECAT_SHM_LAYOUT_MINOR)

#define ECAT_SLOTS 32        /* clients that own outputs or send requests at the same time */
#define ECAT_IMAGES 4        /* committed output images kept per slot */
#define ECAT_REQUESTS 4      /* requests of one client at the same time */
#define ECAT_REQUEST_BYTES 512
#define ECAT_MAX_SLAVES 1024
#define ECAT_HISTOGRAM_BUCKETS 928
/* Who waits on `cycle_word` says for what by a bit of FUTEX_WAIT_BITSET: the end of any cycle, or
 * that of an exchange of domain n (1 << n). */
#define ECAT_WAKE_CYCLE (1u << 31)

enum ecat_bus_state {
  ECAT_BUS_STARTING = 1,
  ECAT_BUS_RUNNING = 2,  /* process data is exchanged */
  ECAT_BUS_STOPPING = 3, /* outputs are at their safe values */
  ECAT_BUS_STOPPED = 4
};

enum ecat_wkc_state {
  ECAT_WKC_ZERO = 0,       /* no slave took part, or no frame came back */
  ECAT_WKC_INCOMPLETE = 1, /* some did not */
  ECAT_WKC_COMPLETE = 2
};

enum ecat_ring {
  ECAT_RING_NONE = 0,   /* no second interface */
  ECAT_RING_CLOSED = 1,
  ECAT_RING_OPEN = 2    /* a break: each interface reaches the slaves on its side */
};

enum ecat_link {
  ECAT_LINK_UNUSED = 0, /* no such interface configured */
  ECAT_LINK_UP = 1,
  ECAT_LINK_NO_CARRIER = 2,
  ECAT_LINK_DOWN = 3,   /* switched off */
  ECAT_LINK_GONE = 4    /* the interface does not exist any more */
};

enum ecat_dc_state {
  ECAT_DC_OFF = 0,      /* the cycle runs on CLOCK_MONOTONIC */
  ECAT_DC_LOCKING = 1,
  ECAT_DC_LOCKED = 2    /* the cycle follows the reference clock */
};

/* Rows of the ecat_shm_setting table, with the meaning of `value`. */
enum ecat_setting {
  ECAT_SETTING_SCHEDULING = 0,   /* SCHED_FIFO; priority */
  ECAT_SETTING_AFFINITY = 1,     /* CPU that the engine is pinned to */
  ECAT_SETTING_MEMORY = 2,       /* mlockall; 0 */
  ECAT_SETTING_TIMER_SLACK = 3,  /* ns */
  ECAT_SETTING_DMA_LATENCY = 4,  /* /dev/cpu_dma_latency; us */
  ECAT_SETTING_BUSY_RECEIVE = 5, /* 0 */
  ECAT_SETTINGS = 6
};

enum ecat_outputs {
  ECAT_OUTPUTS_SAFE = 0,     /* nobody owns them */
  ECAT_OUTPUTS_CLAIMED = 1,  /* owned, but still safe: not yet written by their owner */
  ECAT_OUTPUTS_ACTIVE = 2,   /* written by their owner */
  ECAT_OUTPUTS_STOPPING = 3  /* nobody owns them, and the daemon brings the drive to a stop */
};

enum ecat_reason {
  ECAT_REASON_START = 0,    /* never claimed */
  ECAT_REASON_RELEASED = 1, /* released by their owner */
  ECAT_REASON_LAPSED = 2,   /* heartbeat of the owner stopped */
  ECAT_REASON_GONE = 3,     /* slot taken over by another client: the owner is dead */
  ECAT_REASON_STOPPING = 4, /* the daemon stops */
  ECAT_REASON_WKC = 5       /* slaves of the domain did not take part in the exchange */
};

enum ecat_slot_state {
  ECAT_SLOT_FREE = 0,
  ECAT_SLOT_ACTIVE = 1,
  ECAT_SLOT_LAPSED = 2 /* lost its claims; a new generation may claim again */
};

enum ecat_request_op {
  ECAT_REQUEST_UPLOAD = 1,
  ECAT_REQUEST_DOWNLOAD = 2,
  ECAT_REQUEST_STATE = 3     /* AL state, in the first byte of data */
};

#define STRUCT(name, comment) typedef struct name {
#define FIELD(type, name, count, comment) ECAT_FIELD_##count(type, name)
#define ECAT_FIELD_1(type, name) type name;
#define ECAT_FIELD_3(type, name) type name[3];
#define ECAT_FIELD_4(type, name) type name[4];
#define ECAT_FIELD_16(type, name) type name[16];
#define ECAT_FIELD_32(type, name) type name[32];
#define ECAT_FIELD_64(type, name) type name[64];
#define ECAT_FIELD_512(type, name) type name[512];
#define ECAT_FIELD_928(type, name) type name[928];
#define END(name) } name;
#include "ecat_shm.def"
#undef STRUCT
#undef FIELD
#undef END

#if defined(__GNUC__)
#define ECAT_SHM_API __attribute__((visibility("default")))
#else
#define ECAT_SHM_API
#endif

#ifdef __cplusplus
extern "C" {
#endif

/* The layout as text, a line per field: "struct field type offset size count", and a line
 * "struct - - 0 size 1" per struct. Other languages build their view of the memory from it. */
ECAT_SHM_API const char *ecat_layout(void);

/* The bucket that a time belongs to, and the smallest time that belongs to a bucket. Times of
 * 2^33 ns (8.6 s) and more share the last bucket. */
ECAT_SHM_API unsigned ecat_histogram_bucket(uint64_t ns);
ECAT_SHM_API uint64_t ecat_histogram_bound(unsigned bucket);
/* The time that the share `q` (0 to 1) of all samples does not exceed, in ns; 0 while empty. */
ECAT_SHM_API uint64_t ecat_histogram_quantile(const ecat_shm_histogram *histogram, double q);

#ifdef __cplusplus
}
#endif

#endif
