#include "model/pixel_lattice.h"

#include <algorithm>
#include <cmath>

#include "nerf/base/error.h"

namespace nerf::internal {

namespace {

// Smallest multiple of `step` plus `offset` that is at least `from`; offset < step.
int first_from(int from, int step, int offset) {
  return from + ((offset - from) % step + step) % step;
}

}  // namespace

PixelLattice::PixelLattice(const LatticeOptions& options, int width, int height)
    : options_(options),
      width_(width),
      height_(height),
      wanted_(static_cast<size_t>(width) * static_cast<size_t>(height)),
      surprise_(wanted_.size()) {
  const int spacing = options.spacing;
  NERF_CHECK(spacing >= 2 && (spacing & (spacing - 1)) == 0);
  passes_.push_back({.step = spacing, .share = 1.0 / (spacing * spacing)});
  const Real t = options.tolerance;
  for (int half = spacing / 2; half >= 1; half /= 2) {
    // The closer the neighbours, the less can lie between them.
    const bool last = half == 1;
    const double share = 0.25 / (half * half);
    passes_.push_back(
        {2 * half, half, true, (last ? 2 : 0.75_r) * t, (last ? 0.5_r : 0.375_r) * t, share});
    passes_.push_back(
        {half, half, false, (last ? 3 : 1) * t, (last ? 0.75_r : 0.375_r) * t, 2 * share});
  }
  if (options.sure) passes_[1].contrast = 0;
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

bool PixelLattice::find_neighbours(const Pass& pass, int x, int y, size_t out[4]) const {
  constexpr int kDiagonal[4][2] = {{-1, -1}, {1, -1}, {-1, 1}, {1, 1}};
  constexpr int kStraight[4][2] = {{0, -1}, {-1, 0}, {1, 0}, {0, 1}};
  for (size_t i = 0; i < 4; ++i) {
    const int* step = pass.diagonal ? kDiagonal[i] : kStraight[i];
    // Beyond the picture's border its opposite stands in.
    int u = x + pass.half * step[0], v = y + pass.half * step[1];
    if (u < 0 || u >= width_) u = 2 * x - u;
    if (v < 0 || v >= height_) v = 2 * y - v;
    if (u < 0 || u >= width_ || v < 0 || v >= height_) return false;
    out[i] = static_cast<size_t>(v) * static_cast<size_t>(width_) + static_cast<size_t>(u);
  }
  return true;
}

bool PixelLattice::interpolate(const Pass& pass, size_t p, const size_t from[4],
                               Frame& frame) const {
  Real depths[4], surprise = 0;
  for (size_t i = 0; i < 4; ++i) {
    depths[i] = frame.depth_z[from[i]];
    surprise = std::max(surprise, surprise_[from[i]]);
  }
  const Real nearest = std::min(std::min(depths[0], depths[1]), std::min(depths[2], depths[3]));
  const Real farthest = std::max(std::max(depths[0], depths[1]), std::max(depths[2], depths[3]));
  // Where a neighbour sees nothing, a ray costs little and may meet what is thin.
  if (!(nearest > 0 && farthest <= options_.depth_ratio * nearest && surprise < pass.surprise))
    return false;
  Real means[4];
  for (size_t k = 0; k < 4; ++k) {
    const auto value = [&](size_t i) {
      return k < 3 ? frame.rgb[3 * from[i] + k] : frame.alpha[from[i]];
    };
    const Real a = value(0), b = value(1), c = value(2), d = value(3);
    const Real least = std::min(std::min(a, b), std::min(c, d));
    const Real most = std::max(std::max(a, b), std::max(c, d));
    if (!(most - least < pass.contrast)) return false;
    means[k] = 0.25_r * (a + b + c + d);
  }
  for (size_t k = 0; k < 3; ++k) frame.rgb[3 * p + k] = means[k];
  frame.alpha[p] = means[3];
  frame.depth_z[p] = 0.5_r * (depths[0] + depths[1] + depths[2] + depths[3] - nearest - farthest);
  return true;
}

int PixelLattice::choose(int pass_number, int x0, int y0, int x1, int y1, Frame& frame) {
  const Pass& pass = passes_[static_cast<size_t>(pass_number)];
  int rays = 0;
  each_pixel(pass, x0, y0, x1, y1, [&](int x, int y) {
    const size_t p = static_cast<size_t>(y) * static_cast<size_t>(width_) + static_cast<size_t>(x);
    size_t from[4];
    if (pass.half > 0 && find_neighbours(pass, x, y, from) && interpolate(pass, p, from, frame)) {
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
    if (pass.half == 0 || !find_neighbours(pass, x, y, from)) return;
    for (size_t k = 0; k < 3; ++k) {
      Real sum = 0;
      for (const size_t i : from) sum += frame.rgb[3 * i + k];
      surprise_[p] = std::max(surprise_[p], std::abs(frame.rgb[3 * p + k] - 0.25_r * sum));
    }
  });
}

}  // namespace nerf::internal
