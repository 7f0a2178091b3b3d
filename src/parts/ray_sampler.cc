#include "nerf/parts/ray_sampler.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "nerf/kernels/elementwise.h"
#include "nerf/kernels/linear.h"
#include "nerf/kernels/resampling.h"

namespace nerf {

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

RaySampler::RaySampler(const OccupancyGrid& grid, const SamplerOptions& options, const Box3& clip)
    : grid_(grid), options_(options), clip_(clip) {
  options_.max_samples = std::max(1, options_.max_samples);
  options_.min_samples = std::clamp(options_.min_samples, 1, options_.max_samples);
  const double half = static_cast<double>(1 << (grid.cascades() - 1));
  for (int i = 0; i < 3; ++i) {
    clip_.min[i] = std::max(clip_.min[i], -half);
    clip_.max[i] = std::min(clip_.max[i], half);
  }
  // A ray crosses at most three cells per unit of each axis it moves along, in every cascade; the
  // march writes one more than it counts.
  segments_.resize(
      static_cast<size_t>(grid.cascades()) * 3 * (static_cast<size_t>(grid.side()) + 1) + 64);
  for (auto* a : {&thickness_, &opacity_, &one_})
    *a = AlignedArray<Real>(
        static_cast<size_t>(round_up(static_cast<int64_t>(segments_.size()), kLane)));
  std::ranges::fill(one_, 1.0_r);
  mass_.resize(segments_.size());
  for (auto* v : {&ends_, &mass_at_ends_}) v->resize(2 * segments_.size());
  for (auto* v : {&matter_below_, &mass_below_}) v->resize(segments_.size() + 1);
  targets_.resize(static_cast<size_t>(options_.max_samples));
}

// Traversal of a regular grid (Amanatides and Woo 1987) in two levels: bricks of 4^3 cells, and the
// cells of the bricks that hold any matter. Borders are found from integers, so errors do not add
// up.
struct RaySampler::Traversal {
  Vec3 origin, direction, inverse;
  int step[3], positive[3];
  Real end;              // of the ray
  Real depth = 0, stop;  // optical depth so far, and where to stop

  // t of the border of slot `at` (width w, slot 0 starting at -half) that the ray leaves through.
  Real border(int axis, int at, int half, Real w) const {
    if (step[axis] == 0) return kNever;
    return (static_cast<Real>(at + positive[axis] - half) * w - origin[axis]) * inverse[axis];
  }
  static constexpr Real kNever = 1e30_r;

