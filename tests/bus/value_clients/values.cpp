// The client for C++.
#include <ecat/ecat.hpp>

#include "committed.h"

#include <map>

namespace {

template <class T>
int write(ecat::Client& bus, int number, char kind, double real, unsigned long long whole) {
  ecat::Output<T> output(bus.handle(), number);
  try {
    if (kind == 'p')
      output.write_physical(real);
    else if (kind == 'r')
      output.write(real);
    else if (std::is_unsigned_v<T>)
      output.write(static_cast<std::uint64_t>(whole));
    else
      output.write(static_cast<std::int64_t>(whole));
  } catch (const ecat::Error& error) {
    return error.code();
  }
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 4) return 10;
  ecat::Client bus(argv[1]);
  const ecat::Claim claim = bus.claim(0, ecat::Seconds(60));
  const unsigned char* out = out_segment(argv[1]);
  unsigned long long whole = 0;
  double real = 0;
  char kind = 0;
  int number = 0;
  begin(argv);
  while (next_value(&number, &kind, &real, &whole)) {
    const ecat_signal_info entry = bus.signal(number);
    const auto write_as = ecat::detail::is_real(entry)     ? write<double>
                          : ecat::detail::is_signed(entry) ? write<std::int64_t>
                          : entry.bit_length == 1          ? write<bool>
                                                           : write<std::uint64_t>;
    const int code = write_as(bus, number, kind, real, whole);
    bus.commit();
    std::printf("%d %llx\n", code, committed(out, &entry));
  }
  end();
}
