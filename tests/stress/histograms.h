// Histograms that could come from the worst levels of a ray: positions that coincide, bins without
// width, weights that are 0, alone, huge or denormal.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

#include "nerf/base/real.h"

namespace nerf::stress {

// Levels of n >= 1 entries from `low` to `high`, sorted.
inline std::vector<std::vector<Real>> levels_before(size_t n, Real low, Real high) {
  std::vector<std::vector<Real>> out;
  const auto at = [&](size_t i) {
    return low +
           (high - low) * static_cast<Real>(i) / static_cast<Real>(std::max<size_t>(n, 2) - 1);
  };
  std::vector<Real> level(n);
  for (const Real all : {low, high, (low + high) / 2}) {  // all of them at one place
    std::fill(level.begin(), level.end(), all);
    out.push_back(level);
  }
  for (size_t i = 0; i < n; ++i) level[i] = at(i / 2 * 2);  // pairs
  out.push_back(level);
  for (size_t i = 0; i < n; ++i) level[i] = i < n / 2 ? low : high;  // nothing in between
  out.push_back(level);
  for (size_t i = 0; i < n; ++i)  // neighbouring numbers
    level[i] = i == 0 ? (low + high) / 2 : std::nextafter(level[i - 1], high);
  out.push_back(level);
  for (size_t i = 0; i < n; ++i) level[i] = at(i);
  if (n > 1) level[n / 2] = level[n / 2 - 1];  // one bin without width
  out.push_back(level);
  return out;
}

// Of n >= 1 bins: nothing, next to nothing, the same and far too much in every one; one spike,
// alone or among what is next to nothing.
inline std::vector<std::vector<Real>> weights_before(size_t n) {
  const Real tiny = std::numeric_limits<Real>::denorm_min();
  std::vector<std::vector<Real>> out;
  for (const Real all : {0.0_r, tiny, 1e-30_r, 1.0_r, 1e30_r})
    out.push_back(std::vector<Real>(n, all));
  for (const size_t spike : {size_t{0}, std::max<size_t>(n / 2, 1) - 1, n / 2, n - 1}) {
    std::vector<Real> weights(n, 0.0_r);
    weights[spike] = 1;
    out.push_back(weights);
    std::fill(weights.begin(), weights.end(), tiny);
    weights[spike] = 1e30_r;
    out.push_back(weights);
  }
  return out;
}

}  // namespace nerf::stress
