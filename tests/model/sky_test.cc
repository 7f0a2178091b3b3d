// What rays see of a sky, beside the network worked out in double.
#include "model/sky.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "math/worst_error.h"
#include "model/coded_fields.h"
#include "nerf/math/reference/spherical_harmonics.h"
#include "nerf/model/integrator.h"

namespace nerf {
namespace {

// sigmoid of the network of directions and code, its hidden layers with ReLU.
std::array<double, 3> sky_of(const GridField& field, const Vec3d& d,
                             const std::vector<Real>& code) {
  const auto harmonics = reference::spherical_harmonics(d.x, d.y, d.z);
  std::vector<double> x(harmonics.begin(), harmonics.end());
  x.insert(x.end(), code.begin(), code.end());
  for (size_t l = 0; l < field.sky_layers.size(); ++l) {
    const LinearWeights& w = field.sky_layers[l];
    std::vector<double> y(static_cast<size_t>(w.out));
    for (size_t o = 0; o < y.size(); ++o)
      for (size_t i = 0; i < x.size(); ++i)
        y[o] += static_cast<double>(
                    field.weights[w.offset + o * static_cast<size_t>(weight_stride(w.in)) + i]) *
                x[i];
    if (l + 1 < field.sky_layers.size())
      for (double& v : y) v = std::max(v, 0.0);
    x = y;
  }
  std::array<double, 3> rgb{};
  for (size_t k = 0; k < 3; ++k) rgb[k] = 1 / (1 + std::exp(-x[k]));
  return rgb;
}

std::vector<Ray> some_rays() {
  std::vector<Ray> rays(600);  // more than a block
  for (size_t i = 0; i < rays.size(); ++i) {
    const double a = 0.01 * static_cast<double>(i);
    rays[i].origin = {0.5 * std::sin(3 * a), 0.1, -2};
    rays[i].direction = normalized(Vec3d{0.3 * std::sin(a), 0.4 * std::cos(2 * a), 1});
  }
  return rays;
}

TEST(SkyLight, IsWhatIsLeftOfTheLightTimesTheNetwork) {
  const RadianceField field = test::grid_with_codes(/*sky=*/true);
  const auto rays = some_rays();
  ThreadPool pool(2);
  RenderOptions with, without;
  with.precision = without.precision = Precision::kF32;
  with.appearance.code = without.appearance.code = {0.5_r, -1, 0, 1, 0.25_r, -0.5_r};
  without.sky = false;
  const RayResults a = integrate(field, rays, {}, with, pool);
  const RayResults b = integrate(field, rays, {}, without, pool);
  WorstError worst("sky");
  for (size_t i = 0; i < rays.size(); ++i) {
    ASSERT_EQ(a.opacity[i], 1);
    const auto sky = sky_of(field.grid(), rays[i].direction, with.appearance.code);
    const double left = 1 - static_cast<double>(b.opacity[i]);
    for (size_t k = 0; k < 3; ++k)
      // Three layers of at most 32 products each, of numbers up to a few units.
      worst.compare(a.rgb[3 * i + k], static_cast<double>(b.rgb[3 * i + k]) + left * sky[k],
                    40 * kRoundoff, "ray", i, "channel", k);
  }
  worst.report();
  EXPECT_LT(*std::ranges::min_element(b.opacity), 0.9_r) << "something is left";
}

TEST(SkyLight, IsNotSeenByRaysThatEndBeforeIt) {
  const RadianceField field = test::grid_with_codes(/*sky=*/true);
  std::vector<Ray> rays = some_rays();
  ThreadPool pool(2);
  RenderOptions options, without;
  without.sky = false;
  for (Ray& ray : rays) ray.end_on(1.5, {0, 0, 1});
  const RayResults a = integrate(field, rays, {}, options, pool);
  const RayResults b = integrate(field, rays, {}, without, pool);
  EXPECT_EQ(a.rgb, b.rgb);
  EXPECT_EQ(a.opacity, b.opacity);
  // A clear medium of the options changes neither.
  options.medium.emplace();
  EXPECT_EQ(integrate(field, rays, {}, options, pool).rgb, b.rgb);
}

TEST(SkyLight, IsSeenThroughAMedium) {
  const RadianceField field = test::grid_with_codes(/*sky=*/true);
  const auto rays = some_rays();
  ThreadPool pool(2);
  RenderOptions clear, fog;
  clear.precision = fog.precision = Precision::kF32;
  // Of a box beside the scene's cells: all light from behind passes it.
  fog.medium = Medium{.attenuation = {0.5, 0.25, 0.125}, .colour = {0, 0, 0}};
  fog.medium->box = Box3{{-9, -9, -9}, {9, 9, -1.9_r}};
  fog.medium->backscatter = fog.medium->attenuation;
  const RayResults a = integrate(field, rays, {}, clear, pool);
  const RayResults b = integrate(field, rays, {}, fog, pool);
  for (size_t i = 0; i < rays.size(); ++i) {
    const double length = 0.1 / rays[i].direction.z;
    for (size_t k = 0; k < 3; ++k) {
      const double through = std::exp(-fog.medium->attenuation[static_cast<int>(k)] * length);
      ASSERT_NEAR(b.rgb[3 * i + k], through * a.rgb[3 * i + k], 1e-5) << i;
    }
    ASSERT_EQ(b.opacity[i], 1);
  }
}

}  // namespace
}  // namespace nerf
