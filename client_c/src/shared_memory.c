/* The daemon's shared memory: opening it, checking its contents, and noticing that the daemon has
 * ended. */
#include "internal.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <sched.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

int ecat_daemon_lives(int fd) {
  struct flock lock = {.l_type = F_RDLCK, .l_whence = SEEK_SET, .l_start = ECAT_LOCK_DAEMON, .l_len = 1};
  /* If the lock cannot be queried, the daemon is assumed to live. */
  return fcntl(fd, F_OFD_GETLK, &lock) != 0 || lock.l_type != F_UNLCK;
}

/* What follows `ecatd` in the name of the service of a bus: nothing for ecat0, else @ and the bus. */
static const char *at(const ecat_t *bus) { return strcmp(bus->name, "ecat0") == 0 ? "" : "@"; }
static const char *instance(const ecat_t *bus) { return at(bus)[0] ? bus->name : ""; }

static int not_running(ecat_t *bus) {
  return ecat_fail(bus, ECAT_EDOWN,
                   "bus '%s' is not running; start it with 'systemctl start ecatd%s%s', or "
                   "without hardware with 'ecatd --simulate troll%s%s'",
                   bus->name, at(bus), instance(bus), at(bus)[0] ? " --bus " : "", instance(bus));
}

/* Whether a table lies within the shared memory; checked before its first byte is used. */
static int table_fits(const ecat_t *bus, uint32_t offset, uint64_t count, uint64_t size) {
  return offset % 8 == 0 && offset <= bus->map_size && count <= (bus->map_size - offset) / size;
}

static int damaged(ecat_t *bus, const char *what) {
  return ecat_fail(bus, ECAT_ELAYOUT,
                   "the shared memory of bus '%s' is damaged (%s); restart the daemon", bus->name,
                   what);
}

static int check_domain(ecat_t *bus, unsigned number) {
  const ecat_shm_domain *domain = &bus->domains[number];
  if (!table_fits(bus, domain->page_offset, 1, sizeof(ecat_shm_page) + (uint64_t)domain->image_bytes))
    return damaged(bus, "domain page");
  if (domain->output_bytes > domain->image_bytes ||
      (uint64_t)domain->output_base + domain->output_bytes > bus->header->output_bytes)
    return damaged(bus, "domain outputs");
  if (domain->divider == 0) return damaged(bus, "domain divider");
  if (memchr(domain->name, 0, sizeof domain->name) == NULL) return damaged(bus, "domain name");
  return 0;
}

static int check_slave(ecat_t *bus, unsigned position) {
  const ecat_shm_slave *slave = &bus->slaves[position];
  const ecat_shm_domain *domain;
  if (slave->domain >= bus->header->domain_count) return damaged(bus, "slave domain");
  domain = &bus->domains[slave->domain];
  if ((uint64_t)slave->output_offset + slave->output_bytes > domain->output_bytes ||
      (uint64_t)slave->input_offset + slave->input_bytes > domain->image_bytes)
    return damaged(bus, "slave image");
  if (memchr(slave->name, 0, sizeof slave->name) == NULL) return damaged(bus, "slave name");
  if ((uint64_t)slave->signals_first + slave->signals_count > bus->header->signal_count)
    return damaged(bus, "slave entries");
  if (slave->group < -1 || slave->group >= ECAT_MAX_GROUPS) return damaged(bus, "slave group");
  return 0;
}

