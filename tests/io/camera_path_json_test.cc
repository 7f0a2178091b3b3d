#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <numbers>

#include "nerf/base/error.h"
#include "nerf/base/file.h"
#include "nerf/io/camera_path.h"
#include "nerf/math/camera_paths.h"
#include "support/temp_folder.h"

namespace nerf {
namespace {

namespace fs = std::filesystem;

class CameraPathJson : public testing::Test {
 protected:
  const test::TempFolder folder_;
};

// As nerfstudio's viewer exports it, cut to what matters.
const std::string kExported = R"({
  "keyframes": [{"matrix": "[1,0,0,0]", "fov": 50, "aspect": 1}],
  "camera_type": "perspective",
  "render_height": 108,
  "render_width": 192,
  "camera_path": [
    {"camera_to_world": [1, 0, 0, 0.5,  0, 0, -1, -2,  0, 1, 0, 0.25,  0, 0, 0, 1],
     "fov": 90, "aspect": 1.7777},
    {"camera_to_world": [0, 0, 1, 3,  1, 0, 0, 4,  0, 1, 0, 5,  0, 0, 0, 1],
     "fov": 53.13010235415598, "aspect": 1.7777, "render_time": 0.75}
  ],
  "fps": 24, "seconds": 4, "smoothness_value": 0.5, "is_cycle": false, "crop": null
})";

std::string error_of_path(const std::string& json) {
  return test::error_of([&] { parse_camera_path(json, "flight.json", "flight"); });
}

std::string with(const std::string& from, const std::string& to) {
  std::string json = kExported;
  const size_t at = json.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return json.replace(at, from.size(), to);
}

TEST_F(CameraPathJson, ReadsWhatNerfstudioWrites) {
  const CameraPath path = parse_camera_path(kExported, "flight.json", "flight");
  ASSERT_EQ(path.frames.size(), 2u);
  EXPECT_EQ(path.fps, 24);
  EXPECT_TRUE(path.notes.empty());
  const PathFrame& f = path.frames[0];
  EXPECT_EQ(f.name, "flight_0000");
  EXPECT_EQ(f.camera.width, 192);
  EXPECT_EQ(f.camera.height, 108);
  EXPECT_NEAR(f.camera.fy(), 54, 1e-9);  // 90 degrees: half the height
  EXPECT_NEAR(f.camera.fx(), 54, 1e-9);
  EXPECT_EQ(f.camera.cx(), 96);
  EXPECT_EQ(f.camera_to_world.translation, (Vec3d{0.5, -2, 0.25}));
  // OpenGL's backward axis is -y of the world there: the camera looks along +y, its up is +z.
  EXPECT_EQ(f.camera_to_world.rotation.column(0), (Vec3d{1, 0, 0}));
  EXPECT_EQ(f.camera_to_world.rotation.column(1), (Vec3d{0, 0, -1}));
  EXPECT_EQ(f.camera_to_world.rotation.column(2), (Vec3d{0, 1, 0}));
  EXPECT_EQ(f.time, 0);
  EXPECT_NEAR(path.frames[1].camera.fy(), 108, 1e-9);
  EXPECT_EQ(path.frames[1].time, 0.75);
}

TEST_F(CameraPathJson, PanoramasOfEveryKindThereAndBack) {
  struct Case {
    const char* type;
    PictureKind picture;
    double azimuths;
  };
  for (const Case& c :
       {Case{"equirectangular", PictureKind::kEquirectangular, 2},
        Case{"omnidirectional", PictureKind::kOds, 2}, Case{"vr180", PictureKind::kVr180, 1}}) {
    std::string json = with("perspective", c.type);
    json.replace(json.find("\"fov\": 90"), 9, "\"fov\": null");  // which they have no use for
    CameraPath path = parse_camera_path(json, "flight.json", "flight");
    for (const std::string& name : {std::string("as read"), std::string("written")}) {
      SCOPED_TRACE(c.type + (" " + name));
      EXPECT_EQ(path.picture, c.picture);
      ASSERT_EQ(path.frames.size(), 2u);
      EXPECT_EQ(path.frames[0].camera.width, 192);
      EXPECT_EQ(path.frames[0].camera.params,
                panorama(192, 108, c.azimuths * std::numbers::pi).params);
      EXPECT_EQ(path.frames[0].camera_to_world.translation, (Vec3d{0.5, -2, 0.25}));
      write_camera_path(folder_ / "back.json", path);
      path = read_camera_path(folder_ / "back.json");
    }
  }
}

TEST_F(CameraPathJson, OptionalPartsHaveTheirMeaning) {
  const auto parse = [](const std::string& json) {
    return parse_camera_path(json, "flight.json", "flight");
  };
  EXPECT_EQ(parse(with("\"fps\": 24, ", "")).fps, 0.5);  // two frames in four seconds
  EXPECT_EQ(parse(with("\"fps\": 24, \"seconds\": 4, ", "")).fps, 30);
  EXPECT_EQ(parse(with("perspective", "fisheye")).frames[0].camera.model,
            CameraModel::kOpenCVFisheye);
  EXPECT_EQ(parse(with("\"crop\": null", "\"crop\": {}")).notes.size(), 1u);
}

