/* The client's slot in the .out shared memory: taking it, using it and leaving it. */
#include "internal.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

static void unmap_out(ecat_t *bus) {
  if (bus->out_map != NULL) munmap(bus->out_map, bus->out_size);
  if (bus->out_fd >= 0) close(bus->out_fd); /* releases the lock, and with it the slot */
  if (bus->home != NULL) munmap(bus->home, 1);
  bus->out_map = NULL;
  bus->out_fd = -1;
  bus->home = NULL;
}

/* A forked child inherits the descriptor, and with it the lock of the slot, but the slot belongs to its
 * parent. The kernel clears one page in the child, so that a process can check without a system call
 * whether it is the child. */
static int mark_home(ecat_t *bus) {
  bus->home = mmap(NULL, 1, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  if (bus->home == MAP_FAILED) {
    bus->home = NULL;
    return ecat_fail(bus, ECAT_ESYS, "out of memory");
  }
  *bus->home = 1;
  (void)madvise(bus->home, 1, MADV_WIPEONFORK); /* since Linux 4.14 */
  return 0;
}

int ecat_slot_foreign(const ecat_t *bus) {
  return bus->home != NULL && *(const volatile char *)bus->home == 0;
}

int ecat_slot_check_home(ecat_t *bus) {
  if (bus->slot < 0 || !ecat_slot_foreign(bus)) return 0;
  return ecat_fail(bus, ECAT_EARG,
                   "the outputs and requests of this connection to bus '%s' belong to the process "
                   "that this one was forked from: open another connection", bus->name);
}

static int out_fits(const ecat_t *bus) {
  const ecat_out_header *header = &bus->layout;
  return header->magic == ECAT_OUT_MAGIC && header->layout >> 16 == ECAT_SHM_LAYOUT_MAJOR &&
         header->instance == bus->header->instance &&
         header->slot_count <= bus->header->slot_count &&
         header->doorbells_offset % 8 == 0 && header->slots_offset % 8 == 0 &&
         header->slot_stride % 8 == 0 && header->claims_offset % 8 == 0 &&
         header->images_offset % 8 == 0 && header->image_stride % 8 == 0 &&
         header->image_stride >=
             sizeof(ecat_out_image) + 2 * (((uint64_t)bus->header->output_bytes + 7) / 8 * 8) &&
         header->claims_offset >= sizeof(ecat_out_slot) + ECAT_REQUESTS * sizeof(ecat_out_request) &&
         header->images_offset >= (uint64_t)header->claims_offset + 8 * bus->sets &&
         header->can_offset % 8 == 0 && header->can_queues_offset % 8 == 0 &&
         header->can_offset >= header->images_offset + (uint64_t)ECAT_IMAGES * header->image_stride &&
         header->can_queues_offset >=
             header->can_offset + (uint64_t)bus->header->can_count * sizeof(ecat_out_can) &&
         header->slot_stride >= header->can_queues_offset + (uint64_t)bus->header->can_count * ECAT_CAN_QUEUE *
                                                                sizeof(ecat_out_can_frame) &&
         header->doorbells_offset + (uint64_t)header->slot_count * sizeof(ecat_out_doorbell) <=
             bus->out_size &&
         header->slots_offset + (uint64_t)header->slot_count * header->slot_stride <= bus->out_size;
}

static int map_out(ecat_t *bus) {
  char name[40], path[ECAT_SHM_PATH + 40], text[ECAT_SHM_TEXT];
  struct stat status;
  int code;
  if (bus->out_map != NULL) return 0;
  snprintf(name, sizeof name, "%s.out", bus->name);
  snprintf(path, sizeof path, "%s/%s", bus->folder, name);
  code = ecat_shm_open(bus->folder, name, 1, text);
  if (code == ECAT_EPERM && text[0] == '\0')
    return ecat_fail(bus, ECAT_EPERM,
                     "no right to write outputs of bus '%s': become a member of the group 'ecat' "
                     "('sudo usermod -aG ecat $USER', then log in again)", bus->name);
  if (code == ECAT_EDOWN) return ecat_fail(bus, code, "there is no %s; restart the daemon", path);
  if (code < 0) return ecat_fail(bus, code, "%s", text);
  bus->out_fd = code;
  if (fstat(bus->out_fd, &status) != 0 || (size_t)status.st_size < sizeof bus->layout) {
    unmap_out(bus);
    return ecat_fail(bus, ECAT_ELAYOUT, "%s is damaged; restart the daemon", path);
  }
  bus->out_size = (size_t)status.st_size;
  bus->out_map = mmap(NULL, bus->out_size, PROT_READ | PROT_WRITE, MAP_SHARED, bus->out_fd, 0);
  if (bus->out_map == MAP_FAILED) {
    int error = errno;
    bus->out_map = NULL;
    unmap_out(bus);
    return ecat_fail(bus, ECAT_ESYS, "cannot map %s: %s", path, strerror(error));
  }
  memcpy(&bus->layout, bus->out_map, sizeof bus->layout);
  if (!out_fits(bus)) {
    unmap_out(bus);
    return ecat_fail(bus, ECAT_ELAYOUT, "%s does not belong to the running daemon; restart it", path);
  }
  if ((code = mark_home(bus)) != 0) unmap_out(bus);
  return code;
}

static void program_name(char name[32]) {
  FILE *comm = fopen("/proc/self/comm", "re");
  memset(name, 0, 32);
  if (comm == NULL) return;
  if (fgets(name, 32, comm) != NULL) name[strcspn(name, "\n")] = '\0';
  fclose(comm);
}

uint64_t ecat_pid_namespace(void) {
  struct stat status;
  return stat("/proc/self/ns/pid", &status) == 0 ? (uint64_t)status.st_ino : 0;
}

void ecat_slot_begin(ecat_t *bus) {
  uint32_t before = bus->generation;
  uint64_t namespace = ecat_pid_namespace();
  char name[32];
  program_name(name); /* both are slow, so they are read before the slot is changed */
  memset(bus->claims, 0, 2 * bus->sets * sizeof *bus->claims); /* and `written` */
  memset(bus->mask, 0, bus->header->output_bytes);
  memset(bus->request, 0, sizeof bus->request);
  bus->first = bus->bytes = 0;
  bus->longest_ns = 0;
  bus->request_seq = bus->doorbell->request_seq;
  do bus->generation = ++bus->out->generation; /* skips 0, and in a wiped slot the last generation */
  while (bus->generation == 0 || bus->generation == before);
  /* The slot is freed only after the new generation is stored. So no number is used twice even if this
   * client is killed here, and the engine can see that the previous owner did not release the slot. */
  __atomic_store_n(&bus->doorbell->generation, 0, __ATOMIC_RELEASE);
  bus->out->lease_ns = 0;
  bus->out->since_ns = ecat_now();
  memcpy(bus->out->program, name, sizeof bus->out->program);
  bus->out->pid = (uint32_t)getpid();
  bus->out->pid_namespace = namespace;
  /* Clears requests, claims and anything that a later version may have put between them. */
  memset(bus->out + 1, 0, bus->layout.images_offset - sizeof *bus->out);
  ecat_can_begin(bus);
  bus->doorbell->life = ecat_life_word(bus);
  /* The counters in the doorbell continue where the last client of the slot left them: a repeated number
   * could be taken for the earlier one (tests/proof/claim.pml, request.pml). */
  ecat_beat(bus);
  __atomic_store_n(&bus->doorbell->generation, bus->generation, __ATOMIC_RELEASE);
}

int ecat_slot_overwritten(const ecat_t *bus) {
  return bus->slot >= 0 &&
         __atomic_load_n(&bus->doorbell->generation, __ATOMIC_RELAXED) != bus->generation;
}

int ecat_slot_lapsed(const ecat_t *bus) {
  const ecat_shm_slot_status *status;
  if (bus->slot < 0) return 0;
  status = &bus->slot_status[bus->slot];
  /* The claims were granted to this generation. If the engine has seen another one since, another program
   * has written over the slot. */
  if (__atomic_load_n(&status->generation, __ATOMIC_ACQUIRE) != bus->generation)
    return bus->bytes > 0 || ecat_can_lease(bus) > 0;
  return __atomic_load_n(&status->state, __ATOMIC_RELAXED) == ECAT_SLOT_LAPSED;
}

int ecat_slot_take(ecat_t *bus) {
  const ecat_out_header *header = &bus->layout;
  int code, i;
  if ((code = ecat_memory_return(bus)) != 0) return code;
  if ((code = ecat_slot_check_home(bus)) != 0) return code;
  if (bus->slot >= 0) {
    if (!ecat_slot_overwritten(bus)) return 0;
    if (bus->bytes > 0) bus->lost = LOST_PLACE;
    ecat_slot_begin(bus);
    return 0;
  }
  if (ecat_slot_foreign(bus)) unmap_out(bus); /* the locks would still belong to the parent */
  if ((code = ecat_memory_age(bus)) == ECAT_EDOWN || (code = map_out(bus)) != 0) return code;
  for (i = 0; i < (int)header->slot_count; i++) {
    struct flock lock = {
        .l_type = F_WRLCK, .l_whence = SEEK_SET, .l_start = ECAT_LOCK_SLOT + i, .l_len = 1};
    if (fcntl(bus->out_fd, F_OFD_SETLK, &lock) != 0) continue;
    bus->slot = i;
    bus->doorbell = (ecat_out_doorbell *)(void *)(bus->out_map + header->doorbells_offset) + i;
    bus->out = (void *)(bus->out_map + header->slots_offset + (size_t)i * header->slot_stride);
    bus->out_claims = (void *)((uint8_t *)bus->out + header->claims_offset);
    ecat_life_begin(bus);
    ecat_slot_begin(bus);
    return 0;
  }
  return ecat_fail(bus, ECAT_EFULL,
                   "all %u client slots of bus '%s' are taken: close a client that writes outputs",
                   (unsigned)header->slot_count, bus->name);
}

void ecat_slot_free(ecat_t *bus) {
  if (bus->slot >= 0 && !ecat_slot_foreign(bus)) {
    struct flock lock = {.l_type = F_UNLCK, .l_whence = SEEK_SET,
                         .l_start = ECAT_LOCK_SLOT + bus->slot, .l_len = 1};
    __atomic_store_n(&bus->doorbell->generation, 0, __ATOMIC_RELEASE);
    ecat_life_end(bus); /* before another client has the doorbell */
    bus->doorbell->life = 0;
    (void)fcntl(bus->out_fd, F_OFD_SETLK, &lock); /* a forked process may keep the descriptor open */
  }
  ecat_life_forget(bus);
  bus->slot = -1;
  bus->doorbell = NULL;
  unmap_out(bus);
}

void ecat_slot_forget(ecat_t *bus) {
  int i;
  ecat_can_lose(bus);
  if (bus->bytes > 0) bus->lost = LOST_DAEMON;
  for (i = 0; i < ECAT_REQUESTS; i++) {
    if (bus->request[i] != 0) bus->ended[i] = 1;
    bus->request[i] = 0;
  }
  memset(bus->claims, 0, 2 * bus->sets * sizeof *bus->claims); /* and `written` */
  memset(bus->mask, 0, bus->header->output_bytes);
  bus->first = bus->bytes = 0;
  ecat_slot_free(bus);
}

const ecat_out_slot *ecat_slot_of(ecat_t *bus, int slot) {
  if (slot < 0 || map_out(bus) != 0 || slot >= (int)bus->layout.slot_count) return NULL;
  return (const void *)(bus->out_map + bus->layout.slots_offset +
                        (size_t)slot * bus->layout.slot_stride);
}