static int check_signal(ecat_t *bus, unsigned number) {
  const ecat_shm_signal *from = &bus->signals[number];
  struct signal *to = &bus->signal[number];
  const ecat_shm_domain *domain;
  if (from->slave >= bus->header->slave_count || from->domain >= bus->header->domain_count ||
      from->bit_length == 0 || from->bit_length > 64)
    return damaged(bus, "signal");
  domain = &bus->domains[from->domain];
  if ((uint64_t)from->bit_offset + from->bit_length >
      8ull * (from->output ? domain->output_bytes : domain->image_bytes))
    return damaged(bus, "signal image");
  if (memchr(from->name, 0, sizeof from->name) == NULL ||
      memchr(from->pdo_name, 0, sizeof from->pdo_name) == NULL ||
      memchr(from->unit, 0, sizeof from->unit) == NULL)
    return damaged(bus, "signal name");
  if (from->scale == 0 || !isfinite(from->scale) || !isfinite(from->offset))
    return damaged(bus, "signal scale");
  to->bit = from->bit_offset;
  to->staged = 8 * domain->output_base + from->bit_offset;
  to->bits = (uint8_t)from->bit_length;
  to->slave = from->slave;
  to->domain = from->domain;
  to->output = from->output;
  to->group = (int8_t)bus->slaves[from->slave].group;
  to->sign = (uint8_t)type_is_signed(from->type);
  to->real = (uint8_t)type_is_real(from->type, from->bit_length);
  to->up = (uint8_t)(64 - from->bit_offset % 64 - from->bit_length); /* unless READ_OTHERWISE */
  to->down = (uint8_t)(64 - from->bit_length);
  to->reading = READ_OTHERWISE;
  if (!to->real && from->bit_offset % 64 + from->bit_length <= 64 && (to->sign || to->bits < 64))
    to->reading = to->sign ? READ_SIGNED : READ_UNSIGNED;
  bus->rule[number] = value_rule(from->type, from->bit_length, from->minimum, from->maximum);
  return 0;
}

static int copy_tables(ecat_t *bus) {
  const ecat_shm_header *h = bus->header;
  size_t slaves = h->slave_count * sizeof *bus->slaves;
  size_t signals = h->signal_count * sizeof *bus->signals;
  size_t domains = h->domain_count * sizeof *bus->domains;
  bus->tables = malloc(signals + slaves + domains + 1);
  if (bus->tables == NULL) return -1;
  bus->signals = (void *)bus->tables; /* first, since they have the strictest alignment */
  bus->slaves = (void *)(bus->tables + signals);
  bus->domains = (void *)(bus->tables + signals + slaves);
  memcpy(bus->slaves, bus->map + h->slaves_offset, slaves);
  memcpy(bus->signals, bus->map + h->signals_offset, signals);
  memcpy(bus->domains, bus->map + h->domains_offset, domains);
  return 0;
}

/* Allocates an image. The word before it links it to the next one in the list of retired images. */
static uint64_t *make_image(size_t words) {
  uint64_t *block = calloc(words + 3, 8);
  return block != NULL ? block + 1 : NULL;
}

static void free_image(uint64_t *image) {
  if (image != NULL) free(image - 1);
}

/* Computes the addresses of all entries again after an image has moved. */
static void place_signals(ecat_t *bus) {
  uint32_t i;
  for (i = 0; i < bus->header->signal_count; i++)
    bus->signal[i].at = bus->snapshot[bus->signal[i].domain].image + bus->signal[i].bit / 64;
}

