#include "looks.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "nerf/base/error.h"
#include "nerf/io/layer_image.h"

namespace nerf::apps {
namespace {

// Copies columns [from, to) of a picture to those from `at` on.
void copy_columns(const Image8& picture, int from, int to, int at, Image8& out) {
  for (int y = 0; y < picture.height; ++y)
    std::copy_n(picture.pixels.data() + 3 * (static_cast<size_t>(y) * picture.width + from),
                3 * static_cast<size_t>(to - from),
                out.pixels.data() + 3 * (static_cast<size_t>(y) * out.width + at));
}

}  // namespace

Image8 depth_picture(const LookOptions& look, const Frame& frame, const Pose& camera_to_world,
                     const DepthRange& range) {
  if (look.depth_map != DepthLook::kNormal)
    return depth_image(frame.width, frame.height, frame.depth_z, frame.alpha, range,
                       look.depth_map);
  return normal_image(frame.width, frame.height,
                      camera_normals(frame.layers.normal, camera_to_world.rotation), frame.alpha);
}

Image8 film_picture(FilmKind film, const Image8& colour, const Image8& depth, double position) {
  if (film == FilmKind::kColour) return colour;
  if (film == FilmKind::kDepth) return depth;
  NERF_CHECK(colour.width == depth.width && colour.height == depth.height);
  const bool side = film == FilmKind::kSide;
  const int width = colour.width;
  Image8 out{side ? 2 * width : width, colour.height, 3, {}};
  out.pixels.resize(3 * static_cast<size_t>(out.width) * static_cast<size_t>(out.height));
  if (side) {
    copy_columns(colour, 0, width, 0, out);
    copy_columns(depth, 0, width, width, out);
    return out;
  }
  // All colour at both ends of the film, all depth in its middle.
  const double share = 0.5 + 0.5 * std::cos(2 * std::numbers::pi * position);
  const int border = std::clamp(static_cast<int>(std::lround(share * width)), 0, width);
  copy_columns(colour, 0, border, 0, out);
  copy_columns(depth, border, width, border, out);
  if (border == 0 || border == width) return out;
  for (int y = 0; y < out.height; ++y)
    std::fill_n(out.pixels.begin() + 3 * (static_cast<ptrdiff_t>(y) * width + border), 3, 255);
  return out;
}

std::array<const char*, 2> ends_of(DepthLook map) {
  if (map == DepthLook::kTurbo) return {"red", "blue"};
  if (map == DepthLook::kViridis) return {"yellow", "violet"};
  return {"white", "black"};
}

}  // namespace nerf::apps
