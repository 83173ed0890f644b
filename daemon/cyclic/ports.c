/* The ports of the engine: sockets, sending, receiving, and telling answers from foreign frames.
 *
 * With cable redundancy each frame leaves by both ports. On a closed ring the copy of the first port
 * meets all slaves and arrives at the second port; the other copy passes the slaves unprocessed. On a
 * broken ring each copy comes back at its own port and has met the slaves on this side of the break.
 */
#include "engine.h"
#include "frame_ring.h"

#include <arpa/inet.h>
#include <errno.h>
#include <linux/filter.h>
#include <linux/if_packet.h>
#include <net/if.h>
#include <poll.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/timerfd.h>
#include <unistd.h>

int cyclic_filter_index(int fd, uint32_t first, uint32_t last) {
  struct sock_filter code[] = {
      BPF_STMT(BPF_LD | BPF_B | BPF_ABS, INDEX_AT),
      BPF_JUMP(BPF_JMP | BPF_JGE | BPF_K, first, 0, 2),
      BPF_JUMP(BPF_JMP | BPF_JGT | BPF_K, last, 1, 0),
      BPF_STMT(BPF_RET | BPF_K, 0xFFFF),
      BPF_STMT(BPF_RET | BPF_K, 0),
  };
  struct sock_fprog program = {sizeof code / sizeof code[0], code};
  return setsockopt(fd, SOL_SOCKET, SO_ATTACH_FILTER, &program, sizeof program) == 0 ? 0 : -errno;
}

static int configure(int fd, const struct sockaddr_ll *address, uint32_t first, uint32_t last) {
  int one = 1, code = cyclic_filter_index(fd, first, last);
  uint8_t stale[64];
  if (code != 0) return code;
  setsockopt(fd, SOL_PACKET, PACKET_QDISC_BYPASS, &one, sizeof one);
  setsockopt(fd, SOL_PACKET, PACKET_IGNORE_OUTGOING, &one, sizeof one);
  if (bind(fd, (const struct sockaddr *)address, sizeof *address) != 0) return -errno;
  while (recv(fd, stale, sizeof stale, MSG_DONTWAIT) >= 0) continue;
  return 0;
}

int cyclic_open_socket(const char *interface, uint32_t first, uint32_t last) {
  struct sockaddr_ll address = {.sll_family = AF_PACKET, .sll_protocol = htons(ETHERTYPE)};
  int fd, code;
  address.sll_ifindex = (int)if_nametoindex(interface);
  if (address.sll_ifindex == 0) return -ENODEV;
  /* Protocol 0 until the socket is bound: otherwise it would receive frames of all interfaces. */
  fd = socket(AF_PACKET, SOCK_RAW | SOCK_CLOEXEC, 0);
  if (fd < 0) return -errno;
  code = configure(fd, &address, first, last);
  if (code == 0) return fd;
  close(fd);
  return code;
}

/* Sends one event when a port begins to fail, and one when it works again. */
static void tell(cyclic_t *c, uint32_t port, int error) {
  if (!error == !c->send_error[port]) return;
  if (cyclic_emit(c, CYCLIC_EVENT_SEND, -1, (int32_t)port, (uint32_t)error))
    c->send_error[port] = error;
}

static int send_copy(cyclic_t *c, struct frame *frame, uint32_t port) {
  frame->bytes[SOURCE_PORT_AT] = (uint8_t)((frame->bytes[SOURCE_PORT_AT] & ~1u) | port);
  if (send(c->fd[port], frame->bytes, frame->length, MSG_DONTWAIT) != (ssize_t)frame->length)
    return errno;
  frame->pending |= (uint8_t)(1u << port);
  cyclic_frame_ring_write(c->frame_ring, frame->bytes, frame->length, port, 1, c->cycle);
  counter_add(&c->health->frames, 1);
  return 0;
}

