// Sparse points as photos see them: pixels whose distance is known.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "nerf/io/photos.h"
#include "nerf/io/scene.h"

namespace nerf {

struct Sighting {
  size_t source;    // the i-th training photo
  int32_t point;    // index into Scene::points
  int x, y;         // pixel
  double distance;  // from the camera, engine units
};

// Of the points that three photos or more agree on, in the training photos that are said to see
// them, where the photo shows that place and no mask hides it (Deng et al. 2022, section 3.2).
std::vector<Sighting> sightings_of(const Scene& scene, const PhotoSet& photos);

}  // namespace nerf
