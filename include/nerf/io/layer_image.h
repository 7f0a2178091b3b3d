// A picture's layers under the names that compositing programs know, as numbers that files hold:
// colour in linear light, lengths in input units.
#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "nerf/base/real.h"
#include "nerf/io/image.h"
#include "nerf/math/vec.h"
#include "nerf/model/layers.h"
#include "nerf/model/renderer.h"

namespace nerf {

// How a layer's numbers are stored where a file has less than float32 for them.
enum class LayerKind {
  kColour,     // linear light, times opacity, and opacity
  kShare,      // [0, 1]
  kLength,     // input units (a variance: squared), 0 where there is none
  kDirection,  // unit vectors, 0 where there is none
  kCount,
};

struct ImageLayer {
  std::string name;  // "depth.z"; of the colour "rgba"
  LayerKind kind = LayerKind::kShare;
  // Of the OpenEXR file: layer and one letter, since Blender 3 reads no others ("depth.Z",
  // "depth.p05.Z", "normal.X", "opacity.Y"); the colour's are R, G, B and A alone.
  std::vector<std::string> channels;
  std::vector<Real> values;  // [height][width][channels]
};

struct LayerImage {
  int width = 0, height = 0;
  std::vector<ImageLayer> layers;  // the colour first
};

// All layers but the colour, in their order: depth.z, depth.distance (median), depth.mean,
// depth.p05, depth.p95, opacity, normal (input coordinates), normal_camera (x right, y up, z
// towards the camera), transmittance, samples, variance; and of pictures with inserted objects
// these apart: object (linear light times the share of all light that its surfaces take, and that
// share), field (the colour without it) and shadow (share of the field's light that is left):
//   colour = object + (1 - object.A) field shadow
const std::vector<std::string>& layer_names();

// Layers of a list with commas: names, "all", or "depth" for all that begin with it; upper and
// lower case alike, each once, in layer_names()'s order. Throws Error, at `where`, for others.
// inserted: whether objects stand in the picture; else "all" leaves out what is theirs, and their
// names are an error.
std::vector<std::string> parse_layers(const std::string& list, const std::string& where,
                                      bool inserted = false);

// What a picture must be drawn with.
Layers layers_for(std::span<const std::string> names);

// The colour and the named layers of a frame that was drawn with layers_for(names).
// camera_to_world: its rotation leads from camera to input axes. Linear light is multiplied by
// 2^stops.
LayerImage layer_image(const Frame& frame, std::span<const std::string> names,
                       const Pose& camera_to_world, double stops);

// Normals [n][3] of input axes in those of compositing programs' cameras: x right, y up, z towards
// the camera.
std::vector<Real> camera_normals(const std::vector<Real>& normals, const Mat3d& camera_to_world);

// The deep samples of a pixel as files hold them.
struct DeepPixelSample {
  float z, z_back;  // input units
  float rgba[4];    // linear light times opacity, and opacity, of this stretch alone
};

// Of a frame drawn with Layers::deep. One sample over the other they give the pixel's colour of
// layer_image(): each has its own linear light, times what makes their sum that of the picture,
// whose light was summed in sRGB.
std::vector<DeepPixelSample> deep_pixel(const Frame& frame, size_t pixel, double stops);

// 16 bits a channel: colour as sRGB with straight opacity, shares from 0 to 65535, directions from
// -1 (0) to 1 (65534), lengths and counts times `scale`, cut off at 65535.
Image16 layer_picture(const LayerImage& image, const ImageLayer& layer, double scale);

// A .npy file of float32, [height][width] or [height][width][channels], as the layer's values are.
// Whole or not at all; throws Error.
void write_layer_npy(const std::filesystem::path& path, const LayerImage& image,
                     const ImageLayer& layer);

}  // namespace nerf
