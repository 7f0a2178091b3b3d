#include "io/cameras/stage_progress.h"

#include <fmt/format.h>

#include <cmath>

#include "nerf/base/progress.h"

namespace nerf::internal {

namespace {

constexpr double kSecondsBetween = 5;
constexpr double kSecondsToGoBy = 3;  // before the speed is known well enough

}  // namespace

StageProgress::StageProgress(const Tell& tell, std::string what, std::string unit, int64_t total,
                             int64_t done, double power)
    : tell_(tell),
      what_(std::move(what)),
      unit_(std::move(unit)),
      total_(total),
      begin_(done),
      power_(power) {}

void StageProgress::update(int64_t done) {
  if (!tell_ || done == told_) return;
  const Clock::time_point now = Clock::now();
  const auto seconds = [&](Clock::time_point since) {
    return std::chrono::duration<double>(now - since).count();
  };
  if (told_ >= 0 && done < total_ && seconds(last_) < kSecondsBetween) return;
  told_ = done;
  last_ = now;
  const auto work = [&](int64_t n) { return std::pow(static_cast<double>(n), power_); };
  std::string left;
  if (seconds(start_) > kSecondsToGoBy && done > begin_ && done < total_) {
    const double rate = (work(done) - work(begin_)) / seconds(start_);
    left = ", " + format_duration((work(total_) - work(done)) / rate) + " left";
  }
  tell_(fmt::format("{} {} of {} {}{}", what_, done, total_, unit_, left));
}

}  // namespace nerf::internal
