// nerf_render as a process.
#include <gtest/gtest.h>

#include <chrono>
#include <csignal>
#include <limits>
#include <memory>
#include <thread>

#include "io/some_gltf.h"
#include "nerf/base/threads.h"
#include "nerf/io/image.h"
#include "nerf/kernels/bf16.h"
#include "nerf/kernels/simd.h"
#include "nerf/math/camera_paths.h"
#include "nerf/model/grid_field.h"
#include "nerf/model/radiance_field.h"
#include "run_program.h"

namespace nerf {
namespace {

namespace fs = std::filesystem;
using testing_apps::expect_refused;
using testing_apps::Program;
using testing_apps::ProgramResult;
using testing_apps::TempFolder;
using testing_apps::write_text;

ProgramResult render_program(const std::vector<std::string>& arguments) {
  return testing_apps::run_program(NERF_RENDER_PROGRAM, arguments);
}
void refused(const std::vector<std::string>& arguments, const std::vector<std::string>& parts) {
  SCOPED_TRACE(testing::PrintToString(arguments));
  expect_refused(render_program(arguments), "nerf_render", parts);
}

// A run folder with a small untrained model of six cameras, two of them held out.
class NerfRender : public testing::Test {
 protected:
  NerfRender() : run_((folder_.path() / "run").string()), out_((folder_.path() / "out").string()) {
    ModelInfo info;
    info.background = {0, 1, 0.5_r};
    info.near = 0.1;
    info.far = 4;
    for (int i = 0; i < 6; ++i) {
      ModelView view;
      view.name = (i < 3 ? "left/img" : "right/img") + std::to_string(i) + ".jpg";
      view.camera.model = CameraModel::kPinhole;
      view.camera.width = 24;
      view.camera.height = 16;
      view.camera.params = {20, 20, 12, 8};
      const Vec3d position{2 * std::cos(1.0 * i), 2 * std::sin(1.0 * i), 0.5};
      view.pose = {look_rotation(-position, {0, 0, 1}), position};
      view.held_out = i % 4 == 0;
      info.views.push_back(view);
    }
    GridOptions options;
    options.levels = 2;
    options.log2_entries = 10;
    options.occupancy_side = 64;
    auto grid = std::make_shared<GridField>(options, /*unbounded=*/false, /*cascades=*/1);
    grid->initialise(1);
    fs::create_directory(run_);
    RadianceField(info, std::move(grid)).save(fs::path(run_) / "model.nerf");
  }

  // A program that is still writing may rename a file between its listing and any other look at it:
  // only the listing is asked.
  std::vector<std::string> pictures() const {
    std::vector<std::string> files;
    if (fs::exists(out_))
      for (const auto& entry : fs::recursive_directory_iterator(out_))
        if (!entry.is_directory())
          files.push_back(entry.path().lexically_relative(out_).generic_string());
    std::sort(files.begin(), files.end());
    return files;
  }

  // The first pixel of a picture that is rendered with these options.
  std::vector<uint8_t> corner(std::vector<std::string> options) const {
    options.insert(options.begin(), {run_, "-o", out_, "--no-depth"});
    const ProgramResult result = render_program(options);
    EXPECT_EQ(result.exit_code, 0) << result.err;
    std::vector<uint8_t> pixels = read_image_8bit(fs::path(out_) / "left/img0.png").pixels;
    pixels.resize(3);
    return pixels;
  }

