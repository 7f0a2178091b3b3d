#include "model/pixel_lattice.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "nerf/base/error.h"

namespace nerf::internal {

namespace {

// Smallest multiple of `step` plus `offset` that is at least `from`; offset < step.
int first_from(int from, int step, int offset) {
  return from + ((offset - from) % step + step) % step;
}

// The guess of an error is a sum with these weights, fitted to pixels of `fox` and `bonsai` whose
// rays were all cast. Of the neighbours: their largest difference; that of a pair opposite each
// other, where it is smaller; and of the two pairs' sums; how far off they were themselves. Before
// there is any such, the others count for more.
constexpr Real kContrast = 0.055_r, kAlong = 0.1_r, kTwist = 0.16_r, kSurprise = 0.6_r;
constexpr Real kAtFirst = 1.7_r;
constexpr Real kEarly = 0.6_r;    // of the tolerance, before the last two passes
constexpr int kOuterReach = 3;    // of the outer neighbours
constexpr Real kOuter = 0.125_r;  // Their weight; 0.125 is that of the cubic through four points.

}  // namespace

PixelLattice::PixelLattice(const LatticeOptions& options, int width, int height,
                           const ObjectPixels* objects)
    : options_(options),
      width_(width),
      height_(height),
      objects_(objects),
      wanted_(static_cast<size_t>(width) * static_cast<size_t>(height)),
      surprise_(wanted_.size()) {
  const int spacing = options.spacing;
  NERF_CHECK(spacing >= 2 && (spacing & (spacing - 1)) == 0);
  passes_.push_back({.step = spacing, .share = 1.0 / (spacing * spacing)});
  for (int half = spacing / 2; half >= 1; half /= 2) {
    const Real tolerance = (half == 1 ? 1 : kEarly) * options.tolerance;
    const double share = 0.25 / (half * half);
    passes_.push_back({2 * half, half, true, tolerance, share});
    passes_.push_back({half, half, false, tolerance, 2 * share});
  }
  passes_[1].tolerance = options.sure ? 0 : kEarly * options.tolerance;
}

template <class Body>
void PixelLattice::each_pixel(const Pass& pass, int x0, int y0, int x1, int y1,
                              const Body& body) const {
  if (pass.half == 0 || pass.diagonal) {
    for (int y = first_from(y0, pass.step, pass.half); y < y1; y += pass.step)
      for (int x = first_from(x0, pass.step, pass.half); x < x1; x += pass.step) body(x, y);
    return;
  }
  for (int y = first_from(y0, pass.half, 0); y < y1; y += pass.half) {
    const int offset = y / pass.half % 2 == 0 ? pass.half : 0;
    for (int x = first_from(x0, 2 * pass.half, offset); x < x1; x += 2 * pass.half) body(x, y);
  }
}

bool PixelLattice::find_neighbours(const Pass& pass, int reach, int x, int y, size_t out[4]) const {
  constexpr int kDiagonal[4][2] = {{-1, -1}, {1, -1}, {-1, 1}, {1, 1}};
  constexpr int kStraight[4][2] = {{0, -1}, {-1, 0}, {1, 0}, {0, 1}};
  const int away = reach * pass.half;
  for (size_t i = 0; i < 4; ++i) {
    const int* step = pass.diagonal ? kDiagonal[i] : kStraight[i];
    // Beyond the picture's border its opposite stands in.
    int u = x + away * step[0], v = y + away * step[1];
    if (u < 0 || u >= width_) u = 2 * x - u;
    if (v < 0 || v >= height_) v = 2 * y - v;
    if (u < 0 || u >= width_ || v < 0 || v >= height_) return false;
    out[i] = static_cast<size_t>(v) * static_cast<size_t>(width_) + static_cast<size_t>(u);
  }
  return true;
}

bool PixelLattice::interpolate(const Pass& pass, int x, int y, size_t p, const size_t from[4],
                               Frame& frame) const {
  const auto sees_object = [&](size_t at) { return objects_ && objects_->seen(at); };
  if (sees_object(p)) return false;
  Real surprise = 0, nearest = std::numeric_limits<Real>::max(), farthest = 0, depths = 0;
  for (size_t i = 0; i < 4; ++i) {
    const Real depth = frame.depth_z[from[i]];
    if (sees_object(from[i])) return false;
    nearest = std::min(nearest, depth);
    farthest = std::max(farthest, depth);
    depths += depth;
    surprise += 0.25_r * surprise_[from[i]];
  }
  const bool in_sky = options_.sky && farthest == 0;
  // Where a neighbour sees nothing, a ray costs little and may meet what is thin.
  if (!in_sky && !(nearest > 0 && farthest <= options_.depth_ratio * nearest)) return false;
  const auto value = [&](size_t at, size_t k) {
    return k < 3 ? frame.rgb[3 * at + k] : frame.alpha[at];
  };
  Real means[4], least[4], most[4], contrast = 0, along_first = 0, along_other = 0, twist = 0;
  for (size_t k = 0; k < 4; ++k) {
    const Real a = value(from[0], k), b = value(from[1], k), c = value(from[2], k),
               d = value(from[3], k);
    least[k] = std::min(std::min(a, b), std::min(c, d));
    most[k] = std::max(std::max(a, b), std::max(c, d));
    means[k] = 0.25_r * (a + b + c + d);
    contrast = std::max(contrast, most[k] - least[k]);
    along_first = std::max(along_first, std::abs(a - d));
    along_other = std::max(along_other, std::abs(b - c));
    twist = std::max(twist, std::abs(a + d - b - c));
  }
  const Real differences =
      kContrast * contrast + kAlong * std::min(along_first, along_other) + kTwist * twist;
  const Real guess =
      &pass == &passes_[1] ? kAtFirst * differences : differences + kSurprise * surprise;
  if (!(guess < pass.tolerance)) return false;
  size_t outer[4];
  bool curved = find_neighbours(pass, kOuterReach, x, y, outer);
  for (size_t i = 0; curved && i < 4; ++i) {
    const Real depth = frame.depth_z[outer[i]];
    curved = (depth > 0) != in_sky && !sees_object(outer[i]) &&
             std::max(depth, farthest) <= options_.depth_ratio * std::min(depth, nearest);
  }
  // A cubic's value in the middle, along either pair; within what the nearest enclose.
  for (size_t k = 0; curved && k < 4; ++k) {
    const Real sum =
        value(outer[0], k) + value(outer[1], k) + value(outer[2], k) + value(outer[3], k);
    means[k] = std::clamp((1 + kOuter) * means[k] - 0.25_r * kOuter * sum, least[k], most[k]);
  }
  for (size_t k = 0; k < 3; ++k) frame.rgb[3 * p + k] = means[k];
  frame.alpha[p] = means[3];
  frame.depth_z[p] = 0.5_r * (depths - nearest - farthest);
  return true;
}

int PixelLattice::choose(int pass_number, int x0, int y0, int x1, int y1, Frame& frame) {
  const Pass& pass = passes_[static_cast<size_t>(pass_number)];
  int rays = 0;
  each_pixel(pass, x0, y0, x1, y1, [&](int x, int y) {
    const size_t p = static_cast<size_t>(y) * static_cast<size_t>(width_) + static_cast<size_t>(x);
    size_t from[4];
    if (pass.tolerance > 0 && find_neighbours(pass, 1, x, y, from) &&
        interpolate(pass, x, y, p, from, frame)) {
      for (const size_t i : from) surprise_[p] = std::max(surprise_[p], 0.5_r * surprise_[i]);
      return;
    }
    wanted_[p] = 1;
    ++rays;
  });
  return rays;
}

void PixelLattice::learn(int pass_number, int x0, int y0, int x1, int y1, const Frame& frame) {
  const Pass& pass = passes_[static_cast<size_t>(pass_number)];
  each_pixel(pass, x0, y0, x1, y1, [&](int x, int y) {
    const size_t p = static_cast<size_t>(y) * static_cast<size_t>(width_) + static_cast<size_t>(x);
    if (!wanted_[p]) return;
    wanted_[p] = 0;
    size_t from[4];
    if (pass.half == 0 || !find_neighbours(pass, 1, x, y, from)) return;
    for (size_t k = 0; k < 3; ++k) {
      Real sum = 0;
      for (const size_t i : from) sum += frame.rgb[3 * i + k];
      surprise_[p] = std::max(surprise_[p], std::abs(frame.rgb[3 * p + k] - 0.25_r * sum));
    }
  });
}

}  // namespace nerf::internal
