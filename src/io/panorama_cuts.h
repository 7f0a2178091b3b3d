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

// Cuts look to the horizon all around, each overlapping the next by a third.
inline constexpr int kCutsPerPanorama = 6;

// From the axes of cut k to those of the panorama.
Mat3d cut_rotation(int k);

// A square pinhole camera whose middle is as sharp as the panorama's horizon. 17/35 of the side is
// its focal length: 17 mm in the terms of a 35 mm film, a whole number as EXIF wants it, by which
// colmap starts.
Camera cut_camera(int panorama_width);

// The cut's picture, by bilinear interpolation; the seam is none.
Image8 cut_panorama(const Image8& panorama, int k, ThreadPool& pool);

// JPEG with that focal length in its EXIF. Throws Error.
void write_cut(const std::filesystem::path& path, const Image8& cut);

struct PlacedCut {
  int cut;
  Pose pose;  // cut-to-world
};

// The panorama-to-world pose that most of the cuts agree on to two degrees: the mean of their
// rotations and the median of their centres. No value where no more than half agree.
std::optional<Pose> pose_from_cuts(std::span<const PlacedCut> cuts);

}  // namespace nerf::internal
