// What the C++ client promises, on the reference plant; argument: name of the bus. Prints what is
// not so.
#include <ecat/ecat.hpp>

#include <cstdio>
#include <cstdlib>
#include <functional>
#include <new>
#include <thread>
#include <vector>

using namespace std::chrono_literals;

static_assert(!std::is_copy_constructible_v<ecat::Client> && !std::is_copy_assignable_v<ecat::Client>);
static_assert(!std::is_copy_constructible_v<ecat::Claim> && !std::is_copy_assignable_v<ecat::Claim>);
static_assert(!std::is_copy_constructible_v<ecat::Request>);
static_assert(std::is_nothrow_move_constructible_v<ecat::Client> &&
              std::is_nothrow_move_assignable_v<ecat::Client>);
static_assert(std::is_nothrow_move_constructible_v<ecat::Claim> &&
              std::is_nothrow_move_assignable_v<ecat::Claim>);
static_assert(std::is_nothrow_move_constructible_v<ecat::Request>);
static_assert(std::is_trivially_copyable_v<ecat::Output<double>>);

static long allocations = 0;
static int failures = 0;

void* operator new(std::size_t size) {
  allocations++;
  if (void* memory = std::malloc(size)) return memory;
  throw std::bad_alloc();
}
void operator delete(void* memory) noexcept { std::free(memory); }
void operator delete(void* memory, std::size_t) noexcept { std::free(memory); }

static void expect(bool so, const char* what) {
  if (so) return;
  std::printf("not so: %s\n", what);
  failures++;
}

static void expect_error(int code, const std::string& part, const std::function<void()>& call) {
  try {
    call();
    std::printf("no error: %s\n", part.c_str());
  } catch (const ecat::Error& error) {
    if (error.code() == code && std::string(error.what()).find(part) != std::string::npos) return;
    std::printf("%d %s, expected: %d %s\n", error.code(), error.what(), code, part.c_str());
  }
  failures++;
}

static void reading_and_writing(ecat::Client& bus) {
  const int terminal = bus.find("EL2008");
  auto light = bus.output<bool>(terminal, 0x7000, 1);
  auto input = bus.input<bool>(bus.find(2, 0x03FA3052), 0x6000, 1);
  ecat::Claim claim = bus.claim(terminal, 30s);
  for (bool level : {true, false}) {
    light.write(level);
    bus.commit();
    for (int n = 0; n < 3000 && (bus.wait(1, 30s), bus.sample(), input.read() != level || !input.valid()); n++) continue;
    expect(input.read() == level && light.read() == level, "what is written comes back");
  }
  expect(bus.image().second > 0 && bus.domain().wkc_state == ECAT_WKC_COMPLETE, "the image");
  expect_error(ECAT_EARG, "has no domain 7", [&] { bus.image(7); });
  expect(input.valid() && input.physical() == 0, "validity and physical value");

  const long before = allocations;
  for (int n = 0; n < 1000; n++) {
    bus.sample();
    light.write(!input.read());
    bus.commit();
  }
  expect(allocations == before, "the hot path allocates nothing");
  light.write(false);
  bus.commit();
}

static void types(ecat::Client& bus) {
  expect_error(ECAT_EARG, "has 8 bits (signed)", [&] { bus.input<bool>(0, 0x6061); });
  expect_error(ECAT_EARG, "does not hold", [&] { bus.input<std::uint8_t>(0, 0x6061); });
  expect_error(ECAT_EARG, "has 32 bits (signed)", [&] { bus.input<float>(0, 0x606C); });
  expect_error(ECAT_ESIGNAL, "no output 0x606C:00", [&] { bus.output<double>(0, 0x606C); });
  bus.sample();
  expect(bus.input<double>(0, 0x6061).read() == bus.input<std::int8_t>(0, 0x6061).read(),
         "all types read the same");
}

