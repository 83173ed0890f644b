/* Frames: building, sending, receiving, and telling them from those of others. */
#include "engine.h"

#include <arpa/inet.h>
#include <errno.h>
#include <linux/filter.h>
#include <linux/if_packet.h>
#include <net/if.h>
#include <poll.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#define ETHERTYPE_ETHERCAT 0x88A4

static void put16(uint8_t *at, uint32_t value) {
  at[0] = (uint8_t)value;
  at[1] = (uint8_t)(value >> 8);
}
static void put32(uint8_t *at, uint32_t value) {
  put16(at, value);
  put16(at + 2, value >> 16);
}
static uint32_t get16(const uint8_t *at) { return (uint32_t)(at[0] | at[1] << 8); }

int cyclic_filter_index(int fd, int above, uint32_t limit) {
  struct sock_filter code[] = {
      BPF_STMT(BPF_LD | BPF_B | BPF_ABS, INDEX_AT),
      BPF_JUMP(BPF_JMP | BPF_JGE | BPF_K, limit, (uint8_t)(above ? 0 : 1), (uint8_t)(above ? 1 : 0)),
      BPF_STMT(BPF_RET | BPF_K, 0xFFFF),
      BPF_STMT(BPF_RET | BPF_K, 0),
  };
  struct sock_fprog program = {sizeof code / sizeof code[0], code};
  return setsockopt(fd, SOL_SOCKET, SO_ATTACH_FILTER, &program, sizeof program) == 0 ? 0 : -errno;
}

int cyclic_wire_open(cyclic_t *c, const char *interface) {
  struct sockaddr_ll address = {.sll_family = AF_PACKET,
                                .sll_protocol = htons(ETHERTYPE_ETHERCAT)};
  int one = 1, code;
  uint8_t stale[64];
  address.sll_ifindex = (int)if_nametoindex(interface);
  if (address.sll_ifindex == 0) return -ENODEV;
  /* Protocol 0 until it is bound: otherwise frames of every interface would come in meanwhile. */
  c->socket_fd = socket(AF_PACKET, SOCK_RAW | SOCK_CLOEXEC, 0);
  if (c->socket_fd < 0) return -errno;
  code = cyclic_filter_index(c->socket_fd, 1, INDEX_FIRST);
  if (code != 0) return code;
  setsockopt(c->socket_fd, SOL_PACKET, PACKET_QDISC_BYPASS, &one, sizeof one);
  setsockopt(c->socket_fd, SOL_PACKET, PACKET_IGNORE_OUTGOING, &one, sizeof one);
  if (bind(c->socket_fd, (const struct sockaddr *)&address, sizeof address) != 0) return -errno;
  while (recv(c->socket_fd, stale, sizeof stale, MSG_DONTWAIT) >= 0) continue;
  return 0;
}

/* Lays a frame out once; per cycle only index, outputs and working counters are written. */
static void build(cyclic_t *c, struct frame *frame) {
  static const uint8_t ethernet[ETHERNET_HEADER] = {0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0x03,
                                                    0x01, 0x01, 0x01, 0x01, 0x01, 0x88, 0xA4};
  uint8_t *at = frame->bytes + ETHERNET_HEADER + ETHERCAT_HEADER;
  uint32_t i;
  memset(frame->bytes, 0, sizeof frame->bytes);
  memcpy(frame->bytes, ethernet, sizeof ethernet);
  for (i = 0; i < frame->count; i++) {
    const struct datagram *d = &c->datagram[frame->first + i];
    int more = i + 1 < frame->count;
    at[0] = d->command;
    put32(at + 2, d->address + d->offset);
    put16(at + 6, d->length | (more ? 0x8000u : 0));
    at += DATAGRAM_HEADER + d->length + DATAGRAM_WKC;
  }
  frame->length = (uint32_t)(at - frame->bytes);
  put16(frame->bytes + ETHERNET_HEADER,
        (frame->length - ETHERNET_HEADER - ETHERCAT_HEADER) | 0x1000u);
  if (frame->length < ETHERNET_MIN) frame->length = ETHERNET_MIN;
}

/* Puts the datagrams of each domain into as few frames as their order allows. */
int cyclic_wire_plan(cyclic_t *c) {
  uint32_t i, payload = 0;
  c->frames = 0;
  for (i = 0; i < c->datagrams; i++) {
    uint32_t size = DATAGRAM_HEADER + c->datagram[i].length + DATAGRAM_WKC;
    struct frame *frame = c->frames > 0 ? &c->frame[c->frames - 1] : NULL;
    if (frame == NULL || frame->domain != c->datagram[i].domain || payload + size > PAYLOAD_MAX) {
      if (c->frames == MAX_FRAMES) return -ENOSPC;
      frame = &c->frame[c->frames++];
      memset(frame, 0, sizeof *frame);
      frame->first = i;
      frame->domain = c->datagram[i].domain;
      payload = 0;
    }
    frame->count++;
    payload += size;
  }
  for (i = 0; i < c->frames; i++) build(c, &c->frame[i]);
  return 0;
}

static int is_due(const cyclic_t *c, const struct frame *frame) {
  return c->cycle % c->domain[frame->domain].divider == 0;
}

/* How many bytes of a datagram are outputs: they lie in front. */
static uint32_t output_part(const struct datagram *d, const struct domain *domain) {
  if (d->offset >= domain->output_bytes) return 0;
  return d->length < domain->output_bytes - d->offset ? d->length
                                                      : domain->output_bytes - d->offset;
}

