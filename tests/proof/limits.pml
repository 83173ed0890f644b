/* Limits of outputs that change while the bus runs: `cyclic_use_limits()` in daemon/cyclic/outputs.c
 * writes, `cyclic_outputs_adopt_limits()` and `enforce_limits()` there read.
 *
 * Control fills memory that the engine does not use, says so, and waits until the engine uses it; the
 * memory from before is free then, and may be that of the next limits. The engine looks once in each
 * cycle. Both sides access the words in any order, as plain accesses may.
 *
 * Invariants:
 *   one       a value is compared with both limits of one rule: never with the lower one of a rule
 *             and the upper one of another, which would let values pass that neither allows
 *   forward   a rule is never used after a later one
 *
 * Defects that must be found: -DIN_PLACE, control writes the limits that the engine uses; -DNO_WAIT,
 * it does not wait until the engine uses the new ones.
 */
#define RULES 3
#define CYCLES 4

byte low[2], high[2];
byte wanted = 0, used = 0;

active proctype control() {
  byte rule, to = 0;
  bit did_low, did_high;
  for (rule : 1 .. RULES) {
#ifndef IN_PLACE
    to = 1 - to;
#endif
    did_low = 0; did_high = 0;
    do
    :: did_low && did_high -> break
    :: !did_low -> low[to] = rule; did_low = 1
    :: !did_high -> high[to] = rule; did_high = 1
    od;
    wanted = to;                 /* release */
#ifndef NO_WAIT
end_wait:
    used == to                   /* acquire; the engine may have ended */
#endif
  }
}

active proctype engine() {
  byte cycle, last, now, copy_low, copy_high;
  bit got_low, got_high;
  for (cycle : 1 .. CYCLES) {
    now = wanted;                /* acquire */
    used = now;                  /* release */
    got_low = 0; got_high = 0;
    do
    :: got_low && got_high -> break
    :: !got_low -> copy_low = low[now]; got_low = 1
    :: !got_high -> copy_high = high[now]; got_high = 1
    od;
    assert(copy_low == copy_high); /* one */
    assert(copy_low >= last);      /* forward */
    last = copy_low
  }
}
