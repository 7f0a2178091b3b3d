#include "photo_needs.h"

#include <fmt/format.h>

#include "app.h"
#include "nerf/base/progress.h"
#include "nerf/train/light_probe.h"
#include "nerf/train/methods.h"

namespace nerf::apps {

void look_at_light(TrainCommand& command, bool resumes, const Scene& scene, const PhotoSet& photos,
                   ThreadPool& pool, const Cancel& cancel) {
  constexpr double kFewestMinutes = 1;  // of a training that a few seconds do not matter to
  constexpr int64_t kFewestSteps = 1000;
  LightRecipe& light = command.train.grid_recipe.light;
  if (!reads_option(command.train.method, "appearance")) return;
  const bool is_long =
      light.appearance.automatic && !resumes &&
      (command.minutes.value_or(0) >= kFewestMinutes || command.train.steps >= kFewestSteps);
  Progress clock("looking at the light");
  const LightProbe probe = is_long ? probe_light(scene, photos, pool, &cancel) : LightProbe();
  resolve_light(probe, command.train);
  if (!probe.smooth_share && !probe.exposure_spread) return;
  std::string seen;
  if (probe.exposure_spread)
    seen = fmt::format("{:.2f} stops between photos", *probe.exposure_spread);
  if (probe.smooth_share)
    seen += fmt::format("{}{:.0f} % of a short training's error is even across small areas",
                        seen.empty() ? "" : ", ", 100 * *probe.smooth_share);
  std::string found = "fixed";
  if (light.appearance.count > 0)
    found = fmt::format("differs: {} numbers a photo", light.appearance.count);
  if (light.colour_correction == Switch::kOn) found += ", exposure and white balance";
  if (command.train.grid_recipe.point_depth.value_or(0) > 0)
    found += ", distances of sparse points";
  log_info(fmt::format("light         {} ({}; {:.1f} s)", found, seen, clock.elapsed_seconds()));
}

void look_at_motion(TrainCommand& command, const Scene& scene) {
  MotionRecipe& motion = command.train.grid_recipe.motion;
  if (!reads_option(command.train.method, "deform")) return;
  resolve_motion(scene, motion);
  if (motion.deform != Deform::kNone)
    log_info(fmt::format("motion        {}, of {} moments",
                         motion.deform == Deform::kSe3 ? "se3" : "translation",
                         count_moments(scene)));
}

}  // namespace nerf::apps
