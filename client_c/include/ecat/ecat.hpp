// ecat: the client of the ecatd daemon for C++17, a thin layer over ecat.h.
//
//     ecat::Client bus("ecat0");
//     auto speed = bus.input<std::int32_t>("0/0x606C:00");
//     auto target = bus.output<std::int32_t>("0/0x60FF:00");
//     ecat::Claim drive = bus.claim(0, 100ms);
//     for (;;) {
//       bus.wait();
//       bus.sample();
//       target.write(speed.read() < 1000 ? 1000 : 0);
//       bus.commit();
//     }
//
// Calls that fail throw ecat::Error, with the text and the code of ecat.h. Reading, writing, sampling and
// committing cost a call of the C function and one comparison, and allocate nothing.
//
// A Client belongs to one thread at a time; open one in each. Signals, outputs, claims and requests work
// as long as their Client lives, even if it was moved, and must be destroyed before it: declare them
// after it.
#ifndef ECAT_HPP
#define ECAT_HPP

#include <ecat/ecat.h>

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <memory>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <utility>

namespace ecat {

using Seconds = std::chrono::duration<double>;

// A failed call: what() is the error text, code() the error code.
class Error : public std::runtime_error {
 public:
  Error(int code, const std::string& sentence, std::uint32_t abort_code = 0)
      : std::runtime_error(sentence), code_(code), abort_code_(abort_code) {}
  int code() const noexcept { return code_; }  // enum ecat_errno
  // SDO abort code (ETG.1000.6), with ECAT_EABORT.
  std::uint32_t abort_code() const noexcept { return abort_code_; }

 private:
  int code_;
  std::uint32_t abort_code_;
};

namespace detail {

// Kept out of line, so that check() stays small enough to be inlined.
#if defined(__GNUC__)
[[gnu::cold, gnu::noinline]]
#endif
[[noreturn]] inline void fail(const ecat_t* bus, int code, std::uint32_t abort_code = 0) {
  throw Error(code, ecat_error(bus), abort_code);
}

inline int check(const ecat_t* bus, int code) {
  if (code < 0) fail(bus, code);
  return code;
}

// By CoE data type (ETG.1000.6), as type_is_real() and type_is_signed() of the library.
constexpr bool is_real(const ecat_signal_info& entry) {
  return (entry.type == 0x0008 && entry.bit_length == 32) ||
         (entry.type == 0x0011 && entry.bit_length == 64);
}

constexpr bool is_signed(const ecat_signal_info& entry) {
  return (entry.type >= 0x0002 && entry.type <= 0x0004) || entry.type == 0x0010 ||
         (entry.type >= 0x0012 && entry.type <= 0x0015);
}

// Whether T holds every value of the entry.
template <class T>
constexpr bool holds(const ecat_signal_info& entry) {
  constexpr unsigned digits = static_cast<unsigned>(std::numeric_limits<T>::digits);
  const unsigned bits = entry.bit_length - (is_signed(entry) ? 1 : 0);
  if (is_real(entry)) return std::is_floating_point_v<T> && sizeof(T) * 8 >= entry.bit_length;
  return bits <= digits && (std::is_signed_v<T> || !is_signed(entry));
}

template <class T>
void check_type(const ecat_signal_info& entry) {
  if (holds<T>(entry)) return;
  const char* kind = is_real(entry) ? "floating-point" : is_signed(entry) ? "signed" : "unsigned";
  throw Error(ECAT_EARG, std::string("'") + entry.name + "' of slave " +
                             std::to_string(entry.slave) + " has " +
                             std::to_string(entry.bit_length) + " bits (" + kind +
                             "), which the chosen C++ type does not hold");
}

}  // namespace detail

// An entry of the process image, read as T: bool, an integer or a floating-point type that holds all its
// values. A small handle that may be copied.
template <class T>
class Signal {
  static_assert(std::is_arithmetic_v<T>, "an entry is read as bool, integer or floating point");

 public:
  // Use Client::input() and Client::output() instead.
  Signal(ecat_t* bus, int number) : bus_(bus), number_(number) { detail::check_type<T>(info()); }

