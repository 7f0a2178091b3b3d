// Specification of Russian roulette on gradients (kernels/roulette.h; Arvo and Kirk 1990, "Particle
// transport and image synthesis").
#pragma once

#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

#include "nerf/math/reference/scalar.h"

namespace nerf::reference {

// Sum of magnitudes of a column.
template <class T>
T column_norm(const std::vector<T>& column) {
  T sum(0);
  for (const T& v : column) sum += real_part(v) < 0 ? -v : v;
  return sum;
}

// What a column's norm is measured by: `least` times the mean of all, 0 where that is not finite.
template <class T>
T roulette_bound(const std::vector<T>& norms, double least) {
  T sum(0);
  for (const T& norm : norms) sum += norm;
  const T bound = T(least) * sum / T(static_cast<double>(norms.size()));
  return std::isfinite(static_cast<double>(real_part(bound))) ? bound : T(0);
}

// A chance below this is none: its inverse is to be a float yet.
inline constexpr double kLeastChance = 1e-30;

// The chance that a column is kept: 1 from the bound on and where the norm is no number, 0 of a
// column of zeros, below the bound the norm's share in it.
template <class T>
T chance(T norm, T bound) {
  if (real_part(norm) == 0) return T(0);
  if (!(real_part(norm) < real_part(bound))) return T(1);
  return norm / bound;
}

// What a column that is kept is multiplied by, so that its expectation is what it was.
template <class T>
T factor(T norm, T bound) {
  return T(1) / chance(norm, bound);
}

// The columns that are kept, in ascending order. The draw is systematic: chances below 1 are laid
// end to end from `offset` on, in [0, 1), and a column is kept where its stretch ends in another
// whole number than it begins in.
template <class T>
std::vector<size_t> kept_columns(const std::vector<T>& norms, double least, double offset) {
  const T bound = roulette_bound(norms, least);
  std::vector<size_t> kept;
  double at = offset;
  for (size_t i = 0; i < norms.size(); ++i) {
    const double p = static_cast<double>(real_part(chance(norms[i], bound)));
    const double before = std::floor(at);
    const bool drawn = real_part(norms[i]) < real_part(bound);
    if (drawn) at += p;
    if (p >= kLeastChance && (!drawn || std::floor(at) > before)) kept.push_back(i);
  }
  return kept;
}

}  // namespace nerf::reference
