// The moments of a capture's training photos, and what the networks of a scene that moves learn of
// each.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "nerf/io/scene.h"
#include "nerf/model/network_field.h"
#include "nerf/train/network_recipe.h"
#include "train/ray_batch.h"

namespace nerf {

struct CaptureMoments {
  explicit CaptureMoments(const Scene& scene);

  std::vector<double> times;    // ascending
  std::vector<int> of_photo;    // of the i-th training photo: its moment
  std::vector<size_t> by_time;  // training photos, the first moment's first
  std::vector<int> cameras;     // as the capture numbers those of the training photos
  std::vector<int> camera_of;   // of the i-th training photo, an index into these
  // The moment that is nearest to a time.
  int nearest(double time) const;
};

// The options as far as the capture has what they are about; draws_masked: of the pixels that masks
// leave out some are drawn, as transparent ones. Throws Error where a method of scenes that move is
// asked of photos of one moment.
NetworkOptions options_for(const NetworkOptions& options, const std::string& method,
                           const Scene& scene, bool draws_masked, const CaptureMoments& moments);

// What a field of these options keeps of each photo, moment and camera.
CodeShape codes_for(const NetworkOptions& options, const CaptureMoments& moments,
                    const PixelSource& source);

// Of `step`: how many of the training photos are drawn from, the first ones by time (D-NeRF).
size_t photos_in_time(const NetworkRecipe& recipe, int64_t step, size_t photos);
// How many frequencies are open at a step.
DeformWindows windows_at(const NetworkOptions& options, const NetworkRecipe& recipe, int64_t step);
// The elastic loss's weight at a step.
Real elastic_at(const NetworkRecipe& recipe, int64_t step);

}  // namespace nerf
