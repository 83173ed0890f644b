/* Clients die at random points while they own outputs.
 *
 * usage: dying BUS ROUNDS SEED
 *
 * In each round a victim is killed, stopped, or stopped by a debugger that has had it execute some
 * single instructions of ecat_claim, ecat_sample, ecat_write, ecat_commit or ecat_release. Counted
 * is in cycles, from the last sign of life that the engine saw (ecat_shm_slot_status.beat_ns, which
 * lies in one of the cycles that the reader has recorded) to the cycle of the safe outputs.
 * Prints what was reached, as JSON; ends with a sentence as soon as something is wrong.
 */
#include "death.h"

#include <errno.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/ptrace.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

enum kind { KILLED, STOPPED, STEPPED_AND_KILLED, STEPPED_AND_LEFT, REPLACED, KINDS };
static const char *const KIND[KINDS] = {"killed", "stopped", "stepped_and_killed", "stepped_and_left",
                                        "replaced"};
static const char *const PHASE[PHASES] = {"open", "claim", "wait", "sample", "write", "commit",
                                          "release"};

static struct {
  unsigned kinds[KINDS], phases[PHASES], measured, resumed, reasons[8];
  int excess;               /* cycles beyond the lease; the most of all */
  unsigned long steps;
} reached = {.excess = -1000};

static ecat_t *eye;          /* of the parent: it only reads */
static const char *name;
static struct stage *stage;
static struct source source;

void die(const char *format, ...) {
  va_list arguments;
  va_start(arguments, format);
  fprintf(stderr, "dying: ");
  vfprintf(stderr, format, arguments);
  fprintf(stderr, "\n");
  va_end(arguments);
  _exit(1);
}

ecat_t *connect_to(const char *bus_name) {
  ecat_t *bus = NULL;
  if (ecat_open(&bus, bus_name) != 0) die("%s", ecat_error(bus));
  return bus;
}

/* A machine that stands still for a moment is no error; a daemon that ends is. */
void next_cycle(ecat_t *bus) {
  int code = ecat_wait(bus, 1, 1.0);
  if (code != 0 && code != ECAT_ETIMEOUT && code != ECAT_ESTALE) die("wait: %s", ecat_error(bus));
}

int output_of(const ecat_t *bus, int slave, int number) {
  return (int)bus->slaves[slave].signals_first + number;
}

void write_bytes(ecat_t *bus, int slave, int only, int value) {
  int i;
  for (i = 0; i < BYTES; i++)
    if ((only < 0 || only == i) && ecat_write(bus, output_of(bus, slave, i), value) != 0)
      die("write: %s", ecat_error(bus));
}

static void cycles_pass(unsigned count) {
  while (count-- > 0) next_cycle(eye);
}

static int get(const int *number) { return __atomic_load_n(number, __ATOMIC_ACQUIRE); }

/* --- the debugger --------------------------------------------------------------------------- */

static unsigned steps_in[PHASES]; /* instructions that a phase takes, as far as is known */

static void wait_stop(pid_t victim) {
  int status;
  if (waitpid(victim, &status, 0) != victim || !WIFSTOPPED(status)) die("the victim has ended");
}

/* Has the victim run into a phase, and executes some single instructions of it. */
static void step(pid_t victim, int phase) {
  unsigned i, steps, most = steps_in[phase] > 0 ? steps_in[phase] : 4000;
  wait_stop(victim); /* at the beginning of the phase */
  steps = below(&source, most + most / 8);
  for (i = 0; i < steps; i++) {
    if (ptrace(PTRACE_SINGLESTEP, victim, NULL, NULL) != 0) die("step: %s", strerror(errno));
    wait_stop(victim);
    if (get(&stage->phase) == phase) continue;
    if (steps_in[phase] == 0 || i < steps_in[phase]) steps_in[phase] = i;
    break; /* it has left; a point of its own */
  }
  reached.steps += i;
}

/* --- the end of a victim ------------------------------------------------------------------- */

static const ecat_shm_output *outputs(int number) { return &eye->outputs[output_of(eye, VICTIM, number)]; }

static int owner(int number) { return __atomic_load_n(&outputs(number)->owner, __ATOMIC_ACQUIRE); }

/* Waits until nobody owns an output of the victim's slave; the slot that did, -1: none. */
static int wait_safe(void) {
  int i, tries, slot = -1;
  for (tries = 0; tries < PATIENCE; tries++) {
    int unsafe = 0;
    for (i = 0; i < BYTES; i++) {
      if (owner(i) >= 0) slot = owner(i);
      unsafe |= owner(i) >= 0 || outputs(i)->state != ECAT_OUTPUTS_SAFE;
    }
    /* What the victim has asked for may still be granted in the next cycles. */
    if (!unsafe && tries > 4) return slot;
    next_cycle(eye);
  }
  die("outputs stay as they are");
}

