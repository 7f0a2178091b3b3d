#include <gtest/gtest.h>

#include <functional>
#include <nlohmann/json.hpp>

#include "io/scene_input.h"
#include "support/temp_folder.h"
#include "test_scenes.h"

namespace nerf::internal {
namespace {

using namespace nerf::test;
using nlohmann::json;

// OpenGL camera-to-world of an OpenCV pose: y and z turned round.
json gl_matrix(const Pose& p) {
  json rows = json::array();
  for (size_t r = 0; r < 3; ++r) {
    rows.push_back({p.rotation.m[r][0], -p.rotation.m[r][1], -p.rotation.m[r][2],
                    p.translation[static_cast<int>(r)]});
  }
  rows.push_back({0, 0, 0, 1});
  return rows;
}

json transforms(int n = 4, const std::string& prefix = "images/") {
  json root = {{"fl_x", 50}, {"fl_y", 51}, {"cx", 21}, {"cy", 14}, {"w", 40}, {"h", 30}};
  root["frames"] = json::array();
  for (int i = 0; i < n; ++i) {
    root["frames"].push_back({{"file_path", fmt::format("{}{}.png", prefix, i)},
                              {"transform_matrix", gl_matrix(ring_pose(i, n))}});
  }
  return root;
}

class Transforms : public ::testing::Test {
 protected:
  SceneInput read(const json& root) {
    write_text(folder_ / "transforms.json", root.dump(1));
    return read_transforms_scene(folder_ / "transforms.json");
  }
  std::string error(const json& root) {
    return error_of([&] { read(root); });
  }
  TempFolder folder_;
};

TEST_F(Transforms, PosesBecomeOpenCV) {
  const SceneInput input = read(transforms());
  ASSERT_EQ(input.views.size(), 4u);
  EXPECT_TRUE(input.is_test.empty());
  for (int i = 0; i < 4; ++i) {
    const Pose expected = ring_pose(i, 4), &pose = input.views[static_cast<size_t>(i)].pose;
    EXPECT_LT(length(pose.translation - expected.translation), 1e-12);
    for (int c = 0; c < 3; ++c) {
      EXPECT_LT(length(pose.rotation.column(c) - expected.rotation.column(c)), 1e-12);
    }
  }
  EXPECT_EQ(input.views[1].name, "images/1.png");
  ASSERT_EQ(input.cameras.size(), 1u);
  EXPECT_EQ(input.cameras[0].model, CameraModel::kPinhole);
  EXPECT_EQ(input.cameras[0].fy(), 51);
  EXPECT_EQ(input.cameras[0].cx(), 21);
}

TEST_F(Transforms, PanoramasAreTheWholeSphere) {
  json root = transforms();
  root["w"] = 80;
  root["h"] = 40;
  root["cx"] = 40;
  root["cy"] = 20;
  json latlong = root;
  root["camera_model"] = "EQUIRECTANGULAR";
  latlong["latlong"] = true;
  for (json& file : std::array{std::ref(root), std::ref(latlong)}) {
    const SceneInput input = read(file);
    ASSERT_EQ(input.cameras.size(), 1u);
    EXPECT_EQ(input.cameras[0].model, CameraModel::kEquirectangular);
    EXPECT_EQ(input.cameras[0].params, panorama(80, 40).params) << "fl_x is no scale of it";
    EXPECT_TRUE(input.warnings.empty());
  }
  root.erase("fl_x");
  root.erase("fl_y");
  root["k1"] = 0.1;
  const SceneInput distorted = read(root);
  EXPECT_EQ(distorted.cameras[0].params, panorama(80, 40).params);
  EXPECT_TRUE(any_contains(distorted.warnings, "distortion of EQUIRECTANGULAR"));
  root["k1"] = 0;
  root["cx"] = 35;
  EXPECT_TRUE(any_contains(read(root).warnings, "cx and cy of EQUIRECTANGULAR"));
  root["h"] = 60;
  const std::string shape = error(root);
  EXPECT_TRUE(contains(shape, "EQUIRECTANGULAR of 80 x 60 pixels"));
  EXPECT_TRUE(contains(shape, "twice as wide as high"));
  // instant-ngp's word for another projection.
  latlong.erase("latlong");
  latlong["equirectangular"] = true;
  EXPECT_TRUE(contains(error(latlong), "\"equirectangular\" describes is not supported"));
}

TEST_F(Transforms, LensesOfBothFlavours) {
  json root = transforms();
  root["k1"] = 0.1;
  root["p2"] = 0.01;
  root["aabb_scale"] = 4;
  SceneInput input = read(root);
  EXPECT_EQ(input.format, "transforms.json (instant-ngp)");
  EXPECT_EQ(input.cameras[0].model, CameraModel::kOpenCV);
  EXPECT_EQ(input.cameras[0].params[4], 0.1);
  EXPECT_EQ(input.cameras[0].params[7], 0.01);

  root["camera_model"] = "OPENCV_FISHEYE";
  root["k3"] = 0.002;
  root["k4"] = 0.003;
  root.erase("p2");
  input = read(root);
  EXPECT_EQ(input.format, "transforms.json (nerfstudio)");
  EXPECT_EQ(input.cameras[0].model, CameraModel::kOpenCVFisheye);
  EXPECT_EQ(input.cameras[0].params[7], 0.003);

  root["camera_model"] = "OPENCV";
  input = read(root);
  EXPECT_EQ(input.cameras[0].model, CameraModel::kFullOpenCV);
  EXPECT_EQ(input.cameras[0].params[8], 0.002);
  EXPECT_EQ(input.cameras[0].params[9], 0);
  ASSERT_EQ(input.warnings.size(), 1u);
  EXPECT_TRUE(contains(input.warnings[0], "k4"));

  root.erase("camera_model");
  root["is_fisheye"] = true;
  EXPECT_EQ(read(root).cameras[0].model, CameraModel::kOpenCVFisheye);
}

TEST_F(Transforms, FieldOfViewGivesTheFocalLength) {
  json root = transforms();
  for (const char* key : {"fl_x", "fl_y", "cx", "cy"}) root.erase(key);
  root["camera_angle_x"] = 2 * std::atan(0.5);
  SceneInput input = read(root);
  EXPECT_NEAR(input.cameras[0].fx(), 40, 1e-9);
  EXPECT_NEAR(input.cameras[0].fy(), 40, 1e-9);
  EXPECT_EQ(input.cameras[0].cx(), 20);
  EXPECT_EQ(input.cameras[0].cy(), 15);
  root["camera_angle_y"] = 2 * std::atan(0.25);
  EXPECT_NEAR(read(root).cameras[0].fy(), 60, 1e-9);
  root = transforms();
  root.erase("fl_x");
  EXPECT_EQ(read(root).cameras[0].fx(), 51);
}

TEST_F(Transforms, FramesMayHaveIntrinsicsOfTheirOwn) {
  json root = transforms();
  root["frames"][1]["fl_x"] = 77;
  root["frames"][3]["fl_x"] = 77;
  root["frames"][2]["w"] = 80;
  root["frames"][2]["h"] = 60;
  const SceneInput input = read(root);
  ASSERT_EQ(input.cameras.size(), 3u);
  EXPECT_EQ(input.views[1].camera, input.views[3].camera);
  EXPECT_EQ(input.cameras[static_cast<size_t>(input.views[1].camera)].fx(), 77);
  EXPECT_EQ(input.cameras[static_cast<size_t>(input.views[2].camera)].width, 80);
}

TEST_F(Transforms, ExtensionsAndSizesComeFromTheFiles) {
  json root = transforms(3, "./train/r_");
  for (const char* key : {"w", "h"}) root.erase(key);
  for (json& frame : root["frames"]) {
    std::string name = frame["file_path"];
    frame["file_path"] = name.substr(0, name.size() - 4);
  }
  root["frames"][2]["file_path"] = ".\\train\\r_2";
  write_picture(folder_ / "train" / "r_0.png", 24, 18);
  write_picture(folder_ / "train" / "r_1.jpg", 24, 18);
  write_picture(folder_ / "train" / "r_2.png", 24, 18);
  const SceneInput input = read(root);
  EXPECT_EQ(input.views[0].name, "train/r_0.png");
  EXPECT_EQ(input.views[1].name, "train/r_1.jpg");
  EXPECT_EQ(input.views[2].name, "train/r_2.png");
  EXPECT_EQ(input.cameras[0].width, 24);
  EXPECT_EQ(input.cameras[0].height, 18);
}

TEST_F(Transforms, MasksTimesAndRepeatedFrames) {
  json root = transforms();
  root["frames"][1]["mask_path"] = "masks/one.png";
  root["frames"][2]["time"] = 30;
  root["frames"][3]["time"] = 15;
  root["frames"].push_back(root["frames"][0]);
  const SceneInput input = read(root);
  EXPECT_EQ(input.views.size(), 4u);
  EXPECT_EQ(input.views[1].mask_path, folder_ / "masks/one.png");
  EXPECT_EQ(input.views[2].time, 30);
  EXPECT_EQ(input.views[3].time, 15);
  EXPECT_EQ(input.warnings.size(), 2u);
  EXPECT_TRUE(contains(input.warnings[0], "images/0.png is listed again by"));
  EXPECT_TRUE(contains(input.warnings[1], "2 of 4 frames have no \"time\" and get 0"));
  for (int i = 0; i < 4; ++i) write_picture(folder_ / fmt::format("images/{}.png", i));
  const Scene scene = load_scene(folder_.path());
  EXPECT_EQ(scene.views[2].time, 1);
  EXPECT_EQ(scene.times.last, 30);
}

TEST_F(Transforms, TimesThatAreNone) {
  json root = transforms();
  root["frames"][2]["time"] = "noon";
  EXPECT_TRUE(contains(error(root), "frames[2]: \"time\" is not a number"));
  root["frames"][2]["time"] = "NaN";  // as read_lenient_json() hands NaN on
  EXPECT_TRUE(contains(error(root), "frames[2]: \"time\" is not finite"));
  // Blender's files promise times from 0 to 1.
  root["frames"][2]["time"] = 1.5;
  EXPECT_EQ(error(root), "");
  write_text(folder_ / "transforms_train.json", root.dump());
  EXPECT_TRUE(contains(error_of([&] { read_blender_scene(folder_.path()); }),
                       "transforms_train.json, frames[2]: \"time\" is 1.5"));
}

TEST_F(Transforms, ScaledRotationsAreTakenShearedOnesNot) {
  json root = transforms();
  for (size_t r = 0; r < 3; ++r) {
    for (size_t c = 0; c < 3; ++c) {
      json& cell = root["frames"][1]["transform_matrix"][r][c];
      cell = cell.get<double>() * 2.5;
    }
  }
  const Pose expected = ring_pose(1, 4);
  const Pose pose = read(root).views[1].pose;
  EXPECT_LT(length(pose.rotation.column(2) - expected.rotation.column(2)), 1e-12);
  EXPECT_LT(length(pose.translation - expected.translation), 1e-12);

  for (size_t r = 0; r < 3; ++r) {
    json& cell = root["frames"][1]["transform_matrix"][r][0];
    cell = cell.get<double>() * 1.3;
  }
  EXPECT_TRUE(
      contains(error(root), "frames[1]: \"transform_matrix\" does not begin with a rotation"));
  root = transforms();
  for (size_t r = 0; r < 3; ++r) {
    json& cell = root["frames"][1]["transform_matrix"][r][0];
    cell = -cell.get<double>();  // left-handed
  }
  EXPECT_TRUE(contains(error(root), "right-handed"));
}

TEST_F(Transforms, BrokenFilesAreErrorsWithTheirPlace) {
  const auto with = [&](const std::function<void(json&)>& change) {
    json root = transforms();
    change(root);
    return error(root);
  };
  EXPECT_TRUE(contains(with([](json& r) { r.erase("frames"); }), "there is no list \"frames\""));
  EXPECT_TRUE(contains(with([](json& r) { r["frames"] = json::array(); }), "\"frames\" is empty"));
  EXPECT_TRUE(contains(with([](json& r) { r["frames"][2].erase("file_path"); }),
                       "transforms.json, frames[2]: there is no \"file_path\""));
  EXPECT_TRUE(contains(with([](json& r) { r["frames"][2]["file_path"] = 7; }), "is not text"));
  EXPECT_TRUE(
      contains(with([](json& r) { r["frames"][1].erase("transform_matrix"); }), "frames[1]"));
  EXPECT_TRUE(contains(with([](json& r) { r["frames"][1]["transform_matrix"][0].erase(0); }),
                       "4 rows of 4 numbers"));
  EXPECT_TRUE(contains(with([](json& r) { r["frames"][1]["transform_matrix"][0][1] = "x"; }),
                       "what is not a number"));
  EXPECT_TRUE(contains(with([](json& r) { r["frames"][1]["transform_matrix"][0][3] = 1e40; }),
                       "absurd position"));
  EXPECT_TRUE(contains(with([](json& r) { r["frames"][0] = 3; }), "frames[0]: the frame is not"));
  EXPECT_TRUE(contains(with([](json& r) { r["fl_x"] = "long"; }), "\"fl_x\" is not a number"));
  EXPECT_TRUE(contains(with([](json& r) { r["fl_x"] = 0; }), "focal length that is not positive"));
  EXPECT_TRUE(contains(with([](json& r) { r["w"] = 1e9; }), "\"w\" and \"h\""));
  EXPECT_TRUE(contains(with([](json& r) { r["w"] = 65536, r["h"] = 65536; }), "65536 x 65536"));
  EXPECT_TRUE(contains(with([](json& r) { r.erase("fl_x"), r.erase("fl_y"); }), "no focal length"));
  EXPECT_TRUE(contains(with([](json& r) {
                         r.erase("fl_x"), r.erase("fl_y");
                         r["camera_angle_x"] = 4;
                       }),
                       "camera_angle_x"));
  EXPECT_TRUE(contains(with([](json& r) { r["camera_model"] = "ORTHOPHOTO"; }),
                       "camera_model ORTHOPHOTO is not supported"));
  const std::string cut = transforms().dump(1).substr(0, 300);
  write_text(folder_ / "transforms.json", cut);
  const std::string error = error_of([&] { read_transforms_scene(folder_ / "transforms.json"); });
  EXPECT_TRUE(contains(error, "transforms.json: parse error at line "));
}

TEST(Blender, TrainAndTestFiles) {
  TempFolder folder;
  write_text(folder / "transforms_train.json", transforms(3, "./train/r_").dump());
  write_text(folder / "transforms_test.json", transforms(2, "./test/r_").dump());
  write_text(folder / "transforms_val.json", "not looked at");
  const SceneInput input = read_blender_scene(folder.path());
  EXPECT_EQ(input.format, "Blender transforms");
  ASSERT_EQ(input.views.size(), 5u);
  EXPECT_EQ(input.is_test, (std::vector<char>{0, 0, 0, 1, 1}));
  EXPECT_EQ(input.views[3].name, "test/r_0.png");
  EXPECT_EQ(input.ignored, std::vector<std::string>{"transforms_val.json"});

  std::filesystem::remove(folder / "transforms_test.json");
  write_text(folder / "transforms_val.json", transforms(1, "./val/r_").dump());
  const SceneInput with_val = read_blender_scene(folder.path());
  EXPECT_EQ(with_val.is_test, (std::vector<char>{0, 0, 0, 1}));
  ASSERT_EQ(with_val.warnings.size(), 1u);
  EXPECT_TRUE(contains(with_val.warnings[0], "transforms_val.json is held out"));

  std::filesystem::remove(folder / "transforms_val.json");
  EXPECT_TRUE(read_blender_scene(folder.path()).is_test.empty());
  std::filesystem::remove(folder / "transforms_train.json");
  EXPECT_TRUE(
      contains(error_of([&] { read_blender_scene(folder.path()); }), "no transforms_train.json"));
}

}  // namespace
}  // namespace nerf::internal
