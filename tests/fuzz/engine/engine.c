/* The cyclic engine between a bus and clients that do what they must not.
 *
 * usage: engine SEED CYCLES PORTS
 *
 * Socket pairs stand for the interfaces. The bus answers each frame with inputs that count its
 * frames, the same number in every word, and then loses, holds back, repeats, cuts, lengthens or
 * damages answers, or invents some. Clients write random bytes over the .out file and cut it
 * short; one of them claims and commits as it should, but whatever it likes. Meanwhile sockets are
 * replaced, events and images are read. What must hold: an image is that of one frame, no older
 * frame is taken after a newer one, nobody owns what nobody may, and no output leaves the bits that it
 * was declared with, nor the range, which changes meanwhile.
 * Prints what was reached, as JSON.
 */
#include "../random.h"
#include "engine.h"

#include <errno.h>
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
  CYCLE_NS = 200000,
  SLAVES = 3,
  WORDS = 4,                /* of 8 bytes: outputs, and as many inputs, of a slave */
  SLAVE_BYTES = 8 * WORDS,
  ENTRIES = 16,             /* of 2 bytes: 15 outputs and an input; 2 bytes of outputs have none */
  SIGNALS = SLAVES * ENTRIES,
  LIMITED = 0, CONTROL = 1, COPIED = 2, STATUS = ENTRIES - 1, /* entries of each slave */
  LIMIT = 100, INNER = 50,  /* from -LIMIT to -INNER, and then from INNER to LIMIT, by turns */
  LIAR = 5,                 /* slot of the client that knows the protocol */
  DOMAINS = 2,              /* slave 0 has one for itself; the other one comes every third cycle */
  RUN = 0x600DCAFE,
  HELD = 64,
  OUT_BYTES = 1 << 18
};

static struct {
  unsigned long answers, damaged, invented, held, swaps, events, snapshots, truncated, copied, ranges;
} reached;
static cyclic_t *engine;
static int stop;
static uint8_t *shm;
static int out_fd, far[MAX_PORTS], ports;
static pthread_mutex_t wires = PTHREAD_MUTEX_INITIALIZER; /* guards far[] */
static int wanted; /* somebody waits for them; mutexes are not fair */

static void die(const char *what) {
  fprintf(stderr, "engine: %s\n", what);
  exit(1);
}

static int stopping(void) { return __atomic_load_n(&stop, __ATOMIC_RELAXED); }

/* --- the bus ------------------------------------------------------------------------------- */

struct held {
  uint8_t bytes[2048];
  size_t size;
  int port;
} held[HELD], *newest;

static void put_out(const uint8_t *bytes, size_t size, int port) {
  (void)send(far[port], bytes, size, MSG_DONTWAIT);
}

/* Whether a value is in one of the two ranges that entries have by turns, or safe. */
static int is_allowed(int value) {
  if (value < 0) value = -value;
  return value == 0 || (value >= INNER && value <= LIMIT);
}

/* Outputs of the slaves as they arrive: some entries have a range, their last bytes no entry. */
static void check_outputs(const uint8_t *data, uint32_t slaves) {
  uint32_t i;
  for (i = 0; i < slaves; i++, data += SLAVE_BYTES) {
    int16_t value = (int16_t)get16(data + 2 * LIMITED), copy = (int16_t)get16(data + 2 * COPIED);
    if (!is_allowed(value)) die("a value left its declared ranges");
    if (!is_allowed(copy)) die("a copy left its declared ranges");
    reached.copied += copy != 0;
    if (get16(data + SLAVE_BYTES - 2) != 0) die("bits of no entry were written");
  }
}