static int check_tables(ecat_t *bus) {
  const ecat_shm_header *h = bus->header;
  unsigned i;
  int code;
  if (h->slave_count > ECAT_MAX_SLAVES || h->domain_count > ECAT_MAX_DOMAINS ||
      h->slot_count > ECAT_SLOTS || h->can_count > ECAT_MAX_CAN || h->output_bytes > bus->map_size || h->cycle_time_ns == 0)
    return damaged(bus, "header");
  if (!table_fits(bus, h->slaves_offset, h->slave_count, sizeof(ecat_shm_slave)) ||
      !table_fits(bus, h->signals_offset, h->signal_count, sizeof(ecat_shm_signal)) ||
      !table_fits(bus, h->domains_offset, h->domain_count, sizeof(ecat_shm_domain)) ||
      !table_fits(bus, h->slave_status_offset, h->slave_count, sizeof(ecat_shm_slave_status)) ||
      !table_fits(bus, h->outputs_offset, h->signal_count, sizeof(ecat_shm_output)) ||
      !table_fits(bus, h->slot_status_offset, h->slot_count, sizeof(ecat_shm_slot_status)) ||
      !table_fits(bus, h->replies_offset, (uint64_t)h->slot_count * ECAT_REQUESTS,
                  sizeof(ecat_shm_reply)) ||
      !table_fits(bus, h->domain_status_offset, h->domain_count, sizeof(ecat_shm_domain_status)) ||
      !table_fits(bus, h->settings_offset, ECAT_SETTINGS, sizeof(ecat_shm_setting)) ||
      !table_fits(bus, h->health_offset, 1, sizeof(ecat_shm_health)) ||
      !table_fits(bus, h->can_offset, h->can_count, sizeof(ecat_shm_can)) ||
      !table_fits(bus, h->can_senders_offset, (uint64_t)h->slot_count * h->can_count,
                  sizeof(ecat_shm_can_sender)))
    return damaged(bus, "tables");
  bus->slave_status = (const void *)(bus->map + h->slave_status_offset);
  bus->outputs = (const void *)(bus->map + h->outputs_offset);
  bus->slot_status = (const void *)(bus->map + h->slot_status_offset);
  bus->replies = (const void *)(bus->map + h->replies_offset);
  bus->can = (const void *)(bus->map + h->can_offset);
  bus->can_senders = (const void *)(bus->map + h->can_senders_offset);

  if (copy_tables(bus) != 0) return ecat_fail(bus, ECAT_ESYS, "out of memory");
  bus->signal = calloc(h->signal_count + 1, sizeof *bus->signal);
  bus->rule = calloc(h->signal_count + 1, sizeof *bus->rule);
  bus->snapshot = calloc(h->domain_count + 1, sizeof *bus->snapshot);
  bus->sets = (h->signal_count + 63) / 64;
  bus->claims = calloc(3 * bus->sets + h->signal_count + 1, 8);
  bus->stage = calloc(2, (size_t)h->output_bytes + 32); /* bits_get() reads beyond the last byte */
  if (bus->signal == NULL || bus->rule == NULL || bus->snapshot == NULL || bus->stage == NULL ||
      bus->claims == NULL)
    return ecat_fail(bus, ECAT_ESYS, "out of memory");
  bus->written = bus->claims + bus->sets;
  bus->wish = bus->written + bus->sets;
  bus->lease_ns = bus->wish + bus->sets;
  bus->mask = bus->stage + ((size_t)h->output_bytes + 31) / 8;
  for (i = 0; i < h->domain_count; i++) {
    struct snapshot *snapshot = &bus->snapshot[i];
    if ((code = check_domain(bus, i)) != 0) return code;
    snapshot->page = (const void *)(bus->map + bus->domains[i].page_offset);
    snapshot->words = (bus->domains[i].image_bytes + 7) / 8;
    snapshot->image = make_image(snapshot->words);
    if (snapshot->image == NULL) return ecat_fail(bus, ECAT_ESYS, "out of memory");
  }
  for (i = 0; i < h->slave_count; i++)
    if ((code = check_slave(bus, i)) != 0) return code;
  for (i = 0; i < h->signal_count; i++)
    if ((code = check_signal(bus, i)) != 0) return code;
  for (i = 0; i < h->can_count; i++)
    if (bus->can[i].slave >= h->slave_count ||
        !table_fits(bus, bus->can[i].records_offset, ECAT_CAN_RECORDS, sizeof(ecat_shm_can_record)))
      return damaged(bus, "CAN channel");
  place_signals(bus);
  return 0;
}

