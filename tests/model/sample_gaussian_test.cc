// The Gaussian of a sample, warped and projected, against whole covariance matrices in double and
// against draws.
#include "model/sample_gaussian.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "nerf/math/random.h"
#include "support/network_options.h"

namespace nerf {
namespace {

using internal::place_gaussian;

double number_in(Random& random, double low, double high) {
  return low + (high - low) * static_cast<double>(random.uniform());
}

// Of a ray whose direction is not of unit length, as in normalised device coordinates.
NetworkRay some_ray(Random& random, double length_of_direction) {
  NetworkRay ray;
  for (int k = 0; k < 3; ++k) ray.origin[k] = static_cast<Real>(number_in(random, -1, 1));
  Vec3d d{number_in(random, -1, 1), number_in(random, -1, 1), number_in(random, -1, 1)};
  d = normalized(d) * length_of_direction;
  ray.direction = d.cast<Real>();
  ray.length = static_cast<Real>(length_of_direction);
  ray.radius = static_cast<Real>(number_in(random, 0.01, 0.1));
  return ray;
}

Vec3d contracted(const Vec3d& x) {
  const double r = length(x);
  return r <= 1 ? x : x * ((2 - 1 / r) / r);
}

struct Projected {
  double mean = 0, variance = 0;
};

// p^T J S J^T p with S = t_var d d^T + r_var (I - d d^T / |d|^2) (mip-NeRF, equation 16) and J the
// warp's derivative by central differences.
Projected by_matrices(const NetworkOptions& o, const NetworkRay& ray, double t0, double t1,
                      const Vec3d& p) {
  const auto g = o.space == Space::kNdc ? cylinder_gaussian(t0, t1, static_cast<double>(ray.radius))
                                        : cone_gaussian(t0, t1, static_cast<double>(ray.radius));
  const Vec3d d = ray.direction.cast<double>();
  const Vec3d mean = ray.origin.cast<double>() + d * g.t_mean;
  Vec3d jp;  // J^T p
  constexpr double kStep = 1e-6;
  for (int k = 0; k < 3; ++k) {
    if (o.space != Space::kContract) {
      jp[k] = p[k];
      continue;
    }
    Vec3d step;
    step[k] = kStep;
    jp[k] = dot(p, contracted(mean + step) - contracted(mean - step)) / (2 * kStep);
  }
  double variance = 0;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) {
      const double s = g.t_variance * d[i] * d[j] +
                       g.r_variance * ((i == j ? 1.0 : 0.0) - d[i] * d[j] / dot(d, d));
      variance += jp[i] * s * jp[j];
    }
  return {dot(p, o.space == Space::kContract ? contracted(mean) : mean), variance};
}

std::vector<Projected> placed(const NetworkOptions& o, const NetworkRay& ray, double t0, double t1,
                              const std::vector<Vec3>& axes) {
  std::vector<Real> position(axes.size()), variance(axes.size());
  place_gaussian(o, axes, ray, static_cast<Real>(t0), static_cast<Real>(t1), position.data(),
                 variance.data(), 1);
  std::vector<Projected> out;
  for (size_t k = 0; k < axes.size(); ++k)
    out.push_back({static_cast<double>(position[k]), static_cast<double>(variance[k])});
  return out;
}

std::vector<Vec3> some_axes(Random& random) {
  std::vector<Vec3> axes{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  for (int i = 0; i < 5; ++i)
    axes.push_back(normalized(Vec3d{number_in(random, -1, 1), number_in(random, -1, 1),
                                    number_in(random, -1, 1)})
                       .cast<Real>());
  return axes;
}

TEST(SampleGaussian, IsTheProjectedCovariance) {
  NetworkOptions cone = test::mipnerf_options(), cylinder = cone;
  cylinder.space = Space::kNdc;
  for (uint64_t i = 0; i < 60; ++i) {
    Random random(5, 0, i);
    const auto axes = some_axes(random);
    for (const NetworkOptions& o : {cone, cylinder, test::mipnerf360_options()}) {
      const NetworkRay ray = some_ray(random, o.space == Space::kNdc ? 1.7 : 1.0);
      const double t0 = number_in(random, 0.1, 4), t1 = t0 + number_in(random, 0.05, 2);
      const auto got = placed(o, ray, t0, t1, axes);
      for (size_t k = 0; k < axes.size(); ++k) {
        const auto want = by_matrices(o, ray, t0, t1, axes[k].cast<double>());
        EXPECT_NEAR(got[k].mean, want.mean, 3e-6 * (1 + t1)) << "ray " << i << " axis " << k;
        // Roundings of the largest variance along any axis; differences leave 1e-9 of the slope.
        const double largest = std::pow(t1 * 1.7, 2);
        EXPECT_NEAR(got[k].variance, want.variance, 1e-6 * largest) << "ray " << i << " axis " << k;
      }
    }
  }
}

// Draws from the narrow Gaussian of a cone, each point contracted: the mean and the variance of the
// images are the linear ones within 3 standard errors, the curvature being far below them.
TEST(SampleGaussian, ContractionByDrawing) {
  const NetworkOptions o = test::mipnerf360_options();
  constexpr int kDraws = 200000;
  for (uint64_t i = 0; i < 3; ++i) {
    Random random(6, 0, i);
    NetworkRay ray = some_ray(random, 1);
    ray.radius = 2e-4_r;
    const double t0 = 3 + static_cast<double>(i), t1 = t0 + 2e-3;
    const std::vector<Vec3> axes = some_axes(random);
    const auto want = placed(o, ray, t0, t1, axes);
    const auto g = cone_gaussian(t0, t1, static_cast<double>(ray.radius));
    const Vec3d d = ray.direction.cast<double>();
    const Vec3d u = normalized(cross(d, Vec3d{0.3, 0.5, -0.8})), v = cross(d, u);
    std::vector<double> sum(axes.size()), square(axes.size());
    const auto normal = [&] {
      const double a = 1 - static_cast<double>(random.uniform());
      return std::sqrt(-2 * std::log(a)) * std::cos(number_in(random, 0, 6.283185307179586));
    };
    for (int n = 0; n < kDraws; ++n) {
      const Vec3d x =
          ray.origin.cast<double>() + d * (g.t_mean + std::sqrt(g.t_variance) * normal()) +
          u * (std::sqrt(g.r_variance) * normal()) + v * (std::sqrt(g.r_variance) * normal());
      const Vec3d y = contracted(x);
      for (size_t k = 0; k < axes.size(); ++k) {
        const double e = dot(axes[k].cast<double>(), y) - want[k].mean;
        sum[k] += e;
        square[k] += e * e;
      }
    }
    for (size_t k = 0; k < axes.size(); ++k) {
      const double mean = sum[k] / kDraws, variance = square[k] / kDraws - mean * mean;
      // The mean itself is rounded to a float.
      EXPECT_NEAR(mean, 0, 3 * std::sqrt(variance / kDraws) + 3e-7) << i << " axis " << k;
      EXPECT_NEAR(variance, want[k].variance, 3 * variance * std::sqrt(2.0 / kDraws))
          << i << " axis " << k;
    }
  }
}

}  // namespace
}  // namespace nerf
