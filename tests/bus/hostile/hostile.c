/* A client that does what it must not, and those who are not to notice.
 *
 * usage: hostile BUS KIND COUNT SEED
 *
 * The rig is `line:6`: domain 0 has slaves 0 to 2, domain 1 the others. A child process is hostile
 * COUNT times: `pages` writes random pages over the whole .out file, `lies` claims, commits and
 * releases as the protocol has it, but whatever it likes, and `requests` asks for random objects. The
 * parent meanwhile reads every cycle: the entry with a declared range stays within it, working
 * counters are right, and the cycle goes on. A writer of domain 1 keeps its outputs, unless its slot
 * is written over; it then claims them again.
 * Prints what was reached, as JSON; ends with a sentence as soon as something is wrong.
 */
#include "../../fuzz/random.h"
#include "internal.h"

#include <fcntl.h>
#include <pthread.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

enum {
  LIMITED = 0,              /* entry of slave 0 with a declared range; see the test */
  LOWEST = 20, HIGHEST = 100,
  WRITER = 4,               /* slave of who behaves */
  HOSTILE_SLAVES = 3,       /* slaves 0 to 2 */
  BYTES = 32,
  PAGE = 4096, POOL = 64,
  PATIENCE = 60000          /* cycles */
};

#define LEASE 5.0 /* s */

static struct {
  unsigned long cycles, samples, incomplete, lost, lost_claims, commits;
} reached;
static const char *name;
static int stop;

__attribute__((noreturn, format(printf, 1, 2))) static void die(const char *format, ...) {
  va_list arguments;
  va_start(arguments, format);
  fprintf(stderr, "hostile: ");
  vfprintf(stderr, format, arguments);
  fprintf(stderr, "\n");
  va_end(arguments);
  _exit(1);
}

static ecat_t *connect_to(void) {
  ecat_t *bus = NULL;
  if (ecat_open(&bus, name) != 0) die("%s", ecat_error(bus));
  return bus;
}

static void next_cycle(ecat_t *bus) {
  int code = ecat_wait(bus, 1, 1.0);
  if (code != 0 && code != ECAT_ETIMEOUT && code != ECAT_ESTALE) die("wait: %s", ecat_error(bus));
}

static int output_of(const ecat_t *bus, int slave, int entry) {
  return (int)bus->slaves[slave].signals_first + entry;
}

/* --- the intruder ---------------------------------------------------------------------------- */