int ecat_memory_open(ecat_t *bus) {
  char text[ECAT_SHM_TEXT];
  struct stat status;
  uint32_t layout;
  int fd = bus->folder[0] != '\0' ? ecat_shm_open(bus->folder, bus->name, 0, text)
                                  : ecat_shm_find(bus->name, bus->folder, text);
  if (fd == ECAT_EDOWN) return not_running(bus);
  if (fd == ECAT_EPERM && text[0] == '\0')
    return ecat_fail(bus, ECAT_EPERM,
                     "no right to read bus '%s': become a member of the group 'ecat' "
                     "('sudo usermod -aG ecat $USER', then log in again)",
                     bus->name);
  if (fd < 0) return ecat_fail(bus, fd, "%s", text);
  bus->fd = fd;
  if (fstat(bus->fd, &status) != 0 || (size_t)status.st_size < sizeof(ecat_shm_header))
    return ecat_daemon_lives(bus->fd)
               ? ecat_fail(bus, ECAT_EDOWN, "the daemon of bus '%s' is still starting", bus->name)
               : not_running(bus);
  bus->map_size = (size_t)status.st_size;
  bus->map = mmap(NULL, bus->map_size, PROT_READ, MAP_SHARED, bus->fd, 0);
  if (bus->map == MAP_FAILED) {
    bus->map = NULL;
    return ecat_fail(bus, ECAT_ESYS, "cannot map %s/%s: %s", bus->folder, bus->name, strerror(errno));
  }
  bus->header = (const void *)bus->map;
  layout = __atomic_load_n(&bus->header->layout, __ATOMIC_ACQUIRE);
  if (!ecat_daemon_lives(bus->fd)) return not_running(bus); /* a leftover of a killed daemon */
  if (layout == 0)
    return ecat_fail(bus, ECAT_EDOWN, "the daemon of bus '%s' is still starting", bus->name);
  if (bus->header->magic != ECAT_SHM_MAGIC) return damaged(bus, "magic number");
  if (layout >> 16 != ECAT_SHM_LAYOUT_MAJOR || layout < ECAT_SHM_LAYOUT)
    return ecat_fail(bus, ECAT_ELAYOUT,
                     "the daemon of bus '%s' speaks layout %u.%u, this client %u.%u: %s", bus->name,
                     layout >> 16, layout & 0xFFFF, ECAT_SHM_LAYOUT_MAJOR, ECAT_SHM_LAYOUT_MINOR,
                     layout < ECAT_SHM_LAYOUT
                         ? "update the daemon, if that is not done yet, and restart its service"
                         : "update the client, and generate libraries again");
  if (bus->header->size > bus->map_size) return damaged(bus, "size");
  return check_tables(bus);
}

void ecat_images_free(ecat_t *bus) {
  while (bus->retired != NULL) {
    uint64_t *image = bus->retired;
    bus->retired = (uint64_t *)(uintptr_t)image[-1];
    free_image(image);
  }
}

void ecat_memory_close(ecat_t *bus) {
  unsigned i;
  if (bus->snapshot != NULL)
    for (i = 0; i < bus->header->domain_count; i++) free_image(bus->snapshot[i].image);
  free(bus->snapshot);
  free(bus->signal);
  free(bus->rule);
  free(bus->stage);
  free(bus->claims);
  free(bus->tables);
  if (bus->map != NULL) munmap((void *)(uintptr_t)bus->map, bus->map_size);
  if (bus->fd >= 0) close(bus->fd);
  bus->snapshot = NULL;
  bus->signal = NULL;
  bus->rule = NULL;
  bus->stage = NULL;
  bus->claims = NULL;
  bus->tables = NULL;
  bus->map = NULL;
  bus->fd = -1;
}

/* --- a daemon that goes and comes back ------------------------------------------------------ */

/* Remembers why the daemon is not there. Until the next attempt to find it, calls return this error. */
static int down(ecat_t *bus, int code) {
  bus->down = code;
  snprintf(bus->why, sizeof bus->why, "%s", bus->error);
  return code;
}