/* What slaves do with a frame. */
static void process(uint8_t *bytes, size_t size, uint64_t *number) {
  size_t at = FIRST_DATAGRAM;
  int more = 1;
  ++*number;
  while (more && at + DATAGRAM_FRAMING <= size) {
    uint32_t flags = get16(bytes + at + 6), length = flags & 0x7FF;
    uint8_t *data = bytes + at + DATAGRAM_HEADER, command = bytes[at];
    uint32_t wkc = 0, i;
    if (command == 7) {
      data[0] |= 8;
      put16(bytes + at + 2, get16(bytes + at + 2) + SLAVES);
      wkc = SLAVES;
    } else if (command == 14) {
      put64(data, *number * CYCLE_NS + 12345);
      wkc = SLAVES;
    } else if (command == CYCLIC_LRW) {
      uint32_t slaves = length / (2 * SLAVE_BYTES);
      check_outputs(data, slaves);
      for (i = length / 2; i + 8 <= length; i += 8) put64(data + i, *number);
      wkc = 3 * slaves;
    }
    put16(data + length, get16(data + length) + wkc);
    more = (flags & 0x8000) != 0;
    at += DATAGRAM_FRAMING + length;
  }
}

static void damage(struct source *source, uint8_t *bytes, size_t *size) {
  reached.damaged++;
  switch (below(source, 4)) {
  case 0: *size = below(source, (uint32_t)*size); break;
  case 1: *size += below(source, 64); break;
  case 2: bytes[below(source, FIRST_DATAGRAM + DATAGRAM_HEADER)] ^= (uint8_t)(1u << below(source, 8)); break;
  default: { /* a working counter, the first or the last one, to what no slaves can count to */
    size_t at = one_in(source, 2) ? FIRST_DATAGRAM + DATAGRAM_HEADER + STATUS_BYTES : *size - 2;
    if (at + 1 < *size) bytes[at + 1] ^= (uint8_t)(1 + below(source, 255));
  }
  }
}

static void invent(struct source *source, const uint8_t *like, size_t size, int port) {
  uint8_t bytes[2048] = {0};
  reached.invented++;
  if (one_in(source, 2)) {
    size = below(source, 1600);
    fill(source, bytes, size);
  } else { /* like ours, but of another run: with inputs that would show */
    memcpy(bytes, like, size);
    fill(source, bytes + SOURCE_RUN_AT, 4);
    memset(bytes + size / 2, 0xEE, size - size / 2);
  }
  put_out(bytes, size, port);
}

static void release(struct source *source) {
  struct held *one = one_in(source, 2) ? newest : &held[below(source, HELD)];
  if (one == NULL || one->size == 0) return;
  put_out(one->bytes, one->size, one->port);
  if (!one_in(source, 3)) one->size = 0; /* else it comes once more */
}

static void answer(struct source *source, uint8_t *bytes, size_t size, int from) {
  static uint64_t number;
  /* A closed ring, most of the time; the second copy then meets nobody. */
  static int open;
  int to = ports == 1 ? 0 : open ? from : 1 - from;
  if (ports == 2 && one_in(source, 500)) open = !open;
  if (from == 0) process(bytes, size, &number);
  reached.answers++;
  switch (below(source, 40)) {
  case 0: return;
  case 1: put_out(bytes, size, to); break;
  case 2: damage(source, bytes, &size); break;
  case 3: invent(source, bytes, size, to); break;
  case 4: {
    struct held *one = &held[below(source, HELD)];
    memcpy(one->bytes, bytes, size);
    one->size = size;
    one->port = to;
    newest = one;
    reached.held++;
    return;
  }
  case 5: release(source); break;
  default: break;
  }
  put_out(bytes, size, to);
}

static void *bus(void *argument) {
  struct source source = source_from((uint64_t)(uintptr_t)argument + 1);
  static uint8_t bytes[2048];
  while (!stopping()) {
    struct pollfd fds[MAX_PORTS];
    int i;
    pthread_mutex_lock(&wires);
    for (i = 0; i < ports; i++) fds[i] = (struct pollfd){far[i], POLLIN, 0};
    if (poll(fds, (nfds_t)ports, 1) > 0)
      for (i = 0; i < ports; i++) {
        ssize_t size = recv(far[i], bytes, sizeof bytes, MSG_DONTWAIT);
        if (size > FIRST_DATAGRAM) answer(&source, bytes, (size_t)size, i);
      }
    pthread_mutex_unlock(&wires);
    while (__atomic_load_n(&wanted, __ATOMIC_RELAXED) && !stopping()) sched_yield();
  }
  return NULL;
}

