// Camera paths of other tools, and whose coordinates they are in.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "nerf/io/camera_path.h"
#include "nerf/math/camera_paths.h"
#include "support/temp_folder.h"

namespace nerf {
namespace {

using test::error_of;
using test::TempFolder;
using test::write_text;

// Twelve cameras of 64x48 on a ring of radius 4, photos/img0.jpg and on.
ModelInfo ring() {
  ModelInfo info;
  for (int i = 0; i < 12; ++i) {
    ModelView view;
    view.name = fmt::format("photos/img{}.jpg", i);
    view.camera.model = CameraModel::kSimpleRadial;
    view.camera.width = 64;
    view.camera.height = 48;
    view.camera.params = {60, 31, 24, 0.01 * i};
    const double a = 2 * std::numbers::pi * i / 12;
    const Vec3d at{4 * std::cos(a), 4 * std::sin(a), 1};
    view.pose = {look_rotation(-at, {0, 0, 1}), at};
    info.views.push_back(view);
  }
  return info;
}

// Rows of a pose with OpenGL's camera axes, the left part multiplied.
std::string rows(const Pose& pose, double scale = 1, int count = 4) {
  std::string text = "[";
  for (int r = 0; r < count; ++r) {
    text += r == 0 ? "[" : ", [";
    for (int c = 0; c < 3; ++c) {
      const double x = r < 3 ? pose.rotation.m[r][c] * scale : 0;
      text += fmt::format("{:.17g}, ", c == 0 ? x : -x);
    }
    text += fmt::format("{:.17g}]", r < 3 ? pose.translation[r] : 1.0);
  }
  return text + "]";
}

void expect_same(const Pose& a, const Pose& b, double tolerance = 1e-9) {
  EXPECT_LT(length(a.translation - b.translation), tolerance);
  for (int c = 0; c < 3; ++c)
    EXPECT_LT(length(a.rotation.column(c) - b.rotation.column(c)), tolerance);
}

class PathFormats : public testing::Test {
 protected:
  CameraPath read(const std::string& text, const std::string& name = "tour.json") {
    write_text(folder_ / name, text);
    return read_camera_path(folder_ / name, info_);
  }
  std::string error(const std::string& text) {
    return error_of([&] { read(text); });
  }
  const TempFolder folder_;
  const ModelInfo info_ = ring();
};

TEST_F(PathFormats, TransformsJsonWithItsLens) {
  const Pose a = info_.views[2].pose, b = info_.views[3].pose;
  const CameraPath path = read(fmt::format(
      R"({{"w": 160, "h": 120, "fl_x": 140, "fl_y": 141, "cx": 79, "cy": 61, "k1": 0.1,
          "frames": [{{"file_path": "out/novel_7.png", "transform_matrix": {}}},
                     {{"transform_matrix": {}, "fl_x": 150, "time": 0.5}}]}})",
      rows(a), rows(b, 1.7, 3)));
  ASSERT_EQ(path.frames.size(), 2u);
  EXPECT_EQ(path.frames[0].name, "novel_7");
  EXPECT_EQ(path.frames[1].name, "tour_0001");
  expect_same(path.frames[0].camera_to_world, a);
  expect_same(path.frames[1].camera_to_world, b);
  EXPECT_EQ(path.frames[0].camera.model, CameraModel::kOpenCV);
  EXPECT_EQ(path.frames[0].camera.width, 160);
  EXPECT_EQ(path.frames[0].camera.params[1], 141);
  EXPECT_EQ(path.frames[0].camera.params[2], 79);
  EXPECT_EQ(path.frames[1].camera.params[0], 150);
  EXPECT_EQ(path.frames[1].time, 0.5);
  EXPECT_TRUE(path.own_lenses);
  EXPECT_TRUE(path.notes.empty()) << path.notes[0];
}

TEST_F(PathFormats, BlendersFieldOfViewAndNoLensAtAll) {
  const std::string frames =
      "\"frames\": [{\"transform_matrix\": " + rows(info_.views[0].pose) + "}]}";
  const CameraPath angle = read("{\"camera_angle_x\": 1.5707963267948966, " + frames);
  EXPECT_NEAR(angle.frames[0].camera.fx(), 32, 1e-9);  // 90 degrees over the photos' 64 pixels
  const CameraPath none = read("{" + frames);
  EXPECT_EQ(none.frames[0].camera.params, path_camera(info_).params);
  EXPECT_EQ(none.notes.size(), 1u);
  EXPECT_FALSE(none.own_lenses);
}

