// Captures in Nerfies' layout: two cameras side by side on a ring, a pair of photos per moment.
#include <gtest/gtest.h>

#include <functional>
#include <nlohmann/json.hpp>

#include "io/nerfies_camera.h"
#include "io/scene_input.h"
#include "nerf/io/camera_path.h"
#include "npy_files.h"
#include "support/temp_folder.h"
#include "test_scenes.h"

namespace nerf::internal {
namespace {

using namespace nerf::test;
using nlohmann::json;

constexpr int kMoments = 5;
constexpr double kScale = 0.25;

json camera_json(const Pose& pose) {
  json rows = json::array();
  const Mat3d world_to_camera = pose.rotation.transposed();
  for (const auto& row : world_to_camera.m) rows.push_back({row[0], row[1], row[2]});
  return {{"orientation", rows},
          {"position", {pose.translation.x, pose.translation.y, pose.translation.z}},
          {"focal_length", 50.0},
          {"principal_point", {20.5, 14.0}},
          {"skew", 0.0},
          {"pixel_aspect_ratio", 1.25},
          {"radial_distortion", {0.1, -0.02, 0.003}},
          {"tangential_distortion", {0.01, -0.004}},
          {"image_size", {40, 30}}};
}

class Nerfies : public ::testing::Test {
 protected:
  Nerfies() {
    scene_ = {{"scale", kScale}, {"center", {1, 2, 3}}, {"near", 0.05}, {"far", 2}};
    dataset_ = {{"ids", json::array()}, {"train_ids", json::array()}, {"val_ids", json::array()}};
    for (int i = 0; i < kMoments; ++i)
      for (const char* side : {"left", "right"}) {
        const bool right = side[0] == 'r';
        const std::string id = fmt::format("{}_{:06}", side, i);
        cameras_[id] = camera_json(pose(i, right));
        metadata_[id] = {{"warp_id", i}, {"appearance_id", i + 10}, {"camera_id", right ? 1 : 0}};
        dataset_["ids"].push_back(id);
        dataset_[right == (i % 2 == 1) ? "train_ids" : "val_ids"].push_back(id);
      }
    for (int i = 0; i < 60; ++i)
      points_.insert(points_.end(), {0.02 * i - 0.5, 0.3 - 0.01 * i, 0.1 * (i % 5)});
  }
  static Pose pose(int i, bool right) { return ring_pose(2 * i + right, 2 * kMoments); }

  void write_cameras() {
    for (const auto& [id, camera] : cameras_.items())
      write_text(folder_ / "camera" / (id + ".json"), camera.dump());
  }
  void write(int reduced = 1) {
    write_cameras();
    write_text(folder_ / "scene.json", scene_.dump());
    write_text(folder_ / "dataset.json", dataset_.dump());
    write_text(folder_ / "metadata.json", metadata_.dump());
    write_points("<f4", fmt::format("({}, 3)", points_.size() / 3));
    for (const auto& [id, camera] : cameras_.items())
      write_picture(folder_ / fmt::format("rgb/{}x/{}.png", reduced, id), 40 / reduced,
                    30 / reduced);
  }
  void write_points(const std::string& type, const std::string& shape) {
    write_bytes(folder_ / "points.npy", npy_bytes(type, shape, points_));
  }
  std::string error() { return load_error(folder_.path()); }

