// Layers, looks and films of nerf_render, as a process.
#include <OpenImageIO/imageio.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <memory>

#include "nerf/io/depth_legend.h"
#include "nerf/io/image.h"
#include "nerf/io/mesh_file.h"
#include "nerf/math/camera_paths.h"
#include "nerf/math/srgb.h"
#include "nerf/model/grid_field.h"
#include "nerf/model/radiance_field.h"
#include "run_program.h"

namespace nerf {
namespace {

namespace fs = std::filesystem;
using testing_apps::expect_refused;
using testing_apps::ProgramResult;
using testing_apps::TempFolder;

constexpr int kWidth = 24, kHeight = 16;

// A run folder with a small random model of two views, of which one is held out.
class NerfRenderLayers : public testing::Test {
 protected:
  NerfRenderLayers()
      : run_((folder_.path() / "run").string()), out_((folder_.path() / "out").string()) {
    ModelInfo info;
    info.near = 0.1;
    info.far = 4;
    info.alpha = true;
    info.to_engine.scale = 0.5;
    for (int i = 0; i < 2; ++i) {
      ModelView view;
      view.name = "left/img" + std::to_string(i) + ".jpg";
      view.camera.model = CameraModel::kPinhole;
      view.camera.width = kWidth;
      view.camera.height = kHeight;
      view.camera.params = {20, 20, 12, 8};
      const Vec3d position{4 * std::cos(1.0 * i), 4 * std::sin(1.0 * i), 1};
      view.pose = {look_rotation(-position, {0, 0, 1}), position};
      view.held_out = i == 0;
      info.views.push_back(view);
    }
    GridOptions options;
    options.levels = 2;
    options.log2_entries = 10;
    options.occupancy_side = 64;
    auto grid = std::make_shared<GridField>(options, /*unbounded=*/false, /*cascades=*/1);
    grid->initialise(1);
    // Features of 0.5 to 1 with either sign, as half floats.
    for (size_t i = 0; i < grid->half_table.size(); ++i)
      grid->half_table[i] = static_cast<uint16_t>((i * 2654435761u >> 8 & 0x83ffu) | 0x3800u);
    fs::create_directory(run_);
    RadianceField(info, std::move(grid)).save(fs::path(run_) / "model.nerf");
  }

  ProgramResult render(std::vector<std::string> more) const {
    more.insert(more.begin(), {run_, "-o", out_});
    return testing_apps::run_program(NERF_RENDER_PROGRAM, more);
  }
  void rendered(const std::vector<std::string>& more) const {
    const ProgramResult result = render(more);
    EXPECT_EQ(result.exit_code, 0) << result.err;
  }
  void refused(const std::vector<std::string>& more, const std::vector<std::string>& parts) const {
    SCOPED_TRACE(testing::PrintToString(more));
    expect_refused(render(more), "nerf_render", parts);
  }

  std::vector<std::string> files() const {
    std::vector<std::string> found;
    if (fs::exists(out_))
      for (const auto& entry : fs::recursive_directory_iterator(out_))
        if (!entry.is_directory())
          found.push_back(entry.path().lexically_relative(out_).generic_string());
    std::ranges::sort(found);
    return found;
  }

  struct Picture {
    OIIO::ImageSpec spec;
    std::vector<float> values;
    float at(size_t pixel, const std::string& channel) const {
      return values[pixel * static_cast<size_t>(spec.nchannels) +
                    static_cast<size_t>(spec.channelindex(channel))];
    }
  };
  Picture read(const std::string& name) const {
    Picture picture;
    const auto in = OIIO::ImageInput::open((fs::path(out_) / name).string());
    EXPECT_TRUE(in) << name;
    if (!in) return picture;
    picture.spec = in->spec();
    picture.values.resize(static_cast<size_t>(picture.spec.width) *
                          static_cast<size_t>(picture.spec.height) *
                          static_cast<size_t>(picture.spec.nchannels));
    EXPECT_TRUE(in->read_image(0, 0, 0, -1, OIIO::TypeDesc::FLOAT, picture.values.data()));
    return picture;
  }

