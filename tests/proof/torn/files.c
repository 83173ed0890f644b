#include "torn.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

static char paths[2][ECAT_SHM_PATH + 40];

void die(const char *what, uint64_t number) {
  fprintf(stderr, "torn: %s (%llu)\n", what, (unsigned long long)number);
  files_remove();
  _exit(1);
}

void files_remove(void) {
  int i;
  for (i = 0; i < 2; i++)
    if (paths[i][0] != '\0') unlink(paths[i]);
}

static uint32_t place(uint32_t *end, size_t size) {
  uint32_t at = *end;
  *end += (uint32_t)((size + 63) / 64 * 64);
  return at;
}

static int new_file(const struct bench *bench, int number, size_t size) {
  int fd;
  char folder[ECAT_SHM_PATH];
  (void)ecat_shm_folder(0, folder);
  (void)mkdir(folder, 0700); /* it may be there */
  snprintf(paths[number], sizeof paths[number], "%s/%s%s", folder, bench->name,
           number == 0 ? "" : ".out");
  fd = open(paths[number], O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
  if (fd < 0 || ftruncate(fd, (off_t)size) != 0) die("no shared memory", (uint64_t)errno);
  return fd;
}

/* Entries of one slave: of 64 bits as long as there is room, then of 8. */
static uint32_t entries_in(uint32_t bytes) { return bytes / 8 + bytes % 8; }

static uint32_t begin_of(const struct bench *bench, uint32_t slave) {
  return slave < bench->slaves ? slave * (bench->size / bench->slaves) : bench->size;
}

static void fill(const struct bench *bench, ecat_shm_header *h, uint8_t *shm) {
  ecat_shm_slave *slave = (void *)(shm + h->slaves_offset);
  ecat_shm_signal *signal = (void *)(shm + h->signals_offset);
  ecat_shm_domain *domain = (void *)(shm + h->domains_offset);
  uint32_t i, at, number = 0;
  domain->image_bytes = domain->output_bytes = bench->size;
  domain->divider = 1;
  for (i = 0; i < bench->slaves; i++) {
    uint32_t end = begin_of(bench, i + 1);
    slave[i].output_offset = at = begin_of(bench, i);
    slave[i].output_bytes = end - at;
    slave[i].signals_first = number;
    slave[i].signals_count = entries_in(end - at);
    while (at < end) {
      uint32_t bytes = end - at >= 8 ? 8 : 1;
      ecat_shm_signal entry = {.slave = (uint16_t)i, .output = 1, .bit_offset = 8 * at};
      entry.type = bytes == 8 ? 0x001B : 0x0005; /* UNSIGNED64, UNSIGNED8 */
      entry.bit_length = (uint16_t)(8 * bytes);
      entry.scale = 1;
      entry.minimum = -__builtin_inf();
      entry.maximum = __builtin_inf();
      signal[number++] = entry;
      at += bytes;
    }
  }
}

static int make_out(const struct bench *bench, const ecat_shm_header *h) {
  ecat_out_header out = {.magic = ECAT_OUT_MAGIC, .layout = ECAT_SHM_LAYOUT};
  size_t image = sizeof(ecat_out_image) + 2 * ((bench->size + 7) / 8 * 8);
  int fd;
  out.slot_count = ECAT_SLOTS;
  out.instance = h->instance;
  out.doorbells_offset = 4096;
  out.slots_offset = 8192;
  out.claims_offset = (uint32_t)(sizeof(ecat_out_slot) + ECAT_REQUESTS * sizeof(ecat_out_request));
  out.images_offset = out.claims_offset + (h->signal_count + 63) / 64 * 8;
  out.image_stride = (uint32_t)((image + 63) / 64 * 64);
  out.slot_stride = (out.images_offset + ECAT_IMAGES * out.image_stride + 4095) / 4096 * 4096;
  fd = new_file(bench, 1, out.slots_offset + (size_t)ECAT_SLOTS * out.slot_stride);
  if (pwrite(fd, &out, sizeof out, 0) != sizeof out) die("no .out file", (uint64_t)errno);
  return fd;
}

void files_make(struct bench *bench) {
  ecat_shm_header h = {.magic = ECAT_SHM_MAGIC, .state = ECAT_BUS_RUNNING};
  struct flock lock = {.l_type = F_WRLCK, .l_whence = SEEK_SET, .l_start = ECAT_LOCK_DAEMON, .l_len = 1};
  uint32_t end = (sizeof h + 63) / 64 * 64, i, page;
  uint8_t *shm;
  int fd;
  bench->slaves = bench->size >= 8 * WRITERS ? WRITERS : 1;
  h.instance = 1;
  h.cycle_time_ns = 1000000;
  h.lease_ns = h.lease_max_ns = 100000000000u;
  h.cycle_end_ns = 1ull << 62; /* "just now" for ever */
  h.slave_count = bench->slaves;
  h.domain_count = 1;
  h.slot_count = ECAT_SLOTS;
  h.output_bytes = bench->size;
  for (i = 0; i < bench->slaves; i++)
    h.signal_count += entries_in(begin_of(bench, i + 1) - begin_of(bench, i));
  h.slaves_offset = place(&end, h.slave_count * sizeof(ecat_shm_slave));
  h.signals_offset = place(&end, h.signal_count * sizeof(ecat_shm_signal));
  h.domains_offset = place(&end, sizeof(ecat_shm_domain));
  h.slave_status_offset = place(&end, h.slave_count * sizeof(ecat_shm_slave_status));
  h.outputs_offset = place(&end, h.signal_count * sizeof(ecat_shm_output));
  h.slot_status_offset = place(&end, ECAT_SLOTS * sizeof(ecat_shm_slot_status));
  h.replies_offset = place(&end, ECAT_SLOTS * ECAT_REQUESTS * sizeof(ecat_shm_reply));
  h.domain_status_offset = place(&end, sizeof(ecat_shm_domain_status));
  h.settings_offset = place(&end, ECAT_SETTINGS * sizeof(ecat_shm_setting));
  h.health_offset = place(&end, sizeof(ecat_shm_health));
  page = place(&end, sizeof(ecat_shm_page) + (bench->size + 7) / 8 * 8);
  h.size = end;
  fd = new_file(bench, 0, end);
  shm = mmap(NULL, end, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
  if (shm == MAP_FAILED || fcntl(fd, F_OFD_SETLK, &lock) != 0) die("no shared memory", (uint64_t)errno);
  memcpy(shm, &h, sizeof h);
  fill(bench, &h, shm);
  ((ecat_shm_domain *)(void *)(shm + h.domains_offset))->page_offset = page;
  bench->engine = cyclic_new(shm, make_out(bench, &h), -1, -1, 1);
  if (bench->engine == NULL) die("no engine", (uint64_t)errno);
  cyclic_publish_layout(shm);
}

ecat_t *connection(const struct bench *bench) {
  ecat_t *bus = NULL;
  if (ecat_open(&bus, bench->name) != 0) die(ecat_error(bus), 0);
  return bus;
}
