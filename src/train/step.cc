// A step of training, phase by phase.
#include <algorithm>
#include <cmath>
#include <string>

#include "train/lap.h"
#include "train/trainer_impl.h"

namespace nerf {

StepReport TrainerImpl::step() {
  Lap lap;
  const TrainProfile before = profile;
  StepReport report;
  draw();
  lap.into(profile.rays);
  look_up();
  lap.into(profile.encode);
  const HeadSums sums = head(report);
  lap.into(profile.network);
  // Infinite or not a number: stopped before it reaches the weights.
  if (!std::isfinite(report.loss + sums.squared_error))
    throw NonFiniteError("the loss of step " + std::to_string(done + 1) + " is not finite");
  report.opacity = sums.opacity / static_cast<double>(std::max<int64_t>(report.rays, 1));
  report.psnr = -10 * std::log10(std::max(sums.squared_error, 1e-10));
  report.rate = static_cast<double>(rate_at(done));
  dense->reduce(done + 1, pool);
  dense->update(dense_step(), done + 1, options.precision, pool);
  lap.into(profile.update);
  scatter(report);
  lap.into(profile.scatter);
  observe(report, {profile.network - before.network, profile.scatter - before.scatter});
  report.step = ++done;
  refresh();
  lap.into(profile.occupancy);
  return report;
}

}  // namespace nerf
