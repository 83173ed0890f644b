/* Claims: the ownership of outputs, and its lease. */
#include "internal.h"

#include <stdio.h>
#include <string.h>
#include <unistd.h>

/* Announces the changed claims to the engine and waits until it has carried them out. Without an answer
 * within 0.5 s plus 100 cycles it fails with ECAT_ESTALE. */
static int ring_claims(ecat_t *bus) {
  const ecat_shm_slot_status *status = &bus->slot_status[bus->slot];
  uint32_t seq = bus->doorbell->claim_seq + 1;
  uint64_t start = ecat_now(), patience = 500000000u + 100 * bus->header->cycle_time_ns;
  ecat_beat(bus);
  __atomic_store_n(&bus->doorbell->claim_seq, seq, __ATOMIC_RELEASE);
  while (!(__atomic_load_n(&status->generation, __ATOMIC_ACQUIRE) == bus->generation &&
           __atomic_load_n(&status->claim_ack, __ATOMIC_ACQUIRE) == seq)) {
    int code = ecat_wait_until(bus, &bus->header->cycle, ecat_cycle(bus) + 1, ECAT_WAKE_CYCLE, 0.1);
    if (code == ECAT_EDOWN || code == ECAT_ESTALE) return code;
    ecat_beat(bus);
    if (ecat_now() - start > patience)
      return ecat_fail(bus, ECAT_ESTALE, "the daemon of bus '%s' does not answer a claim",
                       bus->name);
  }
  return 0;
}

/* Computes the part of the output image that holds all claimed outputs, and their longest lease. The
 * engine computes the same part from the claims. */
static void measure(ecat_t *bus) {
  uint32_t first = UINT32_MAX, end = 0;
  int i;
  bus->longest_ns = 0;
  for (i = 0; i < ecat_signal_count(bus); i++) {
    const struct signal *signal = &bus->signal[i];
    if (!set_has(bus->claims, (uint32_t)i)) continue;
    if (bus->lease_ns[i] > bus->longest_ns) bus->longest_ns = bus->lease_ns[i];
    if (signal->staged / 64 < first) first = signal->staged / 64;
    if ((signal->staged + signal->bits + 63) / 64 > end) end = (signal->staged + signal->bits + 63) / 64;
  }
  bus->first = end > 0 ? 8 * first : 0;
  bus->bytes = end > 0 ? 8 * (end - first) : 0;
}

static int check_outputs(ecat_t *bus, int position) {
  int code = ecat_check_position(bus, position);
  if (code != 0) return code;
  if (bus->slaves[position].output_bytes == 0)
    return ecat_fail(bus, ECAT_EARG, "slave %d (%s) of bus '%s' has no outputs", position,
                     ecat_shown(bus->slaves[position].name), bus->name);
  return 0;
}

int ecat_check_output(ecat_t *bus, int number) {
  const ecat_shm_signal *entry;
  int code = ecat_check_signal(bus, number);
  if (code != 0 || bus->signal[number].output) return code;
  entry = &bus->signals[number];
  return ecat_fail(bus, ECAT_EARG, "0x%04X:%02X of slave %d (%s) is an input: it has no owner and "
                   "cannot be written", entry->index, entry->subindex, entry->slave,
                   ecat_shown(bus->slaves[entry->slave].name));
}

int ecat_is_reserved(const ecat_t *bus, int number) {
  uint32_t state = __atomic_load_n(&bus->outputs[number].state, __ATOMIC_RELAXED);
  return state == ECAT_OUTPUTS_COPIED || state == ECAT_OUTPUTS_CAN;
}

/* The program name in a slot. The client wrote it, so characters that could change a terminal or a log
 * are replaced. */
static void name_of(const ecat_out_slot *slot, char name[33]) {
  size_t i;
  memcpy(name, slot->program, 32);
  name[32] = '\0';
  for (i = 0; name[i] != '\0'; i++)
    if (name[i] < ' ' || name[i] > '~') name[i] = '?';
}

/* Whether the pid in a slot means a process here: a container has a PID namespace of its own. */
static int is_here(const ecat_out_slot *slot) {
  uint64_t theirs = slot->pid_namespace, ours = ecat_pid_namespace();
  return theirs == ours || theirs == 0 || ours == 0;
}

