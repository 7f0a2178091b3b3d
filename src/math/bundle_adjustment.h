// Bundle adjustment: cameras, their places and points in space such that the points are seen where
// keypoints say (Triggs, McLauchlan, Hartley and Fitzgibbon 2000).
#pragma once

#include <cstdint>
#include <vector>

#include "nerf/base/cancel.h"
#include "nerf/base/threads.h"
#include "nerf/math/camera.h"
#include "nerf/math/vec.h"

namespace nerf {

// A point of the world seen at a place of an image.
struct Keypoint {
  int32_t image = 0, point = 0;  // indices into Bundle's
  Vec2d pixel;
};

struct Bundle {
  struct Image {
    int camera = 0;  // index into cameras
    Pose pose;       // camera-to-world, OpenCV axes
  };
  std::vector<Camera> cameras;
  std::vector<Image> images;
  std::vector<Vec3d> points;        // world
  std::vector<Keypoint> keypoints;  // any order
};

// Distance of each keypoint from where its point is projected to, pixels; the picture's diagonal
// where the camera does not see the point.
std::vector<double> reprojection_errors(const Bundle& bundle);

// Sum of Cauchy's losses of the keypoints, with kLossScale, squared pixels.
double reprojection_loss(const Bundle& bundle);

struct AdjustmentResult {
  double before = 0, after = 0;  // median of the reprojection errors, pixels
  int iterations = 0;            // linear systems that were solved
};

// Scale of Cauchy's loss at last, pixels; COLMAP drops what is 4 off.
inline constexpr double kLossScale = 2;

// Most unknowns of images and lenses together: their matrix is dense, 8 bytes for each pair.
inline constexpr int64_t kMostUnknowns = 8000;

// Unknowns of images and lenses that an adjustment would have, and the memory that it would take.
int64_t adjustment_unknowns(const Bundle& bundle);
uint64_t adjustment_bytes(const Bundle& bundle);

// Levenberg-Marquardt on the Schur complement of the points, with Cauchy's loss, whose scale falls
// from three times the median error to kLossScale. Adjusted are poses, points, focal lengths and
// distortion, but not principal points, with weak priors towards what was given: they decide of
// what keypoints say nothing of, such as the place of the whole. Panoramas keep their lens, points
// without two keypoints their place. The result is the same for any number of threads. Needs at
// most kMostUnknowns. Throws Cancelled.
AdjustmentResult adjust_bundle(Bundle& bundle, ThreadPool& pool, const Cancel* cancel = nullptr);

}  // namespace nerf
