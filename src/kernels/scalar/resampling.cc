#include "nerf/kernels/resampling.h"

#include "nerf/math/step_function.h"

namespace nerf {

void histogram_cdf(std::span<const Real> weights, std::span<Real> cdf) {
  cumulative_shares<Real>(weights, cdf);
}

void histogram_inverse(std::span<const Real> edges, std::span<const Real> cdf,
                       std::span<const Real> u, std::span<Real> out) {
  invert_sorted<Real>(edges, cdf, u, out);
}

void histogram_anneal(std::span<const Real> edges, std::span<const Real> weights, Real exponent,
                      std::span<Real> out) {
  anneal_weights<Real>(edges, weights, exponent, out);
}

}  // namespace nerf