TEST_F(CameraPathJson, WrittenPathsReadBack) {
  CameraPath path;
  path.fps = 23.976;
  for (int i = 0; i < 7; ++i) {
    PathFrame frame;
    frame.camera.width = 640;
    frame.camera.height = 360;
    frame.camera.params = {500.0 + i, 500.0 + i, 320, 180};
    frame.camera_to_world.rotation = look_rotation({1.0, 0.3 * i, -0.1 * i}, {0.1, 0, 1});
    frame.camera_to_world.translation = {0.1 * i, 1.0 / 3, -7e5};
    frame.time = i / 6.0;
    path.frames.push_back(frame);
  }
  const fs::path file = folder_ / "tour.json";
  write_camera_path(file, path);
  const CameraPath back = read_camera_path(file);
  ASSERT_EQ(back.frames.size(), path.frames.size());
  EXPECT_EQ(back.fps, path.fps);
  EXPECT_EQ(back.frames[6].name, "tour_0006");
  for (size_t i = 0; i < back.frames.size(); ++i) {
    const PathFrame& a = path.frames[i];
    const PathFrame& b = back.frames[i];
    EXPECT_EQ(a.camera_to_world.translation, b.camera_to_world.translation);
    EXPECT_LT(rotation_angle(a.camera_to_world.rotation, b.camera_to_world.rotation), 1e-7);
    for (int r = 0; r < 3; ++r)
      for (int c = 0; c < 3; ++c)
        EXPECT_NEAR(a.camera_to_world.rotation.m[r][c], b.camera_to_world.rotation.m[r][c], 1e-12);
    EXPECT_NEAR(a.camera.fy(), b.camera.fy(), 1e-9);
    EXPECT_EQ(a.time, b.time);
  }
}

TEST_F(CameraPathJson, WriteRefusesWhatTheFormatCannotHold) {
  CameraPath path;
  EXPECT_THROW(write_camera_path(folder_ / "empty.json", path), Error);
  path = parse_camera_path(kExported, "flight.json", "flight");
  path.frames[1].camera.width = 10;
  EXPECT_THROW(write_camera_path(folder_ / "sizes.json", path), Error);
  EXPECT_TRUE(fs::is_empty(folder_.path()));
  path.frames.pop_back();
  EXPECT_THROW(write_camera_path(folder_ / "missing" / "path.json", path), Error);
}

TEST_F(CameraPathJson, ErrorsNameFileAndPlace) {
  EXPECT_EQ(
      error_of_path("{\n \"camera_path\": oops}").rfind("flight.json:2:17: not valid JSON", 0), 0u)
      << error_of_path("{\n \"camera_path\": oops}");
  const struct {
    const char *from, *to, *starts;
  } cases[] = {
      {"\"render_width\": 192,", "", "flight.json: render_width: the entry is missing"},
      {"192", "0", "flight.json: render_width: 0 is outside"},
      {"192", "1e12", "flight.json: render_width: 1e+12 is outside"},
      {"192", "19.5", "flight.json: render_width: expected whole pixels"},
      {"192", "\"192\"", "flight.json: render_width: expected a number"},
      {"\"fov\": 90", "\"fov\": 180", "flight.json: camera_path[0].fov: 180 is outside"},
      {"\"fov\": 90", "\"fov\": -1", "flight.json: camera_path[0].fov: -1 is outside"},
      {"\"fov\": 90", "\"fov\": null", "flight.json: camera_path[0].fov: expected a number"},
      {"\"fov\": 90", "\"fov\": 1e999", "flight.json: holds a number that is out of range"},
      {"[1, 0, 0, 0.5,", "[1, 0, 0,",
       "flight.json: camera_path[0].camera_to_world: expected 16 numbers"},
      {"[1, 0, 0, 0.5,", "[1, 0, 0, \"x\",",
       "flight.json: camera_path[0].camera_to_world[3]: expected a number"},
      {"[1, 0, 0, 0.5,", "[2, 0, 0, 0.5,",
       "flight.json: camera_path[0].camera_to_world: the matrix's left 3x3 part is no rotation"},
      {"[1, 0, 0, 0.5,", "[-1, 0, 0, 0.5,",
       "flight.json: camera_path[0].camera_to_world: the matrix's left 3x3 part is no rotation"},
      {"0, 1, 0, 5,  0, 0, 0, 1", "0, 1, 0, 5,  3, 4, 5, 1",
       "flight.json: camera_path[1].camera_to_world: the matrix's last row"},
      {"\"render_time\": 0.75", "\"render_time\": 2",
       "flight.json: camera_path[1].render_time: 2 is outside"},
      {"\"fps\": 24", "\"fps\": 0", "flight.json: fps: 0 is outside"},
  };
  for (const auto& c : cases) {
    const std::string error = error_of_path(with(c.from, c.to));
    EXPECT_EQ(error.rfind(c.starts, 0), 0u) << c.to << " gave: " << error;
  }
  EXPECT_EQ(error_of_path("[]"), "flight.json: expected an object");
  EXPECT_NE(error_of_path(R"({"camera_path": []})").find("one frame or more"), std::string::npos);
  EXPECT_NE(error_of_path(R"({"camera_path": 3})"), "");
  EXPECT_NE(error_of_path(R"({"camera_path": [3], "render_width": 4, "render_height": 4})")
                .find("camera_path[0]: expected an object"),
            std::string::npos);
}

TEST_F(CameraPathJson, EveryPrefixAndByteFlipGivesAPathOrAnError) {
  for (size_t n = 0; n < kExported.size(); ++n)
    EXPECT_NE(error_of_path(kExported.substr(0, n)), "") << n;
  for (size_t i = 0; i < kExported.size(); ++i)
    for (const int flip : {1, 0x20, 0x80, 0xff}) {
      std::string json = kExported;
      json[i] = static_cast<char>(json[i] ^ flip);
      error_of_path(json);  // any other exception fails the test
    }
}

TEST_F(CameraPathJson, FilesThatCannotBeReadSaySo) {
  EXPECT_THROW(read_camera_path(folder_ / "none.json"), Error);
  EXPECT_THROW(read_camera_path(folder_.path()), Error);
}

}  // namespace
}  // namespace nerf