  TempFolder folder_;
  std::string run_, out_;
};

TEST_F(NerfRender, TestViewsKeepTheirNames) {
  const ProgramResult result = render_program({run_, "-o", out_});
  EXPECT_EQ(result.exit_code, 0) << result.err;
  EXPECT_EQ(pictures(), (std::vector<std::string>{"depth/left/img0.png", "depth/right/img4.png",
                                                  "left/img0.png", "right/img4.png"}));
  const Image8 picture = read_image_8bit(fs::path(out_) / "left/img0.png");
  EXPECT_EQ(picture.width, 24);
  EXPECT_EQ(picture.height, 16);
  EXPECT_EQ(picture.channels, 3);
  const std::string first = result.lines().at(0);
  EXPECT_EQ(first.rfind("nerf_render 0.", 0), 0u) << first;
  EXPECT_NE(first.find(precision_name(resolve_precision(Precision::kAuto))), std::string::npos)
      << first;
  EXPECT_EQ(result.out, "");
}

TEST_F(NerfRender, BackgroundIsTheModelsUnlessChosen) {
  // Next to nothing is drawn, and it is not in the corner.
  const std::string box = "0,0,0,0.1,0.1,0.1";
  EXPECT_EQ(corner({"--bbox", box}), (std::vector<uint8_t>{0, 255, 128}));
  EXPECT_EQ(corner({"--bbox", box, "--background", "1,0,0.2"}), (std::vector<uint8_t>{255, 0, 51}));
}

TEST_F(NerfRender, AChosenBackgroundTakesTheSkysPlace) {
  const fs::path file = fs::path(run_) / "model.nerf";
  const RadianceField model = RadianceField::load(file);
  auto grid = std::make_shared<GridField>(model.grid().options, /*unbounded=*/false,
                                          /*cascades=*/1, GridParts{.sky = true});
  grid->initialise(1);
  grid->occupancy.set_levels(std::vector<uint8_t>(grid->occupancy.levels().size()));  // empty
  RadianceField(model.info(), std::move(grid)).save(file);
  // The sky of an untrained network is about grey.
  for (const uint8_t k : corner({})) EXPECT_NEAR(k, 128, 70);
  EXPECT_EQ(corner({"--background", "1,0,0.2"}), (std::vector<uint8_t>{255, 0, 51}));
}

// Pictures smaller than the photos do not alias, unless one ray per pixel is asked for.
TEST_F(NerfRender, SmallPicturesAverageRays) {
  const auto small = [&](std::vector<std::string> more) {
    more.insert(more.begin(), {run_, "-o", out_, "--no-depth", "--downscale", "2"});
    const ProgramResult result = render_program(more);
    EXPECT_EQ(result.exit_code, 0) << result.err;
    const bool said = result.err.find("averages 2 x 2 rays") != std::string::npos;
    return std::pair(said, read_image_8bit(fs::path(out_) / "left/img0.png").pixels);
  };
  const auto usual = small({}), two = small({"--supersample", "2"}),
             one = small({"--supersample", "1"});
  EXPECT_TRUE(usual.first);
  EXPECT_FALSE(two.first || one.first);
  EXPECT_EQ(usual.second, two.second);
  EXPECT_NE(usual.second, one.second);
  refused({run_, "-o", out_, "--supersample", "9"}, {"--supersample"});
}

TEST_F(NerfRender, EveryKindOfViews) {
  for (const std::string kind :
       {"train", "orbit", "spiral", "spherified", "ellipse", "interpolate"}) {
    std::vector<std::string> arguments{
        run_ + "/model.nerf", "--views", kind, "--no-depth", "-o", out_, "--size", "12x10",
        "--threads",          "1"};
    if (kind != "train") arguments.insert(arguments.end(), {"--frames", "3"});
    const ProgramResult result = render_program(arguments);
    EXPECT_EQ(result.exit_code, 0) << kind << ": " << result.err;
    EXPECT_NE(result.err.find("1 thread,"), std::string::npos) << result.err;
    const std::string last = kind == "train" ? "right/img5.png" : kind + "_0002.png";
    EXPECT_EQ(read_image_8bit(fs::path(out_) / last).width, 12) << kind;
  }
  EXPECT_EQ(pictures().size(), 4u + 5 * 3);
}

TEST_F(NerfRender, CameraPathFile) {
  const fs::path file = folder_.path() / "tour.json";
  write_text(file, R"({"render_width": 20, "render_height": 10, "fps": 5, "camera_path": [
    {"camera_to_world": [1,0,0,0, 0,1,0,0, 0,0,1,2, 0,0,0,1], "fov": 50},
    {"camera_to_world": [1,0,0,0, 0,1,0,0, 0,0,1,3, 0,0,0,1], "fov": 50}]})");
  const ProgramResult result = render_program({run_, "--views", file.string(), "-o", out_, "--bbox",
                                               "-1,-1,-1,1,1,1", "--background", "0,0.5,1"});
  EXPECT_EQ(result.exit_code, 0) << result.err;
  EXPECT_EQ(pictures(), (std::vector<std::string>{"depth/tour_0000.png", "depth/tour_0001.png",
                                                  "tour_0000.png", "tour_0001.png"}));
}

TEST_F(NerfRender, Video) {
  const std::string mp4 = (folder_.path() / "films" / "orbit.mp4").string();
  const ProgramResult result = render_program(
      {run_, "--views", "orbit", "--frames", "4", "-o", out_, "--mp4", mp4, "--size", "33x25"});
  EXPECT_EQ(result.exit_code, 0) << result.err;
  EXPECT_EQ(testing_apps::read_text(mp4).substr(4, 4), "ftyp");
  EXPECT_NE(result.err.find(mp4), std::string::npos) << result.err;
}