  // Raw value of the last sample.
  T read() const {
    if constexpr (std::is_floating_point_v<T>) {
      double value = 0;
      detail::check(bus_, ecat_read(bus_, number_, &value));
      return static_cast<T>(value);
    } else {
      std::int64_t value = 0;
      detail::check(bus_, ecat_read_int(bus_, number_, &value));
      return static_cast<T>(value);
    }
  }
  // Raw value * scale + offset, in the unit of info().
  double physical() const {
    double value = 0;
    detail::check(bus_, ecat_read_physical(bus_, number_, &value));
    return value;
  }
  enum ecat_validity validity() const {
    return static_cast<enum ecat_validity>(detail::check(bus_, ecat_validity(bus_, number_)));
  }
  bool valid() const { return validity() == ECAT_VALID; }

  ecat_signal_info info() const {
    ecat_signal_info info{};
    detail::check(bus_, ecat_signal(bus_, number_, &info));
    return info;
  }
  int number() const noexcept { return number_; }  // its handle in C

 protected:
  ecat_t* bus_;
  int number_;
};

// An output: read() returns the value in the last sample, write() stages a new one.
template <class T>
class Output : public Signal<T> {
 public:
  using Signal<T>::Signal;

  // Stages a raw value; Client::commit() publishes it. The output must be claimed before. The value is
  // not converted to T first, but follows the rule of ecat_write(): an integer entry makes 4 of 3.5, and
  // an entry of 8 bits refuses 300.
  template <class V>
  void write(V value) {
    static_assert(std::is_arithmetic_v<V>, "a raw value is bool, integer or floating point");
    detail::check(this->bus_, is_integer(value) ? ecat_write_int(this->bus_, this->number_,
                                                                 static_cast<std::int64_t>(value))
                                                : ecat_write(this->bus_, this->number_,
                                                             static_cast<double>(value)));
  }
  // Stages a physical value, in the unit of info(); see ecat_write_physical().
  void write_physical(double value) {
    detail::check(this->bus_, ecat_write_physical(this->bus_, this->number_, value));
  }
  // The owner and the state of this output now, and since when.
  ecat_output_info owner() const {
    ecat_output_info info{};
    detail::check(this->bus_, ecat_output(this->bus_, this->number_, &info));
    return info;
  }

 private:
  // Whether ecat_write_int() keeps the value: it passes 64 bits to an unsigned entry, else 63 and a sign.
  template <class V>
  static constexpr bool is_integer(V value) {
    if constexpr (std::is_floating_point_v<V>)
      return false;
    else if constexpr (std::is_signed_v<V>)
      return std::is_signed_v<T> || value >= 0;
    else
      return std::is_unsigned_v<T> || static_cast<std::uint64_t>(value) <= INT64_MAX;
  }
};

// Ownership of the outputs of a slave, or of one output, while this object lives and samples are taken.
class [[nodiscard]] Claim {
 public:
  enum class What { slave, entry };

  // Use Client::claim() instead.
  Claim(ecat_t* bus, What what, int number, Seconds lease)
      : bus_(bus), what_(what), number_(number), lease_(lease) {
    renew();
  }
  Claim(Claim&& other) noexcept { *this = std::move(other); }
  Claim& operator=(Claim&& other) noexcept {  // the outputs of this one are released with the other one
    std::swap(bus_, other.bus_);
    std::swap(what_, other.what_);
    std::swap(number_, other.number_);
    std::swap(lease_, other.lease_);
    std::swap(held_, other.held_);
    return *this;
  }
  ~Claim() {
    if (held_) give_back();
  }

  // Claims again after ECAT_ELEASE or a restart of the daemon; otherwise it does nothing.
  void renew() {
    auto claim = what_ == What::slave ? ecat_claim : ecat_claim_entry;
    detail::check(bus_, claim(bus_, number_, lease_.count()));
    held_ = true;
  }
  // Releases the outputs before the destructor would; they go to their safe values.
  void release() {
    if (held_) detail::check(bus_, give_back());
  }

 private:
  int give_back() noexcept {
    held_ = false;
    return (what_ == What::slave ? ecat_release : ecat_release_entry)(bus_, number_);
  }

