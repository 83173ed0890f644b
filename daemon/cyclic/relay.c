/* The relay: see relay.h. One frame at a time is on the wire. The relay sleeps in ppoll() or in a
 * futex, and allocates nothing after its start. Its lock is for control, which changes the sockets, the
 * share or the engine of the relay. The engine never waits for this lock. */
#include "relay.h"

#include "engine.h"
#include "frame_ring.h"
#include "thread.h"

#include <errno.h>
#include <linux/futex.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <unistd.h>

enum {
  STACK_BYTES = 64 * 1024,
  FRAME_MIN = FIRST_DATAGRAM + DATAGRAM_FRAMING,
  SECOND_COPY_NS = 500000,   /* how long the second copy may come after the first */
  NS_PER_BYTE = 80,          /* at 100 Mbit/s */
  AT_ONCE = 64               /* frames taken before the time is read again */
};

#define FREE_PART_MIN 0.1 /* so that a cycle without free time does not stop mailboxes altogether */

/* Commands with positions (ETG.1000.4). */
enum { APRD = 1, APWR = 2, APRW = 3, ARMW = 13 };

struct cyclic_relay {
  pthread_mutex_t lock;
  cyclic_relay_settings settings;
  int client;           /* -1: the client has closed its socket */
  int port[MAX_PORTS];
  uint32_t ports;
  int stop_fd;
  cyclic_t *engine;
  cyclic_frame_ring_t *frame_ring; /* records sent and received frames, or NULL */
  pthread_t thread;

  uint64_t free_ns;     /* time from which on the share allows the next frame */
  double free_part;     /* part of the cycle that the exchange leaves free, averaged */
  uint64_t typical_ns;  /* time of a frame on the wire, averaged */

  /* The frame that is being served. */
  size_t length;
  uint32_t pending;     /* bit per port: its copy is on the wire */
  uint32_t copies;      /* number of copies that are back */
  uint32_t back_at;     /* port at which the last copy came back */
  int in_turn;          /* 1: the frame leaves by one port after the other */
  uint32_t number;      /* frames served so far */
  uint8_t frame[2048], answer[2048], received[2048];
};

/* --- pacing --------------------------------------------------------------------------------- */

static void sleep_until(uint64_t at_ns) {
  struct timespec at = {(time_t)(at_ns / 1000000000u), (long)(at_ns % 1000000000u)};
  while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &at, NULL) == EINTR) continue;
}

/* Sleeps until a cycle ends after the one with the futex value `word`, at most until `until_ns`. */
static void wait_for_end_of_cycle(const ecat_shm_header *header, uint32_t word, uint64_t until_ns) {
  struct timespec at = {(time_t)(until_ns / 1000000000u), (long)(until_ns % 1000000000u)};
  /* FUTEX_WAIT_BITSET has an absolute time-out. */
  syscall(SYS_futex, &header->cycle_word, FUTEX_WAIT_BITSET, word, &at, NULL,
          FUTEX_BITSET_MATCH_ANY);
}

/* Whether a frame that is on the wire for `need_ns` should leave now. It should if it will be back before
 * the next deadline. If the whole free time is too short for it, it leaves in the first half of it. */
static int is_free(uint64_t now, uint64_t end_ns, uint64_t deadline_ns, uint64_t need_ns) {
  if (end_ns >= deadline_ns) return 1; /* the cycle is over, and the next deadline is not set yet */
  if (now >= deadline_ns) return 0;    /* the exchange is under way */
  if (now + need_ns <= deadline_ns) return 1;
  return end_ns + need_ns > deadline_ns && now < end_ns + (deadline_ns - end_ns) / 2;
}

/* Sleeps until the share of the time allows another frame. */
static void wait_for_share(const cyclic_relay_t *r, uint64_t now) {
  uint64_t until = now + r->settings.patience_ns;
  if (r->free_ns > now) sleep_until(r->free_ns < until ? r->free_ns : until);
}

/* Sleeps until the exchange of process data leaves time for a frame on the wire. */
static void wait_for_window(const cyclic_relay_t *r) {
  const ecat_shm_header *header = r->engine->header;
  uint64_t wire_ns = r->length * NS_PER_BYTE, until = cyclic_now() + CYCLIC_RELAY_WINDOW_NS;
  uint64_t need = r->typical_ns > wire_ns ? r->typical_ns : wire_ns;
  for (;;) {
    uint32_t word = __atomic_load_n(&header->cycle_word, __ATOMIC_ACQUIRE);
    uint64_t deadline = cyclic_deadline(r->engine);
    uint64_t end = __atomic_load_n(&header->cycle_end_ns, __ATOMIC_RELAXED);
    uint64_t now = cyclic_now();
    if (deadline == 0 || now >= until || is_free(now, end, deadline, need)) return;
    wait_for_end_of_cycle(header, word, until);
  }
}

