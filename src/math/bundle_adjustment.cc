#include "math/bundle_adjustment.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "math/bundle_equations.h"
#include "nerf/base/error.h"
#include "nerf/math/camera_paths.h"

namespace nerf {
namespace {

constexpr double kFirstScale = 3;                     // of the median error
constexpr double kNextScale = 0.25;                   // of the scale before
constexpr int kMostIterations = 30, kMostCoarse = 8;  // with the last scale, with each before
constexpr double kTolerance = 1e-4;                   // of the cost; while the scale falls kCoarse
constexpr double kCoarse = 1e-2;
constexpr double kFirstDamping = 1e-4, kLeastDamping = 1e-10, kMostDamping = 1e6;

double median_error(const Bundle& bundle) { return quantile(reprojection_errors(bundle), 0.5); }

// Goes down with one scale of the loss; returns the linear systems that were solved.
int descend(internal::BundleEquations& equations, double scale, Bundle& bundle,
            const Cancel* cancel) {
  double damping = kFirstDamping, cost = equations.cost(bundle, scale);
  equations.linearise(bundle, scale);
  Bundle moved;
  int iterations = 0;
  const bool last = scale == kLossScale;
  const double tolerance = last ? kTolerance : kCoarse;
  while (iterations < (last ? kMostIterations : kMostCoarse) && damping <= kMostDamping) {
    if (cancel && cancel->requested()) throw Cancelled();
    ++iterations;
    const double now = equations.solve(bundle, damping, moved)
                           ? equations.cost(moved, scale)
                           : std::numeric_limits<double>::infinity();
    if (!(now < cost)) {
      damping *= 10;
      continue;
    }
    const bool done = cost - now <= tolerance * cost;
    std::swap(bundle.cameras, moved.cameras);
    std::swap(bundle.images, moved.images);
    std::swap(bundle.points, moved.points);
    cost = now;
    if (done) break;
    damping = std::max(damping / 10, kLeastDamping);
    equations.linearise(bundle, scale);
  }
  return iterations;
}

}  // namespace

std::vector<double> reprojection_errors(const Bundle& bundle) {
  std::vector<double> errors;
  errors.reserve(bundle.keypoints.size());
  for (const Keypoint& k : bundle.keypoints) {
    const Bundle::Image& image = bundle.images[static_cast<size_t>(k.image)];
    const Vec3d apart = bundle.points[static_cast<size_t>(k.point)] - image.pose.translation;
    const Camera& camera = bundle.cameras[static_cast<size_t>(image.camera)];
    const std::optional<Vec2d> seen = project(camera, image.pose.rotation.transposed() * apart);
    errors.push_back(std::sqrt(internal::squared_error(camera, seen, k.pixel)));
  }
  return errors;
}

double reprojection_loss(const Bundle& bundle) {
  double sum = 0;
  for (const double error : reprojection_errors(bundle))
    sum += internal::cauchy_loss(error * error, kLossScale);
  return sum;
}

int64_t adjustment_unknowns(const Bundle& bundle) {
  int64_t unknowns = 6 * static_cast<int64_t>(bundle.images.size());
  for (const Camera& camera : bundle.cameras)
    unknowns += static_cast<int64_t>(internal::free_parameters(camera).size());
  return unknowns;
}

uint64_t adjustment_bytes(const Bundle& bundle) {
  const auto unknowns = static_cast<uint64_t>(adjustment_unknowns(bundle));
  return internal::BundleEquations::bytes(bundle.keypoints.size(), bundle.points.size(), unknowns);
}

AdjustmentResult adjust_bundle(Bundle& bundle, ThreadPool& pool, const Cancel* cancel) {
  NERF_CHECK(!bundle.keypoints.empty());
  NERF_CHECK(adjustment_unknowns(bundle) <= kMostUnknowns);
  AdjustmentResult result;
  result.before = median_error(bundle);
  internal::BundleEquations equations(bundle, pool);
  double scale = std::max(kLossScale, kFirstScale * result.before);
  for (; scale > kLossScale; scale = std::max(kLossScale, scale * kNextScale))
    result.iterations += descend(equations, scale, bundle, cancel);
  result.iterations += descend(equations, scale, bundle, cancel);
  result.after = median_error(bundle);
  return result;
}

}  // namespace nerf
