#include "nerf/parts/losses.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "nerf/base/error.h"

namespace nerf {

namespace {

// middle(i) and width(i) of the i-th interval.
template <class Middle, class Width>
double distortion(const Middle& middle, const Width& width, std::span<const Real> weights,
                  Real scale, std::span<Real> d_weights) {
  double all = 0, all_moment = 0;
  for (size_t i = 0; i < weights.size(); ++i) {
    all += static_cast<double>(weights[i]);
    all_moment += static_cast<double>(weights[i]) * middle(i);
  }
  double loss = 0, before = 0, moment_before = 0;
  for (size_t i = 0; i < weights.size(); ++i) {
    const double w = weights[i], m = middle(i), across = width(i);
    const double behind = all - before - w, moment_behind = all_moment - moment_before - w * m;
    loss += 2 * w * (m * before - moment_before) + w * w * across / 3;
    const double slope =
        2 * (m * (before - behind) - (moment_before - moment_behind)) + 2 * w * across / 3;
    d_weights[i] += scale * static_cast<Real>(slope);
    before += w;
    moment_before += w * m;
  }
  return static_cast<double>(scale) * loss;
}

}  // namespace

double distortion_loss(std::span<const Real> edges, std::span<const Real> weights, Real scale,
                       std::span<Real> d_weights) {
  NERF_CHECK_EQ(edges.size(), weights.size() + 1);
  NERF_CHECK_EQ(d_weights.size(), weights.size());
  const auto edge = [&](size_t i) { return static_cast<double>(edges[i]); };
  return distortion([&](size_t i) { return 0.5 * (edge(i) + edge(i + 1)); },
                    [&](size_t i) { return edge(i + 1) - edge(i); }, weights, scale, d_weights);
}

double distortion_loss(std::span<const Real> middles, std::span<const Real> widths,
                       std::span<const Real> weights, Real scale, std::span<Real> d_weights) {
  NERF_CHECK_EQ(middles.size(), weights.size());
  NERF_CHECK_EQ(widths.size(), weights.size());
  NERF_CHECK_EQ(d_weights.size(), weights.size());
  return distortion([&](size_t i) { return static_cast<double>(middles[i]); },
                    [&](size_t i) { return static_cast<double>(widths[i]); }, weights, scale,
                    d_weights);
}

double depth_loss(std::span<const Real> middles, std::span<const Real> weights, Real depth,
                  Real scale, std::span<Real> d_weights) {
  NERF_CHECK_EQ(middles.size(), weights.size());
  NERF_CHECK_EQ(d_weights.size(), weights.size());
  const double end = depth;
  const double tolerance = kDepthTolerance * end * (1 - end);  // dm = m (1 - m) dd / d
  const auto cost = [&](double middle) {
    return std::max(0.0, std::abs(middle - end) - tolerance);
  };
  const double of_the_rest = cost(1);
  double loss = of_the_rest;
  for (size_t i = 0; i < weights.size(); ++i) {
    const double slope = cost(static_cast<double>(middles[i])) - of_the_rest;
    loss += static_cast<double>(weights[i]) * slope;
    d_weights[i] += scale * static_cast<Real>(slope);
  }
  return static_cast<double>(scale) * loss;
}

double matter_loss(std::span<const Real> densities, std::span<const Real> deltas, Real scale,
                   std::span<Real> d_densities) {
  NERF_CHECK_EQ(densities.size(), deltas.size());
  NERF_CHECK_EQ(densities.size(), d_densities.size());
  Real tau = 0;
  for (size_t i = 0; i < deltas.size(); ++i) tau += densities[i] * deltas[i];
  const Real share = 1 / (1 + tau);
  for (size_t i = 0; i < deltas.size(); ++i) d_densities[i] = scale * share * share * deltas[i];
  return static_cast<double>(scale) * static_cast<double>(tau * share);
}

double interlevel_loss(std::span<const Real> edges, std::span<const Real> weights,
                       std::span<const Real> proposal_edges, std::span<const Real> proposal_weights,
                       Real scale, std::span<Real> d_proposal) {
  NERF_CHECK_EQ(edges.size(), weights.size() + 1);
  NERF_CHECK_EQ(proposal_edges.size(), proposal_weights.size() + 1);
  NERF_CHECK_EQ(d_proposal.size(), proposal_weights.size());
  const size_t m = proposal_weights.size();
  // Proposal bins that overlap bin i: [first, last). Both move forward only.
  size_t first = 0, last = 0;
  double loss = 0;
  double bound = 0;  // of [first, last)
  for (size_t i = 0; i < weights.size(); ++i) {
    while (last < m && proposal_edges[last] <= edges[i + 1])
      bound += static_cast<double>(proposal_weights[last++]);
    while (first < last && !(proposal_edges[first + 1] > edges[i]))
      bound -= static_cast<double>(proposal_weights[first++]);
    const double w = weights[i];
    if (!(bound < w)) continue;
    const double over = (w - bound) / (w + static_cast<double>(kInterlevelEpsilon));
    loss += over * (w - bound);
    const Real slope = -2 * scale * static_cast<Real>(over);
    for (size_t j = first; j < last; ++j) d_proposal[j] += slope;
  }
  return static_cast<double>(scale) * loss;
}

}  // namespace nerf
