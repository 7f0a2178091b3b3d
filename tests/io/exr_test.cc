// OpenEXR files, read back by OpenImageIO and by OpenEXR's own compositing.
#include "nerf/io/exr.h"

#include <OpenEXR/ImfCompositeDeepScanLine.h>
#include <OpenEXR/ImfDeepScanLineInputFile.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfInputFile.h>
#include <OpenEXR/ImfMatrixAttribute.h>
#include <OpenEXR/ImfStandardAttributes.h>
#include <OpenEXR/ImfStringAttribute.h>
#include <OpenImageIO/deepdata.h>
#include <OpenImageIO/imageio.h>
#include <gtest/gtest.h>

#include <cmath>
#include <map>

#include "layer_frames.h"
#include "nerf/base/process.h"
#include "support/cameras.h"
#include "support/temp_folder.h"

namespace nerf {
namespace {

using test::error_of;
using test::layer_frame;
using test::TempFolder;

constexpr int kFrameWidth = 70, kFrameHeight = 9;  // more than a tile wide

ExrHeader some_header() {
  ExrHeader header;
  header.camera = test::pinhole(kFrameWidth, kFrameHeight, 80, 90);
  header.camera.params[2] = 33;
  header.camera.params[3] = 5;
  header.camera_to_world.rotation.m = {{{0.8, 0, 0.6}, {0, 1, 0}, {-0.6, 0, 0.8}}};
  header.camera_to_world.translation = {1, 2, 3};
  header.texts = {{"nerf/view", "left/img0.jpg"}, {"software", "nerf_render"}};
  return header;
}

LayerImage some_image() {
  return layer_image(layer_frame(kFrameWidth, kFrameHeight), layer_names(), Pose(), 0);
}

std::map<std::string, std::vector<float>> read_channels(const std::filesystem::path& path) {
  const auto in = OIIO::ImageInput::open(path.string());
  EXPECT_TRUE(in) << OIIO::geterror();
  std::map<std::string, std::vector<float>> channels;
  if (!in) return channels;
  const OIIO::ImageSpec& spec = in->spec();
  EXPECT_EQ(spec.width, kFrameWidth);
  EXPECT_EQ(spec.height, kFrameHeight);
  const size_t count = static_cast<size_t>(spec.nchannels);
  std::vector<float> all(static_cast<size_t>(kFrameWidth * kFrameHeight) * count);
  EXPECT_TRUE(in->read_image(0, 0, 0, spec.nchannels, OIIO::TypeDesc::FLOAT, all.data()));
  for (size_t c = 0; c < count; ++c)
    for (size_t i = c; i < all.size(); i += count) channels[spec.channelnames[c]].push_back(all[i]);
  return channels;
}

TEST(Exr, EveryLayerIsReadBack) {
  const TempFolder folder;
  const LayerImage image = some_image();
  for (const ExrType type : {ExrType::kFloat, ExrType::kHalf})
    for (const bool tiled : {false, true}) {
      SCOPED_TRACE(testing::Message() << static_cast<int>(type) << tiled);
      write_exr(folder / "a.exr", image, some_header(), {type, tiled});
      auto channels = read_channels(folder / "a.exr");
      EXPECT_EQ(channels.size(), 4u + 5 + 2 * 3 + 4 + 2 * 4 + 3);
      for (const ImageLayer& layer : image.layers)
        for (size_t c = 0; c < layer.channels.size(); ++c) {
          SCOPED_TRACE(layer.channels[c]);
          const std::vector<float>& read = channels[layer.channels[c]];
          ASSERT_EQ(read.size(), static_cast<size_t>(kFrameWidth * kFrameHeight));
          const bool exact = type == ExrType::kFloat || layer.kind == LayerKind::kLength ||
                             layer.kind == LayerKind::kCount;
          for (size_t i = 0; i < read.size(); ++i) {
            const float v = static_cast<float>(layer.values[i * layer.channels.size() + c]);
            ASSERT_NEAR(read[i], v, exact ? 0 : std::abs(v) / 2048 + 1e-7) << i;
          }
        }
      const Imf::InputFile file((folder / "a.exr").c_str());
      EXPECT_EQ(file.header().hasTileDescription(), tiled);
    }
}

// The header's camera leads a point to the pixel that the camera projects it to.
TEST(Exr, TheHeaderHoldsTheCamera) {
  const TempFolder folder;
  const ExrHeader given = some_header();
  write_exr(folder / "a.exr", some_image(), given, {});
  const Imf::InputFile file((folder / "a.exr").c_str());
  const Imf::Header& header = file.header();
  const Vec3d in_camera{0.3, -0.2, 2};
  const Vec3d p = given.camera_to_world * in_camera;
  const Imath::V3f world(static_cast<float>(p.x), static_cast<float>(p.y), static_cast<float>(p.z));
  Imath::V3f seen;
  Imf::worldToCamera(header).multVecMatrix(world, seen);
  EXPECT_NEAR(seen.x, 0.3, 1e-5);
  EXPECT_NEAR(seen.y, 0.2, 1e-5) << "up";
  EXPECT_NEAR(seen.z, 2, 1e-5) << "forward";
  Imath::V3f ndc;
  Imf::worldToNDC(header).multVecMatrix(world, ndc);
  const Vec2d pixel = *project(given.camera, in_camera);
  EXPECT_NEAR(ndc.x * kFrameWidth, pixel.x, 1e-3);
  EXPECT_NEAR(ndc.y * kFrameHeight, pixel.y, 1e-3);
  // The window's middle, left and up of the axis at distance 1, and its width.
  EXPECT_NEAR(header.screenWindowCenter().x, (33 - 35) / 80.0, 1e-6);
  EXPECT_NEAR(header.screenWindowCenter().y, (5 - 4.5) / 90.0, 1e-6);
  EXPECT_NEAR(header.screenWindowWidth(), kFrameWidth / 80.0, 1e-6);
  const auto text = [&](const char* name) {
    const auto* found = header.findTypedAttribute<Imf::StringAttribute>(name);
    return found ? found->value() : std::string("none");
  };
  EXPECT_EQ(text("nerf/view"), "left/img0.jpg");
  EXPECT_EQ(text("nerf/lens"), "PINHOLE 70 9 80 90 33 5");
  EXPECT_NE(text("nerf/colour").find("sRGB"), std::string::npos);
  // What The Foundry's guide evaluates as a list of 16 numbers: the camera's axes in columns.
  EXPECT_EQ(text("nuke/camera/matrix"),
            "[0.8, -0, -0.6, 1, 0, -1, -0, 2, -0.6, -0, -0.8, 3, 0, 0, 0, 1]");
  EXPECT_NEAR(std::stod(text("nuke/camera/focal")), 36 * 80.0 / 70, 1e-9);
  EXPECT_NEAR(std::stod(text("nuke/camera/vaperture")), 36 * 9.0 / 70 * 80 / 90, 1e-9);
  EXPECT_TRUE(Imf::hasChromaticities(header));
}

TEST(Exr, ALensThatBendsHasNoMatrixOfProjection) {
  const TempFolder folder;
  const auto header_of = [&](const ExrHeader& given) {
    write_exr(folder / "a.exr", some_image(), given, {});
    return Imf::InputFile((folder / "a.exr").c_str()).header();
  };
  ExrHeader given = some_header();
  given.camera.model = CameraModel::kOpenCV;
  Imf::Header header = header_of(given);
  EXPECT_TRUE(Imf::hasWorldToCamera(header));
  EXPECT_FALSE(Imf::hasWorldToNDC(header));
  EXPECT_EQ(header.screenWindowWidth(), 1);
  given.camera = panorama(kFrameWidth, kFrameHeight);
  header = header_of(given);
  EXPECT_TRUE(Imf::hasWorldToCamera(header));
  EXPECT_TRUE(Imf::hasEnvmap(header));
  EXPECT_FALSE(Imf::hasWorldToNDC(header));
  given.single_eye = false;
  header = header_of(given);
  EXPECT_FALSE(Imf::hasWorldToCamera(header) || Imf::hasEnvmap(header));
}

// Flattened by OpenEXR and by oiiotool, the deep picture is the flat one.
TEST(DeepExr, FlattenedIsTheFlatPicture) {
  const TempFolder folder;
  const Frame frame = layer_frame(kFrameWidth, kFrameHeight);
  const ImageLayer flat = layer_image(frame, {}, Pose(), 0).layers[0];
  for (const ExrType type : {ExrType::kFloat, ExrType::kHalf}) {
    // Four samples of half floats, one over the other.
    const double tolerance = type == ExrType::kFloat ? 2e-6 : 4.0 / 2048;
    write_deep_exr(folder / "deep.exr", frame, 0, some_header(), {type, false});

    Imf::DeepScanLineInputFile file((folder / "deep.exr").c_str());
    EXPECT_TRUE(Imf::hasWorldToNDC(file.header()));
    Imf::CompositeDeepScanLine composite;
    composite.addSource(&file);
    std::vector<float> planes[4];
    Imf::FrameBuffer buffer;
    for (size_t k = 0; k < 4; ++k) {
      planes[k].resize(kFrameWidth * kFrameHeight);
      buffer.insert(
          std::string(1, "RGBA"[k]),
          Imf::Slice(Imf::FLOAT, reinterpret_cast<char*>(planes[k].data()), 4, 4 * kFrameWidth));
    }
    composite.setFrameBuffer(buffer);
    composite.readPixels(0, kFrameHeight - 1);

    run_process_or_throw({"oiiotool", (folder / "deep.exr").string(), "--flatten", "-d", "float",
                          "-o", (folder / "flat.exr").string()},
                         {}, "oiiotool flattens");
    auto channels = read_channels(folder / "flat.exr");
    for (size_t i = 0; i < frame.alpha.size(); ++i)
      for (size_t k = 0; k < 4; ++k) {
        const float expected = static_cast<float>(flat.values[4 * i + k]);
        ASSERT_NEAR(planes[k][i], expected, tolerance) << i;
        ASSERT_NEAR(channels[std::string(1, "RGBA"[k])][i], expected, tolerance) << i;
      }
  }
}

TEST(DeepExr, SamplesAreWhereTheirLightIsStopped) {
  const TempFolder folder;
  const Frame frame = layer_frame(kFrameWidth, kFrameHeight);
  write_deep_exr(folder / "deep.exr", frame, 0, some_header(), {});
  const auto in = OIIO::ImageInput::open((folder / "deep.exr").string());
  ASSERT_TRUE(in);
  ASSERT_TRUE(in->spec().deep);
  OIIO::DeepData data;
  ASSERT_TRUE(in->read_native_deep_image(0, 0, data));
  const auto channel = [&](const char* name) { return in->spec().channelindex(name); };
  for (int64_t i = 0; i < kFrameWidth * kFrameHeight; ++i) {
    const auto& samples = frame.layers.deep[static_cast<size_t>(i)];
    ASSERT_EQ(data.samples(i), static_cast<int>(samples.size()));
    for (int s = 0; s < data.samples(i); ++s) {
      EXPECT_EQ(data.deep_value(i, channel("Z"), s), samples[static_cast<size_t>(s)].front);
      EXPECT_EQ(data.deep_value(i, channel("ZBack"), s), samples[static_cast<size_t>(s)].back);
    }
  }
}

TEST(Exr, WhatCannotBeWrittenLeavesNothing) {
  const TempFolder folder;
  const Frame frame = layer_frame(kFrameWidth, kFrameHeight);
  test::write_text(folder / "file", "x");
  for (const auto& target : {std::filesystem::path("/dev/full"), folder / "file" / "a.exr",
                             folder.path(), folder / "none" / "a.exr"}) {
    const std::string flat = error_of([&] { write_exr(target, some_image(), some_header(), {}); });
    const std::string deep = error_of([&] { write_deep_exr(target, frame, 0, some_header(), {}); });
    EXPECT_NE(flat.find(target.string()), std::string::npos) << flat;
    EXPECT_NE(deep.find(target.string()), std::string::npos) << deep;
  }
  EXPECT_EQ(folder.files(), 1);
}

}  // namespace
}  // namespace nerf
