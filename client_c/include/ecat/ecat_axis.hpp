// ecat::Axes: axes that are enabled, homed, moved and stopped, for C++17; a thin layer over ecat_axis.h.
//
//     ecat::Axes axes("ecat0", {"x", "y"});
//     axes.start();
//     axes.enable();
//     axes.home();
//     axes.move({0.05, 1.0});  // both arrive at the same time
//     axes.stop();
//
// Positions are in rad, or in m of a linear axis. Calls that fail throw ecat::Error, whose text has axis, state,
// statusword and error code. A thread of the library exchanges the axes in every bus cycle; the object itself
// belongs to one thread at a time.
#ifndef ECAT_AXIS_HPP
#define ECAT_AXIS_HPP

#include <ecat/ecat.hpp>
#include <ecat/ecat_axis.h>

#include <string>
#include <vector>

namespace ecat {

class Axes {
 public:
  // Connects, and finds the axes: names or positions of slaves; "NAME/2" is the second axis of a drive.
  Axes(const std::string& bus, const std::vector<std::string>& names) {
    const int code = ecat_axes_open(&axes_, bus.c_str());
    if (code < 0) fail(code);
    for (const std::string& name : names) {
      const std::size_t slash = name.rfind('/');
      const bool has_number = slash != std::string::npos && slash + 2 == name.size();
      const int added = ecat_axes_add(axes_, (has_number ? name.substr(0, slash) : name).c_str(),
                                      has_number ? name.back() - '0' : 1);
      if (added < 0) fail(added);
    }
  }
  ~Axes() { ecat_axes_close(axes_); }
  Axes(const Axes&) = delete;
  Axes& operator=(const Axes&) = delete;

  // The settings of an axis, which may be changed before start().
  ecat_drive_settings& settings(int axis) { return found(axis).drive.settings; }
  bool linear(int axis) const { return found(axis).linear != 0; }  // m, not rad

  // Claims the axes. `lease`: seconds without an exchange after which they stop as their safe outputs say;
  // `together`: all stop when one of them stops by itself.
  void start(Seconds lease = Seconds(0.2), bool together = true) {
    check(ecat_axes_start(axes_, lease.count(), together ? 1 : 0));
  }

  void enable(Seconds timeout = Seconds(5)) { check(ecat_axes_enable(axes_, all, timeout.count())); }
  void disable(Seconds timeout = Seconds(10)) { check(ecat_axes_disable(axes_, all, timeout.count())); }
  void reset(Seconds timeout = Seconds(5)) { check(ecat_axes_reset(axes_, all, timeout.count())); }
  void home(Seconds timeout = Seconds(60)) { check(ecat_axes_home(axes_, all, timeout.count())); }
  void stop(Seconds timeout = Seconds(10)) { check(ecat_axes_stop(axes_, all, timeout.count())); }
  // One position for each axis; `speeds` and `accelerations` too, or none: those of the settings. With a timeout of 0
  // it begins only, and reached() says when they are there.
  void move(const std::vector<double>& positions, const std::vector<double>& speeds = {},
            const std::vector<double>& accelerations = {}, Seconds timeout = Seconds(60)) {
    sized(positions);
    if (!speeds.empty()) sized(speeds);
    if (!accelerations.empty()) sized(accelerations);
    check(ecat_axes_move(axes_, all, positions.data(), speeds.empty() ? nullptr : speeds.data(),
                         accelerations.empty() ? nullptr : accelerations.data(), timeout.count()));
  }
  bool reached() {
    const int code = ecat_axes_poll(axes_, all, ECAT_AXES_REACHED);
    if (code != ECAT_EBUSY) check(code);
    return code == 0;
  }
  // One speed, or torque, for each axis, until something else is asked for.
  void run(const std::vector<double>& speeds) {
    sized(speeds);
    check(ecat_axes_run(axes_, all, speeds.data()));
  }
  void push(const std::vector<double>& torques) {
    sized(torques);
    check(ecat_axes_push(axes_, all, torques.data()));
  }

  // Positions that the program sends again and again, see ecat_axes_follow().
  void follow(const std::vector<double>& positions, Seconds interval = Seconds(0)) {
    sized(positions);
    check(ecat_axes_follow(axes_, all, positions.data(), interval.count()));
  }

  // The last cycle of an axis.
  ecat_axis_state state(int axis) const {
    ecat_axis_state state;
    if (ecat_axes_state(axes_, axis, &state) < 0) throw Error(ECAT_EARG, "there is no such axis");
    return state;
  }
  double position(int axis) const { return state(axis).view.position; }
  std::string explain(int axis) const {
    char text[ECAT_DRIVE_TEXT];
    return ecat_axes_explain(axes_, axis, text);
  }
  // Waits for the next cycle.
  void wait(Seconds timeout = Seconds(1)) { check(ecat_axes_wait(axes_, timeout.count())); }

 private:
  static constexpr unsigned all = ECAT_AXES_ALL;

  [[noreturn]] void fail(int code) {
    const std::string text = ecat_axes_error(axes_);
    throw Error(code, text);
  }
  void check(int code) {
    if (code < 0) fail(code);
  }
  ecat_axis& found(int axis) const {
    ecat_axis* pointer = ecat_axes_axis(axes_, axis);
    if (pointer == nullptr) throw Error(ECAT_EARG, "there is no such axis");
    return *pointer;
  }
  void sized(const std::vector<double>& values) const {
    if (ecat_axes_axis(axes_, static_cast<int>(values.size()) - 1) == nullptr ||
        ecat_axes_axis(axes_, static_cast<int>(values.size())) != nullptr)
      throw Error(ECAT_EARG, "there must be one number for each axis");
  }

  ecat_axes* axes_ = nullptr;
};

}  // namespace ecat

#endif
