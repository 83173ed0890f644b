/* Commits: `ecat_commit()` in client_c/src/outputs.c writes round a number of images and rings;
 * `take_image()` in daemon/cyclic/slots.c takes the newest.
 *
 * Between its fences either side accesses words in any order. The client may die at any point. The
 * engine looks any number of times, at any speed.
 *
 * Invariants:
 *   whole     an image that is taken over has all words of one commit
 *   newest    it is the commit that the doorbell told, and no older one than the last
 *   unowned   nothing is taken over before the first commit was whole
 *   progress  when the client rests, its last commit is taken over at the next look
 *
 * Defect that must be found: -DSLACK=3, the engine believes an image that is just being written.
 */
#define IMAGES 4               /* ECAT_IMAGES; the fewer, the sooner it comes round */
#define COMMITS 8
#ifndef SLACK
#define SLACK (IMAGES - 2)   /* commits that may come while an image is read */
#endif

byte bell = 0;
byte number[IMAGES];
byte word0[IMAGES], word1[IMAGES];
bool resting = false;

active proctype client() {
  byte commit, at;
  bit did_number, did_0, did_1;
  for (commit : 1 .. COMMITS) {
    at = commit % IMAGES;
    did_number = 0; did_0 = 0; did_1 = 0;
    do
    :: did_number && did_0 && did_1 -> break
    :: !did_number -> number[at] = commit; did_number = 1
    :: !did_0 -> word0[at] = commit; did_0 = 1
    :: !did_1 -> word1[at] = commit; did_1 = 1
    :: goto dead
    od;
    bell = commit                /* release */
  }
  resting = true;
dead:
  skip
}

active proctype engine() {
  byte told, taken, after, n, w0, w1;
  bit was_resting, got_number, got_0, got_1;
  do
  :: taken < COMMITS ->
     was_resting = resting;
     told = bell;                /* pread of the doorbells, acquire fence */
     if
     :: told == taken -> (bell != taken || timeout)
     :: else ->
        got_number = 0; got_0 = 0; got_1 = 0;
        do
        :: got_number && got_0 && got_1 -> break
        :: !got_number -> n = number[told % IMAGES]; got_number = 1
        :: !got_0 -> w0 = word0[told % IMAGES]; got_0 = 1
        :: !got_1 -> w1 = word1[told % IMAGES]; got_1 = 1
        od;
        after = bell;            /* acquire fence, pread of this doorbell */
        if
        :: n != told || after - told > SLACK -> assert(!was_resting) /* progress */
        :: else ->
           assert(w0 == told && w1 == told);  /* whole, unowned */
           assert(told > taken);              /* newest */
           taken = told
        fi
     fi
  :: else -> break
  :: timeout -> break
  od
}