void ecat_client_name(ecat_t *bus, int slot, char text[96]) {
  const ecat_out_slot *other = ecat_slot_of(bus, slot);
  char program[33];
  text[0] = '\0';
  if (other == NULL) return;
  name_of(other, program);
  snprintf(text, 96, "%s (pid %u%s)", program[0] != '\0' ? program : "another client", (unsigned)other->pid,
           is_here(other) ? "" : " in another PID namespace");
}

/* Sets the error text for an output that cannot be claimed because the daemon writes it. */
static int refused_reserved(ecat_t *bus, int number) {
  uint32_t source = bus->outputs[number].source;
  const ecat_shm_signal *entry = &bus->signals[number];
  const ecat_shm_signal *from = &bus->signals[source < bus->header->signal_count ? source : 0];
  if (__atomic_load_n(&bus->outputs[number].state, __ATOMIC_RELAXED) == ECAT_OUTPUTS_CAN)
    return ecat_fail(bus, ECAT_EOWNED,
                     "output 0x%04X:%02X of slave %d (%s) of bus '%s' cannot be claimed: the daemon exchanges "
                     "CAN frames with it ([slave.can] in its configuration); send frames instead, as with "
                     "`ecatctl can send`",
                     entry->index, entry->subindex, entry->slave,
                     ecat_shown(bus->slaves[entry->slave].name), bus->name);
  if (source >= bus->header->signal_count)
    return ecat_fail(bus, ECAT_EOWNED,
                     "output 0x%04X:%02X of slave %d (%s) of bus '%s' cannot be claimed: the daemon copies "
                     "an input to it that is not on the bus ([[copy]] in its configuration)",
                     entry->index, entry->subindex, entry->slave,
                     ecat_shown(bus->slaves[entry->slave].name), bus->name);
  return ecat_fail(bus, ECAT_EOWNED,
                   "output 0x%04X:%02X of slave %d (%s) of bus '%s' cannot be claimed: the daemon copies "
                   "input 0x%04X:%02X of slave %d (%s) to it ([[copy]] in its configuration)",
                   entry->index, entry->subindex, entry->slave,
                   ecat_shown(bus->slaves[entry->slave].name), bus->name, from->index, from->subindex,
                   from->slave, ecat_shown(bus->slaves[from->slave].name));
}

static int refused(ecat_t *bus, int conflict) {
  const ecat_out_slot *other;
  const ecat_shm_signal *entry;
  char program[33];
  const char *next = "; end it first";
  int here;
  if (conflict < 0 || conflict >= ecat_signal_count(bus))
    return ecat_fail(bus, ECAT_EDOWN, "the daemon of bus '%s' is stopping", bus->name);
  entry = &bus->signals[conflict];
  if (ecat_is_reserved(bus, conflict)) return refused_reserved(bus, conflict);
  other = ecat_slot_of(bus, __atomic_load_n(&bus->outputs[conflict].owner, __ATOMIC_ACQUIRE));
  if (other == NULL)
    return ecat_fail(bus, ECAT_EOWNED, "the outputs of slave %d were owned a moment ago; try again",
                     entry->slave);
  name_of(other, program);
  here = is_here(other);
  if (strncmp(program, "hand:", 5) == 0) /* as outputs by hand call themselves */
    next = "; somebody holds it by hand, as in another page: `ecatctl claims` shows who";
  else if (here && other->pid == (uint32_t)getpid())
    next = ", which is this program itself: only one of its connections can own it";
  return ecat_fail(bus, ECAT_EOWNED,
                   "output 0x%04X:%02X of slave %d (%s) of bus '%s' belongs to %s (pid %u%s)%s",
                   entry->index, entry->subindex, entry->slave,
                   ecat_shown(bus->slaves[entry->slave].name), bus->name,
                   program[0] != '\0' ? program : "another client", (unsigned)other->pid,
                   here ? "" : " in another PID namespace", next);
}

/* Prepares a claim: takes a slot and empties `bus->wish`, to which the caller adds the outputs it
 * wants. */