  // Along the axes other than `axis`: the slots, from `at` to at most `last`, in which the ray is
  // at t, and where it leaves them. Found from the borders, so that no rounding tells a jump from
  // its steps.
  void follow(int axis, Real t, int half, Real w, int at[3], const int last[3],
              Real next[3]) const {
    for (int i = 0; i < 3; ++i) {
      if (i == axis || step[i] == 0) continue;
      const Real p = origin[i] + direction[i] * t;
      int slot =
          std::clamp(floor_int(p / w) + half, std::min(at[i], last[i]), std::max(at[i], last[i]));
      while (slot != at[i] && border(i, slot - step[i], half, w) > t) slot -= step[i];
      while (slot != last[i] && border(i, slot, half, w) <= t) slot += step[i];
      at[i] = slot;
      next[i] = border(i, slot, half, w);
    }
  }
};

namespace {
int least(const Real t[3]) { return t[0] < t[1] ? (t[0] < t[2] ? 0 : 2) : (t[1] < t[2] ? 1 : 2); }
}  // namespace

void RaySampler::march(const Ray& ray, Real min_transmittance) {
  segment_count_ = 0;
  double t0 = ray.near, t1 = ray.far;
  Box3 box = grid_.occupied_box();
  for (int i = 0; i < 3; ++i) {
    box.min[i] = std::max(box.min[i], clip_.min[i]);
    box.max[i] = std::min(box.max[i], clip_.max[i]);
  }
  if (box.empty() || !clip_to_box(ray, box, t0, t1)) return;
  start_ = t0;
  entry_ = (ray.origin + ray.direction * t0).cast<Real>();

  Traversal v;
  v.origin = entry_;
  v.direction = ray.direction.cast<Real>();
  v.end = static_cast<Real>(t1 - t0);
  v.stop = min_transmittance > 0 ? -std::log(min_transmittance) : Traversal::kNever;
  // Along such an axis no ray gets from one Real to the next.
  constexpr Real kParallel =
      1e-12_r * std::numeric_limits<Real>::epsilon() / std::numeric_limits<float>::epsilon();
  for (int i = 0; i < 3; ++i) {
    const Real d = v.direction[i];
    v.step[i] = std::fabs(d) < kParallel ? 0 : d > 0 ? 1 : -1;
    v.positive[i] = d > 0;
    v.inverse[i] = v.step[i] ? 1.0_r / d : 0.0_r;
  }
  if (!(v.end <= 4 * static_cast<Real>(1 << grid_.cascades())))
    return;  // coordinates are no numbers
  // Nudged across the border that the ray, or the last stretch of it, starts on. One that enters
  // along the grid's upper border is inside, wherever rounding has put it.
  constexpr Real kNudge = 1e-6_r;
  Real t = static_cast<Real>(std::clamp(ray.clear - t0, 0.0, t1 - t0));
  const Vec3 begin = v.origin + v.direction * (t + kNudge * (1 + t));
  int c = std::min(grid_.cascade_of(begin), grid_.cascades() - 1);
  while (t < v.end && v.depth < v.stop && c < grid_.cascades())
    t = march_cascade(v, c, t + kNudge * (1 + t));
}

// A brick that a ray passes from t to exit.
struct RaySampler::Passage {
  int64_t brick;
  int at[3];
  Real t, exit;
};

Real RaySampler::march_cascade(Traversal& v, int& cascade, Real t) {
  const int c = cascade;
  const int bricks = grid_.bricks(), half = bricks / 2;
  const Real width = grid_.brick_width(c);
  int at[3];
  Real next[3];
  for (int i = 0; i < 3; ++i) {
    const Real p = v.origin[i] + v.direction[i] * t;
    at[i] = std::clamp(floor_int(p / width) + half, 0, bricks - 1);
    next[i] = v.border(i, at[i], half, width);
  }
  const auto in_finer = [&] {
    for (int a : at)
      if (a < half / 2 || a >= bricks - half / 2) return false;
    return true;
  };
  // Bricks that hold matter are marched through a few at a time, so that their memory is on its way
  // when its turn comes.
  constexpr int kAhead = 6;
  Passage ahead[kAhead];
  int waiting = 0;
  const auto pass = [&] {
    for (int i = 0; i < waiting && v.depth < v.stop; ++i) march_brick(v, c, ahead[i]);
    waiting = 0;
  };
  constexpr int kWorthAJump = 3;
  for (;;) {
    const int64_t brick = (int64_t{at[2]} * bricks + at[1]) * bricks + at[0];
    const int clearance = grid_.clearance(c, brick);
    int axis;
    if (clearance >= kWorthAJump) {
      // Out of the cube of clear bricks around this one.
      int last[3];
      for (int i = 0; i < 3; ++i) {
        last[i] = std::clamp(at[i] + v.step[i] * (clearance - 1), 0, bricks - 1);
        next[i] = v.border(i, last[i], half, width);
      }
      axis = least(next);
      t = std::min(std::max(next[axis], t), v.end);
      if (t >= v.end) break;
      v.follow(axis, t, half, width, at, last, next);
      at[axis] = last[axis];
    } else {
      axis = least(next);
      const Real exit = std::min(std::max(next[axis], t), v.end);
      if (clearance == 0) {
        grid_.prefetch(c, brick);
        ahead[waiting++] = {brick, {at[0], at[1], at[2]}, t, exit};
        if (waiting == kAhead) pass();
      }
      t = exit;
      if (t >= v.end || v.depth >= v.stop) break;
    }
    at[axis] += v.step[axis];
    // By the bricks' places and not by the point's: rounding may keep a point this side of the
    // border.
    if (at[axis] < 0 || at[axis] >= bricks) {
      ++cascade;
      break;
    }
    if (c > 0 && in_finer()) {
      --cascade;
      break;
    }
    next[axis] = v.border(axis, at[axis], half, width);
  }
  pass();
  return t;
}

void RaySampler::march_brick(Traversal& v, int c, const Passage& passage) {
  const uint64_t mask = grid_.brick_mask(c, passage.brick);
  const int half = grid_.side() / 2;
  const Real width = grid_.cell_width(c), scale = 1.0_r / width;
  // Of each axis the borders ahead, how many of them are the brick's, and what a cell further is in
  // its memory. Which axis is next and whether its cell holds matter cannot be foretold, so that
  // nothing below branches on it.
  constexpr int kSide = 4, kStride[3] = {1, kSide, kSide * kSide};
  Real border[3][kSide];
  int ahead[3], stride[3], in = 0;
  for (int i = 0; i < 3; ++i) {
    const Real p = v.origin[i] + v.direction[i] * passage.t;
    const int first = passage.at[i] * kSide;
    const int at = std::clamp(floor_int(p * scale) + half - first, 0, kSide - 1);
    for (int k = 0; k < kSide; ++k)
      border[i][k] = v.border(i, first + at + k * v.step[i], half, width);
    ahead[i] = v.positive[i] ? kSide - at : at + 1;
    stride[i] = v.step[i] * kStride[i];
    in += at * kStride[i];
  }
  Segment* out = segments_.data() + segment_count_;
  Real t = passage.t, depth = v.depth;
  int x = 0, y = 0, z = 0;  // steps along each axis
  for (;;) {
    const Real tx = border[0][x], ty = border[1][y], tz = border[2][z];
    const int by_x = int{tx < ty} & int{tx < tz}, by_y = (by_x ^ 1) & int{ty < tz};
    const int by_z = (by_x | by_y) ^ 1;
    const Real exit = std::min(std::max(std::min(std::min(tx, ty), tz), t), passage.exit);
    const int cell = in + x * stride[0] + y * stride[1] + z * stride[2];
    const bool matter = (mask >> cell & 1) & uint64_t{exit > t};
    // An empty cell's is 0.
    const Real tau = grid_.thickness(c, passage.brick * 64 + cell) * (exit - t) * scale;
    *out = {t, exit, tau};
    out += matter;
    depth += tau;
    t = exit;
    x += by_x;
    y += by_y;
    z += by_z;
    if (t >= passage.exit || depth >= v.stop) break;
    if (x == ahead[0] || y == ahead[1] || z == ahead[2]) break;  // out of the brick
  }
  v.depth = depth;
  segment_count_ = static_cast<int>(out - segments_.data());
}

// Mass of each segment: the share of light that the cache says comes from it, spread to its direct
// neighbours (they may hold the surface just as well), and a uniform share of the ray's matter.
int RaySampler::choose_count(bool follow_cache) {
  const size_t n = static_cast<size_t>(segment_count_);
  Real length = 0;
  for (size_t i = 0; i < n; ++i) {
    length += segments_[i].t1 - segments_[i].t0;
    thickness_[i] = segments_[i].thickness;
  }
  const size_t padded = static_cast<size_t>(round_up(segment_count_, kLane));
  std::fill(thickness_.data() + n, thickness_.data() + padded, 0.0_r);
  opacity(segment_count_, thickness_.data(), one_.data(), opacity_.data());
  Real transmittance = 1;
  for (size_t i = 0; i < n; ++i) {
    mass_[i] = follow_cache ? transmittance * opacity_[i] : 0;
    transmittance *= 1 - opacity_[i];
  }
  Real previous = 0, sum = 0, squares = 0;
  for (size_t i = 0; i < n; ++i) {
    const Real here = mass_[i];
    const Real next = i + 1 < n ? mass_[i + 1] : 0;
    const Real share = (segments_[i].t1 - segments_[i].t0) / length;
    mass_[i] = 0.5_r * here + 0.25_r * (previous + next) + options_.uniform_share * share;
    if (!follow_cache) mass_[i] = share;
    previous = here;
    sum += mass_[i];
    squares += mass_[i] * mass_[i];
  }
  // Number of cells that would give this sum of squares if they were equal.
  const Real cells = sum * sum / squares;
  const Real wanted = std::ceil(options_.samples_per_cell * cells);
  if (!(wanted < static_cast<Real>(options_.max_samples))) return options_.max_samples;
  return std::max(static_cast<int>(wanted), options_.min_samples);
}

int RaySampler::sample(const Ray& ray, Random* random, bool follow_cache, RaySamples& out) {
  march(ray, follow_cache ? options_.min_transmittance : 0);
  const int count = segment_count_ == 0 ? 0 : choose_count(follow_cache);
  out.t.resize(static_cast<size_t>(count));
  out.delta.resize(static_cast<size_t>(count));
  if (count == 0) return 0;
  // Inverse of the distribution at one place inside each share of the mass (positions, between the
  // segments' ends; a gap has no mass) and at the borders k / count (interval lengths, of matter
  // alone).
  const size_t n = static_cast<size_t>(segment_count_), shares = static_cast<size_t>(count);
  Real mass = 0, matter = 0;
  for (size_t i = 0; i < n; ++i) {
    const Segment& s = segments_[i];
    ends_[2 * i] = s.t0;
    ends_[2 * i + 1] = s.t1;
    mass_below_[i] = mass_at_ends_[2 * i] = mass;
    matter_below_[i] = matter;
    mass += mass_[i];
    matter += s.t1 - s.t0;
    mass_at_ends_[2 * i + 1] = mass;
  }
  mass_below_[n] = mass;
  matter_below_[n] = matter;
  const auto up_to = [](std::vector<Real>& v, size_t size) { return std::span(v.data(), size); };
  const Real unit = mass / static_cast<Real>(count);
  for (int k = 0; k < count; ++k)
    targets_[static_cast<size_t>(k)] =
        (static_cast<Real>(k) + (random ? random->uniform() : 0.5_r)) * unit;
  histogram_inverse(up_to(ends_, 2 * n), up_to(mass_at_ends_, 2 * n), up_to(targets_, shares),
                    out.t);
  if (out.with_fronts) {
    out.front.resize(shares);
    for (size_t k = 0; k < shares; ++k) targets_[k] = static_cast<Real>(k) * unit;
    histogram_inverse(up_to(ends_, 2 * n), up_to(mass_at_ends_, 2 * n), up_to(targets_, shares),
                      out.front);
  }
  for (int k = 1; k < count; ++k)
    targets_[static_cast<size_t>(k - 1)] = static_cast<Real>(k) * unit;
  histogram_inverse(up_to(matter_below_, n + 1), up_to(mass_below_, n + 1),
                    up_to(targets_, shares - 1), up_to(out.delta, shares - 1));
  // The last border is the end of all matter, whatever the sum of masses was rounded to.
  out.delta.back() = matter;
  for (size_t k = shares; --k > 0;) out.delta[k] = std::max(out.delta[k] - out.delta[k - 1], 0.0_r);
  return count;
}

int RaySampler::sample_all(const Ray& ray, int per_cell, RaySamples& out) {
  out.t.clear();
  out.delta.clear();
  out.front.clear();
  march(ray, 0);
  for (const Segment& s : segments()) {
    const Real width = (s.t1 - s.t0) / static_cast<Real>(per_cell);
    for (int k = 0; k < per_cell; ++k) {
      out.t.push_back(s.t0 + (static_cast<Real>(k) + 0.5_r) * width);
      out.delta.push_back(width);
      if (out.with_fronts) out.front.push_back(s.t0 + static_cast<Real>(k) * width);
    }
  }
  return static_cast<int>(out.t.size());
}

}  // namespace nerf
