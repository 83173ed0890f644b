/* The client's slot: claims, staged outputs, commits. */
#include "internal.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

static int map_out(ecat_t *bus) {
  char path[64];
  struct stat status;
  ecat_out_header *header = &bus->layout;
  if (bus->out_map != NULL) return 0;
  snprintf(path, sizeof path, "/dev/shm/ecat.%s.out", bus->name);
  bus->out_fd = open(path, O_RDWR | O_CLOEXEC | O_NOFOLLOW);
  if (bus->out_fd < 0) {
    if (errno == EACCES)
      return ecat_fail(bus, ECAT_EPERM,
                       "no right to write outputs of bus '%s': become a member of the group 'ecat' "
                       "('sudo usermod -aG ecat $USER', then log in again)", bus->name);
    return ecat_fail(bus, ECAT_EDOWN, "cannot open %s: %s", path, strerror(errno));
  }
  if (fstat(bus->out_fd, &status) != 0 || (size_t)status.st_size < sizeof *header)
    return ecat_fail(bus, ECAT_ELAYOUT, "%s is too short; restart the daemon", path);
  bus->out_size = (size_t)status.st_size;
  bus->out_map = mmap(NULL, bus->out_size, PROT_READ | PROT_WRITE, MAP_SHARED, bus->out_fd, 0);
  if (bus->out_map == MAP_FAILED) {
    bus->out_map = NULL;
    return ecat_fail(bus, ECAT_ESYS, "cannot map %s: %s", path, strerror(errno));
  }
  memcpy(header, bus->out_map, sizeof *header);
  if (header->magic != ECAT_OUT_MAGIC || header->layout >> 16 != ECAT_SHM_LAYOUT_MAJOR ||
      header->instance != bus->header->instance || header->slot_count > ECAT_SLOTS ||
      header->doorbells_offset % 8 != 0 || header->slots_offset % 8 != 0 ||
      header->slot_stride % 8 != 0 || header->image_stride % 8 != 0 ||
      header->image_stride < sizeof(ecat_out_image) + bus->header->output_bytes ||
      header->slot_stride < sizeof(ecat_out_slot) + ECAT_REQUESTS * sizeof(ecat_out_request) +
                                (uint64_t)ECAT_IMAGES * header->image_stride ||
      header->doorbells_offset + (uint64_t)header->slot_count * sizeof(ecat_out_doorbell) >
          bus->out_size ||
      header->slots_offset + (uint64_t)header->slot_count * header->slot_stride > bus->out_size) {
    munmap(bus->out_map, bus->out_size);
    bus->out_map = NULL;
    close(bus->out_fd);
    bus->out_fd = -1;
    return ecat_fail(bus, ECAT_ELAYOUT, "%s does not belong to the running daemon; open the bus again",
                     path);
  }
  return 0;
}

/* Starts a new life in the slot: the engine forgets whatever its number stood for before. */
static void begin_generation(ecat_t *bus) {
  FILE *comm;
  memset(bus->claims, 0, sizeof bus->claims);
  memset(bus->written, 0, sizeof bus->written);
  memset(bus->request, 0, sizeof bus->request);
  bus->request_seq = 0;
  __atomic_store_n(&bus->doorbell->generation, 0, __ATOMIC_RELEASE);
  bus->generation = bus->out->generation + 1;
  if (bus->generation == 0) bus->generation = 1;
  /* First of all, so that no number is used twice wherever this client ends. */
  bus->out->generation = bus->generation;
  bus->out->lease_ns = 0;
  memset(bus->out->claims, 0, sizeof bus->out->claims);
  memset(bus->out->program, 0, sizeof bus->out->program);
  bus->out->pid = (uint32_t)getpid();
  comm = fopen("/proc/self/comm", "re");
  if (comm != NULL) {
    if (fgets(bus->out->program, sizeof bus->out->program, comm) != NULL)
      bus->out->program[strcspn(bus->out->program, "\n")] = '\0';
    fclose(comm);
  }
  memset(bus->out + 1, 0, ECAT_REQUESTS * sizeof(ecat_out_request));
  bus->doorbell->claim_seq = bus->doorbell->commit_seq = bus->doorbell->request_seq = 0;
  bus->doorbell->heartbeat++;
  __atomic_store_n(&bus->doorbell->generation, bus->generation, __ATOMIC_RELEASE);
}

