#include "train/camera_fit.h"

#include <algorithm>
#include <cmath>
#include <span>
#include <vector>

#include "nerf/math/random.h"
#include "nerf/math/refined_camera.h"
#include "nerf/model/integrator.h"
#include "train/least_squares.h"

namespace nerf {

namespace {

constexpr int kPixels = 1500;
// Of the differences, in pixels: a wide one sees past the texture that a far-off pose is lost in.
constexpr double kSpans[] = {8, 3, 1};
constexpr int kIterations = 6;  // of each

struct FittedPixel {
  Vec3d direction;  // camera axes, unit
  double share;     // line_share()
  Real rgb[3];      // over the background
};

// One in each cell of a lattice, so that they cover the photo evenly.
std::vector<FittedPixel> pixels_of(const Photo& photo, const Camera& camera,
                                   const Vec3& background) {
  const double side = std::sqrt(static_cast<double>(photo.width) * photo.height / kPixels);
  const int columns = std::max(1, static_cast<int>(photo.width / side));
  const int rows = std::max(1, static_cast<int>(photo.height / side));
  std::vector<FittedPixel> out;
  for (int i = 0; i < columns * rows; ++i) {
    Random random(0, 0, static_cast<uint64_t>(i));
    const auto within = [&](int cell, int cells, int size) {
      const double at = (cell + static_cast<double>(random.uniform())) / cells * size;
      return std::min(static_cast<int>(at), size - 1);
    };
    const int x = within(i % columns, columns, photo.width);
    const int y = within(i / columns, rows, photo.height);
    if (photo.masked_out(x, y)) continue;
    const Vec2d at{x + 0.5, y + 0.5};
    const auto direction = unproject(camera, at);
    if (!direction) continue;
    FittedPixel pixel{normalized(*direction), line_share(camera, at), {}};
    Real rgba[4];
    photo.pixel(x, y, rgba);
    for (int k = 0; k < 3; ++k) pixel.rgb[k] = rgba[k] * rgba[3] + background[k] * (1 - rgba[3]);
    out.push_back(pixel);
  }
  return out;
}

double median_of(std::vector<Real> values) {
  std::erase_if(values, [](Real v) { return !(v > 0); });
  if (values.empty()) return 1;
  const auto middle = values.begin() + static_cast<ptrdiff_t>(values.size() / 2);
  std::ranges::nth_element(values, middle);
  return static_cast<double>(*middle);
}

}  // namespace

CameraFit fit_camera(const RadianceField& field, const Camera& camera, const Pose& pose,
                     const Photo& photo, const RenderOptions& options, ThreadPool& pool,
                     const Cancel* cancel) {
  const Pose given = field.info().to_engine.apply(pose);
  CameraFit fit{pose};
  const std::vector<FittedPixel> pixels = pixels_of(photo, camera, options.background);
  const Camera own = camera.in_unit(field.info().to_engine.scale);
  const bool one_centre = !is_panorama(camera) || camera.params[4] == 0;
  if (pixels.empty() || !one_centre) return fit;
  const Real radius =
      static_cast<Real>(pixel_cone_radius(camera, {0.5 * camera.width, 0.5 * camera.height}));
  const auto correction = [](std::span<const double> x) {
    return PoseCorrection{{x[0], x[1], x[2]}, {x[3], x[4], x[5]}};
  };
  double distance = 0;  // to what the photo shows, engine units
  std::vector<Ray> rays(pixels.size());
  const auto residuals = [&](std::span<const double> x, std::vector<double>& out) {
    const Pose at = corrected(given, correction(x));
    for (size_t i = 0; i < pixels.size(); ++i) {
      Ray& ray = rays[i];
      const Pose of_line = line_pose(own, at, pixels[i].share);
      ray.origin = of_line.translation;
      ray.direction = of_line.rotation * pixels[i].direction;
      ray.near = field.info().near;
      ray.radius = radius;
      ray.time = options.time;
      ray.background = options.background;
    }
    const RayResults seen = integrate(field, rays, {}, options, pool, {}, cancel);
    if (distance == 0) distance = median_of(seen.median);
    out.resize(3 * pixels.size());
    for (size_t i = 0; i < out.size(); ++i)
      out[i] = static_cast<double>(seen.rgb[i] - pixels[i / 3].rgb[i % 3]);
  };
  std::vector<double> x(PoseCorrection::kParameters), first;
  residuals(x, first);
  for (const double e : first) fit.before += e * e / static_cast<double>(first.size());
  fit.after = fit.before;
  LeastSquaresOptions solver;
  solver.most_iterations = kIterations;
  solver.tolerance = 1e-3;
  const double pixel = 1 / camera.fx();
  for (const double span : kSpans) {
    std::vector<double> steps(x.size(), span * pixel);
    for (size_t i = 3; i < steps.size(); ++i) steps[i] *= distance;
    const LeastSquaresResult result = minimise_squares(residuals, steps, x, solver);
    fit.after = result.after / static_cast<double>(first.size());
  }
  if (fit.after < fit.before)
    fit.pose = field.info().to_engine.apply_inverse(corrected(given, correction(x)));
  return fit;
}

}  // namespace nerf