static void ownership(ecat::Client& bus, const char* name) {
  auto light = bus.output<bool>("EL2008/0x7010:01");
  ecat::Client other(name);
  {
    ecat::Claim first = bus.claim(light, 30s);
    ecat::Claim claim = std::move(first);
    expect(light.owner().owned == 1, "a claim that was moved lives");
    expect_error(ECAT_EOWNED, "belongs to", [&] { (void)other.claim(3); });
    expect_error(ECAT_ECLAIM, "must be claimed",
                 [&] { bus.output<bool>("EL2008/0x7020:01").write(true); });
  }
  expect(light.owner().owner == -1, "a claim ends with its scope");

  (void)bus.claim(light);  // with the daemon's default lease, some cycles
  ecat::Claim brief = bus.claim(light, 2s);
  while (light.owner().state != ECAT_OUTPUTS_SAFE) std::this_thread::sleep_for(1ms);
  expect_error(ECAT_ELEASE, "did not sample in time", [&] { bus.commit(); });
  brief.renew();
  expect(light.owner().owned == 1, "a claim is made again");
  ecat::Claim all = bus.claim(3, 30s);
  all = std::move(brief);
  all.release();
  expect(light.owner().owner == -1, "a claim is given back");
  {
    ecat::Claim early = bus.claim(3, 30s);
    early.release();
    early = bus.claim(light, 30s);  // what was released ends here, and takes nothing along
    expect(light.owner().owned == 1, "a claim that was released does not end another one");
    early.release();
    ecat::Claim later = bus.claim(light, 30s);
    early.release();
    expect(light.owner().owned == 1, "a claim is given back once");
  }
}

static void requests(ecat::Client& bus) {
  ecat::Request mode = bus.upload(0, 0x6061);
  mode.wait(30s);
  expect(mode.done() && mode.size() == 1, "an answer stays");
  expect_error(ECAT_EARG, "has 1 bytes", [&] { (void)mode.value<std::int32_t>(); });
  ecat::Request write = bus.download(0, 0x6060, 0, mode.value<std::int8_t>());
  ecat::Request moved = std::move(write);
  moved.wait(30s);
  ecat::Request none = bus.upload(0, 0x5FFF);
  try {
    none.wait(30s);
    expect(false, "an object that is not there");
  } catch (const ecat::Error& error) {
    expect(error.code() == ECAT_EABORT && error.abort_code() == 0x06020000, "the abort code");
  }
  for (int n = 0; n < 3; n++) {  // those that nobody waits for give their place back
    std::vector<ecat::Request> all;
    for (int i = 0; i < ECAT_REQUESTS; i++) all.push_back(bus.upload(0, 0x1000));
    expect_error(ECAT_EFULL, "4 requests are running", [&] { (void)bus.upload(0, 0x1000); });
  }
  ecat::Request after = bus.upload(0, 0x1018, 1);
  after.wait(30s);
  expect(after.value<std::uint32_t>() == 0x9A, "the answer is to this question");
  ecat::Request impatient = bus.upload(0, 0x1000);
  try {
    impatient.wait(0s);
    expect(impatient.done(), "who does not wait is told so, unless it was answered meanwhile");
  } catch (const ecat::Error& error) {
    expect(error.code() == ECAT_ETIMEOUT, "who does not wait is told so");
  }
}

int main(int argc, char** argv) {
  const char* name = argc > 1 ? argv[1] : "ecat0";
  expect_error(ECAT_EDOWN, "bus 'nobody' is not running", [] { ecat::Client("nobody"); });
  try {
    ecat::Client opened(name);
    ecat::Client bus = std::move(opened);
    expect(bus.slave_count() == 8 && bus.slave(3).has_outputs, "the reference plant");
    expect_error(ECAT_EBUS, "has no slave 'EL9999'", [&] { bus.find("EL9999"); });
    expect_error(ECAT_EBUS, "give the position instead", [&] { bus.find("EL3008"); });
    bus.expect(bus.find("3"), 2, 0x07D83052);
    reading_and_writing(bus);
    types(bus);
    ownership(bus, name);
    requests(bus);
  } catch (const ecat::Error& error) {
    std::printf("%d %s\n", error.code(), error.what());
    return 1;
  }
  return failures == 0 ? 0 : 1;
}
