/* The relay beside an engine, between a client and a bus that loses, repeats and damages frames.
 *
 * usage: relay SEED FRAMES PORTS
 *
 * Socket pairs stand for the interfaces of both. The client sends frames of two datagrams with
 * a number, and junk; the bus adds to working counters as slaves on a ring would that is open
 * or closed. Meanwhile sockets are replaced, and the engine is followed, or not. What must hold: the
 * client gets answers to its last frame only, each once and complete, and nobody waits for ever.
 * Prints what was reached, as JSON.
 */
#include "../random.h"
#include "engine.h"
#include "relay.h"

#include <fcntl.h>
#include <poll.h>
#include <sched.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <unistd.h>

enum {
  CYCLE_NS = 500000,
  SIDE = 3,                /* slaves on each side of a break */
  FPRD = 4,
  BRD = 7,
  STATION = 0x1003,        /* on the far side */
  WAIT_MS = 60,            /* far longer than a frame can take, here */
  WIRES = 2 * MAX_PORTS    /* those of the engine, then those of the relay */
};

static struct {
  unsigned long sent, answered, silent, junk, lost, repeated, damaged, swaps, follows;
} reached;
static cyclic_t *engine;
static cyclic_relay_t *relay;
static uint8_t *shm;
static int stop, ports, far[WIRES], wanted;
static unsigned long frames;
static pthread_mutex_t wires = PTHREAD_MUTEX_INITIALIZER; /* guards far[] */

static void die(const char *what) {
  fprintf(stderr, "relay: %s\n", what);
  exit(1);
}

static void add(unsigned long *counter) { __atomic_fetch_add(counter, 1, __ATOMIC_RELAXED); }

static int stopping(void) { return __atomic_load_n(&stop, __ATOMIC_RELAXED); }

static int new_pair(int *other) {
  int pair[2];
  if (socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, pair) != 0) die("no socket pair");
  *other = pair[1];
  return pair[0];
}

/* --- the bus ------------------------------------------------------------------------------- */

/* What slaves do with a frame: those of one side of the break, or all of them. */
static void process(uint8_t *bytes, size_t size, int near_side, int far_side) {
  size_t at = FIRST_DATAGRAM;
  int more = 1;
  while (more && at + DATAGRAM_FRAMING <= size) {
    uint32_t flags = get16(bytes + at + 6), length = flags & 0x7FF, wkc = 0;
    uint8_t *data = bytes + at + DATAGRAM_HEADER;
    if (at + DATAGRAM_FRAMING + length > size) return;
    if (bytes[at] == BRD) {
      wkc = (uint32_t)(SIDE * (near_side + far_side));
      if (length > 0 && near_side) data[0] |= 0x01;
      if (length > 0 && far_side) data[0] |= 0x80;
      put16(bytes + at + 2, get16(bytes + at + 2) + wkc);
    } else if (bytes[at] == FPRD && far_side) {
      wkc = 1;
      if (length > 4) data[4] = 0x5A;
    }
    put16(data + length, get16(data + length) + wkc);
    more = (flags & 0x8000) != 0;
    at += DATAGRAM_FRAMING + length;
  }
}

static void answer(struct source *source, uint8_t *bytes, size_t size, int group, int from) {
  static int open;
  int to = ports == 1 ? 0 : open ? from : 1 - from;
  if (ports == 2 && one_in(source, 300)) open = !open;
  if (!open && from == 0) process(bytes, size, 1, 1);
  if (open) process(bytes, size, from == 0, from == 1);
  to += group;
  switch (group == 0 ? 100 : below(source, 30)) {
  case 0: add(&reached.lost); return;
  case 1: add(&reached.repeated); (void)send(far[to], bytes, size, MSG_DONTWAIT); break;
  case 2: add(&reached.damaged); size = below(source, (uint32_t)size); break;
  case 3: add(&reached.damaged); bytes[INDEX_AT] ^= (uint8_t)(1u << below(source, 8)); break;
  case 4: add(&reached.damaged); bytes[FIRST_DATAGRAM + 6] ^= 1; break;
  default: break;
  }
  (void)send(far[to], bytes, size, MSG_DONTWAIT);
}

static void *bus(void *argument) {
  struct source source = source_from((uint64_t)(uintptr_t)argument + 1);
  static uint8_t bytes[2048];
  while (!stopping()) {
    struct pollfd fds[WIRES];
    int i;
    pthread_mutex_lock(&wires);
    for (i = 0; i < WIRES; i++) fds[i] = (struct pollfd){far[i], POLLIN, 0};
    if (poll(fds, WIRES, 1) > 0)
      for (i = 0; i < WIRES; i++) {
        ssize_t size = far[i] < 0 ? -1 : recv(far[i], bytes, sizeof bytes, MSG_DONTWAIT);
        if (size > FIRST_DATAGRAM)
          answer(&source, bytes, (size_t)size, i / MAX_PORTS * MAX_PORTS, i % MAX_PORTS);
      }
    pthread_mutex_unlock(&wires);
    while (__atomic_load_n(&wanted, __ATOMIC_RELAXED) && !stopping()) sched_yield();
  }
  return NULL;
}

