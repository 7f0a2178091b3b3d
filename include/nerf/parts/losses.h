// Losses on the light weights along one ray, or on its densities, with their gradients. A histogram
// has n bins between n + 1 sorted edges in normalised distance s in [0, 1], and a weight for each
// bin.
#pragma once

#include <span>

#include "nerf/base/real.h"

namespace nerf {

// Barron et al. 2022, equation 15: draws the weights of a ray together. Adds scale times the
// gradient to d_weights and returns scale times the loss. O(n).
double distortion_loss(std::span<const Real> edges, std::span<const Real> weights, Real scale,
                       std::span<Real> d_weights);

// The same for n intervals in order that may leave gaps: the middle and the width of each.
double distortion_loss(std::span<const Real> middles, std::span<const Real> widths,
                       std::span<const Real> weights, Real scale, std::span<Real> d_weights);

// Where a distance from the camera, in engine units, stands in inverse distance: 0 at the camera, 1
// at infinity.
inline Real inverse_place(Real distance) { return 1 - 1 / (1 + distance); }

// How far the light of a ray is from where it should end: sum_i w_i c(m_i) + (1 - sum_i w_i) c(1),
// where c(m) = max(0, |m - depth| - tolerance); what passes all n intervals counts as at 1. This is
// the 1-Wasserstein (earth mover's) distance of the distribution of the light to that place, but
// for the tolerance, kDepthTolerance of the distance d where m = 1 - 1 / (1 + d). Linear in the
// weights: light is drawn there from both sides, and none may stand before and behind it to be
// right in the mean. Adds scale times the gradient to d_weights and returns scale times the loss.
// O(n).
inline constexpr double kDepthTolerance = 0.01;
double depth_loss(std::span<const Real> middles, std::span<const Real> weights, Real depth,
                  Real scale, std::span<Real> d_weights);

// Barron et al. 2022, equation 13: a proposal's weights must bound those of the final histogram
// from above; the final ones pass no gradient. Adds scale times the gradient with respect to the
// proposal's weights to d_proposal and returns scale times the loss, summed over the final bins.
// O(n + m).
double interlevel_loss(std::span<const Real> edges, std::span<const Real> weights,
                       std::span<const Real> proposal_edges, std::span<const Real> proposal_weights,
                       Real scale, std::span<Real> d_proposal);

// How much matter is on a ray: tau / (1 + tau), tau = sum_i density_i delta_i being its optical
// depth. Like its opacity, 1 - exp(-tau), this is tau where matter is thin, and next to flat where
// it is solid; but where a fog fills the ray, and opacity is flat as well, it still has a slope.
// Writes scale times the gradient to d_densities and returns scale times the loss. O(n).
double matter_loss(std::span<const Real> densities, std::span<const Real> deltas, Real scale,
                   std::span<Real> d_densities);

// Added to a weight that is divided by (multinerf's lossfun_outer: the float's epsilon).
inline constexpr Real kInterlevelEpsilon = 0x1p-23_r;

}  // namespace nerf