/* --- the wire ------------------------------------------------------------------------------- */

/* Copies of the second port differ in the last bit of the source address. So the relay knows which copy
 * has come back, and does not count a copy twice. */
static void mark(uint8_t *frame, uint32_t port) { frame[SOURCE_PORT_AT] ^= (uint8_t)port; }

static void send_copy(cyclic_relay_t *r, uint32_t port) {
  mark(r->frame, port);
  if (send(r->port[port], r->frame, r->length, MSG_DONTWAIT) == (ssize_t)r->length) {
    r->pending |= 1u << port;
    cyclic_frame_ring_write(r->frame_ring, r->frame, r->length, port, 1, 0);
  }
  mark(r->frame, port);
}

/* Returns the offset of the datagram after the one at `at`, 0 if that is the last one, or -1 if a
 * datagram does not fit into `length`. */
static int next_datagram(const uint8_t *frame, size_t length, size_t at) {
  size_t size = get16(frame + at + 6) & 0x7FFu, next = at + DATAGRAM_FRAMING + size;
  if (next > length) return -1;
  if ((frame[at + 7] & 0x80) == 0) return 0;
  return next + DATAGRAM_FRAMING <= length ? (int)next : -1;
}

static int is_sound(const uint8_t *frame, size_t length) {
  int at = FIRST_DATAGRAM;
  if (length < FRAME_MIN) return 0;
  while (at > 0) at = next_datagram(frame, length, (size_t)at);
  return at == 0;
}

/* Whether a frame addresses slaves by position, which each slave increments. */
static int is_positional(const uint8_t *frame, size_t length) {
  int at = FIRST_DATAGRAM;
  while (at > 0) {
    if (frame[at] == APRD || frame[at] == APWR || frame[at] == APRW || frame[at] == ARMW) return 1;
    at = next_datagram(frame, length, (size_t)at);
  }
  return 0;
}

/* Sends a frame by all ports. A frame with positions leaves by the first port alone, and receive() sends
 * it on, since the slaves behind a break would count the positions of a second copy from its start. */
static void send_copies(cyclic_relay_t *r) {
  uint32_t port;
  r->pending = r->copies = 0;
  r->in_turn = r->ports > 1 && is_positional(r->frame, r->length);
  for (port = 0; port < r->ports; port++)
    if (port == 0 || !r->in_turn) send_copy(r, port);
}

/* Whether the datagrams of `other` are those of our sound frame. Compares command, index, length and the
 * upper half of the address. The lower half may hold a position, which slaves increment. */
static int is_answer(const cyclic_relay_t *r, const uint8_t *other, size_t length) {
  int at = FIRST_DATAGRAM;
  if (length < r->length) return 0;
  if (memcmp(other + SOURCE_RUN_AT, r->frame + SOURCE_RUN_AT, 4) != 0) return 0;
  if (((other[SOURCE_PORT_AT] ^ r->frame[SOURCE_PORT_AT]) & ~1u) != 0) return 0;
  while (at > 0) {
    const uint8_t *ours = r->frame + at, *theirs = other + at;
    if (memcmp(ours, theirs, 2) != 0 || memcmp(ours + 4, theirs + 4, 2) != 0 ||
        ((get16(ours + 6) ^ get16(theirs + 6)) & 0x87FF) != 0)
      return 0;
    at = next_datagram(r->frame, r->length, (size_t)at);
  }
  return 1;
}

/* Adds a copy to the answer. Working counters are added. Data comes from the copy that has met slaves;
 * if both copies have, as in a broadcast, the data is ORed. */
static void merge(cyclic_relay_t *r, const uint8_t *copy) {
  int at = FIRST_DATAGRAM;
  if (r->copies++ == 0) {
    memcpy(r->answer, copy, r->length);
    return;
  }
  while (at > 0) {
    uint8_t *to = r->answer + at + DATAGRAM_HEADER;
    const uint8_t *from = copy + at + DATAGRAM_HEADER;
    size_t i, size = get16(r->frame + at + 6) & 0x7FFu;
    uint32_t before = get16(to + size), more = get16(from + size);
    if (before == 0) memcpy(to, from, size);
    for (i = 0; before > 0 && more > 0 && i < size; i++) to[i] |= from[i];
    put16(to + size, before + more);
    at = next_datagram(r->frame, r->length, (size_t)at);
  }
}

/* Takes the frames that a port has received, a limited number in case of a flood. Returns 0 if the port
 * cannot be used for now. */