/* --- client -------------------------------------------------------------------------------- */

struct client {
  int fd;
  uint64_t seed;
};

/* A broadcast and a read of one slave, with a number; returns the length. */
static size_t build(uint8_t *bytes, uint8_t index, uint32_t number) {
  uint8_t *second = bytes + FIRST_DATAGRAM + DATAGRAM_FRAMING + 2;
  memset(bytes, 0, 2048);
  memset(bytes, 0xFF, 6);
  bytes[6] = 2;
  put16(bytes + ETHERNET_HEADER, 0x1000 | (2 + 8 + 2 * DATAGRAM_FRAMING));
  bytes[FIRST_DATAGRAM] = BRD;
  bytes[FIRST_DATAGRAM + 1] = second[1] = index;
  put16(bytes + FIRST_DATAGRAM + 6, 2 | 0x8000);
  second[0] = FPRD;
  put16(second + 2, STATION);
  put16(second + 6, 8);
  put32(second + DATAGRAM_HEADER, number);
  return ETHERNET_MIN;
}

static void check(const uint8_t *bytes, size_t size, uint32_t number) {
  const uint8_t *first = bytes + FIRST_DATAGRAM + DATAGRAM_HEADER;
  const uint8_t *second = first + 2 + DATAGRAM_WKC + DATAGRAM_HEADER;
  uint32_t everybody = get16(first + 2), one = get16(second + 8);
  if (size != ETHERNET_MIN) die("an answer of another size");
  if (get32(second) != number) die("the answer to another frame");
  /* Where one copy is lost, slaves on one side are, too; and a ring may open meanwhile. */
  if (everybody % SIDE != 0 || everybody > 3 * SIDE || one > 2) die("working counters of no bus");
  if (one > 0 && second[4] != 0x5A) die("the data of a slave is missing");
  if (everybody == 2 * SIDE && one == 1 && first[0] != 0x81) die("data of two sides is not ORed");
  if (ports == 1 && (everybody != 2 * SIDE || one != 1)) die("a copy was counted twice");
}

static void *client(void *argument) {
  const struct client *me = argument;
  struct source source = source_from(me->seed);
  uint8_t bytes[2048], index = 0;
  uint32_t number = 0;
  while (!stopping()) {
    struct pollfd readable = {me->fd, POLLIN, 0};
    size_t size;
    ssize_t got;
    if (one_in(&source, 20)) {
      size = 1 + below(&source, sizeof bytes - 1);
      fill(&source, bytes, size);
      if (one_in(&source, 2) && size > INDEX_AT) bytes[INDEX_AT] = 0xFF; /* never ours */
      add(&reached.junk);
      /* What looks like a frame may be sent and come back. */
      if (size > INDEX_AT) bytes[FIRST_DATAGRAM + 6] = bytes[FIRST_DATAGRAM + 7] = 0xFF;
      if (send(me->fd, bytes, size, 0) != (ssize_t)size) die("the client cannot send");
      continue;
    }
    index = (uint8_t)((index + 1) % CYCLIC_INDEX_ENGINE);
    size = build(bytes, index, ++number);
    if (send(me->fd, bytes, size, 0) != (ssize_t)size) die("the client cannot send");
    add(&reached.sent);
    __atomic_fetch_add(&frames, 1, __ATOMIC_RELAXED);
    /* The relay may have been slow to give up: an answer to an older frame says so by its index. */
    for (got = 0; poll(&readable, 1, WAIT_MS) != 0;) {
      got = recv(me->fd, bytes, sizeof bytes, MSG_DONTWAIT);
      if (got <= 0) die("the relay is gone");
      if (bytes[INDEX_AT] == index) break;
      got = 0;
    }
    if (got == 0) {
      add(&reached.silent);
      continue;
    }
    check(bytes, (size_t)got, number);
    add(&reached.answered);
  }
  return NULL;
}

/* --- control ------------------------------------------------------------------------------- */

static void swap_socket(int *near, int port) {
  int old_near = *near, old_far, fresh;
  __atomic_store_n(&wanted, 1, __ATOMIC_RELAXED);
  pthread_mutex_lock(&wires);
  __atomic_store_n(&wanted, 0, __ATOMIC_RELAXED);
  old_far = far[MAX_PORTS + port];
  fresh = new_pair(&far[MAX_PORTS + port]);
  pthread_mutex_unlock(&wires);
  close(old_far); /* sending fails now */
  cyclic_relay_set_socket(relay, (uint32_t)port, fresh);
  close(old_near);
  *near = fresh;
  reached.swaps++;
}

