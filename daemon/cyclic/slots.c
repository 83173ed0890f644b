/* Clients: reads their claims, commits and heartbeats from the .out shared memory.
 *
 * Clients may write anything into the .out shared memory at any time, and may truncate the file. So the
 * engine reads it only with pread, and checks every number from it. A client can affect no outputs
 * except those that it owns.
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
  if (n != (ssize_t)sizeof c->out || c->out.slot_count > ECAT_SLOTS ||
      c->out.slot_count > c->header->slot_count || fstat(c->out_fd, &status) != 0)
    return -EINVAL;
  c->out_size = (size_t)status.st_size;
  c->out_map = mmap(NULL, c->out_size, PROT_READ, MAP_SHARED, c->out_fd, 0);
  if (c->out_map == MAP_FAILED) {
    c->out_map = NULL;
    return -errno;
  }
  return 0;
}

static off_t slot_at(const cyclic_t *c, uint32_t number) {
  return (off_t)c->out.slots_offset + (off_t)number * c->out.slot_stride;
}

static void refuse(cyclic_t *c, uint32_t number) {
  counter_add(&c->health->malformed, 1);
  if (!c->slot[number].told_malformed)
    c->slot[number].told_malformed = cyclic_emit(c, CYCLIC_EVENT_MALFORMED, -1, (int32_t)number,
                                                 c->slot[number].generation);
}

static void read_claims(cyclic_t *c, uint32_t number) {
  struct slot *slot = &c->slot[number];
  ecat_shm_slot_status *status = &c->slot_status[number];
  size_t size = (c->header->signal_count + 63) / 64 * sizeof *c->wanted;
  off_t at = slot_at(c, number);
  ecat_out_slot want;
  int32_t conflict, can;
  if (pread(c->out_fd, &want, sizeof want, at) != (ssize_t)sizeof want ||
      pread(c->out_fd, c->wanted, size, at + (off_t)c->out.claims_offset) != (ssize_t)size)
    return;
  slot->lease_ns = want.lease_ns;
  if (slot->lease_ns < c->header->lease_ns) slot->lease_ns = c->header->lease_ns;
  if (slot->lease_ns > c->header->lease_max_ns) slot->lease_ns = c->header->lease_max_ns;
  __atomic_store_n(&status->lease_ns, slot->lease_ns, __ATOMIC_RELAXED);
  can = cyclic_can_claim(c, number);
  conflict = cyclic_outputs_claim(c, number);
  if (conflict == CYCLIC_CONFLICT_NONE) conflict = can;
  __atomic_store_n(&status->claim_conflict, conflict, __ATOMIC_RELAXED);
  if (conflict >= 0) {
    counter_add(&c->health->conflicts, 1);
    cyclic_emit(c, CYCLIC_EVENT_CONFLICT, c->signals[conflict].slave, (int32_t)number,
                (uint32_t)conflict);
  }
}

/* Reads commit `seq` of a slot into `slot_image`, and then the number of the newest commit. The client uses
 * ECAT_IMAGES images in turn, so the copy is consistent unless the client has reached this image again. */
static int read_image(cyclic_t *c, uint32_t number, uint32_t seq, uint32_t *newest) {
  size_t size = sizeof(ecat_out_image) + 2 * (size_t)c->slot[number].bytes;
  off_t at = slot_at(c, number) + (off_t)c->out.images_offset +
             (off_t)(seq % ECAT_IMAGES) * c->out.image_stride;
  off_t bell = (off_t)c->out.doorbells_offset + (off_t)(number * sizeof(ecat_out_doorbell)) +
               (off_t)offsetof(ecat_out_doorbell, commit_seq);
  ssize_t n;
  if (pread(c->out_fd, c->slot_image, size, at) != (ssize_t)size) return 0;
  __atomic_thread_fence(__ATOMIC_ACQUIRE);
  n = pread(c->out_fd, newest, sizeof *newest, bell);
  __atomic_thread_fence(__ATOMIC_ACQUIRE); /* `newest` may be the next commit to be read */
  return n == (ssize_t)sizeof *newest;
}

enum { TRIES = 4 };

/* Reads the newest commit: `seq` or a later one. A client that commits without a pause may overwrite an
 * image before it is read. Then `overtaken` asks the client to wait a little, and the engine tries the
 * next image, at most TRIES times. */
static int find_image(cyclic_t *c, uint32_t number, uint32_t seq) {
  ecat_shm_slot_status *status = &c->slot_status[number];
  const ecat_out_image *image = (const void *)c->slot_image;
  uint32_t newest, tries;
  for (tries = 0; tries < TRIES; tries++) {
    if (!read_image(c, number, seq, &newest)) return 0;
    if (image->seq == seq && image->generation == c->slot[number].generation &&
        newest - seq <= ECAT_IMAGES - 2)
      return 1;
    if (newest == seq) break;
    if (tries == 0) __atomic_store_n(&status->overtaken, status->overtaken + 1, __ATOMIC_RELAXED);
    seq = newest;
  }
  counter_add(&c->health->torn, 1); /* read again in the next cycle */
  return 0;
}

