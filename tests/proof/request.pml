/* Requests: client_c/src/requests.c asks in a cell of its slot, daemon/ecatd/master/engine/slot_cells.py and
 * slot_requests.py read and carry out, and `cyclic_reply()` in daemon/cyclic/control.c answers into
 * the cell's reply.
 *
 * Two clients follow each other in the slot, and each may ask twice in the same cell, the second time
 * without an answer to the first; each may die at any point. The answer to a request may come at any
 * time, also when another client has the slot. Fields between the fences are written, and read, in any
 * order.
 *
 * Invariants:
 *   asked     what is carried out is, in all its words, what was asked under its number
 *   mine      an answer that a client takes is that to its own request
 *   whole     and all of it
 *
 * Defects that must be found: -DREUSE, numbers of requests begin anew with every client; -DNO_CLEAR,
 * a request is written over while the number of the last one is still there; -DEAGER, the daemon
 * reads what is not announced, and does not look again.
 */
#define CLIENTS 2
#define TURNS 2

byte generation = 0, number = 0;           /* of the slot: kept when clients change */
byte bell_generation = 0, bell_seq = 0;
byte cell_seq = 0, cell_0 = 0, cell_1 = 0; /* the request, and what it asks in two words */
byte reply_seq = 0, reply_generation = 0, reply_data = 0;
chan mailbox = [CLIENTS * TURNS] of { byte, byte, byte };  /* generation, seq, what is asked */
bool free = true;

proctype client(byte me) {
  byte mine, seq, data, g, s, turn;
  bit got_g, got_d;
  atomic { free -> free = false };
  bell_generation = 0;
  generation++;
  mine = generation;
#ifdef REUSE
  number = 0;
#endif
  cell_seq = 0;
  bell_generation = mine;                  /* release */
  for (turn : 1 .. TURNS) {
#ifndef NO_CLEAR
    cell_seq = 0;                          /* then a release fence */
#endif
    number++;
    seq = number;
    if
    :: cell_0 = 10 * me + seq; cell_1 = 10 * me + seq
    :: cell_1 = 10 * me + seq; cell_0 = 10 * me + seq
    fi;
    cell_seq = seq;                        /* release */
    bell_seq = seq;                        /* release */
    do
    :: goto dead
    :: turn < TURNS -> break               /* has no more use for it */
    :: timeout -> goto dead
    :: s = reply_seq;                      /* acquire */
       if
       :: s == seq ->
          got_g = 0; got_d = 0;
          do
          :: got_g && got_d -> break
          :: !got_g -> g = reply_generation; got_g = 1
          :: !got_d -> data = reply_data; got_d = 1
          od;
          if                               /* acquire fence */
          :: g == mine && reply_seq == seq ->
             assert(data == 10 * me + seq);  /* mine, whole */
             break
          :: else
          fi
       :: else -> (reply_seq == seq || timeout)
       fi
    od
  }
dead:
  free = true
}

/* Takes what is new in the cell. */
active proctype control() {
  byte g, b, s, word0, word1, seen_g, seen_s, rung_g, rung_b;
  bit got_s, got_0, got_1;
end:
  do
  :: atomic { bell_generation != 0 && (bell_seq != rung_b || bell_generation != rung_g) ->
              rung_b = bell_seq; rung_g = bell_generation };
     g = bell_generation;                  /* one pread after the other; the kernel has fences */
     b = bell_seq;
     got_s = 0; got_0 = 0; got_1 = 0;
     do
     :: got_s && got_0 && got_1 -> break
     :: !got_s -> s = cell_seq; got_s = 1
     :: !got_0 -> word0 = cell_0; got_0 = 1
     :: !got_1 -> word1 = cell_1; got_1 = 1
     od;
     if
#ifdef EAGER
     :: g != 0 && s != 0 && bell_generation == g && (s != seen_s || g != seen_g) ->
#else
     :: g != 0 && s != 0 && s <= b && bell_generation == g && (s != seen_s || g != seen_g) ->
#endif
        seen_s = s;
        seen_g = g;
        if
#ifndef EAGER
        :: bell_generation != g || cell_seq != s     /* is_wanted() */
#endif
        :: else ->
           assert(word0 == word1 && word0 % 10 == s);  /* asked */
           mailbox ! g, s, word0
        fi
     :: else
     fi
  od
}

/* Answers, some time. */
active proctype worker() {
  byte g, s, a;
  bit did_g, did_d;
end:
  do
  :: mailbox ? g, s, a ->
     reply_seq = 0;                        /* then a release fence */
     did_g = 0; did_d = 0;
     do
     :: did_g && did_d -> break
     :: !did_g -> reply_generation = g; did_g = 1
     :: !did_d -> reply_data = a; did_d = 1
     od;
     reply_seq = s                         /* release */
  od
}

init {
  atomic { run client(1); run client(2) }
}