  ecat_t* bus_ = nullptr;
  What what_ = What::slave;
  int number_ = 0;
  Seconds lease_{};
  bool held_ = false;
};

// An SDO request, or a request for an AL state. Only wait() blocks the program.
class [[nodiscard]] Request {
 public:
  // Use Client::upload(), download() and state() instead.
  Request(ecat_t* bus, int request) : bus_(bus), request_(detail::check(bus, request)) {}
  Request(Request&& other) noexcept { *this = std::move(other); }
  Request& operator=(Request&& other) noexcept {
    std::swap(bus_, other.bus_);
    std::swap(request_, other.request_);
    std::swap(length_, other.length_);
    std::swap(data_, other.data_);
    return *this;
  }
  ~Request() {
    if (request_ >= 0) ecat_cancel(bus_, request_);
  }

  // Whether the answer has come; throws if it is an error.
  bool done() {
    if (request_ < 0) return true;
    std::uint32_t abort_code = 0;
    const int code = ecat_poll(bus_, request_, data_.data(), data_.size(), &length_, &abort_code);
    if (code == ECAT_EBUSY) return false;
    request_ = -1;
    if (code < 0) detail::fail(bus_, code, abort_code);
    return true;
  }
  // Waits for the answer. No samples are taken meanwhile, so a claim may lapse.
  void wait(Seconds timeout = Seconds(1)) {
    if (request_ >= 0) detail::check(bus_, ecat_wait_request(bus_, request_, timeout.count()));
    done();
  }

  // The uploaded bytes.
  const unsigned char* data() const noexcept { return data_.data(); }
  std::size_t size() const noexcept { return length_; }
  // The uploaded bytes as a number. T must have the size of the object.
  template <class T>
  T value() const {
    static_assert(std::is_arithmetic_v<T>, "an object is read as a number, or as bytes by data()");
    if (size() != sizeof(T))
      throw Error(ECAT_EARG, "the object has " + std::to_string(size()) +
                                 " bytes, and the chosen C++ type " + std::to_string(sizeof(T)));
    T value;
    std::memcpy(&value, data_.data(), sizeof value);
    return value;
  }

 private:
  ecat_t* bus_ = nullptr;
  int request_ = -1;  // handle in C; -1: answered
  std::size_t length_ = 0;
  std::array<unsigned char, ECAT_REQUEST_BYTES> data_{};
};

// A connection to a bus.
class Client {
 public:
  explicit Client(const std::string& bus = "ecat0") {
    ecat_t* opened = nullptr;
    const int code = ecat_open(&opened, bus.c_str());
    bus_.reset(opened);
    detail::check(opened, code);
  }

  // Takes one consistent image of every domain, or of one; all reads until the next call see it.
  void sample() { detail::check(handle(), ecat_sample(handle())); }
  void sample(int domain) { detail::check(handle(), ecat_sample_domain(handle(), domain)); }
  // Publishes all written outputs at once; they go out with the next cycle.
  void commit() { detail::check(handle(), ecat_commit(handle())); }
  // Waits until so many cycles, or exchanges of a domain, have ended since the last sample or wait.
  void wait(unsigned cycles = 1, Seconds timeout = Seconds(1)) {
    detail::check(handle(), ecat_wait(handle(), cycles, timeout.count()));
  }
  void wait_domain(int domain, unsigned exchanges = 1, Seconds timeout = Seconds(1)) {
    detail::check(handle(), ecat_wait_domain(handle(), domain, exchanges, timeout.count()));
  }

  // An entry by "slave/entry" (see ecat_lookup) or by its address.
  template <class T>
  Signal<T> input(const std::string& name) {
    return {handle(), detail::check(handle(), ecat_lookup(handle(), name.c_str(), ECAT_INPUT))};
  }
  template <class T>
  Signal<T> input(int position, unsigned index, unsigned subindex = 0) {
    return {handle(), bind(position, index, subindex, ECAT_INPUT)};
  }
  template <class T>
  Output<T> output(const std::string& name) {
    return {handle(), detail::check(handle(), ecat_lookup(handle(), name.c_str(), ECAT_OUTPUT))};
  }
  template <class T>
  Output<T> output(int position, unsigned index, unsigned subindex = 0) {
    return {handle(), bind(position, index, subindex, ECAT_OUTPUT)};
  }

