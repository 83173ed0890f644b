/* The seqlock of a domain's page: `cyclic_publish_domain()` in daemon/cyclic/publish.c writes,
 * `ecat_page_copy()` in client_c/src/shared_memory.c reads.
 *
 * Between the fences both sides access the words in any order, as relaxed atomics may. The writer
 * may stop for ever at any point, as a daemon that is killed does. Readers only load, so one stands
 * for all.
 *
 * Invariants:
 *   whole     a snapshot that is accepted has all words of one cycle
 *   forward   a reader never sees a cycle before one that it has seen
 *   present   it is the cycle that the sequence number tells: nothing before the first is accepted
 *
 * Defects that must be found: -DNO_ODD, the writer does not mark the page while it writes;
 * -DNO_CHECK, the reader does not look again.
 */
#define CYCLES 3
#define TRIES 3

byte seq = 0, word0 = 0, word1 = 0;

active proctype writer() {
  byte cycle;
  bit did_0, did_1;
  for (cycle : 1 .. CYCLES) {
#ifndef NO_ODD
    seq++;                       /* relaxed, then a release fence */
#endif
    did_0 = 0; did_1 = 0;
    do
    :: did_0 && did_1 -> break
    :: !did_0 -> word0 = cycle; did_0 = 1
    :: !did_1 -> word1 = cycle; did_1 = 1
    :: goto killed
    od;
#ifdef NO_ODD
    seq++;
#endif
    seq++                        /* release */
  }
killed:
  skip
}

active proctype reader() {
  byte before, tries, last, copy0, copy1;
  bit got_0, got_1;
  for (tries : 1 .. TRIES) {
    before = seq;                /* acquire */
    if
    :: before & 1
    :: else ->
       got_0 = 0; got_1 = 0;
       do
       :: got_0 && got_1 -> break
       :: !got_0 -> copy0 = word0; got_0 = 1
       :: !got_1 -> copy1 = word1; got_1 = 1
       od;
       if                        /* acquire fence */
#ifdef NO_CHECK
       :: true ->
#else
       :: seq == before ->
#endif
          assert(copy0 == copy1);       /* whole */
          assert(copy0 >= last);        /* forward */
          assert(copy0 == before / 2);  /* present */
          last = copy0
       :: else
       fi
    fi
  }
}
