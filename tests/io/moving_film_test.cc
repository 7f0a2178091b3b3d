// What moves in a film, of pictures that are drawn here: a textured wall, and a square before it.
#include "io/moving_film.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "io/corner_tracks.h"
#include "nerf/io/image.h"
#include "support/temp_folder.h"
#include "test_scenes.h"

namespace nerf::internal {
namespace {

using namespace nerf::test;

constexpr int kFrames = 12, kWidth = 320, kHeight = 240;
constexpr double kFocal = 300;
constexpr double kWall = 4, kSquare = 3;  // their depths

// Even between random values, one each 0.1 units.
double wall_grey(double x, double y) {
  constexpr int kSize = 64;
  static const std::vector<double> values = [] {
    std::mt19937 random(7);
    std::vector<double> out;
    for (int i = 0; i < kSize * kSize; ++i)
      out.push_back(static_cast<double>(random()) / std::mt19937::max());
    return out;
  }();
  x = 10 * x + 1000;
  y = 10 * y + 1000;
  const int i = static_cast<int>(x), j = static_cast<int>(y);
  const double u = x - i, v = y - j;
  const auto at = [&](int a, int b) {
    return values[static_cast<size_t>((a % kSize) * kSize + b % kSize)];
  };
  return (1 - u) * ((1 - v) * at(i, j) + v * at(i, j + 1)) +
         u * ((1 - v) * at(i + 1, j) + v * at(i + 1, j + 1));
}

// The camera goes 0.04 to the right from frame to frame, the square by `velocity`. In the middle of
// the film everything falls by `jump` pixels.
SweepImage drawn(int frame, const Vec2d& velocity, int jump = 0) {
  SweepImage image{kWidth, kHeight, kFocal, {}, {}};
  const double eye = 0.04 * frame;
  const int fall = 2 * frame < kFrames ? 0 : jump;
  image.to_engine.translation = {eye, 0, 0};
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x) {
      const double dx = (x + 0.5 - image.cx()) / kFocal,
                   dy = (y + 0.5 - fall - image.cy()) / kFocal;
      const double sx = eye + kSquare * dx - velocity.x * frame - 0.3;
      const double sy = kSquare * dy - velocity.y * frame;
      const bool on_square = std::abs(sx) < 0.5 && std::abs(sy) < 0.5;
      image.grey.push_back(static_cast<float>(on_square ? wall_grey(sx + 3, sy + 3)
                                                        : wall_grey(eye + kWall * dx, kWall * dy)));
    }
  return image;
}

CornerTracks tracks_of(const Vec2d& velocity, int threads = 1, int jump = 0) {
  std::vector<SweepImage> frames;
  for (int i = 0; i < kFrames; ++i) frames.push_back(drawn(i, velocity, jump));
  ThreadPool pool(threads);
  return follow_corners(frames, pool);
}

TEST(CornerTracks, WhatStandsStillIsFoundStandingStill) {
  const CornerTracks still = tracks_of({0, 0});
  EXPECT_GT(still.followed, 500);
  // At the square's corners, before the wall, there are some that nothing has.
  EXPECT_LE(still.moving, still.followed / 200);
}

TEST(CornerTracks, ASquareThatMovesAcrossIsFoundMoving) {
  for (const double speed : {0.02, -0.02}) {
    const CornerTracks found = tracks_of({0, speed}, 2);
    // The square is a hundred pixels wide, an eighth of the picture.
    const double share = static_cast<double>(found.moving) / static_cast<double>(found.followed);
    EXPECT_GT(share, 0.06);
    EXPECT_LT(share, 0.14);
    const CornerTracks one = tracks_of({0, speed});
    EXPECT_EQ(one.followed, found.followed);
    EXPECT_EQ(one.moving, found.moving);
  }
}

// As where a corner is taken for the next one of a pattern.
TEST(CornerTracks, AJumpIsNoMotion) {
  const CornerTracks found = tracks_of({0, 0}, 1, 10);
  EXPECT_GT(found.followed, 500);
  EXPECT_LE(found.moving, found.followed / 100);
}

// It looks like one that stands still at another depth.
TEST(CornerTracks, WhatMovesAlongTheCamerasWayCannotBeTold) {
  EXPECT_EQ(tracks_of({0.01, 0}).moving, 0);
}

TEST(CornerTracks, FewFramesTellNothing) {
  std::vector<SweepImage> frames;
  ThreadPool pool(1);
  for (int i = 0; i < 7; ++i) frames.push_back(drawn(i, {0, 0.02}));
  EXPECT_EQ(follow_corners(frames, pool).followed, 0);
  frames.push_back(drawn(7, {0, 0.02}));
  EXPECT_GT(follow_corners(frames, pool).followed, 100);
  Cancel cancel;
  cancel.request();
  EXPECT_THROW(follow_corners(frames, pool, &cancel), Cancelled);
}

// As a film's frames come from load_scene(): files, and views in the order of names.
SceneInput film(const TempFolder& folder, const Vec2d& velocity) {
  SceneInput input;
  Camera camera;
  camera.width = kWidth;
  camera.height = kHeight;
  camera.params = {kFocal, kFocal, 0.5 * kWidth, 0.5 * kHeight};
  input.cameras = {camera};
  input.times = SceneInput::Times{.source = "film.mp4", .seconds = true, .on_request = true};
  for (int i = 0; i < kFrames; ++i) {
    const SweepImage frame = drawn(i, velocity);
    Image8 image{kWidth, kHeight, 1, {}};
    for (const float g : frame.grey)
      image.pixels.push_back(static_cast<uint8_t>(std::lround(255 * g)));
    View view;
    view.name = std::to_string(kFrames - i) + ".png";
    view.image_path = folder / view.name;
    view.pose = frame.to_engine;
    view.time = 0.5 * i;
    write_image(view.image_path, image);
    input.views.insert(input.views.begin(), view);
  }
  return input;
}

TEST(MovingFilm, SaysWhatItFound) {
  const TempFolder folder;
  SceneReport report;
  EXPECT_FALSE(film_moves(film(folder, {0, 0}), report, {}, nullptr));
  EXPECT_TRUE(any_contains(report.notes, "0 % of "));
  report.notes.clear();
  std::string told;
  EXPECT_TRUE(film_moves(
      film(folder, {0, 0.02}), report, [&](const std::string& line) { told += line; }, nullptr));
  EXPECT_TRUE(any_contains(report.notes, "--times none"));
  EXPECT_EQ(told, "looking for what moves in film.mp4");
}

}  // namespace
}  // namespace nerf::internal
