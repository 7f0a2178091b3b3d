// Samples that training leaves out because hardly any light depends on them
// (NetworkLosses::negligible).
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "nerf/model/network_levels.h"
#include "support/network_options.h"
#include "support/network_rays.h"

namespace nerf {
namespace {

using test::small_network;
using test::some_rays;

constexpr int kRays = 6;

NetworkField field_of(const NetworkOptions& o, Real density_bias) {
  NetworkField field(o, 0.5, 4);
  field.initialise(3);
  for (Real& w : field.weights) w *= 3;  // from next to nothing to opaque
  for (const RadianceNetwork& n : field.networks)
    field.weights[n.density.bias_offset()] = density_bias;
  return field;
}

NetworkLosses losses_with(Real negligible) {
  NetworkLosses losses;
  losses.negligible = negligible;
  return losses;
}

struct Pass {
  Pass(const NetworkField& field, const NetworkLosses& losses, bool skip)
      : levels(field, kRays, true, losses), gradient(field.weights.size()) {
    auto rays = some_rays(kRays, 2);
    levels.forward(rays, 1, skip);
    levels.backward(gradient.data());
  }
  NetworkLevels levels;
  AlignedArray<Real> gradient;
};

// The light of a sample that is left out goes to what stands behind it: at most so much of the
// pixel is another colour. What the gradient changes by depends on the weights too; without a
// sample that matters it would be as large as the gradient.
void expect_alike(const NetworkField& field, const Pass& whole, const Pass& part, double share) {
  for (int r = 0; r < kRays; ++r) {
    Real a[3], b[3], oa, ob;
    whole.levels.pixel(r, a, oa);
    part.levels.pixel(r, b, ob);
    const double most = (1 + 2 * static_cast<double>(field.options.colour_padding)) * share + 1e-5;
    for (int k = 0; k < 3; ++k) EXPECT_NEAR(a[k], b[k], most) << r;
    for (int l = 0; l < whole.levels.levels(); ++l)
      EXPECT_TRUE(std::ranges::equal(whole.levels.weights(l, r), part.levels.weights(l, r)));
  }
  double norm = 0, difference = 0;
  for (size_t i = 0; i < whole.gradient.size(); ++i) {
    norm += std::pow(static_cast<double>(whole.gradient[i]), 2);
    difference +=
        std::pow(static_cast<double>(whole.gradient[i]) - static_cast<double>(part.gradient[i]), 2);
  }
  EXPECT_GT(norm, 0);
  EXPECT_LT(std::sqrt(difference / norm), 0.01);
}

TEST(NegligibleSamples, OfASoftplusByTheirWeight) {
  const NetworkField field = field_of(small_network(test::mipnerf_options()), -1);
  constexpr double kNegligible = 1e-4;
  const Pass whole(field, losses_with(0), false);
  EXPECT_FALSE(whole.levels.can_skip());
  const Pass part(field, losses_with(kNegligible), true);
  ASSERT_TRUE(part.levels.can_skip());
  double most = 0;
  int64_t needed = 0, all = 0;
  for (int r = 0; r < kRays; ++r) {
    double left_out = 0;
    for (int l = 0; l < whole.levels.levels(); ++l)
      for (const Real w : whole.levels.weights(l, r)) {
        ++all;
        const bool is_needed = w >= static_cast<Real>(kNegligible);
        needed += is_needed;
        if (l + 1 == whole.levels.levels() && !is_needed) left_out += static_cast<double>(w);
      }
    most = std::max(most, left_out);
  }
  EXPECT_EQ(part.levels.all_samples(), all);
  EXPECT_EQ(part.levels.dense_samples(), needed);
  EXPECT_LT(needed, 0.9 * static_cast<double>(all));
  EXPECT_GT(needed, 0);
  expect_alike(field, whole, part, most);
}

// What stands behind opaque matter, whatever its density.
TEST(NegligibleSamples, OfAReluByTheLightThatReachesThem) {
  const NetworkField field = field_of(small_network(test::nerf_options()), 3);
  constexpr double kNegligible = 1e-4;
  const Pass whole(field, losses_with(0), true), part(field, losses_with(kNegligible), true);
  EXPECT_LT(part.levels.dense_samples(), 0.9 * static_cast<double>(whole.levels.dense_samples()));
  expect_alike(field, whole, part, kNegligible);
}

// A proposal whose weight is too small must be able to learn of it.
TEST(NegligibleSamples, NoneOfProposals) {
  const NetworkOptions o = small_network(test::mipnerf360_options());
  const NetworkField field = field_of(o, -1);
  NetworkLosses losses = losses_with(1e-3_r);
  losses.coarse = 0;
  losses.interlevel = 1;
  const Pass part(field, losses, true);
  EXPECT_EQ(part.levels.all_samples(), kRays * o.sampling.fine);
  EXPECT_LT(part.levels.dense_samples(), part.levels.all_samples());
}

}  // namespace
}  // namespace nerf
