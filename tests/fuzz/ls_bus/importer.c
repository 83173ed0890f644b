/* An importer whose virtual ECUs send anything. Built with sanitizers, from the sources in the FMU.
 *
 *     importer RESOURCES TOKEN BUS FIRST INPUTS SEED
 *
 * BUS: name, or - for none; FIRST: value reference of Ecu1.Rx_Clock, which is followed by Rx_Data, Tx_Clock and
 * Tx_Data. Prints how many operations of each code the ECU has got.
 */
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "../random.h"
#include "fmi/fmi3Functions.h"

enum { BUS = 1, WAIT_FOR_BUS = 2, WHEN_MISSING = 4, WHEN_FAILED = 5, LONGEST = 70000 };

static unsigned long got[256], warnings;

static void hear(fmi3InstanceEnvironment environment, fmi3Status level, fmi3String category, fmi3String text) {
  (void)environment, (void)category;
  if (level >= fmi3Error) fprintf(stderr, "%s\n", text);
  warnings += level == fmi3Warning;
}

static void check(int is_so, const char *what) {
  if (is_so) return;
  fprintf(stderr, "%s\n", what);
  exit(1);
}

static uint32_t word(const uint8_t *from) {
  return (uint32_t)from[0] | (uint32_t)from[1] << 8 | (uint32_t)from[2] << 16 | (uint32_t)from[3] << 24;
}

/* What the FMU sends is whole and of the standard, whatever it has got. */
static void take(const uint8_t *bytes, size_t length) {
  check(length <= 2048, "more than a node must take at once");
  while (length > 0) {
    uint32_t code, all;
    check(length >= 8, "half an operation");
    code = word(bytes);
    all = word(bytes + 4);
    check(all >= 8 && all <= length, "an operation has a wrong length");
    check(code == 0x01 || code == 0x10 || code == 0x20 || code == 0x31 || code == 0x42, "an unexpected operation");
    if (code == 0x10) check(all == 16u + bytes[14] && bytes[14] <= 8 && bytes[15] == 0, "a frame that cannot be");
    if (code == 0x01) check(all == 10u + (bytes[8] | (uint32_t)bytes[9] << 8), "a Format Error with a wrong length");
    got[code]++;
    bytes += all;
    length -= all;
  }
}

/* Operations that are right, nearly right, or anything. */
static size_t make(struct source *state, uint8_t *to) {
  static const uint8_t codes[] = {0x01, 0x10, 0x10, 0x10, 0x11, 0x12, 0x20, 0x30, 0x31, 0x40, 0x41, 0x42, 0x99};
  size_t length = 0, count = below(state, 8), i;
  if (one_in(state, 50)) count = 300;
  for (i = 0; i < count && length + 100 < LONGEST; i++) {
    uint8_t *o = to + length;
    uint32_t code = codes[below(state, (uint32_t)sizeof codes)], data = below(state, 9), k;
    uint32_t all = code == 0x10 ? 16 + data : code == 0x40 ? 10 + 3 * below(state, 2)
                   : code == 0x41 ? 9 : code == 0x42 ? 8 : 8 + below(state, 30);
    memset(o, 0, 100);
    o[0] = (uint8_t)code;
    o[4] = (uint8_t)all;
    for (k = 8; k < all; k++) o[k] = (uint8_t)below(state, 4);
    if (code == 0x10) {
      o[10] = o[11] = 0;
      o[12] &= 1, o[13] = 0, o[14] = (uint8_t)data, o[15] = 0;
    }
    if (one_in(state, 10)) o[below(state, all)] = (uint8_t)below(state, 256);
    length += all;
  }
  if (one_in(state, 20))
    for (i = 0; i < 40; i++) to[length++] = (uint8_t)below(state, 256);
  if (one_in(state, 20) && length > 0) length = below(state, (uint32_t)length);
  if (one_in(state, 500)) length = LONGEST; /* more than the FMU takes; old operations follow */
  return length;
}

int main(int count, char **arguments) {
  static uint8_t bytes[LONGEST + 500];
  fmi3ValueReference first, rx_clock, rx_data, tx_clock, tx_data, reference;
  fmi3Boolean need, end, a, b, c, events, early;
  fmi3Float64 next, reached;
  const fmi3Clock active = fmi3ClockActive;
  const fmi3Boolean no = fmi3False;
  fmi3Instance fmu;
  fmi3Binary value = bytes;
  unsigned long i, inputs;
  struct source state;
  int has_bus;
  check(count == 7, "six arguments");
  has_bus = strcmp(arguments[3], "-") != 0;
  first = (fmi3ValueReference)atoi(arguments[4]);
  inputs = strtoul(arguments[5], NULL, 10);
  state = source_from(strtoull(arguments[6], NULL, 10));
  rx_clock = first, rx_data = first + 1, tx_clock = first + 2, tx_data = first + 3;
  fmu = fmi3InstantiateCoSimulation("fuzzed", arguments[2], arguments[1], 0, 1, 1, 0, NULL, 0, NULL, hear, NULL);
  check(fmu != NULL, "it is not instantiated");
  reference = has_bus ? WHEN_FAILED : WHEN_MISSING;
  check(fmi3SetInt64(fmu, &reference, 1, &(fmi3Int64){3}, 1) == fmi3OK, "whenMissing"); /* Continue */
  reference = WAIT_FOR_BUS;
  check(fmi3SetBoolean(fmu, &reference, 1, &no, 1) == fmi3OK, "waitForBus");
  reference = BUS;
  check(fmi3SetString(fmu, &reference, 1, &(fmi3String){has_bus ? arguments[3] : "nothing"}, 1) == fmi3OK, "bus");
  check(fmi3EnterInitializationMode(fmu, 0, 0, 0, 0, 0) == fmi3OK, "initialization");
  check(fmi3ExitInitializationMode(fmu) == fmi3OK, "initialization");
  for (i = 0; i < inputs; i++) {
    size_t length = make(&state, bytes);
    int ticks = below(&state, 3) > 0;
    check(fmi3SetClock(fmu, &rx_clock, 1, &active) == fmi3OK, "fmi3SetClock");
    check(fmi3SetBinary(fmu, &rx_data, 1, &length, &value, 1) == fmi3OK, "fmi3SetBinary");
    if (ticks) {
      fmi3Binary operations;
      size_t size;
      check(fmi3SetClock(fmu, &tx_clock, 1, &active) == fmi3OK, "fmi3SetClock");
      check(fmi3GetBinary(fmu, &tx_data, 1, &size, &operations, 1) == fmi3OK, "fmi3GetBinary");
      take(operations, size);
    }
    check(fmi3UpdateDiscreteStates(fmu, &need, &end, &a, &b, &c, &next) == fmi3OK, "fmi3UpdateDiscreteStates");
    check(fmi3EnterStepMode(fmu) == fmi3OK, "fmi3EnterStepMode");
    check(fmi3DoStep(fmu, (double)i * 1e-3, 1e-3, 1, &events, &end, &early, &reached) == fmi3OK, "fmi3DoStep");
    check(fmi3EnterEventMode(fmu) == fmi3OK, "fmi3EnterEventMode");
  }
  check(fmi3Terminate(fmu) == fmi3OK, "fmi3Terminate");
  fmi3FreeInstance(fmu);
  printf("{\"format_errors\": %lu, \"frames\": %lu, \"confirms\": %lu, \"bus_errors\": %lu, \"warnings\": %lu}\n",
         got[0x01], got[0x10], got[0x20], got[0x31], warnings);
  return 0;
}
