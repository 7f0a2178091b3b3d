// Panoramas without poses: recognised, cut into perspective views, posed by what those agree on.
#include "io/panoramas.h"

#include <cmath>
#include <numbers>

#include "io/cameras/capture_photos.h"
#include "io/panorama_cuts.h"
#include "nerf/math/camera_paths.h"
#include "test_images.h"
#include "test_scenes.h"

namespace nerf::internal {
namespace {

namespace fs = std::filesystem;
using namespace nerf::test;

// The colour of a direction, [0, 1], slow enough for bilinear interpolation.
float sky(const Vec3d& d, int c) {
  return static_cast<float>(0.5 + 0.2 * d[c] + 0.2 * std::sin(3 * d[(c + 1) % 3] + d.z));
}

float sphere_pixel(const Camera& camera, int x, int y, int c) {
  return sky(*unproject(camera, {x + 0.5, y + 0.5}), c);
}

void write_panorama(const fs::path& path, int width = 256, int height = 128) {
  const Camera camera = panorama(width, height);
  make_image(path, {width, height, 3, OIIO::TypeDesc::UINT8, {}},
             [&](int x, int y, int c) { return sphere_pixel(camera, x, y, c); });
}

class Panoramas : public ::testing::Test {
 protected:
  bool recognised() const {
    return are_panoramas(folder_.path(), capture_photo_names(folder_.path(), {}));
  }
  TempFolder folder_;
};

TEST_F(Panoramas, AreRecognisedByTheirEdges) {
  for (const char* name : {"a.png", "b.png", "c.png"}) write_panorama(folder_ / name);
  EXPECT_TRUE(recognised());
  write_panorama(folder_ / "d.png", 256, 192);
  EXPECT_FALSE(recognised()) << "one of another shape";
}

TEST_F(Panoramas, PhotosTwiceAsWideAsHighAreNone) {
  for (const char* name : {"a.png", "b.png"})
    make_image(folder_ / name, {128, 64, 3, OIIO::TypeDesc::UINT8, {}}, texture);
  EXPECT_FALSE(recognised());
}

// Everything meets everything else on a white ground.
TEST_F(Panoramas, ProductsBeforeWhiteAreNone) {
  for (const char* name : {"a.png", "b.png"})
    make_image(folder_ / name, {128, 64, 3, OIIO::TypeDesc::UINT8, {}}, [](int x, int y, int c) {
      return std::hypot(x - 64, y - 32) < 20 ? texture(x, y, c) : 1.0f;
    });
  EXPECT_FALSE(recognised());
}

TEST_F(Panoramas, AreRecognisedByTheirXmp) {
  for (const char* name : {"a.jpg", "b.jpg"})
    make_image(folder_ / name,
               {128, 64, 3, OIIO::TypeDesc::UINT8,
                [](OIIO::ImageSpec& spec) {
                  spec.attribute("ImageDescription", "GPano:ProjectionType=\"equirectangular\"");
                }},
               texture);
  EXPECT_TRUE(recognised());
}

TEST_F(Panoramas, PicturesOfARunAreNoPhotos) {
  for (const char* name : {"a.png", "run/eval/b.png", "c/d.png"}) {
    fs::create_directories((folder_ / name).parent_path());
    write_panorama(folder_ / name, 16, 8);
  }
  EXPECT_EQ(capture_photo_names(folder_.path(), {folder_ / "run" / "capture", folder_ / "run"}),
            (std::vector<std::string>{"a.png", "c/d.png"}));
  EXPECT_EQ(capture_photo_names(folder_ / "run" / "eval", {folder_ / "run", {}}).size(), 1u);
}

// Every cut shows the colours of its own directions, round the seam as well.
TEST(PanoramaCuts, ShowWhatTheirRaysSee) {
  const Camera around = panorama(1024, 512);
  Image8 image{1024, 512, 3, {}};
  for (int y = 0; y < 512; ++y)
    for (int x = 0; x < 1024; ++x)
      for (int c = 0; c < 3; ++c)
        image.pixels.push_back(
            static_cast<uint8_t>(std::lround(255 * sphere_pixel(around, x, y, c))));
  ThreadPool pool(2);
  for (int k = 0; k < kCutsPerPanorama; ++k) {
    const Camera camera = cut_camera(1024, k);
    // As sharp in the middle as the panorama, and this share of the side is what EXIF will say.
    EXPECT_NEAR(camera.fx(), around.fx(), 0.5);
    EXPECT_DOUBLE_EQ(camera.fx(), cut_film_focal(k) / 35.0 * camera.width);
    const Image8 cut = cut_panorama(image, k, pool);
    ASSERT_EQ(cut.width, camera.width);
    const double turn = 2 * std::numbers::pi * k / kLevelCuts;
    for (int y = 0; y < cut.height; y += 9)
      for (int x = 0; x < cut.width; x += 7) {
        const Vec3d d = normalized(*unproject(camera, {x + 0.5, y + 0.5}));
        const Vec3d seen = k == 6   ? Vec3d{d.x, d.z, -d.y}  // down, y points there
                           : k == 7 ? Vec3d{d.x, -d.z, d.y}
                                    : Vec3d{std::cos(turn) * d.x + std::sin(turn) * d.z, d.y,
                                            -std::sin(turn) * d.x + std::cos(turn) * d.z};
        for (int c = 0; c < 3; ++c)
          ASSERT_NEAR(cut.pixels[static_cast<size_t>(3 * (y * cut.width + x) + c)],
                      255 * sky(seen, c), 1.6)
              << k << ": " << x << ' ' << y;
      }
  }
}

// What is linear stays so, small pictures are enlarged, and no overshoot wraps round.
TEST(PanoramaCuts, SmallPanoramasAreEnlarged) {
  Image8 image{64, 32, 1, {}};
  for (int y = 0; y < 32; ++y)
    for (int x = 0; x < 64; ++x) image.pixels.push_back(x < 32 ? 0 : 255);
  ThreadPool pool(1);
  const Image8 cut = cut_panorama(image, 0, pool);
  ASSERT_EQ(cut.width, 320);
  // Half-way between two samples Catmull and Rom's cubic rises by 5/4 of their difference.
  const double pixels_per_pixel = cut_camera(64, 0).fx() / panorama(64, 32).fx();
  const double slope = 1.25 * 255 / pixels_per_pixel;
  for (int x = 0; x < 320; ++x) {
    const int value = cut.pixels[static_cast<size_t>(320 * 160 + x)];
    if (x < 120 || x >= 200) {
      EXPECT_EQ(value, x < 160 ? 0 : 255) << x;
    } else if (x >= 155 && x < 165) {
      EXPECT_NEAR(value, 128 + (x + 0.5 - 160) * slope, 12) << x;
    }
  }
}

TEST(PanoramaCuts, FilesSayTheirFocalLength) {
  const TempFolder folder;
  for (const auto& [k, focal] : {std::pair{3, 17}, {6, 9}, {7, 9}}) {
    write_cut(folder / "cut.jpg", k, {64, 64, 3, std::vector<uint8_t>(3 * 64 * 64, 90)});
    const auto in = OIIO::ImageInput::open((folder / "cut.jpg").string());
    ASSERT_TRUE(in);
    EXPECT_EQ(in->spec().get_int_attribute("Exif:FocalLengthIn35mmFilm"), focal);
  }
  EXPECT_FALSE(error_of([&] { write_cut(folder / "none" / "cut.jpg", 0, {8, 8, 3, {}}); }).empty());
}

Mat3d small_turn(double radians) {
  Mat3d r;
  r.m = {{{std::cos(radians), -std::sin(radians), 0},
          {std::sin(radians), std::cos(radians), 0},
          {0, 0, 1}}};
  return r;
}

const Pose kPose = look_at({3, -2, 1}, {0.5, 0.2, -0.4}, normalized(Vec3d{0.1, -0.3, 1}));

PlacedCut cut_of(int k, double off = 0, const Vec3d& moved = {}) {
  return {k, {kPose.rotation * small_turn(off) * cut_rotation(k), kPose.translation + moved}};
}

TEST(PoseFromCuts, IsTheOneThatMostAgreeOn) {
  std::vector<PlacedCut> cuts;
  for (int k = 0; k < 5; ++k) cuts.push_back(cut_of(k, 0.002 * (k - 2), {0.01 * (k - 2), 0, 0}));
  cuts.push_back(cut_of(5, 1.0, {7, 7, 7}));  // taken for another place
  const auto pose = pose_from_cuts(cuts);
  ASSERT_TRUE(pose);
  EXPECT_LT(length(pose->translation - kPose.translation), 1e-12);
  for (int c = 0; c < 3; ++c)
    EXPECT_LT(length(pose->rotation.column(c) - kPose.rotation.column(c)), 1e-5);
  const std::vector<PlacedCut> two{cut_of(3), cut_of(4)}, one{cut_of(3)};
  ASSERT_TRUE(pose_from_cuts(two));
  EXPECT_LT(length(pose_from_cuts(two)->rotation.column(0) - kPose.rotation.column(0)), 1e-12);
  EXPECT_FALSE(pose_from_cuts(one));  // nothing says that it is right
  std::vector<PlacedCut> sees_much = one;
  sees_much[0].points = 100;
  ASSERT_TRUE(pose_from_cuts(sees_much));
  EXPECT_LT(length(pose_from_cuts(sees_much)->rotation.column(2) - kPose.rotation.column(2)),
            1e-12);
}

TEST(PoseFromCuts, IsNoneWhereCutsDisagree) {
  EXPECT_FALSE(pose_from_cuts({}));
  EXPECT_FALSE(pose_from_cuts(std::vector{cut_of(0), cut_of(1, 0.5)}));
  EXPECT_FALSE(pose_from_cuts(std::vector{cut_of(0), cut_of(1, 0.5), cut_of(2, 1.5)}));
}

// A model of the cuts of three panoramas becomes one of the panoramas: the last one's cuts say
// nothing in common, a point that two cuts of one panorama see is seen once by it.
TEST_F(Panoramas, TakeTheirPosesAndPointsFromTheCuts) {
  const std::vector<std::string> names{"a.png", "b.png", "lost.png"};
  for (const std::string& name : names) write_panorama(folder_ / name, 64, 32);
  SceneInput cuts;
  cuts.format = "COLMAP binary";
  const auto place = [&](size_t i, int k, const Pose& panorama) {
    View view;
    view.name = cut_name(i, k);
    view.pose = {panorama.rotation * cut_rotation(k), panorama.translation};
    cuts.views.push_back(view);
  };
  const Pose a = ring_pose(0, 5), b = ring_pose(2, 5);
  for (int k = 0; k < 3; ++k) place(1, k, b);
  for (int k = 5; k >= 1; --k) place(0, k, a);
  for (int k = 0; k < 4; ++k) place(2, k, ring_pose(k, 4));
  cuts.points = {{{1, 2, 3}, 0.5, 4}, {{4, 5, 6}, 0.5, 2}};
  // Points of cuts of b, b, a and the lost one; of a and a.
  cuts.observations = {{0, 0}, {1, 0}, {4, 0}, {8, 0}, {3, 1}, {5, 1}};
  const SceneInput input = panoramas_of_cuts(cuts, folder_.path(), names);
  ASSERT_EQ(input.views.size(), 2u);
  EXPECT_EQ(input.views[0].name, "a.png");
  EXPECT_EQ(input.views[1].image_path, folder_ / "b.png");
  for (const auto& [view, pose] : {std::pair{input.views[0], a}, {input.views[1], b}}) {
    EXPECT_LT(length(view.pose.translation - pose.translation), 1e-12);
    EXPECT_LT(length(view.pose.rotation.column(2) - pose.rotation.column(2)), 1e-12);
    EXPECT_EQ(input.cameras[static_cast<size_t>(view.camera)].params, panorama(64, 32).params);
  }
  EXPECT_EQ(input.points[0].views, 2);
  EXPECT_EQ(input.points[1].views, 1);
  EXPECT_EQ(input.observations.size(), 3u);
  EXPECT_EQ(input.images_total, 3);
  EXPECT_TRUE(any_contains(input.warnings, "1 of 3 panoramas could not be placed: lost.png"));
  write_panorama(folder_ / "a.png", 64, 48);
  EXPECT_TRUE(contains(error_of([&] { panoramas_of_cuts(cuts, folder_.path(), names); }),
                       "twice as wide as high"));
}

}  // namespace
}  // namespace nerf::internal
