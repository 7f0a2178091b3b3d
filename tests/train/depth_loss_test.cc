// The loss by depth maps, where colour says nothing: a plain wall.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "base/half.h"
#include "nerf/model/renderer.h"
#include "nerf/train/trainer.h"
#include "support/synthetic_scene.h"
#include "support/tiny_options.h"
#include "train/ray_batch.h"
#include "train/scene_fingerprint.h"

namespace nerf {
namespace {

constexpr double kWall = 3.3;  // from every camera, along its axis
constexpr int kSize = 32;

// Cameras side by side that look along +z at a grey wall which fills their pictures, in a box that
// ends with [-1, 1]^3.
test::SyntheticCapture wall_capture(bool depth = true) {
  test::SyntheticCapture c;
  c.scene.near = 0.1;
  c.scene.far = 5;
  c.scene.cameras = {test::sphere_camera(kSize)};
  for (int i = 0; i < 4; ++i) {
    View view;
    view.name = std::to_string(i);
    view.pose.translation = {0.2 * (i % 2), 0.2 * (i / 2), -3};
    c.scene.views.push_back(view);
    c.scene.train.push_back(i);
    Photo photo;
    photo.width = photo.height = kSize;
    photo.pixels8.assign(3 * kSize * kSize, 120);
    if (depth) {
      // Of another size than the photo.
      const size_t pixels = kSize / 2 * kSize / 2;
      photo.depth = {
          kSize / 2, kSize / 2,
          std::vector<uint16_t>(pixels, internal::float_to_half(static_cast<float>(kWall)))};
    }
    c.photos.photos.push_back(photo);
    c.photos.cameras.push_back(c.scene.cameras[0]);
  }
  return c;
}

// Mean distance of the rendered surface from the wall over the middle of a picture.
double depth_error(const std::string& method, const test::SyntheticCapture& c, double weight) {
  TrainOptions options = test::tiny_options(method, method == kGridMethod ? 120 : 400);
  options.pixel_recipe.depth_loss = weight;
  ThreadPool pool(2);
  Trainer trainer(c.scene, c.photos, options, pool);
  trainer.run({});
  const Frame frame =
      render(trainer.snapshot(), c.scene.cameras[0], c.scene.views[0].pose, {}, pool);
  double sum = 0;
  int count = 0;
  for (int y = kSize / 4; y < 3 * kSize / 4; ++y)
    for (int x = kSize / 4; x < 3 * kSize / 4; ++x, ++count)
      sum +=
          std::abs(static_cast<double>(frame.depth_z[static_cast<size_t>(y * kSize + x)]) - kWall);
  return sum / count;
}

class DepthTrainingOf : public ::testing::TestWithParam<std::string> {};

TEST_P(DepthTrainingOf, PutsAPlainWallWhereTheMapsSay) {
  const auto c = wall_capture();
  const double open = depth_error(GetParam(), c, 0), drawn = depth_error(GetParam(), c, 1);
  RecordProperty("without", std::to_string(open));
  RecordProperty("with", std::to_string(drawn));
  EXPECT_GT(open, 0.3);
  EXPECT_LT(drawn, 0.06);
}

TEST(DepthTraining, APixelsDistanceIsAlongItsRay) {
  const auto c = wall_capture();
  const PixelSource source(c.scene, c.photos);
  EXPECT_TRUE(source.has_depth());
  double largest = 0;
  for (uint64_t i = 0; i < 200; ++i) {
    Random random(3, i, 0);
    PixelSource::Pixel pixel;
    ASSERT_TRUE(source.draw(random, pixel));
    const Vec3d p = pixel.ray.origin + pixel.ray.direction * pixel.distance;
    EXPECT_NEAR(p.z + 3, kWall, 0x1p-11 * kWall);
    largest = std::max(largest, pixel.distance);
  }
  EXPECT_GT(largest, 1.02 * kWall);  // beside the axis
}

TEST(DepthTraining, WithoutMapsNothingChanges) {
  const auto bits = [](const test::SyntheticCapture& c, std::optional<double> weight) {
    ThreadPool pool(1);
    TrainOptions options = test::tiny_options(20);
    options.pixel_recipe.depth_loss = weight;
    Trainer trainer(c.scene, c.photos, options, pool);
    for (int i = 0; i < 12; ++i) trainer.step();
    return test::learnt_by(trainer);
  };
  const auto without = wall_capture(false), with = wall_capture();
  EXPECT_EQ(bits(without, {}), bits(without, 5));
  EXPECT_EQ(bits(without, {}), bits(with, 0));
  EXPECT_NE(bits(without, {}), bits(with, {}));
  EXPECT_FALSE(PixelSource(without.scene, without.photos).has_depth());
  TrainOptions options;
  EXPECT_EQ(depth_loss_weight(options, without.scene, without.photos), 0);
  EXPECT_GT(depth_loss_weight(options, with.scene, with.photos), 0);
  // A checkpoint of one is none of the other.
  EXPECT_NE(internal::scene_fingerprint(without.scene, without.photos),
            internal::scene_fingerprint(with.scene, with.photos));
}

TEST(DepthTraining, ThreadsChangeNothing) {
  const auto c = wall_capture();
  const auto bits = [&](int threads) {
    ThreadPool pool(threads);
    Trainer trainer(c.scene, c.photos, test::tiny_options(40), pool);
    for (int i = 0; i < 24; ++i) trainer.step();
    return test::learnt_by(trainer);
  };
  EXPECT_EQ(bits(1), bits(2));
}

INSTANTIATE_TEST_SUITE_P(Methods, DepthTrainingOf, ::testing::Values("grid", "nerf", "mipnerf"),
                         [](const auto& info) { return info.param; });

}  // namespace
}  // namespace nerf