int ecat_memory_check(ecat_t *bus, uint64_t age_ns) {
  uint64_t limit = 5 * bus->header->cycle_time_ns;
  if (bus->map == NULL)
    return ecat_fail(bus, ECAT_EDOWN, "this client is not connected to bus '%s'", bus->name);
  if (bus->down != 0) return ecat_fail(bus, bus->down, "%s", bus->why);
  /* The lock costs a system call, so it is checked only after a live daemon would have finished a
   * cycle. */
  if (limit < LATE_NS) limit = LATE_NS;
  if (__atomic_load_n(&bus->header->state, __ATOMIC_RELAXED) == ECAT_BUS_STOPPED)
    ecat_fail(bus, ECAT_EDOWN, "the daemon of bus '%s' was stopped", bus->name);
  else if (age_ns <= limit)
    return 0;
  else if (!ecat_daemon_lives(bus->fd))
    ecat_fail(bus, ECAT_EDOWN, "the daemon of bus '%s' has ended; start it again with "
              "'systemctl start ecatd%s%s', unless systemd does so by itself",
              bus->name, at(bus), instance(bus));
  else if (age_ns > limit + 80000000u)
    return ecat_fail(bus, ECAT_ESTALE, "the cycle of bus '%s' stands still since %.3f s", bus->name,
                     (double)age_ns * 1e-9);
  else
    return 0;
  ecat_slot_forget(bus);
  return down(bus, ECAT_EDOWN);
}

/* Whether the last cycle ended so recently that no more checks are needed. The coarse clock costs a fifth
 * of the exact one, which would cost as much as the rest of a sample. */
static int young(const ecat_t *bus, uint64_t end) {
  struct timespec now;
  if (bus->down != 0 || bus->map == NULL ||
      __atomic_load_n(&bus->header->state, __ATOMIC_RELAXED) == ECAT_BUS_STOPPED)
    return 0;
  clock_gettime(CLOCK_MONOTONIC_COARSE, &now);
  return (int64_t)((uint64_t)now.tv_sec * NS_PER_S + (uint64_t)now.tv_nsec - end) <
         (int64_t)(LATE_NS - TICK_NS);
}

int ecat_memory_age(ecat_t *bus) {
  uint64_t now, end = __atomic_load_n(&bus->header->cycle_end_ns, __ATOMIC_RELAXED);
  if (young(bus, end)) return 0;
  now = ecat_now();
  return ecat_memory_check(bus, now > end ? now - end : 0);
}

/* Whether slaves, entries and domains are the same as before, so that the handles of the program stay
 * valid. */
static int check_same(ecat_t *fresh, const ecat_t *bus) {
  const ecat_shm_header *now = fresh->header, *before = bus->header;
  if (now->fingerprint != before->fingerprint || now->slave_count != before->slave_count ||
      now->signal_count != before->signal_count)
    return ecat_fail(fresh, ECAT_EBUS,
                     "bus '%s' came back with other slaves or other entries: it has %u slaves with "
                     "%u entries now, and had %u with %u; open it again",
                     bus->name, (unsigned)now->slave_count, (unsigned)now->signal_count,
                     (unsigned)before->slave_count, (unsigned)before->signal_count);
  if (now->can_count != before->can_count)
    return ecat_fail(fresh, ECAT_EBUS,
                     "bus '%s' came back with %u CAN channels instead of %u; open it again", bus->name,
                     (unsigned)now->can_count, (unsigned)before->can_count);
  if (now->domain_count != before->domain_count)
    return ecat_fail(fresh, ECAT_EBUS,
                     "bus '%s' came back with %u domains instead of %u; open it again", bus->name,
                     (unsigned)now->domain_count, (unsigned)before->domain_count);
  return 0;
}

/* Programs may have addresses of the images. An image keeps its address if its size is unchanged;
 * otherwise it is kept, as retired, beside the new one. */
static void keep_images(ecat_t *bus, ecat_t *fresh) {
  uint32_t i;
  fresh->retired = bus->retired;
  for (i = 0; i < fresh->header->domain_count; i++) {
    struct snapshot *before = &bus->snapshot[i], *now = &fresh->snapshot[i];
    uint64_t *image = before->image;
    before->image = NULL;
    if (before->words == now->words) {
      free_image(now->image);
      now->image = image;
    } else {
      image[-1] = (uint64_t)(uintptr_t)fresh->retired;
      fresh->retired = image;
    }
  }
}

/* Replaces the connection by a fresh one. Texts, tables and images keep their addresses, since the
 * program may have pointers to them. */
