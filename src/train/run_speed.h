// How fast a training runs: lately, for people, and what is to be expected of its later steps.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <deque>
#include <vector>

#include "nerf/train/trainer.h"

namespace nerf::internal {

class SpeedMeter {
 public:
  void add(double seconds, const StepReport& report) {
    const double mse = std::pow(10.0, -report.psnr / 10);
    recent_.push_back(
        {seconds, static_cast<double>(report.samples), static_cast<double>(report.rays), mse});
    total_ = total_ + recent_.back();
    while (total_.seconds > kWindowSeconds && recent_.size() > kWindowSteps) {
      total_ = total_ - recent_.front();
      recent_.pop_front();
    }
    ++steps_;
    if (all_.size() < kMostRemembered) all_.push_back(static_cast<float>(seconds));
  }

  int64_t steps() const { return steps_; }
  double step_seconds() const { return total_.seconds / static_cast<double>(recent_.size()); }
  double samples_per_second() const { return total_.samples / total_.seconds; }
  double rays_per_second() const { return total_.rays / total_.seconds; }
  double psnr() const {
    return -10 * std::log10(std::max(total_.mse / static_cast<double>(recent_.size()), 1e-10));
  }

  // Mean of the later half of all steps so far: the first ones see an occupancy that is not cleared
  // yet, and cold caches. The few longest are left out: they refreshed the whole occupancy, which
  // later ones do not.
  double step_seconds_ahead() const {
    std::vector<float> half(all_.begin() + static_cast<std::ptrdiff_t>(all_.size() / 2),
                            all_.end());
    std::sort(half.begin(), half.end());
    const size_t longest = half.size() / 32;
    half.resize(half.size() - (half.size() > 8 ? std::max<size_t>(longest, 1) : 0));
    double sum = 0;
    for (const float s : half) sum += static_cast<double>(s);
    return sum / static_cast<double>(half.size());
  }

 private:
  static constexpr double kWindowSeconds = 1;
  static constexpr size_t kWindowSteps = 20;  // at least
  static constexpr size_t kMostRemembered = size_t{1} << 20;

  struct Sum {
    double seconds = 0, samples = 0, rays = 0, mse = 0;
    Sum operator+(const Sum& b) const {
      return {seconds + b.seconds, samples + b.samples, rays + b.rays, mse + b.mse};
    }
    Sum operator-(const Sum& b) const {
      return {seconds - b.seconds, samples - b.samples, rays - b.rays, mse - b.mse};
    }
  };
  std::deque<Sum> recent_;
  Sum total_;
  std::vector<float> all_;
  int64_t steps_ = 0;
};

}  // namespace nerf::internal