/* --- clients and control -------------------------------------------------------------------- */

/* All that the engine believes, but with values that no one has checked. */
static void lie(struct source *source, const ecat_out_header *header, ecat_out_doorbell *bell) {
  uint8_t image[sizeof(ecat_out_image) + 2 * SLAVES * SLAVE_BYTES], claims[8];
  ecat_out_image *head = (void *)image;
  off_t slot = (off_t)header->slots_offset + LIAR * (off_t)header->slot_stride;
  off_t door = (off_t)header->doorbells_offset + LIAR * (off_t)sizeof *bell;
  fill(source, image, sizeof image);
  head->seq = ++bell->commit_seq;
  head->first = 0;
  head->bytes = SLAVES * SLAVE_BYTES;
  if (one_in(source, 50) || bell->generation == 0) bell->generation++;
  if (!one_in(source, 10)) head->generation = bell->generation;
  if (one_in(source, 20) || bell->claim_seq == 0) {
    memset(claims, one_in(source, 2) ? 0xFF : (int)below(source, 256), sizeof claims);
    (void)!pwrite(out_fd, claims, sizeof claims, slot + header->claims_offset);
    bell->claim_seq++;
  }
  bell->heartbeat++;
  (void)!pwrite(out_fd, image, sizeof image,
                slot + header->images_offset + head->seq % ECAT_IMAGES * header->image_stride);
  (void)!pwrite(out_fd, bell, sizeof *bell, door);
}

static void *clients(void *argument) {
  struct source source = source_from((uint64_t)(uintptr_t)argument + 2);
  uint8_t junk[256];
  ecat_out_header header;
  ecat_out_doorbell bell = {0};
  if (pread(out_fd, &header, sizeof header, 0) != sizeof header) die("no .out file");
  while (!stopping()) {
    uint32_t at = header.doorbells_offset + below(&source, OUT_BYTES - header.doorbells_offset - 256);
    if (one_in(&source, 2)) at = header.doorbells_offset + 4 * below(&source, 8 * ECAT_SLOTS);
    fill(&source, junk, sizeof junk);
    if (one_in(&source, 200)) {
      (void)!ftruncate(out_fd, below(&source, OUT_BYTES));
      reached.truncated++;
      sched_yield();
      (void)!ftruncate(out_fd, OUT_BYTES);
    }
    if (one_in(&source, 4)) (void)!pwrite(out_fd, junk, 1 + below(&source, 64), at);
    lie(&source, &header, &bell);
    nanosleep(&(struct timespec){0, 50000}, NULL);
  }
  return NULL;
}

static const ecat_shm_page *page(const cyclic_t *c, int domain) { return c->domain[domain].page; }

/* An image as clients read it; 0 while the engine writes. */
static int snapshot(const ecat_shm_page *from, uint64_t *words, size_t count) {
  const uint64_t *data = (const uint64_t *)(from + 1);
  uint64_t before = __atomic_load_n(&from->seq, __ATOMIC_ACQUIRE);
  size_t i;
  for (i = 0; i < count; i++) words[i] = __atomic_load_n(&data[i], __ATOMIC_RELAXED);
  __atomic_thread_fence(__ATOMIC_ACQUIRE);
  return before % 2 == 0 && __atomic_load_n(&from->seq, __ATOMIC_RELAXED) == before;
}

static void *reader(void *argument) {
  static uint64_t last[DOMAINS];
  const cyclic_t *c = argument;
  while (!stopping()) {
    int domain, i;
    for (domain = 0; domain < DOMAINS; domain++) {
      int words = domain == 0 ? WORDS : (SLAVES - 1) * WORDS;
      uint64_t image[2 * SLAVES * WORDS];
      if (!snapshot(page(c, domain), image, (size_t)(2 * words))) continue;
      for (i = words; i < 2 * words; i++)
        if (image[i] != image[words]) die("an image of two frames");
      if (image[words] < last[domain]) die("an older frame was taken after a newer one");
      if (image[words] == 0xEEEEEEEEEEEEEEEEu) die("a frame of another run was taken");
      last[domain] = image[words];
      reached.snapshots++;
    }
    nanosleep(&(struct timespec){0, 20000}, NULL);
  }
  return NULL;
}

