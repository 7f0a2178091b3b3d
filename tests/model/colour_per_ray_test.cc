// Colours found once for a ray, GridOptions::colour_per_ray: pictures against sums in double over
// the same samples. The training tape is tested in grid_field_test.cc.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>
#include <vector>

#include "model/small_grid.h"
#include "nerf/model/grid_field.h"
#include "nerf/model/radiance_field.h"
#include "nerf/model/renderer.h"
#include "support/cameras.h"

namespace nerf {
namespace {

GridOptions small_options(bool per_ray) {
  GridOptions o = test::small_options(1, 1);
  o.colour_per_ray = per_ray;
  return o;
}

// A field of random content whose cells are all occupied: with four samples in each of them most
// rays need more samples than a chunk holds.
std::shared_ptr<GridField> random_field(bool per_ray = true) {
  auto grid = std::make_shared<GridField>(small_options(per_ray), /*unbounded=*/false, 1);
  grid->initialise(7);
  for (Real& v : grid->table) v *= 1e4_r;
  grid->occupancy.set_levels(std::vector<uint8_t>(grid->occupancy.levels().size(), 20));
  return grid;
}

// Runs `field` over samples of one ray, a chunk at a time: features and densities of each.
class SamplesOfARay {
 public:
  explicit SamplesOfARay(const GridField& field)
      : field_(field), tape_(field, /*training=*/false), chunk_(tape_.tape) {
    chunk_.weights = field.weights.data();
  }

  // Colour over a background of 0, that of the features' sum or of their mean, and opacity.
  std::vector<double> pixel(const RaySampler& sampler, const RaySamples& samples, const Vec3& d) {
    const int features = field_.options.geometry_features;
    std::vector<double> sums(static_cast<size_t>(features));
    double light = 1;
    for (size_t from = 0; from < samples.t.size(); from += kChunkSamples) {
      const int n = static_cast<int>(std::min<size_t>(kChunkSamples, samples.t.size() - from));
      run(sampler, samples, d, from, n);
      tape_.forward_density(chunk_);
      for (int i = 0; i < n; ++i) {
        const double depth = static_cast<double>(chunk_.data(tape_.density)[i]) *
                             static_cast<double>(samples.delta[from + static_cast<size_t>(i)]);
        const double weight = -light * std::expm1(-depth);
        light *= std::exp(-depth);
        for (int f = 0; f < features; ++f)
          sums[static_cast<size_t>(f)] +=
              weight * static_cast<double>(
                           chunk_.data(tape_.geometry)[f * chunk_.stride(tape_.geometry) + i]);
      }
    }
    const int32_t one[] = {0, 1};
    chunk_.samples = chunk_.rays = 1;
    chunk_.ray_begin = one;
    for (int f = 0; f < features; ++f)
      chunk_.data(tape_.geometry)[f * chunk_.stride(tape_.geometry)] = static_cast<Real>(
          sums[static_cast<size_t>(f)] / (field_.options.colour_per_ray ? 1 : 1 - light));
    tape_.forward_colour(chunk_);
    std::vector<double> out;
    for (int k = 0; k < 3; ++k)
      out.push_back((1 - light) * static_cast<double>(
                                      chunk_.data(tape_.colour)[k * chunk_.stride(tape_.colour)]));
    out.push_back(1 - light);
    return out;
  }

 private:
  void run(const RaySampler& sampler, const RaySamples& samples, const Vec3& d, size_t from,
           int n) {
    for (int i = 0; i < kChunkSamples; ++i) {
      const size_t s = from + static_cast<size_t>(std::min(i, n - 1));
      const Vec3 g = field_.grid_position(sampler.entry() + d * samples.t[s]);
      x_[static_cast<size_t>(i)] = g.x;
      y_[static_cast<size_t>(i)] = g.y;
      z_[static_cast<size_t>(i)] = g.z;
    }
    begin_[0] = 0;
    begin_[1] = n;
    chunk_.samples = n;
    chunk_.rays = 1;
    chunk_.ray_begin = begin_;
    for (int k = 0; k < 3; ++k)
      chunk_.data(tape_.directions)[k * chunk_.stride(tape_.directions)] = d[k];
    encode(field_, x_.data(), y_.data(), z_.data(), nullptr, n, chunk_.data(tape_.features),
           chunk_.stride(tape_.features));
  }

  const GridField& field_;
  GridTape tape_;
  Chunk chunk_;
  AlignedArray<Real> x_{kChunkSamples}, y_{kChunkSamples}, z_{kChunkSamples};
  int32_t begin_[2];
};

// The picture of a field with one colour for each ray, against one put together by hand.
void expect_one_colour_a_ray(const std::shared_ptr<GridField>& grid, RenderOptions options) {
  ModelInfo info;
  info.near = 1e-3;
  const RadianceField radiance(std::move(info), grid);
  const Camera camera = test::pinhole(24, 20, 20);
  Pose pose;
  pose.translation = {0.1, -0.2, -2};
  ThreadPool pool(2);
  options.background = {0, 0, 0};
  options.precision = Precision::kF32;
  const Frame frame = render(radiance, camera, pose, options, pool);

  SamplesOfARay by_hand(*grid);
  RaySampler sampler(grid->occupancy, grid->options.sampler, grid->clip);
  RaySamples samples;
  int64_t rays = 0;
  int longer_than_a_chunk = 0;
  Real least = 1, most = 0;
  for (int y = 0; y < camera.height; ++y)
    for (int x = 0; x < camera.width; ++x) {
      Ray ray;
      ray.origin = pose.translation;
      ray.direction = normalized(*unproject(camera, {x + 0.5, y + 0.5}));
      ray.near = 1e-3;
      const int n = sampler.sample_all(ray, 4, samples);
      if (n == 0) continue;
      ++rays;
      longer_than_a_chunk += n > kChunkSamples;
      const auto want = by_hand.pixel(sampler, samples, ray.direction.cast<Real>());
      const size_t p = static_cast<size_t>(y * camera.width + x);
      for (size_t k = 0; k < 3; ++k) {
        // The sums of up to 440 features of about 1, rounded once, through two layers.
        EXPECT_NEAR(frame.rgb[3 * p + k], want[k], 2e-6) << "pixel " << x << ' ' << y;
        least = std::min(least, frame.rgb[3 * p + k]);
        most = std::max(most, frame.rgb[3 * p + k]);
      }
      EXPECT_NEAR(frame.alpha[p], want[3], 1e-6);
    }
  EXPECT_GT(longer_than_a_chunk, 50);
  EXPECT_GT(most - least, 0.1_r);  // not one colour everywhere
  EXPECT_EQ(frame.statistics.colour_evaluations, rays);

  // Rays that let nearly everything through need no colour.
  options.unshaded = 0.9_r;
  EXPECT_LT(render(radiance, camera, pose, options, pool).statistics.colour_evaluations, rays);
}

TEST(ColourPerRay, PicturesAreThoseOfTheSums) {
  RenderOptions options;
  options.skip_nothing();
  expect_one_colour_a_ray(random_field(), options);
}

// So are those of a field with a colour for each sample where samples may share one.
TEST(ColourPerRay, SharedColoursAreThoseOfTheMeans) {
  RenderOptions options;
  options.skip_nothing();
  options.shared_colour = 2;  // sums of weights may exceed 1 by their roundings
  expect_one_colour_a_ray(random_field(/*per_ray=*/false), options);
}

}  // namespace
}  // namespace nerf
