// Which photos were taken through one lens.
#pragma once

#include <string>
#include <vector>

#include "nerf/io/scene.h"

namespace nerf {

struct Lenses {
  std::vector<std::string> names;  // for a person, each different
  std::vector<int> of_view;        // of each of Scene::views, an index into them; below 0: no lens
};

// Photos whose EXIF names one camera, lens and focal length; of those that name none, photos of one
// size whose cameras' focal lengths have no gap of a tenth (where each photo has a camera of its
// own, they scatter). Panoramas are put together from many.
Lenses lenses_of(const Scene& scene);

}  // namespace nerf