int ecat_slot_lapsed(const ecat_t *bus) {
  const ecat_shm_slot_status *status;
  if (bus->slot < 0) return 0;
  status = &bus->slot_status[bus->slot];
  return __atomic_load_n(&status->generation, __ATOMIC_ACQUIRE) == bus->generation &&
         __atomic_load_n(&status->state, __ATOMIC_RELAXED) == ECAT_SLOT_LAPSED;
}

int ecat_slot_take(ecat_t *bus) {
  const ecat_out_header *header = &bus->layout;
  int code, i;
  if (bus->slot >= 0) return 0;
  if ((code = map_out(bus)) != 0) return code;
  for (i = 0; i < (int)header->slot_count; i++) {
    struct flock lock = {
        .l_type = F_WRLCK, .l_whence = SEEK_SET, .l_start = LOCK_SLOT + i, .l_len = 1};
    if (fcntl(bus->out_fd, F_OFD_SETLK, &lock) != 0) continue;
    bus->slot = i;
    bus->doorbell = (ecat_out_doorbell *)(void *)(bus->out_map + header->doorbells_offset) + i;
    bus->out = (void *)(bus->out_map + header->slots_offset + (size_t)i * header->slot_stride);
    begin_generation(bus);
    return 0;
  }
  return ecat_fail(bus, ECAT_EFULL,
                   "all %u client slots of bus '%s' are taken: close a client that writes outputs",
                   (unsigned)header->slot_count, bus->name);
}

void ecat_slot_free(ecat_t *bus) {
  if (bus->slot >= 0) __atomic_store_n(&bus->doorbell->generation, 0, __ATOMIC_RELEASE);
  if (bus->out_map != NULL) munmap(bus->out_map, bus->out_size);
  if (bus->out_fd >= 0) close(bus->out_fd); /* frees the lock, and so the slot */
}

/* Tells the engine that the claims have changed, and waits until it has carried that out. */
static int ring_claims(ecat_t *bus) {
  const ecat_shm_slot_status *status = &bus->slot_status[bus->slot];
  uint32_t seq = bus->doorbell->claim_seq + 1;
  uint64_t start = ecat_now(), patience = 500000000u + 20 * bus->header->cycle_time_ns;
  uint64_t waited = bus->waited_cycle; /* waiting here must not count as the caller's waiting */
  int code = 0;
  bus->doorbell->heartbeat++;
  __atomic_store_n(&bus->doorbell->claim_seq, seq, __ATOMIC_RELEASE);
  while (!(__atomic_load_n(&status->generation, __ATOMIC_ACQUIRE) == bus->generation &&
           __atomic_load_n(&status->claim_ack, __ATOMIC_ACQUIRE) == seq)) {
    bus->waited_cycle = ecat_cycle(bus);
    code = ecat_wait(bus, 1, 0.1);
    if (code == ECAT_EDOWN || code == ECAT_ESTALE) break;
    bus->doorbell->heartbeat++;
    if (ecat_now() - start > patience) {
      code = ecat_fail(bus, ECAT_ESTALE, "the daemon of bus '%s' does not answer a claim",
                       bus->name);
      break;
    }
    code = 0;
  }
  bus->waited_cycle = waited;
  return code;
}

static int check_claim(ecat_t *bus, int position) {
  if (position < 0 || position >= ecat_slave_count(bus))
    return ecat_fail(bus, ECAT_EBUS, "bus '%s' has no slave %d: it has %d", bus->name, position,
                     ecat_slave_count(bus));
  if (bus->slaves[position].output_bytes == 0)
    return ecat_fail(bus, ECAT_EARG, "slave %d (%s) of bus '%s' has no outputs", position,
                     bus->slaves[position].name, bus->name);
  return 0;
}

static int owned_by_other(ecat_t *bus, int position, int owner) {
  const ecat_out_header *header = &bus->layout;
  const ecat_out_slot *other;
  char program[33];
  if (__atomic_load_n(&bus->header->state, __ATOMIC_RELAXED) != ECAT_BUS_RUNNING)
    return ecat_fail(bus, ECAT_EDOWN, "the daemon of bus '%s' is stopping", bus->name);
  if (owner < 0 || owner >= (int)header->slot_count)
    return ecat_fail(bus, ECAT_ESTALE, "the claim of slave %d was not granted; try again", position);
  other = (const void *)(bus->out_map + header->slots_offset + (size_t)owner * header->slot_stride);
  memcpy(program, other->program, 32);
  program[32] = '\0';
  return ecat_fail(bus, ECAT_EOWNED,
                   "the outputs of slave %d (%s) of bus '%s' belong to %s (pid %u); end it first",
                   position, bus->slaves[position].name, bus->name,
                   program[0] != '\0' ? program : "another client", (unsigned)other->pid);
}

