/* Clients: who owns which outputs, what they want to send, and whether they are alive.
 *
 * Clients write into the .out segment whatever they like, at any time, and may cut the file short.
 * So it is only ever read with pread, every number from it is checked, and nothing in it decides
 * more than the outputs that its writer was granted.
 */
#include "engine.h"

#include <errno.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

int cyclic_slots_init(cyclic_t *c) {
  ssize_t n = pread(c->out_fd, &c->out, sizeof c->out, 0);
  struct stat status;
  uint32_t i;
  if (n != (ssize_t)sizeof c->out || c->out.slot_count > ECAT_SLOTS ||
      c->out.slot_count > c->header->slot_count || fstat(c->out_fd, &status) != 0)
    return -EINVAL;
  c->out_size = (size_t)status.st_size;
  c->out_map = mmap(NULL, c->out_size, PROT_READ, MAP_SHARED, c->out_fd, 0);
  if (c->out_map == MAP_FAILED) {
    c->out_map = NULL;
    return -errno;
  }
  for (i = 0; i < c->header->slave_count; i++) {
    c->slave_status[i].owner = -1;
    c->slave_status[i].outputs = ECAT_OUTPUTS_SAFE;
    c->slave_status[i].reason = ECAT_REASON_START;
  }
  return 0;
}

static uint8_t *output_of(const cyclic_t *c, uint8_t *image, uint32_t slave) {
  const ecat_shm_slave *s = &c->slaves[slave];
  return image + c->domain[s->domain].output_base + s->output_offset;
}

static void set_owner(cyclic_t *c, uint32_t slave, int32_t owner, uint32_t outputs,
                      uint32_t reason) {
  ecat_shm_slave_status *status = &c->slave_status[slave];
  __atomic_store_n(&status->outputs, outputs, __ATOMIC_RELAXED);
  __atomic_store_n(&status->reason, reason, __ATOMIC_RELAXED);
  __atomic_store_n(&status->since_cycle, c->cycle, __ATOMIC_RELAXED);
  __atomic_store_n(&status->owner, owner, __ATOMIC_RELEASE);
}

static void make_safe(cyclic_t *c, uint32_t slave, uint32_t reason) {
  uint8_t *to = output_of(c, c->outputs, slave);
  const uint8_t *safe = output_of(c, c->safe, slave), *hold = output_of(c, c->hold, slave);
  uint32_t i;
  int32_t slot = c->slave_status[slave].owner;
  for (i = 0; i < c->slaves[slave].output_bytes; i++)
    to[i] = (uint8_t)((to[i] & hold[i]) | (safe[i] & ~hold[i]));
  set_owner(c, slave, -1, ECAT_OUTPUTS_SAFE, reason);
  if (slot >= 0) (void)cyclic_emit(c, CYCLIC_EVENT_SAFE, (int32_t)slave, slot, reason);
}

static void drop_all(cyclic_t *c, uint32_t number, uint32_t reason) {
  uint32_t i;
  if (c->slot[number].owned == 0) return;
  for (i = 0; i < c->header->slave_count; i++)
    if (c->slave_status[i].owner == (int32_t)number) make_safe(c, i, reason);
  c->slot[number].owned = 0;
}

static off_t slot_at(const cyclic_t *c, uint32_t number) {
  return (off_t)c->out.slots_offset + (off_t)number * c->out.slot_stride;
}

