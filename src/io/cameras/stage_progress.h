// Lines of progress of one stage, with the time left.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <string>

namespace nerf::internal {

using Tell = std::function<void(const std::string&)>;

class StageProgress {
 public:
  // "WHAT DONE of TOTAL UNIT". `done` were finished by an earlier run. Where later ones take
  // longer, `power` says how the time grows with their number: 1 for all alike.
  StageProgress(const Tell& tell, std::string what, std::string unit, int64_t total,
                int64_t done = 0, double power = 1);

  // Tells at the beginning, at the end and every few seconds in between.
  void update(int64_t done);

 private:
  using Clock = std::chrono::steady_clock;

  const Tell& tell_;
  std::string what_, unit_;
  int64_t total_, begin_;
  double power_;
  int64_t told_ = -1;
  Clock::time_point start_ = Clock::now(), last_{};
};

}  // namespace nerf::internal