  TempFolder folder_;
  json scene_, dataset_, metadata_, cameras_;
  std::vector<double> points_;
};

TEST_F(Nerfies, LoadsAsAScene) {
  write();
  const Scene scene = load_scene(folder_.path());
  EXPECT_EQ(scene.options.format, SceneFormat::kNerfies);
  EXPECT_EQ(scene.report.format, "Nerfies");
  EXPECT_TRUE(scene.report.ignored.empty()) << scene.report.ignored[0];
  ASSERT_EQ(scene.views.size(), 2u * kMoments);
  for (size_t v = 0; v < scene.views.size(); ++v) {
    const View& view = scene.views[v];
    const bool right = v >= kMoments;  // names are sorted
    const int moment = static_cast<int>(v) % kMoments;
    EXPECT_EQ(view.name, fmt::format("{}_{:06}.png", right ? "right" : "left", moment));
    const Pose expected = pose(moment, right);
    EXPECT_LT(length(view.pose.translation - expected.translation), 1e-12);
    for (int c = 0; c < 3; ++c)
      EXPECT_LT(length(view.pose.rotation.column(c) - expected.rotation.column(c)), 1e-12);
    EXPECT_EQ(view.ids, (ViewIds{moment, moment + 10, right ? 1 : 0}));
    EXPECT_DOUBLE_EQ(view.time, moment / (kMoments - 1.0));
    const bool held_out = right == (moment % 2 == 0);
    EXPECT_EQ(std::ranges::count(scene.test, static_cast<int>(v)), held_out ? 1 : 0);
    EXPECT_EQ(std::ranges::count(scene.train, static_cast<int>(v)), held_out ? 0 : 1);
  }
  EXPECT_EQ(scene.cameras.size(), 1u);
  EXPECT_EQ(scene.points.size(), 60u);
  EXPECT_NEAR(length(scene.points[7].position - Vec3d{-0.36, 0.23, 0.2}), 0, 1e-6);
  EXPECT_EQ(scene.times.first, 0);
  EXPECT_EQ(scene.times.last, kMoments - 1);
  EXPECT_EQ(scene.report.times,
            "5 moments, 0 to 4 (ids of metadata.json); held out: 5 of moments that training sees "
            "from elsewhere");
  EXPECT_NEAR(scene.published_near, 0.05 / kScale * scene.to_engine.scale, 1e-12);
  EXPECT_NEAR(scene.published_far, 2 / kScale * scene.to_engine.scale, 1e-12);
  // Near is the points', which lie within 1 of the ring's middle.
  EXPECT_GT(scene.report.near, 1);
  EXPECT_FALSE(scene.states_depths);
}

// The formulas of Nerfies' camera.py, in the order it has them.
TEST_F(Nerfies, LensIsNerfies) {
  write_text(folder_ / "c.json", camera_json(ring_pose(1, 7)).dump());
  const NerfiesCamera read = read_nerfies_camera(folder_ / "c.json");
  const double k[] = {0.1, -0.02, 0.003}, p[] = {0.01, -0.004};
  for (const auto& [x, y] : {std::pair{0.2, -0.1}, {-0.3, 0.25}, {0.0, 0.0}}) {
    const double r2 = x * x + y * y, d = 1 + r2 * (k[0] + r2 * (k[1] + k[2] * r2));
    const double xd = x * d + 2 * p[0] * x * y + p[1] * (r2 + 2 * x * x);
    const double yd = y * d + 2 * p[1] * x * y + p[0] * (r2 + 2 * y * y);
    const auto pixel = project(read.camera, {x, y, 1});
    ASSERT_TRUE(pixel);
    EXPECT_NEAR(pixel->x, 50 * xd + 20.5, 1e-9);
    EXPECT_NEAR(pixel->y, 62.5 * yd + 14, 1e-9);
  }
}

TEST_F(Nerfies, LensesOfFewerNumbers) {
  const auto lens = [&](const std::function<void(json&)>& change) {
    json camera = camera_json(ring_pose(0, 7));
    change(camera);
    write_text(folder_ / "c.json", camera.dump());
    return read_nerfies_camera(folder_ / "c.json").camera;
  };
  EXPECT_EQ(lens([](json&) {}).model, CameraModel::kFullOpenCV);
  EXPECT_EQ(lens([](json& c) { c["radial_distortion"][2] = 0; }).model, CameraModel::kOpenCV);
  const Camera plain = lens([](json& c) {
    c.erase("radial_distortion");
    c.erase("tangential_distortion");
    c["skew"] = 0.0001;
  });
  EXPECT_EQ(plain.model, CameraModel::kPinhole);
  // The name that the published code writes.
  const Camera tangential = lens([](json& c) {
    c["tangential"] = c["tangential_distortion"];
    c.erase("tangential_distortion");
  });
  EXPECT_EQ(tangential.params[6], 0.01);
}

TEST_F(Nerfies, ReducedPhotosAndThoseOfTwoSizes) {
  write(2);
  Scene scene = load_scene(folder_.path());
  EXPECT_EQ(scene.report.format, "Nerfies, photos of rgb/2x/");
  EXPECT_NEAR(scene.cameras[0].fx(), 25, 1e-9);
  EXPECT_NEAR(scene.cameras[0].cy(), 7, 1e-9);
  // Cameras of another size than the others'.
  json& other = cameras_["left_000002"];
  other["image_size"] = {32, 32};
  write_cameras();
  write_picture(folder_ / "rgb/2x/left_000002.png", 16, 16);
  scene = load_scene(folder_.path());
  EXPECT_EQ(scene.cameras.size(), 2u);
  // A photo that is not as its camera says.
  write_picture(folder_ / "rgb/2x/left_000003.png", 16, 16);
  EXPECT_TRUE(contains(error(), "left_000003.png"));
  write_picture(folder_ / "rgb/4x/left_000003.png", 10, 7);
  EXPECT_TRUE(any_contains(read_nerfies_scene(folder_.path()).ignored, "rgb/4x/"));
}

TEST_F(Nerfies, SplitsOfOtherKinds) {
  dataset_["val_ids"] = json::array();
  write();
  Scene scene = load_scene(folder_.path());
  EXPECT_EQ(scene.views.size(), static_cast<size_t>(kMoments));
  EXPECT_EQ(scene.test, std::vector<int>{0});
  EXPECT_TRUE(any_contains(scene.report.notes, "no \"val_ids\""));
  EXPECT_TRUE(any_contains(scene.report.notes, "5 photos are left out"));
  dataset_.erase("train_ids");
  write();
  EXPECT_EQ(load_scene(folder_.path()).views.size(), 2u * kMoments);
  dataset_["val_ids"] = {"left_000000", "left_000001", "left_000001"};
  dataset_["train_ids"] = {"left_000001", "left_000002", "left_000003"};
  write();
  scene = load_scene(folder_.path());
  EXPECT_EQ(scene.test, (std::vector<int>{0, 1}));
  EXPECT_EQ(scene.train, (std::vector<int>{2, 3}));
  EXPECT_TRUE(any_contains(scene.report.warnings, "lists 1 photos again"));
  EXPECT_TRUE(any_contains(scene.report.warnings, "has 1 photos for training and for measuring"));
  std::filesystem::remove(folder_ / "dataset.json");
  scene = load_scene(folder_.path());
  EXPECT_EQ(scene.views.size(), 2u * kMoments);
  EXPECT_TRUE(any_contains(scene.report.warnings, "no dataset.json"));
}

TEST_F(Nerfies, TimesAreOfTimeIdsFirst) {
  for (auto& [id, entry] : metadata_.items())
    entry["time_id"] = 100 + 2 * entry["warp_id"].get<int>();
  write();
  const Scene scene = load_scene(folder_.path());
  EXPECT_EQ(scene.times.first, 100);
  EXPECT_EQ(scene.times.last, 108);
  EXPECT_EQ(scene.views[1].time, 0.25);
  EXPECT_EQ(scene.views[1].ids.moment, 1);
}

TEST_F(Nerfies, OneCameraIsNoted) {
  for (auto& [id, entry] : metadata_.items()) entry["camera_id"] = 0;
  write();
  EXPECT_TRUE(any_contains(load_scene(folder_.path()).report.notes, "of one camera"));
}

TEST_F(Nerfies, WithoutPointsOrMetadata) {
  write();
  std::filesystem::remove(folder_ / "points.npy");
  Scene scene = load_scene(folder_.path());
  EXPECT_TRUE(scene.states_depths);
  EXPECT_NEAR(scene.report.near, 0.9 * 0.05 / kScale, 1e-9);
  EXPECT_NEAR(scene.report.far, 2 / kScale, 1e-9);
  EXPECT_TRUE(any_contains(scene.report.notes, "no points.npy"));
  std::filesystem::remove(folder_ / "metadata.json");
  scene = load_scene(folder_.path());
  EXPECT_TRUE(any_contains(scene.report.warnings, "no metadata.json"));
  EXPECT_EQ(scene.views[3].time, 0);
  EXPECT_EQ(scene.report.times, "");
}

TEST_F(Nerfies, MistakesAreNamed) {
  write();
  EXPECT_EQ(error(), "");
  const auto with = [&](const char* file, const json& root,
                        const std::function<void(json&)>& change) {
    json changed = root;
    change(changed);
    write_text(folder_ / file, changed.dump());
    const std::string text = error();
    write_text(folder_ / file, root.dump());
    EXPECT_TRUE(contains(text, file));
    return text;
  };
  const auto metadata = [&](const std::function<void(json&)>& change) {
    return with("metadata.json", metadata_, change);
  };
  EXPECT_TRUE(contains(metadata([](json& m) { m.erase("left_000003"); }),
                       "has no entry for 1 of 10 photos: left_000003"));
  EXPECT_TRUE(contains(metadata([](json& m) { m["left_000003"]["warp_id"] = -2; }),
                       "\"left_000003\": \"warp_id\" is -2"));
  EXPECT_TRUE(contains(metadata([](json& m) { m["left_000003"]["appearance_id"] = 1 << 24; }),
                       "\"appearance_id\" is 1.67772e+07"));
  EXPECT_TRUE(contains(metadata([](json& m) { m["left_000003"]["camera_id"] = 0.5; }),
                       "whole numbers from 0"));
  EXPECT_TRUE(contains(metadata([](json& m) { m["left_000003"]["warp_id"] = "a"; }),
                       "\"warp_id\" is not a number"));
  EXPECT_TRUE(contains(metadata([](json& m) { m["left_000003"]["warp_id"] = "NaN"; }),
                       "\"left_000003\": \"warp_id\" is not finite"));
  EXPECT_TRUE(contains(metadata([](json& m) { m["left_000003"].erase("warp_id"); }),
                       "neither \"warp_id\" nor \"time_id\""));
  const auto dataset = [&](const std::function<void(json&)>& change) {
    return with("dataset.json", dataset_, change);
  };
  EXPECT_TRUE(contains(dataset([](json& d) { d["val_ids"].push_back("nobody"); }),
                       "\"val_ids\": names nobody, which has no camera/nobody.json"));
  EXPECT_TRUE(contains(dataset([](json& d) { d["train_ids"] = "all"; }), "not a list of ids"));
  EXPECT_TRUE(contains(dataset([](json& d) { d = json::object(); }), "lists no photo"));
  const auto region = [&](const std::function<void(json&)>& change) {
    return with("scene.json", scene_, change);
  };
  EXPECT_TRUE(contains(region([](json& s) { s["scale"] = 0; }), "\"scale\" is 0, not above 0"));
  EXPECT_TRUE(contains(region([](json& s) { s.erase("near"); }), "no \"near\""));
  EXPECT_TRUE(contains(region([](json& s) { s["far"] = 0.01; }), "nothing lies between"));
  const auto camera = [&](const std::function<void(json&)>& change) {
    return with("camera/left_000002.json", cameras_["left_000002"], change);
  };
  EXPECT_TRUE(contains(camera([](json& c) { c["orientation"][0][0] = 2; }), "is no rotation"));
  EXPECT_TRUE(contains(camera([](json& c) { c["orientation"][1] = 2; }), "3 rows of 3"));
  EXPECT_TRUE(contains(camera([](json& c) { c["position"][1] = nullptr; }), "3 finite numbers"));
  EXPECT_TRUE(contains(camera([](json& c) { c["skew"] = 3; }), "\"skew\" is 3, which moves"));
  EXPECT_TRUE(contains(camera([](json& c) { c["focal_length"] = -1; }), "focal length"));
  EXPECT_TRUE(contains(camera([](json& c) { c["image_size"] = {0, 3}; }), "\"image_size\" is 0"));

  std::filesystem::remove(folder_ / "rgb/1x/left_000001.png");
  EXPECT_TRUE(contains(error(), "names left_000001, of which there is no photo"));
}

TEST_F(Nerfies, PointsOfOtherKindsAreRefused) {
  write();
  write_points("<f4", "(180,)");
  EXPECT_TRUE(contains(error(), "points.npy: has the shape (180), not (N, 3)"));
  write_points("<f4", "(90, 2)");
  EXPECT_TRUE(contains(error(), "has the shape (90, 2)"));
  write_points("<i8", "(60, 3)");
  EXPECT_TRUE(contains(error(), "points.npy: holds numbers of type '<i8'"));
  write_points("<u4", "(120, 3)");  // each number's 8 bytes as two of them
  EXPECT_TRUE(contains(error(), "points.npy: holds whole numbers, not coordinates"));
  write_points("<f4", "(61, 3)");
  EXPECT_TRUE(contains(error(), "points.npy: holds 720 bytes of numbers"));
  points_[4] = NAN;
  write_points("<f4", "(60, 3)");
  const Scene scene = load_scene(folder_.path());
  EXPECT_EQ(scene.points.size(), 59u);
  EXPECT_TRUE(any_contains(scene.report.warnings, "1 of 60 points"));
}

TEST_F(Nerfies, APathOfCameras) {
  ModelInfo info;
  for (int i = 0; i < kMoments; ++i)
    info.views.push_back({fmt::format("left_{}.png", i), {}, pose(i, false), false, 0.25 * i, {}});
  const auto path_folder = folder_ / "camera-paths/orbit-mild";
  for (int i = 0; i < 12; ++i)
    write_text(path_folder / fmt::format("{}.json", i), camera_json(pose(i, true)).dump());
  for (const auto& folder : {path_folder, path_folder / ""}) {
    const CameraPath path = read_camera_path(folder, info);
    ASSERT_EQ(path.frames.size(), 12u);
    EXPECT_TRUE(path.own_lenses);
    EXPECT_EQ(path.frames[10].name, "orbit-mild_0010");
    EXPECT_LT(length(path.frames[10].camera_to_world.translation - pose(10, true).translation),
              1e-12);
    EXPECT_EQ(path.frames[10].camera.params[8], 0.003);
    EXPECT_DOUBLE_EQ(path.frames[10].time, 10 / 11.0);
  }
  for (ModelView& view : info.views) view.time = 0;
  EXPECT_EQ(read_camera_path(path_folder, info).frames[11].time, 0);
  EXPECT_TRUE(
      contains(error_of([&] { read_camera_path(folder_.path(), info); }), "there are no cameras"));
}

TEST_F(Nerfies, WhatIsMissing) {
  write();
  std::filesystem::remove(folder_ / "scene.json");
  EXPECT_TRUE(contains(error(), folder_.path().string() + ": there is no scene.json"));
  write();
  std::filesystem::remove_all(folder_ / "rgb/1x");
  std::filesystem::create_directories(folder_ / "rgb/1x");
  EXPECT_TRUE(contains(error(), "there are no photos"));
}

}  // namespace
}  // namespace nerf::internal