// What the environment asks for is what runs, or is refused with what there is.
TEST_F(NerfRender, TheEnvironmentChoosesInstructions) {
  const auto with = [&](const std::string& variable) {
    return testing_apps::run_program(
        "/usr/bin/env", {variable, NERF_RENDER_PROGRAM, run_, "-o", out_, "--no-depth"});
  };
  for (const std::string& target : simd_targets()) {
    const ProgramResult result = with("NERF_SIMD=" + target);
    EXPECT_EQ(result.exit_code, 0) << result.err;
    EXPECT_NE(result.lines().at(0).find(": " + target + ","), std::string::npos) << result.err;
  }
  expect_refused(with("NERF_SIMD=MMX"), "nerf_render", {"NERF_SIMD", "MMX", simd_targets().back()});
  for (const Bf16Unit unit : bf16_units()) {
    const ProgramResult result = with("NERF_BF16=" + bf16_unit_name(unit));
    EXPECT_EQ(result.exit_code, 0) << result.err;
  }
  expect_refused(with("NERF_BF16=MMX"), "nerf_render", {"NERF_BF16", "MMX"});
}

TEST_F(NerfRender, HelpIsNoMistake) {
  const ProgramResult result = render_program({"--help"});
  EXPECT_EQ(result.exit_code, 0);
  EXPECT_EQ(result.err, "");
  EXPECT_NE(result.out.find("--views"), std::string::npos);
}

TEST_F(NerfRender, WrongOptions) {
  refused({}, {"RUN is missing"});
  refused({run_}, {"--out is missing"});
  refused({run_, "-o", out_, "--veiws", "test"},
          {"unknown option --veiws", "did you mean --views"});
  refused({run_, "-o", out_, "--views", "obrit"}, {"--views", "did you mean orbit?"});
  refused({run_, "-o", out_, "--size", "0x0"}, {"--size", "800x600"});
  refused({run_, "-o", out_, "--size", "1000000x1000000"}, {"--size", "16384"});
  refused({run_, "-o", out_, "--size", "8x8", "--downscale", "2"}, {"--size", "--downscale"});
  refused({run_, "-o", out_, "--threads", "-1"}, {"--threads", "0 to 1024"});
  refused({run_, "-o", out_, "--frames", "0", "--views", "orbit"}, {"--frames"});
  refused({run_, "-o", out_, "--frames", "3"}, {"--frames", "leave it out"});
  refused({run_, "-o", out_, "--bbox", "0,0,0,1,1"}, {"--bbox", "6 numbers"});
  refused({run_, "-o", out_, "--bbox", "0,0,0,1,1,-1"}, {"--bbox", "greater"});
  refused({run_, "-o", out_, "--background", "1,2,3"}, {"--background", "0 to 1"});
  refused({run_, "-o", out_, "--mp4", "film.avi"}, {"--mp4", ".mp4"});
  EXPECT_FALSE(fs::exists(out_)) << "nothing is written for a command that cannot be carried out";
}

TEST_F(NerfRender, MissingAndBrokenModels) {
  const fs::path empty = folder_.path() / "empty";
  fs::create_directory(empty);
  refused({(folder_.path() / "none").string(), "-o", out_}, {"none: no such file or folder"});
  refused({empty.string(), "-o", out_}, {"empty", "no model.nerf", "nerf_train"});
  write_text(empty / "model.nerf", "");
  refused({empty.string(), "-o", out_}, {"model.nerf"});
  write_text(empty / "model.nerf", "this is no model file, whatever its name says");
  refused({empty.string(), "-o", out_}, {"model.nerf"});
  const std::string whole = testing_apps::read_text(run_ + "/model.nerf");
  write_text(empty / "model.nerf", whole.substr(0, whole.size() / 2));
  refused({empty.string(), "-o", out_}, {"model.nerf"});
  EXPECT_FALSE(fs::exists(out_));
}

