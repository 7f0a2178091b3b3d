#include "photo_plan.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "nerf/base/error.h"
#include "orientation.h"

namespace nerf::internal {

bool same_shape(double w1, double h1, double w2, double h2) {
  return std::abs(w1 * h2 / w2 - h1) <= std::max(2.0, 0.02 * h1);
}

int orientation_for(const Camera& camera, const ImageInfo& info) {
  const int w = info.width, h = info.height;
  if (!info.lies_on_its_side() || camera.width < 1 || camera.height < 1) return 1;
  if (camera.width == w && camera.height == h) return 1;
  if (camera.width == h && camera.height == w) return info.orientation;
  const bool as_stored = same_shape(w, h, camera.width, camera.height);
  return !as_stored && same_shape(h, w, camera.width, camera.height) ? info.orientation : 1;
}

int downscaled(int size, int downscale) {
  return static_cast<int>(
      std::max<int64_t>(1, (2 * int64_t{size} + downscale) / (2 * int64_t{downscale})));
}

Camera camera_of_photo(const Camera& camera, const View& view, int width, int height, int new_width,
                       int new_height) {
  const auto says = [&] {
    return fmt::format("the photo is {} x {} pixels and its camera {} x {}", width, height,
                       camera.width, camera.height);
  };
  if (camera.width < 1 || camera.height < 1) throw Error(says(), view.image_path.string());
  if (!same_shape(width, height, camera.width, camera.height)) {
    if (same_shape(height, width, camera.width, camera.height)) {
      throw Error(
          says() + ": one of them is turned by 90 degrees", view.image_path.string(),
          "the photo has no EXIF orientation that says so: store it as the model saw it, or "
          "run COLMAP on it as it is stored");
    }
    throw Error(says() + ": it was cropped or belongs to another model", view.image_path.string(),
                "photos may be resized after COLMAP, but keep their shape");
  }
  if (camera.width == new_width && camera.height == new_height) return camera;
  return camera.scaled_to(new_width, new_height);
}

void add_photo(PhotoMemory& memory, const ImageInfo& info, bool mask, int downscale) {
  const uint64_t bytes = info.half_or_16bit ? 2 : 1;
  const uint64_t w = static_cast<uint64_t>(info.width), h = static_cast<uint64_t>(info.height);
  const uint64_t channels = info.channels % 2 == 0 ? 4 : 3;
  const uint64_t new_pixels = static_cast<uint64_t>(downscaled(info.width, downscale)) *
                              static_cast<uint64_t>(downscaled(info.height, downscale));
  memory.kept += new_pixels * (channels * bytes + (mask ? 1 : 0));
  memory.largest = std::max(
      memory.largest, w * h * std::max<uint64_t>(static_cast<uint64_t>(info.channels) * bytes, 1));
}

void check_photo_memory(const PhotoMemory& memory, int threads, uint64_t limit, int downscale,
                        const std::string& where) {
  const uint64_t scratch = memory.largest * static_cast<uint64_t>(std::max(1, threads));
  if (memory.kept + scratch <= limit) return;
  const auto megabytes = [](uint64_t bytes) { return (bytes + (1u << 20) - 1) >> 20; };
  std::string hint;
  if (scratch < limit) {
    // The photos shrink with the square of the factor.
    const double shrink =
        std::sqrt(static_cast<double>(memory.kept) / static_cast<double>(limit - scratch));
    const double factor = std::ceil(std::max(downscale * shrink, downscale + 1.0));
    hint =
        fmt::format("use --downscale {:.0f}, or a machine or container with more memory", factor);
  } else {
    hint = "use smaller photos, fewer --threads, or a machine or container with more memory";
  }
  throw Error(
      fmt::format("the photos need {} MB and their decoding {} MB, but this process may use "
                  "{} MB",
                  megabytes(memory.kept), megabytes(scratch), megabytes(limit)),
      where, hint);
}

}  // namespace nerf::internal
