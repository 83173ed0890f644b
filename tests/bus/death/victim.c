/* A client that claims, samples, writes, commits and releases until it is killed. */
#include "death.h"

#include <signal.h>
#include <stdlib.h>
#include <sys/prctl.h>
#include <sys/ptrace.h>
#include <unistd.h>

static struct stage *stage;

/* Here the debugger takes over. */
static void enter(int phase) {
  __atomic_store_n(&stage->phase, phase, __ATOMIC_RELEASE);
  if (__atomic_load_n(&stage->trap, __ATOMIC_ACQUIRE) == phase && --stage->visits <= 0) {
    stage->trap = -1;
    raise(SIGSTOP);
  }
}

static void add(int *number) { __atomic_fetch_add(number, 1, __ATOMIC_RELEASE); }

/* Claims until it succeeds. */
static void own(ecat_t *bus, int only, double lease) {
  for (;;) {
    int code;
    enter(CLAIMING);
    code = only < 0 ? ecat_claim(bus, VICTIM, lease)
                    : ecat_claim_entry(bus, output_of(bus, VICTIM, only), lease);
    stage->slot = bus->slot;
    if (code == 0) break;
    if (code != ECAT_EOWNED && code != ECAT_ESTALE) die("the victim's claim: %s", ecat_error(bus));
    next_cycle(bus);
  }
  add(&stage->owning);
}

static void live(ecat_t *bus, struct source *source) {
  int only = one_in(source, 4) ? ENTRY : -1, value = 0;
  double lease = one_in(source, 2) ? 0 : 0.001 * (double)(4 + below(source, 16));
  own(bus, only, lease);
  for (;;) {
    int code;
    enter(WAITING);
    next_cycle(bus);
    enter(SAMPLING);
    (void)ecat_sample(bus);
    enter(WRITING);
    write_bytes(bus, VICTIM, only, OF_VICTIM | (value++ & 0x3F));
    enter(COMMITTING);
    code = ecat_commit(bus);
    if (code == ECAT_ELEASE) {
      add(&stage->told);
      own(bus, only, lease);
    } else if (code != 0) {
      die("the victim's commit: %s", ecat_error(bus));
    }
    if (!one_in(source, 8)) continue;
    enter(RELEASING);
    code = only < 0 ? ecat_release(bus, VICTIM)
                    : ecat_release_entry(bus, output_of(bus, VICTIM, only));
    if (code != 0 && code != ECAT_ESTALE) die("the victim's release: %s", ecat_error(bus));
    own(bus, only, lease);
  }
}

pid_t victim_start(const char *name, struct stage *shared, uint64_t seed) {
  struct source source = source_from(seed);
  pid_t parent = getpid(), pid = fork();
  if (pid != 0) return pid;
  stage = shared;
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  if (getppid() != parent) _exit(1);
  if (stage->trap >= 0 && ptrace(PTRACE_TRACEME, 0, NULL, NULL) != 0) die("no right to trace");
  enter(OPENING);
  live(connect_to(name), &source);
  _exit(1);
}
