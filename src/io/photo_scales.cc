#include "nerf/io/photo_scales.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <chrono>
#include <span>
#include <vector>

#include "nerf/base/error.h"
#include "photo_plan.h"
#include "photo_rows.h"
#include "resample.h"

namespace nerf {
namespace {

std::vector<uint8_t> scaled_mask(const Photo& photo, int width, int height) {
  std::vector<uint8_t> mask(static_cast<size_t>(width) * static_cast<size_t>(height));
  size_t at = 0;
  internal::area_average(
      photo.width, photo.height, 1,
      [&](int y, std::span<float> row) {
        for (int x = 0; x < photo.width; ++x)
          row[static_cast<size_t>(x)] = photo.masked_out(x, y) ? 0.0f : 1.0f;
      },
      width, height,
      [&](int, std::span<const float> row) {
        for (const float kept : row) mask[at++] = kept < 0.5f ? 0 : 255;
      });
  return mask;
}

Photo scaled(const Photo& photo, int width, int height) {
  Photo out;
  out.width = width;
  out.height = height;
  out.channels = photo.channels;
  const size_t channels = static_cast<size_t>(photo.channels);
  const size_t count = static_cast<size_t>(width) * static_cast<size_t>(height) * channels;
  photo.pixels8.empty() ? out.pixels16.resize(count) : out.pixels8.resize(count);
  internal::area_average(
      photo.width, photo.height, photo.channels,
      [&](int y, std::span<float> row) {
        for (int x = 0; x < photo.width; ++x) {
          Real rgba[4];
          photo.pixel(x, y, rgba);
          for (size_t c = 0; c < channels; ++c)
            row[static_cast<size_t>(x) * channels + c] = c < 3 ? rgba[c] * rgba[3] : rgba[3];
        }
      },
      width, height,
      [&](int y, std::span<const float> row) { internal::store_averaged_row(out, y, row); });
  if (!photo.mask.empty()) out.mask = scaled_mask(photo, width, height);
  return out;
}

}  // namespace

PhotoSet reduced_photos(const Scene& scene, const PhotoSet& photos, int longest_side,
                        ThreadPool& pool) {
  PhotoSet out;
  out.photos.resize(photos.photos.size());
  out.cameras = photos.cameras;
  pool.parallel_for(static_cast<int64_t>(scene.train.size()), [&](int64_t i) {
    const size_t v = static_cast<size_t>(scene.train[static_cast<size_t>(i)]);
    const Photo& photo = photos.photos[v];
    const int longest = std::max(photo.width, photo.height);
    const int divide = std::max(1, (longest + longest_side - 1) / longest_side);
    const int width = internal::downscaled(photo.width, divide);
    const int height = internal::downscaled(photo.height, divide);
    out.cameras[v] = internal::camera_of_photo(photos.cameras[v], scene.views[v], photo.width,
                                               photo.height, width, height);
    out.photos[v] = scaled(photo, width, height);
  });
  return out;
}

void add_photo_scales(Scene& scene, PhotoSet& photos, int scales, bool training, ThreadPool& pool) {
  const auto begin = std::chrono::steady_clock::now();
  const size_t full_views = scene.views.size();
  std::vector<size_t> from;  // of each view added, the view that it is a smaller photo of
  const auto add = [&](int v, int scale, std::vector<int>& split) {
    View view = scene.views[static_cast<size_t>(v)];
    const Photo& photo = photos.photos[static_cast<size_t>(v)];
    const int width = internal::downscaled(photo.width, scale);
    const int height = internal::downscaled(photo.height, scale);
    if (std::min(width, height) < kLeastScaledSide)
      throw Error(
          fmt::format("a photo of {} x {} pixels has no scale 1/{}: a side would be below "
                      "{} pixels",
                      photo.width, photo.height, scale, kLeastScaledSide),
          view.image_path.string(),
          fmt::format("use --scales {} or less", std::bit_width(static_cast<unsigned>(scale)) - 1));
    view.scale = scale;
    view.name = fmt::format("scale{}/{}", scale, view.name);
    photos.cameras.push_back(internal::camera_of_photo(photos.cameras[static_cast<size_t>(v)], view,
                                                       photo.width, photo.height, width, height));
    split.push_back(static_cast<int>(scene.views.size()));
    scene.views.push_back(std::move(view));
    from.push_back(static_cast<size_t>(v));
  };
  const std::vector<int> train = training ? scene.train : std::vector<int>(), test = scene.test;
  for (int s = 1; s < scales; ++s) {
    for (const int v : train) add(v, 1 << s, scene.train);
    for (const int v : test) add(v, 1 << s, scene.test);
  }
  photos.photos.resize(scene.views.size());
  pool.parallel_for(static_cast<int64_t>(from.size()), [&](int64_t i) {
    const size_t at = full_views + static_cast<size_t>(i);
    const Camera& camera = photos.cameras[at];
    photos.photos[at] =
        scaled(photos.photos[from[static_cast<size_t>(i)]], camera.width, camera.height);
  });
  photos.decode_seconds +=
      std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}

}  // namespace nerf