static void *control(void *argument) {
  struct source source = source_from((uint64_t)(uintptr_t)argument + 3);
  const ecat_shm_output *outputs = engine->output;
  ecat_shm_slave_status *status = (void *)(shm + engine->header->slave_status_offset);
  while (!stopping()) {
    cyclic_event event;
    int i;
    while (cyclic_wait_event(engine, &event, 1000000)) {
      reached.events++;
      if (event.type == CYCLIC_EVENT_REQUEST) {
        cyclic_listen(engine, (uint32_t)event.slot);
        cyclic_reply(engine, (uint32_t)event.slot, below(&source, 8), event.value, 1, 0, 0, "x", 1);
      }
      if (stopping()) return NULL;
    }
    __atomic_store_n(&status[below(&source, SLAVES)].al_state, one_in(&source, 4) ? 4 : 8,
                     __ATOMIC_RELAXED);
    for (i = 0; i < SIGNALS; i++) {
      int owner = __atomic_load_n(&outputs[i].owner, __ATOMIC_RELAXED);
      if (owner < -1 || owner >= ECAT_SLOTS) die("an owner that is no slot");
      if (owner != -1 && i % ENTRIES == COPIED) die("a copy has an owner");
    }
  }
  return NULL;
}

static int new_pair(int port) {
  int pair[2];
  if (socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, pair) != 0) die("no socket pair");
  far[port] = pair[1];
  return pair[0];
}

/* The interface goes, and comes back as another one. */
static void swap_socket(int *near, int port) {
  int old_near = *near, old_far, fresh;
  __atomic_store_n(&wanted, 1, __ATOMIC_RELAXED);
  pthread_mutex_lock(&wires);
  __atomic_store_n(&wanted, 0, __ATOMIC_RELAXED);
  old_far = far[port];
  fresh = new_pair(port);
  pthread_mutex_unlock(&wires);
  close(old_far); /* sending fails now */
  cyclic_set_socket(engine, (uint32_t)port, fresh);
  close(old_near);
  *near = fresh;
  reached.swaps++;
}

/* The configuration is read again, and has other limits. */
static void swap_ranges(void) {
  ecat_shm_signal *signals = (void *)(shm + engine->header->signals_offset);
  uint32_t held[SIGNALS];
  int i, up = reached.ranges % 2 == 0;
  for (i = 0; i < SIGNALS; i++) {
    if (i % ENTRIES != LIMITED && i % ENTRIES != COPIED) continue;
    signals[i].minimum = up ? INNER : -LIMIT;
    signals[i].maximum = up ? LIMIT : -INNER;
  }
  if (cyclic_use_limits(engine, held, SIGNALS) < 0) die("other limits were refused");
  reached.ranges++;
}

/* --- the shared memory ----------------------------------------------------------------------- */

static uint32_t place(uint32_t *end, size_t size) {
  uint32_t at = *end;
  *end += (uint32_t)((size + 63) / 64 * 64);
  return at;
}

