// Looks at photos, before a training, for light that differs between them and for what passed by.
#pragma once

#include <optional>

#include "nerf/base/cancel.h"
#include "nerf/base/threads.h"
#include "nerf/io/photos.h"
#include "nerf/io/scene.h"
#include "nerf/train/shown_light.h"
#include "nerf/train/trainer.h"

namespace nerf {

struct LightProbe {
  // How bright photos show the same sparse points: standard deviation of ShownLight::exposure;
  // no value where there are too few points.
  std::optional<double> exposure_spread = {};
  // Of a short training on reduced photos: what share of its squared error is one colour across a
  // tile of a photo, which a sharper field would not mend; no value where none was made.
  std::optional<double> smooth_share = {};
  // The same of the tiles where nothing was left out.
  std::optional<double> smooth_elsewhere = {};
  // The one of the two that tells of light: where something passes by, its errors are even too.
  std::optional<double> smooth_by_light() const {
    return passes() ? smooth_elsewhere : smooth_share;
  }
  // What share of the photos' pixels the short training left out, since they look different from
  // what the other photos show there (LightRecipe::robust).
  std::optional<double> passing_share = {};
  // Whether that is more than light and what is hard to learn account for.
  bool passes() const;
  ShownLight shown = {};
  // What share of the photos lies above the horizon and above all sparse points that they show, of
  // a scene that may have a sky: an unbounded one, not an object cut out.
  double above_points = 0;
};

// A few seconds. The short training is made of an unbounded scene with `train` photos enough, and
// none where photos have times, whose content differs. The same for any number of threads. Throws
// Cancelled.
LightProbe probe_light(const Scene& scene, const PhotoSet& photos, ThreadPool& pool,
                       const Cancel* cancel = nullptr);

// Gives the options that are to be found automatically a value, by the probe.
void resolve_light(const LightProbe& probe, TrainOptions& options);

}  // namespace nerf
