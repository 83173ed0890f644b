/* Clients that die while they own outputs, and those who watch it. The rig is `line:4`: each slave
 * has 32 entries of a byte as outputs, and returns them as inputs. */
#ifndef DEATH_H
#define DEATH_H

#include "../../fuzz/random.h"
#include "internal.h"

#include <sys/types.h>

enum {
  VICTIM = 0, WRITER = 1,   /* slaves: of whom dies, and of one who is not to notice */
  SLAVES = 2,               /* that are looked at */
  BYTES = 32,
  FIXED = 0, HELD = 1,      /* entries with other safe values than zero; see the test */
  FIXED_VALUE = 0x11,
  ENTRY = 5,                /* that is claimed alone, sometimes */
  RECORDS = 1 << 16,
  PATIENCE = 60000          /* cycles */
};

/* What victims send, and what those send who come after them. */
enum { OF_VICTIM = 0x80, OF_HEIR = 0xC0, FAMILY = 0xC0 };

/* What the victim is doing. */
enum phase { OPENING, CLAIMING, WAITING, SAMPLING, WRITING, COMMITTING, RELEASING, PHASES };

/* Between victim and parent. */
struct stage {
  int phase, trap;          /* phase in which the victim stops for the debugger, -1: none */
  int visits;               /* after so many times */
  int owning;               /* times that a claim was granted */
  int told;                 /* times that it heard that its lease was over */
  int slot;                 /* -1: none yet */
};

/* One cycle, as a reader sees it. */
struct record {
  uint64_t cycle, time_ns, missed;
  uint8_t out[SLAVES][BYTES], in[SLAVES][BYTES];
};

__attribute__((noreturn, format(printf, 1, 2))) void die(const char *format, ...);
ecat_t *connect_to(const char *name);
void next_cycle(ecat_t *bus);
/* Outputs of a slave, all with one value, but for `only` alone if it is not -1. */
void write_bytes(ecat_t *bus, int slave, int only, int value);
int output_of(const ecat_t *bus, int slave, int number);

/* watch.c: a reader of every cycle, and a writer of another slave; threads of this process. */
void watch_start(const char *name);
void watch_stop(void);
uint64_t watch_newest(void);
const struct record *watch_record(uint64_t cycle); /* NULL: the reader has missed it */
/* From cycle `first` on slave VICTIM is sent its safe outputs. Whether it has returned them by now: its
 * program takes its time, as that of a real slave does. */
int watch_check_safe(uint64_t first, uint64_t end);
void watch_check_no_victim(uint64_t first, uint64_t end);

/* victim.c */
pid_t victim_start(const char *name, struct stage *stage, uint64_t seed);

#endif
