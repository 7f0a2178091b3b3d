// What of a scene training depends on, as a few numbers that tell two scenes apart.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "nerf/io/photos.h"
#include "nerf/io/scene.h"

namespace nerf::internal {

// Aspects of the scene (named for people: "names of the images", "poses", ...) and a hash of each,
// in a fixed order. Pixels are not looked at, but near and far are, which a plane sweep may have
// found in them.
using SceneFingerprint = std::vector<std::pair<std::string, std::string>>;

// clock: whether training depends on View::clock.
SceneFingerprint scene_fingerprint(const Scene& scene, const PhotoSet& photos, bool clock = false);

}  // namespace nerf::internal
