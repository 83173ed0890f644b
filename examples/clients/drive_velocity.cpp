// Switches a CiA 402 drive on, turns it at a velocity for some seconds, and brings it to rest.
//
//     drive_velocity [BUS [POSITION [VELOCITY [SECONDS [LEASE_MS]]]]]
//
// VELOCITY is in the units of object 0x60FF. If this program gets no processor for LEASE_MS (100), the daemon
// takes its outputs. Prints target and actual velocity four times a second.
// Ctrl-C, an error of the drive and the end of this program all end in the safe values of the outputs;
// how the daemon brings the drive to rest then is a matter of its configuration.
#include <ecat/ecat.hpp>

#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <string>

namespace {

constexpr std::int8_t cyclic_velocity = 9;  // object 0x6060

volatile std::sig_atomic_t stop = 0;

// The state machine of CiA 402, table "state coding" of the status word.
enum class State { not_ready, switch_on_disabled, ready, switched_on, enabled, quick_stop, fault };

State state_of(std::uint16_t status_word) {
  if ((status_word & 0x08) != 0) return State::fault;
  if ((status_word & 0x40) != 0) return State::switch_on_disabled;
  if ((status_word & 0x01) == 0) return State::not_ready;
  if ((status_word & 0x20) == 0) return State::quick_stop;
  if ((status_word & 0x04) != 0) return State::enabled;
  return (status_word & 0x02) != 0 ? State::switched_on : State::ready;
}

// The control word that leads one step on towards `enabled`, or to `ready`, where it coasts.
std::uint16_t control_word(State state, bool enable) {
  if (!enable || state == State::switch_on_disabled) return 0x06;
  return state == State::ready ? 0x07 : 0x0F;
}

class Drive {
 public:
  Drive(ecat::Client& bus, int position, std::chrono::milliseconds lease)
      : bus_(bus),
        control_(bus.output<std::uint16_t>(position, 0x6040)),
        target_(bus.output<std::int32_t>(position, 0x60FF)),
        mode_(bus.output<std::int8_t>(position, 0x6060)),
        status_(bus.input<std::uint16_t>(position, 0x6041)),
        actual_(bus.input<std::int32_t>(position, 0x606C)),
        claim_(bus.claim(position, lease)) {}

  // One cycle: waits for it, reads, and sends the next target.
  void step(std::int32_t velocity, bool enable) {
    bus_.wait();
    bus_.sample();
    state_ = state_of(status_.read());
    mode_.write(cyclic_velocity);
    control_.write(control_word(state_, enable));
    target_.write(state_ == State::enabled ? velocity : 0);
    bus_.commit();
  }
  State state() const { return state_; }
  std::int32_t velocity() const { return actual_.read(); }

 private:
  ecat::Client& bus_;
  ecat::Output<std::uint16_t> control_;
  ecat::Output<std::int32_t> target_;
  ecat::Output<std::int8_t> mode_;
  ecat::Signal<std::uint16_t> status_;
  ecat::Signal<std::int32_t> actual_;
  ecat::Claim claim_;  // last: it is given back first
  State state_ = State::not_ready;
};

// Ramps up in a second, holds, and ramps down, so that the drive can follow.
double profile(double time, double seconds) {
  if (time > seconds - 1) return seconds > time ? seconds - time : 0;
  return time < 1 ? time : 1;
}

int run(ecat::Client& bus, int position, double velocity, double seconds,
        std::chrono::milliseconds lease) {
  Drive drive(bus, position, lease);
  const double cycle = bus.cycle_time().count();
  double waited = 0, time = 0, printed = 0;
  std::printf("%8s %12s %12s\n", "time/s", "target", "actual");
  while (stop == 0 && time < seconds) {
    const auto target = static_cast<std::int32_t>(velocity * profile(time, seconds));
    drive.step(target, true);
    if (drive.state() == State::fault) {
      std::fprintf(stderr, "drive_velocity: the drive reports a fault; object 0x603F says which\n");
      return 1;
    }
    if (drive.state() != State::enabled) {
      waited += cycle;
      if (waited < 5) continue;
      std::fprintf(stderr, "drive_velocity: the drive cannot be enabled\n");
      return 1;
    }
    time += cycle;
    if (time < printed) continue;
    std::printf("%8.3f %12d %12d\n", time, target, drive.velocity());
    printed = time + 0.25;
  }
  for (int n = 0; n < 100; n++) drive.step(0, false);
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  const auto argument = [&](int n, const char* otherwise) { return argc > n ? argv[n] : otherwise; };
  const std::string first = argument(1, "ecat0");
  if (first[0] == '-') {
    std::puts("usage: drive_velocity [BUS [SLAVE [VELOCITY [SECONDS [LEASE_MS]]]]]\n"
              "Turns a drive (CiA 402) with a velocity in its own unit, such as counts/s.");
    return first != "--help";
  }
  std::signal(SIGINT, [](int) { stop = 1; });
  std::signal(SIGTERM, [](int) { stop = 1; });
  try {
    ecat::Client bus(argument(1, "ecat0"));
    return run(bus, bus.find(argument(2, "0")), std::atof(argument(3, "20000")),
               std::atof(argument(4, "4")),
               std::chrono::milliseconds(std::atoi(argument(5, "100"))));
  } catch (const ecat::Error& error) {
    std::fprintf(stderr, "drive_velocity: %s\n", error.what());
    return 1;
  }
}
