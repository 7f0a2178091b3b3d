#include "nerf/math/contraction.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "golden/golden.h"
#include "math/worst_error.h"
#include "nerf/math/random.h"
#include "nerf/math/reference/contraction.h"

namespace nerf {
namespace {

// A norm (3 products, 2 sums, a root), two divisions, a difference, a product: 10 roundings, and
// the inverse about as many.
constexpr double kOps = 10;

TEST(Contraction, MatchesGoldenValues) {
  WorstError in_float("float"), in_double("double"), reference("reference");
  for (const std::vector<double>& v : golden_lines("encodings.txt", "contract")) {
    ASSERT_EQ(v.size(), 6u);
    const Vec3d d = contract(Vec3d{v[0], v[1], v[2]});
    const auto f = contract(Vec3d{v[0], v[1], v[2]}.cast<float>());
    const auto r = reference::contract<double>({v[0], v[1], v[2]});
    for (int i = 0; i < 3; ++i) {
      const double want = v[static_cast<size_t>(3 + i)];
      in_double.compare(d[i], want, kOps * 0x1p-53 * std::fabs(want), v[0], v[1], v[2], "axis", i);
      // One more rounding: that of the input.
      in_float.compare(f[i], want, rounding_bound(2 * kOps, kFloatRoundoff) * std::fabs(want), v[0],
                       v[1], v[2], "axis", i);
      reference.compare(r[static_cast<size_t>(i)], want, kOps * 0x1p-53 * std::fabs(want), v[0],
                        v[1], v[2], "axis", i);
    }
  }
  in_double.report();
  in_float.report();
  reference.report();
}

// Going back amplifies an error of z by the inverse's slope, r^2, and by as much again near the
// shell's rim, where 2 - |z| = 1 / r loses digits.
TEST(Contraction, RoundTrip) {
  WorstError worst("round_trip");
  Random random(3, 1, 4);
  for (int i = 0; i < 2000; ++i) {
    const double radius = std::pow(10.0, -3 + 6 * static_cast<double>(random.uniform()));
    Vec3d d{random.uniform() - 0.5, random.uniform() - 0.5, random.uniform() - 0.5};
    const Vec3d x = normalized(d) * radius;
    const Vec3d z = contract(x);
    EXPECT_LE(length(z), std::min(2.0, std::max(1.0, radius)) * (1 + 1e-15));
    EXPECT_LT(length(z), 2.0);
    const Vec3d back = uncontract(z);
    const auto reference = reference::uncontract<double>({z.x, z.y, z.z});
    const double tolerance = 4 * kOps * 0x1p-53 * radius * std::max(1.0, radius);
    for (int k = 0; k < 3; ++k) {
      worst.compare(back[k], x[k], tolerance, "radius", radius, "axis", k);
      worst.compare(reference[static_cast<size_t>(k)], x[k], tolerance, "reference, radius", radius,
                    "axis", k);
    }
  }
  worst.report();
}

TEST(Contraction, UnitBallStaysBitForBitAndNeighboursMeet) {
  const Vec3 inside{0.6f, -0.3f, 0.7f};
  EXPECT_EQ(contract(inside), inside);
  EXPECT_EQ(uncontract(inside), inside);
  const Vec3d just_out{1 + 1e-12, 0, 0}, just_in{1 - 1e-12, 0, 0};
  EXPECT_NEAR(contract(just_out).x, contract(just_in).x, 1e-11);
  EXPECT_NEAR(uncontract(just_out).x, uncontract(just_in).x, 1e-11);
}

}  // namespace
}  // namespace nerf
