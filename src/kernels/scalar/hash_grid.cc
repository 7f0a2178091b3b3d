#include "nerf/kernels/hash_grid.h"

#include <array>

#include "base/half.h"
#include "nerf/kernels/linear.h"
#include "nerf/math/reference/hash_grid.h"

namespace nerf {
namespace {

reference::GridLevel reference_level(const HashGridLevel& level) {
  return {level.scale, level.resolution, level.entries, level.dense,
          static_cast<size_t>(level.features)};
}

// Calls body(p, s) for each sample, those of the padding too.
template <class Body>
void each_place(const Real* x, const Real* y, const Real* z, int64_t n, const Body& body) {
  // What is no number is at 0 too: no row outside the table.
  const auto inside = [](Real p) { return p > 0 ? p : 0.0_r; };
  const int64_t end = round_up(n, kLane);
  for (int64_t s = 0; s < end; ++s)
    body(std::array<Real, 3>{inside(x[s]), inside(y[s]), inside(z[s])}, s);
}

// Calls body(corners, s).
template <class Body>
void each_sample(const HashGridLevel& level, const Real* x, const Real* y, const Real* z, int64_t n,
                 const Body& body) {
  const reference::GridLevel grid = reference_level(level);
  each_place(x, y, z, n,
             [&](const auto& p, int64_t s) { body(reference::grid_corners<Real>(grid, p), s); });
}

// number(i): the i-th of the table.
template <class Number>
void interpolate(const HashGridLevel& level, const Real* x, const Real* y, const Real* z, int64_t n,
                 Real* features, int64_t ld, const Number& number) {
  each_sample(level, x, y, z, n, [&](const auto& corners, int64_t s) {
    for (int f = 0; f < level.features; ++f) {
      Real sum = 0;
      for (const auto& c : corners) sum += c.weight * number(size_t{c.row} * level.features + f);
      features[f * ld + s] = sum;
    }
  });
}

template <class Number>
void differentiate(const HashGridLevel& level, const Real* x, const Real* y, const Real* z,
                   int64_t n, const Real* d_features, int64_t ld, Real* dx, Real* dy, Real* dz,
                   const Number& number) {
  const reference::GridLevel grid = reference_level(level);
  each_place(x, y, z, n, [&](const auto& p, int64_t s) {
    std::array<Real, 3> sum{};
    for (const auto& c : reference::grid_corner_slopes<Real>(grid, p)) {
      Real product = 0;
      for (int f = 0; f < level.features; ++f)
        product += number(size_t{c.row} * level.features + f) * d_features[f * ld + s];
      for (size_t i = 0; i < 3; ++i)
        if (c.weight[i] != 0) sum[i] += c.weight[i] * product;  // as the template's
    }
    dx[s] += sum[0];
    dy[s] += sum[1];
    dz[s] += sum[2];
  });
}

}  // namespace

void hash_grid_forward(const HashGridLevel& level, const Real* table, const Real* x, const Real* y,
                       const Real* z, int64_t n, Real* features, int64_t ld) {
  interpolate(level, x, y, z, n, features, ld, [&](size_t i) { return table[i]; });
}

void hash_grid_forward(const HashGridLevel& level, const uint16_t* table, const Real* x,
                       const Real* y, const Real* z, int64_t n, Real* features, int64_t ld) {
  interpolate(level, x, y, z, n, features, ld,
              [&](size_t i) { return static_cast<Real>(internal::half_to_float(table[i])); });
}

void hash_grid_backward(const HashGridLevel& level, const Real* x, const Real* y, const Real* z,
                        int64_t n, const Real* d_features, int64_t ld, Real* gradient,
                        uint8_t* marks) {
  each_sample(level, x, y, z, n, [&](const auto& corners, int64_t s) {
    bool none = true;
    for (int f = 0; f < level.features; ++f) none = none && d_features[f * ld + s] == 0;
    if (none) return;
    for (const auto& c : corners) {
      const size_t row = size_t{c.row} * static_cast<size_t>(level.features);
      for (int f = 0; f < level.features; ++f)
        gradient[row + static_cast<size_t>(f)] += c.weight * d_features[f * ld + s];
      marks[c.row] = 1;
    }
  });
}

void hash_grid_position_backward(const HashGridLevel& level, const Real* table, const Real* x,
                                 const Real* y, const Real* z, int64_t n, const Real* d_features,
                                 int64_t ld, Real* dx, Real* dy, Real* dz) {
  differentiate(level, x, y, z, n, d_features, ld, dx, dy, dz, [&](size_t i) { return table[i]; });
}

void hash_grid_position_backward(const HashGridLevel& level, const uint16_t* table, const Real* x,
                                 const Real* y, const Real* z, int64_t n, const Real* d_features,
                                 int64_t ld, Real* dx, Real* dy, Real* dz) {
  differentiate(level, x, y, z, n, d_features, ld, dx, dy, dz,
                [&](size_t i) { return static_cast<Real>(internal::half_to_float(table[i])); });
}

}  // namespace nerf
