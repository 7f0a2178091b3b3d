// A clock for the parts of a step.
#pragma once

#include <chrono>

namespace nerf {

inline double seconds_now() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

// Adds the time since the last call to a counter.
class Lap {
 public:
  void into(double& counter) {
    const double now = seconds_now();
    counter += now - last_;
    last_ = now;
  }

 private:
  double last_ = seconds_now();
};

}  // namespace nerf
