/* Requests: client_c/src/requests.c asks in a cell of its slot, daemon/ecatd/bus/slot_requests.py
 * carries out, and `cyclic_reply()` in daemon/cyclic/control.c answers into the cell's reply.
 *
 * Two clients follow each other in the slot; the first one may die at any point. The answer to a
 * request may come at any time, also when another client has the slot. Fields between the fences are
 * written, and read, in any order.
 *
 * Invariants:
 *   mine      an answer that a client takes is that to its own request
 *   whole     and all of it
 *
 * Defect that must be found: -DREUSE, numbers of requests begin anew with every client.
 */
#define CLIENTS 2

byte generation = 0, number = 0;           /* of the slot: kept when clients change */
byte cell_seq = 0, cell_asks = 0;          /* the request: what it asks stands for its data */
byte reply_seq = 0, reply_generation = 0, reply_data = 0;
chan mailbox = [CLIENTS] of { byte, byte, byte };  /* generation, seq, what is asked */
bool free = true;

proctype client(byte me) {
  byte mine, seq, data, g, s;
  bit got_g, got_d;
  atomic { free -> free = false };
  generation++;
  mine = generation;
#ifdef REUSE
  number = 0;
#endif
  cell_seq = 0;
  number++;
  seq = number;
  cell_asks = me;
  cell_seq = seq;                          /* release */
  do
  :: goto dead
  :: timeout -> goto dead
  :: s = reply_seq;                        /* acquire */
     if
     :: s == seq ->
        got_g = 0; got_d = 0;
        do
        :: got_g && got_d -> break
        :: !got_g -> g = reply_generation; got_g = 1
        :: !got_d -> data = reply_data; got_d = 1
        od;
        if                                 /* acquire fence */
        :: g == mine && reply_seq == seq ->
           assert(data == me);             /* mine, whole */
           break
        :: else
        fi
     :: else -> (reply_seq == seq || timeout)
     fi
  od;
dead:
  free = true
}

/* Takes what is new in the cell. */
active proctype control() {
  byte g, s, a, seen_g, seen_s;
end:
  do
  :: atomic { cell_seq != 0 && (cell_seq != seen_s || generation != seen_g) ->
              g = generation; s = cell_seq; a = cell_asks; seen_g = g; seen_s = s };
     mailbox ! g, s, a
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
