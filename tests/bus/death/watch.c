/* A reader that looks at every cycle, and a writer of another slave. Neither is to notice anything. */
#include "death.h"

#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static struct record records[RECORDS];
static uint64_t newest;
static int stop, writing;
static pthread_t reader_thread, writer_thread;

static uint8_t safe(int number) { return number == FIXED ? FIXED_VALUE : 0; }

static int uniform(const uint8_t *bytes) {
  int i;
  for (i = 1; i < BYTES; i++)
    if (bytes[i] != bytes[0]) return 0;
  return 1;
}

/* Outputs of the victim's slave are those of one commit, whole, or safe. What is held may be that of
 * an earlier one. */
static void check_whole(const struct record *now, const uint8_t *bytes) {
  int i, active = 0, value = bytes[ENTRY];
  for (i = 0; i < BYTES; i++) {
    if (i == HELD || bytes[i] == safe(i)) continue;
    if (bytes[i] != value || value < OF_VICTIM)
      die("cycle %llu: half a commit: entry %d is 0x%02X, entry %d is 0x%02X",
          (unsigned long long)now->cycle, i, bytes[i], ENTRY, value);
    active++;
  }
  if (active == BYTES - 1 ? bytes[HELD] != value : active > 1)
    die("cycle %llu: half a commit: %d of %d entries, 0x%02X", (unsigned long long)now->cycle, active,
        BYTES, bytes[HELD]);
}

static void look(const ecat_t *bus, struct record *now) {
  const struct snapshot *snapshot = &bus->snapshot[0];
  const ecat_shm_health *health = (const void *)(bus->map + bus->header->health_offset);
  const uint8_t *image = (const uint8_t *)snapshot->image;
  int i;
  now->time_ns = snapshot->time_ns;
  now->missed = __atomic_load_n(&health->missed, __ATOMIC_RELAXED);
  for (i = 0; i < SLAVES; i++) {
    memcpy(now->out[i], image + bus->slaves[i].output_offset, BYTES);
    memcpy(now->in[i], image + bus->slaves[i].input_offset, BYTES);
  }
  check_whole(now, now->out[VICTIM]);
  check_whole(now, now->in[VICTIM]);
  if (!uniform(now->out[WRITER]) || !uniform(now->in[WRITER]))
    die("cycle %llu: half a commit of the other writer", (unsigned long long)snapshot->cycle);
  if (__atomic_load_n(&writing, __ATOMIC_ACQUIRE) && now->out[WRITER][0] == 0)
    die("cycle %llu: outputs of the other writer are safe", (unsigned long long)snapshot->cycle);
  __atomic_store_n(&now->cycle, snapshot->cycle, __ATOMIC_RELEASE);
}

static void *reader(void *name) {
  ecat_t *bus = connect_to(name);
  while (!__atomic_load_n(&stop, __ATOMIC_RELAXED)) {
    next_cycle(bus);
    if (ecat_sample(bus) != 0) continue;
    if (bus->sample_cycle == newest) continue;
    if (bus->sample_cycle < newest) die("an older cycle after a newer one");
    look(bus, &records[bus->sample_cycle % RECORDS]);
    __atomic_store_n(&newest, bus->sample_cycle, __ATOMIC_RELEASE);
  }
  ecat_close(bus);
  return NULL;
}

static void *writer(void *name) {
  ecat_t *bus = connect_to(name);
  int value = 0, entry;
  if (ecat_claim(bus, WRITER, 20.0) != 0) die("the other writer: %s", ecat_error(bus));
  entry = output_of(bus, WRITER, 0);
  while (!__atomic_load_n(&stop, __ATOMIC_RELAXED)) {
    ecat_output_info info;
    next_cycle(bus);
    (void)ecat_sample(bus);
    write_bytes(bus, WRITER, -1, 1 + value++ % 255);
    if (ecat_commit(bus) != 0) die("the other writer: %s", ecat_error(bus));
    if (ecat_output(bus, entry, &info) != 0 || info.owner != bus->slot)
      die("the other writer has lost its outputs to slot %d", info.owner);
    if (info.state == ECAT_OUTPUTS_ACTIVE && value == 10) __atomic_store_n(&writing, 1, __ATOMIC_RELEASE);
  }
  __atomic_store_n(&writing, 0, __ATOMIC_RELEASE);
  ecat_close(bus);
  return NULL;
}

void watch_start(const char *name) {
  if (pthread_create(&reader_thread, NULL, reader, (void *)(uintptr_t)name) != 0 ||
      pthread_create(&writer_thread, NULL, writer, (void *)(uintptr_t)name) != 0)
    die("no threads");
  while (!__atomic_load_n(&writing, __ATOMIC_ACQUIRE)) nanosleep(&(struct timespec){0, 1000000}, NULL);
}

void watch_stop(void) {
  __atomic_store_n(&stop, 1, __ATOMIC_RELAXED);
  pthread_join(writer_thread, NULL);
  pthread_join(reader_thread, NULL);
}

uint64_t watch_newest(void) { return __atomic_load_n(&newest, __ATOMIC_ACQUIRE); }

const struct record *watch_record(uint64_t cycle) {
  const struct record *record = &records[cycle % RECORDS];
  return __atomic_load_n(&record->cycle, __ATOMIC_ACQUIRE) == cycle ? record : NULL;
}

static int is_safe(const uint8_t *bytes) {
  int i;
  for (i = 0; i < BYTES; i++)
    if (i != HELD && bytes[i] != safe(i)) return 0;
  return 1;
}

int watch_check_safe(uint64_t first, uint64_t end) {
  uint64_t cycle;
  int back = 0;
  for (cycle = first; cycle < end; cycle++) {
    const struct record *record = watch_record(cycle);
    if (record == NULL) continue;
    if (!is_safe(record->out[VICTIM]))
      die("cycle %llu: outputs that are sent are not safe", (unsigned long long)cycle);
    if (back && !is_safe(record->in[VICTIM]))
      die("cycle %llu: outputs that came back are not safe any more", (unsigned long long)cycle);
    back = is_safe(record->in[VICTIM]);
  }
  return back;
}

void watch_check_no_victim(uint64_t first, uint64_t end) {
  uint64_t cycle;
  for (cycle = first; cycle < end; cycle++) {
    const struct record *record = watch_record(cycle);
    int i;
    for (i = 0; record != NULL && i < BYTES; i++)
      if (i != HELD && (record->out[VICTIM][i] & FAMILY) == OF_VICTIM)
        die("cycle %llu: a value of a client that has lost its lease", (unsigned long long)cycle);
  }
}
