/* The client for C. */
#include "committed.h"

int main(int argc, char **argv) {
  ecat_t *bus = NULL;
  const unsigned char *out = out_segment(argv[1]);
  unsigned long long whole;
  double real;
  char kind;
  int number, code;
  if (argc != 4 || ecat_open(&bus, argv[1]) != 0 || ecat_claim(bus, 0, 60) != 0) return 10;
  begin(argv);
  while (next_value(&number, &kind, &real, &whole)) {
    ecat_signal_info entry;
    if (ecat_signal(bus, number, &entry) != 0) return 11;
    code = kind == 'i'   ? ecat_write_int(bus, number, (int64_t)whole)
           : kind == 'p' ? ecat_write_physical(bus, number, real)
                         : ecat_write(bus, number, real);
    if (ecat_commit(bus) != 0) return 12;
    printf("%d %llx\n", code, committed(out, &entry));
  }
  end();
  ecat_close(bus);
  return 0;
}