TEST_F(PathFormats, AnExportedListTakesTheLensOfTheViewOfThatName) {
  const CameraPath path = read(fmt::format(
      R"([{{"file_path": "/data/x/photos/img5.jpg", "transform": {}}},
          {{"file_path": "C:\\else\\other.jpg", "transform": {}}}])",
      rows(info_.views[5].pose, 1, 3), rows(info_.views[1].pose, 1, 3)));
  ASSERT_EQ(path.frames.size(), 2u);
  EXPECT_EQ(path.frames[0].name, "img5");
  EXPECT_EQ(path.frames[0].camera.params, info_.views[5].camera.params);
  EXPECT_EQ(path.frames[1].camera.params, path_camera(info_).params);
  expect_same(path.frames[0].camera_to_world, info_.views[5].pose);
}

// What instant-ngp does with a pose of transforms.json (its documentation of the formats and
// loader): camera axes to OpenCV's, position times scale plus offset, then x, y, z become z, x, y.
struct Ngp {
  std::array<double, 4> r;  // x y z w
  Vec3d t;
};
Ngp to_ngp(const Pose& pose, double scale, const Vec3d& offset) {
  const auto cycled = [](const Vec3d& v) { return Vec3d{v.y, v.z, v.x}; };
  Mat3d rotation;
  for (int c = 0; c < 3; ++c) rotation.set_column(c, cycled(pose.rotation.column(c)));
  const Quaternion q = to_quaternion(rotation);
  return {{q.x, q.y, q.z, q.w}, cycled(pose.translation * scale + offset)};
}
std::string key(const Pose& pose, double scale = 0.33, const Vec3d& offset = {0.5, 0.5, 0.5},
                double sign = 1) {
  const Ngp k = to_ngp(pose, scale, offset);
  return fmt::format(R"({{"R": [{:.17g}, {:.17g}, {:.17g}, {:.17g}],
                         "T": [{:.17g}, {:.17g}, {:.17g}],
                         "fov": 50, "scale": 1.5, "slice": 0.2, "timestamp": 0}})",
                     sign * k.r[0], sign * k.r[1], sign * k.r[2], sign * k.r[3], k.t.x, k.t.y,
                     k.t.z);
}

TEST_F(PathFormats, InstantNgpsKeysStandWhereItsCubeSaysSo) {
  const Pose pose = info_.views[4].pose;
  const CameraPath usual = read("{\"path\": [" + key(pose) + "]}", "base_cam.json");
  ASSERT_EQ(usual.frames.size(), 1u);
  expect_same(usual.frames[0].camera_to_world, pose, 1e-6);
  EXPECT_NEAR(usual.frames[0].camera.fy(), 24 / std::tan(25 * std::numbers::pi / 180), 1e-9);
  EXPECT_EQ(usual.frames[0].camera.width, 64);
  EXPECT_TRUE(usual.notes.empty());

  write_text(folder_ / "transforms.json", R"({"scale": 0.1, "offset": [0.4, 0.6, 0.7]})");
  const CameraPath own = read("{\"path\": [" + key(pose, 0.1, {0.4, 0.6, 0.7}) + "]}");
  expect_same(own.frames[0].camera_to_world, pose, 1e-6);
  write_text(folder_ / "transforms.json", R"({"aabb": [[-4, -4, -6], [6, 4, 6]]})");
  const double scale = 1.0 / 12;
  const CameraPath aabb = read("{\"path\": [" + key(pose, scale, {0.5 - scale, 0.5, 0.5}) + "]}");
  expect_same(aabb.frames[0].camera_to_world, pose, 1e-6);
}

