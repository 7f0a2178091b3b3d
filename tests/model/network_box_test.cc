// RenderOptions::bbox with the paper methods.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <memory>
#include <numbers>
#include <vector>

#include "model/homogeneous_field.h"
#include "nerf/model/network_field.h"
#include "nerf/model/renderer.h"
#include "support/boxed_view.h"
#include "support/cameras.h"
#include "support/network_options.h"

namespace nerf {
namespace {

using test::small_network;
using test::tilted;

// A network whose only weights are the biases of its heads: the same matter everywhere.
RadianceField homogeneous_network(const NetworkOptions& options, const Similarity& to_engine,
                                  Real raw_density) {
  auto network = std::make_shared<NetworkField>(options, 0.5, 6);
  for (const RadianceNetwork& n : network->networks)
    network->weights[n.density.bias_offset()] = raw_density;
  ModelInfo info;
  info.to_engine = to_engine;
  info.near = network->near;
  return RadianceField(std::move(info), std::move(network));
}

struct Case {
  NetworkOptions options;
  Real raw_density;  // such that the density is 1 per engine unit
};

std::vector<Case> cases() {
  const Real softplus_of_one = std::log(std::exp(1.0_r) - 1) + 1;  // behind a bias of -1
  return {{small_network(test::nerf_options()), 1},
          {small_network(test::mipnerf_options()), softplus_of_one},
          {small_network(test::mipnerf360_options()), softplus_of_one}};
}

// A panorama's rays, which in a stereo picture begin beside its middle.
TEST(NetworkBox, PanoramasSeeAllAroundFromTheirEyes) {
  const Similarity to_engine = tilted();
  const test::BoxedView view = test::boxed_view(to_engine);
  RenderOptions options;
  options.bbox = view.box;
  ThreadPool pool(2);
  for (const Case& c : cases()) {
    const RadianceField field = homogeneous_network(c.options, to_engine, c.raw_density);
    for (const double eye : {0.0, 0.8}) {
      Camera camera = panorama(16, 8);
      camera.params[4] = eye;
      Pose pose;
      pose.translation = to_engine.center + Vec3d{0.2, -4, 0.1};  // the box below it
      const Frame frame = render(field, camera, pose, options, pool);
      for (int y = 0; y < 8; ++y)
        for (int x = 0; x < 16; ++x) {
          const double azimuth = std::numbers::pi * (x + 0.5 - 8) / 8;
          const double down = std::numbers::pi * (y + 0.5 - 4) / 8;
          const Vec3d d{std::cos(down) * std::sin(azimuth), std::sin(down),
                        std::cos(down) * std::cos(azimuth)};
          const Vec3d from = Vec3d{std::cos(azimuth), 0, -std::sin(azimuth)} * eye;
          const double inside = test::length_inside(pose * from, d, view.box);
          const size_t at = static_cast<size_t>(y * 16 + x);
          EXPECT_NEAR(frame.alpha[at], 1 - std::exp(-inside * to_engine.scale), 2e-5)
              << x << ' ' << y << " eye " << eye;
          EXPECT_GE(frame.depth_z[at], 0) << x << ' ' << y;
        }
    }
  }
}

// As of the grid method: opacity 1 - exp(-density * length) of the part of each ray inside the box,
// also where the field goes on behind it, to an opaque end or without end.
TEST(NetworkBox, NothingIsDrawnOutside) {
  const Similarity to_engine = tilted();
  const test::BoxedView view = test::boxed_view(to_engine);  // 2.25 engine units before it
  RenderOptions options;
  options.bbox = view.box;
  ThreadPool pool(2);
  for (const Case& c : cases()) {
    const RadianceField field = homogeneous_network(c.options, to_engine, c.raw_density);
    const Frame frame = render(field, view.camera, view.pose, options, pool);
    test::expect_opacity_inside(view, to_engine, frame);
    // A capture without alpha has black behind it; the medium's colour is a half.
    for (size_t i = 0; i < frame.alpha.size(); ++i)
      EXPECT_NEAR(frame.rgb[3 * i], 0.5_r * frame.alpha[i], 1e-6) << i;
  }
}

// A box around everything that the samples reach changes nothing but the end, which is open.
TEST(NetworkBox, AroundEverythingChangesNothing) {
  const Camera camera = test::pinhole(12, 9, 10);
  Pose pose;
  pose.translation = {0, 0, -2};
  ThreadPool pool(2);
  RenderOptions whole, boxed;
  boxed.bbox = Box3{{-1e5, -1e5, -1e5}, {1e5, 1e5, 1e5}};
  for (Case c : cases()) {
    c.options.opaque_end = false;
    if (c.options.sampling.resampling == Resampling::kCoarseFine) continue;  // endless at the end
    const RadianceField field = homogeneous_network(c.options, Similarity(), 0.3_r);
    const Frame a = render(field, camera, pose, whole, pool);
    const Frame b = render(field, camera, pose, boxed, pool);
    for (size_t i = 0; i < a.alpha.size(); ++i) EXPECT_NEAR(a.alpha[i], b.alpha[i], 2e-6);
  }
}

}  // namespace
}  // namespace nerf