TEST_F(NerfRender, BrokenCameraPaths) {
  const std::string path = (folder_.path() / "path.json").string();
  const std::vector<std::string> arguments{run_, "--views", path, "-o", out_};
  refused(arguments, {"path.json"});  // not there
  write_text(path, "{\n  \"camera_path\": [}");
  refused(arguments, {"path.json:2:19", "not valid JSON"});
  write_text(path, "{\"camera_path\": [], \"render_width\": 8, \"render_height\": 8}");
  refused(arguments, {"path.json: camera_path", "one frame or more"});
  write_text(path, R"({"render_width": 1e9, "render_height": 8, "camera_path": [{}]})");
  refused(arguments, {"path.json: render_width"});
  write_text(path, R"({"render_width": 8, "render_height": 8, "camera_path": [{"fov": 50,
    "aspect": 1, "camera_to_world": [1,0,0,NaN, 0,1,0,0, 0,0,1,0, 0,0,0,1]}]})");
  refused(arguments, {"path.json:2", "not valid JSON"});
  const std::string film = (folder_.path() / "path.glb").string();
  test::SomeGltf gltf;
  gltf.json["nodes"] = {{{"camera", 0}}};
  gltf.json["cameras"] = {
      {{"type", "perspective"}, {"perspective", {{"yfov", 1.0}, {"znear", 0.1}}}}};
  gltf.animate(0, "translation", {0, 1}, {0, 0, 0, 0, std::numeric_limits<float>::quiet_NaN(), 1},
               "VEC3");
  gltf.write(film);
  refused({run_, "--views", film, "-o", out_}, {"path.glb", "output 1 is not finite"});
  EXPECT_FALSE(fs::exists(out_));
}

TEST_F(NerfRender, UnwritableOutput) {
  const fs::path file = folder_.path() / "file";
  write_text(file, "x");
  refused({run_, "-o", file.string()}, {"file"});
  refused({run_, "-o", (file / "below").string()}, {"file"});
  refused({run_, "-o", "/proc/nerf"}, {"/proc/nerf"});
  EXPECT_EQ(testing_apps::read_text(file), "x");
  fs::create_directory(out_);
  refused({run_, "-o", out_, "--views", "interpolate", "--mp4", (file / "film.mp4").string()},
          {"file"});
}

TEST_F(NerfRender, ABrokenObjectLeavesNoFolder) {
  const std::string object = (folder_.path() / "broken.glb").string();
  write_text(object, "glTF, or not");
  refused({run_, "-o", out_, "--insert", object}, {"broken.glb"});
  EXPECT_FALSE(fs::exists(out_));
  const fs::path film = folder_.path() / "films" / "new" / "film.mp4";
  refused({run_, "-o", out_, "--views", "interpolate", "--mp4", film.string(), "--insert", object},
          {"broken.glb"});
  EXPECT_FALSE(fs::exists(out_));
  EXPECT_FALSE(fs::exists(folder_.path() / "films"));
}

TEST_F(NerfRender, ADiskThatIsFullLeavesNothingHalfWritten) {
  // No file may grow over 1 KB, as if the disk had no more room; the pictures are larger.
  const ProgramResult result = testing_apps::run_program(
      "/bin/bash", {"-c", "trap '' XFSZ; ulimit -f 1; exec \"$@\"", "bash", NERF_RENDER_PROGRAM,
                    run_, "-o", out_, "--size", "240x160"});
  EXPECT_EQ(result.exit_code, 2) << result.err;
  const std::string last = result.lines().back();
  EXPECT_EQ(last.rfind("nerf_render: " + out_, 0), 0u) << last;
  EXPECT_NE(last.find(".png: cannot write"), std::string::npos) << last;
  EXPECT_TRUE(pictures().empty()) << testing::PrintToString(pictures());
}

TEST_F(NerfRender, SignalsLeaveWholeFramesOnly) {
  for (const int number : {SIGTERM, SIGINT}) {
    fs::remove_all(out_);
    Program program(NERF_RENDER_PROGRAM, {run_, "--views", "orbit", "--frames", "100000", "-o",
                                          out_, "--size", "64x48"});
    const fs::path third = fs::path(out_) / "orbit_0002.png";  // its depth is written before it
    for (int i = 0; i < 3000 && !fs::exists(third); ++i)
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    kill(program.pid(), number);
    const ProgramResult result = program.wait();
    EXPECT_EQ(result.exit_code, 128 + number) << result.err;
    const std::vector<std::string> files = pictures();
    EXPECT_GE(files.size(), 6u);
    EXPECT_EQ(files.size() % 2, 0u) << "colour without depth";
    for (const std::string& name : files) {
      EXPECT_TRUE(name.ends_with(".png") && name.find(".tmp") == std::string::npos) << name;
      EXPECT_EQ(read_image_8bit(fs::path(out_) / name).height, 48) << name;
    }
    const std::string last = result.lines().back();
    EXPECT_NE(
        last.find("stopped by a signal; " + std::to_string(files.size() / 2) + " of 100000 frames"),
        std::string::npos)
        << last;
  }
}

}  // namespace
}  // namespace nerf