void cyclic_ports_send(cyclic_t *c, uint32_t first, uint32_t end) {
  uint32_t i, port;
  int error[MAX_PORTS] = {0, 0};
  c->waiting = 0;
  if (first == 0) c->ring = ECAT_RING_NONE;
  for (i = first; i < end; i++) {
    struct frame *frame = &c->frame[i];
    for (port = 0; port < c->ports; port++) {
      int code = send_copy(c, frame, port);
      if (code == 0) continue;
      error[port] = code;
      counter_add(&c->health->unsent, 1);
    }
    if (frame->pending) c->waiting++;
  }
  for (port = 0; port < c->ports; port++) tell(c, port, error[port]);
}

/* Counts a frame that is not an answer of this cycle, if it is a late frame of ours. */
static void pass_over(cyclic_t *c, uint8_t index) {
  uint32_t domains = c->lost[index & 0x7F], i;
  if (domains == 0) return; /* a second copy of a frame that was complete already */
  c->lost[index & 0x7F] = 0;
  counter_add(&c->health->late, 1);
  for (i = 0; i < c->domains; i++)
    if (domains >> i & 1) counter_add(&c->domain[i].status->late, 1);
}

static void note_ring(cyclic_t *c, const struct frame *frame, const uint8_t *bytes, uint32_t sent_by,
                      uint32_t port) {
  if (sent_by != port) {
    c->ring = ECAT_RING_CLOSED;
  } else if (c->ring != ECAT_RING_CLOSED && port == 0 && frame == &c->frame[0]) {
    c->ring = ECAT_RING_OPEN;
    c->ring_break = get16(bytes + FIRST_DATAGRAM + DATAGRAM_HEADER + STATUS_BYTES);
  } else if (c->ring == ECAT_RING_NONE && port == 1 && frame == &c->frame[0]) {
    c->ring = ECAT_RING_OPEN; /* so far no frame has come back at the first port */
    c->ring_break = 0;
  }
}

static void accept_frame(cyclic_t *c, uint32_t port, size_t length) {
  const uint8_t *bytes = c->receive_buffer;
  struct frame *frame;
  uint32_t number, sent_by = bytes[SOURCE_PORT_AT] & 1u;
  cyclic_frame_ring_write(c->frame_ring, bytes, length, port, 0, c->cycle);
  if (length <= INDEX_AT) return;
  if (memcmp(bytes + SOURCE_RUN_AT, c->source + 1, 4) != 0 || sent_by >= c->ports) return;
  number = (bytes[INDEX_AT] - (c->sent - c->frames)) & 0x7F;
  frame = &c->frame[number < c->frames ? number : 0];
  if (number >= c->frames || !cyclic_frame_is_answer(c, frame, bytes, length)) {
    pass_over(c, bytes[INDEX_AT]);
    return;
  }
  if (!(frame->pending >> sent_by & 1)) return; /* the copy has come already */
  if (c->ports == 1) {
    frame->pending = 0;
    c->waiting--;
    cyclic_frame_take(c, frame, bytes);
    return;
  }
  note_ring(c, frame, bytes, sent_by, port);
  frame->pending &= (uint8_t)~(1u << sent_by);
  cyclic_frame_merge(c, frame, bytes);
  if (frame->pending && !cyclic_frame_complete(c, frame, frame->answer)) return;
  frame->pending = 0;
  c->waiting--;
  cyclic_frame_take(c, frame, frame->answer);
}

enum { DRAIN_FRAMES = 128 }; /* frames taken before the time is read again, in case of a flood */

/* Takes the frames that a port has received. Returns 0 if its socket cannot be used in this cycle. */
static int drain(cyclic_t *c, uint32_t port) {
  int i;
  for (i = 0; c->waiting > 0 && i < DRAIN_FRAMES; i++) {
    ssize_t length = recv(c->fd[port], c->receive_buffer, sizeof c->receive_buffer, MSG_DONTWAIT);
    if (length > 0)
      accept_frame(c, port, (size_t)length);
    else if (length < 0 && errno == EAGAIN)
      return 1;
    else if (length == 0 || errno != EINTR)
      return 0; /* such as ENETDOWN: the next cycle tries again */
  }
  return 1;
}