static int begin_claim(ecat_t *bus, double lease) {
  int code;
  if (!(lease >= 0)) return ecat_fail(bus, ECAT_EARG, "%g s is no lease", lease);
  if ((code = ecat_slot_take(bus)) != 0) return code;
  if (ecat_slot_lapsed(bus)) ecat_slot_begin(bus);
  if (ecat_can_beats(bus))
    return ecat_fail(bus, ECAT_EARG, "this connection sends on a CAN channel without a lease of its own: own outputs "
                     "with another connection, or claim the channel with a lease");
  memset(bus->wish, 0, bus->sets * sizeof *bus->wish);
  return 0;
}

/* The lease that the slot needs, if outputs need `outputs_ns`. */
static uint64_t lease_of(const ecat_t *bus, uint64_t outputs_ns) {
  uint64_t can_ns = ecat_can_lease(bus);
  return outputs_ns > can_ns ? outputs_ns : can_ns;
}

/* Writes what this client has into its slot, without `bus->wish`. */
static void want_claims(ecat_t *bus) {
  memcpy(bus->out_claims, bus->claims, bus->sets * sizeof *bus->claims);
  bus->out->lease_ns = lease_of(bus, bus->longest_ns);
  ecat_can_want(bus);
}

void ecat_claims_withdraw(ecat_t *bus) {
  if (bus->slot < 0) return; /* there is no daemon any more */
  want_claims(bus);
  __atomic_store_n(&bus->doorbell->claim_seq, bus->doorbell->claim_seq + 1, __ATOMIC_RELEASE);
}

int ecat_claims_ring(ecat_t *bus, int *conflict) {
  int code;
  want_claims(bus);
  if ((code = ring_claims(bus)) != 0) return code;
  *conflict = __atomic_load_n(&bus->slot_status[bus->slot].claim_conflict, __ATOMIC_RELAXED);
  return 0;
}

/* Adds the granted outputs to the claims. A repeated claim may lengthen a lease, but not shorten it. */
static void accept(ecat_t *bus, uint64_t lease_ns) {
  int i;
  for (i = 0; i < ecat_signal_count(bus); i++) {
    if (!set_has(bus->wish, (uint32_t)i)) continue;
    if (!set_has(bus->claims, (uint32_t)i) || lease_ns > bus->lease_ns[i])
      bus->lease_ns[i] = lease_ns;
    set_add(bus->claims, (uint32_t)i);
  }
  measure(bus);
  bus->lost = LOST_NOTHING;
}

/* Claims all outputs in `bus->wish`, or none of them. */
static int claim(ecat_t *bus, double lease) {
  uint64_t lease_ns = ecat_ns(lease), more = 0;
  int code, conflict, longer = lease_ns > bus->longest_ns;
  size_t i;
  for (i = 0; i < bus->sets; i++) more |= bus->wish[i] & ~bus->claims[i];
  if (more != 0 || longer) {
    for (i = 0; i < bus->sets; i++) bus->out_claims[i] = bus->claims[i] | bus->wish[i];
    bus->out->lease_ns = lease_of(bus, longer ? lease_ns : bus->longest_ns);
    if ((code = ring_claims(bus)) != 0) {
      ecat_claims_withdraw(bus); /* otherwise an engine that was only late could still grant it */
      return code;
    }
    conflict = __atomic_load_n(&bus->slot_status[bus->slot].claim_conflict, __ATOMIC_RELAXED);
    if (more != 0 && conflict != -1) {
      ecat_claims_withdraw(bus);
      return refused(bus, conflict);
    }
  }
  accept(bus, lease_ns);
  return 0;
}

static void disown(ecat_t *bus, uint32_t number) {
  const struct signal *signal = &bus->signal[number];
  set_drop(bus->claims, number);
  set_drop(bus->written, number);
  bits_put((uint8_t *)bus->mask, signal->staged, signal->bits, 0);
}

/* Releases the outputs in `bus->wish`. */
static int release(ecat_t *bus) {
  int i, less = 0, code = ecat_slot_check_home(bus);
  if (code != 0) return code;
  for (i = 0; i < ecat_signal_count(bus); i++) {
    if (!set_has(bus->wish, (uint32_t)i) || !set_has(bus->claims, (uint32_t)i)) continue;
    disown(bus, (uint32_t)i);
    less = 1;
  }
  if (!less || ecat_slot_lapsed(bus)) return 0;
  measure(bus);
  want_claims(bus);
  return ring_claims(bus);
}

