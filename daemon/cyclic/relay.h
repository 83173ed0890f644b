/* The relay: a thread through which everything goes to the slaves that is not the cyclic exchange,
 * so that SDOs and register access never get in its way. It lets the frames of the control side
 * (ecatd/bus/frames/datagrams.py) pass in the time that the cycle leaves free.
 */
#ifndef ECAT_RELAY_H
#define ECAT_RELAY_H

#include "cyclic.h"

typedef struct cyclic_relay cyclic_relay_t;

enum {
  CYCLIC_RELAY_WINDOW_NS = 1000000 /* the longest time that a frame waits for the exchange to end */
};

typedef struct cyclic_relay_settings {
  double share;          /* of the free time that its frames may be on the wire, above 0 to 1 */
  uint64_t patience_ns;  /* the longest time that a frame waits for its share */
  uint64_t answer_ns;    /* a frame that is not back after this time is lost */
  int32_t priority;      /* SCHED_FIFO priority, below that of the engine; 0: ordinary scheduling */
} cyclic_relay_settings;

/* A relay between a local socket that carries frames (SOCK_SEQPACKET) and one or two ports
 * (`second_fd` -1: no cable redundancy; from cyclic_open_socket()). With two, the client need not
 * know it: a frame leaves by both, and what its copies bring is put together. All sockets stay the
 * caller's. NULL and errno. */
CYCLIC_API cyclic_relay_t *cyclic_relay_new(int client_fd, int first_fd, int second_fd,
                                            const cyclic_relay_settings *settings);
/* Has frames wait for the free time of an engine's cycle; until cyclic_stop(), or with NULL, they
 * pass at once. From the same moment on they are counted in the engine's ecat_shm_health. */
CYCLIC_API void cyclic_relay_follow(cyclic_relay_t *r, cyclic_t *engine);
/* Has it use another socket for port 0 or 1, as after an interface went and came back. When it
 * returns, the old one is no longer used. */
CYCLIC_API void cyclic_relay_set_socket(cyclic_relay_t *r, uint32_t port, int fd);
/* Ends the thread and frees the relay. */
CYCLIC_API void cyclic_relay_free(cyclic_relay_t *r);

#endif
