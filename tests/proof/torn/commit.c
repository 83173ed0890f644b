/* Clients that commit without end, one for each slave, against the engine that takes commits over. */
#include "torn.h"

#include <pthread.h>
#include <sched.h>
#include <stdio.h>
#include <string.h>

enum { UNSEEN = 16 };

struct writer {
  struct bench *bench;
  ecat_t *bus;
  pthread_t thread;
  int slave;
  uint64_t want, commits;
};

/* A commit that is changed after it was told, as no client may. */
static void spoil(const ecat_t *bus) {
  uint32_t seq = bus->doorbell->commit_seq;
  uint8_t *image = (uint8_t *)bus->out + bus->layout.images_offset +
                   (size_t)(seq % ECAT_IMAGES) * bus->layout.image_stride;
  uint32_t i;
  for (i = 0; i < bus->bytes; i++) image[sizeof(ecat_out_image) + bus->bytes + i] ^= 0x55;
}

static void *commit_all(void *argument) {
  struct writer *writer = argument;
  ecat_t *bus = writer->bus;
  uint64_t state = (uint64_t)writer->slave + 1;
  uint32_t i;
  if (ecat_claim(bus, writer->slave, 0) != 0) die(ecat_error(bus), 0);
  while (writer->commits < writer->want) {
    const ecat_shm_slave *slave = &bus->slaves[writer->slave];
    uint32_t number = bus->doorbell->commit_seq + 1;
    for (i = 0; i < slave->signals_count; i++) {
      uint64_t word = word_of(number, i);
      int signal = (int)(slave->signals_first + i);
      if (bus->signal[signal].bits == 8) word &= 0xFF;
      if (ecat_write_int(bus, signal, (int64_t)word) != 0) die(ecat_error(bus), number);
    }
    if (ecat_commit(bus) != 0) die(ecat_error(bus), number);
    if (writer->bench->broken) spoil(bus);
    writer->commits++;
    if (writer->bench->hurry) {
      if (ecat_sample(bus) != 0) die(ecat_error(bus), number);
      continue;
    }
    if (random_below(&state, 4) != 0) rest(random_below(&state, 2000));
    if (number - bus->slot_status[bus->slot].commit_ack > UNSEEN) sched_yield(); /* no engine runs */
  }
  __atomic_fetch_add(&writer->bench->ended, 1, __ATOMIC_RELEASE);
  return NULL;
}

/* Whether the outputs of a slave are all of the commit that the engine took last. */
static void check(const cyclic_t *c, const ecat_shm_slave *slave, uint32_t number) {
  const ecat_shm_signal *signal = &c->signals[slave->signals_first];
  uint32_t i;
  for (i = 0; i < slave->signals_count; i++) {
    uint64_t is = 0, is_to_be = number == 0 ? 0 : word_of(number, i);
    memcpy(&is, c->outputs + signal[i].bit_offset / 8, signal[i].bit_length / 8u);
    if (signal[i].bit_length == 8) is_to_be &= 0xFF;
    if (is != is_to_be) die("outputs of two commits", number);
  }
}

/* What the engine does in a cycle, as far as clients see it. */
static void cycle(struct bench *bench, uint32_t *last, uint64_t *taken) {
  cyclic_t *c = bench->engine;
  uint32_t i;
  c->cycle++;
  c->now_ns = cyclic_now();
  cyclic_slots_read(c);
  for (i = 0; i < bench->slaves; i++) {
    int owner = c->output[c->slaves[i].signals_first].owner;
    uint32_t number = owner >= 0 ? c->slot[owner].commit_seq : 0;
    check(c, &c->slaves[i], number);
    if (number < last[i]) die("a commit was taken after a newer one", number);
    *taken += number != last[i];
    last[i] = number;
  }
  cyclic_slots_publish(c);
  cyclic_publish_cycle(c, cyclic_now());
}

void take_commits(struct bench *bench) {
  struct writer writer[WRITERS] = {{0}};
  uint32_t i, last[WRITERS] = {0};
  uint64_t taken = 0;
  for (i = 0; i < bench->slaves; i++) {
    writer[i].bench = bench;
    writer[i].slave = (int)i;
    writer[i].want = bench->count / bench->slaves;
    writer[i].bus = connection(bench);
    pthread_create(&writer[i].thread, NULL, commit_all, &writer[i]);
  }
  while (__atomic_load_n(&bench->ended, __ATOMIC_ACQUIRE) < (int)bench->slaves) {
    cycle(bench, last, &taken);
    if (bench->hurry) nanosleep(&(struct timespec){0, 200000}, NULL);
  }
  cycle(bench, last, &taken);
  for (i = 0; i < bench->slaves; i++) {
    pthread_join(writer[i].thread, NULL);
    if (last[i] != writer[i].want) die("the last commit was not taken", last[i]);
    ecat_close(writer[i].bus);
  }
  printf("{\"commits\": %llu, \"taken\": %llu, \"torn\": %llu, \"malformed\": %llu}\n",
         (unsigned long long)(bench->count / bench->slaves * bench->slaves), (unsigned long long)taken,
         (unsigned long long)bench->engine->health->torn,
         (unsigned long long)bench->engine->health->malformed);
}