static int take(cyclic_relay_t *r, uint32_t port) {
  int left = AT_ONCE;
  while (r->pending && left-- > 0) {
    ssize_t length = recv(r->port[port], r->received, sizeof r->received, MSG_DONTWAIT);
    uint32_t sent_by;
    if (length < 0 && errno == EINTR) continue;
    if (length < 0) return errno == EAGAIN; /* others, such as ENETDOWN: cannot be used */
    if (length == 0) return 0;
    cyclic_frame_ring_write(r->frame_ring, r->received, (size_t)length, port, 0, 0);
    if (!is_answer(r, r->received, (size_t)length)) continue;
    sent_by = r->received[SOURCE_PORT_AT] != r->frame[SOURCE_PORT_AT];
    if (!(r->pending >> sent_by & 1)) continue; /* the copy has come already */
    r->pending &= ~(1u << sent_by);
    r->back_at = port;
    merge(r, r->received);
  }
  return 1;
}

/* Receives until all copies are back, or until `until_ns`. Returns the time at which the last copy came
 * back, or 0 if none did. */
static uint64_t receive_copies(cyclic_relay_t *r, uint64_t until_ns) {
  int usable[MAX_PORTS] = {1, 1};
  uint64_t now = cyclic_now(), back = 0;
  while (r->pending && now < until_ns && (usable[0] || (r->ports > 1 && usable[1]))) {
    struct pollfd ports[MAX_PORTS];
    struct timespec left = {(time_t)((until_ns - now) / 1000000000u),
                            (long)((until_ns - now) % 1000000000u)};
    uint32_t port, copies = r->copies;
    for (port = 0; port < r->ports; port++)
      ports[port] = (struct pollfd){usable[port] ? r->port[port] : -1, POLLIN, 0};
    (void)ppoll(ports, r->ports, &left, NULL); /* result not needed: recv() tells */
    for (port = 0; port < r->ports; port++)
      if (usable[port]) usable[port] = take(r, port);
    now = cyclic_now();
    if (r->copies > copies) {
      back = now;
      if (until_ns > now + SECOND_COPY_NS) until_ns = now + SECOND_COPY_NS;
    }
  }
  return back;
}

/* Receives the answer to a frame; returns as receive_copies(). If the frame goes by one port after the
 * other and comes back at the first port, the ring is broken. The frame is then sent by the second port
 * with its data, positions and working counters, and meets the slaves behind the break. If it does not
 * come back at all, the original frame is sent by the second port. */
static uint64_t receive(cyclic_relay_t *r, uint64_t until_ns) {
  uint64_t now = cyclic_now(), back, second;
  if (!r->in_turn) return receive_copies(r, until_ns);
  back = receive_copies(r, until_ns < now ? until_ns : now + (until_ns - now) / 2);
  if (back > 0 && r->back_at == 1) return back;
  if (back > 0)
    memcpy(r->frame + FIRST_DATAGRAM, r->answer + FIRST_DATAGRAM, r->length - FIRST_DATAGRAM);
  r->pending = r->copies = 0;
  send_copy(r, 1);
  second = receive_copies(r, until_ns);
  return second > 0 ? second : back;
}

/* --- serving -------------------------------------------------------------------------------- */

/* Measures the free part of the cycle, from the end of the last exchange to the next deadline. */
static void look_at_free_time(cyclic_relay_t *r) {
  const ecat_shm_header *header = r->engine->header;
  uint64_t end = __atomic_load_n(&header->cycle_end_ns, __ATOMIC_RELAXED);
  uint64_t deadline = cyclic_deadline(r->engine), period = header->cycle_time_ns;
  double part;
  if (end >= deadline || deadline - end > period) return; /* the next deadline is not known yet */
  part = (double)(deadline - end) / (double)period;
  r->free_part += (part - r->free_part) / 8;
  if (r->free_part < FREE_PART_MIN) r->free_part = FREE_PART_MIN;
}

static void account(cyclic_relay_t *r, uint64_t came_ns, uint64_t sent_ns, uint64_t back_ns) {
  uint64_t on_wire = back_ns > 0 ? back_ns - sent_ns : r->typical_ns;
  ecat_shm_health *health;
  if (back_ns > 0) {
    uint64_t most = 4 * r->typical_ns + 10000; /* limits the effect of a delayed frame on the mean */
    r->typical_ns = (7 * r->typical_ns + (on_wire < most ? on_wire : most)) / 8;
  }
  if (r->engine == NULL) return;
  look_at_free_time(r);
  if (r->free_ns < sent_ns) r->free_ns = sent_ns;
  r->free_ns += (uint64_t)((double)on_wire / (r->settings.share * r->free_part));
  health = r->engine->health;
  counter_add(&health->mailbox_frames, 1);
  if (back_ns > 0) {
    counter_add(&health->mailbox_wire_ns, on_wire);
    cyclic_count(&health->mailbox, back_ns - came_ns);
  } else {
    counter_add(&health->mailbox_lost, 1);
  }
}

