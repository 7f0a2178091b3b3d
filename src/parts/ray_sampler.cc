#include "nerf/parts/ray_sampler.h"

#include <algorithm>
#include <cmath>

namespace nerf {

namespace {

// Entry and exit of a ray through a box; false where it misses.
bool clip_to_box(const Ray& ray, const Box3& box, double& t0, double& t1) {
  for (int i = 0; i < 3; ++i) {
    const double d = ray.direction[i];
    if (std::fabs(d) < 1e-300) {
      if (ray.origin[i] < box.min[i] || ray.origin[i] > box.max[i]) return false;
      continue;
    }
    double a = (box.min[i] - ray.origin[i]) / d, b = (box.max[i] - ray.origin[i]) / d;
    if (a > b) std::swap(a, b);
    t0 = std::max(t0, a);
    t1 = std::min(t1, b);
  }
  return t0 < t1;
}

}  // namespace

RaySampler::RaySampler(const OccupancyGrid& grid, const SamplerOptions& options, const Box3& clip)
    : grid_(grid), options_(options), clip_(clip) {
  const double half = static_cast<double>(1 << (grid.cascades() - 1));
  for (int i = 0; i < 3; ++i) {
    clip_.min[i] = std::max(clip_.min[i], -half);
    clip_.max[i] = std::min(clip_.max[i], half);
  }
}

void RaySampler::march(const Ray& ray, float min_transmittance) {
  segments_.clear();
  double t0 = ray.near, t1 = ray.far;
  if (!clip_to_box(ray, clip_, t0, t1)) return;
  start_ = t0;
  entry_ = (ray.origin + ray.direction * t0).cast<float>();
  const Vec3 o = entry_;
  const Vec3 d = ray.direction.cast<float>();
  const float end = static_cast<float>(t1 - t0);
  Vec3 inverse;
  for (int i = 0; i < 3; ++i) inverse[i] = std::fabs(d[i]) > 1e-12f ? 1.0f / d[i] : 1e12f;

  constexpr int kHalf = OccupancyGrid::kSide / 2;
  const float stop = min_transmittance > 0 ? -std::log(min_transmittance) : 1e30f;
  float depth = 0, t = 0;
  while (t < end && depth < stop) {
    // Nudged across the border that the last step ended on.
    const float at = t + 1e-5f + 1e-6f * t;
    const Vec3 p = o + d * at;
    const int c = grid_.cascade_of(p);
    if (c >= grid_.cascades()) break;
    const float width = OccupancyGrid::cell_width(c), scale = 1.0f / width;
    int cell[3];
    for (int i = 0; i < 3; ++i)
      cell[i] = std::clamp(static_cast<int>(std::floor(p[i] * scale)) + kHalf, 0,
                           OccupancyGrid::kSide - 1);
    const int64_t brick =
        (int64_t{cell[2] >> 2} * OccupancyGrid::kBricks + (cell[1] >> 2)) * OccupancyGrid::kBricks +
        (cell[0] >> 2);
    const uint64_t mask = grid_.brick_mask(c, brick);
    const int step = mask == 0 ? 4 : 1;  // an empty brick is left in one stride
    float exit = end;
    for (int i = 0; i < 3; ++i) {
      const int low = mask == 0 ? cell[i] & ~3 : cell[i];
      const float border = static_cast<float>(low + (d[i] > 0 ? step : 0) - kHalf) * width;
      if (std::fabs(d[i]) > 1e-12f) exit = std::min(exit, (border - o[i]) * inverse[i]);
    }
    exit = std::min(std::max(exit, at), end);
    const int in = (cell[2] & 3) * 16 + (cell[1] & 3) * 4 + (cell[0] & 3);
    if (mask >> in & 1) {
      const float tau = grid_.thickness(c, brick * 64 + in) * (exit - t) * scale;
      segments_.push_back({t, exit, tau});
      depth += tau;
    }
    t = exit;
  }
}

// Mass of each segment: the share of light that the cache says comes from it, spread to its direct
// neighbours (they may hold the surface just as well), and a uniform share of the ray's matter.
int RaySampler::choose_count(bool follow_cache) {
  const size_t n = segments_.size();
  mass_.resize(n);
  float length = 0;
  for (const Segment& s : segments_) length += s.t1 - s.t0;
  float transmittance = 1;
  for (size_t i = 0; i < n; ++i) {
    const float pass = std::exp(-segments_[i].thickness);
    mass_[i] = follow_cache ? transmittance * (1 - pass) : 0;
    transmittance *= pass;
  }
  float previous = 0, sum = 0, squares = 0;
  for (size_t i = 0; i < n; ++i) {
    const float here = mass_[i];
    const float next = i + 1 < n ? mass_[i + 1] : 0;
    const float share = (segments_[i].t1 - segments_[i].t0) / length;
    mass_[i] = 0.5f * here + 0.25f * (previous + next) + options_.uniform_share * share;
    if (!follow_cache) mass_[i] = share;
    previous = here;
    sum += mass_[i];
    squares += mass_[i] * mass_[i];
  }
  total_mass_ = sum;
  // Number of cells that would give this sum of squares if they were equal.
  const float cells = squares > 0 ? sum * sum / squares : 0;
  return std::clamp(static_cast<int>(std::ceil(options_.samples_per_cell * cells)),
                    options_.min_samples, options_.max_samples);
}

int RaySampler::sample(const Ray& ray, Random* random, bool follow_cache, RaySamples& out) {
  out.t.clear();
  out.delta.clear();
  march(ray, follow_cache ? options_.min_transmittance : 0);
  if (segments_.empty()) return 0;
  const int count = choose_count(follow_cache);
  // Inverse of the distribution at the borders k / count of equal mass (interval lengths) and at one
  // place inside each (positions), in one walk over the segments.
  size_t s = 0;
  float below = 0;  // mass of the segments before s
  float matter = 0; // their length
  const auto advance = [&](float target, float& length) {
    while (s + 1 < segments_.size() && below + mass_[s] < target) {
      below += mass_[s];
      matter += segments_[s].t1 - segments_[s].t0;
      ++s;
    }
    const float width = segments_[s].t1 - segments_[s].t0;
    const float f = mass_[s] > 0 ? std::clamp((target - below) / mass_[s], 0.0f, 1.0f) : 0.5f;
    length = matter + f * width;
    return segments_[s].t0 + f * width;
  };
  float from = 0;
  const float unit = total_mass_ / static_cast<float>(count);
  for (int k = 0; k < count; ++k) {
    const float inside = random ? random->uniform() : 0.5f;
    float length = 0;
    const float t = advance((static_cast<float>(k) + inside) * unit, length);
    float to = 0;
    advance(static_cast<float>(k + 1) * unit, to);
    out.t.push_back(t);
    out.delta.push_back(std::max(to - from, 0.0f));
    from = to;
  }
  return count;
}

int RaySampler::sample_all(const Ray& ray, int per_cell, RaySamples& out) {
  out.t.clear();
  out.delta.clear();
  march(ray, 0);
  for (const Segment& s : segments_) {
    const float width = (s.t1 - s.t0) / static_cast<float>(per_cell);
    for (int k = 0; k < per_cell; ++k) {
      out.t.push_back(s.t0 + (static_cast<float>(k) + 0.5f) * width);
      out.delta.push_back(width);
    }
  }
  return static_cast<int>(out.t.size());
}

}  // namespace nerf