/* What the engine sends while nobody writes is the start of what this client will send: entries
 * that it never writes keep their safe value. */
static int stage_safe_values(ecat_t *bus, int position) {
  const ecat_shm_slave *slave = &bus->slaves[position];
  const ecat_shm_domain *domain = &bus->domains[slave->domain];
  const struct snapshot *snapshot = &bus->snapshot[slave->domain];
  struct snapshot ignored;
  if (ecat_page_copy(snapshot->page, bus->scratch, snapshot->words, &ignored) != 0)
    return ecat_fail(bus, ECAT_ESTALE, "the outputs of bus '%s' could not be read", bus->name);
  memcpy(bus->stage + domain->output_base + slave->output_offset,
         (const uint8_t *)bus->scratch + slave->output_offset, slave->output_bytes);
  return 0;
}

int ecat_claim(ecat_t *bus, int position, double lease) {
  int code = check_claim(bus, position), owner, longer;
  unsigned bit = (unsigned)position;
  if (!(lease >= 0)) return ecat_fail(bus, ECAT_EARG, "%g s is no lease", lease);
  if (code != 0 || (code = ecat_slot_take(bus)) != 0) return code;
  if (ecat_slot_lapsed(bus)) begin_generation(bus);
  longer = ecat_ns(lease) > bus->out->lease_ns;
  if (longer) bus->out->lease_ns = ecat_ns(lease);
  if (bit_get(bus->claims, bit)) return longer ? ring_claims(bus) : 0;
  bit_set(bus->out->claims, bit);
  if ((code = ring_claims(bus)) != 0) {
    bit_clear(bus->out->claims, bit);
    return code;
  }
  owner = __atomic_load_n(&bus->slave_status[position].owner, __ATOMIC_ACQUIRE);
  if (owner != bus->slot) {
    bit_clear(bus->out->claims, bit);
    ring_claims(bus);
    return owned_by_other(bus, position, owner);
  }
  if ((code = stage_safe_values(bus, position)) != 0) return code;
  bit_set(bus->claims, bit);
  bit_clear(bus->written, bit);
  return 0;
}

int ecat_release(ecat_t *bus, int position) {
  int code = check_claim(bus, position);
  unsigned bit = (unsigned)position;
  if (code != 0) return code;
  if (bus->slot < 0 || !bit_get(bus->claims, bit)) return 0;
  bit_clear(bus->claims, bit);
  bit_clear(bus->written, bit);
  bit_clear(bus->out->claims, bit);
  return ring_claims(bus);
}

static void put_bits(const struct signal *signal, uint8_t *image, uint64_t bits) {
  unsigned done = 0, shift = signal->shift;
  if (shift == 0 && signal->bits % 8 == 0) {
    memcpy(image, &bits, signal->bits / 8u);
    return;
  }
  while (done < signal->bits) {
    unsigned count = 8 - shift;
    uint8_t mask;
    if (count > signal->bits - done) count = signal->bits - done;
    mask = (uint8_t)(((1u << count) - 1) << shift);
    *image = (uint8_t)((*image & ~mask) | ((uint8_t)(bits >> done << shift) & mask));
    done += count;
    shift = 0;
    image++;
  }
}

/* The entry if this client may write it, else NULL and a code. */
static const struct signal *writable(ecat_t *bus, int number, int *code) {
  const struct signal *signal;
  if (number < 0 || number >= ecat_signal_count(bus)) {
    *code = ecat_fail(bus, ECAT_EARG, "%d is no signal: bus '%s' has %d", number, bus->name,
                      ecat_signal_count(bus));
    return NULL;
  }
  signal = &bus->signal[number];
  if (!signal->output) {
    *code = ecat_fail(bus, ECAT_EARG, "0x%04X:%02X of slave %d (%s) is an input and cannot be written",
                      bus->signals[number].index, bus->signals[number].subindex, signal->slave,
                      bus->slaves[signal->slave].name);
    return NULL;
  }
  if (!bit_get(bus->claims, signal->slave)) {
    *code = ecat_fail(bus, ECAT_ECLAIM, "the outputs of slave %d (%s) must be claimed before they are written",
                      signal->slave, bus->slaves[signal->slave].name);
    return NULL;
  }
  return signal;
}