static void read_claims(cyclic_t *c, uint32_t number) {
  struct slot *slot = &c->slot[number];
  int safe = __atomic_load_n(&c->make_safe, __ATOMIC_RELAXED);
  ecat_out_slot want;
  uint32_t i;
  if (pread(c->out_fd, &want, sizeof want, slot_at(c, number)) != (ssize_t)sizeof want) return;
  slot->lease_ns = want.lease_ns;
  if (slot->lease_ns < c->header->lease_ns) slot->lease_ns = c->header->lease_ns;
  if (slot->lease_ns > c->header->lease_max_ns) slot->lease_ns = c->header->lease_max_ns;
  for (i = 0; i < c->header->slave_count; i++) {
    int wanted = (int)(want.claims[i / 64] >> (i % 64) & 1);
    int32_t owner = c->slave_status[i].owner;
    if (wanted && owner < 0 && c->slaves[i].output_bytes > 0 && !safe) {
      set_owner(c, i, (int32_t)number, ECAT_OUTPUTS_CLAIMED, c->slave_status[i].reason);
      slot->owned++;
      cyclic_emit(c, CYCLIC_EVENT_CLAIMED, (int32_t)i, (int32_t)number, 0);
    } else if (!wanted && owner == (int32_t)number) {
      make_safe(c, i, ECAT_REASON_RELEASED);
      slot->owned--;
    }
  }
}

/* Takes the newest committed image over. The client goes round ECAT_IMAGES images, so the one that
 * was read is whole unless the client has meanwhile come round to it. */
static void read_image(cyclic_t *c, uint32_t number, uint32_t seq) {
  struct slot *slot = &c->slot[number];
  const ecat_out_image *image = (const void *)c->slot_image;
  size_t size = sizeof *image + c->header->output_bytes;
  off_t at = slot_at(c, number) + (off_t)sizeof(ecat_out_slot) +
             (off_t)(ECAT_REQUESTS * sizeof(ecat_out_request)) +
             (off_t)(seq % ECAT_IMAGES) * c->out.image_stride;
  off_t bell = (off_t)c->out.doorbells_offset + (off_t)(number * sizeof(ecat_out_doorbell)) +
               (off_t)offsetof(ecat_out_doorbell, commit_seq);
  uint32_t after, i;
  if (pread(c->out_fd, c->slot_image, size, at) != (ssize_t)size) return;
  __atomic_thread_fence(__ATOMIC_ACQUIRE);
  if (pread(c->out_fd, &after, sizeof after, bell) != (ssize_t)sizeof after) return;
  if (image->seq != seq || after - seq > ECAT_IMAGES - 2) {
    counter_add(&c->health->torn, 1);
    return; /* the newer image is read in the next cycle */
  }
  slot->commit_seq = seq;
  slot->commit_ns = image->commit_ns;
  slot->sample_cycle = image->sample_cycle;
  for (i = 0; i < c->header->slave_count; i++) {
    ecat_shm_slave_status *status = &c->slave_status[i];
    if (status->owner != (int32_t)number || !(image->written[i / 64] >> (i % 64) & 1)) continue;
    memcpy(output_of(c, c->outputs, i), output_of(c, c->slot_image + sizeof *image, i),
           c->slaves[i].output_bytes);
    if (status->outputs != ECAT_OUTPUTS_ACTIVE)
      set_owner(c, i, (int32_t)number, ECAT_OUTPUTS_ACTIVE, status->reason);
  }
  counter_add(&c->health->commits, 1);
}

static void begin(cyclic_t *c, uint32_t number, uint32_t generation) {
  struct slot *slot = &c->slot[number];
  drop_all(c, number, generation == 0 ? ECAT_REASON_RELEASED : ECAT_REASON_GONE);
  memset(slot, 0, sizeof *slot);
  slot->generation = generation;
  slot->beat_ns = c->now_ns;
  slot->lease_ns = c->header->lease_ns;
  c->slot_status[number].claim_ack = c->slot_status[number].commit_ack = 0;
  __atomic_store_n(&c->slot_status[number].state,
                   generation == 0 ? ECAT_SLOT_FREE : ECAT_SLOT_ACTIVE, __ATOMIC_RELAXED);
}

static void lapse(cyclic_t *c, uint32_t number) {
  ecat_shm_slot_status *status = &c->slot_status[number];
  drop_all(c, number, ECAT_REASON_LAPSED);
  counter_add(&c->health->lapses, 1);
  __atomic_store_n(&status->lapses, status->lapses + 1, __ATOMIC_RELAXED);
  __atomic_store_n(&status->state, ECAT_SLOT_LAPSED, __ATOMIC_RELEASE);
}

