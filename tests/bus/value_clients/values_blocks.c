/* The headers of Modelica blocks. One more argument: "raw", and the objects have no meaning of their
 * own, as in a block that was written by hand; "physical", and they have that of the bus. */
#include "committed.h"

#include "ecat_modelica.h"

enum { MOST = 400 };

static ecat_t *bus;
static void *entries[MOST];

static void open_entries(void *slave, int physical) {
  ecat_signal_info found;
  int i;
  for (i = 0; i < ecat_signal_count(bus); i++) {
    if (ecat_signal(bus, i, &found) != 0) exit(13);
    entries[i] = ecatm_pdo_open(slave, (int)found.index, (int)found.subindex, 1, (int)found.type,
                                (int)found.bit_length, physical ? found.scale : 1,
                                physical ? found.offset : 0, physical ? found.unit : "");
  }
}

/* A write and a commit, which end the simulation where the value is refused. */
static int give(void *slave, double time, int number, char kind, double real,
                unsigned long long whole) {
  if (setjmp(refused) != 0) return ECAT_ERANGE;
  if (kind == 'i')
    ecatm_write_integer(entries[number], time, 0, (int)(long long)whole);
  else
    ecatm_write_real(entries[number], time, 0, real);
  ecatm_commit(slave, time, 0);
  return 0;
}

int main(int argc, char **argv) {
  static struct {
    char kind;
    double real;
    unsigned long long whole;
  } last[MOST];
  const unsigned char *out = out_segment(argv[1]);
  unsigned long long whole;
  double real, time = 0;
  void *master, *domain, *slave;
  char kind;
  int number, code;
  if (argc != 5 || ecat_open(&bus, argv[1]) != 0) return 10;
  master = ecatm_master_open(argv[1], 0, 0.001, 1, 60, 1, 1, 0, 0, 0, "");
  domain = ecatm_domain_open(master, 1, "");
  slave = ecatm_slave_open(domain, 0, "", 0xFFFF, 0xBA1E5, 1, "Values", "", "make it again", "");
  open_entries(slave, strcmp(argv[4], "physical") == 0);
  begin(argv);
  while (next_value(&number, &kind, &real, &whole)) {
    ecat_signal_info entry;
    if (ecat_signal(bus, number, &entry) != 0) return 11;
    code = give(slave, time += 0.001, number, kind, real, whole);
    if (code == 0)
      last[number].kind = kind, last[number].real = real, last[number].whole = whole;
    else if (give(slave, time += 0.001, number, last[number].kind, last[number].real,
                  last[number].whole) != 0)
      return 12;
    printf("%d %llx\n", code, committed(out, &entry));
  }
  end();
  ecatm_master_close(master);
  return 0;
}