static void replace(ecat_t *bus, ecat_t *fresh) {
  const ecat_shm_header *h = fresh->header;
  uint32_t i;
  memcpy(bus->slaves, fresh->slaves, h->slave_count * sizeof *bus->slaves);
  memcpy(bus->signals, fresh->signals, h->signal_count * sizeof *bus->signals);
  memcpy(bus->domains, fresh->domains, h->domain_count * sizeof *bus->domains);
  free(fresh->tables);
  fresh->tables = bus->tables;
  fresh->slaves = bus->slaves;
  fresh->signals = bus->signals;
  fresh->domains = bus->domains;
  fresh->lost = bus->lost;
  memcpy(fresh->ended, bus->ended, sizeof fresh->ended);
  memcpy(fresh->handle, bus->handle, sizeof fresh->handle);
  fresh->handles = bus->handles;
  for (i = 0; i < h->can_count; i++) { /* reading goes on with the first record of the new daemon */
    fresh->can_use[i].listens = bus->can_use[i].listens;
    fresh->can_use[i].missed = bus->can_use[i].missed;
    fresh->can_use[i].lost = bus->can_use[i].lost || bus->can_use[i].sends;
  }
  bus->tables = NULL;
  keep_images(bus, fresh);
  ecat_slot_free(bus); /* ecat_output() may have mapped the old one again */
  ecat_memory_close(bus);
  *bus = *fresh;
  place_signals(bus);
  /* The layout of an image may have changed, so that old values would be misread. Reads therefore get the
   * new images until the next sample. */
  for (i = 0; i < bus->header->domain_count; i++) (void)ecat_page_copy(&bus->snapshot[i]);
}

int ecat_memory_look(ecat_t *bus) {
  ecat_t fresh = {.fd = -1, .out_fd = -1, .slot = -1};
  static const ecat_shm_header nothing;
  uint64_t now;
  int code;
  now = ecat_now();
  if (now - bus->tried_ns < RETURN_PAUSE_NS) return ecat_memory_check(bus, 0);
  bus->tried_ns = now;
  fresh.header = &nothing;
  strcpy(fresh.name, bus->name);
  strcpy(fresh.folder, bus->folder); /* a bus of this name elsewhere is another one */
  code = ecat_memory_open(&fresh);
  if (code == 0) code = check_same(&fresh, bus);
  if (code == 0) {
    replace(bus, &fresh);
    return 0;
  }
  ecat_memory_close(&fresh);
  memcpy(bus->error, fresh.error, sizeof bus->error);
  return down(bus, code);
}

int ecat_page_copy(struct snapshot *snapshot) {
  const ecat_shm_page *page = snapshot->page;
  const uint64_t *data = (const uint64_t *)(page + 1);
  uint64_t *image = snapshot->image;
  size_t words = snapshot->words;
  unsigned tries;
  for (tries = 0; tries < 1064; tries++) {
    size_t i;
    uint64_t before = __atomic_load_n(&page->seq, __ATOMIC_ACQUIRE);
    if ((before & 1) == 0) {
      snapshot->cycle = __atomic_load_n(&page->cycle, __ATOMIC_RELAXED);
      snapshot->time_ns = __atomic_load_n(&page->time_ns, __ATOMIC_RELAXED);
      snapshot->absent = __atomic_load_n(&page->absent, __ATOMIC_RELAXED);
      snapshot->wkc = __atomic_load_n(&page->wkc, __ATOMIC_RELAXED);
      snapshot->wkc_state = __atomic_load_n(&page->wkc_state, __ATOMIC_RELAXED);
#pragma GCC unroll 8
      for (i = 0; i < words; i++) image[i] = __atomic_load_n(&data[i], __ATOMIC_RELAXED);
      __atomic_thread_fence(__ATOMIC_ACQUIRE);
      if (__atomic_load_n(&page->seq, __ATOMIC_RELAXED) == before) return 0;
    }
    /* The engine writes for well under a microsecond. After 64 tries it was probably preempted: let it
     * run. */
    if (tries > 64) sched_yield();
  }
  return ECAT_ESTALE;
}
