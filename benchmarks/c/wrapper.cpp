// The overhead of the C++ wrapper: times a snapshot with 20 reads in C and in C++, in turns.
//
// usage: wrapper BUS SECONDS
#include <ecat/ecat.hpp>

#include "bus.h"
#include "median.h"

#include <vector>

namespace {

constexpr int reads = 20, turn = 100;

void read_in_c(ecat_t* bus, const std::vector<int>& entries) {
  double values[reads];
  check(bus, ecat_sample(bus));
  for (int i = 0; i < reads; i++) check(bus, ecat_read(bus, entries[i], &values[i]));
  keep(values);
}

void read_in_cpp(ecat::Client& bus, const std::vector<ecat::Signal<double>>& signals) {
  double values[reads];
  bus.sample();
  for (int i = 0; i < reads; i++) values[i] = signals[i].read();
  keep(values);
}

template <class Call>
double time_of(Call call) {
  const double idle = settling(turn), start = now_ns();
  for (int i = 0; i < turn; i++) {
    call();
    settle();
  }
  return (now_ns() - start) / turn - idle;
}

}  // namespace

int main(int count, char** arguments) {
  if (count != 3) {
    std::fprintf(stderr, "usage: wrapper BUS SECONDS\n");
    return 2;
  }
  ecat_t* plain = open_bus(arguments[1]);
  ecat::Client bus{arguments[1]};
  std::vector<int> entries(reads);
  choose(plain, entries.data(), reads);
  std::vector<ecat::Signal<double>> signals;
  for (int entry : entries) signals.emplace_back(bus.handle(), entry);

  std::vector<double> c, cpp;
  const double end = now_ns() + std::atof(arguments[2]) * 1e9;
  do {
    c.push_back(time_of([&] { read_in_c(plain, entries); }));
    cpp.push_back(time_of([&] { read_in_cpp(bus, signals); }));
  } while (now_ns() < end);
  const auto turns = static_cast<unsigned>(c.size());
  std::printf("{\"c\": %.2f, \"cpp\": %.2f}\n", median(c.data(), turns), median(cpp.data(), turns));
  ecat_close(plain);
  return 0;
}