static void fill_header(ecat_shm_header *h) {
  uint32_t end = sizeof *h, i;
  uint32_t slaves_in[DOMAINS] = {1, SLAVES - 1}, base = 0;
  ecat_shm_slave *slaves;
  ecat_shm_domain *domains;
  ecat_shm_signal *signals;
  h->cycle_time_ns = CYCLE_NS;
  h->lease_ns = 2 * CYCLE_NS;
  h->lease_max_ns = 100 * CYCLE_NS;
  h->slave_count = SLAVES;
  h->domain_count = DOMAINS;
  h->slot_count = ECAT_SLOTS;
  h->output_bytes = SLAVES * SLAVE_BYTES;
  end = (end + 63) / 64 * 64;
  h->slaves_offset = place(&end, SLAVES * sizeof *slaves);
  h->domains_offset = place(&end, DOMAINS * sizeof *domains);
  h->slave_status_offset = place(&end, SLAVES * sizeof(ecat_shm_slave_status));
  h->signal_count = SIGNALS;
  h->signals_offset = place(&end, SIGNALS * sizeof *signals);
  h->outputs_offset = place(&end, SIGNALS * sizeof(ecat_shm_output));
  h->slot_status_offset = place(&end, ECAT_SLOTS * sizeof(ecat_shm_slot_status));
  h->replies_offset = place(&end, ECAT_SLOTS * ECAT_REQUESTS * sizeof(ecat_shm_reply));
  h->domain_status_offset = place(&end, DOMAINS * sizeof(ecat_shm_domain_status));
  h->settings_offset = place(&end, ECAT_SETTINGS * sizeof(ecat_shm_setting));
  h->health_offset = place(&end, sizeof(ecat_shm_health));
  slaves = (void *)(shm + h->slaves_offset);
  domains = (void *)(shm + h->domains_offset);
  signals = (void *)(shm + h->signals_offset);
  for (i = 0; i < DOMAINS; i++) {
    uint32_t bytes = slaves_in[i] * SLAVE_BYTES;
    domains[i].image_bytes = 2 * bytes;
    domains[i].output_bytes = bytes;
    domains[i].output_base = base;
    domains[i].divider = i == 0 ? 1 : 3;
    domains[i].wkc_expected = 3 * slaves_in[i];
    domains[i].page_offset = place(&end, sizeof(ecat_shm_page) + 2 * bytes);
    base += bytes;
  }
  for (i = 0; i < SLAVES; i++) {
    slaves[i].domain = i > 0;
    slaves[i].output_bytes = slaves[i].input_bytes = SLAVE_BYTES;
    slaves[i].output_offset = i > 0 ? (i - 1) * SLAVE_BYTES : 0;
  }
  /* The last byte of each output belongs to no entry. */
  for (i = 0; i < SIGNALS; i++) {
    uint32_t slave = i / ENTRIES, entry = i % ENTRIES, bytes = slaves_in[slave > 0] * SLAVE_BYTES;
    signals[i].slave = (uint16_t)slave;
    signals[i].domain = slave > 0;
    signals[i].output = entry < ENTRIES - 1;
    signals[i].type = 0x0003; /* INTEGER16 */
    signals[i].bit_length = 16;
    signals[i].minimum = entry == LIMITED || entry == COPIED ? -LIMIT : -HUGE_VAL;
    signals[i].maximum = entry == LIMITED || entry == COPIED ? -INNER : HUGE_VAL;
    signals[i].bit_offset = 8 * (slaves[slave].output_offset + 2 * entry);
    if (!signals[i].output) signals[i].bit_offset = 8 * (bytes + slaves[slave].output_offset);
  }
}

static void fill_out(void) {
  ecat_out_header header = {.slot_count = ECAT_SLOTS, .doorbells_offset = 4096, .slots_offset = 8192};
  header.claims_offset =
      (uint32_t)(sizeof(ecat_out_slot) + ECAT_REQUESTS * sizeof(ecat_out_request));
  header.images_offset = header.claims_offset + (SIGNALS + 63) / 64 * 8;
  header.image_stride = (uint32_t)(sizeof(ecat_out_image) + 2 * (SLAVES * SLAVE_BYTES + 8));
  header.slot_stride = header.images_offset + ECAT_IMAGES * header.image_stride;
  out_fd = memfd_create("out", MFD_CLOEXEC);
  if (out_fd < 0 || ftruncate(out_fd, OUT_BYTES) != 0 ||
      pwrite(out_fd, &header, sizeof header, 0) != sizeof header)
    die("no .out file");
}

/* Exchanges of the first domain that arrived whole and in time. On a busy machine most are late. */
static uint64_t good_exchanges(void) {
  const ecat_shm_domain_status *status = engine->domain[0].status;
  return __atomic_load_n(&status->exchanges, __ATOMIC_RELAXED) -
         __atomic_load_n(&status->wkc_bad, __ATOMIC_RELAXED);
}