/* Whether the client and the engine may disagree about the client's outputs without an error of the
 * client: either the daemon is stopping, and the client does not know it yet, or the engine has not yet
 * read a change of the claims. */
static int is_out_of_date(const cyclic_t *c, uint32_t number) {
  uint32_t claim_seq;
  off_t bell = (off_t)c->out.doorbells_offset + (off_t)(number * sizeof(ecat_out_doorbell)) +
               (off_t)offsetof(ecat_out_doorbell, claim_seq);
  if (__atomic_load_n(&c->make_safe, __ATOMIC_RELAXED)) return 1;
  return pread(c->out_fd, &claim_seq, sizeof claim_seq, bell) == (ssize_t)sizeof claim_seq &&
         claim_seq != c->slot[number].claim_seq;
}

/* Takes the newest commit over. */
static void take_image(cyclic_t *c, uint32_t number, uint32_t seq) {
  struct slot *slot = &c->slot[number];
  const ecat_out_image *image = (const void *)c->slot_image;
  if (!find_image(c, number, seq)) return;
  if (image->first != slot->first || image->bytes != slot->bytes) {
    if (is_out_of_date(c, number)) return; /* read again in the next cycle */
    slot->commit_seq = image->seq;
    refuse(c, number);
    return;
  }
  slot->commit_seq = image->seq;
  slot->commit_ns = image->commit_ns;
  slot->sample_cycle = image->sample_cycle;
  cyclic_outputs_take(c, number, (const uint64_t *)(const void *)(image + 1));
  counter_add(&c->health->commits, 1);
}

/* The reason why a slot has lost its client. A client that leaves only writes generation 0 into its
 * doorbell. A client that takes the slot of a dead client first writes its own generation into the slot.
 * If the slot cannot be read, the file was truncated. */
static uint32_t why_ended(const cyclic_t *c, uint32_t number, uint32_t generation) {
  ecat_out_slot slot;
  if (generation == 0 && pread(c->out_fd, &slot, sizeof slot, slot_at(c, number)) == sizeof slot &&
      slot.generation == c->slot[number].generation)
    return ECAT_REASON_RELEASED;
  return ECAT_REASON_GONE;
}

/* Begins a generation. The new client may have sent claims and requests already, but no commits, since it
 * owns nothing yet. */
static void begin(cyclic_t *c, uint32_t number, const ecat_out_doorbell *bell) {
  uint32_t generation = bell->generation;
  struct slot *slot = &c->slot[number];
  ecat_shm_slot_status *status = &c->slot_status[number];
  uint32_t why = why_ended(c, number, generation);
  cyclic_outputs_drop(c, number, why);
  /* To send ends in order by a claim. A client that leaves before may have crashed. */
  (void)cyclic_can_drop(c, number, why == ECAT_REASON_RELEASED ? ECAT_REASON_GONE : why);
  slot->can_seq = bell->can_seq;
  slot->heartbeat = bell->heartbeat;
  slot->claim_seq = bell->claim_seq - 1;
  slot->commit_seq = bell->commit_seq;
  slot->request_seq = bell->request_seq - 1;
  slot->commit_ns = 0;
  slot->told_malformed = 0;
  slot->generation = generation;
  slot->beat_ns = c->now_ns;
  slot->lease_ns = c->header->lease_ns;
  __atomic_store_n(&status->lease_ns, slot->lease_ns, __ATOMIC_RELAXED);
  __atomic_store_n(&status->beat_ns, c->now_ns, __ATOMIC_RELAXED);
  __atomic_store_n(&status->refused, 0, __ATOMIC_RELAXED);
  __atomic_store_n(&status->state, generation == 0 ? ECAT_SLOT_FREE : ECAT_SLOT_ACTIVE,
                   __ATOMIC_RELAXED);
}

static void lapse(cyclic_t *c, uint32_t number, uint32_t reason) {
  ecat_shm_slot_status *status = &c->slot_status[number];
  int has_outputs = c->slot[number].bytes > 0;
  if (has_outputs) cyclic_outputs_drop(c, number, reason);
  if (cyclic_can_drop(c, number, reason) || has_outputs) {
    counter_add(&c->health->lapses, 1);
    __atomic_store_n(&status->lapses, status->lapses + 1, __ATOMIC_RELAXED);
  }
  __atomic_store_n(&status->reason, reason, __ATOMIC_RELAXED);
  __atomic_store_n(&status->state, ECAT_SLOT_LAPSED, __ATOMIC_RELEASE);
}