static void pages(struct source *source, unsigned long count) {
  static uint8_t pool[POOL][PAGE];
  char folder[ECAT_SHM_PATH], path[ECAT_SHM_PATH + 40];
  struct stat status;
  uint8_t *map;
  size_t size;
  unsigned long i;
  int fd;
  (void)ecat_shm_folder(0, folder);
  snprintf(path, sizeof path, "%s/%s.out", folder, name);
  fd = open(path, O_RDWR);
  if (fd < 0 || fstat(fd, &status) != 0) die("no %s", path);
  size = (size_t)status.st_size / PAGE;
  map = mmap(NULL, size * PAGE, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
  if (map == MAP_FAILED) die("cannot map %s", path);
  fill(source, pool[0], sizeof pool);
  for (i = 0; i < count; i++) {
    /* The page of the doorbells more often: with them the engine believes that something is new. */
    size_t page = one_in(source, 4) ? 1 : below(source, (uint32_t)size);
    uint32_t shift = below(source, PAGE);
    const uint8_t *junk = pool[below(source, POOL)];
    memcpy(map + page * PAGE, junk + shift, PAGE - shift);
    memcpy(map + page * PAGE + PAGE - shift, junk, shift);
    if (i % 8 == 0) usleep(below(source, 200)); /* so that cycles come in between */
  }
}

/* What the library would write, but for the values. */
static void lie(ecat_t *bus, struct source *source) {
  uint32_t first = bus->first, bytes = bus->bytes;
  fill(source, (uint8_t *)bus->stage, bus->header->output_bytes);
  fill(source, (uint8_t *)bus->mask, bus->header->output_bytes);
  if (one_in(source, 2)) memset(bus->mask, 0xFF, bus->header->output_bytes);
  if (one_in(source, 50)) { /* a part that is not its own, or none at all */
    bus->first = below(source, 24) * 8;
    bus->bytes = below(source, (uint32_t)(bus->header->output_bytes - bus->first) / 8 + 1) * 8;
  }
  (void)ecat_commit(bus);
  bus->first = first;
  bus->bytes = bytes;
  if (one_in(source, 100)) { /* claims of whatever, also of what is another's and of inputs */
    fill(source, (uint8_t *)bus->out_claims, bus->sets * 8);
    bus->doorbell->claim_seq++;
    (void)ecat_commit(bus);
    ecat_slot_begin(bus); /* a new client, as far as anybody can see */
  }
  if (one_in(source, 100)) bus->out->lease_ns = draw(source);
}

static void lies(struct source *source, unsigned long count) {
  ecat_t *bus = connect_to();
  unsigned long i;
  for (i = 0; i < count; i++) {
    if (bus->bytes == 0 || one_in(source, 10))
      (void)ecat_claim(bus, (int)below(source, HOSTILE_SLAVES), LEASE);
    if (one_in(source, 40)) (void)ecat_release(bus, (int)below(source, HOSTILE_SLAVES));
    if (one_in(source, 4)) next_cycle(bus);
    (void)ecat_sample(bus);
    lie(bus, source);
  }
  ecat_close(bus);
}

static void requests(struct source *source, unsigned long count) {
  ecat_t *bus = connect_to();
  ecat_out_request *request;
  unsigned long i;
  while (ecat_slot_take(bus) != 0) next_cycle(bus);
  request = (ecat_out_request *)(void *)(bus->out + 1);
  for (i = 0; i < count; i++) {
    ecat_out_request *cell = &request[below(source, ECAT_REQUESTS)];
    if (one_in(source, 2)) {
      fill(source, (uint8_t *)cell, sizeof *cell);
    } else { /* one that may succeed */
      cell->op = 1 + below(source, 4);
      cell->slave = (uint16_t)below(source, 7);
      cell->index = (uint16_t)(one_in(source, 2) ? 0x1018 : below(source, 0x10000));
      cell->subindex = (uint8_t)below(source, 8);
      cell->length = below(source, 8);
    }
    /* No state: a slave out of OP is what this client may ask for, and no defect. */
    if (cell->op == ECAT_REQUEST_STATE) cell->op = 0;
    cell->seq = draw(source);
    __atomic_store_n(&bus->doorbell->request_seq, draw(source), __ATOMIC_RELEASE);
    if (one_in(source, 16)) next_cycle(bus);
  }
  ecat_close(bus);
}

static pid_t start_intruder(const char *kind, unsigned long count, uint64_t seed) {
  struct source source = source_from(seed);
  pid_t parent = getpid(), pid = fork();
  if (pid != 0) return pid;
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  prctl(PR_SET_NAME, "intruder");
  if (getppid() != parent) _exit(1);
  if (strcmp(kind, "pages") == 0) pages(&source, count);
  else if (strcmp(kind, "lies") == 0) lies(&source, count);
  else if (strcmp(kind, "requests") == 0) requests(&source, count);
  else die("there is no kind '%s'", kind);
  _exit(0);
}

/* --- who is not to notice ------------------------------------------------------------------- */

static void look(ecat_t *bus) {
  ecat_domain_info info;
  double sent = 0, back = 0;
  int i, input = output_of(bus, 0, BYTES + LIMITED); /* inputs follow the outputs */
  for (i = 0; i < ecat_domain_count(bus); i++) {
    if (ecat_domain(bus, i, &info) != 0) die("domain: %s", ecat_error(bus));
    if (info.wkc_state == ECAT_WKC_INCOMPLETE) die("domain %d: working counter %u", i, info.wkc);
    reached.incomplete += info.wkc_state == ECAT_WKC_ZERO; /* the frame was late */
  }
  ecat_read(bus, output_of(bus, 0, LIMITED), &sent);
  ecat_read(bus, input, &back);
  if (sent < LOWEST || sent > HIGHEST) die("cycle %llu: %g is sent and not allowed",
                                           (unsigned long long)bus->sample_cycle, sent);
  if (back != 0 && (back < LOWEST || back > HIGHEST)) die("%g has arrived and is not allowed", back);
  reached.samples++;
}

static void *writer(void *kind) {
  int may_lose = strcmp(kind, "pages") == 0, value = 0, i;
  ecat_t *bus = connect_to();
  while (!__atomic_load_n(&stop, __ATOMIC_RELAXED)) {
    int code = 0;
    next_cycle(bus);
    (void)ecat_sample(bus);
    value = value % 255 + 1;
    for (i = 0; i < BYTES && code == 0; i++) code = ecat_write(bus, output_of(bus, WRITER, i), value);
    if (code == 0) code = ecat_commit(bus);
    if (code == 0) {
      __atomic_fetch_add(&reached.commits, 1, __ATOMIC_RELAXED);
      continue;
    }
    if (!may_lose && reached.commits > 0) die("the writer: %s", ecat_error(bus));
    reached.lost_claims += reached.commits > 0;
    code = ecat_claim(bus, WRITER, LEASE);
    if (code == ECAT_EDOWN || (code != 0 && !may_lose)) die("the writer: %s", ecat_error(bus));
  }
  ecat_close(bus);
  return NULL;
}

/* After all that, whoever behaves can own and write whatever nobody else has. */
static void check_usable(ecat_t *reader) {
  ecat_t *bus = connect_to();
  int slave, tries;
  for (slave = 0; slave < 6; slave++) /* what the intruder had, it has for its lease */
    for (tries = 0; ecat_claim(bus, slave, LEASE) != 0; tries++) {
      if (tries == PATIENCE) die("afterwards: %s", ecat_error(bus));
      (void)ecat_sample(bus);
      next_cycle(reader);
    }
  for (slave = 0; slave < 6; slave++)
    if (ecat_write(bus, output_of(bus, slave, LIMITED), 77) != 0) die("afterwards: %s", ecat_error(bus));
  if (ecat_commit(bus) != 0) die("afterwards: %s", ecat_error(bus));
  for (tries = 0; tries < PATIENCE; tries++) {
    double value = 0;
    next_cycle(reader);
    (void)ecat_sample(bus);
    (void)ecat_sample(reader);
    ecat_read(reader, output_of(reader, 0, BYTES + LIMITED), &value);
    if (value == 77) break;
  }
  if (tries == PATIENCE) die("afterwards no value arrives");
  ecat_close(bus);
}

int main(int argc, char **argv) {
  ecat_t *bus;
  pthread_t thread;
  pid_t intruder;
  uint64_t begin;
  int status = 0;
  const ecat_shm_health *health;
  if (argc != 5) die("usage: hostile BUS KIND COUNT SEED");
  name = argv[1];
  bus = connect_to();
  health = (const void *)(bus->map + bus->header->health_offset);
  if (pthread_create(&thread, NULL, writer, argv[2]) != 0) die("no thread");
  while (__atomic_load_n(&reached.commits, __ATOMIC_RELAXED) == 0) next_cycle(bus);
  intruder = start_intruder(argv[2], strtoul(argv[3], NULL, 10), strtoull(argv[4], NULL, 10));
  if (intruder < 0) die("no process");
  begin = ecat_cycle(bus);
  while (waitpid(intruder, &status, WNOHANG) == 0) {
    next_cycle(bus);
    if (ecat_sample(bus) == 0) look(bus);
  }
  if (status != 0) die("the intruder has failed");
  __atomic_store_n(&stop, 1, __ATOMIC_RELAXED);
  pthread_join(thread, NULL);
  reached.cycles = (unsigned long)(ecat_cycle(bus) - begin);
  check_usable(bus);
  printf("{\"cycles\": %lu, \"samples\": %lu, \"incomplete\": %lu, \"lost_claims\": %lu, "
         "\"commits\": %lu, \"malformed\": %llu, \"refused\": %llu, \"intruder\": %d}\n",
         reached.cycles, reached.samples, reached.incomplete, reached.lost_claims, reached.commits,
         (unsigned long long)health->malformed, (unsigned long long)health->refused, (int)intruder);
  ecat_close(bus);
  return 0;
}
