#include "train/lens_picture.h"

#include <algorithm>
#include <vector>

#include "io/photo_rows.h"

namespace nerf {

namespace {

// Not so dark that what it stands for cannot be told.
double gain_at(const Camera& camera, const Falloff& falloff, int x, int y) {
  constexpr double kDarkest = 1e-2;
  return std::max(kDarkest, falloff_gain(falloff, corner_square(camera, {x + 0.5, y + 0.5})));
}

}  // namespace

Photo without_falloff(const Photo& photo, const Camera& camera, const Falloff& falloff) {
  Photo out = photo;
  const size_t pixels = static_cast<size_t>(photo.width) * static_cast<size_t>(photo.height);
  const size_t channels = static_cast<size_t>(photo.channels);
  out.pixels8.clear();
  out.pixels16.assign(pixels * channels, 0);
  std::vector<float> row(static_cast<size_t>(photo.width) * channels);
  for (int y = 0; y < photo.height; ++y) {
    for (int x = 0; x < photo.width; ++x) {
      Real rgba[4];
      photo.pixel(x, y, rgba);
      dim(rgba, 1.0_r, {}, static_cast<Real>(1 / gain_at(camera, falloff, x, y)));
      std::copy_n(rgba, channels, row.begin() + static_cast<ptrdiff_t>(x) * photo.channels);
    }
    internal::store_row(out, y, row);
  }
  return out;
}

void add_falloff(const Camera& camera, const Falloff& falloff, const Vec3& background,
                 Frame& frame) {
  for (int y = 0; y < frame.height; ++y)
    for (int x = 0; x < frame.width; ++x) {
      const size_t at =
          static_cast<size_t>(y) * static_cast<size_t>(frame.width) + static_cast<size_t>(x);
      dim(frame.rgb.data() + 3 * at, frame.alpha[at], background,
          static_cast<Real>(gain_at(camera, falloff, x, y)));
    }
}

}  // namespace nerf