/* The cycle that began at this time; 0 where the reader has missed the one before. */
static uint64_t cycle_at(uint64_t begin_ns, uint64_t latest) {
  uint64_t cycle = latest;
  const struct record *record;
  while ((record = watch_record(cycle)) != NULL && record->time_ns > begin_ns) cycle--;
  return record != NULL ? cycle + 1 : 0;
}

static uint64_t missed_between(uint64_t first, uint64_t last) {
  const struct record *before = watch_record(first), *after = watch_record(last);
  if (before == NULL || after == NULL) return UINT64_MAX;
  return after->missed - before->missed;
}

/* A lease that is over: the outputs are safe within two cycles of it. */
static void measure(int slot, uint64_t safe_cycle, uint64_t safe_ns) {
  const ecat_shm_slot_status *status = &eye->slot_status[slot];
  uint64_t cycle_ns = eye->header->cycle_time_ns;
  uint64_t lease = (status->lease_ns + cycle_ns - 1) / cycle_ns, beat, missed;
  int excess;
  if (safe_ns - status->beat_ns <= status->lease_ns) die("outputs are safe before the lease is over");
  if ((beat = cycle_at(status->beat_ns, safe_cycle + 1)) == 0) return;
  missed = missed_between(beat - 1, safe_cycle + 1);
  if (missed == UINT64_MAX) return;
  excess = (int)(safe_cycle - beat - missed - lease);
  if (excess > 2)
    die("outputs are safe %d cycles after the lease of %llu (cycles %llu to %llu, %llu missed)", excess,
        (unsigned long long)lease, (unsigned long long)beat, (unsigned long long)safe_cycle,
        (unsigned long long)missed);
  if (excess > reached.excess) reached.excess = excess;
  reached.measured++;
}

/* Returns the cycle from which on the victim's outputs are safe. */
static uint64_t judge(uint64_t begin) {
  int i, slot = wait_safe(), lapsed = 0, tries;
  uint64_t safe_cycle = begin, safe_ns = 0;
  for (i = 0; i < BYTES; i++) {
    if (outputs(i)->since_cycle <= safe_cycle) continue;
    safe_cycle = outputs(i)->since_cycle;
    safe_ns = outputs(i)->since_ns;
    lapsed = outputs(i)->reason == ECAT_REASON_LAPSED;
    reached.reasons[outputs(i)->reason % 8]++;
  }
  while (watch_newest() < safe_cycle + 4) next_cycle(eye);
  if (lapsed && slot >= 0) measure(slot, safe_cycle, safe_ns);
  for (tries = 0; !watch_check_safe(safe_cycle, watch_newest()); tries++) {
    if (tries == PATIENCE) die("safe outputs do not arrive at the slave");
    next_cycle(eye);
  }
  return safe_cycle;
}

static void bury(pid_t victim) {
  int status;
  kill(victim, SIGKILL);
  do {
    if (waitpid(victim, &status, 0) != victim) die("the victim is gone");
  } while (WIFSTOPPED(status));
  if (!WIFSIGNALED(status)) die("the victim has ended by itself");
}

/* Another client takes the slave over. */
static ecat_t *inherit(void) {
  ecat_t *heir = connect_to(name);
  int n, code = ecat_claim(heir, VICTIM, 20.0);
  if (code != 0) die("the slave cannot be claimed again: %s", ecat_error(heir));
  for (n = 0; n < 4; n++) {
    write_bytes(heir, VICTIM, -1, OF_HEIR | n);
    if (ecat_commit(heir) != 0) die("the heir: %s", ecat_error(heir));
    next_cycle(heir);
  }
  return heir;
}

/* A victim that was only stopped goes on, finds that it has lost its outputs, and may not have them
 * as long as another one does. */
