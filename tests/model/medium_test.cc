// Fields seen through a medium: the closed forms of the volume rendering equation, and a float64
// quadrature of it for media and fields that have none.
#include "nerf/model/medium.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <memory>
#include <vector>

#include "model/analytic_field.h"
#include "model/exact_options.h"
#include "model/homogeneous_field.h"
#include "model/medium_ray.h"
#include "model/some_fog.h"
#include "model/some_info.h"
#include "nerf/base/error.h"
#include "nerf/geometry/object.h"
#include "nerf/math/srgb.h"
#include "nerf/model/insertion.h"
#include "nerf/model/integrator.h"
#include "nerf/model/network_field.h"
#include "support/cameras.h"
#include "support/network_options.h"

namespace nerf {
namespace {

using test::some_fog;

using test::exact_options;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

// From x = -3 along x, through what is between -1 and 1.
Ray along_x() {
  Ray ray;
  ray.origin = {-3, 0.1, -0.2};
  ray.direction = {1, 0, 0};
  ray.background = {0.1_r, 0.5_r, 0.9_r};
  return ray;
}

// Of a medium and matter of one colour, by 200 000 steps in double: the light that reaches the
// ray's origin from [0, far], in front of a background.
Vec3d quadrature(const Medium& m, const std::function<double(double)>& medium_density,
                 const std::function<double(double)>& field_density, double far,
                 const Vec3& background) {
  constexpr int kSteps = 200'000;
  const double step = far / kSteps;
  Vec3d sum;
  for (int k = 0; k < 3; ++k) {
    const double sigma = m.attenuation[k], own = static_cast<double>(m.colour[k]);
    double left = 1;
    for (int i = 0; i < kSteps; ++i) {
      const double t = (i + 0.5) * step;
      const double a = field_density(t), b = sigma * medium_density(t), all = a + b;
      if (!(all > 0)) continue;
      const double stopped = left * -std::expm1(-all * step);
      sum[k] += stopped * (a * 0.5 + b * own) / all;
      left -= stopped;
    }
    sum[k] += left * static_cast<double>(background[k]);
  }
  return sum;
}

// Closed form: matter of density 1 between 2 and 4, colour 0.5, in fog everywhere, a background at
// 6. However few samples there are.
TEST(Medium, HomogeneousFogAndMatterAreExactForAnyNumberOfSamples) {
  const RadianceField field = test::homogeneous_field(Similarity());
  ThreadPool pool(2);
  Ray ray = along_x();
  ray.far = 6;
  RenderOptions options = exact_options();
  options.medium = some_fog();
  for (const int samples : {0, 64, 7, 2}) {
    SCOPED_TRACE(samples);
    if (samples > 0) {  // of those that follow the cached density
      options.unclipped = false;
      options.max_samples = samples;
      options.sample_factor = samples == 64 ? 4 : 0.01_r;
    }
    const RayResults r = integrate(field, std::vector{ray}, {.samples = true}, options, pool);
    double mean_left = 0;
    for (int k = 0; k < 3; ++k) {
      const double s = options.medium->attenuation[k];
      const double c = static_cast<double>(options.medium->colour[k]);
      const double matter = (1 * 0.5 + s * c) / (1 + s) * -std::expm1(-2 * (1 + s));
      const double left = std::exp(-6 * s - 2);
      const double truth = c * -std::expm1(-2 * s) + std::exp(-2 * s) * matter +
                           std::exp(-4 * s - 2) * c * -std::expm1(-2 * s) +
                           left * static_cast<double>(ray.background[k]);
      mean_left += left / 3;
      EXPECT_NEAR(r.rgb[static_cast<size_t>(k)], truth, 2e-5) << r.samples[0];
    }
    EXPECT_NEAR(r.opacity[0], 1 - mean_left, 1e-5);
  }
}

TEST(Medium, HeightBoxAndHomogeneousMediaAgreeWithAFloat64Quadrature) {
  const RadianceField field = test::homogeneous_field(Similarity());
  ThreadPool pool(2);
  Ray ray = along_x();
  ray.direction = normalized(Vec3d{1, 0.1, 0.25});
  ray.far = 5;
  Medium height = some_fog(), box = some_fog(), both = some_fog();
  height.height = 0.2;
  height.falloff = both.falloff = 0.4;
  // From before the matter into it.
  box.box = both.box = Box3{{-1.6, -9, -9}, {0.33, 9, 9}};
  const auto inside = [&](double t) {
    const Vec3d p = ray.origin + ray.direction * t;
    return std::fabs(p.x) < 1 && std::fabs(p.y) < 1 && std::fabs(p.z) < 1 ? 1.0 : 0.0;
  };
  for (const Medium& m : {some_fog(), height, box, both}) {
    const auto density = [&](double t) {
      const Vec3d p = ray.origin + ray.direction * t;
      if (m.box && !(p.x > m.box->min.x && p.x < m.box->max.x)) return 0.0;
      return m.falloff ? std::exp(-(p.z - m.height) / *m.falloff) : 1.0;
    };
    RenderOptions options = exact_options();
    options.medium = m;
    const RayResults r = integrate(field, std::vector{ray}, {}, options, pool);
    const Vec3d truth = quadrature(m, density, inside, ray.far, ray.background);
    for (int k = 0; k < 3; ++k) EXPECT_NEAR(r.rgb[static_cast<size_t>(k)], truth[k], 1e-4) << k;
  }
}

// A wall at distance d:  colour (1 - exp(-sigma d)) + wall exp(-sigma d), in pictures, by usual
// options, in another unit.
TEST(Medium, AWallInFogHasItsClosedForm) {
  Similarity to_engine;
  to_engine.scale = 0.5;
  const RadianceField field =
      test::surface_field(to_engine, [](const Vec3d& p) { return 0.3 - p.z; });
  ThreadPool pool(2);
  Pose pose;
  pose.translation = {0, 0, -4};  // the wall's plane is at 0.6
  RenderOptions options;
  options.medium = some_fog();
  options.precision = Precision::kF32;
  const Frame f = render(field, test::pinhole(9, 9, 40), pose, options, pool);
  for (size_t p = 0; p < f.alpha.size(); ++p) {
    const double x = (static_cast<double>(p % 9) - 4) / 40,
                 y = (static_cast<double>(p / 9) - 4) / 40;
    const double d = 4.6 * std::sqrt(1 + x * x + y * y);
    for (int k = 0; k < 3; ++k) {
      const double left = std::exp(-options.medium->attenuation[k] * d);
      const double c = static_cast<double>(options.medium->colour[k]);
      EXPECT_NEAR(f.rgb[3 * p + static_cast<size_t>(k)], c * (1 - left) + left * 0.5, 1e-3);
    }
    EXPECT_NEAR(f.depth_z[p], 4.6, 0.02) << "depth is the field's";
  }
}

// Through water light from the wall and light of the water are lost at rates of their own.
TEST(Medium, AttenuationAndBackscatterMayDiffer) {
  const RadianceField field = test::homogeneous_field(Similarity());
  ThreadPool pool(1);
  Ray ray = along_x();
  ray.far = 1.5;  // before the matter
  RenderOptions options = exact_options();
  options.medium = some_fog();
  options.medium->backscatter = {0.1, 0.2, 2};
  const RayResults r = integrate(field, std::vector{ray}, {}, options, pool);
  for (int k = 0; k < 3; ++k) {
    const double a = options.medium->attenuation[k], b = options.medium->backscatter[k];
    EXPECT_NEAR(r.rgb[static_cast<size_t>(k)],
                std::exp(-1.5 * a) * static_cast<double>(ray.background[k]) -
                    std::expm1(-1.5 * b) * static_cast<double>(options.medium->colour[k]),
                1e-6);
  }
}

TEST(Medium, ANetworksFieldIsSeenThroughItToo) {
  NetworkOptions o = test::small_network(test::mipnerf_options());
  o.density_bias = 1;
  o.sampling.coarse = o.sampling.fine = 16;
  auto network = std::make_shared<NetworkField>(o, 0.5, 5);  // all weights are 0
  const RadianceField field(test::some_info(), network);
  ThreadPool pool(1);
  Ray ray = along_x();
  ray.far = 7;
  RenderOptions options = exact_options();
  options.medium = some_fog();
  const RayResults r = integrate(field, std::vector{ray}, {.deep = true}, options, pool);
  const double density = std::log1p(std::exp(1.0));
  const Vec3d truth = quadrature(
      some_fog(), [](double) { return 1.0; },
      [&](double t) { return t > 0.5 && t < 5 ? density : 0.0; }, 7, ray.background);
  for (size_t k = 0; k < 3; ++k) {
    EXPECT_NEAR(r.rgb[k], truth[static_cast<int>(k)], 2e-4);
    double deep = 0;
    for (const DeepSample& s : r.deep[0]) deep += static_cast<double>(s.rgb[k]);
    EXPECT_NEAR(r.rgb[k], deep, 0.01);
  }
}

// Deep samples stand behind their haze: together, and with what shows behind them, they are the
// pixel.
TEST(Medium, DeepSamplesAddUpToThePixel) {
  const RadianceField field = test::homogeneous_field(Similarity());
  ThreadPool pool(1);
  RenderOptions options = exact_options();
  options.medium = some_fog();
  const RayResults r = integrate(field, std::vector{along_x()}, {.deep = true}, options, pool);
  const double left = std::exp(-2.0);
  for (size_t k = 0; k < 3; ++k) {
    double sum = left * static_cast<double>(options.medium->colour[static_cast<int>(k)]);
    for (const DeepSample& s : r.deep[0]) sum += static_cast<double>(s.rgb[k]);
    EXPECT_NEAR(r.rgb[k], sum, 1e-4);
  }
}

TEST(Medium, OneThatIsEmptyChangesNoBit) {
  const RadianceField field = test::homogeneous_field(test::tilted());
  ThreadPool pool(2);
  Pose pose;
  pose.translation = {3, -1, -10};
  RenderOptions without;
  RenderOptions with = without;
  with.medium = some_fog();
  with.medium->attenuation = with.medium->backscatter = {};
  with.medium->falloff = 2;
  with.medium->box = Box3{{-1, -1, -1}, {1, 1, 1}};
  const Frame a = render(field, test::pinhole(20, 20, 20), pose, without, pool);
  const Frame b = render(field, test::pinhole(20, 20, 20), pose, with, pool);
  EXPECT_EQ(a.rgb, b.rgb);
  EXPECT_EQ(a.alpha, b.alpha);
  EXPECT_EQ(a.depth_z, b.depth_z);
}

TEST(Medium, OneAndTwoThreadsGiveTheSameBits) {
  const RadianceField field = test::homogeneous_field(test::tilted());
  ThreadPool one(1), two(2);
  Pose pose;
  pose.translation = {3, -1, -10};
  RenderOptions options;
  options.medium = some_fog();
  options.medium->falloff = 2;
  options.medium->box = Box3{{-4, -4, -4}, {4, 4, 4}};
  const Frame a = render(field, test::pinhole(40, 40, 40), pose, options, one);
  const Frame b = render(field, test::pinhole(40, 40, 40), pose, options, two);
  EXPECT_EQ(a.rgb, b.rgb);
  EXPECT_EQ(a.alpha, b.alpha);
}

SceneObject screen(Real x, double alpha) {
  SceneObject object;
  Material m;
  m.base = srgb_to_linear(Vec3d{0.2, 0.4, 0.9});
  m.alpha = alpha;
  m.alpha_mode = AlphaMode::kBlend;
  m.double_sided = m.unlit = true;
  object.materials = {m};
  object.mesh.positions = {{x, -3, -3}, {x, 3, -3}, {x, 3, 3}, {x, -3, 3}};
  object.mesh.triangles = {{0, 1, 2}, {0, 2, 3}};
  object.material = {0, 0};
  return object;
}

// A screen at distance 3.4, half of whose light comes from behind it: field, medium and screen
// attenuate each other.
TEST(Medium, InsertedObjectsStandInIt) {
  const RadianceField field = test::homogeneous_field(Similarity());
  ThreadPool pool(2);
  RenderOptions options = exact_options();
  options.medium = some_fog();
  Pose pose;
  pose.rotation.m = {{{0, 0, 1}, {-1, 0, 0}, {0, -1, 0}}};
  pose.translation = {-3, 0, 0};
  InsertionOptions unshadowed;
  unshadowed.shadows = false;
  for (const double alpha : {1.0, 0.5}) {
    SCOPED_TRACE(alpha);
    const Insertion object(field, screen(0.4_r, alpha), unshadowed, options, pool);
    const Frame f =
        render(field, test::pinhole(9, 9, 200), pose, options, pool, {}, nullptr, &object);
    const auto everywhere = [](double) { return 1.0; };
    const Vec3d behind = quadrature(
        some_fog(), everywhere, [](double t) { return t < 0.6 ? 1.0 : 0.0; }, 60, Vec3());
    Vec3 back;
    const double own[3] = {0.2, 0.4, 0.9};
    for (int k = 0; k < 3; ++k)
      back[k] = static_cast<Real>(alpha * own[k] + (1 - alpha) * behind[k]);
    const Vec3d truth =
        quadrature(some_fog(), everywhere, [](double t) { return t > 2 ? 1.0 : 0.0; }, 3.4, back);
    for (int k = 0; k < 3; ++k)
      EXPECT_NEAR(f.rgb[3 * (f.alpha.size() / 2) + static_cast<size_t>(k)], truth[k], 5e-4);
  }
}

TEST(Medium, NumbersThatCannotBeAreErrors) {
  EXPECT_NO_THROW(check_medium(some_fog(), "test"));
  const auto refused = [](const std::function<void(Medium&)>& change) {
    Medium m = some_fog();
    change(m);
    EXPECT_THROW(check_medium(m, "test"), Error);
  };
  refused([](Medium& m) { m.attenuation.y = -0.1; });
  refused([](Medium& m) { m.backscatter.z = kNan; });
  refused([](Medium& m) { m.attenuation.x = std::numeric_limits<double>::infinity(); });
  refused([](Medium& m) { m.colour.x = 1.5_r; });
  refused([](Medium& m) { m.colour.z = static_cast<Real>(kNan); });
  refused([](Medium& m) { m.height = kNan; });
  refused([](Medium& m) { m.falloff = 0; });
  refused([](Medium& m) { m.box = Box3{{0, 0, 1}, {1, 1, 0}}; });
  refused([](Medium& m) { m.box = Box3{{0, 0, 0}, {1, 1, kNan}}; });
  const RadianceField field = test::homogeneous_field(Similarity());
  ThreadPool pool(1);
  RenderOptions options;
  options.medium = some_fog();
  options.medium->attenuation.x = -1;
  EXPECT_THROW(integrate(field, std::vector{along_x()}, {}, options, pool), Error);
}

}  // namespace
}  // namespace nerf