static void refresh(cyclic_t *c, struct frame *frame) {
  uint8_t *at = frame->bytes + ETHERNET_HEADER + ETHERCAT_HEADER;
  uint32_t i;
  for (i = 0; i < frame->count; i++) {
    const struct datagram *d = &c->datagram[frame->first + i];
    uint32_t outputs = output_part(d, &c->domain[d->domain]);
    at[1] = frame->index;
    memcpy(at + DATAGRAM_HEADER, c->domain[d->domain].image + d->offset, outputs);
    at += DATAGRAM_HEADER + d->length + DATAGRAM_WKC;
  }
}

void cyclic_wire_send(cyclic_t *c) {
  uint32_t i;
  int error = 0;
  for (i = 0; i < c->frames; i++) {
    struct frame *frame = &c->frame[i];
    frame->pending = 0;
    if (!is_due(c, frame)) continue;
    frame->index = c->next_index;
    c->next_index = c->next_index == 0xFF ? INDEX_FIRST : (uint8_t)(c->next_index + 1);
    refresh(c, frame);
    if (send(c->socket_fd, frame->bytes, frame->length, MSG_DONTWAIT) == (ssize_t)frame->length) {
      frame->pending = 1;
      counter_add(&c->health->frames, 1);
    } else {
      error = errno;
      c->domain[frame->domain].complete = 0;
      counter_add(&c->health->send_errors, 1);
    }
  }
  if (!error != !c->sending_fails) {
    c->sending_fails = error != 0;
    cyclic_emit(c, CYCLIC_EVENT_SEND, -1, -1, (uint32_t)error);
  }
}

/* Whether a frame is the answer to ours: all datagrams are where they were sent. */
static int is_answer(const cyclic_t *c, const struct frame *frame, const uint8_t *bytes,
                     size_t length) {
  size_t at = ETHERNET_HEADER + ETHERCAT_HEADER;
  uint32_t i;
  if (length < frame->length) return 0;
  for (i = 0; i < frame->count; i++) {
    if (memcmp(bytes + at, frame->bytes + at, DATAGRAM_HEADER - 2) != 0) return 0;
    at += DATAGRAM_HEADER + c->datagram[frame->first + i].length + DATAGRAM_WKC;
  }
  return 1;
}

/* Takes the inputs of a frame that came back. */
static void take(cyclic_t *c, struct frame *frame, const uint8_t *bytes) {
  const uint8_t *at = bytes + ETHERNET_HEADER + ETHERCAT_HEADER;
  uint32_t i;
  for (i = 0; i < frame->count; i++) {
    const struct datagram *d = &c->datagram[frame->first + i];
    struct domain *domain = &c->domain[d->domain];
    uint32_t outputs = output_part(d, domain);
    uint32_t wkc = get16(at + DATAGRAM_HEADER + d->length);
    domain->wkc += wkc;
    if (wkc == d->wkc_expected)
      memcpy(domain->image + d->offset + outputs, at + DATAGRAM_HEADER + outputs,
             d->length - outputs);
    else
      domain->complete = 0;
    at += DATAGRAM_HEADER + d->length + DATAGRAM_WKC;
  }
  frame->pending = 0;
}

static struct frame *find_pending(cyclic_t *c, uint8_t index) {
  uint32_t i;
  for (i = 0; i < c->frames; i++)
    if (c->frame[i].pending && c->frame[i].index == index) return &c->frame[i];
  return NULL;
}

/* Sleeps until a frame is there; 0 when the deadline is over. */
static int wait_readable(cyclic_t *c, uint64_t deadline_ns) {
  struct pollfd poll_fd = {c->socket_fd, POLLIN, 0};
  struct timespec left;
  uint64_t now = cyclic_now();
  if (now >= deadline_ns) return 0;
  if (c->settings.busy_receive) return 1;
  left.tv_sec = (time_t)((deadline_ns - now) / 1000000000u);
  left.tv_nsec = (long)((deadline_ns - now) % 1000000000u);
  (void)ppoll(&poll_fd, 1, &left, NULL); /* whatever it says, the next recv knows */
  return 1;
}

void cyclic_wire_receive(cyclic_t *c, uint64_t deadline_ns) {
  uint32_t i, waiting = 0;
  for (i = 0; i < c->frames; i++) waiting += c->frame[i].pending;
  while (waiting > 0) {
    ssize_t length = recv(c->socket_fd, c->receive_buffer, sizeof c->receive_buffer, MSG_DONTWAIT);
    struct frame *frame;
    if (length < 0) {
      if (errno == EINTR || (errno == EAGAIN && wait_readable(c, deadline_ns))) continue;
      break; /* late, or ENETDOWN: the next cycle is soon enough to try again */
    }
    if (length <= INDEX_AT) continue;
    frame = find_pending(c, c->receive_buffer[INDEX_AT]);
    if (frame != NULL && is_answer(c, frame, c->receive_buffer, (size_t)length)) {
      take(c, frame, c->receive_buffer);
      waiting--;
    } else {
      counter_add(&c->health->late, 1);
    }
  }
  for (i = 0; i < c->frames; i++)
    if (c->frame[i].pending) c->domain[c->frame[i].domain].complete = 0;
  counter_add(&c->health->lost, waiting);
}