TEST_F(PathFormats, InstantNgpsPathIsACubicBSpline) {
  // Keys on a line, evenly: the spline passes over it at constant speed between inner keys, and
  // begins with the ends' weights 5/6 and 1/6.
  std::string keys;
  const Pose first = info_.views[0].pose;
  for (int i = 0; i < 4; ++i) {
    Pose p = first;
    p.translation = first.translation + Vec3d{0, 0.3 * i, 0};
    keys += (i == 0 ? "" : ", ") + key(p, 0.33, {0.5, 0.5, 0.5}, i % 2 ? -1 : 1);
  }
  const CameraPath open =
      read("{\"path\": [" + keys + "], \"loop\": false, \"duration_seconds\": 1}");
  ASSERT_EQ(open.frames.size(), 30u);
  EXPECT_EQ(open.fps, 30);
  const auto y = [&](const CameraPath& path, size_t i) {
    return path.frames[i].camera_to_world.translation.y - first.translation.y;
  };
  EXPECT_NEAR(y(open, 0), 0.3 / 6, 1e-6);
  EXPECT_NEAR(y(open, 29), 0.9 - 0.3 / 6, 1e-6);
  for (size_t i = 11; i < 18; ++i) EXPECT_NEAR(y(open, i + 1) - y(open, i), 0.9 / 29, 1e-6);
  for (const PathFrame& f : open.frames)
    EXPECT_LT(rotation_angle(f.camera_to_world.rotation, first.rotation), 1e-6);
  const CameraPath loop =
      read("{\"path\": [" + keys + "], \"loop\": true, \"duration_seconds\": 2}");
  ASSERT_EQ(loop.frames.size(), 60u);
  EXPECT_NEAR(y(loop, 0), (0.9 + 4 * 0 + 0.3) / 6, 1e-6);  // neighbours on both sides
}

TEST_F(PathFormats, MistakesNameFileAndPlace) {
  const std::string good = rows(info_.views[0].pose);
  for (const auto& [text, part] : std::initializer_list<std::pair<std::string, std::string>>{
           {"[]", "list of cameras is empty"},
           {"[3]", "[0]: expected an object"},
           {"[{\"file_path\": \"a.jpg\"}]", "[0]: there is no \"transform\""},
           {"[{\"transform\": [[1, 0]]}]", "[0].transform"},
           {"{\"frames\": []}", "frames: expected a list"},
           {"{\"frames\": [{\"transform_matrix\": 1}]}", "frames[0].transform_matrix"},
           {"{\"frames\": [{\"transform_matrix\": " + rows({Mat3d{}, {1e12, 0, 0}}) + "}]}",
            "not a number"},
           {"{\"frames\": [{}]}", "frames[0]: there is no \"transform_matrix\""},
           {"{\"path\": []}", "path: expected a list"},
           {"{\"path\": [{\"R\": [0, 0, 0, 0], \"T\": [0, 0, 0]}]}",
            "path[0]: \"R\" is no rotation"},
           {"{\"path\": [{\"R\": [0, 0, 1], \"T\": [0, 0, 0]}]}", "path[0].R: expected 4 numbers"},
           {"{\"path\": [{\"T\": [0, 0, 0]}]}", "path[0]: there is no \"R\""},
           {"{\"keyframes\": []}", "keyframes and no path"},
           {"{\"frames\": [", "not valid JSON"},
           {"{}", "camera_path: the entry is missing"}}) {
    const std::string message = error(text);
    EXPECT_NE(message.find(part), std::string::npos) << text << " gave: " << message;
    EXPECT_NE(message.find("tour.json"), std::string::npos) << message;
  }
  EXPECT_EQ(error("{\"frames\": [{\"transform_matrix\": " + good + "}]}"), "");
}

// nerfstudio: normalised = scale * (transform * pose).
struct Normalised {
  Mat3d rotation = to_rotation({0.8, 0, 0, 0.6});
  Vec3d translation{-0.03, 0.02, -1.5};
  double scale = 0.25;
  Pose of(const Pose& p) const {
    return {rotation * p.rotation, (rotation * p.translation + translation) * scale};
  }
  std::string json() const {
    std::string text = "{\"transform\": [";
    for (int r = 0; r < 3; ++r)
      text += fmt::format("{}[{:.17g}, {:.17g}, {:.17g}, {:.17g}]", r == 0 ? "" : ", ",
                          rotation.m[r][0], rotation.m[r][1], rotation.m[r][2], translation[r]);
    return text + fmt::format("], \"scale\": {}}}", scale);
  }
};