static int out_of_range(ecat_t *bus, int number, double value) {
  const struct signal *signal = &bus->signal[number];
  double low = signal->sign ? -ldexp(1, signal->bits - 1) : 0;
  double high = ldexp(1, signal->sign ? signal->bits - 1 : signal->bits) - 1;
  return ecat_fail(bus, ECAT_ERANGE,
                   "%.15g is out of range for 0x%04X:%02X (%s) of slave %d (%s): whole numbers from "
                   "%.15g to %.15g are allowed",
                   value, bus->signals[number].index, bus->signals[number].subindex,
                   bus->signals[number].name, signal->slave, bus->slaves[signal->slave].name, low,
                   high);
}

static int stage(ecat_t *bus, const struct signal *signal, uint64_t bits) {
  put_bits(signal, bus->stage + signal->staged, bits);
  bit_set(bus->written, signal->slave);
  return 0;
}

int ecat_write_int(ecat_t *bus, int number, int64_t value) {
  int code = 0;
  const struct signal *signal = writable(bus, number, &code);
  if (signal == NULL) return code;
  if (signal->real) return ecat_write(bus, number, (double)value);
  if (signal->bits < 64) {
    int64_t low = signal->sign ? -(1ll << (signal->bits - 1)) : 0;
    int64_t high = (int64_t)((1ull << (signal->bits - signal->sign)) - 1);
    if (value < low || value > high) return out_of_range(bus, number, (double)value);
  }
  return stage(bus, signal, (uint64_t)value);
}

int ecat_write(ecat_t *bus, int number, double value) {
  int code = 0;
  uint64_t bits = 0;
  const struct signal *signal = writable(bus, number, &code);
  if (signal == NULL) return code;
  if (signal->real) {
    if (signal->bits == 32) {
      float single = (float)value;
      memcpy(&bits, &single, 4);
    } else {
      memcpy(&bits, &value, 8);
    }
    return stage(bus, signal, bits);
  }
  /* NaN fails both comparisons; 2^63 and 2^64 are exact as double, so the casts below are sound. */
  if (!(value >= -9223372036854775808.0 && value < 18446744073709551616.0) ||
      value != floor(value))
    return out_of_range(bus, number, value);
  if (value >= 9223372036854775808.0) {
    if (signal->sign || signal->bits < 64) return out_of_range(bus, number, value);
    return stage(bus, signal, (uint64_t)value);
  }
  if (value < 0 && !signal->sign) return out_of_range(bus, number, value);
  return ecat_write_int(bus, number, (int64_t)value);
}

int ecat_write_physical(ecat_t *bus, int number, double value) {
  const ecat_shm_signal *entry;
  if (number < 0 || number >= ecat_signal_count(bus)) return ecat_write(bus, number, value);
  entry = &bus->signals[number];
  value = (value - entry->offset) / entry->scale;
  return ecat_write(bus, number, bus->signal[number].real ? value : nearbyint(value));
}

int ecat_commit(ecat_t *bus) {
  ecat_out_image *image;
  uint32_t seq;
  if (bus->slot < 0) return 0;
  if (ecat_slot_lapsed(bus)) {
    memset(bus->claims, 0, sizeof bus->claims);
    return ecat_fail(bus, ECAT_ELEASE,
                     "bus '%s': this client did not sample in time and lost its outputs, which are at "
                     "their safe values now; claim them again with a longer lease",
                     bus->name);
  }
  seq = bus->doorbell->commit_seq + 1;
  image = (void *)((uint8_t *)(bus->out + 1) + ECAT_REQUESTS * sizeof(ecat_out_request) +
                   (size_t)(seq % ECAT_IMAGES) * bus->layout.image_stride);
  /* The engine trusts an older image while this number is unchanged: no byte of this one may come
   * before the number of the last. */
  __atomic_thread_fence(__ATOMIC_RELEASE);
  image->seq = seq;
  image->commit_ns = ecat_now();
  image->sample_cycle = bus->sample_cycle;
  memcpy(image->written, bus->written, sizeof image->written);
  memcpy(image + 1, bus->stage, bus->header->output_bytes);
  bus->doorbell->heartbeat++;
  __atomic_store_n(&bus->doorbell->commit_seq, seq, __ATOMIC_RELEASE);
  return 0;
}
