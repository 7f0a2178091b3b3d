#include "photo_needs.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <string>
#include <vector>

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
      (light.appearance.automatic || light.robust.automatic) && !resumes &&
      (command.minutes.value_or(0) >= kFewestMinutes || command.train.steps >= kFewestSteps);
  const bool finds_passing = light.robust.automatic;
  Progress clock("looking at the light");
  LightProbe probe;
  if (is_long)
    probe = probe_light(scene, photos, pool, &cancel);
  else if (light.colour_correction == Switch::kOn && light.exif_exposure.automatic)
    probe.shown = shown_light(scene, photos);
  resolve_light(probe, command.train);
  const bool has_exif = light.colour_correction == Switch::kOn && light.exif_exposure.number > 0;
  if (!probe.smooth_share && !probe.exposure_spread && !has_exif) return;
  std::string seen;
  if (probe.exposure_spread)
    seen = fmt::format("{:.2f} stops between photos", *probe.exposure_spread);
  if (const auto smooth = probe.smooth_by_light())
    seen += fmt::format("{}{:.0f} % of a short training's error is even across small areas",
                        seen.empty() ? "" : ", ", 100 * *smooth);
  if (has_exif)
    seen += fmt::format("{}{:.2f} stops for each of EXIF's", seen.empty() ? "" : ", ",
                        light.exif_exposure.number);
  std::vector<std::string> learnt;
  if (light.appearance.count > 0)
    learnt.push_back(fmt::format("{} numbers a photo", light.appearance.count));
  if (light.colour_correction == Switch::kOn)
    learnt.push_back(has_exif ? "exposure and white balance, beginning with EXIF's exposure"
                              : "exposure and white balance");
  if (light.vignetting == Switch::kOn) learnt.push_back("vignetting");
  if (light.sky == Switch::kOn) learnt.push_back("a sky");
  if (command.train.pixel_recipe.point_depth.value_or(0) > 0)
    learnt.push_back("distances of sparse points");
  log_info(fmt::format("light         {}{} ({}; {:.1f} s)", learnt.empty() ? "fixed" : "differs: ",
                       fmt::join(learnt, ", "), seen, clock.elapsed_seconds()));
  if (finds_passing && probe.passes())
    log_info(
        fmt::format("passing by    {:.0f} % of the pixels show what other photos do not: the "
                    "worst {:.0f} % teach nothing (--robust off: all teach)",
                    100 * *probe.passing_share, 100 * light.robust.number));
}

void look_at_motion(TrainCommand& command, const Scene& scene) {
  MotionRecipe& motion = command.train.grid_recipe.motion;
  if (!reads_option(command.train.method, "deform")) return;
  resolve_motion(scene, motion);
  if (motion.deform != Deform::kNone)
    log_info(fmt::format(
        "motion        {}, of {} moments{}", motion.deform == Deform::kSe3 ? "se3" : "translation",
        count_moments(scene),
        offset_weight(motion, scene) > 0 ? ", matter held in place where it need not move" : ""));
}

}  // namespace nerf::apps
