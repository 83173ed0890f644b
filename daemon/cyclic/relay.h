/* The relay: a thread that sends the frames of the control side (ecatd/master/frames/datagrams.py), such
 * as SDOs and register access, in the free time of the cycle. So these frames never delay the exchange
 * of process data.
 */
#ifndef ECAT_RELAY_H
#define ECAT_RELAY_H

#include "cyclic.h"

typedef struct cyclic_relay cyclic_relay_t;

enum {
  CYCLIC_RELAY_WINDOW_NS = 1000000 /* the longest time that a frame waits for the exchange to end */
};

typedef struct cyclic_relay_settings {
  double share;          /* part of the free time that the relay may use, greater than 0, at most 1 */
  uint64_t patience_ns;  /* the longest time that a frame waits for its share */
  uint64_t answer_ns;    /* a frame that is not back after this time is lost */
  int32_t priority;      /* SCHED_FIFO priority, below that of the engine; 0: ordinary scheduling */
} cyclic_relay_settings;

/* Makes a relay between a local socket that carries frames (SOCK_SEQPACKET) and one or two ports
 * from cyclic_open_socket() (`second_fd` -1: no cable redundancy). With two ports it sends a copy of
 * each frame by each port, and merges the answers into one. The caller still owns all sockets. Returns
 * NULL on failure, and sets errno. */
CYCLIC_API cyclic_relay_t *cyclic_relay_new(int client_fd, int first_fd, int second_fd,
                                            const cyclic_relay_settings *settings);
/* Makes frames wait for the free time of the engine's cycle, and counts them in its ecat_shm_health.
 * After cyclic_stop(), or with NULL, frames are sent at once. */
CYCLIC_API void cyclic_relay_follow(cyclic_relay_t *r, cyclic_t *engine);
/* Changes `share` and `patience_ns` of the settings. A share that is out of range changes nothing. */
CYCLIC_API void cyclic_relay_set_share(cyclic_relay_t *r, double share, uint64_t patience_ns);
/* Gives the relay another socket for port 0 or 1, after an interface went away and came back.
 * Returns when the old socket is no longer used. */
CYCLIC_API void cyclic_relay_set_socket(cyclic_relay_t *r, uint32_t port, int fd);
/* Ends the thread and frees the relay. */
CYCLIC_API void cyclic_relay_free(cyclic_relay_t *r);

#endif
