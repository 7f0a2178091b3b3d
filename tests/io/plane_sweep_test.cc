// Points that a plane sweep finds, beside the surface that the photos were made of.
#include "nerf/io/plane_sweep.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

namespace nerf {
namespace {

constexpr double kFloor = -0.5, kBall = 0.6;

double wall_colour(double a, double b, double c) {
  return 0.5 + 0.15 * (std::sin(9 * a + 2) * std::sin(11 * b) + std::sin(17 * a + 5 * c) +
                       std::sin(23 * b - 4 * c));
}

// Grey of what a ray sees: a ball about the origin on a floor below it, before a plain wall of sky.
double grey_of(const Vec3d& eye, const Vec3d& d) {
  const double b = dot(eye, d), root = b * b - (dot(eye, eye) - kBall * kBall);
  if (root > 0) {
    const Vec3d p = eye + d * (-b - std::sqrt(root));
    return wall_colour(p.x, p.y, p.z);
  }
  if (d.z < 0) {
    const Vec3d p = eye + d * ((kFloor - eye.z) / d.z);
    if (std::hypot(p.x, p.y) < 3) return wall_colour(0.7 * p.x, 0.7 * p.y, 0);
  }
  return 0.8;
}

struct Capture {
  Scene scene;
  PhotoSet photos;
};

// Cameras on an arc that look at the origin from a distance of 2.
Capture capture(int count) {
  Capture c;
  c.scene.unbounded = true;
  c.scene.near = 0.02;
  c.scene.far = 50;
  Camera camera;
  camera.width = 160;
  camera.height = 120;
  camera.params = {140, 140, 80, 60};
  for (int i = 0; i < count; ++i) {
    const double angle = 0.17 * i;
    const Vec3d eye{1.9 * std::cos(angle), 1.9 * std::sin(angle), 0.6};
    const Vec3d forward = normalized(-eye), right = normalized(cross(forward, Vec3d{0, 0, 1}));
    View view;
    view.pose.rotation.set_column(0, right);
    view.pose.rotation.set_column(1, cross(forward, right));
    view.pose.rotation.set_column(2, forward);
    view.pose.translation = eye;
    Photo photo;
    photo.width = camera.width;
    photo.height = camera.height;
    for (int y = 0; y < photo.height; ++y)
      for (int x = 0; x < photo.width; ++x) {
        const auto d = unproject(camera, {x + 0.5, y + 0.5});
        const double g = grey_of(eye, normalized(view.pose.rotation * *d));
        photo.pixels8.insert(photo.pixels8.end(), 3, static_cast<uint8_t>(std::lround(255 * g)));
      }
    c.scene.views.push_back(view);
    c.scene.train.push_back(i);
    c.photos.photos.push_back(std::move(photo));
    c.photos.cameras.push_back(camera);
  }
  c.scene.cameras = {camera};
  return c;
}

int sweep(Capture& c, int threads = 2) {
  ThreadPool pool(threads);
  return add_swept_points(c.scene, c.photos, pool);
}

double distance_to_surface(const Vec3d& p) {
  return std::min(std::abs(length(p) - kBall), std::abs(p.z - kFloor));
}

TEST(PlaneSweep, PointsLieOnTheSurface) {
  Capture c = capture(9);
  const int added = sweep(c);
  ASSERT_EQ(added, static_cast<int>(c.scene.points.size()));
  ASSERT_GT(added, 1000);
  std::vector<double> off;
  for (const ScenePoint& p : c.scene.points) off.push_back(distance_to_surface(p.position));
  std::sort(off.begin(), off.end());
  // A plane is 1 / (0.1 * 2 * 127) in inverse depth from the next: 0.16 at a distance of 2. Half of
  // that is the least that a parabola through three scores must do.
  EXPECT_LT(off[off.size() / 2], 0.08);
  EXPECT_LT(off[off.size() * 9 / 10], 0.16);
}

TEST(PlaneSweep, EveryPointNamesTwoPhotosOrMore) {
  Capture c = capture(9);
  sweep(c);
  std::vector<int> views(c.scene.points.size());
  for (const Observation& o : c.scene.observations) {
    ASSERT_LT(static_cast<size_t>(o.image), c.scene.views.size());
    ++views[static_cast<size_t>(o.point)];
  }
  for (size_t i = 0; i < views.size(); ++i) {
    EXPECT_GE(views[i], 2);
    EXPECT_EQ(views[i], c.scene.points[i].views);
  }
}

TEST(PlaneSweep, IsTheSameForAnyNumberOfThreads) {
  Capture one = capture(5), two = capture(5);
  ASSERT_EQ(sweep(one, 1), sweep(two, 2));
  for (size_t i = 0; i < one.scene.points.size(); ++i)
    ASSERT_EQ(length(one.scene.points[i].position - two.scene.points[i].position), 0);
}

TEST(PlaneSweep, FindsNothingWhereNothingCanBeRecognised) {
  Capture c = capture(5);
  for (Photo& p : c.photos.photos) std::fill(p.pixels8.begin(), p.pixels8.end(), uint8_t{128});
  EXPECT_EQ(sweep(c), 0);
  Capture masked = capture(5);
  for (Photo& p : masked.photos.photos)
    p.mask.assign(static_cast<size_t>(p.width) * static_cast<size_t>(p.height), 0);
  EXPECT_EQ(sweep(masked), 0);
}

TEST(PlaneSweep, LeavesCapturesAloneThatHavePointsOrAlpha) {
  Capture c = capture(3);
  for (int i = 0; i < kFewPoints; ++i) {
    c.scene.points.push_back({{0, 0, 0}, 0.5, 1});
    c.scene.observations.push_back({0, i});
  }
  EXPECT_EQ(sweep(c), 0);
  Capture alpha = capture(3);
  alpha.scene.alpha = true;
  EXPECT_EQ(sweep(alpha), 0);
}

TEST(PlaneSweep, OnePhotoFromCloseUpDoesNotCoarsenTheOthers) {
  Capture c = capture(9);
  View& close = c.scene.views[8];
  close.pose.translation = close.pose.translation * 0.1;
  EXPECT_GT(sweep(c), 800);
}

TEST(PlaneSweep, LeavesNearToAPointCloudAndToTheOption) {
  Capture cloud = capture(9);
  cloud.scene.points.assign(kFewPoints, {{0, 0, 0}, 0, 0});
  EXPECT_GT(sweep(cloud), 1000);
  EXPECT_EQ(cloud.scene.near, 0.02);
  Capture given = capture(9);
  given.scene.options.near = given.scene.near = 5;
  sweep(given);
  EXPECT_EQ(given.scene.near, 5);
  EXPECT_GE(given.scene.far, 10);
}

TEST(PlaneSweep, LooksAtNarrowLensesOnly) {
  Capture c = capture(5);
  for (Camera& camera : c.photos.cameras) camera.params = {60, 60, 80, 60};  // 53 degrees aside
  EXPECT_EQ(sweep(c), 0);
}

TEST(PlaneSweep, TellsWhereContentBegins) {
  Capture c = capture(9);
  sweep(c);
  // The nearest of the ball is 1.4 away; half of that is safe, a tenth would be fog's.
  EXPECT_GT(c.scene.near, 0.4);
  EXPECT_LT(c.scene.near, 1.3);
  EXPECT_GE(c.scene.far, 4);
}

}  // namespace
}  // namespace nerf
