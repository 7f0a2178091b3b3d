// The matter on a ray by brute force, in double: the ray is cut by every plane of every cascade,
// and the cell of each piece is that of its middle.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "math/worst_error.h"
#include "nerf/parts/ray_sampler.h"
#include "parts/occupancy_pattern.h"

namespace nerf {

// A stretch of matter, neighbouring occupied cells joined. slack0 and slack1: how far off its ends
// a march in float may be, for the coordinates of a ray have 24 bits: a plane crossed at a shallow
// angle is met at another t. gaps: what it may leave out between them, where it steps over the
// borders of cascades.
struct Stretch {
  double t0, t1, slack0, slack1, gaps = 0;
};

inline std::vector<Stretch> brute_march(const Ray& ray, const Box3& clip, int cascades,
                                        const Pattern& pattern,
                                        int side = OccupancyGrid::kDefaultSide) {
  const int middle_place = side / 2;
  const double half = std::ldexp(1.0, cascades - 1);
  double begin = ray.near, end = ray.far;
  int first_axis = -1, last_axis = -1;
  for (int i = 0; i < 3; ++i) {
    const double low = std::max(clip.min[i], -half), high = std::min(clip.max[i], half);
    if (low >= high) return {};
    const double o = ray.origin[i], d = ray.direction[i];
    if (d == 0) {
      if (o < low || o > high) return {};
      continue;
    }
    const double a = ((d > 0 ? low : high) - o) / d, b = ((d > 0 ? high : low) - o) / d;
    if (a > begin) begin = a, first_axis = i;
    if (b < end) end = b, last_axis = i;
  }
  if (!(begin < end)) return {};

  struct Crossing {
    double t;
    int axis;
  };
  std::vector<Crossing> crossings;
  for (int c = 0; c < cascades; ++c)
    for (int k = -middle_place; k <= middle_place; ++k)
      for (int i = 0; i < 3; ++i) {
        if (ray.direction[i] == 0) continue;
        const double t = (std::ldexp(k, c) / middle_place - ray.origin[i]) / ray.direction[i];
        if (t > begin && t < end) crossings.push_back({t, i});
      }
  std::sort(crossings.begin(), crossings.end(), [](auto& a, auto& b) { return a.t < b.t; });
  crossings.insert(crossings.begin(), {begin, first_axis});
  crossings.push_back({end, last_axis});

  // Coordinates up to `half` and directions are rounded, and so is each of the three operations
  // that find a border; the march steps over cascade borders by a few millionths.
  const auto slack = [&](const Crossing& at) {
    const double along = at.t - begin, nudge = 4e-6 * (1 + along);
    if (at.axis < 0) return nudge;
    return nudge + kRoundoff * (4 * half + 4 * along) / std::fabs(ray.direction[at.axis]);
  };
  std::vector<Stretch> out;
  int previous = 0;  // cascade of the piece before
  for (size_t i = 0; i + 1 < crossings.size(); ++i) {
    const Crossing &from = crossings[i], &to = crossings[i + 1];
    if (!(from.t < to.t)) continue;
    const Vec3d middle = ray.origin + ray.direction * (0.5 * (from.t + to.t));
    const auto inside = [&](int c) {
      const double h = std::ldexp(1.0, c);
      for (int i = 0; i < 3; ++i)
        if (!(middle[i] >= -h && middle[i] < h)) return false;
      return true;
    };
    int c = 0;
    while (c < cascades - 1 && !inside(c)) ++c;
    const auto index = [&](double v) {
      return std::clamp(
          static_cast<int>(std::floor(v * std::ldexp(middle_place, -c))) + middle_place, 0,
          side - 1);
    };
    if (pattern({c, index(middle.x), index(middle.y), index(middle.z)}) == 0) continue;
    if (!out.empty() && out.back().t1 == from.t) {
      // A step of a millionth of 1 + t, rounded.
      if (c != previous) out.back().gaps += 1.2e-6 * (1 + from.t - begin);
      out.back().t1 = to.t;
      out.back().slack1 = slack(to);
    } else {
      out.push_back({from.t, to.t, slack(from), slack(to)});
    }
    previous = c;
  }
  return out;
}

}  // namespace nerf
