// Points of depth maps, of a scene small enough to say by hand.
#include "nerf/io/depth_points.h"

#include <gtest/gtest.h>

#include <cmath>

#include "base/half.h"

namespace nerf {
namespace {

constexpr double kWall = 2;  // distance of the wall that all cameras look at

// Cameras side by side that look along +z at a wall, engine and input coordinates the same.
struct Capture {
  Scene scene;
  PhotoSet photos;

  explicit Capture(int views = 3) {
    scene.unbounded = true;
    scene.near = 0.01;
    scene.far = 50;
    Camera camera;
    camera.width = 80;
    camera.height = 60;
    camera.params = {80, 80, 40, 30};
    scene.cameras = {camera};
    for (int i = 0; i < views; ++i) {
      View view;
      view.pose.translation = {0.1 * i, 0, 0};
      scene.views.push_back(view);
      scene.train.push_back(i);
      photos.cameras.push_back(camera);
      Photo photo;
      photo.width = 80;
      photo.height = 60;
      photo.pixels8.assign(3 * 80 * 60, 100);
      photos.photos.push_back(photo);
      set_depth(i, [](int, int) { return kWall; });
    }
  }
  template <class Depth>
  void set_depth(int view, const Depth& z) {
    DepthMap& map = photos.photos[static_cast<size_t>(view)].depth;
    map = {40, 30, {}};
    for (int y = 0; y < 30; ++y)
      for (int x = 0; x < 40; ++x)
        map.z.push_back(internal::float_to_half(static_cast<float>(z(x, y))));
  }
  DepthPoints add(int threads = 1) {
    ThreadPool pool(threads);
    return add_depth_points(scene, photos, pool);
  }
};

TEST(DepthPoints, LieWhereTheMapsSayAndInThePhotosThatSeeThem) {
  Capture c;
  const DepthPoints result = c.add();
  EXPECT_EQ(result.maps, 3);
  EXPECT_FALSE(result.rejected);
  EXPECT_EQ(result.agreed, 1);
  ASSERT_GT(result.points, 1000);
  ASSERT_EQ(c.scene.points.size(), static_cast<size_t>(result.points));
  for (const Observation& o : c.scene.observations) {
    const Vec3d p = c.scene.points[static_cast<size_t>(o.point)].position -
                    c.scene.views[static_cast<size_t>(o.image)].pose.translation;
    ASSERT_NEAR(p.z, kWall, 1e-12);
    ASSERT_LE(std::abs(p.x), 0.5 * kWall + 1e-12);
  }
  // The middle of the wall is in all three pictures, and depth is a witness more.
  for (const ScenePoint& p : c.scene.points)
    if (std::abs(p.position.x - 0.1) < 0.5) {
      ASSERT_EQ(p.views, 4);
    }
}

TEST(DepthPoints, SetNearAndFarUnlessPointsOrOptionsDo) {
  Capture c;
  c.add();
  EXPECT_NEAR(c.scene.near, 0.5 * kWall, 0.01);
  EXPECT_NEAR(c.scene.far, 2 * kWall * std::hypot(1.0, 0.5, 0.375), 0.1);
  Capture holes;  // beyond a sensor's reach
  holes.set_depth(0, [](int x, int) { return x < 8 ? 0 : kWall; });
  holes.add();
  EXPECT_NEAR(holes.scene.near, 0.5 * kWall, 0.01);
  EXPECT_EQ(holes.scene.far, 50);
  Capture given;
  given.scene.options.near = 0.3;
  given.scene.near = 0.3;
  given.add();
  EXPECT_EQ(given.scene.near, 0.3);
  Capture cloud;
  for (int i = 0; i < 200; ++i) cloud.scene.points.push_back({{0, 0, 3}, 0, 0});
  cloud.add();
  EXPECT_EQ(cloud.scene.near, 0.01);
  EXPECT_GT(cloud.scene.points.size(), 1000u);
}

TEST(DepthPoints, NoneBesideEdgesNorUnderMasks) {
  Capture c(1);
  c.set_depth(0, [](int x, int) { return x < 20 ? kWall : 2 * kWall; });
  Photo& photo = c.photos.photos[0];
  photo.mask.assign(80 * 60, 255);
  for (int y = 0; y < 60; ++y)
    for (int x = 60; x < 80; ++x) photo.mask[static_cast<size_t>(y * 80 + x)] = 0;
  const DepthPoints result = c.add();
  // Of 40 columns: 2 at the edge and 10 below the mask.
  EXPECT_EQ(result.points, 28 * 30);
}

TEST(DepthPoints, APlaceThatOthersLookThroughIsNone) {
  Capture c;
  const auto flying = [](int x, int y) { return x < 12 && y < 12 ? 0.25 * kWall : kWall; };
  c.set_depth(0, flying);
  const DepthPoints result = c.add();
  EXPECT_FALSE(result.rejected);
  EXPECT_GT(result.opposed, 0);
  int close = 0;
  for (const ScenePoint& p : c.scene.points)
    if (p.position.z < 0.5 * kWall) {
      // Only where no other picture shows it.
      const double left = (p.position.x - 0.1) / p.position.z;
      EXPECT_LT(left, -0.5);
      ++close;
    }
  EXPECT_GT(close, 0);
}

TEST(DepthPoints, MapsThatDoNotFitTheCamerasAreNotUsed) {
  Capture wrong;  // of another unit
  for (int i = 0; i < 3; ++i)
    wrong.set_depth(i, [&](int x, int y) { return 0.1 * (kWall + i + 0.03 * (x + y)); });
  const DepthPoints result = wrong.add();
  EXPECT_TRUE(result.rejected);
  EXPECT_EQ(result.points, 0);
  EXPECT_TRUE(wrong.scene.points.empty());
  for (const Photo& photo : wrong.photos.photos) EXPECT_TRUE(photo.depth.empty());
  EXPECT_EQ(wrong.scene.far, 50);
}

TEST(DepthPoints, AreTheSameForAnyNumberOfThreads) {
  Capture one, two;
  one.add(1);
  two.add(2);
  ASSERT_EQ(one.scene.points.size(), two.scene.points.size());
  for (size_t i = 0; i < one.scene.points.size(); ++i)
    EXPECT_EQ(one.scene.points[i].position.x, two.scene.points[i].position.x);
  EXPECT_EQ(one.scene.observations.size(), two.scene.observations.size());
}

TEST(DepthPoints, NoMapsNoChange) {
  Capture c;
  for (Photo& photo : c.photos.photos) photo.depth = {};
  EXPECT_EQ(c.add().maps, 0);
  EXPECT_TRUE(c.scene.points.empty());
  EXPECT_EQ(c.scene.near, 0.01);
}

}  // namespace
}  // namespace nerf
