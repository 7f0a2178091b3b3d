#include "nerf/io/layer_image.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "io/npy.h"
#include "layer_frames.h"
#include "nerf/math/srgb.h"
#include "support/temp_folder.h"

namespace nerf {
namespace {

using test::contains;
using test::error_of;
using test::layer_frame;
using test::TempFolder;
using Names = std::vector<std::string>;

TEST(Srgb, IsItsOwnInverseAndHasTheStandardsValues) {
  EXPECT_NEAR(srgb_to_linear(0.5), 0.21404114048223255, 1e-15);
  EXPECT_NEAR(srgb_to_linear(0.04), 0.04 / 12.92, 1e-15);
  EXPECT_EQ(srgb_to_linear(1.0), 1);
  for (double x = -0.5; x < 2; x += 0.01) EXPECT_NEAR(linear_to_srgb(srgb_to_linear(x)), x, 1e-7);
}

TEST(LayerNames, AreFoundInAnyOrderAndCaseAndSuggested) {
  EXPECT_EQ(parse_layers("all", "--aov", /*inserted=*/true), layer_names());
  EXPECT_EQ(parse_layers("all", "--aov"), Names(layer_names().begin(), layer_names().end() - 3));
  EXPECT_EQ(parse_layers("shadow,object", "--aov", true), (Names{"object", "shadow"}));
  EXPECT_TRUE(contains(error_of([] { parse_layers("depth,field", "--aov"); }),
                       "the layer 'field' is of pictures with an object in them"));
  EXPECT_EQ(parse_layers("normal, Depth.Z,normal", "--aov"), (Names{"depth.z", "normal"}));
  EXPECT_EQ(parse_layers("depth", "--aov"),
            (Names{"depth.z", "depth.distance", "depth.mean", "depth.p05", "depth.p95"}));
  EXPECT_TRUE(contains(error_of([] { parse_layers("depth.z,normals", "--aov"); }),
                       "--aov: 'normals' is no layer"));
  EXPECT_TRUE(contains(error_of([] { parse_layers("normals", "--aov"); }), "did you mean normal?"));
  EXPECT_TRUE(contains(error_of([] { parse_layers("opacity,", "--aov"); }), "'' is no layer"));
  EXPECT_EQ(layers_for(Names{"depth.z", "opacity", "transmittance", "depth.distance"}), Layers{});
  EXPECT_EQ(layers_for(Names{"variance"}), Layers{.moments = true});
  EXPECT_EQ(
      layers_for(layer_names()),
      (Layers{
          .moments = true, .percentiles = true, .samples = true, .normal = true, .apart = true}));
}

TEST(LayerImage, TheObjectOverItsShadowedFieldIsThePicture) {
  const Frame frame = layer_frame(7, 6);
  const LayerImage image =
      layer_image(frame, Names{"object", "field", "shadow"}, Pose(), /*stops=*/-0.5);
  const auto& rgba = image.layers[0].values;
  const auto &object = image.layers[1].values, &field = image.layers[2].values;
  const auto& shadow = image.layers[3].values;
  for (size_t i = 0; i < 42; ++i) {
    EXPECT_EQ(object[4 * i + 3], frame.layers.cover[i]);
    EXPECT_EQ(field[4 * i + 3], frame.layers.field[4 * i + 3]);
    for (size_t k = 0; k < 3; ++k) {
      EXPECT_NEAR(
          object[4 * i + k] + (1 - object[4 * i + 3]) * field[4 * i + k] * shadow[3 * i + k],
          rgba[4 * i + k], 1e-6);
      const double alpha = frame.alpha[i], seen = frame.layers.field[4 * i + k] / alpha;
      EXPECT_NEAR(field[4 * i + k], alpha > 0 ? std::exp2(-0.5) * alpha * srgb_to_linear(seen) : 0,
                  1e-6);
      if (frame.layers.cover[i] > 0) {
        EXPECT_EQ(shadow[3 * i + k], frame.layers.shadow[3 * i + k]);
      } else {  // all of the picture is the field's, and what makes it so is the shadow
        EXPECT_NEAR(object[4 * i + k], 0, 1e-6);
        if (field[4 * i + k] > 0) {
          EXPECT_NEAR(shadow[3 * i + k], 1, 1e-6);
        }
      }
    }
  }
}

TEST(LayerImage, ColourIsLinearLightTimesOpacity) {
  const Frame frame = layer_frame(5, 4);
  Pose pose;
  pose.rotation.m = {{{0, 0, 1}, {1, 0, 0}, {0, 1, 0}}};
  for (const double stops : {0.0, 1.5}) {
    const LayerImage image = layer_image(frame, layer_names(), pose, stops);
    ASSERT_EQ(image.layers.size(), layer_names().size() + 1);
    const auto& rgba = image.layers[0].values;
    for (size_t i = 0; i < 20; ++i) {
      const double alpha = frame.alpha[i];
      EXPECT_EQ(rgba[4 * i + 3], frame.alpha[i]);
      for (size_t k = 0; k < 3; ++k) {
        const double seen = alpha > 0 ? frame.layers.rgb[3 * i + k] / alpha : 0;
        EXPECT_NEAR(rgba[4 * i + k], std::exp2(stops) * alpha * srgb_to_linear(seen), 1e-6) << i;
      }
    }
  }
  // The camera's x is the world's y, its y (down) the world's z, its z (forward) the world's x.
  const LayerImage image = layer_image(frame, Names{"normal_camera", "transmittance"}, pose, 0);
  EXPECT_EQ(image.layers[1].channels,
            (Names{"normal_camera.X", "normal_camera.Y", "normal_camera.Z"}));
  for (size_t i = 1; i < 20; i += 5) {
    EXPECT_NEAR(image.layers[1].values[3 * i], frame.layers.normal[3 * i + 1], 1e-6);
    EXPECT_NEAR(image.layers[1].values[3 * i + 1], -frame.layers.normal[3 * i + 2], 1e-6);
    EXPECT_NEAR(image.layers[1].values[3 * i + 2], -frame.layers.normal[3 * i], 1e-6);
    EXPECT_NEAR(image.layers[2].values[i], 1 - frame.alpha[i], 1e-6);
  }
}

// Front over back, sample by sample, in double.
TEST(DeepPixel, OneSampleOverTheOtherIsThePixel) {
  const Frame frame = layer_frame(9, 7);
  const LayerImage flat = layer_image(frame, {}, Pose(), 0.5);
  for (size_t i = 0; i < 63; ++i) {
    double rgba[4] = {0, 0, 0, 0};
    const auto samples = deep_pixel(frame, i, 0.5);
    EXPECT_EQ(samples.size(), frame.layers.deep[i].size());
    for (const DeepPixelSample& s : samples) {
      const double left = 1 - rgba[3];
      for (size_t k = 0; k < 4; ++k) rgba[k] += left * static_cast<double>(s.rgba[k]);
      EXPECT_GT(s.z_back, s.z);
    }
    for (size_t k = 0; k < 4; ++k) EXPECT_NEAR(rgba[k], flat.layers[0].values[4 * i + k], 2e-6);
  }
}

TEST(LayerPicture, HoldsSixteenBitsOfWhatTheLayerSays) {
  const Frame frame = layer_frame(5, 4);
  const LayerImage image = layer_image(frame, layer_names(), Pose(), 0);
  for (const ImageLayer& layer : image.layers) {
    const Image16 picture = layer_picture(image, layer, 100);
    ASSERT_EQ(picture.pixels.size(), layer.values.size());
    EXPECT_EQ(picture.channels, static_cast<int>(layer.channels.size()));
    for (size_t i = 0; i < layer.values.size(); ++i) {
      const double v = layer.values[i], stored = picture.pixels[i];
      switch (layer.kind) {
        case LayerKind::kColour:
          if (const double a = layer.values[i / 4 * 4 + 3]; i % 4 < 3 && a > 0) {
            EXPECT_NEAR(srgb_to_linear(stored / 65535) * a, v, 1e-4);
          }
          break;
        case LayerKind::kShare:
          EXPECT_NEAR(stored / 65535, v, 1e-5);
          break;
        case LayerKind::kDirection:
          EXPECT_NEAR(stored / 32767 - 1, v, 2e-5);
          break;
        default:
          EXPECT_NEAR(stored / 100, v, 0.005 + 1e-9);
      }
    }
  }
  // What does not fit is cut off, and a file gives back what was written.
  const Image16 bright = layer_picture(image, image.layers[1], 1e6);
  EXPECT_EQ(*std::ranges::max_element(bright.pixels), 65535);
  const TempFolder folder;
  const Image16 rgba = layer_picture(image, image.layers[0], 1);
  write_image(folder / "a.png", rgba);
  const ImageF read = read_image_float(folder / "a.png");
  ASSERT_EQ(read.channels, 4);
  for (size_t i = 0; i < rgba.pixels.size(); ++i)
    EXPECT_NEAR(read.pixels[i], rgba.pixels[i] / 65535.0, 1e-6);
  EXPECT_TRUE(contains(error_of([&] { write_image(folder / "a.jpg", rgba); }), "PNG"));
}

TEST(LayerNpy, IsReadBack) {
  const TempFolder folder;
  const LayerImage image = layer_image(layer_frame(5, 4), layer_names(), Pose(), 0);
  for (const ImageLayer& layer : image.layers) {
    write_layer_npy(folder / "a.npy", image, layer);
    const internal::NpyArray read = internal::read_npy(folder / "a.npy");
    std::vector<size_t> shape{4, 5};
    if (layer.channels.size() > 1) shape.push_back(layer.channels.size());
    EXPECT_EQ(read.shape, shape);
    ASSERT_EQ(read.values.size(), layer.values.size());
    for (size_t i = 0; i < read.values.size(); ++i)
      EXPECT_EQ(read.values[i], static_cast<float>(layer.values[i]));
  }
}

}  // namespace
}  // namespace nerf
