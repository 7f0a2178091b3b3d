// A step of training, phase by phase.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "nerf/base/error.h"
#include "train/lap.h"
#include "train/trainer_impl.h"

namespace nerf {

StepReport TrainerImpl::step() {
  NERF_CHECK(!open);
  Lap lap;
  draw();
  lap.into(profile.rays);
  look_up();
  lap.into(profile.encode);
  return complete();
}

const RayPixels& TrainerImpl::begin_step(std::span<const Ray> rays) {
  NERF_CHECK(!open);
  check_open();
  if (static_cast<int64_t>(rays.size()) > most_rays())
    throw Error(fmt::format("a step takes at most {} given rays, not {}", most_rays(), rays.size()),
                "Trainer::begin_step", "give fewer, or raise --batch-samples");
  Lap lap;
  pixels = RayPixels();
  pixels.rays.assign(rays.begin(), rays.end());
  given = pixels.rays;
  open = true;
  draw();
  lap.into(profile.rays);
  look_up();
  lap.into(profile.encode);
  render();
  lap.into(profile.network);
  return pixels;
}

StepReport TrainerImpl::finish_step(std::span<const Real> gradient, double loss) {
  NERF_CHECK(open);
  NERF_CHECK_EQ(gradient.size(), pixels.rgba.size());
  pixel_gradient = gradient;
  // Closed even where the loss or a gradient is no number: the trainer goes back from there.
  struct Close {
    TrainerImpl& trainer;
    ~Close() {
      trainer.pixel_gradient = {};
      trainer.given = {};
      trainer.open = false;
    }
  } close{*this};
  StepReport report = complete();
  report.loss += loss;
  return report;
}

StepReport TrainerImpl::complete() {
  Lap lap;
  const TrainProfile before = profile;
  StepReport report;
  const HeadSums sums = head(report);
  trace_positions();
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
