// Whole pictures of the paper methods: networks of any weights, from every place that a camera can
// stand at.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "kernels/kernel_test.h"
#include "math/worst_error.h"
#include "nerf/model/network_field.h"
#include "nerf/model/network_levels.h"
#include "nerf/model/network_ray.h"
#include "stress/composite_run.h"
#include "stress/stress_field.h"
#include "stress/views.h"
#include "support/network_options.h"
#include "support/network_rays.h"

namespace nerf::stress {
namespace {

struct Method {
  std::string name;
  NetworkOptions options;
  double near, far;
};

// Of the sizes that a test can afford, but with all of the papers' frequencies: the argument of the
// highest is 2^15 times a position.
std::vector<Method> methods() {
  const auto small = [](const NetworkOptions& o) {
    NetworkOptions out = test::small_network(o);
    out.position_degrees = o.position_degrees;
    out.direction_degrees = o.direction_degrees;
    return out;
  };
  const NetworkOptions nerf = small(test::nerf_options()), mip = small(test::mipnerf_options());
  NetworkOptions ndc = nerf;
  ndc.space = Space::kNdc;
  return {{"nerf", nerf, 0.5, 5},
          {"nerf, far", nerf, 1e-3, 1e6},
          {"nerf, normalised device coordinates", ndc, 0, 1},
          {"mipnerf", mip, 0.5, 5},
          {"mipnerf, far", mip, 1e-3, 1e6},
          {"mipnerf360", small(test::mipnerf360_options()), 0.5, 5},
          {"mipnerf360, far", small(test::mipnerf360_options()), 1e-3, 1e6}};
}

void scale_layer(NetworkField& field, const LinearWeights& w, Real factor) {
  for (size_t i = 0; i < w.size(); ++i) field.weights[w.offset + i] *= factor;
}

struct Content {
  std::string name;
  void (*change)(NetworkField&);  // of the first weights
};

// What training may start from and what it may end in when it goes wrong.
const Content kContents[] = {
    {"untrained", [](NetworkField&) {}},
    {"nothing learnt", [](NetworkField& f) { std::ranges::fill(f.weights, 0.0_r); }},
    {"hard",
     [](NetworkField& f) {
       for (Real& w : f.weights) w *= 1e3_r;
     }},
    {"faint",
     [](NetworkField& f) {
       for (Real& w : f.weights) w *= 1e-15_r;
     }},
    {"walls",
     [](NetworkField& f) {
       for (const RadianceNetwork& n : f.networks) scale_layer(f, n.density, 1e5_r);
     }},
    {"loud colours", [](NetworkField& f) { scale_layer(f, f.networks.back().colour, 1e5_r); }},
    {"opaque",
     [](NetworkField& f) {
       for (const RadianceNetwork& n : f.networks) f.weights[n.density.bias_offset()] = 1e10_r;
     }},
    {"vacuum", [](NetworkField& f) {
       for (const RadianceNetwork& n : f.networks) f.weights[n.density.bias_offset()] = -1e10_r;
     }}};

RadianceField field_of(const Method& m, const Content& content, const Similarity& to_engine = {}) {
  auto network = std::make_shared<NetworkField>(m.options, m.near, m.far);
  network->initialise(5);
  content.change(*network);
  if (m.options.space == Space::kNdc) network->ndc.near = 1;
  ModelInfo info;
  info.method = "composed";
  info.to_engine = to_engine;
  info.alpha = true;
  info.near = m.near;
  info.far = m.far;
  return RadianceField(std::move(info), std::move(network));
}

// All pixels are numbers in range, in bf16 too where a target takes it by default.
TEST(StressNetworkRender, EveryPixelOfEveryView) {
  ThreadPool pool(2);
  const Similarity frame = engine_frame(3e5, 1e-3);
  for_each_target([&](const std::string&) {
    for (const Method& m : methods())
      for (const Content& content : kContents) {
        const RadianceField field = field_of(m, content, frame);
        for (const View& v : views(4)) {
          SCOPED_TRACE(m.name + ", " + content.name + ", " + v.name);
          const Frame picture = render(field, v.camera, frame.apply_inverse(v.pose), {}, pool);
          expect_picture(picture);
        }
      }
  });
}

// Before a picture clips anything: no weight is below 0, and those of a ray's samples, on any
// level, add up to at most 1 + 1e-6 in double.
TEST(StressNetworkRender, WeightsOfEveryRayAddUpToAtMostOne) {
  int64_t rays_seen = 0, opaque = 0;
  for_each_target([&](const std::string&) {
    for (const Method& m : methods())
      for (const Content& content : kContents) {
        NetworkField field(m.options, m.near, m.far);
        field.initialise(5);
        content.change(field);
        if (m.options.space == Space::kNdc) field.ndc.near = 1;
        NetworkLevels levels(field, 9);
        for (const View& v : views(3)) {
          SCOPED_TRACE(m.name + ", " + content.name + ", " + v.name);
          std::vector<NetworkRay> rays;
          for (int i = 0; i < 9; ++i)
            if (const auto ray =
                    test::network_ray(field, v.camera, v.pose, {i % 3 + 0.5, i / 3 + 0.5}))
              rays.push_back(*ray);
          if (rays.empty()) continue;
          levels.forward(rays, 1);
          rays_seen += static_cast<int64_t>(rays.size());
          for (int level = 0; level < levels.levels(); ++level)
            for (int r = 0; r < static_cast<int>(rays.size()); ++r) {
              double sum = 0;
              for (const Real w : levels.weights(level, r)) {
                ASSERT_TRUE(w >= 0) << "level " << level << " ray " << r << ": " << w;
                sum += double{w};
              }
              ASSERT_LE(sum, 1 + 1e-6) << "level " << level << " ray " << r;
              opaque += sum > 0.999;
            }
        }
      }
  });
  EXPECT_GT(rays_seen, 5000);
  EXPECT_GT(opaque, 1000);
}

// Pictures of other targets agree to a quarter of an 8-bit level
// (tests/support/same_pictures.h), wherever the camera stands, unless a sample's place, off by a
// millionth of its interval, decides what is there. It does where last layers are loud; and where a
// point's sine has many turns in that millionth, as it has not in an interval's mean.
TEST(StressNetworkRender, TheSameOnEveryTarget) {
  ThreadPool pool(2);
  RenderOptions options;
  options.precision = Precision::kF32;
  int seen = 0;
  for (const Method& m : methods())
    for (const Content& content : kContents) {
      const bool even = content.name == "nothing learnt" || content.name == "opaque" ||
                        content.name == "vacuum" || content.name == "faint";
      if (!even && (content.name != "untrained" || m.name == "nerf, far")) continue;
      const RadianceField field = field_of(m, content);
      for (const View& v : views(4)) {
        SCOPED_TRACE(m.name + ", " + content.name + ", " + v.name);
        const Frame usual = render(field, v.camera, v.pose, options, pool);
        const auto [least, most] = std::ranges::minmax(usual.rgb);
        seen += most - least > 0.01_r;
        for_each_target([&](const std::string&) {
          const Frame frame = render(field, v.camera, v.pose, options, pool);
          for (size_t i = 0; i < frame.rgb.size(); ++i)
            ASSERT_NEAR(frame.rgb[i], usual.rgb[i], 0.25 / 255) << "value " << i;
          for (size_t i = 0; i < frame.alpha.size(); ++i)
            ASSERT_NEAR(frame.alpha[i], usual.alpha[i], 0.25 / 255) << "pixel " << i;
        });
      }
    }
  EXPECT_GT(seen, 50) << "pictures with something to see";
}

// Of no weights but the densities' biases: 1 - exp(-density (far - near)) on every ray, from
// anywhere. With u the unit roundoff,
// - density is off by 8 u of itself (elementwise_test.cc: Exp, Log1p and a sum), and by the
//   rounding of what softplus takes;
// - the intervals' lengths add up to far - near, each off by u of itself, and both ends by 4 u;
// - what is composited from them by kPixelErrorInHalves, and a colour by three roundings more.
TEST(StressNetworkRender, HomogeneousMatterFromEverywhere) {
  ThreadPool pool(2);
  WorstError opacity("opacity"), colour("colour");
  RenderOptions options;
  options.background = {0.1_r, 0.9_r, 0.3_r};
  for (Method m : methods()) {
    if (m.options.sampling.resampling == Resampling::kCoarseFine) continue;  // is endless, below
    m.options.opaque_end = false;
    m.options.sampling.rounds = 0;  // that the outermost posts are near and far
    for (double density : {1e-6, 1e-3, 0.3, 2.0, 1e4, 1e10}) {
      const double before = density > 30 ? density : std::log(std::expm1(density));
      const Real raw = static_cast<Real>(before - double{m.options.density_bias});
      auto network = std::make_shared<NetworkField>(m.options, m.near, m.far);
      network->weights[network->networks.back().density.bias_offset()] = raw;
      ModelInfo info;
      info.method = "composed";
      info.alpha = true;
      const RadianceField field(std::move(info), network);
      const double at = double{raw} + double{m.options.density_bias};
      const double sigma = at > 30 ? at : std::log1p(std::exp(at));
      const double tau = sigma * (m.far - m.near), left = std::exp(-tau);
      const double slope = 1 / (1 + std::exp(-at));
      const double off_density = 8 * kRoundoff * sigma + kRoundoff * std::fabs(at) * slope;
      const double off = off_density * (m.far - m.near) + 9 * kRoundoff * sigma * m.far;
      const double tolerance = std::exp(-tau + std::min(off, tau)) * off + kPixelErrorInHalves;
      for_each_target([&](const std::string&) {
        for (const View& v : views(3)) {
          const Frame frame = render(field, v.camera, v.pose, options, pool);
          for (int y = 0; y < frame.height; ++y)
            for (int x = 0; x < frame.width; ++x) {
              const size_t i = static_cast<size_t>(y * frame.width + x);
              const double light = unproject(v.camera, {x + 0.5, y + 0.5}) ? left : 1;
              opacity.compare(frame.alpha[i], 1 - light, tolerance, m.name, density, v.name);
              for (size_t k = 0; k < 3; ++k)
                colour.compare(
                    frame.rgb[3 * i + k],
                    (1 - light) * 0.5 + light * double{options.background[static_cast<int>(k)]},
                    tolerance + 3 * kRoundoff, m.name, density, v.name, "channel", k);
            }
        }
      });
    }
  }
  opacity.report();
  colour.report();
}

// NeRF's last interval has no end: a density of 1e-6 there lets exp(-1e4) through.
TEST(StressNetworkRender, PointsEndInAWallFromEverywhere) {
  ThreadPool pool(2);
  for (const Method& m : methods()) {
    if (m.options.sampling.resampling != Resampling::kCoarseFine) continue;
    for (Real density : {0.0_r, 1e-6_r, 1.0_r, 1e10_r}) {
      auto network = std::make_shared<NetworkField>(m.options, m.near, m.far);
      for (const RadianceNetwork& n : network->networks)
        network->weights[n.density.bias_offset()] = density;
      if (m.options.space == Space::kNdc) network->ndc.near = 1;
      ModelInfo info;
      info.method = "composed";
      info.alpha = true;
      const RadianceField field(std::move(info), network);
      for_each_target([&](const std::string&) {
        for (const View& v : views(3)) {
          SCOPED_TRACE(m.name + ", " + v.name);
          const Frame frame = render(field, v.camera, v.pose, {}, pool);
          for (int i = 0; i < 3 * 3; ++i) {
            const bool met =
                test::network_ray(*network, v.camera, v.pose, {i % 3 + 0.5, i / 3 + 0.5})
                    .has_value();
            ASSERT_NEAR(frame.alpha[static_cast<size_t>(i)], density > 0 && met,
                        kPixelErrorInHalves)
                << "pixel " << i;
          }
        }
      });
    }
  }
}

}  // namespace
}  // namespace nerf::stress
