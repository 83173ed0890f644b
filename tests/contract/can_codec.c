/* Takes the signals of frames apart and puts them together, as a session does, for tests/contract/test_can_codec.py.
 *
 * Each line of the input has a command, a signal (start, length, big endian, number, scale, offset, minimum, maximum, unit
 * or -, and five numbers of its selector), and 8 bytes as 16 hexadecimal digits. `d` answers with the value of the
 * signal, as a real and as a whole number. `r` and `w` have a value behind the bytes, a real or a whole number, and
 * answer with the bytes of a frame with this value, if its other bits are those bytes; or with the error text. `l` has
 * a number of bytes behind the bytes, and answers whether a frame with so many of them is received.
 */
#include "session_can.c"

#include <inttypes.h>

static int read_bytes(uint8_t bytes[8]) {
  unsigned byte;
  int i;
  for (i = 0; i < 8; i++) {
    if (scanf("%2x", &byte) != 1) return 0;
    bytes[i] = (uint8_t)byte;
  }
  return 1;
}

static void keep_quiet(void *context, int warning, const char *sentence) {
  (void)context, (void)warning, (void)sentence;
}

int main(void) {
  static const ecat_session_settings settings = {"none", 1, 3, 3, 0, 0, 0, "this", "the test", "patience", keep_quiet, NULL, NULL};
  char command, unit[32];
  double real;
  int64_t whole;
  for (;;) {
    ecat_session session;
    ecat_session_slave slave;
    ecat_session_message message;
    ecat_session_signal signal;
    ecat_can_frame frame;
    uint8_t bytes[8];
    int i, code, length;
    memset(&slave, 0, sizeof slave);
    memset(&message, 0, sizeof message);
    memset(&signal, 0, sizeof signal);
    memset(&frame, 0, sizeof frame);
    ecat_session_init(&session, &settings);
    slave.name = "codec";
    ecat_session_add_slave(&session, &slave);
    if (scanf(" %c %d %d %d %d %lf %lf %lf %lf %31s %d %d %d %lf %lf ", &command, &signal.start, &signal.length,
              &signal.big_endian, &signal.number, &signal.scale, &signal.offset, &signal.minimum, &signal.maximum, unit,
              &signal.selector.start, &signal.selector.length, &signal.selector.big_endian, &signal.selector.low,
              &signal.selector.high) != 15 ||
        !read_bytes(bytes))
      return 0;
    signal.name = "s";
    signal.unit = strcmp(unit, "-") == 0 ? "" : unit;
    signal.message = &message;
    message.slave = &slave;
    message.sends = command != 'd' && command != 'l';
    message.length = message.sends ? 8 : 0;
    message.transmission = ECAT_SESSION_EACH_SAMPLE;
    code = ecat_session_add_message(&message);
    if (code == 0) code = ecat_session_add_signal(&signal);
    if (code == 0 && command == 'd') {
      frame.length = 8;
      memcpy(frame.data, bytes, sizeof bytes);
      take(&message, &frame);
      printf("%.17g %" PRId64 "\n", ecat_session_can_read(&signal), ecat_session_can_read_int(&signal));
    } else if (code == 0 && command == 'l' && scanf("%d", &length) == 1) {
      frame.length = (uint8_t)length;
      memcpy(frame.data, bytes, (size_t)length);
      take(&message, &frame);
      printf("%d\n", message.count);
    } else if (code == 0) {
      if (command == 'r' && scanf("%lf", &real) == 1) ecat_session_can_write(&signal, real);
      if (command == 'w' && scanf("%" SCNd64, &whole) == 1) ecat_session_can_write_int(&signal, whole);
      code = put_signal(bytes, &signal);
      for (i = 0; code == 0 && i < 8; i++) printf("%02x%s", bytes[i], i < 7 ? "" : "\n");
    }
    if (code != 0) printf("%s\n", session.problem);
    fflush(stdout);
  }
}
