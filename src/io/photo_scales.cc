#include "nerf/io/photo_scales.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <span>
#include <vector>

#include "half.h"
#include "nerf/base/error.h"
#include "photo_plan.h"
#include "resample.h"

namespace nerf {
namespace {

// Numbers in the form that `like` holds them.
void store(const Photo& like, std::span<const float> values, size_t at, Photo& out) {
  for (size_t i = 0; i < values.size(); ++i) {
    if (like.pixels8.empty())
      out.pixels16[at + i] = internal::float_to_half(values[i]);
    else
      out.pixels8[at + i] = static_cast<uint8_t>(std::clamp(values[i], 0.0f, 1.0f) * 255.0f + 0.5f);
  }
}

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
  std::vector<float> straight;
  internal::area_average(
      photo.width, photo.height, photo.channels,
      [&](int y, std::span<float> row) {
        for (int x = 0; x < photo.width; ++x) {
          float rgba[4];
          photo.pixel(x, y, rgba);
          for (size_t c = 0; c < channels; ++c)
            row[static_cast<size_t>(x) * channels + c] = c < 3 ? rgba[c] * rgba[3] : rgba[3];
        }
      },
      width, height,
      [&](int y, std::span<const float> row) {
        straight.assign(row.begin(), row.end());
        for (size_t i = 0; channels == 4 && i < straight.size(); i += 4)
          for (size_t c = 0; c < 3; ++c)
            straight[i + c] = straight[i + 3] > 0 ? straight[i + c] / straight[i + 3] : 0;
        store(photo, straight, static_cast<size_t>(y) * straight.size(), out);
      });
  if (!photo.mask.empty()) out.mask = scaled_mask(photo, width, height);
  return out;
}

}  // namespace

void add_photo_scales(Scene& scene, PhotoSet& photos, int scales, ThreadPool& pool) {
  const auto begin = std::chrono::steady_clock::now();
  const size_t views = scene.views.size();
  const std::vector<int> train = scene.train, test = scene.test;
  for (int s = 1; s < scales; ++s) {
    const int scale = 1 << s;
    const int first = static_cast<int>(views) * s;
    for (const int v : train) scene.train.push_back(first + v);
    for (const int v : test) scene.test.push_back(first + v);
    for (size_t v = 0; v < views; ++v) {
      View view = scene.views[v];
      const Photo& photo = photos.photos[v];
      const int width = internal::downscaled(photo.width, scale);
      const int height = internal::downscaled(photo.height, scale);
      if (std::min(width, height) < kLeastScaledSide)
        throw Error(fmt::format("a photo of {} x {} pixels has no scale 1/{}: a side would be "
                                "below {} pixels",
                                photo.width, photo.height, scale, kLeastScaledSide),
                    view.image_path.string(), fmt::format("use --scales {} or less", s));
      view.scale = scale;
      view.name = fmt::format("scale{}/{}", scale, view.name);
      photos.cameras.push_back(internal::camera_of_photo(photos.cameras[v], view, photo.width,
                                                         photo.height, width, height));
      scene.views.push_back(std::move(view));
    }
  }
  photos.photos.resize(scene.views.size());
  pool.parallel_for(static_cast<int64_t>(scene.views.size() - views), [&](int64_t i) {
    const size_t at = views + static_cast<size_t>(i);
    const Camera& camera = photos.cameras[at];
    photos.photos[at] =
        scaled(photos.photos[static_cast<size_t>(i) % views], camera.width, camera.height);
  });
  photos.decode_seconds +=
      std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}

}  // namespace nerf
