// Up of captures whose photos lie on their sides, and what the points say of it.
#include <OpenImageIO/imageio.h>
#include <gtest/gtest.h>

#include "io/scene_frame.h"
#include "nerf/math/random.h"
#include "test_images.h"
#include "test_scenes.h"

namespace nerf::internal {
namespace {

using namespace nerf::test;

constexpr double kDegree = std::numbers::pi / 180;

double angle(const Vec3d& a, const Vec3d& b) { return std::acos(std::clamp(dot(a, b), -1.0, 1.0)); }

// The camera turned about its optical axis, so that its picture turns counterclockwise.
Pose rolled(const Pose& pose, double degrees) {
  const double c = std::cos(degrees * kDegree), s = std::sin(degrees * kDegree);
  Mat3d roll;
  roll.m = {{{c, -s, 0}, {s, c, 0}, {0, 0, 1}}};
  return {pose.rotation * roll, pose.translation};
}

View view_of(const Pose& pose, int orientation = 1) {
  View view;
  view.pose = pose;
  view.orientation = orientation;
  return view;
}

// Level cameras on an arc round the origin that look down at it.
std::vector<Pose> arc(int n, double degrees, double height = 2) {
  std::vector<Pose> poses;
  for (int i = 0; i < n; ++i) {
    const double a = degrees * kDegree * i / n;
    poses.push_back(look_at({4 * std::cos(a), 4 * std::sin(a), height + 0.3 * (i % 3)}, {0, 0, 0}));
  }
  return poses;
}

// Points on the plane through (0, 0, -1) across `normal`, and a ball of others above it.
std::vector<ScenePoint> floor_points(const Vec3d& normal, int on_floor, int above) {
  std::vector<ScenePoint> points;
  for (int i = 0; i < on_floor + above; ++i) {
    Random random(5, 0, static_cast<uint64_t>(i));
    const auto draw = [&] { return 2 * static_cast<double>(random.uniform()) - 1; };
    Vec3d p{2 * draw(), 2 * draw(), draw()};
    if (i < on_floor) p.z = -1 - (normal.x * p.x + normal.y * p.y) / normal.z;
    points.push_back({p, 0.5, 4});
  }
  return points;
}

struct Tag {
  int orientation;
  double roll;  // of the stored picture's axes against those of the picture shown, degrees
};
// Orientation 6: the picture is shown after a clockwise turn, so the stored one is turned
// counterclockwise.
constexpr Tag kTags[] = {{3, 180}, {6, 90}, {8, -90}};

TEST(SceneUp, TagsTurnEachPhotosOwnAxes) {
  for (const Tag& tag : kTags) {
    std::vector<View> views;
    for (const Pose& p : arc(12, 150))
      views.push_back(view_of(rolled(p, tag.roll), tag.orientation));
    std::vector<std::string> warnings;
    const UpEstimate up = estimate_up(views, {}, warnings);
    EXPECT_LT(angle(up.up, {0, 0, 1}), 2 * kDegree) << tag.orientation;
    EXPECT_TRUE(up.source.starts_with("from the EXIF orientation")) << up.source;
    EXPECT_TRUE(warnings.empty());
  }
  // Each photo by its own tag.
  std::vector<View> mixed;
  const std::vector<Pose> poses = arc(12, 300);
  for (size_t i = 0; i < poses.size(); ++i) {
    const Tag& tag = kTags[i % 3];
    mixed.push_back(view_of(rolled(poses[i], tag.roll), tag.orientation));
  }
  std::vector<std::string> warnings;
  EXPECT_LT(angle(estimate_up(mixed, {}, warnings).up, {0, 0, 1}), 2 * kDegree);
}

// Where a pixel of the stored picture is shown is what the tag says: of orientation 6, row 0 is the
// right side and column 0 the top.
TEST(SceneUp, TheTagsMeaningIsThatOfTheStandard) {
  const Pose level = look_at({4, 0, 0}, {0, 0, 0});
  const Pose stored = rolled(level, 90);  // the picture as a phone stores it
  EXPECT_GT(dot(-stored.rotation.column(0), Vec3d{0, 0, 1}), 0.99) << "column 0 is the top";
  EXPECT_GT(dot(-stored.rotation.column(1), level.rotation.column(0)), 0.99)
      << "row 0 is the right side";
}

TEST(SceneUp, PhonesHeldSidewaysWithoutTags) {
  std::vector<View> views;
  const std::vector<Pose> poses = arc(24, 240);
  for (size_t i = 0; i < poses.size(); ++i)
    views.push_back(view_of(rolled(poses[i], i % 8 == 0 ? 0 : -90)));
  std::vector<std::string> warnings;
  const UpEstimate up = estimate_up(views, {}, warnings);
  EXPECT_LT(angle(up.up, {0, 0, 1}), 3 * kDegree);
  EXPECT_NE(up.source.find("lie on a side"), std::string::npos) << up.source;
  EXPECT_TRUE(warnings.empty());
  // Held the other way round: the floor tells, and levels exactly what held cameras leave over.
  for (View& view : views) view.pose = rolled(view.pose, 183);
  const UpEstimate with_floor = estimate_up(views, floor_points({0, 0, 1}, 800, 400), warnings);
  EXPECT_LT(angle(with_floor.up, {0, 0, 1}), 0.1 * kDegree);
  EXPECT_NE(with_floor.source.find("plane that"), std::string::npos) << with_floor.source;
}

TEST(SceneUp, AFloorCorrectsALittleAndAWallNothing) {
  std::vector<View> views;
  for (const Pose& p : arc(20, 360)) views.push_back(view_of(rolled(p, 3)));
  const double tilt = 4 * kDegree;
  const Vec3d slope{std::sin(tilt), 0, std::cos(tilt)};
  std::vector<std::string> warnings;
  EXPECT_LT(angle(estimate_up(views, floor_points(slope, 800, 300), warnings).up, slope),
            0.1 * kDegree);
  // A slope steeper than people hold phones off level is a slope.
  const Vec3d steep{std::sin(4 * tilt), 0, std::cos(4 * tilt)};
  EXPECT_LT(angle(estimate_up(views, floor_points(steep, 800, 300), warnings).up, {0, 0, 1}),
            2 * kDegree);
  // Points without any plane say nothing.
  const UpEstimate ball = estimate_up(views, floor_points({0, 0, 1}, 0, 900), warnings);
  EXPECT_EQ(ball.source.find("plane that"), std::string::npos) << ball.source;
}

TEST(SceneUp, AWallTellsHowFarDownCamerasLookThatAllLookOneWay) {
  std::vector<View> views;  // before a wall y = 3, all looking 8 degrees down
  for (int i = 0; i < 12; ++i)
    views.push_back(view_of(look_at({0.2 * i, 0, 0.1 * (i % 3)},
                                    {0.2 * i, 3, 0.1 * (i % 3) - 3 * std::tan(8 * kDegree)})));
  std::vector<std::string> warnings;
  EXPECT_NEAR(angle(estimate_up(views, {}, warnings).up, {0, 0, 1}), 8 * kDegree, 0.1 * kDegree);
  std::vector<ScenePoint> wall;
  for (int i = 0; i < 500; ++i) {
    Random random(6, 0, static_cast<uint64_t>(i));
    wall.push_back({{3 * static_cast<double>(random.uniform()), 3,
                     2 * static_cast<double>(random.uniform()) - 1},
                    0.5,
                    4});
  }
  const UpEstimate up = estimate_up(views, wall, warnings);
  EXPECT_LT(angle(up.up, {0, 0, 1}), 0.1 * kDegree);
  EXPECT_NE(up.source.find("upright plane"), std::string::npos) << up.source;
}

TEST(SceneUp, TheTagIsReadFromTheFile) {
  TempFolder folder;
  for (const int orientation : {1, 6, 8}) {
    const auto file = folder / fmt::format("o{}.jpg", orientation);
    make_image(file,
               {16, 12, 3, OIIO::TypeDesc::UINT8,
                [&](OIIO::ImageSpec& spec) { spec.attribute("Orientation", orientation); }},
               texture);
    EXPECT_EQ(read_image_info(file).orientation, orientation);
  }
  make_image(folder / "none.png", {16, 12, 3, OIIO::TypeDesc::UINT8, {}}, texture);
  EXPECT_EQ(read_image_info(folder / "none.png").orientation, 1);
}

}  // namespace
}  // namespace nerf::internal
