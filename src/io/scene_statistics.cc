#include "scene_statistics.h"

#include <algorithm>
#include <cmath>

namespace nerf::internal {

double quantile(std::vector<double> values, double fraction) {
  if (values.empty()) return 0;
  const auto at =
      values.begin() +
      static_cast<std::ptrdiff_t>(std::lround(fraction * static_cast<double>(values.size() - 1)));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

Vec3d median_position(const std::vector<Vec3d>& positions) {
  Vec3d median;
  for (int k = 0; k < 3; ++k) {
    std::vector<double> values;
    values.reserve(positions.size());
    for (const Vec3d& p : positions) values.push_back(p[k]);
    median[k] = quantile(std::move(values), 0.5);
  }
  return median;
}

std::vector<char> in_the_crowd(const std::vector<double>& values, double factor) {
  constexpr double kCrowd = 0.8;
  const double limit = factor * quantile(values, kCrowd);
  std::vector<char> in(values.size(), 1);
  for (size_t i = 0; limit > 0 && i < values.size(); ++i) in[i] = values[i] <= limit;
  return in;
}

std::pair<double, double> near_far_of(const std::vector<double>& distances) {
  constexpr double kFarthest = 4;  // a ray through the whole inner box, 2 sqrt(3), ends before far
  const double middle = quantile(distances, 0.5);
  return {std::clamp(0.5 * quantile(distances, 0.001), 1e-3 * middle, 0.5 * middle),
          std::max(kFarthest, 2 * quantile(distances, 0.999))};
}

void set_near_far(const std::vector<double>& distances, Scene& scene) {
  const auto [near, far] = near_far_of(distances);
  if (!scene.options.far) scene.far = scene.options.near ? std::max(far, 2 * scene.near) : far;
  if (!scene.options.near) scene.near = std::min(near, 0.5 * scene.far);
}

std::vector<char> supported_points(const std::vector<ScenePoint>& points) {
  constexpr size_t kEnough = 50;
  if (std::all_of(points.begin(), points.end(), [](const ScenePoint& p) { return p.views == 0; })) {
    return std::vector<char>(points.size(), 1);
  }
  std::vector<double> errors;
  errors.reserve(points.size());
  for (const ScenePoint& p : points) errors.push_back(p.error);
  const double limit = std::max(1.0, 2 * quantile(std::move(errors), 0.75));
  const auto seen_by = [&](int views) {
    std::vector<char> good(points.size());
    for (size_t i = 0; i < points.size(); ++i) {
      good[i] = points[i].views >= views && points[i].error <= limit;
    }
    return good;
  };
  std::vector<char> good = seen_by(3);
  if (std::count(good.begin(), good.end(), 1) < static_cast<std::ptrdiff_t>(kEnough)) {
    good = seen_by(2);
  }
  return good;
}

}  // namespace nerf::internal
