// Pixels as a function of the code alone: those that the integral along the rays has.
#include "model/coded_rays.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "model/coded_fields.h"
#include "model/some_info.h"
#include "nerf/model/integrator.h"
#include "nerf/model/network_field.h"
#include "nerf/model/radiance_field.h"
#include "support/network_options.h"

namespace nerf {
namespace {

TEST(CodedRays, AreThePixelsOfTheIntegral) {
  for (NetworkOptions o : {test::nerf_options(), test::mipnerf_options(), test::nerfw_options()}) {
    o = test::small_network(o);
    o.image_code = 3;
    o.density_bias = 1;
    auto network = std::make_shared<NetworkField>(o, 1.0, 5.0, std::vector<std::string>{"a", "b"});
    network->initialise(3);
    const RadianceField field(test::some_info(), network);
    std::vector<Ray> rays;
    for (int i = 0; i < 150; ++i) {
      Ray ray;
      ray.origin = {0, 0, 3};
      ray.direction = normalized(Vec3d{0.004 * i - 0.3, 0.1, -1});
      ray.radius = 0.001_r;
      ray.background = {1, 0.5_r, 0};
      rays.push_back(ray);
    }
    ThreadPool pool(2);
    RenderOptions options;
    options.precision = Precision::kF32;
    options.unclipped = true;
    const auto coded = internal::coded_rays(field, rays, options, pool, nullptr);
    for (const Real x : {-2.0_r, 0.0_r, 2.0_r}) {
      options.appearance.code = {x, 1, -x};
      const auto want = integrate(field, rays, {}, options, pool).rgb;
      const auto got = coded->pixels(options.appearance.code);
      ASSERT_EQ(got.size(), want.size());
      Real most = 0;
      for (size_t i = 0; i < got.size(); ++i) most = std::max(most, std::abs(got[i] - want[i]));
      // Samples of less than 1/512 of the light are left out, at most 16 of them.
      EXPECT_LT(most, 0.03_r) << x;
    }
  }
}

// A sum of the same products in another order.
void expect_pixels_of_the_integral(bool sky) {
  const RadianceField field = test::grid_with_codes(sky);
  std::vector<Ray> rays(700);
  for (size_t i = 0; i < rays.size(); ++i) {
    const double a = 0.001 * static_cast<double>(i) - 0.35;
    rays[i].origin = {a, 0.1, -2};
    rays[i].direction = normalized(Vec3d{0.3 * a, a, 1});
    rays[i].background = {1, 0.5_r, 0};
  }
  ThreadPool pool(2), one(1);
  RenderOptions options;
  options.precision = Precision::kF32;
  const auto coded = internal::coded_rays(field, rays, options, pool, nullptr);
  const auto alone = internal::coded_rays(field, rays, options, one, nullptr);
  for (const std::vector<Real>& code :
       {std::vector<Real>{}, {-0.5_r, 0, 1, 0, 0.5_r, -1}, {2, -2, 1, 0, 0.5_r, 1}}) {
    options.appearance.code = code;
    const RayResults want = integrate(field, rays, {}, options, pool);
    const auto got = coded->pixels(code);
    EXPECT_EQ(got, alone->pixels(code));
    ASSERT_EQ(got.size(), want.rgb.size());
    for (size_t i = 0; i < got.size(); ++i) ASSERT_NEAR(got[i], want.rgb[i], 3e-6) << i;
    EXPECT_GT(*std::ranges::max_element(want.opacity), 0.3_r);
    EXPECT_EQ(*std::ranges::min_element(want.opacity) == 1, sky);
  }
}

TEST(CodedRays, OfATableAreThePixelsOfTheIntegral) { expect_pixels_of_the_integral(false); }
TEST(CodedRays, OfATableSeeTheSky) { expect_pixels_of_the_integral(true); }

}  // namespace
}  // namespace nerf
