// OpenEXR files of pictures with layers, flat and deep, as compositing programs read them.
#pragma once

#include <array>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "nerf/base/options.h"
#include "nerf/io/layer_image.h"
#include "nerf/math/camera.h"
#include "nerf/math/vec.h"

namespace nerf {

enum class ExrType { kFloat, kHalf };
inline auto option_names(ExrType) {
  return std::array{OptionName{ExrType::kFloat, "float"}, OptionName{ExrType::kHalf, "half"}};
}

struct ExrOptions {
  // Of colour, shares and directions; lengths and counts are float32, since half has 11 bits.
  ExrType type = ExrType::kFloat;
  bool tiled = false;  // tiles of 64 x 64 pixels instead of lines; flat files only
};

// What the header says of a picture beside its channels.
struct ExrHeader {
  Camera camera;         // of a picture of two eyes the left one's
  Pose camera_to_world;  // input coordinates, OpenCV axes
  bool single_eye = true;
  std::vector<std::pair<std::string, std::string>> texts;  // more attributes: name, text
};

// The header holds, where the camera is one eye's:
//  - worldToCamera, as OpenEXR defines it (points are rows; x right, y up, z forward), and, of
//  lenses
//    without distortion, worldToNDC ((0, 0) upper left, (1, 1) lower right), screenWindowCenter and
//    screenWindowWidth;
//  - nuke/camera/focal, haperture, vaperture (mm, of a film 36 mm wide) and matrix (camera to
//  world,
//    x right, y up, z backward), which The Foundry's guide makes a camera of;
//  - nerf/lens: model, size and parameters as COLMAP's cameras.txt; envmap where it is a panorama
//  of
//    the full sphere.
// The file appears whole or not at all; the same bytes for any number of threads. Throws Error.
void write_exr(const std::filesystem::path& path, const LayerImage& image, const ExrHeader& header,
               const ExrOptions& options);

// A deep scan-line file of R, G, B, A, Z and ZBack, of a frame drawn with Layers::deep.
void write_deep_exr(const std::filesystem::path& path, const Frame& frame, double stops,
                    const ExrHeader& header, const ExrOptions& options);

}  // namespace nerf
