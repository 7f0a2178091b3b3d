// Perspective views out of a panorama for programs that know only those, and the panorama's pose
// from theirs.
#pragma once

#include <filesystem>
#include <optional>
#include <span>

#include "nerf/base/threads.h"
#include "nerf/io/image.h"
#include "nerf/math/camera.h"

namespace nerf::internal {

// Six cuts look to the horizon all around, each overlapping the next by a third, one down and one
// up. Those two are wide: what lies on a floor looks alike in all cuts that look down on it, while
// to the horizon's it is foreshortened, in every one differently, and matches only the next.
inline constexpr int kLevelCuts = 6, kCutsPerPanorama = 8;

// From the axes of cut k to those of the panorama.
Mat3d cut_rotation(int k);

// mm of a film 35 mm wide, a whole number as EXIF wants it, by which colmap knows the lens.
int cut_film_focal(int k);

// A square pinhole camera whose middle is as sharp as the panorama's horizon, or sharper where it
// would have too few pixels for features. cut_film_focal() / 35 of the side is its focal length.
Camera cut_camera(int panorama_width, int k);

// The cut's picture, by Catmull and Rom's cubic interpolation; the seam is none.
Image8 cut_panorama(const Image8& panorama, int k, ThreadPool& pool);

// JPEG with cut k's focal length in its EXIF. Throws Error.
void write_cut(const std::filesystem::path& path, int k, const Image8& cut);

struct PlacedCut {
  int cut;
  Pose pose;       // cut-to-world
  int points = 0;  // that the model says it sees
};

// The panorama-to-world pose that most of the cuts agree on to two degrees: the mean of their
// rotations and the median of their centres. Of a single cut, its own where it sees many points. No
// value where no more than half agree.
std::optional<Pose> pose_from_cuts(std::span<const PlacedCut> cuts);

}  // namespace nerf::internal
