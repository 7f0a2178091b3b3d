// poses_bounds.npy; precomputed.json of Non-Rigid NeRF, whose rows are the same turned.
#include <gtest/gtest.h>

#include <functional>
#include <nlohmann/json.hpp>

#include "io/npy.h"
#include "io/scene_input.h"
#include "npy_files.h"
#include "support/temp_folder.h"
#include "test_scenes.h"

namespace nerf::internal {
namespace {

using namespace nerf::test;

constexpr int kViews = 6;
constexpr int kPictureWidth = 40, kPictureHeight = 30;  // of write_picture()

// Rows of LLFF: columns down, right, backwards, position, (height, width, focal length).
std::vector<double> rows(int views = kViews) {
  std::vector<double> out;
  for (int i = 0; i < views; ++i) {
    const Pose p = ring_pose(i, views);
    const double size[3] = {2.0 * kPictureHeight, 2.0 * kPictureWidth, 77.5};
    for (size_t r = 0; r < 3; ++r)
      for (const double v : {p.rotation.m[r][1], p.rotation.m[r][0], -p.rotation.m[r][2],
                             p.translation[static_cast<int>(r)], size[r]})
        out.push_back(v);
    out.push_back(1.5 + 0.1 * i);
    out.push_back(9.0 - 0.1 * i);
  }
  return out;
}

class Llff : public ::testing::Test {
 protected:
  void write(const std::vector<double>& values, const std::string& type = "<f8") {
    write_bytes(folder_ / "poses_bounds.npy",
                npy_bytes(type, fmt::format("({}, 17)", values.size() / 17), values));
  }
  void write_pictures(const char* folder = "images", int views = kViews) {
    for (int i = 0; i < views; ++i)
      write_picture(folder_ / folder / fmt::format("image{:03}.png", i));
  }
  std::string error() {
    return error_of([&] { read_llff_scene(folder_.path()); });
  }
  TempFolder folder_;
};

TEST_F(Llff, PosesBecomeOpenCV) {
  write(rows());
  write_pictures();
  const SceneInput input = read_llff_scene(folder_.path());
  ASSERT_EQ(input.views.size(), static_cast<size_t>(kViews));
  for (int i = 0; i < kViews; ++i) {
    const View& view = input.views[static_cast<size_t>(i)];
    const Pose expected = ring_pose(i, kViews);
    EXPECT_EQ(view.name, fmt::format("image{:03}.png", i));
    EXPECT_LT(length(view.pose.translation - expected.translation), 1e-12);
    for (int c = 0; c < 3; ++c)
      EXPECT_LT(length(view.pose.rotation.column(c) - expected.rotation.column(c)), 1e-12);
    const Camera& camera = input.cameras[static_cast<size_t>(view.camera)];
    EXPECT_EQ(camera.fx(), 77.5);
    EXPECT_EQ(camera.width, 2 * kPictureWidth);
    EXPECT_EQ(camera.cx(), kPictureWidth);
  }
}

// Photos at half the size that the file says: cameras are scaled to them. Depths give near and far.
TEST_F(Llff, LoadsAsAScene) {
  write(rows(), "<f4");
  write_pictures("images_2");
  const Scene scene = load_scene(folder_.path());
  EXPECT_EQ(scene.report.format, "LLFF, photos of images_2/");
  EXPECT_EQ(scene.options.format, SceneFormat::kLlff);
  EXPECT_NEAR(scene.report.near, 0.9 * 1.5, 1e-6);
  EXPECT_NEAR(scene.report.far, 9, 1e-6);
  EXPECT_EQ(scene.test.size(), 1u);
  const Camera& camera = scene.cameras[static_cast<size_t>(scene.views[0].camera)];
  EXPECT_EQ(camera.width, kPictureWidth);
  EXPECT_NEAR(camera.fx(), 77.5 / 2, 1e-6);
}

TEST_F(Llff, MistakesAreNamed) {
  write_pictures();
  const auto with = [&](const std::function<void(std::vector<double>&)>& change) {
    std::vector<double> v = rows();
    change(v);
    write(v);
    return error();
  };
  EXPECT_EQ(with([](auto&) {}), "");
  EXPECT_TRUE(contains(with([](auto& v) { v.resize(17 * 5); }), "has 5 rows, but"));
  EXPECT_TRUE(
      contains(with([](auto& v) { v[17 + 3] = NAN; }), "row 1: holds what is not a number"));
  EXPECT_TRUE(contains(with([](auto& v) { v[0] += 0.5; }), "row 0: does not hold a rotation"));
  EXPECT_TRUE(contains(with([](auto& v) { v[14] = -1; }), "focal length"));
  EXPECT_TRUE(contains(with([](auto& v) { v[4] = 0; }), "0 pixels"));
  EXPECT_TRUE(contains(with([](auto& v) { v[15] = 10; }), "has the depths 10 to 9"));
  write_bytes(folder_ / "poses_bounds.npy", npy_bytes("<f8", "(6, 15)", std::vector<double>(90)));
  EXPECT_TRUE(contains(error(), "17 numbers per image"));
}

TEST_F(Llff, NoImages) {
  write(rows());
  EXPECT_TRUE(contains(error(), "there are no images"));
}

class Nonrigid : public ::testing::Test {
 protected:
  using json = nlohmann::json;
  Nonrigid() {
    for (int i = 0; i < kViews; ++i) {
      write_picture(folder_ / "images" / fmt::format("image{:03}.png", i));
      const Pose p = ring_pose(i, kViews);
      json rows = json::array();
      for (size_t r = 0; r < 3; ++r)
        rows.push_back({p.rotation.m[r][0], -p.rotation.m[r][1], -p.rotation.m[r][2],
                        p.translation[static_cast<int>(r)],
                        r == 0   ? 1.0 * kPictureHeight
                        : r == 1 ? 1.0 * kPictureWidth
                                 : 42.5});
      root_["poses"].push_back(rows);
      root_["bds"].push_back({1.5 + 0.1 * i, 9});
    }
  }
  std::string error_of(const json& root) {
    write_text(folder_ / "precomputed.json", root.dump());
    return test::error_of([&] { read_nonrigid_scene(folder_.path()); });
  }
  TempFolder folder_;
  json root_;
};

TEST_F(Nonrigid, LoadsAsASceneInTime) {
  root_["i_test"] = 3;
  ASSERT_EQ(error_of(root_), "");
  const Scene scene = load_scene(folder_.path());
  EXPECT_EQ(scene.options.format, SceneFormat::kNonrigid);
  ASSERT_EQ(scene.views.size(), static_cast<size_t>(kViews));
  for (int i = 0; i < kViews; ++i) {
    const View& view = scene.views[static_cast<size_t>(i)];
    const Pose expected = ring_pose(i, kViews);
    EXPECT_LT(length(view.pose.translation - expected.translation), 1e-12);
    for (int c = 0; c < 3; ++c)
      EXPECT_LT(length(view.pose.rotation.column(c) - expected.rotation.column(c)), 1e-12);
    EXPECT_DOUBLE_EQ(view.time, i / (kViews - 1.0));
    EXPECT_EQ(view.ids.moment, i);
    EXPECT_EQ(scene.cameras[static_cast<size_t>(view.camera)].fx(), 42.5);
  }
  EXPECT_NEAR(scene.report.near, 0.9 * 1.5, 1e-6);
  EXPECT_EQ(scene.times.last, kViews - 1);
  EXPECT_TRUE(any_contains(scene.report.ignored, "\"i_test\" of precomputed.json"));
}

TEST_F(Nonrigid, MistakesAreNamed) {
  json root = root_;
  root["bds"].erase(5);
  EXPECT_TRUE(contains(error_of(root), "precomputed.json: has 6 \"poses\" and 5 \"bds\""));
  root = root_;
  root["poses"][2][1][4] = nullptr;
  EXPECT_TRUE(contains(error_of(root), "precomputed.json, poses[2]: holds what is not a number"));
  root = root_;
  root["poses"][2][0].erase(4);
  EXPECT_TRUE(contains(error_of(root), "poses[2]: is not 3 rows of 5 numbers"));
  root = root_;
  root["poses"][4][0][0] = 3;
  EXPECT_TRUE(contains(error_of(root), "poses[4]: does not hold a rotation"));
  root = root_;
  root["bds"][3] = {2, 1};
  EXPECT_TRUE(contains(error_of(root), "has the depths 2 to 1"));
  root.erase("bds");
  EXPECT_TRUE(contains(error_of(root), "there is no list \"bds\""));
  EXPECT_TRUE(contains(error_of(json::array()), "does not hold an object"));
}

TEST_F(Llff, NpyMistakes) {
  const auto reading = [&](const std::vector<char>& bytes) {
    write_bytes(folder_ / "a.npy", bytes);
    return error_of([&] { read_npy(folder_ / "a.npy"); });
  };
  const std::vector<char> good = npy_bytes("<f8", "(2,)", {1, 2});
  EXPECT_EQ(reading(good), "");
  EXPECT_EQ(read_npy(folder_ / "a.npy").values, (std::vector<double>{1, 2}));
  EXPECT_EQ(read_npy(folder_ / "a.npy").shape, std::vector<size_t>{2});
  EXPECT_TRUE(contains(reading({'x'}), "no NumPy array"));
  EXPECT_TRUE(contains(reading(npy_bytes("<i8", "(2,)", {1, 2})), "type '<i8'"));
  EXPECT_TRUE(contains(reading(npy_bytes("<f8", "(2,)", {1, 2}, "True")), "column by column"));
  EXPECT_TRUE(contains(reading(npy_bytes("<f8", "(3,)", {1, 2})), "asks for 24"));
  EXPECT_TRUE(contains(reading(npy_bytes("<f8", "(2x,)", {1, 2})), "shape"));
  EXPECT_TRUE(contains(reading(npy_bytes("<f8", "(99999999, 99999999)", {})), "larger than any"));
  // Cut anywhere: an error, never a crash or a shorter array.
  for (size_t n = 0; n < good.size(); ++n)
    EXPECT_NE(reading({good.begin(), good.begin() + static_cast<ptrdiff_t>(n)}), "") << n;
}

}  // namespace
}  // namespace nerf::internal
