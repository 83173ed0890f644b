/* Every call of ecat.h on a live bus, the reference plant: what it does, and how it refuses. For
 * sanitizers, with a second thread that reads through a handle of its own.
 *
 * Argument: name of the bus. Says "restart" when the daemon is to be killed and started again, and
 * ends with "done". */
#include <ecat/ecat.h>
#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { IO_TERMINAL = 7, IO_NODE = 2 }; /* a CAN terminal, and the CANopen node behind it */
enum { DRIVE = 0, COUPLER = 1, INPUTS = 2, LAMPS = 3, VENDOR = 2, LAMPS_PRODUCT = 0x07D83052 };

#define CHECK(condition) \
  if (!(condition)) fail(bus, __LINE__, #condition)

static void fail(const ecat_t *bus, int line, const char *condition) {
  fprintf(stderr, "line %d: %s: %s\n", line, condition, ecat_error(bus));
  exit(1);
}

static int stop;

static void *look(void *name) {
  ecat_t *bus = NULL;
  unsigned long rounds = 0;
  CHECK(ecat_open(&bus, name) == 0);
  for (; !__atomic_load_n(&stop, __ATOMIC_ACQUIRE) || rounds == 0; rounds++) {
    ecat_slave_info slave;
    ecat_signal_info signal;
    ecat_output_info output;
    ecat_domain_info domain;
    double value;
    int i;
    (void)ecat_wait_domain(bus, 0, 1, 0.05);
    (void)ecat_sample(bus);
    for (i = 0; i < ecat_slave_count(bus); i++) CHECK(ecat_slave(bus, i, &slave) == 0);
    for (i = 0; i < ecat_signal_count(bus); i++) {
      CHECK(ecat_signal(bus, i, &signal) == 0 && ecat_read(bus, i, &value) == 0);
      CHECK(ecat_validity(bus, i) >= 0);
      if (signal.output) CHECK(ecat_output(bus, i, &output) == 0);
    }
    CHECK(ecat_domain(bus, 0, &domain) == 0);
  }
  ecat_close(bus);
  return NULL;
}

static void opening(const char *name) {
  ecat_t *bus = NULL;
  ecat_slave_info slave;
  double value;
  ecat_close(NULL);
  CHECK(ecat_open(&bus, "") == ECAT_EARG);
  ecat_close(bus);
  CHECK(ecat_open(&bus, "a/b") == ECAT_EARG);
  ecat_close(bus);
  CHECK(ecat_open(&bus, "no-such-bus") == ECAT_EDOWN);
  CHECK(strstr(ecat_error(bus), "no-such-bus") != NULL && ecat_slave_count(bus) == 0);
  /* All calls on what is not connected are errors. */
  CHECK(ecat_sample(bus) == ECAT_EDOWN && ecat_sample_domain(bus, 0) < 0);
  CHECK(ecat_summarize(bus, NULL, 0, 1, 1, NULL) == ECAT_EDOWN);
  CHECK(ecat_wait(bus, 1, 0) < 0 && ecat_wait_domain(bus, 0, 1, 0) < 0);
  CHECK(ecat_find_name(bus, "EL2008") < 0 && strstr(ecat_error(bus), "is not connected") != NULL);
  CHECK(ecat_find(bus, VENDOR, LAMPS_PRODUCT, 0) < 0 && ecat_lookup(bus, "0/x", ECAT_ANY) < 0);
  CHECK(ecat_bind(bus, 0, 0x6040, 0, ECAT_ANY) < 0);
  CHECK(strstr(ecat_error(bus), "is not connected") != NULL);
  CHECK(ecat_slave(bus, 0, &slave) < 0 && ecat_read(bus, 0, &value) < 0 && ecat_write(bus, 0, 0) < 0);
  CHECK(ecat_claim(bus, 0, 0) < 0 && ecat_commit(bus) == 0 && ecat_state_start(bus, 0, 8) < 0);
  ecat_release_all(bus);
  ecat_close(bus);
  CHECK(ecat_open(&bus, name) == 0 && strcmp(ecat_error(bus), "no error") == 0);
  ecat_close(bus);
  CHECK(strcmp(ecat_strerror(ECAT_EDOWN), "the daemon is not running") == 0);
  CHECK(strcmp(ecat_strerror(-99), "unknown error") == 0 && strcmp(ecat_strerror(7), "no error") == 0);
  CHECK(strcmp(ecat_error(NULL), "out of memory") == 0);
}

static void directory(ecat_t *bus, const char *name) {
  ecat_slave_info slave;
  ecat_signal_info signal;
  int lamp = ecat_lookup(bus, "EL2008/0x7000:01", ECAT_OUTPUT);
  CHECK(strcmp(ecat_name(bus), name) == 0 && ecat_fingerprint(bus) != 0 && ecat_instance(bus) != 0);
  CHECK(ecat_slave_count(bus) == 8 && ecat_domain_count(bus) == 1 && ecat_signal_count(bus) > 20);
  CHECK(ecat_cycle_time(bus) > 0 && ecat_cycle_time(bus) < 1);
  CHECK(ecat_slave(bus, LAMPS, &slave) == 0 && slave.product == LAMPS_PRODUCT);
  CHECK(strcmp(slave.name, "EL2008") == 0 && slave.has_outputs && !slave.owned);
  CHECK(ecat_slave(bus, -1, &slave) == ECAT_EBUS && ecat_slave(bus, 8, &slave) == ECAT_EBUS);
  CHECK(lamp >= 0 && lamp == ecat_bind(bus, LAMPS, 0x7000, 1, ECAT_ANY));
  CHECK(ecat_signal(bus, lamp, &signal) == 0 && signal.slave == LAMPS && signal.bit_length == 1);
  CHECK(signal.output == 1 && signal.index == 0x7000 && signal.subindex == 1);
  CHECK(ecat_signal(bus, -1, &signal) == ECAT_EARG);
  CHECK(ecat_signal(bus, ecat_signal_count(bus), &signal) == ECAT_EARG);
  CHECK(ecat_bind(bus, LAMPS, 0x7000, 1, ECAT_INPUT) == ECAT_ESIGNAL);
  CHECK(ecat_bind(bus, 99, 0x7000, 1, ECAT_ANY) == ECAT_EBUS);
  CHECK(ecat_lookup(bus, "EL2008", ECAT_ANY) == ECAT_EARG && ecat_lookup(bus, NULL, 0) == ECAT_EARG);
  CHECK(ecat_lookup(bus, "EL2008/nothing", ECAT_ANY) == ECAT_ESIGNAL);
  CHECK(ecat_lookup(bus, "EL3008/x", ECAT_ANY) == ECAT_EBUS); /* there are two */
  CHECK(ecat_find(bus, VENDOR, LAMPS_PRODUCT, 0) == LAMPS);
  CHECK(ecat_find(bus, VENDOR, LAMPS_PRODUCT, 1) == ECAT_EBUS);
  CHECK(ecat_find_name(bus, "EL2008") == LAMPS && ecat_find_name(bus, "3") == LAMPS);
  CHECK(ecat_find_name(bus, "") == ECAT_EBUS && ecat_find_name(bus, NULL) == ECAT_EBUS);
  CHECK(ecat_find_name(bus, "99999999999999999999") == ECAT_EBUS);
  CHECK(ecat_expect(bus, LAMPS, VENDOR, LAMPS_PRODUCT, 0) == LAMPS);
  CHECK(ecat_expect(bus, LAMPS, VENDOR, LAMPS_PRODUCT, 1) == ECAT_EBUS);
  CHECK(ecat_expect(bus, LAMPS, VENDOR, 1, 0) == ECAT_EBUS);
}

static void reading(ecat_t *bus) {
  ecat_domain_info domain;
  const void *image;
  size_t size = 0;
  uint64_t cycle = ecat_cycle(bus);
  int64_t whole = -1;
  int tries = 0;
  double value = -1, physical = -1;
  int status = ecat_bind(bus, DRIVE, 0x6041, 0, ECAT_INPUT);
  ecat_signal_info entry;
  CHECK(status >= 0 && ecat_signal(bus, status, &entry) == 0);
  CHECK(ecat_wait(bus, 2, 60) == 0 && ecat_cycle(bus) >= cycle + 2);
  CHECK(ecat_wait(bus, 1000000, 0) == ECAT_ETIMEOUT && ecat_wait(bus, 1, -1) == ECAT_EARG);
  CHECK(ecat_wait_domain(bus, 0, 1, 60) == 0 && ecat_wait_domain(bus, 1, 1, 1) == ECAT_EARG);
  CHECK(ecat_wait_domain(bus, 0, 1000000, 0) == ECAT_ETIMEOUT);
  CHECK(ecat_sample(bus) == 0 && ecat_sample_domain(bus, -1) == ECAT_EARG);
  do { /* a busy machine may be late for a frame */
    CHECK(ecat_wait(bus, 1, 60) == 0 && ecat_sample_domain(bus, 0) == 0);
    CHECK(ecat_domain(bus, 0, &domain) == 0 && domain.cycle >= cycle && domain.wkc_expected > 0);
  } while (domain.wkc_state != ECAT_WKC_COMPLETE && ++tries < 1000);
  CHECK(domain.wkc == domain.wkc_expected && domain.wkc_state == ECAT_WKC_COMPLETE);
  CHECK(domain.age >= 0 && domain.name != NULL && domain.divider == 1);
  CHECK(ecat_domain(bus, 1, &domain) == ECAT_EARG);
  image = ecat_image(bus, 0, &size);
  CHECK(image != NULL && size >= 8 && ecat_image(bus, 1, &size) == NULL);
  CHECK(ecat_validity(bus, status) == ECAT_VALID && ecat_validity(bus, -1) == ECAT_EARG);
  CHECK(ecat_read(bus, status, &value) == 0 && ecat_read_int(bus, status, &whole) == 0);
  CHECK(ecat_read_physical(bus, status, &physical) == 0);
  CHECK(value == (double)whole && physical == value * entry.scale + entry.offset);
  {
    uint16_t raw;
    memcpy(&raw, (const char *)image + entry.bit_offset / 8, sizeof raw);
    CHECK(raw == whole);
  }
  CHECK(ecat_read(bus, -1, &value) == ECAT_EARG && ecat_read_int(bus, 9999, &whole) == ECAT_EARG);
  CHECK(ecat_read_physical(bus, 9999, &value) == ECAT_EARG);
  {
    int two[2];
    ecat_summary found[2];
    two[0] = two[1] = status;
    CHECK(ecat_summarize(bus, two, 2, 5, 10, found) == 0 && ecat_cycle(bus) >= cycle + 4);
    CHECK(found[0].count == found[1].count && found[0].count <= 1000);
    CHECK(found[0].count == 0 || (found[0].minimum <= found[0].mean && found[0].mean <= found[0].maximum));
    CHECK(found[0].count == 0 || (found[0].minimum <= found[0].last && found[0].last <= found[0].maximum));
    two[1] = 9999;
    CHECK(ecat_summarize(bus, two, 2, 1, 1, found) == ECAT_EARG);
    CHECK(ecat_summarize(bus, two, 0, 1, 10, found) == 0);
    CHECK(ecat_summarize(bus, two, 1, 1000000, -1, found) == ECAT_EARG);
  }
}

/* Waits until an output is as it was committed. */
static void await(ecat_t *bus, int signal, double wanted) {
  double value = -1;
  int tries;
  for (tries = 0; tries < 10000 && value != wanted; tries++)
    CHECK(ecat_wait(bus, 1, 60) == 0 && ecat_sample(bus) == 0 && ecat_read(bus, signal, &value) == 0);
  CHECK(value == wanted);
}

static void writing(ecat_t *bus, const char *name) {
  ecat_t *other = NULL;
  ecat_output_info info;
  ecat_slave_info slave;
  int one = ecat_bind(bus, LAMPS, 0x7000, 1, ECAT_OUTPUT);
  int two = ecat_bind(bus, LAMPS, 0x7010, 1, ECAT_OUTPUT);
  int input = ecat_bind(bus, INPUTS, 0x6000, 1, ECAT_INPUT);
  CHECK(one >= 0 && two >= 0 && input >= 0 && ecat_open(&other, name) == 0);
  CHECK(ecat_commit(bus) == 0 && ecat_release(bus, LAMPS) == 0); /* of nothing */
  CHECK(ecat_write(bus, one, 1) == ECAT_ECLAIM && ecat_write(bus, input, 1) == ECAT_EARG);
  CHECK(ecat_claim(bus, COUPLER, 0) == ECAT_EARG && ecat_claim(bus, 99, 0) == ECAT_EBUS);
  CHECK(ecat_claim(bus, LAMPS, -1) == ECAT_EARG && ecat_claim_entry(bus, input, 0) == ECAT_EARG);
  CHECK(ecat_claim_entry(bus, one, 1e300) == 0 && ecat_claim_entry(bus, one, 0) == 0);
  CHECK(ecat_claim_entry(other, two, 10) == 0); /* another one of the same byte */
  CHECK(ecat_claim(other, LAMPS, 10) == ECAT_EOWNED && strstr(ecat_error(other), "belongs to"));
  CHECK(ecat_output(bus, one, &info) == 0 && info.owned && info.state == ECAT_OUTPUTS_CLAIMED);
  CHECK(info.owner >= 0 && info.program[0] != '\0' && info.age >= 0);
  CHECK(ecat_output(bus, two, &info) == 0 && !info.owned && info.owner >= 0);
  CHECK(ecat_output(bus, input, &info) == ECAT_EARG);
  {
    int three = ecat_bind(bus, LAMPS, 0x7020, 1, ECAT_OUTPUT), both[] = {three, two, three};
    CHECK(ecat_claim_entries(bus, both, 3, 0.1) == ECAT_EOWNED && strstr(ecat_error(bus), "0x7010"));
    CHECK(ecat_output(bus, three, &info) == 0 && info.owner == -1); /* and never was: */
    CHECK(info.reason == ECAT_REASON_START && info.since_cycle == 0);
    CHECK(ecat_output(bus, one, &info) == 0 && info.owned);
    both[1] = one;
    CHECK(ecat_claim_entries(bus, both, 3, 0.1) == 0);
    CHECK(ecat_output(bus, three, &info) == 0 && info.owned);
    both[1] = three;
    CHECK(ecat_release_entries(bus, both, 2) == 0);
    CHECK(ecat_output(bus, three, &info) == 0 && info.owner == -1);
    CHECK(ecat_output(bus, one, &info) == 0 && info.owned);
    both[1] = input;
    CHECK(ecat_claim_entries(bus, both, 3, 0) == ECAT_EARG);
    CHECK(ecat_release_entries(bus, both, 3) == ECAT_EARG);
    CHECK(ecat_claim_entries(bus, NULL, 1, 0) == ECAT_EARG && ecat_claim_entries(bus, NULL, 0, 0) == 0);
    CHECK(ecat_claim_entries(bus, both, 1, -1) == ECAT_EARG);
    CHECK(ecat_claim_entries(other, both, 1, 10) == 0); /* what was not granted is free */
    CHECK(ecat_release_entries(other, both, 1) == 0);
  }
  CHECK(ecat_write(bus, one, 2) == ECAT_ERANGE && ecat_write(bus, one, 1.5) == ECAT_ERANGE);
  CHECK(ecat_write(bus, one, -1) == ECAT_ERANGE && ecat_write(bus, one, 1e30) == ECAT_ERANGE);
  CHECK(ecat_write_int(bus, one, -1) == ECAT_ERANGE && ecat_write_int(bus, -1, 0) == ECAT_EARG);
  CHECK(ecat_write(bus, one, strtod("nan", NULL)) == ECAT_ERANGE);
  CHECK(ecat_write_physical(bus, -1, 0) == ECAT_EARG && ecat_write_scaled(bus, -1, 0, 1, 0) == ECAT_EARG);
  CHECK(ecat_write_scaled(bus, one, 1, 0, 0) == ECAT_EARG);
  CHECK(strstr(ecat_error(bus), "the scale must be a finite number other than 0") != NULL);
  CHECK(ecat_write_scaled(bus, one, 1, 1, strtod("inf", NULL)) == ECAT_EARG);
  CHECK(ecat_write_scaled(bus, one, strtod("nan", NULL), 2, 0) == ECAT_ERANGE);
  CHECK(ecat_write_scaled(bus, one, -1e300, 24, 0) == 0 && ecat_write(bus, one, 0.5) == 0);
  CHECK(ecat_write(bus, one, 1) == 0 && ecat_commit(bus) == 0);
  CHECK(ecat_write_physical(other, two, 1) == 0 && ecat_commit(other) == 0);
  await(bus, one, 1);
  await(bus, two, 1);
  CHECK(ecat_slave(bus, LAMPS, &slave) == 0 && slave.owned && slave.outputs == ECAT_OUTPUTS_ACTIVE);
  CHECK(ecat_write_int(bus, one, 0) == 0 && ecat_commit(bus) == 0);
  await(bus, one, 0);
  CHECK(ecat_release_entry(bus, one) == 0 && ecat_release_entry(bus, input) == ECAT_EARG);
  CHECK(ecat_output(bus, one, &info) == 0 && info.owner == -1 && info.reason == ECAT_REASON_RELEASED);
  ecat_close(other);
  await(bus, two, 0);
  CHECK(ecat_claim(bus, LAMPS, 10) == 0 && ecat_release(bus, LAMPS) == 0);
  /* A lease that is over: nobody samples. */
  CHECK(ecat_claim(bus, LAMPS, 10) == 0 && ecat_write(bus, one, 1) == 0);
  ecat_release_all(bus);
  CHECK(ecat_write(bus, one, 1) == ECAT_ECLAIM && ecat_commit(bus) == 0);
  CHECK(ecat_claim(bus, LAMPS, 0.001) == 0);
  CHECK(ecat_wait(bus, 3000, 60) == 0 && ecat_commit(bus) == ECAT_ELEASE);
  CHECK(ecat_write(bus, one, 1) == ECAT_ELEASE && ecat_commit(bus) == ECAT_ELEASE);
  CHECK(ecat_claim(bus, LAMPS, 10) == 0 && ecat_release(bus, LAMPS) == 0);
}

/* What needs no bus. */
static void values(const ecat_t *bus) {
  ecat_signal_info entry;
  uint64_t bits = 0;
  double low, high;
  memset(&entry, 0, sizeof entry);
  entry.type = 0x0003; /* INTEGER16 */
  entry.bit_length = 16;
  entry.scale = 0.5;
  entry.unit = "V";
  entry.minimum = -100;
  entry.maximum = HUGE_VAL;
  ecat_limits(&entry, &low, &high);
  CHECK(low == -100 && high == 32767);
  CHECK(ecat_encode(&entry, 2.5, &bits) == 0 && bits == 2);
  CHECK(ecat_encode(&entry, -101, &bits) == ECAT_ERANGE && ecat_encode(&entry, 1e300, &bits) < 0);
  CHECK(ecat_encode_int(&entry, -1, &bits) == 0 && bits == 0xFFFF);
  CHECK(ecat_encode_int(&entry, INT64_MIN, &bits) == ECAT_ERANGE);
  CHECK(ecat_encode_physical(&entry, -1e300, &bits) == 0 && bits == 0x10000 - 100);
  CHECK(ecat_encode_physical(&entry, strtod("nan", NULL), &bits) == ECAT_ERANGE);
  CHECK(ecat_to_physical(3, 0.5, -1) == 0.5 && ecat_to_raw(0.5, 0.5, -1) == 3);
  CHECK(ecat_round(2.5) == 2 && ecat_round(3.5) == 4 && ecat_round(-0.5) == 0);
  CHECK(ecat_round(-1.5) == -2 && ecat_round(0.49999999999999994) == 0);
  CHECK(ecat_round(4503599627370495.5) == 4503599627370496.0 && ecat_round(1e300) == 1e300);
}

static void requests(ecat_t *bus) {
  char data[ECAT_REQUEST_BYTES + 1] = {0};
  size_t length = 99;
  uint32_t reason = 0, vendor = 0;
  int handle[ECAT_REQUESTS], i;
  CHECK(ecat_sdo_start(bus, 99, 0x1018, 1, NULL, 0) == ECAT_EBUS);
  CHECK(ecat_sdo_start(bus, DRIVE, 0x10000, 0, NULL, 0) == ECAT_EARG);
  CHECK(ecat_sdo_start(bus, DRIVE, 0x6083, 0, data, sizeof data) == ECAT_EARG);
  CHECK(ecat_state_start(bus, DRIVE, 3) == ECAT_EARG && ecat_state_start(bus, 99, 8) == ECAT_EBUS);
  CHECK(ecat_poll(bus, -1, NULL, 0, NULL, NULL) == ECAT_EARG && ecat_cancel(bus, 5) == ECAT_EARG);
  CHECK(ecat_wait_request(bus, 0, 1) == ECAT_EARG);
  for (i = 0; i < ECAT_REQUESTS; i++)
    CHECK((handle[i] = ecat_sdo_start(bus, DRIVE, i == 1 ? 0x7777 : 0x1018, 1, NULL, 0)) >= 0);
  CHECK(ecat_sdo_start(bus, DRIVE, 0x1018, 1, NULL, 0) == ECAT_EFULL);
  CHECK(ecat_cancel(bus, handle[3]) == 0 && ecat_cancel(bus, handle[3]) == ECAT_EARG);
  CHECK(ecat_wait_request(bus, handle[0], 60) == 0);
  CHECK(ecat_poll(bus, handle[0], &vendor, sizeof vendor, &length, &reason) == 0);
  CHECK(length == 4 && vendor == 0x9A && reason == 0);
  CHECK(ecat_wait_request(bus, handle[1], 60) == 0);
  CHECK(ecat_poll(bus, handle[1], data, 1, &length, &reason) == ECAT_EABORT);
  CHECK(reason == 0x06020000 && length == 0);
  CHECK(ecat_wait_request(bus, handle[2], 60) == 0 && ecat_poll(bus, handle[2], data, 1, NULL, NULL) == 0);
  CHECK(ecat_poll(bus, handle[2], NULL, 0, NULL, NULL) == ECAT_EARG);
  CHECK((handle[0] = ecat_sdo_start(bus, DRIVE, 0x6083, 0, "\1\2\3", 4)) >= 0);
  CHECK(ecat_wait_request(bus, handle[0], 60) == 0 && ecat_poll(bus, handle[0], NULL, 0, NULL, NULL) == 0);
  CHECK((handle[0] = ecat_state_start(bus, LAMPS, ECAT_AL_OP)) >= 0);
  CHECK(ecat_wait_request(bus, handle[0], 60) == 0 && ecat_poll(bus, handle[0], NULL, 0, NULL, NULL) == 0);
  CHECK((handle[0] = ecat_sdo_start(bus, DRIVE, 0x1018, 1, NULL, 0)) >= 0);
  CHECK(ecat_wait_request(bus, handle[0], 0) == ECAT_ETIMEOUT || ecat_poll(bus, handle[0], NULL, 0, NULL, NULL) == 0);
  ecat_release_all(bus);
}

/* Asks the node for its device type, and waits for the frame and for the answer. */
static void ask_node(ecat_t *bus, int channel, uint64_t *sender) {
  ecat_can_frame question = {.id = 0x600 + IO_NODE, .length = 8, .data = {0x40, 0x00, 0x10}}, found[16];
  uint32_t number = 0;
  int answered = 0, sent = 0, i, count;
  CHECK(ecat_can_send(bus, channel, &question, 1, &number) == 1 && number > 0);
  while (!answered || !sent) {
    CHECK(ecat_can_wait(bus, channel, 60) == 0);
    CHECK((count = ecat_can_read(bus, channel, found, 16, 0)) >= 0);
    for (i = 0; i < count; i++) {
      sent |= found[i].kind == ECAT_CAN_SENT && found[i].own && found[i].number == number;
      answered |= found[i].kind == ECAT_CAN_RECEIVED && found[i].id == 0x580 + IO_NODE;
      if (found[i].own) *sender = found[i].sender;
    }
  }
}

static void can(ecat_t *bus, const char *name) {
  ecat_can_range range = {0x600, 0x67F}, wrong = {2, 1};
  ecat_can_frame frame = {.id = 0x602, .length = 9};
  ecat_can_info info;
  ecat_t *other = NULL;
  uint64_t sender = 0;
  int channel;
  CHECK(ecat_can_count(bus) == 2 && ecat_can_find(bus, LAMPS) == ECAT_EBUS);
  CHECK(ecat_can_find(bus, 99) == ECAT_EBUS && (channel = ecat_can_find(bus, IO_TERMINAL)) == 1);
  CHECK(ecat_can(bus, 2, &info) == ECAT_EARG && ecat_can(bus, channel, &info) == 0);
  CHECK(info.slave == IO_TERMINAL && info.bit_rate == 500000 && info.identifier_bits == 29);
  CHECK(ecat_can_listen(bus, channel) == 0 && ecat_can_listen(bus, -1) == ECAT_EARG);
  CHECK(ecat_can_sender(bus) == 0 || bus != NULL);
  CHECK(ecat_can_wait(bus, channel, -1) == ECAT_EARG && ecat_can_wait(bus, 9, 1) == ECAT_EARG);
  CHECK(ecat_can_read(bus, 9, &frame, 1, 0) == ECAT_EARG);
  CHECK(ecat_can_send(bus, channel, &frame, 1, NULL) == ECAT_ECLAIM && ecat_can_flush(bus, channel, 1) == ECAT_ECLAIM);
  CHECK(ecat_can_release(bus, channel) == 0 && ecat_can_release(bus, 9) == ECAT_EARG);
  CHECK(ecat_can_claim(bus, channel, -1, NULL, 0) == ECAT_EARG);
  CHECK(ecat_can_claim(bus, channel, 0, &wrong, 1) == ECAT_EARG);
  CHECK(ecat_can_claim(bus, channel, 0, &range, 1) == 0);
  CHECK(ecat_claim(bus, LAMPS, 1) == ECAT_EARG); /* a thread gives the signs of life of this connection */
  CHECK(ecat_can_send(bus, channel, &frame, 1, NULL) == ECAT_ERANGE);
  ask_node(bus, channel, &sender);
  CHECK(sender != 0 && sender == ecat_can_sender(bus));
  CHECK(ecat_open(&other, name) == 0 && ecat_can_claim(other, channel, 5, &range, 1) == ECAT_EOWNED);
  CHECK(ecat_can_claim(other, channel, 5, NULL, 0) == 0);
  frame.length = 0;
  CHECK(ecat_can_send(other, channel, &frame, 1, NULL) == ECAT_EOWNED);
  CHECK(ecat_claim(other, LAMPS, 5) == 0); /* with a lease both are possible */
  CHECK(ecat_can_release(bus, channel) == 0 && ecat_can_send(other, channel, &frame, 1, NULL) == 1);
  CHECK(ecat_can_flush(other, channel, 60) == 0 && ecat_can(other, channel, &info) == 0 && info.own_sent == 1);
  ecat_close(other);
  ecat_release_all(bus);
}

static void restart(ecat_t *bus) {
  uint64_t before = ecat_instance(bus);
  int lamp = ecat_bind(bus, LAMPS, 0x7000, 1, ECAT_OUTPUT), request, code = 0;
  CHECK(ecat_claim(bus, LAMPS, 10) == 0 && ecat_write(bus, lamp, 1) == 0 && ecat_commit(bus) == 0);
  CHECK((request = ecat_sdo_start(bus, DRIVE, 0x1018, 1, NULL, 0)) >= 0);
  puts("restart");
  fflush(stdout);
  while (ecat_instance(bus) == before) {
    code = ecat_wait(bus, 1, 0.05);
    if (code == 0) code = ecat_sample(bus);
    CHECK(code == 0 || code == ECAT_EDOWN || code == ECAT_ESTALE || code == ECAT_ETIMEOUT);
  }
  CHECK(ecat_poll(bus, request, NULL, 0, NULL, NULL) == ECAT_EDOWN);
  CHECK(ecat_write(bus, lamp, 1) == ECAT_ELEASE && ecat_commit(bus) == ECAT_ELEASE);
  CHECK(ecat_claim(bus, LAMPS, 10) == 0 && ecat_write(bus, lamp, 1) == 0 && ecat_commit(bus) == 0);
  await(bus, lamp, 1);
}

int main(int count, char **arguments) {
  ecat_t *bus = NULL;
  pthread_t thread;
  if (count != 2) return 2;
  opening(arguments[1]);
  pthread_create(&thread, NULL, look, arguments[1]);
  CHECK(ecat_open(&bus, arguments[1]) == 0);
  directory(bus, arguments[1]);
  reading(bus);
  writing(bus, arguments[1]);
  values(bus);
  requests(bus);
  can(bus, arguments[1]);
  restart(bus);
  __atomic_store_n(&stop, 1, __ATOMIC_RELEASE);
  pthread_join(thread, NULL);
  ecat_close(bus);
  puts("done");
  return 0;
}
