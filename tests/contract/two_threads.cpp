// Two threads with a handle each, on the reference plant, for the thread sanitizer. Arguments: name of
// the bus, and "shared" for one handle in both threads, which is not allowed and must be found.
#include <ecat/ecat.hpp>

#include <cstdio>
#include <cstring>
#include <thread>

using namespace std::chrono_literals;

static int failures[2];

static void work(ecat::Client& bus, unsigned channel) {
  auto light = bus.output<bool>(channel == 1 ? "EL2008/0x7000:01" : "EL2008/0x7010:01");
  for (int round = 0; round < 5; round++) {
    ecat::Claim claim = bus.claim(light, 30s);
    ecat::Request question = bus.upload(0, 0x1018, channel);
    for (int n = 0; n < 200; n++) {
      bus.wait(1, 10s);
      bus.sample();
      light.write(n % 2 == 0);
      bus.commit();
    }
    question.wait(10s);
    (void)ecat_layout();
    (void)bus.slave(0);
  }
}

static void run(ecat::Client& bus, unsigned channel) {
  try {
    work(bus, channel);
  } catch (const ecat::Error& error) {
    if (error.code() == ECAT_ELEASE) return work(bus, channel);  // a slow machine
    std::fprintf(stderr, "channel %u: %s\n", channel, error.what());
    failures[channel - 1] = 1;
  }
}

int main(int argc, char** argv) {
  if (argc < 2) return 2;
  ecat::Client first(argv[1]), second(argv[1]);
  const bool shared = argc > 2 && std::strcmp(argv[2], "shared") == 0;
  std::thread one([&] { run(first, 1); });
  std::thread two([&] { run(shared ? first : second, 2); });
  one.join();
  two.join();
  return failures[0] + failures[1];
}