int main(int count, char **arguments) {
  cyclic_settings settings = {.cpu = -1};
  cyclic_clock clock = {.address = 0x1000, .phase_ns = 1000, .lock_ns = 20000};
  pthread_t threads[4];
  void *(*const roles[4])(void *) = {bus, clients, reader, control};
  int near[MAX_PORTS] = {-1, -1}, i;
  uint64_t seed, cycles, good;
  if (count != 5) die("usage: engine SEED CYCLES PORTS GOOD_EXCHANGES");
  seed = strtoull(arguments[1], NULL, 0);
  cycles = strtoull(arguments[2], NULL, 0);
  ports = atoi(arguments[3]);
  good = strtoull(arguments[4], NULL, 0);
  shm = aligned_alloc(64, 1 << 20);
  if (shm == NULL || ports < 1 || ports > MAX_PORTS) die("cannot begin");
  memset(shm, 0, 1 << 20);
  fill_header((ecat_shm_header *)(void *)shm);
  fill_out();
  for (i = 0; i < ports; i++) near[i] = new_pair(i);
  engine = cyclic_new(shm, out_fd, near[0], near[1], RUN);
  if (engine == NULL) die("no engine");
  for (i = 0; i < DOMAINS; i++)
    if (cyclic_add_datagram(engine, (uint32_t)i, CYCLIC_LRW, 0x100000u * (uint32_t)(i + 1), 0,
                            engine->domain[i].image_bytes, engine->domain[i].wkc_expected, -1, 0,
                            0) != 0)
      die("a datagram was refused");
  for (i = 0; i < SLAVES; i++) {
    uint32_t first = (uint32_t)(i * ENTRIES);
    if (cyclic_set_stop(engine, first + CONTROL, first + STATUS, 2, 3 * CYCLE_NS) != 0)
      die("a stop was refused");
    if (cyclic_set_follow(engine, first + STATUS, first + LIMITED, (int32_t)first + CONTROL) != 0)
      die("a safe value that follows was refused");
    /* Twice an input of the next slave, which is in another domain, or not. */
    if (cyclic_set_copy(engine, (uint32_t)((i + 1) % SLAVES * ENTRIES + STATUS), first + COPIED, 2, -1,
                        (int32_t)first + CONTROL) != 0)
      die("a copy was refused");
  }
  cyclic_set_clock(engine, &clock);
  if (cyclic_start(engine, &settings) != 0) die("it does not start");
  for (i = 0; i < 4; i++)
    pthread_create(&threads[i], NULL, roles[i], roles[i] == reader ? (void *)engine : (void *)(uintptr_t)seed);
  for (i = 0; __atomic_load_n(&engine->health->cycles, __ATOMIC_RELAXED) < cycles ||
              good_exchanges() < good;
       i++) {
    nanosleep(&(struct timespec){0, 5000000}, NULL);
    swap_socket(&near[i % ports], i % ports);
    swap_ranges();
  }
  cyclic_make_safe(engine);
  __atomic_store_n(&stop, 1, __ATOMIC_RELAXED);
  for (i = 0; i < 4; i++) pthread_join(threads[i], NULL);
  cyclic_stop(engine);
  printf("{\"answers\": %lu, \"damaged\": %lu, \"invented\": %lu, \"held\": %lu, \"swaps\": %lu, "
         "\"events\": %lu, \"snapshots\": %lu, \"truncated\": %lu, \"lost\": %lu, \"late\": %lu, "
         "\"cycles\": %lu, \"exchanges\": %lu, \"bad\": %lu, \"commits\": %lu, "
         "\"refused\": %lu, \"malformed\": %lu, \"copied\": %lu, \"ranges\": %lu}\n",
         reached.answers, reached.damaged, reached.invented, reached.held, reached.swaps,
         reached.events, reached.snapshots, reached.truncated, (unsigned long)engine->health->lost,
         (unsigned long)engine->health->late, (unsigned long)engine->health->cycles,
         (unsigned long)engine->domain[0].status->exchanges,
         (unsigned long)engine->health->wkc_bad, (unsigned long)engine->health->commits,
         (unsigned long)engine->health->refused, (unsigned long)engine->health->malformed, reached.copied,
         reached.ranges);
  cyclic_free(engine);
  for (i = 0; i < ports; i++) close(near[i]), close(far[i]);
  close(out_fd);
  free(shm);
  return 0;
}
