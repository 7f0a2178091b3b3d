// Which cells cannot hold matter, beside what geometry says of a sphere and the cameras around it.
#include "train/visibility.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "nerf/train/trainer.h"
#include "support/synthetic_scene.h"

namespace nerf {
namespace {

constexpr int kSide = 64;

OccupancyGrid carved(const test::SyntheticCapture& c, const TrainOptions& options = {},
                     int threads = 2, int cascades = 1) {
  OccupancyGrid grid(cascades, kSide);
  ThreadPool pool(threads);
  switch_off_impossible_cells(c.scene, c.photos, options, pool, grid);
  return grid;
}

struct Ball {
  Vec3d centre;
  double radius;
};

// Around a cell, or around the cube of 4^3 cells whose first it is.
Ball ball_of(const OccupancyGrid& grid, int64_t cell, int side = 1, int cascade = 0) {
  const double half = 0.5 * side * grid.cell_width(cascade);
  return {grid.cell_corner(cell, cascade).cast<double>() + Vec3d{half, half, half},
          std::sqrt(3.0) * half};
}

double angle_between(const Vec3d& a, const Vec3d& b) {
  return std::acos(std::clamp(dot(normalized(a), normalized(b)), -1.0, 1.0));
}

// The angle by which the ball is apart from the sphere, as view v sees both; as far below 0 as
// they overlap.
double apart(const test::SyntheticCapture& c, int v, const Ball& ball) {
  const Vec3d eye = c.scene.views[static_cast<size_t>(v)].pose.translation;
  const Vec3d to_ball = ball.centre - eye;
  return angle_between(to_ball, -eye) - std::asin(test::kSphereRadius / length(eye)) -
         std::asin(std::min(1.0, ball.radius / length(to_ball)));
}

// How far the ball's centre is inside the edges of view v's picture, at a depth of 1.
double inside_picture(const test::SyntheticCapture& c, int v, const Ball& ball) {
  const Vec3d p = c.scene.views[static_cast<size_t>(v)].pose.inverse() * ball.centre;
  return p.z <= 0
             ? -1
             : std::tan(0.5 * test::kFieldOfView) - std::max(std::fabs(p.x), std::fabs(p.y)) / p.z;
}

TEST(Visibility, KeepsWhatEveryPhotoShows) {
  const auto c = test::sphere_capture(24, 128);
  const OccupancyGrid grid = carved(c);
  int64_t inside = 0;
  for (int64_t i = 0; i < grid.cells(); ++i) {
    const Ball cell = ball_of(grid, i);
    if (length(cell.centre) > test::kSphereRadius + 0.5 * grid.cell_width(0)) continue;
    ++inside;
    ASSERT_FALSE(grid.is_off(0, i)) << "cell " << i << " at " << length(cell.centre);
  }
  EXPECT_GT(inside, grid.cells() / 8);
}

// A cell's footprint is taken generously: half as large again, in blocks of four pixels, and one
// more beside it. What two photos of 18 show apart from the sphere by more than that is off.
TEST(Visibility, SwitchesOffWhatTwoPhotosShowAsTransparent) {
  constexpr int kSize = 256;
  const auto c = test::sphere_capture(24, kSize);
  const OccupancyGrid grid = carved(c);
  // A pixel is widest, as an angle, in the middle of the picture; the ball's square has corners.
  const double pixel = 2 * std::tan(0.5 * test::kFieldOfView) / kSize;
  const double blocks = std::sqrt(2.0) * 5 * pixel;
  int64_t clear = 0, off = 0;
  for (int64_t i = 0; i < grid.cells(); ++i) {
    const Ball cell = ball_of(grid, i);
    off += grid.is_off(0, i);
    const auto shown = std::ranges::count_if(c.scene.train, [&](int v) {
      const Pose& pose = c.scene.views[static_cast<size_t>(v)].pose;
      const double depth = (pose.inverse() * cell.centre).z;
      const double margin =
          blocks + 1.5 * std::sqrt(2.0) * cell.radius / std::max(depth - cell.radius, 1e-9);
      return inside_picture(c, v, cell) > margin && apart(c, v, cell) > margin;
    });
    if (shown < 2) continue;
    ++clear;
    ASSERT_TRUE(grid.is_off(0, i)) << "cell " << i << " at " << length(cell.centre);
  }
  EXPECT_GT(clear, grid.cells() / 10);
  EXPECT_GT(off, grid.cells() / 2);
  EXPECT_LT(off, grid.cells() * 9 / 10);
}

// Makes a square around the middle of the i-th training photo transparent.
void cut_hole(test::SyntheticCapture& c, size_t i) {
  Photo& photo = c.photos.photos[static_cast<size_t>(c.scene.train[i])];
  for (int y = photo.height / 3; y < 2 * photo.height / 3; ++y)
    for (int x = photo.width / 3; x < 2 * photo.width / 3; ++x)
      photo.pixels8[4 * static_cast<size_t>(y * photo.width + x) + 3] = 0;
}

// The cells of the sphere that are off.
int64_t lost_cells(const OccupancyGrid& grid) {
  int64_t lost = 0;
  for (int64_t i = 0; i < grid.cells(); ++i)
    lost += grid.is_off(0, i) && length(ball_of(grid, i).centre) < test::kSphereRadius;
  return lost;
}

TEST(Visibility, WrongMattesOfFewPhotosEraseNothing) {
  const struct {
    int views;
    size_t holes, lost_from;
  } cases[] = {{24, 1, 2}, {72, 2, 3}};  // 18 and 54 photos to train on
  for (const auto& k : cases) {
    auto c = test::sphere_capture(k.views, 64);
    ASSERT_EQ(static_cast<size_t>(matte_agreement(c.scene.train.size())), k.lost_from);
    for (size_t i = 0; i < k.holes; ++i) cut_hole(c, i);
    EXPECT_EQ(lost_cells(carved(c)), 0) << k.views;
    for (size_t i = k.holes; i < 2 * k.lost_from; ++i) cut_hole(c, i);
    EXPECT_GT(lost_cells(carved(c)), 100) << k.views;
  }
}

TEST(Visibility, FewPhotosAreBelievedEach) {
  EXPECT_EQ(matte_agreement(9), 1);
  auto c = test::sphere_capture(8, 64);
  EXPECT_EQ(lost_cells(carved(c)), 0);
  cut_hole(c, 0);
  EXPECT_GT(lost_cells(carved(c)), 100);
}

// Far out, where pictures do not overlap.
TEST(Visibility, SwitchesOffWhatAllThatSeeItShowAsTransparent) {
  auto c = test::sphere_capture(16, 128);
  ASSERT_EQ(matte_agreement(c.scene.train.size()), 2);
  constexpr int kCascade = 2;
  TrainOptions options;
  options.grid_recipe.keep_unseen = true;
  const OccupancyGrid grid = carved(c, options, 2, kCascade + 1);
  int64_t seen_once = 0;
  for (int64_t i = 0; i < grid.cells(); ++i) {
    const Ball cell = ball_of(grid, i, 1, kCascade);
    int seen = 0, clear = 0, outside = 0;
    for (const int v : c.scene.train) {
      const double inside = inside_picture(c, v, cell);
      const Pose& pose = c.scene.views[static_cast<size_t>(v)].pose;
      const Vec3d p = pose.inverse() * cell.centre;
      const double margin = 0.05 + 2 * cell.radius / std::max(p.z - cell.radius, 1e-9);
      // Outside of the cone through the picture's corners, which no cell touches.
      const double corner = std::atan(std::sqrt(2.0) * std::tan(0.5 * test::kFieldOfView));
      outside += length(p) > cell.radius &&
                 angle_between(p, {0, 0, 1}) > corner + std::asin(cell.radius / length(p)) + 1e-6;
      seen += inside > margin;
      clear += p.z > cell.radius && inside > margin && apart(c, v, cell) > margin;
    }
    if (seen != 1 || clear != 1 || seen + outside != static_cast<int>(c.scene.train.size()))
      continue;
    ++seen_once;
    ASSERT_TRUE(grid.is_off(kCascade, i)) << i;
  }
  EXPECT_GT(seen_once, 50);
}

// Cameras of another lens, turned so far that the sphere stands beside the middle of their
// pictures.
test::SyntheticCapture beside_the_middle(const Camera& camera, double turn) {
  constexpr double kDistance = 2.2;
  test::SyntheticCapture c = test::sphere_capture(4, 8);
  const double s = std::sin(turn), k = std::cos(turn);
  for (size_t i = 0; i < c.scene.views.size(); ++i) {
    Pose& pose = c.scene.views[i].pose;
    const Vec3d right = pose.rotation.column(0), forward = pose.rotation.column(2);
    pose.rotation.set_column(0, right * k + forward * s);
    pose.rotation.set_column(2, forward * k - right * s);
    pose.translation = pose.translation * (kDistance / test::kCameraDistance);
    c.photos.cameras[i] = camera;
    c.photos.photos[i] = test::sphere_photo(camera, pose, 1);
  }
  c.scene.cameras = {camera};
  return c;
}

// No photo shows as transparent what meets the sphere. Returns how many cells are off.
int64_t expect_sphere_kept(const test::SyntheticCapture& c) {
  constexpr int kCascades = 2;
  TrainOptions options;
  options.grid_recipe.keep_unseen = true;
  const OccupancyGrid grid = carved(c, options, 2, kCascades);
  int64_t off = 0;
  for (int cascade = 0; cascade < kCascades; ++cascade)
    for (int64_t i = 0; i < grid.cells(); ++i) {
      off += grid.is_off(cascade, i);
      const double distance = length(ball_of(grid, i, 1, cascade).centre);
      if (distance > test::kSphereRadius + 0.5 * grid.cell_width(cascade)) continue;
      EXPECT_FALSE(grid.is_off(cascade, i))
          << "cascade " << cascade << ", cell " << i << " at " << distance;
      if (grid.is_off(cascade, i)) return off;
    }
  return off;
}

TEST(Visibility, KeepsTheSphereInPicturesOfWideLenses) {
  Camera pinhole;
  pinhole.width = 1201;
  pinhole.height = 501;
  pinhole.model = CameraModel::kPinhole;
  pinhole.params = {200, 200, 600.5, 250.5};  // 143 degrees across
  Camera fisheye = pinhole;
  fisheye.model = CameraModel::kOpenCVFisheye;
  fisheye.params = {400, 400, 600.5, 250.5, 0.02, -0.01, 0, 0};
  Camera field_of_view = pinhole;
  field_of_view.model = CameraModel::kFov;  // 2.8 times as large in the middle as at the border
  field_of_view.params = {700, 700, 600.5, 250.5, 2.6};
  for (const Camera& camera : {pinhole, fisheye, field_of_view})
    for (const double turn : {0.0, 0.33, 0.8, 1.45, 1.51}) {
      SCOPED_TRACE(std::string(camera_model_name(camera.model)) + ", turned " +
                   std::to_string(turn));
      EXPECT_GT(expect_sphere_kept(beside_the_middle(camera, turn)), 1000);
    }
}

// A photo is looked at in blocks of four pixels, of which the last may reach beyond it.
TEST(Visibility, KeepsWhatIsBesideAPictureOfOddSize) {
  Camera camera;
  camera.width = camera.height = 9;
  camera.model = CameraModel::kPinhole;
  camera.params = {20, 20, 4.5, 4.5};
  // The sphere begins a third of a pixel beside the pictures: they show nothing at all.
  const double outline = std::asin(test::kSphereRadius / 2.2), border = std::atan(4.8 / 20);
  for (const double turn : {outline + border, -outline - border})
    EXPECT_GT(expect_sphere_kept(beside_the_middle(camera, turn)), 100);
}

TEST(Visibility, SwitchesOffBricksOutsideEveryPicture) {
  auto c = test::sphere_capture(8, 32);
  c.scene.train = {1, 2};
  TrainOptions options;
  options.grid_recipe.keep_transparent = true;
  constexpr int kCascades = 3;
  const OccupancyGrid grid = carved(c, options, 2, kCascades);
  int64_t seen = 0, unseen = 0;
  for (int cascade = 0; cascade < kCascades; ++cascade)
    for (int64_t i = 0; i < grid.cells(); i += 64) {
      const Ball brick = ball_of(grid, i, 4, cascade);
      bool some = false, none = true;
      for (const int v : c.scene.train) {
        const Pose& pose = c.scene.views[static_cast<size_t>(v)].pose;
        const Vec3d p = pose.inverse() * brick.centre;
        some |= inside_picture(c, v, brick) > 0;
        // Outside the cone through the picture's corners.
        const double corner = std::atan(std::sqrt(2.0) * std::tan(0.5 * test::kFieldOfView));
        none &= length(p) > brick.radius &&
                angle_between(p, {0, 0, 1}) > corner + std::asin(brick.radius / length(p)) + 1e-6;
      }
      for (int64_t cell = i; cell < i + 64; ++cell) {
        if (some) {
          ASSERT_FALSE(grid.is_off(cascade, cell));
        }
        if (none) {
          ASSERT_TRUE(grid.is_off(cascade, cell));
        }
      }
      seen += some;
      unseen += none;
    }
  EXPECT_GT(seen, 500);
  EXPECT_GT(unseen, 500);
}

TEST(Visibility, MaskedOutPixelsSayNothing) {
  auto c = test::sphere_capture(8, 32);
  for (Photo& photo : c.photos.photos) photo.mask.assign(static_cast<size_t>(32 * 32), 0);
  TrainOptions unseen;
  unseen.grid_recipe.keep_transparent = true;
  const OccupancyGrid masked = carved(c), grid = carved(c, unseen);
  // Masked, single cells are asked for, which fewer eyes may see than see their brick.
  int64_t off = 0;
  for (int64_t i = 0; i < grid.cells(); ++i) {
    off += grid.is_off(0, i);
    if (!masked.is_off(0, i)) continue;
    for (const int v : c.scene.train) ASSERT_LT(inside_picture(c, v, ball_of(grid, i)), 0) << i;
  }
  EXPECT_LT(off, grid.cells());
}

TEST(Visibility, SameForAnyNumberOfThreads) {
  const auto c = test::sphere_capture(8, 64);
  const OccupancyGrid one = carved(c, {}, 1), three = carved(c, {}, 3);
  EXPECT_TRUE(std::ranges::equal(one.training_state(), three.training_state()));
}

}  // namespace
}  // namespace nerf