void cyclic_slots_lapse_domain(cyclic_t *c, uint32_t domain) {
  uint32_t i;
  for (i = 0; i < c->out.slot_count; i++)
    if (cyclic_outputs_has_domain(c, i, domain)) lapse(c, i, ECAT_REASON_WKC);
}

/* Sends an event about new requests, but only one until control has called cyclic_listen(): a client with
 * endless requests must not fill the event queue. */
static void tell_requests(cyclic_t *c, uint32_t number, uint32_t seq) {
  uint32_t bit = 1u << number;
  if (__atomic_load_n(&c->request_told, __ATOMIC_ACQUIRE) & bit) return;
  __atomic_fetch_or(&c->request_told, bit, __ATOMIC_ACQ_REL);
  if (cyclic_emit(c, CYCLIC_EVENT_REQUEST, -1, (int32_t)number, c->slot[number].generation))
    c->slot[number].request_seq = seq;
  else
    __atomic_fetch_and(&c->request_told, ~bit, __ATOMIC_RELEASE);
}

/* A client that owns no outputs and sends on no CAN channel has no lease. */
static int lease_has_ended(const cyclic_t *c, const struct slot *slot) {
  return (slot->bytes > 0 || slot->can_sends != 0) && c->now_ns - slot->beat_ns > slot->lease_ns;
}

static void look_at_slot(cyclic_t *c, uint32_t number, const ecat_out_doorbell *bell) {
  struct slot *slot = &c->slot[number];
  ecat_shm_slot_status *status = &c->slot_status[number];
  if (bell->heartbeat != slot->heartbeat) {
    slot->heartbeat = bell->heartbeat;
    slot->beat_ns = c->now_ns;
    __atomic_store_n(&status->beat_ns, c->now_ns, __ATOMIC_RELAXED);
  }
  /* What a dead client has committed or claimed last is not looked at: its outputs go to their safe values. */
  if ((bell->life & ECAT_DIED) != 0 && status->state != ECAT_SLOT_LAPSED)
    lapse(c, number, ECAT_REASON_DIED);
  if (status->state == ECAT_SLOT_LAPSED) {
    slot->claim_seq = bell->claim_seq; /* claims are refused until a new generation begins */
  } else {
    /* The commit is read before the claims, since the client made it with its earlier claims. */
    if (bell->commit_seq != slot->commit_seq) take_image(c, number, bell->commit_seq);
    if (bell->claim_seq != slot->claim_seq && c->claim_turn == number) {
      slot->claim_seq = bell->claim_seq;
      read_claims(c, number);
    }
    if (bell->can_seq != slot->can_seq) {
      slot->can_seq = bell->can_seq;
      cyclic_can_look(c, number);
    }
    if (lease_has_ended(c, slot)) lapse(c, number, ECAT_REASON_LAPSED);
  }
  if (bell->request_seq != slot->request_seq) tell_requests(c, number, bell->request_seq);
}

/* Chooses the slot whose claims are read in this cycle. There is one slot in each cycle, in turn, so that
 * many clients that change their claims all the time cost no more than one such client. */
static void choose_claims(cyclic_t *c) {
  uint32_t i;
  for (i = 1; i <= c->out.slot_count; i++) {
    uint32_t number = (c->claim_turn + i) % c->out.slot_count;
    const struct slot *slot = &c->slot[number];
    if (slot->generation == 0 || c->doorbell[number].claim_seq == slot->claim_seq) continue;
    c->claim_turn = number;
    return;
  }
}

void cyclic_slots_read(cyclic_t *c) {
  size_t size = c->out.slot_count * sizeof(ecat_out_doorbell);
  uint32_t i;
  ssize_t n = pread(c->out_fd, c->doorbell, size, (off_t)c->out.doorbells_offset);
  if (n != (ssize_t)size) memset(c->doorbell, 0, size); /* truncated: drops all clients */
  __atomic_thread_fence(__ATOMIC_ACQUIRE); /* claims, commits and requests are read after the doorbells */
  c->used = 0;
  for (i = 0; i < c->out.slot_count; i++) {
    uint32_t generation = c->doorbell[i].generation;
    if ((generation | c->slot[i].generation) == 0) continue;
    c->used |= 1u << i;
    if (generation != c->slot[i].generation) begin(c, i, &c->doorbell[i]);
  }
  if (c->used != 0) choose_claims(c);
  for (i = 0; i < c->out.slot_count; i++)
    if (c->slot[i].generation != 0) look_at_slot(c, i, &c->doorbell[i]);
}

void cyclic_slots_sent(cyclic_t *c) {
  uint32_t left;
  for (left = c->used; left != 0; left &= left - 1) {
    struct slot *slot = &c->slot[__builtin_ctz(left)];
    uint64_t cycles;
    if (slot->commit_ns == 0) continue;
    /* Both numbers come from the client. A wrong number only falsifies a statistic. */
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
