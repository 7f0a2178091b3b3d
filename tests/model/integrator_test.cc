// Rays without a camera (model/integrator.h): a medium's closed forms, and pictures' own bits.
#include "nerf/model/integrator.h"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <vector>

#include "math/worst_error.h"
#include "model/exact_options.h"
#include "model/homogeneous_field.h"
#include "model/some_info.h"
#include "nerf/model/field.h"
#include "nerf/model/network_field.h"
#include "nerf/model/network_ray.h"
#include "support/cameras.h"
#include "support/network_options.h"

namespace nerf {
namespace {

using test::exact_options;

const Layers kAll{.moments = true, .percentiles = true, .samples = true, .normal = true};

// Through the medium along x, which it fills from -1 to 1 with density 1.
Ray through(double y, double z) {
  Ray ray;
  ray.origin = {-3, y, z};
  ray.direction = {1, 0, 0};
  ray.background = {0.1_r, 0.5_r, 0.9_r};
  return ray;
}

// The light that is stopped before a distance d in the medium is 1 - exp(-d); samples of a quarter
// of a cell (1/64 unit) are where it is found.
TEST(Integrate, GivesAMediumsClosedForms) {
  const RadianceField field = test::homogeneous_field(Similarity());
  std::vector<Ray> rays{through(0, 0), through(0.3, -0.2), through(0, 0), through(0, 0)};
  rays[2].far = 3.0;                         // inside: 1 unit of the medium
  rays[3].near = 2.5;                        // half a unit is not seen
  const double across = 2 * std::sqrt(3.0);  // from corner to corner, and as far before it
  rays.push_back(through(0, 0));
  rays[4].origin = {-3, -3, -3};
  rays[4].direction = normalized(Vec3d{1, 1, 1});
  ThreadPool pool(2);
  const RayResults r = integrate(field, rays, kAll, exact_options(), pool);
  constexpr double kStep = 1.0 / 64;
  const double begin[] = {2, 2, 2, 2.5, across}, length[] = {2, 2, 1, 1.5, across};
  for (size_t i = 0; i < rays.size(); ++i) {
    SCOPED_TRACE(i);
    const double left = std::exp(-length[i]), opacity = 1 - left;
    EXPECT_NEAR(r.opacity[i], opacity, 1e-5);
    for (size_t k = 0; k < 3; ++k) {
      const double behind = static_cast<double>(rays[i].background[static_cast<int>(k)]);
      EXPECT_NEAR(r.rgb[3 * i + k], 0.5 * opacity + left * behind, 1e-5);
    }
    EXPECT_NEAR(r.median[i], begin[i] + std::log(2.0), 2 * kStep);
    EXPECT_NEAR(r.near[i], begin[i] - std::log(0.95), 2 * kStep);
    const bool is_deep = length[i] > -std::log(0.05);  // else so much is not stopped
    EXPECT_NEAR(r.far[i], is_deep ? begin[i] - std::log(0.05) : 0.0, 2 * kStep);
    // Of exp(-t) up to `length`.
    const double l = length[i], mean = 1 - l * left / opacity;
    const double second = 2 - (l * l + 2 * l) * left / opacity;
    EXPECT_NEAR(r.mean[i], begin[i] + mean, kStep);
    EXPECT_NEAR(r.variance[i], second - mean * mean, 2 * kStep);
    EXPECT_GT(r.samples[i], 30 * length[i]);
  }
}

// The same of a network that knows nothing but its bias: one density between near and far.
TEST(Integrate, GivesANetworksClosedForms) {
  NetworkOptions o = test::small_network(test::mipnerf_options());
  o.density_bias = 1;
  o.sampling.coarse = o.sampling.fine = 128;
  auto network = std::make_shared<NetworkField>(o, 0.5, 5);  // all weights are 0
  const RadianceField field(test::some_info(), network);
  ThreadPool pool(1);
  const std::vector<Ray> rays{through(0, 0)};
  const RayResults r = integrate(field, rays, kAll, exact_options(), pool);
  const double density = std::log1p(std::exp(1.0)), l = 4.5 * density, left = std::exp(-l);
  EXPECT_NEAR(r.opacity[0], 1 - left, 1e-4);
  const double mean = 1 - l * left / (1 - left);
  const double second = 2 - (l * l + 2 * l) * left / (1 - left);
  constexpr double kInterval = 4.5 / 128;
  EXPECT_NEAR(r.median[0], 0.5 + std::log(2.0) / density, 2 * kInterval);
  EXPECT_NEAR(r.near[0], 0.5 - std::log(0.95) / density, 2 * kInterval);
  EXPECT_NEAR(r.far[0], 0.5 - std::log(0.05) / density, 4 * kInterval);
  EXPECT_NEAR(r.mean[0], 0.5 + mean / density, 2 * kInterval);
  EXPECT_NEAR(r.variance[0], (second - mean * mean) / (density * density), 4 * kInterval);
  EXPECT_EQ(r.samples[0], 128);
}

TEST(Integrate, OfAPicturesRaysIsThePicture) {
  ThreadPool pool(2);
  const Camera camera = test::pinhole(30, 20, 25);
  Pose pose;
  pose.translation = {0.1, -0.2, -2.5};
  std::vector<RadianceField> fields;
  fields.push_back(test::homogeneous_field(Similarity()));
  for (const NetworkOptions& o : {test::small_network(test::nerf_options()),
                                  test::small_network(test::mipnerf360_options())}) {
    auto network = std::make_shared<NetworkField>(o, 0.5, 5);
    network->initialise(4);
    fields.emplace_back(test::some_info(), network);
  }
  for (const RadianceField& field : fields) {
    RenderOptions options;
    options.interpolated = 0;
    options.supersample = 1;
    options.background = {0.2_r, 0.4_r, 0.6_r};
    const Frame frame = render(field, camera, pose, options, pool);
    std::vector<Ray> rays;
    for (int y = 0; y < camera.height; ++y)
      for (int x = 0; x < camera.width; ++x) {
        Ray ray = *camera_ray(camera, pose, {x + 0.5, y + 0.5});
        if (field.is_grid())
          ray.near = field.info().near;
        else
          ray.radius = cast_radius(field.network(), camera, pose, {x + 0.5, y + 0.5});
        ray.background = options.background;
        rays.push_back(ray);
      }
    const RayResults r = integrate(field, rays, {}, options, pool);
    EXPECT_TRUE(r.mean.empty() && r.far.empty() && r.samples.empty() && r.normal.empty());
    ASSERT_EQ(r.opacity.size(), frame.alpha.size());
    for (size_t i = 0; i < rays.size(); ++i) {
      ASSERT_NEAR(r.opacity[i], frame.alpha[i], 4 * kRoundoff) << i;
      for (size_t k = 0; k < 3; ++k)
        ASSERT_NEAR(r.rgb[3 * i + k], frame.rgb[3 * i + k], 16 * kRoundoff) << i;
    }
    EXPECT_EQ(r.statistics.density_evaluations, frame.statistics.density_evaluations);
  }
}

TEST(Integrate, IsTheSameForAnyNumberOfThreads) {
  const RadianceField field = test::homogeneous_field(test::tilted());
  std::vector<Ray> rays;
  for (int i = 0; i < 700; ++i) rays.push_back(through(0.002 * i - 0.7, 0.5));
  ThreadPool one(1), three(3);
  const RayResults a = integrate(field, rays, kAll, {}, one);
  const RayResults b = integrate(field, rays, kAll, {}, three);
  EXPECT_EQ(a.rgb, b.rgb);
  EXPECT_EQ(a.median, b.median);
  EXPECT_EQ(a.variance, b.variance);
  EXPECT_EQ(a.samples, b.samples);
}

// Where half of the light is stopped, against the field's own slope.
TEST(Integrate, NormalsFaceWhereDensityFalls) {
  NetworkOptions o = test::small_network(test::nerf_options());
  o.density = DensityActivation::kSoftplus;
  o.density_bias = 2;
  auto network = std::make_shared<NetworkField>(o, 0.5, 5);
  network->initialise(4);
  const RadianceField field(test::some_info(), network);
  std::vector<Ray> rays;
  for (int i = 0; i < 20; ++i) rays.push_back(through(0.05 * i - 0.5, 0.1));
  ThreadPool pool(1);
  const RayResults r = integrate(field, rays, kAll, exact_options(), pool);
  const auto query = field.field().query(nullptr);
  int seen = 0;
  for (size_t i = 0; i < rays.size(); ++i) {
    if (!(r.median[i] > 0)) {
      EXPECT_EQ(r.normal[i], (Vec3{0, 0, 0}));
      continue;
    }
    ++seen;
    const std::vector<Vec3d> at{rays[i].origin +
                                rays[i].direction * static_cast<double>(r.median[i])};
    std::vector<Real> slope(3);
    query->ask({at, {}}, {{}, {}, slope});
    const Vec3 g{slope[0], slope[1], slope[2]};
    EXPECT_NEAR(length(r.normal[i]), 1, 1e-5);
    EXPECT_NEAR(dot(r.normal[i], g) / length(g), -1, 1e-5);
  }
  EXPECT_GT(seen, 10);
}

}  // namespace
}  // namespace nerf