static void serve(cyclic_relay_t *r) {
  uint64_t came, sent, back;
  ssize_t length = recv(r->client, r->frame, sizeof r->frame, MSG_DONTWAIT);
  if (length == 0) r->client = -1;
  if (length <= 0) return;
  r->length = (size_t)length;
  if (r->length > FRAME_BYTES || !is_sound(r->frame, r->length) ||
      r->frame[INDEX_AT] >= CYCLIC_INDEX_ENGINE)
    return;
  /* The bits above the port number the frames. So a late frame that was given up is not taken for a new
   * one with the same index. */
  r->frame[SOURCE_PORT_AT] = (uint8_t)(++r->number << 1);
  came = cyclic_now();
  if (r->engine != NULL) {
    wait_for_share(r, came);
    wait_for_window(r);
  }
  sent = cyclic_now();
  send_copies(r);
  back = receive(r, sent + r->settings.answer_ns);
  account(r, came, sent, back);
  /* Does not wait for a client that does not read. */
  if (back > 0) (void)send(r->client, r->answer, r->length, MSG_DONTWAIT | MSG_NOSIGNAL);
}

static void *thread_main(void *argument) {
  cyclic_relay_t *r = argument;
  (void)cyclic_thread_become("ecat-relay", r->settings.priority); /* the engine reports it */
  prctl(PR_SET_TIMERSLACK, 1);
  for (;;) {
    struct pollfd fds[] = {{r->stop_fd, POLLIN, 0}, {r->client, POLLIN, 0}};
    (void)ppoll(fds, 2, NULL, NULL);
    if (fds[0].revents) return NULL;
    if (!fds[1].revents) continue;
    pthread_mutex_lock(&r->lock);
    serve(r);
    pthread_mutex_unlock(&r->lock);
  }
}

/* --- life ----------------------------------------------------------------------------------- */

cyclic_relay_t *cyclic_relay_new(int client_fd, int first_fd, int second_fd,
                                 const cyclic_relay_settings *settings) {
  cyclic_relay_t *r;
  int code;
  if (!(settings->share > 0 && settings->share <= 1)) {
    errno = EINVAL;
    return NULL;
  }
  r = calloc(1, sizeof *r);
  if (r == NULL) return NULL;
  r->settings = *settings;
  r->client = client_fd;
  r->port[0] = first_fd;
  r->port[1] = second_fd;
  r->ports = second_fd >= 0 ? 2 : 1;
  r->stop_fd = eventfd(0, EFD_CLOEXEC);
  pthread_mutex_init(&r->lock, NULL);
  code = r->stop_fd < 0 ? errno : -cyclic_thread_start(&r->thread, STACK_BYTES, thread_main, r);
  if (code == 0) return r;
  if (r->stop_fd >= 0) close(r->stop_fd);
  pthread_mutex_destroy(&r->lock);
  free(r);
  errno = code;
  return NULL;
}

void cyclic_relay_follow(cyclic_relay_t *r, cyclic_t *engine) {
  pthread_mutex_lock(&r->lock);
  if (r->engine != NULL) r->engine->relay = NULL;
  r->engine = engine;
  if (engine != NULL) engine->relay = r;
  r->free_ns = 0;
  r->free_part = 1;
  pthread_mutex_unlock(&r->lock);
}

void cyclic_relay_set_frame_ring(cyclic_relay_t *r, cyclic_frame_ring_t *ring) {
  pthread_mutex_lock(&r->lock);
  r->frame_ring = ring;
  pthread_mutex_unlock(&r->lock);
}

void cyclic_relay_set_share(cyclic_relay_t *r, double share, uint64_t patience_ns) {
  if (!(share > 0 && share <= 1)) return;
  pthread_mutex_lock(&r->lock);
  r->settings.share = share;
  r->settings.patience_ns = patience_ns;
  pthread_mutex_unlock(&r->lock);
}

void cyclic_relay_set_socket(cyclic_relay_t *r, uint32_t port, int fd) {
  if (port >= r->ports) return;
  pthread_mutex_lock(&r->lock);
  r->port[port] = fd;
  pthread_mutex_unlock(&r->lock);
}

void cyclic_relay_free(cyclic_relay_t *r) {
  uint64_t one = 1;
  if (r == NULL) return;
  (void)!write(r->stop_fd, &one, sizeof one);
  pthread_join(r->thread, NULL);
  if (r->engine != NULL) r->engine->relay = NULL;
  close(r->stop_fd);
  pthread_mutex_destroy(&r->lock);
  free(r);
}