static uint32_t place(uint32_t *end, size_t size) {
  uint32_t at = *end;
  *end += (uint32_t)((size + 63) / 64 * 64);
  return at;
}

/* A bus without slaves of its own: the engine asks for their status only. */
static int make_files(void) {
  ecat_shm_header *h = (void *)shm;
  ecat_out_header out = {.slot_count = ECAT_SLOTS, .doorbells_offset = 4096, .slots_offset = 8192,
                         .slot_stride = 8192, .image_stride = 64};
  uint32_t end = (sizeof *h + 63) / 64 * 64;
  int fd = memfd_create("out", MFD_CLOEXEC);
  h->cycle_time_ns = CYCLE_NS;
  h->slot_count = ECAT_SLOTS;
  h->slot_status_offset = place(&end, ECAT_SLOTS * sizeof(ecat_shm_slot_status));
  h->replies_offset = place(&end, ECAT_SLOTS * ECAT_REQUESTS * sizeof(ecat_shm_reply));
  h->health_offset = place(&end, sizeof(ecat_shm_health));
  h->slaves_offset = h->domains_offset = h->signals_offset = h->outputs_offset = end;
  h->domain_status_offset = end;
  if (fd < 0 || ftruncate(fd, 1 << 20) != 0 || pwrite(fd, &out, sizeof out, 0) != sizeof out)
    die("no .out file");
  return fd;
}

int main(int count, char **arguments) {
  cyclic_settings settings = {.cpu = -1};
  cyclic_relay_settings relayed = {.share = 0.5, .patience_ns = 500000, .answer_ns = 2000000};
  struct client only;
  int near[WIRES] = {-1, -1, -1, -1}, end, i, out_fd;
  pthread_t threads[2];
  unsigned long wanted_frames;
  if (count != 4) die("usage: relay SEED FRAMES PORTS");
  wanted_frames = strtoul(arguments[2], NULL, 0);
  ports = atoi(arguments[3]);
  shm = aligned_alloc(64, 1 << 20);
  if (shm == NULL || ports < 1 || ports > MAX_PORTS) die("cannot begin");
  memset(shm, 0, 1 << 20);
  out_fd = make_files();
  for (i = 0; i < WIRES; i++) {
    far[i] = -1;
    if (i % MAX_PORTS < ports) near[i] = new_pair(&far[i]);
  }
  only.fd = new_pair(&end);
  only.seed = strtoull(arguments[1], NULL, 0) + 10;
  engine = cyclic_new(shm, out_fd, near[0], near[1], 0x600DCAFE);
  relay = cyclic_relay_new(end, near[2], near[3], &relayed);
  if (engine == NULL || relay == NULL) die("no engine or no relay");
  if (cyclic_start(engine, &settings) != 0) die("it does not start");
  pthread_create(&threads[0], NULL, bus, (void *)(uintptr_t)only.seed);
  pthread_create(&threads[1], NULL, client, &only);
  for (i = 0; __atomic_load_n(&frames, __ATOMIC_RELAXED) < wanted_frames; i++) {
    cyclic_relay_follow(relay, i % 8 < 6 ? engine : NULL);
    reached.follows++;
    nanosleep(&(struct timespec){0, 5000000}, NULL);
    swap_socket(&near[MAX_PORTS + i % ports], i % ports);
  }
  cyclic_relay_follow(relay, engine);
  __atomic_store_n(&stop, 1, __ATOMIC_RELAXED);
  pthread_join(threads[1], NULL);
  pthread_join(threads[0], NULL);
  cyclic_stop(engine); /* which the relay no longer follows then */
  printf("{\"sent\": %lu, \"answered\": %lu, \"silent\": %lu, \"junk\": %lu, \"lost\": %lu, "
         "\"repeated\": %lu, \"damaged\": %lu, \"swaps\": %lu, \"follows\": %lu, \"cycles\": %lu, "
         "\"relayed\": %lu}\n",
         reached.sent, reached.answered, reached.silent, reached.junk, reached.lost,
         reached.repeated, reached.damaged, reached.swaps, reached.follows,
         (unsigned long)engine->health->cycles, (unsigned long)engine->health->mailbox_frames);
  cyclic_free(engine);
  cyclic_relay_free(relay);
  for (i = 0; i < WIRES; i++)
    if (near[i] >= 0) close(near[i]), close(far[i]);
  close(only.fd);
  close(end);
  close(out_fd);
  free(shm);
  return 0;
}