static void set_timer(cyclic_t *c, uint64_t deadline_ns) {
  struct itimerspec at = {.it_value = {(time_t)(deadline_ns / 1000000000u),
                                       (long)(deadline_ns % 1000000000u)}};
  timerfd_settime(c->timer_fd, TFD_TIMER_ABSTIME, &at, NULL);
}

/* Sleeps until a frame is there, or the timer rings. */
static void sleep_until_readable(cyclic_t *c, const int *usable) {
  struct pollfd sources[MAX_PORTS + 1];
  uint32_t i;
  for (i = 0; i < c->ports; i++) sources[i] = (struct pollfd){usable[i] ? c->fd[i] : -1, POLLIN, 0};
  sources[i] = (struct pollfd){c->timer_fd, POLLIN, 0};
  (void)ppoll(sources, c->ports + 1, NULL, NULL); /* result not needed: the next recv tells */
}

/* Waits for a frame; returns 0 after the deadline. If answers usually come within poll_ns, it first
 * returns at once, so that the caller polls: sleeping and waking up takes longer than a short round
 * trip. Then it sets the timer once, returns so that the caller checks the sockets once more, and after
 * that sleeps. A time-out of ppoll would cost time in each call, even if the answer is there. */
static int wait_for_frame(cyclic_t *c, uint64_t deadline_ns, const int *usable, int *timer_set) {
  uint64_t now = cyclic_now();
  int soon = c->typical_ns < c->settings.poll_ns;
  if (now >= deadline_ns) return 0;
  if (c->settings.busy_receive || (soon && now - c->send_ns < (uint64_t)c->settings.poll_ns)) return 1;
  if (*timer_set) {
    sleep_until_readable(c, usable);
  } else {
    set_timer(c, deadline_ns);
    *timer_set = 1;
  }
  return 1;
}

/* Gives up waiting for a frame. If one of its copies is back, the data of this copy is taken over. */
static void give_up(cyclic_t *c, struct frame *frame) {
  uint32_t i;
  if (frame->copies > 0) {
    cyclic_frame_take(c, frame, frame->answer);
  } else {
    uint32_t index = frame->bytes[INDEX_AT] & 0x7Fu;
    counter_add(&c->health->lost, 1);
    for (i = 0; i < c->domains; i++)
      if (frame->domains >> i & 1) {
        c->domain[i].complete = c->domain[i].whole = 0;
        counter_add(&c->domain[i].status->lost, 1);
      }
    c->lost[index] = frame->domains | 1u << 31; /* to recognize the frame if it comes late */
    if (frame == &c->frame[0]) c->silent++;
  }
  frame->pending = 0;
}

/* Marks the domains of a frame that could not be sent as incomplete. */
static void leave_out(cyclic_t *c, const struct frame *frame) {
  uint32_t i;
  for (i = 0; i < c->domains; i++)
    if (frame->domains >> i & 1) {
      c->domain[i].complete = c->domain[i].whole = 0;
      counter_add(&c->domain[i].status->unsent, 1);
    }
  if (frame == &c->frame[0]) c->silent++;
}

void cyclic_ports_leave_out(cyclic_t *c, uint32_t first, uint32_t end) {
  for (; first < end; first++) leave_out(c, &c->frame[first]);
}

void cyclic_ports_receive(cyclic_t *c, uint32_t first, uint32_t end, uint64_t deadline_ns) {
  int usable[MAX_PORTS] = {1, 1}, timer_set = 0;
  uint32_t i, port;
  for (i = first; i < end; i++)
    if (!c->frame[i].pending) leave_out(c, &c->frame[i]);
  while (c->waiting > 0 && (usable[0] || (c->ports > 1 && usable[1]))) {
    for (port = 0; port < c->ports; port++)
      if (usable[port]) usable[port] = drain(c, port);
    if (c->waiting > 0 && !wait_for_frame(c, deadline_ns, usable, &timer_set)) break;
  }
  for (i = first; c->waiting > 0 && i < end; i++)
    if (c->frame[i].pending) {
      give_up(c, &c->frame[i]);
      c->waiting--;
    }
}