void cyclic_slots_read(cyclic_t *c) {
  size_t size = c->out.slot_count * sizeof(ecat_out_doorbell);
  uint32_t i;
  ssize_t n = pread(c->out_fd, c->doorbell, size, (off_t)c->out.doorbells_offset);
  if (n != (ssize_t)size) memset(c->doorbell, 0, size); /* cut short: all clients are gone */
  __atomic_thread_fence(__ATOMIC_ACQUIRE); /* what a doorbell announces is read after it */
  c->used = 0;
  for (i = 0; i < c->out.slot_count; i++) {
    const ecat_out_doorbell *bell = &c->doorbell[i];
    struct slot *slot = &c->slot[i];
    if ((bell->generation | slot->generation) == 0) continue;
    c->used |= 1u << i;
    if (bell->generation != slot->generation) begin(c, i, bell->generation);
    if (slot->generation == 0) continue;
    if (bell->heartbeat != slot->heartbeat) {
      slot->heartbeat = bell->heartbeat;
      slot->beat_ns = c->now_ns;
    }
    if (c->slot_status[i].state == ECAT_SLOT_LAPSED) {
      slot->claim_seq = bell->claim_seq; /* refused until it comes back as a new generation */
    } else {
      if (bell->claim_seq != slot->claim_seq) {
        slot->claim_seq = bell->claim_seq;
        read_claims(c, i);
      }
      if (bell->commit_seq != slot->commit_seq) read_image(c, i, bell->commit_seq);
      if (slot->owned > 0 && c->now_ns - slot->beat_ns > slot->lease_ns) lapse(c, i);
    }
    if (bell->request_seq != slot->request_seq &&
        cyclic_emit(c, CYCLIC_EVENT_REQUEST, -1, (int32_t)i, slot->generation))
      slot->request_seq = bell->request_seq;
  }
}

void cyclic_slots_sent(cyclic_t *c) {
  uint32_t left;
  for (left = c->used; left != 0; left &= left - 1) {
    struct slot *slot = &c->slot[__builtin_ctz(left)];
    uint64_t cycles;
    if (slot->commit_ns == 0) continue;
    /* Both numbers come from the client; a wrong one may spoil a statistic, nothing else. */
    if (slot->commit_ns <= c->send_ns) {
      cycles = c->cycle - slot->sample_cycle;
      cyclic_count(&c->health->delay, c->send_ns - slot->commit_ns);
      counter_add(&c->health->delay_cycles[cycles < 3 ? cycles : 3], 1);
    }
    slot->commit_ns = 0;
  }
}

void cyclic_slots_publish(cyclic_t *c) {
  uint32_t left;
  for (left = c->used; left != 0; left &= left - 1) {
    int i = __builtin_ctz(left);
    ecat_shm_slot_status *status = &c->slot_status[i];
    const struct slot *slot = &c->slot[i];
    if (status->commit_ack != slot->commit_seq) {
      __atomic_store_n(&status->commit_cycle, c->cycle, __ATOMIC_RELAXED);
      __atomic_store_n(&status->commit_ack, slot->commit_seq, __ATOMIC_RELEASE);
    }
    if (status->claim_ack != slot->claim_seq)
      __atomic_store_n(&status->claim_ack, slot->claim_seq, __ATOMIC_RELEASE);
    if (status->generation != slot->generation)
      __atomic_store_n(&status->generation, slot->generation, __ATOMIC_RELEASE);
  }
}

void cyclic_slots_make_safe(cyclic_t *c) {
  uint32_t i;
  for (i = 0; i < c->header->slave_count; i++)
    if (c->slaves[i].output_bytes > 0 &&
        (c->slave_status[i].owner >= 0 || c->slave_status[i].reason != ECAT_REASON_STOPPING))
      make_safe(c, i, ECAT_REASON_STOPPING);
  for (i = 0; i < ECAT_SLOTS; i++) c->slot[i].owned = 0;
}
