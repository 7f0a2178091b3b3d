#include "sweep_image.h"

#include <algorithm>
#include <cmath>

namespace nerf::internal {

namespace {

// Tangent of the angle from the axis to a point of the picture's border, at most that of 50
// degrees.
double tangent_at(const Camera& camera, const Vec2d& pixel) {
  constexpr double kMost = 1.19;
  const auto d = unproject(camera, pixel);
  if (!d || d->z <= 0) return kMost;
  return std::min(kMost, std::hypot(d->x, d->y) / d->z);
}

// Mean of a square of the photo's pixels; below 0 where a mask or the border leaves none.
float mean_grey(const Photo& photo, const Vec2d& middle, double half) {
  const int x0 = std::max(0, static_cast<int>(std::floor(middle.x - half)));
  const int y0 = std::max(0, static_cast<int>(std::floor(middle.y - half)));
  const int x1 = std::min(photo.width, static_cast<int>(std::ceil(middle.x + half)));
  const int y1 = std::min(photo.height, static_cast<int>(std::ceil(middle.y + half)));
  double sum = 0;
  int count = 0;
  for (int y = y0; y < y1; ++y)
    for (int x = x0; x < x1; ++x) {
      if (photo.masked_out(x, y)) continue;
      Real rgba[4];
      photo.pixel(x, y, rgba);
      sum += 0.299 * static_cast<double>(rgba[0]) + 0.587 * static_cast<double>(rgba[1]) +
             0.114 * static_cast<double>(rgba[2]);
      ++count;
    }
  return count > 0 ? static_cast<float>(sum / count) : -1.0f;
}

}  // namespace

SweepImage make_sweep_image(const Photo& photo, const Camera& camera, const Pose& to_engine,
                            int longest) {
  SweepImage out;
  out.to_engine = to_engine;
  const double w = camera.width, h = camera.height;
  const double across = 0.5 * (tangent_at(camera, {0, 0.5 * h}) + tangent_at(camera, {w, 0.5 * h}));
  const double down = 0.5 * (tangent_at(camera, {0.5 * w, 0}) + tangent_at(camera, {0.5 * w, h}));
  if (!(across > 0) || !(down > 0)) return out;
  const double reduce = std::max(1.0, std::max(w, h) / longest);
  out.focal = 0.5 * std::max(w, h) / reduce / std::max(across, down);
  out.width = std::max(1, static_cast<int>(std::lround(2 * across * out.focal)));
  out.height = std::max(1, static_cast<int>(std::lround(2 * down * out.focal)));
  out.grey.resize(static_cast<size_t>(out.width) * static_cast<size_t>(out.height));
  for (int y = 0; y < out.height; ++y)
    for (int x = 0; x < out.width; ++x) {
      const Vec3d d{(x + 0.5 - out.cx()) / out.focal, (y + 0.5 - out.cy()) / out.focal, 1};
      const auto at = project(camera, d);
      const bool inside = at && at->x >= 0 && at->y >= 0 && at->x < w && at->y < h;
      out.grey[static_cast<size_t>(y) * static_cast<size_t>(out.width) + static_cast<size_t>(x)] =
          inside ? mean_grey(photo, *at, 0.5 * reduce) : -1.0f;
    }
  return out;
}

}  // namespace nerf::internal
