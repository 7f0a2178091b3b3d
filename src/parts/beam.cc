#include "nerf/parts/beam.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace nerf {

namespace {

double distance_to_box(const Vec3d& p, const Box3& box) {
  double sum = 0;
  for (int i = 0; i < 3; ++i) {
    const double outside = std::max({box.min[i] - p[i], p[i] - box.max[i], 0.0});
    sum += outside * outside;
  }
  return std::sqrt(sum);
}

double farthest_of_box(const Vec3d& p, const Box3& box) {
  double sum = 0;
  for (int i = 0; i < 3; ++i) {
    const double most = std::max(std::abs(box.min[i] - p[i]), std::abs(box.max[i] - p[i]));
    sum += most * most;
  }
  return std::sqrt(sum);
}

struct Clear {
  double radius;  // around a point, in which no brick holds matter as far as clearances tell
  double worth;   // of steps: a cell's width there
};

Clear clear_around(const OccupancyGrid& grid, const Vec3d& p) {
  const double outside = distance_to_box(p, grid.occupied_box());
  const Vec3 at = p.cast<Real>();
  const int last = grid.cascades() - 1, c = grid.cascade_of(at);
  const double cell = static_cast<double>(grid.cell_width(std::min(c, last)));
  if (c > last) return {outside, cell};
  const int clearance = grid.clearance(c, grid.cell_of(at, c) / 64);
  if (clearance == 0) return {outside, cell};
  const double width = 4 * cell, half = width * (grid.bricks() / 2);
  double to_border = half, to_cascade = half;
  for (int i = 0; i < 3; ++i) {
    const double slot = p[i] / width, into = slot - std::floor(slot);
    to_border = std::min(to_border, width * std::min(into, 1 - into));
    to_cascade = std::min(to_cascade, half - std::abs(p[i]));
  }
  double radius = to_border + (clearance - 1) * width;
  // What lies beyond is the next cascade's to say; beyond the last there is nothing.
  if (c < last) radius = std::min(radius, to_cascade);
  // The march finds its positions in float.
  return {std::max(outside, radius - 1e-5 * half), cell};
}

}  // namespace

double clear_until(const OccupancyGrid& grid, const Beam& beam) {
  constexpr double kNever = std::numeric_limits<double>::infinity();
  const Box3& box = grid.occupied_box();
  if (box.empty()) return kNever;
  const double end = farthest_of_box(beam.origin, box) + beam.width;
  double t = beam.near;
  while (t < end) {
    const Clear clear = clear_around(grid, beam.origin + beam.axis * t);
    // Rays at distance t are within width + t * spread of the axis.
    const double step = (clear.radius - beam.width - t * beam.spread) / (1 + beam.spread);
    if (!(step > clear.worth)) return t;
    t += step;
  }
  return kNever;
}

}  // namespace nerf
