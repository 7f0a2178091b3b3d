// Where a photo may show the sky, by the sparse points that it shows.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "nerf/io/photos.h"
#include "nerf/io/scene.h"
#include "train/sample_range.h"

namespace nerf {

// Of each training photo the highest sparse points that it shows, in every direction around its
// camera, and how far its points go. Points of two photos or more count.
class Skylines {
 public:
  explicit Skylines(const Scene& scene);

  // Distances, in engine units, between which a ray of the i-th training photo may meet matter;
  // what is elsewhere on it is sky, or air. `direction`: unit, engine coordinates.
  // - From a tenth nearer than the photo's points to a quarter farther, but for 2 % at either end
  //   that may be wrong.
  // - Nowhere (none) above the skyline: above the horizon and the points within a few degrees to
  //   the left and right, but for one.
  // - Without an end below the horizon, where bare ground has no points either.
  // - Anywhere where the photo shows too few points to tell.
  std::optional<SampleRange> matter(size_t photo, const Vec3d& direction) const;
  // Whether the photo shows points enough to tell.
  bool is_known(size_t photo) const { return lines_[line_of_[photo]].points >= kEnoughPoints; }

 private:
  static constexpr int kEnoughPoints = 20;
  struct Line {
    int points = 0;
    SampleRange reach = {};      // between which they lie
    std::vector<double> height;  // sine of the elevation, in equal bins all around
    size_t bin_of(const Vec3d& direction) const;
  };
  std::vector<Line> lines_;      // of photos of different files
  std::vector<size_t> line_of_;  // of the i-th training photo
};

// What share of the training photos is above their skylines and not masked out, in the mean of
// those that show points enough; none where no photo does.
std::optional<double> share_above_points(const Scene& scene, const PhotoSet& photos);

}  // namespace nerf