  // The outputs of a slave, or one of them; see ecat_claim. 0: the daemon's default lease.
  Claim claim(int position, Seconds lease = Seconds(0)) {
    return {handle(), Claim::What::slave, position, lease};
  }
  template <class T>
  Claim claim(const Output<T>& output, Seconds lease = Seconds(0)) {
    return {handle(), Claim::What::entry, output.number(), lease};
  }
  // Releases all outputs and drops all requests.
  void release_all() { ecat_release_all(handle()); }

  // SDO requests to a slave; at most ECAT_REQUESTS requests at a time.
  Request upload(int position, unsigned index, unsigned subindex = 0) {
    return {handle(), ecat_sdo_start(handle(), position, index, subindex, nullptr, 0)};
  }
  Request download(int position, unsigned index, unsigned subindex, const void* data,
                   std::size_t size) {
    return {handle(), ecat_sdo_start(handle(), position, index, subindex, data, size)};
  }
  // T must have the size of the object: std::int8_t(8), not 8, for 0x6060.
  template <class T>
  Request download(int position, unsigned index, unsigned subindex, T value) {
    static_assert(std::is_arithmetic_v<T>, "an object is written as a number, or as bytes");
    return download(position, index, subindex, &value, sizeof value);
  }
  Request state(int position, ecat_al_state al_state) {
    return {handle(), ecat_state_start(handle(), position, al_state)};
  }

  // The position of a slave by identity, or by name.
  int find(std::uint32_t vendor, std::uint32_t product, unsigned nth = 0) {
    return detail::check(handle(), ecat_find(handle(), vendor, product, nth));
  }
  int find(const std::string& name) {
    return detail::check(handle(), ecat_find_name(handle(), name.c_str()));
  }
  // Throws unless the slave at this position has this identity; revision 0 accepts any.
  void expect(int position, std::uint32_t vendor, std::uint32_t product,
              std::uint32_t revision = 0) {
    detail::check(handle(), ecat_expect(handle(), position, vendor, product, revision));
  }

  int slave_count() const noexcept { return ecat_slave_count(handle()); }
  int signal_count() const noexcept { return ecat_signal_count(handle()); }
  int domain_count() const noexcept { return ecat_domain_count(handle()); }
  ecat_slave_info slave(int position) const {
    ecat_slave_info info{};
    detail::check(handle(), ecat_slave(handle(), position, &info));
    return info;
  }
  ecat_signal_info signal(int number) const {
    ecat_signal_info info{};
    detail::check(handle(), ecat_signal(handle(), number, &info));
    return info;
  }
  // Age, cycle and working counter of the last sample of a domain.
  ecat_domain_info domain(int number = 0) const {
    ecat_domain_info info{};
    detail::check(handle(), ecat_domain(handle(), number, &info));
    return info;
  }
  // The last sample of a domain as bytes, see ecat_image.
  std::pair<const unsigned char*, std::size_t> image(int domain = 0) const {
    std::size_t size = 0;
    const void* data = ecat_image(handle(), domain, &size);
    if (data == nullptr) detail::fail(handle(), ECAT_EARG);
    return {static_cast<const unsigned char*>(data), size};
  }
  const char* name() const noexcept { return ecat_name(handle()); }
  std::uint64_t fingerprint() const noexcept { return ecat_fingerprint(handle()); }
  std::uint64_t instance() const noexcept { return ecat_instance(handle()); }
  std::uint64_t cycle() const noexcept { return ecat_cycle(handle()); }  // the last finished one
  Seconds cycle_time() const noexcept { return Seconds(ecat_cycle_time(handle())); }

  // For calls of ecat.h.
  ecat_t* handle() const noexcept { return bus_.get(); }

 private:
  struct Close {
    void operator()(ecat_t* bus) const noexcept { ecat_close(bus); }
  };

  int bind(int position, unsigned index, unsigned subindex, int direction) {
    return detail::check(handle(), ecat_bind(handle(), position, index, subindex, direction));
  }

  std::unique_ptr<ecat_t, Close> bus_;
};

}  // namespace ecat

#endif
