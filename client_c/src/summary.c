/* Summaries of entries over some cycles, for clients that cannot take a sample in each cycle. */
#include "internal.h"

#include <math.h>

static void begin(ecat_summary *summary) {
  summary->minimum = HUGE_VAL;
  summary->maximum = -HUGE_VAL;
  summary->mean = summary->last = 0;
  summary->count = 0;
}

static void add(ecat_summary *summary, double value) {
  if (value < summary->minimum) summary->minimum = value;
  if (value > summary->maximum) summary->maximum = value;
  summary->last = value;
  summary->count++;
  summary->mean += (value - summary->mean) / (double)summary->count; /* large sums lose digits */
}

int ecat_summarize(ecat_t *bus, const int *signals, size_t count, unsigned cycles, double timeout,
                   ecat_summary *summaries) {
  uint64_t last = 0;
  size_t i;
  int code;
  if (bus->map == NULL && (code = ecat_memory_check(bus, 0)) != 0) return code;
  for (i = 0; i < count; i++) {
    if ((code = ecat_check_signal(bus, signals[i])) != 0) return code;
    begin(&summaries[i]);
  }
  do {
    if ((code = ecat_wait(bus, 1, timeout)) != 0) return code;
    ecat_sample(bus); /* values that are not new do not count */
    if (last == 0) last = bus->sample_cycle + cycles - 1;
    for (i = 0; i < count; i++) {
      double value;
      if (ecat_validity(bus, signals[i]) == ECAT_VALID &&
          ecat_read_physical(bus, signals[i], &value) == 0)
        add(&summaries[i], value);
    }
  } while (bus->sample_cycle < last);
  return 0;
}
