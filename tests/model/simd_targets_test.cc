// The same pictures on every SIMD target.
#include <gtest/gtest.h>

#include <cmath>
#include <memory>

#include "kernels/kernel_test.h"
#include "nerf/model/grid_field.h"
#include "nerf/model/network_field.h"
#include "nerf/model/radiance_field.h"
#include "nerf/model/renderer.h"
#include "support/cameras.h"
#include "support/network_options.h"
#include "support/tables.h"

namespace nerf {
namespace {

// Targets differ in the order of sums and by the last digits of exponentials: 2e-6 of a layer's
// output. Behind ten layers, and by way of the places that samples are drawn from, a colour may be
// off by a quarter of what an 8-bit picture can show.
constexpr double kMost = 0.25 / 255;

void expect_same_pictures(const RadianceField& field, const RenderOptions& options, double most) {
  Pose pose;
  pose.translation = {0.1, -0.2, -2.5};
  ThreadPool pool(2);
  const Camera camera = test::pinhole(24, 20, 18);
  const Frame usual = render(field, camera, pose, options, pool);
  double light = 0, contrast = 0;
  for (size_t i = 0; i < usual.alpha.size(); ++i) light += static_cast<double>(usual.alpha[i]);
  for (size_t i = 3; i < usual.rgb.size(); ++i)
    contrast = std::max(contrast, std::fabs(static_cast<double>(usual.rgb[i] - usual.rgb[i - 3])));
  EXPECT_GT(light, 0.1 * static_cast<double>(usual.alpha.size())) << "there is something to see";
  EXPECT_GT(contrast, 0.01);
  for_each_target([&](const std::string&) {
    const Frame frame = render(field, camera, pose, options, pool);
    for (size_t i = 0; i < frame.rgb.size(); ++i)
      ASSERT_NEAR(frame.rgb[i], usual.rgb[i], most) << "value " << i;
    for (size_t i = 0; i < frame.alpha.size(); ++i)
      ASSERT_NEAR(frame.alpha[i], usual.alpha[i], most) << "pixel " << i;
  });
}

void expect_same_pictures(const RadianceField& field) {
  RenderOptions usual;
  usual.precision = Precision::kF32;
  RenderOptions whole = usual;
  whole.skip_nothing();
  expect_same_pictures(field, whole, kMost);
  // A last digit decides whether a ray ends a sample earlier.
  expect_same_pictures(field, usual, kMost + static_cast<double>(usual.stop_transmittance));
}

ModelInfo some_info() {
  ModelInfo info;
  info.alpha = true;
  info.near = 0.5;
  info.far = 5;
  return info;
}

TEST(SimdTargets, PicturesOfTheGrid) {
  for (const bool unbounded : {false, true}) {
    GridOptions o;
    o.table_bits = unbounded ? 16 : 32;
    o.levels = 4;
    o.log2_entries = 12;
    o.occupancy_side = 64;
    o.hidden = 32;
    auto grid = std::make_shared<GridField>(o, unbounded, unbounded ? 2 : 1);
    grid->initialise(3);
    test::scale_table(*grid, 1e4_r);
    grid->occupancy.set_levels(std::vector<uint8_t>(grid->occupancy.levels().size(), 20));
    expect_same_pictures(RadianceField(some_info(), grid));
  }
}

TEST(SimdTargets, PicturesOfThePapersMethods) {
  for (const NetworkOptions& o :
       {test::nerf_options(), test::mipnerf_options(), test::mipnerf360_options()}) {
    auto field = std::make_shared<NetworkField>(test::small_network(o), 0.5, 5);
    field->initialise(4);
    expect_same_pictures(RadianceField(some_info(), field));
  }
}

}  // namespace
}  // namespace nerf
