// Closed forms of the medium on a ray, against sums of small steps.
#include "model/medium_ray.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "model/homogeneous_field.h"
#include "model/some_fog.h"

namespace nerf {
namespace {

using test::some_fog;

using internal::EngineMedium;
using internal::MediumRay;

TEST(Medium, TheMeanOverThinAndThickMatterIsExact) {
  for (const double a : {0.0, 1e-12, 1e-6, 0.01, 0.5, 3.0, 50.0, 1e4})
    for (const double m : {0.0, 1e-9, 0.02, 1.0, 7.0}) {
      double sum = 0, weight = 0;
      constexpr int kSteps = 200'000;
      for (int i = 0; i < kSteps; ++i) {
        const double s = (i + 0.5) / kSteps, w = std::exp(-a * s);
        sum += w * std::exp(-m * s);
        weight += w;
      }
      EXPECT_NEAR(internal::mean_transmittance(a, m), sum / weight, 1e-5) << a << ' ' << m;
    }
  EXPECT_EQ(internal::mean_transmittance(std::numeric_limits<double>::infinity(), 2), 1);
  EXPECT_EQ(internal::mean_transmittance(1, std::numeric_limits<double>::infinity()), 0);
}

// In a frame whose axes, unit and origin differ from the input's.
TEST(Medium, AmountsAreIntegralsOfTheDensity) {
  const Similarity to_engine = test::tilted();
  Medium height = some_fog(), box = some_fog(), both = some_fog();
  height.height = 2.5;
  height.falloff = both.falloff = 3;
  box.box = both.box = Box3{{0, -4, 0}, {7, 2, 5}};
  const Vec3d up = to_engine.rotation.transposed() * Vec3d{0, 0, 1};
  const auto density = [&](const Medium& m, const Vec3d& p) {
    if (m.box)
      for (int k = 0; k < 3; ++k)
        if (p[k] < m.box->min[k] || p[k] > m.box->max[k]) return 0.0;
    return m.falloff ? std::exp(-(dot(up, p) - m.height) / *m.falloff) : 1.0;
  };
  for (const Medium& m : {some_fog(), height, box, both})
    for (const Vec3d& d :
         {Vec3d{1, 0.2, -0.3}, Vec3d{0.1, -1, 0.8}, Vec3d{0, 0, 1}, Vec3d{1, 0, 0}}) {
      Ray ray;
      ray.origin = {-1, 0.3, 0.1};
      ray.direction = normalized(d);
      ray.medium_from = 0.25;
      ray.far = 4;
      const EngineMedium engine(m, to_engine);
      EXPECT_NEAR(engine.attenuation.y * to_engine.scale, m.attenuation.y, 1e-12);
      const MediumRay way(engine, ray);
      for (const double t : {0.1, 0.6, 2.0, 9.0}) {
        constexpr int kSteps = 100'000;
        const double length = std::max(0.0, std::min(t, ray.far) - ray.medium_from);
        double sum = 0;
        for (int i = 0; i < kSteps; ++i) {
          const double at = ray.medium_from + length * (i + 0.5) / kSteps;
          sum += density(m, to_engine.apply_inverse(ray.origin + ray.direction * at));
        }
        EXPECT_NEAR(way.amount(t), sum * length / kSteps, 1e-4 * (1 + sum * length / kSteps));
      }
    }
}

// Up for ever, down for ever and level, from anywhere: never NaN.
TEST(Medium, HeightFogWithoutAnEndIsFinite) {
  Medium m = some_fog();
  m.falloff = 0.01;
  const EngineMedium engine(m, Similarity());
  for (const double z : {-1e6, -1.0, 0.0, 1e6})
    for (const Vec3d& d : {Vec3d{0, 0, 1}, Vec3d{0, 0, -1}, Vec3d{1, 0, 0}, Vec3d{1, 0, 1e-300}}) {
      Ray ray;
      ray.origin = {0, 0, z};
      ray.direction = d;
      const MediumRay way(engine, ray);
      for (const double t : {0.0, 1.0, 1e30}) {
        const internal::Veil veil = way.before(t), part = way.before(0.5 * t, t, 0.7);
        for (int k = 0; k < 3; ++k) {
          EXPECT_TRUE(veil.through[k] >= 0 && veil.through[k] <= 1) << z << ' ' << t;
          EXPECT_TRUE(part.through[k] >= 0 && part.through[k] <= 1) << z << ' ' << t;
        }
      }
    }
}

}  // namespace
}  // namespace nerf
