// Resampling of step functions on rays, as vector kernels. What they compute is specified by the
// templates of math/step_function.h, whose rules for edges, weights and empty histograms hold here.
#pragma once

#include <span>

#include "nerf/base/real.h"

namespace nerf {

// cumulative_shares(): cdf[0 .. n] of n >= 1 weights. It never falls.
void histogram_cdf(std::span<const Real> weights, std::span<Real> cdf);

// invert_sorted(): where the cdf over the edges takes the sorted values u, each in [0, 1).
void histogram_inverse(std::span<const Real> edges, std::span<const Real> cdf,
                       std::span<const Real> u, std::span<Real> out);

// anneal_weights(): weights raised to an exponent of at least 0 and normalised; one above 0 and
// below the smallest normal number may count as that. In place is allowed.
void histogram_anneal(std::span<const Real> edges, std::span<const Real> weights, Real exponent,
                      std::span<Real> out);

}  // namespace nerf
