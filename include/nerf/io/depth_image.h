// Depth and normals as pictures for people.
#pragma once

#include <array>
#include <span>

#include "nerf/base/options.h"
#include "nerf/base/real.h"
#include "nerf/io/image.h"
#include "nerf/math/vec.h"

namespace nerf {

// sRGB in [0, 1] of the "turbo" colour map at x in [0, 1] (clamped; not a number counts as 0): dark
// blue over green and yellow to dark red. Straight lines between 18 entries of its author's table
// (A. Mikhailov, "Turbo, an improved rainbow colormap for visualization", 2019), within 0.03 of it.
Vec3 turbo_color(Real x);

// Likewise "viridis" (S. van der Walt and N. Smith, 2015), which grows evenly brighter, to eyes
// that see fewer colours too: dark violet over green to yellow. Within 0.01 of its table.
Vec3 viridis_color(Real x);

// What a picture of depth shows: the inverse of depth between both ends of a range in the colours
// of a map, far to near; the same in grey; or what way surfaces face.
enum class DepthLook { kTurbo, kViridis, kDisparity, kNormal };
inline auto option_names(DepthLook) {
  return std::array{
      OptionName{DepthLook::kTurbo, "turbo"}, OptionName{DepthLook::kViridis, "viridis"},
      OptionName{DepthLook::kDisparity, "disparity"}, OptionName{DepthLook::kNormal, "normal"}};
}

// sRGB of the map (of depth) at x in [0, 1], clamped.
Vec3 depth_color(DepthLook map, Real x);

// What the two ends of the colour map stand for, in the depth's unit. near <= far.
struct DepthRange {
  double near = 0, far = 0;
  bool empty() const { return !(far > 0); }
};

// Depths below which the fractions `low` and `high` of all pixels' opacity lie (quantiles weighted
// by alpha). Pixels without depth (not above 0, not finite) or alpha do not count; an image without
// any gives an empty range. Spans of equal length.
DepthRange depth_range(std::span<const Real> depth, std::span<const Real> alpha, double low = 0.02,
                       double high = 0.98);

// The range that covers a set of ranges; empty ones do not count.
DepthRange merged(std::span<const DepthRange> ranges);

// The picture, 3 channels: the map at the inverse depth between 1 / far (0) and 1 / near (1), so
// that unbounded scenes keep their foreground apart, laid over black by alpha. Depth and alpha row
// by row from the top, width * height values each. Pixels without depth, and all of an empty range,
// are black.
Image8 depth_image(int width, int height, std::span<const Real> depth, std::span<const Real> alpha,
                   const DepthRange& range, DepthLook map = DepthLook::kTurbo);

// Unit normals [n][3] in camera axes (x right, y up, z towards the camera) as colours from 0 (-1)
// to 255 (1), laid over black by alpha; black where there is none.
Image8 normal_image(int width, int height, std::span<const Real> normals,
                    std::span<const Real> alpha);

}  // namespace nerf
