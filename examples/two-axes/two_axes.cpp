// Two axes in C++: they home, move together, and stop. As two_axes.c.
//
//     c++ -std=c++17 $(ecatctl client-flags) -o two_axes two_axes.cpp && ./two_axes ecat0 >two_axes.csv
#include <ecat/ecat_axis.hpp>

#include <cstdio>
#include <iostream>

namespace {

void move(ecat::Axes& axes, const std::vector<double>& positions, std::uint64_t begin) {
  axes.move(positions, {0.1, 2.0}, {0.5, 8.0}, ecat::Seconds(0));
  while (!axes.reached()) {
    axes.wait();
    const double time = static_cast<double>(axes.state(0).cycle - begin) * 0.001;
    std::printf("%.3f,%.6f,%.6f\n", time, axes.position(0), axes.position(1));
  }
}

}  // namespace

int main(int argc, char** argv) {
  try {
    ecat::Axes axes(argc > 1 ? argv[1] : "ecat0", {"x", "y"});
    axes.start();
    axes.enable();
    axes.home();
    axes.move({0.0, 0.0});
    const std::uint64_t begin = axes.state(0).cycle;
    move(axes, {0.05, 2.0}, begin);
    move(axes, {0.0, 0.0}, begin);
    axes.stop();
  } catch (const ecat::Error& error) {
    std::cerr << error.what() << '\n';
    return 1;
  }
  return 0;
}