TEST_F(PathFormats, ANormalisedPathIsBroughtBack) {
  const Normalised n;
  std::vector<std::string> normalised, plain;
  for (const ModelView& view : info_.views) {
    normalised.push_back("{\"transform\": " + rows(n.of(view.pose), 1, 3) + "}");
    plain.push_back("{\"transform\": " + rows(view.pose, 1, 3) + "}");
  }
  const std::string text = fmt::format("[{}]", fmt::join(normalised, ","));
  // Nothing beside it: another place, and said so.
  const CameraPath lost = read(text);
  ASSERT_EQ(lost.notes.size(), 1u);
  EXPECT_NE(lost.notes[0].find("--path-transform"), std::string::npos) << lost.notes[0];

  write_text(folder_ / "run" / "dataparser_transforms.json", n.json());
  const CameraPath given = read_camera_path(folder_ / "tour.json", info_,
                                            {folder_ / "run" / "dataparser_transforms.json"});
  write_text(folder_ / "dataparser_transforms.json", n.json());
  const CameraPath beside = read(text);
  for (const CameraPath* path : {&given, &beside})
    for (size_t i = 0; i < 12; ++i)
      expect_same(path->frames[i].camera_to_world, info_.views[i].pose, 1e-6);
  EXPECT_TRUE(given.notes.empty());
  EXPECT_EQ(beside.notes.size(), 1u);
  // One that is in the model's coordinates stays where it is.
  const CameraPath own = read(fmt::format("[{}]", fmt::join(plain, ",")));
  expect_same(own.frames[3].camera_to_world, info_.views[3].pose);
  EXPECT_NE(own.notes.at(0).find("not used"), std::string::npos);
  // Another tool's path is none of that run's.
  const CameraPath other = read("{\"path\": [" + key(info_.views[3].pose) + "]}");
  expect_same(other.frames[0].camera_to_world, info_.views[3].pose, 1e-6);
  EXPECT_TRUE(other.notes.empty());
}

TEST_F(PathFormats, WhatNerfstudioAppliedToTransformsJsonCounts) {
  // The model is of transforms.json, whose coordinates are those after "applied_transform"; the
  // run's transform takes those before it.
  const Normalised n;
  Mat3d applied;
  applied.m = {{{1, 0, 0}, {0, 0, 1}, {0, -1, 0}}};
  std::vector<std::string> frames;
  for (const ModelView& view : info_.views) {
    const Pose before{applied.transposed() * view.pose.rotation,
                      applied.transposed() * view.pose.translation};
    frames.push_back("{\"transform\": " + rows(n.of(before), 1, 3) + "}");
  }
  write_text(folder_ / "dataparser_transforms.json", n.json());
  write_text(folder_ / "transforms.json",
             R"({"applied_transform": [[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0]]})");
  const CameraPath path = read(fmt::format("[{}]", fmt::join(frames, ",")));
  for (size_t i = 0; i < 12; ++i)
    expect_same(path.frames[i].camera_to_world, info_.views[i].pose, 1e-6);
}

TEST_F(PathFormats, ATransformThatIsNoneIsRefused) {
  const std::string text = "[{\"transform\": " + rows(info_.views[0].pose) + "}]";
  for (const char* bad :
       {"{}", "[]", "{\"transform\": [[1, 0, 0, 0]], \"scale\": 1}",
        "{\"transform\": [[2, 0, 0, 0], [0, 2, 0, 0], [0, 0, 2, 0]], \"scale\": 1}",
        "{\"transform\": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]], \"scale\": 0}"}) {
    write_text(folder_ / "dataparser_transforms.json", bad);
    EXPECT_NE(error(text).find("dataparser_transforms.json"), std::string::npos) << bad;
  }
}

TEST_F(PathFormats, TheFilmOfPhotosOnTheirSideStandsUpright) {
  ModelInfo info = ring();
  for (ModelView& view : info.views) {
    Mat3d& r = view.pose.rotation;  // a quarter turn about the optical axis
    const Vec3d x = r.column(0);
    r.set_column(0, r.column(1));
    r.set_column(1, -x);
  }
  const Camera camera = path_camera(info);
  EXPECT_EQ(camera.width, 48);
  EXPECT_EQ(camera.height, 64);
  EXPECT_EQ(path_camera(ring()).width, 64);
}

}  // namespace
}  // namespace nerf