  TempFolder folder_;
  std::string run_, out_;
};

// The picture is the layers' colour over the background, and layers agree with each other.
TEST_F(NerfRenderLayers, OpenExrHoldsThePictureAndItsLayers) {
  rendered({"--aov", "all", "--background", "1,0,0.5", "--supersample", "2", "--metres", "0.25"});
  EXPECT_EQ(files(), (std::vector<std::string>{"depth/left/img0.png", "exr/left/img0.exr",
                                               "left/img0.png"}));
  const Picture exr = read("exr/left/img0.exr");
  ASSERT_EQ(exr.spec.nchannels, 4 + 5 + 6 + 4);
  EXPECT_EQ(exr.spec.get_string_attribute("nerf/view"), "left/img0.jpg");
  EXPECT_EQ(exr.spec.get_string_attribute("nerf/metresPerUnit"), "0.25");
  const Image8 png = read_image_8bit(fs::path(out_) / "left/img0.png");
  int seen = 0;
  for (size_t i = 0; i < kWidth * kHeight; ++i) {
    const float alpha = exr.at(i, "A");
    const float behind[3] = {1, 0, 0.5f};
    for (size_t k = 0; k < 3; ++k) {
      const float linear = exr.at(i, std::string(1, "RGB"[k]));
      const float sum =
          (alpha > 0 ? alpha * linear_to_srgb(linear / alpha) : 0) + (1 - alpha) * behind[k];
      EXPECT_NEAR(png.pixels[3 * i + k], 255 * sum, 0.6) << i;
    }
    EXPECT_EQ(exr.at(i, "opacity.Y"), alpha);
    EXPECT_NEAR(exr.at(i, "transmittance.Y"), 1 - alpha, 1e-6);
    const float z = exr.at(i, "depth.Z");
    if (!(z > 0)) continue;
    ++seen;
    EXPECT_LE(z, exr.at(i, "depth.distance.Z") * 1.00001f);
    EXPECT_LE(exr.at(i, "depth.p05.Z"), exr.at(i, "depth.distance.Z"));
    EXPECT_GT(exr.at(i, "depth.mean.Z"), 0);
    EXPECT_GT(exr.at(i, "samples.Y"), 0);
    double length = 0, in_camera = 0;
    for (const char* axis : {"X", "Y", "Z"}) {
      length += std::pow(exr.at(i, std::string("normal.") + axis), 2);
      in_camera += std::pow(exr.at(i, std::string("normal_camera.") + axis), 2);
    }
    EXPECT_NEAR(length, in_camera, 1e-5);
  }
  EXPECT_GT(seen, 20);
}

TEST_F(NerfRenderLayers, TheObjectOverItsFieldIsThePicture) {
  TriangleMesh mesh;
  mesh.positions = {{-0.5_r, -0.5_r, 0}, {0.5_r, -0.5_r, 0}, {0.5_r, 0.5_r, 0}, {0, 0, 0.7_r}};
  mesh.triangles = {{0, 1, 2}, {0, 1, 3}, {1, 2, 3}, {2, 0, 3}};
  const std::string object = (folder_.path() / "wedge.glb").string();
  write_glb(object, mesh, Similarity(), Similarity());
  rendered({"--insert", object, "--at", "0,0,0", "--scale", "2", "--aov", "object,field,shadow",
            "--no-depth"});
  const Picture exr = read("exr/left/img0.exr");
  ASSERT_EQ(exr.spec.nchannels, 4 + 4 + 4 + 3);
  int covered = 0, clear = 0;
  for (size_t i = 0; i < kWidth * kHeight; ++i) {
    const float cover = exr.at(i, "object.A");
    covered += cover > 0.1f;
    clear += cover == 0;
    for (const char* k : {"R", "G", "B"})
      EXPECT_NEAR(exr.at(i, std::string("object.") + k) + (1 - cover) *
                                                              exr.at(i, std::string("field.") + k) *
                                                              exr.at(i, std::string("shadow.") + k),
                  exr.at(i, k), 1e-5)
          << i;
  }
  EXPECT_GT(covered, 10);
  EXPECT_GT(clear, 10);
  refused({"--aov", "depth,shadow"}, {"--aov", "'shadow'", "--insert"});
}

TEST_F(NerfRenderLayers, FormatsHoldTheSameNumbers) {
  rendered({"--aov", "depth.z,normal", "--aov-format", "exr,npy,png16", "--no-depth"});
  EXPECT_EQ(files(),
            (std::vector<std::string>{"exr/left/img0.exr", "layers.json", "left/img0.png",
                                      "npy/depth.z/left/img0.npy", "npy/normal/left/img0.npy",
                                      "npy/rgba/left/img0.npy", "png16/depth.z/left/img0.png",
                                      "png16/normal/left/img0.png", "png16/rgba/left/img0.png"}));
  const Picture exr = read("exr/left/img0.exr"), depth = read("png16/depth.z/left/img0.png"),
                normal = read("png16/normal/left/img0.png");
  EXPECT_EQ(exr.spec.nchannels, 8);
  EXPECT_EQ(depth.spec.format, OIIO::TypeDesc::UINT16);
  // A scene of scale 0.5: 65535 * 0.5 / 8 is above 1000.
  EXPECT_NE(
      testing_apps::read_text(fs::path(out_) / "layers.json").find("\"lengths_per_unit\": 1000.0"),
      std::string::npos);
  const std::string npy = testing_apps::read_text(fs::path(out_) / "npy/depth.z/left/img0.npy");
  ASSERT_GT(npy.size(), sizeof(float) * kWidth * kHeight);
  const char* const numbers = npy.data() + npy.size() - sizeof(float) * kWidth * kHeight;
  for (size_t i = 0; i < kWidth * kHeight; ++i) {
    float value;
    std::memcpy(&value, numbers + sizeof(float) * i, sizeof value);
    EXPECT_EQ(value, exr.at(i, "depth.Z"));
    EXPECT_NEAR(depth.values[i] * 65.535f, value, 0.00051f);
    EXPECT_NEAR(normal.values[3 * i] * 65535 / 32767 - 1, exr.at(i, "normal.X"), 1e-4);
  }
}

TEST_F(NerfRenderLayers, DeepPicturesFlattenToTheFlatOnes) {
  rendered({"--aov", "opacity", "--deep", "--no-depth", "--exposure", "1"});
  const std::string flat = (fs::path(out_) / "flat.exr").string();
  const ProgramResult flattened = testing_apps::run_program(
      "/usr/bin/env", {"oiiotool", (fs::path(out_) / "deep/left/img0.exr").string(), "--flatten",
                       "-d", "float", "-o", flat});
  ASSERT_EQ(flattened.exit_code, 0) << flattened.err << flattened.out;
  const Picture deep = read("flat.exr"), exr = read("exr/left/img0.exr");
  for (size_t i = 0; i < kWidth * kHeight; ++i)
    for (const char* channel : {"R", "G", "B", "A"})
      ASSERT_NEAR(deep.at(i, channel), exr.at(i, channel), 1e-5) << i << channel;
}

TEST_F(NerfRenderLayers, PicturesOfTwoEyesAndTiles) {
  rendered({"--views", "orbit", "--frames", "2", "--camera", "vr180", "--size", "16x16", "--ipd",
            "0.1", "--aov", "all", "--deep", "--exr-type", "half", "--exr-tiles"});
  const Picture exr = read("exr/orbit_0001.exr");
  EXPECT_EQ(exr.spec.width, 32);
  EXPECT_EQ(exr.spec.tile_width, 64);
  EXPECT_EQ(exr.spec.channelformat(exr.spec.channelindex("R")), OIIO::TypeDesc::HALF);
  EXPECT_EQ(exr.spec.channelformat(exr.spec.channelindex("depth.Z")), OIIO::TypeDesc::FLOAT);
  EXPECT_EQ(files().size(), 2u * 4);
}

// Asking for layers changes nothing of pictures that have none, and threads change nothing.
TEST_F(NerfRenderLayers, TheSameBytesForAnyNumberOfThreads) {
  const auto bytes = [&](const std::string& threads) {
    rendered({"--aov", "all", "--deep", "--threads", threads});
    std::string all;
    for (const std::string& file : files()) all += testing_apps::read_text(fs::path(out_) / file);
    return all;
  };
  const std::string one = bytes("1");
  EXPECT_GT(one.size(), 1000u);
  EXPECT_EQ(bytes("2"), one);
}

TEST_F(NerfRenderLayers, DepthIsShownAsAsked) {
  rendered({});
  const Picture turbo = read("depth/left/img0.png");
  rendered({"--depth-map", "disparity", "--depth-legend"});
  const Picture grey = read("depth/left/img0.png");
  EXPECT_EQ(grey.spec.width, kWidth + legend_width(kHeight));
  rendered({"--depth-map", "normal"});
  const Picture normal = read("depth/left/img0.png");
  EXPECT_EQ(normal.spec.width, kWidth);
  int coloured = 0;
  for (size_t y = 0; y < kHeight; ++y)
    for (size_t x = 0; x < kWidth; ++x) {
      const float* g = grey.values.data() + 3 * (y * static_cast<size_t>(grey.spec.width) + x);
      EXPECT_TRUE(g[0] == g[1] && g[1] == g[2]);
      const float* t = turbo.values.data() + 3 * (y * kWidth + x);
      coloured += t[0] != t[1] || t[1] != t[2];
    }
  EXPECT_GT(coloured, 20);
  EXPECT_NE(normal.values, turbo.values);
}

TEST_F(NerfRenderLayers, FilmsShowDepth) {
  const std::string mp4 = (folder_.path() / "film.mp4").string();
  for (const std::string kind : {"side", "wipe", "depth"}) {
    rendered({"--views", "orbit", "--frames", "3", "--mp4", mp4, "--film", kind});
    EXPECT_EQ(testing_apps::read_text(mp4).substr(4, 4), "ftyp");
    const Picture film = read("film/orbit_0001.png"), colour = read("orbit_0001.png"),
                  depth = read("depth/orbit_0001.png");
    EXPECT_EQ(film.spec.width, kind == "side" ? 2 * kWidth : kWidth);
    // In the middle of a wipe there is depth alone; side by side it is the right half.
    if (kind == "side") {
      EXPECT_EQ(film.values[0], colour.values[0]);
      EXPECT_EQ(film.values.back(), depth.values.back());
    } else {
      EXPECT_EQ(film.values, depth.values);
    }
    if (kind == "wipe") {
      EXPECT_EQ(read("film/orbit_0000.png").values, read("orbit_0000.png").values);
      EXPECT_EQ(read("film/orbit_0002.png").values, read("orbit_0002.png").values);
    }
  }
}

TEST_F(NerfRenderLayers, WrongOptions) {
  refused({"--aov", "depth.x"}, {"--aov", "'depth.x' is no layer", "did you mean depth.z?"});
  refused({"--aov", "all", "--aov-format", "tiff"},
          {"--aov-format", "'tiff' is no format", "png16"});
  refused({"--exr-type", "double"}, {"--exr-type", "float, half"});
  refused({"--depth-map", "jet"}, {"--depth-map", "turbo, viridis, disparity, normal"});
  refused({"--film", "side"}, {"--film", "--mp4"});
  refused({"--film", "side", "--mp4", "a.mp4", "--no-depth"}, {"--film", "--no-depth"});
  EXPECT_FALSE(fs::exists(out_));
}

TEST_F(NerfRenderLayers, WhatCannotBeWrittenIsSaidAndLeavesNothing) {
  fs::create_directory(out_);
  testing_apps::write_text(fs::path(out_) / "exr", "a file");
  refused({"--aov", "all"}, {"exr", "is a file where a folder is wanted"});
  EXPECT_EQ(files(), (std::vector<std::string>{"exr"}));
  fs::remove(fs::path(out_) / "exr");
  // No file may grow over 4 KB, as if the disk had no more room; the layers are larger.
  for (const std::string kind : {"--aov=all", "--deep"}) {
    const ProgramResult result = testing_apps::run_program(
        "/bin/bash", {"-c", "trap '' XFSZ; ulimit -f 4; exec \"$@\"", "bash", NERF_RENDER_PROGRAM,
                      run_, "-o", out_, kind, "--no-depth"});
    EXPECT_EQ(result.exit_code, 2) << result.err;
    EXPECT_NE(result.lines().back().find("img0.exr: cannot write"), std::string::npos)
        << result.err;
    EXPECT_TRUE(files().empty()) << testing::PrintToString(files());
  }
}

}  // namespace
}  // namespace nerf