static void resume(pid_t victim, int traced, uint64_t safe_cycle) {
  ecat_t *heir = inherit();
  int told = get(&stage->told), owning = get(&stage->owning), tries;
  uint64_t end;
  if (traced ? ptrace(PTRACE_DETACH, victim, NULL, NULL) != 0 : kill(victim, SIGCONT) != 0)
    die("resume: %s", strerror(errno));
  /* Its claim may not have been granted yet when it was stopped; it is refused now. */
  for (tries = 0; get(&stage->told) == told && get(&stage->phase) != CLAIMING && tries < PATIENCE;
       tries++)
    next_cycle(eye);
  if (tries == PATIENCE) die("the victim does not notice that it has lost its outputs");
  cycles_pass(10);
  end = watch_newest();
  watch_check_no_victim(safe_cycle, end);
  if (owner(ENTRY) != heir->slot) die("the heir has lost its outputs");
  if (ecat_commit(heir) != 0) die("the heir: %s", ecat_error(heir));
  ecat_close(heir);
  for (tries = 0; get(&stage->owning) == owning && tries < PATIENCE; tries++) next_cycle(eye);
  if (tries == PATIENCE) die("the victim cannot claim again");
  reached.resumed++;
}

/* --- rounds --------------------------------------------------------------------------------- */

static void replace_at_once(pid_t victim) {
  ecat_t *heir;
  uint64_t from;
  bury(victim);
  heir = connect_to(name); /* gets the slot of the victim, so it need not wait for its lease */
  if (ecat_claim(heir, VICTIM, 20.0) != 0) die("at once: %s", ecat_error(heir));
  from = ecat_cycle(eye) + 1;
  ecat_close(heir);
  cycles_pass(4);
  watch_check_no_victim(from, watch_newest());
  (void)wait_safe();
}

static void round_of(enum kind kind) {
  uint64_t begin = ecat_cycle(eye), safe_cycle;
  int traced = kind == STEPPED_AND_KILLED || kind == STEPPED_AND_LEFT, phase;
  pid_t victim;
  *stage = (struct stage){.trap = -1, .slot = -1};
  if (traced) {
    static const int phases[] = {CLAIMING, SAMPLING, WRITING, COMMITTING, COMMITTING, RELEASING};
    stage->trap = phases[below(&source, sizeof phases / sizeof *phases)];
    stage->visits = 1 + (int)below(&source, stage->trap == RELEASING ? 2 : 4);
  }
  phase = stage->trap;
  victim = victim_start(name, stage, draw(&source));
  if (victim < 0) die("fork: %s", strerror(errno));
  if (traced) {
    step(victim, phase);
  } else {
    int tries;
    for (tries = 0; get(&stage->owning) == 0 && tries < PATIENCE; tries++) next_cycle(eye);
    if (tries == PATIENCE) die("the victim cannot claim");
    nanosleep(&(struct timespec){0, (long)below(&source, 15000000)}, NULL);
  }
  reached.kinds[kind]++;
  reached.phases[get(&stage->phase)]++;
  if (stage->slot > 2) die("slots of dead clients are not used again");
  if (kind == REPLACED) {
    replace_at_once(victim);
    return;
  }
  if (kind == KILLED || kind == STEPPED_AND_KILLED) bury(victim);
  if (kind == STOPPED) {
    kill(victim, SIGSTOP);
    int status;
    waitpid(victim, &status, WUNTRACED);
  }
  safe_cycle = judge(begin);
  if (kind == KILLED || kind == STEPPED_AND_KILLED) return;
  if (one_in(&source, 4)) { /* it ends as it is */
    bury(victim);
    return;
  }
  resume(victim, traced, safe_cycle);
  bury(victim);
  (void)judge(watch_newest());
}

static void print_reached(void) {
  const ecat_shm_health *health = (const void *)(eye->map + eye->header->health_offset);
  int i;
  printf("{");
  for (i = 0; i < KINDS; i++) printf("\"%s\": %u, ", KIND[i], reached.kinds[i]);
  for (i = 0; i < PHASES; i++) printf("\"in_%s\": %u, ", PHASE[i], reached.phases[i]);
  printf("\"measured\": %u, \"resumed\": %u, \"excess\": %d, \"steps\": %lu, ", reached.measured,
         reached.resumed, reached.excess, reached.steps);
  for (i = 0; i < 8; i++) printf("\"reason_%d\": %u, ", i, reached.reasons[i]);
  printf("\"malformed\": %llu, \"torn\": %llu}\n", (unsigned long long)health->malformed,
         (unsigned long long)health->torn);
}

int main(int argc, char **argv) {
  unsigned i, rounds;
  if (argc != 4) die("usage: dying BUS ROUNDS SEED");
  name = argv[1];
  rounds = (unsigned)atoi(argv[2]);
  source = source_from((uint64_t)atoll(argv[3]));
  stage = mmap(NULL, 4096, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
  if (stage == MAP_FAILED) die("no memory");
  eye = connect_to(name);
  watch_start(name);
  for (i = 0; i < rounds; i++) round_of((enum kind)(i % KINDS));
  watch_stop();
  print_reached();
  ecat_close(eye);
  return 0;
}
