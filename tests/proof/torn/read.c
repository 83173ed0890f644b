/* One writer, the engine's, against READERS readers that sample as programs do. */
#include "torn.h"

#include <pthread.h>
#include <sched.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { SAME = 16, MEETINGS = 1000, MOST = 500 };

struct reader {
  struct bench *bench;
  ecat_t *bus;
  pthread_t thread;
  uint64_t want, reads, met, gave_up, cycles;
};

/* What a snapshot says about its cycle, the bytes above all. */
static void check(const struct bench *bench, ecat_t *bus) {
  const struct snapshot *snapshot = &bus->snapshot[0];
  uint64_t cycle = snapshot->cycle;
  size_t size = 0, i;
  const uint8_t *image = ecat_image(bus, 0, &size);
  if (size != bench->size) die("an image of another size", size);
  for (i = 0; i + 8 <= size; i += 8) {
    uint64_t word;
    memcpy(&word, image + i, 8);
    if (word != word_of(cycle, i / 8)) die("an image of two cycles", cycle);
  }
  if (i < size) {
    uint64_t word = word_of(cycle, i / 8);
    if (memcmp(image + i, &word, size - i) != 0) die("an image of two cycles", cycle);
  }
  if (snapshot->time_ns != word_of(cycle, 100000)) die("a time of another cycle", cycle);
  if (snapshot->wkc != (uint32_t)word_of(cycle, 100001)) die("a counter of another cycle", cycle);
  if (snapshot->wkc_state != cycle % 3) die("a state of another cycle", cycle);
}

/* Reads enough, and until enough of them have met the writer: how soon they do is up to the machine. */
static int goes_on(const struct reader *reader) {
  if (reader->reads < reader->want) return 1;
  return reader->met <= reader->want / MEETINGS && reader->reads < MOST * reader->want;
}

static void *read_all(void *argument) {
  struct reader *reader = argument;
  ecat_t *bus = reader->bus;
  const ecat_shm_page *page = bus->snapshot[0].page;
  uint64_t last = 0;
  int same = 0;
  while (goes_on(reader)) {
    uint64_t before = __atomic_load_n(&page->seq, __ATOMIC_ACQUIRE);
    int code = ecat_sample_domain(bus, 0);
    if (code == ECAT_ESTALE) {
      reader->gave_up++; /* overtaken a thousand times; never told as good */
      continue;
    }
    if (code != 0) die(ecat_error(bus), reader->reads);
    check(reader->bench, bus);
    if (bus->snapshot[0].cycle < last) die("time went backwards", last);
    same = bus->snapshot[0].cycle == last ? same + 1 : 0;
    reader->cycles += same == 0;
    last = bus->snapshot[0].cycle;
    /* The writer was at work between the first look and the end. */
    reader->met += before % 2 == 1 || last != before / 2;
    reader->reads++;
    if (same > SAME) sched_yield(); /* the writer has no processor: these reads say little */
  }
  __atomic_fetch_add(&reader->bench->ended, 1, __ATOMIC_RELEASE);
  return NULL;
}

/* As cyclic_publish_domain(), but readers are not told that it is at work. */
static void publish_unmarked(const cyclic_t *c, const struct domain *domain, uint64_t time_ns) {
  ecat_shm_page *page = domain->page;
  uint64_t *data = (uint64_t *)(page + 1);
  const uint64_t *image = (const void *)domain->image;
  uint32_t i;
  __atomic_store_n(&page->cycle, c->cycle, __ATOMIC_RELAXED);
  __atomic_store_n(&page->time_ns, time_ns, __ATOMIC_RELAXED);
  __atomic_store_n(&page->wkc, domain->wkc, __ATOMIC_RELAXED);
  __atomic_store_n(&page->wkc_state, domain->wkc_state, __ATOMIC_RELAXED);
  for (i = 0; i < (domain->image_bytes + 7) / 8; i++)
    __atomic_store_n(&data[i], image[i], __ATOMIC_RELAXED);
  __atomic_store_n(&page->seq, page->seq + 2, __ATOMIC_RELEASE);
}

static void write_cycle(const struct bench *bench) {
  cyclic_t *c = bench->engine;
  struct domain *domain = &c->domain[0];
  uint64_t *image = (uint64_t *)(void *)domain->image;
  uint32_t i;
  c->cycle++;
  for (i = 0; i < (bench->size + 7) / 8; i++) image[i] = word_of(c->cycle, i);
  domain->wkc = (uint32_t)word_of(c->cycle, 100001);
  domain->wkc_state = (uint32_t)(c->cycle % 3);
  if (bench->broken)
    publish_unmarked(c, domain, word_of(c->cycle, 100000));
  else
    cyclic_publish_domain(c, domain, word_of(c->cycle, 100000));
}

void read_images(struct bench *bench) {
  struct reader reader[READERS] = {{0}}, all = {0};
  uint64_t state = 1;
  int i;
  write_cycle(bench);
  for (i = 0; i < READERS; i++) {
    reader[i].bench = bench;
    reader[i].want = bench->count / READERS;
    reader[i].bus = connection(bench);
    pthread_create(&reader[i].thread, NULL, read_all, &reader[i]);
  }
  /* It never sleeps. The rests, of any length about that of a read and often none, let readers get
   * through, and see to it that they meet the writer at every point. */
  while (__atomic_load_n(&bench->ended, __ATOMIC_ACQUIRE) < READERS) {
    write_cycle(bench);
    if (random_below(&state, 4) != 0) rest(random_below(&state, 400 + bench->size * 2));
  }
  for (i = 0; i < READERS; i++) {
    pthread_join(reader[i].thread, NULL);
    all.reads += reader[i].reads;
    all.met += reader[i].met;
    all.gave_up += reader[i].gave_up;
    all.cycles += reader[i].cycles;
    ecat_close(reader[i].bus);
  }
  printf("{\"reads\": %llu, \"met\": %llu, \"gave_up\": %llu, \"cycles\": %llu, \"published\": %llu}\n",
         (unsigned long long)all.reads, (unsigned long long)all.met, (unsigned long long)all.gave_up,
         (unsigned long long)all.cycles, (unsigned long long)bench->engine->cycle);
}