static int check_list(ecat_t *bus, const int *numbers, size_t count) {
  size_t i;
  int code = 0;
  if (numbers == NULL && count > 0) return ecat_fail(bus, ECAT_EARG, "there is no list of outputs");
  for (i = 0; i < count && code == 0; i++) code = ecat_check_output(bus, numbers[i]);
  return code;
}

int ecat_claim_entries(ecat_t *bus, const int *numbers, size_t count, double lease) {
  size_t i;
  int code = check_list(bus, numbers, count);
  if (code != 0 || (code = begin_claim(bus, lease)) != 0 || count == 0) return code;
  for (i = 0; i < count; i++) set_add(bus->wish, (uint32_t)numbers[i]);
  return claim(bus, lease);
}

int ecat_release_entries(ecat_t *bus, const int *numbers, size_t count) {
  size_t i;
  int code = check_list(bus, numbers, count);
  if (code != 0 || bus->slot < 0) return code;
  memset(bus->wish, 0, bus->sets * sizeof *bus->wish);
  for (i = 0; i < count; i++) set_add(bus->wish, (uint32_t)numbers[i]);
  return release(bus);
}

int ecat_claim_entry(ecat_t *bus, int number, double lease) {
  return ecat_claim_entries(bus, &number, 1, lease);
}

int ecat_release_entry(ecat_t *bus, int number) { return ecat_release_entries(bus, &number, 1); }

/* Adds all outputs of a slave that may have an owner to `bus->wish`. */
static void wish_slave(ecat_t *bus, int position) {
  const ecat_shm_slave *slave = &bus->slaves[position];
  uint32_t i;
  for (i = slave->signals_first; i < slave->signals_first + slave->signals_count; i++)
    if (bus->signal[i].output && !ecat_is_reserved(bus, (int)i)) set_add(bus->wish, i);
}

int ecat_claim(ecat_t *bus, int position, double lease) {
  int code = check_outputs(bus, position);
  if (code != 0 || (code = begin_claim(bus, lease)) != 0) return code;
  wish_slave(bus, position);
  return claim(bus, lease);
}

int ecat_release(ecat_t *bus, int position) {
  int code = check_outputs(bus, position);
  if (code != 0 || bus->slot < 0) return code;
  memset(bus->wish, 0, bus->sets * sizeof *bus->wish);
  wish_slave(bus, position);
  return release(bus);
}

void ecat_release_all(ecat_t *bus) {
  int i;
  if (bus->map == NULL) return;
  ecat_slot_forget(bus);
  bus->lost = LOST_NOTHING;
  for (i = 0; i < ecat_can_count(bus); i++) bus->can_use[i].lost = 0;
  memset(bus->ended, 0, sizeof bus->ended);
}

int ecat_output(ecat_t *bus, int number, ecat_output_info *info) {
  const ecat_shm_output *output;
  const ecat_out_slot *slot;
  uint64_t since, now = ecat_now();
  int code = ecat_check_output(bus, number);
  if (code != 0) return code;
  output = &bus->outputs[number];
  memset(info, 0, sizeof *info);
  info->owner = __atomic_load_n(&output->owner, __ATOMIC_ACQUIRE);
  info->owned = set_has(bus->claims, (uint32_t)number) && !ecat_slot_lapsed(bus);
  info->state = (int)__atomic_load_n(&output->state, __ATOMIC_RELAXED);
  info->reason = (int)__atomic_load_n(&output->reason, __ATOMIC_RELAXED);
  info->since_cycle = __atomic_load_n(&output->since_cycle, __ATOMIC_RELAXED);
  since = __atomic_load_n(&output->since_ns, __ATOMIC_RELAXED);
  info->age = now > since ? (double)(now - since) * 1e-9 : 0;
  slot = ecat_slot_of(bus, info->owner);
  if (slot == NULL) return 0; /* no client owns it, or this user may not read the slots */
  info->pid = is_here(slot) ? slot->pid : 0;
  name_of(slot, info->program);
  return 0;
}
