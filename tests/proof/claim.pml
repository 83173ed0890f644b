/* Claims and leases: client_c/src/{slot,claims}.c against daemon/cyclic/{slots,outputs}.c.
 *
 * Two clients want the same output: one after the other in one slot, or at the same time in two
 * (-DCOMPETE). Each may die, or hang, at any point; a dead one loses its lock, so another may take its slot. The
 * engine reads the fields of a doorbell one by one, forwards or backwards, and claims of one slot a
 * cycle. What a commit brings is whole (commit.pml), so it is one step here.
 *
 * Invariants:
 *   mine      an output takes values of the client that owns it, and of no predecessor in its slot
 *   granted   a client that was told yes owns the output, or has lost it since
 *   lease     nobody owns an output longer than a lease after its last sign of life
 *   safe      an output that nobody owns is safe
 *
 * Defects that must be found: -DRESET, counters begin anew with every client; -DNO_STAMP, an image
 * does not say who made it; -DNO_LEASE; -DCOMPETE -DNO_OWNER, whoever claims gets the output.
 */
#ifdef COMPETE           /* two slots, one client each */
#define SLOTS 2
#else                    /* two clients, one after the other, in one slot */
#define SLOTS 1
#endif
#define NOBODY 9
#define LEASE 1          /* cycles */
#ifdef COMPETE
#define CYCLES 5
#else
#define CYCLES 6
#endif
#define COMMITS 2
#define BEATS 3          /* heartbeats count modulo this */

/* The .out file; a client's life is told by `generation`, and so is who made an image. */
bool lock[SLOTS];
byte last[SLOTS], bell_generation[SLOTS], bell_beat[SLOTS], bell_claim[SLOTS], bell_commit[SLOTS];
bit wants[SLOTS];
byte image_of[SLOTS];    /* generation that wrote the image, as 10 * slot + generation */

/* What the engine publishes. */
byte told_generation[SLOTS], told_claim[SLOTS];
bool told_conflict[SLOTS], lapsed[SLOTS];

/* What it keeps. */
byte generation[SLOTS], beat[SLOTS], age[SLOTS], claim[SLOTS], commit[SLOTS];
byte owner = NOBODY, value = 0; /* value: of whom the output comes, 0 safe */
byte turn = 0;

proctype client(byte slot) {
  byte mine, asked, commits;
  /* The kernel's lock; a client that does not get it has no part in this. */
  atomic { !lock[slot] -> lock[slot] = true };
  mine = last[slot] + 1;
  last[slot] = mine;
  bell_generation[slot] = 0;
  wants[slot] = 0;
#ifdef RESET
  bell_claim[slot] = 0;
  bell_commit[slot] = 0;
#endif
  bell_beat[slot] = (bell_beat[slot] + 1) % BEATS;
  bell_generation[slot] = mine;             /* release */
  if
  :: goto dead
  :: goto hangs
  :: true
  fi;
  wants[slot] = 1;
  asked = bell_claim[slot] + 1;
  bell_claim[slot] = asked;                 /* release */
  if
  :: told_generation[slot] == mine && told_claim[slot] == asked
  :: goto dead
  :: goto hangs
  :: timeout -> goto dead
  fi;
  atomic {
    if
    :: told_conflict[slot] -> goto dead
    :: else -> assert(owner == slot || lapsed[slot])  /* granted */
    fi
  };
  do
  :: commits < COMMITS && !lapsed[slot] ->
     bell_beat[slot] = (bell_beat[slot] + 1) % BEATS;
     commits++;
     atomic { image_of[slot] = 10 * slot + mine; bell_commit[slot] = bell_commit[slot] + 1 }
  :: goto dead
  :: goto hangs
  :: lapsed[slot] -> goto dead
  od;
hangs:
  if
  :: timeout -> skip                         /* until all else has ended */
  fi;
dead:
  lock[slot] = false
}

inline drop(s) {
  if
  :: owner == s -> owner = NOBODY; value = 0
  :: else
  fi
}

/* All claims and commits are ignored while a slot is lapsed or free. */
inline look(s) {
  /* One pread, whose words may come in any order. */
  if
  :: g = bell_generation[s]; b = bell_beat[s]; k = bell_claim[s]; m = bell_commit[s]
  :: m = bell_commit[s]; k = bell_claim[s]; b = bell_beat[s]; g = bell_generation[s]
  fi;
  atomic {
    if
    :: g != generation[s] ->                 /* begin() */
       drop(s);
       generation[s] = g; age[s] = 0; lapsed[s] = false;
#ifdef RESET
       claim[s] = 0; commit[s] = 0
#else
       claim[s] = k - 1; commit[s] = m   /* claims may have come already, commits not */
#endif
    :: else
    fi;
    if
    :: b != beat[s] -> beat[s] = b; age[s] = 0
    :: else -> age[s] = (owner == s -> age[s] + 1 : 0)
    fi;
    if
    :: generation[s] != 0 && !lapsed[s] && m != commit[s] ->  /* take_image() */
       commit[s] = m;
       if
#ifdef NO_STAMP
       :: owner == s && bell_commit[s] == m ->
#else
       :: owner == s && bell_commit[s] == m && image_of[s] == 10 * s + generation[s] ->
#endif
          value = image_of[s]
       :: else
       fi
    :: else
    fi
  };
  atomic {
    if
    :: generation[s] != 0 && lapsed[s] -> claim[s] = k
    :: generation[s] != 0 && !lapsed[s] && k != claim[s] && turn == s ->  /* read_claims() */
       claim[s] = k;
       told_conflict[s] = false;
       if
#ifdef NO_OWNER
       :: wants[s] && owner != s -> owner = s; age[s] = 0
#else
       :: wants[s] && owner == NOBODY -> owner = s; age[s] = 0
       :: wants[s] && owner != NOBODY && owner != s -> told_conflict[s] = true
#endif
       :: wants[s] && owner == s
       :: !wants[s] -> drop(s)
       fi
    :: else
    fi;
#ifndef NO_LEASE
    if
    :: owner == s && age[s] > LEASE -> drop(s); lapsed[s] = true
    :: else
    fi
#endif
  }
}

inline publish(s) {
  d_step { told_claim[s] = claim[s]; told_generation[s] = generation[s] }
}

active proctype engine() {
  byte g, b, k, m, cycle;
  for (cycle : 1 .. CYCLES) {
    turn = cycle % SLOTS;
    look(0);
#ifdef COMPETE
    look(1);
#endif
    assert(owner == NOBODY || age[owner] <= LEASE);             /* lease */
    assert(owner != NOBODY || value == 0);                      /* safe */
    assert(value == 0 || value == 10 * owner + generation[owner]); /* mine */
    publish(0);
#ifdef COMPETE
    publish(1)
#endif
  }
}

init {
  atomic { run client(0); run client(SLOTS - 1) }
}
