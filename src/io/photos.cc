#include "nerf/io/photos.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <mutex>
#include <span>

#include "cut_out.h"
#include "depth_file.h"
#include "half.h"
#include "image_decode.h"
#include "nerf/base/error.h"
#include "nerf/base/file.h"
#include "nerf/base/memory.h"
#include "nerf/io/image.h"
#include "orientation.h"
#include "photo_plan.h"
#include "photo_rows.h"
#include "resample.h"

namespace nerf {
namespace {

using internal::SampleType;
using internal::ShownPixels;
using internal::StoredImage;

constexpr float kLargestHalf = 65504.0f;

// Colour (grey three times) and alpha of pixels as they are shown, straight, as numbers.
class PixelReader {
 public:
  PixelReader(const StoredImage& image, const ShownPixels& shown, const std::string& name)
      : image_(image), shown_(shown), name_(name) {
    for (int i = 0; i < 256; ++i) by_byte_[i] = static_cast<float>(i) / 255.0f;
  }

  // Row y with 3 channels (of a picture without transparency) or 4, then premultiplied if
  // `premultiply`, else straight.
  void row(int y, int channels, bool premultiply, std::span<float> out) const {
    const bool grey = image_.channels < 3;
    const auto in = static_cast<size_t>(image_.channels);
    int64_t pixel = shown_.at(0, y);
    for (size_t o = 0; o < out.size(); o += static_cast<size_t>(channels), pixel += shown_.step_x) {
      const size_t at = static_cast<size_t>(pixel) * in;
      for (size_t c = 0; c < 3; ++c) out[o + c] = number(at + (grey ? 0 : c));
      if (channels == 3) continue;
      const float alpha = std::clamp(number(at + in - 1), 0.0f, 1.0f);
      out[o + 3] = alpha;
      if (premultiply == image_.premultiplied) continue;
      if (premultiply) {
        for (size_t c = 0; c < 3; ++c) out[o + c] *= alpha;
      } else {
        internal::unpremultiply(&out[o], alpha);
      }
    }
  }

 private:
  float number(size_t i) const {
    if (image_.type == SampleType::k8) return by_byte_[image_.samples8[i]];
    const float value = image_.sample(i);
    if (image_.type == SampleType::kHalf) {
      if (std::isnan(value)) fail(i);
      return std::clamp(value, -kLargestHalf, kLargestHalf);  // highlights may be infinite
    }
    return value;
  }

  [[noreturn]] void fail(size_t i) const {
    const size_t pixel = i / static_cast<size_t>(image_.channels);
    const auto width = static_cast<size_t>(image_.width);
    throw Error(
        fmt::format("the pixel at column {}, row {} is not a number", pixel % width, pixel / width),
        name_, "render the picture again, or replace such pixels");
  }

  const StoredImage& image_;
  const ShownPixels shown_;
  const std::string& name_;
  float by_byte_[256];
};

bool any_transparent(const StoredImage& image) {
  if (!image.has_alpha()) return false;
  const size_t count = std::max(image.samples8.size(), image.samples16.size());
  for (size_t i = static_cast<size_t>(image.channels) - 1; i < count;
       i += static_cast<size_t>(image.channels)) {
    if (image.type == SampleType::k8 ? image.samples8[i] != 255 : !(image.sample(i) >= 1)) {
      return true;
    }
  }
  return false;
}

// `image` is consumed: its memory becomes the photo's where nothing has to be changed.
void convert(StoredImage& image, int orientation, const std::string& name, Photo& photo) {
  // An alpha channel that is opaque everywhere says nothing.
  photo.channels = any_transparent(image) ? 4 : 3;
  const ShownPixels shown = internal::shown_pixels(orientation, image.width, image.height);
  const bool same_size = shown.width == photo.width && shown.height == photo.height;
  if (orientation == 1 && same_size && image.type == SampleType::k8 &&
      image.channels == photo.channels && !image.premultiplied) {
    photo.pixels8 = std::move(image.samples8);
    return;
  }
  const size_t count = static_cast<size_t>(photo.width) * static_cast<size_t>(photo.height) *
                       static_cast<size_t>(photo.channels);
  if (image.type == SampleType::k8) {
    photo.pixels8.resize(count);
  } else {
    photo.pixels16.resize(count);
  }
  const PixelReader reader(image, shown, name);
  if (same_size) {
    std::vector<float> row(static_cast<size_t>(photo.width) * static_cast<size_t>(photo.channels));
    for (int y = 0; y < photo.height; ++y) {
      reader.row(y, photo.channels, false, row);
      internal::store_row(photo, y, row);
    }
    return;
  }
  internal::area_average(
      shown.width, shown.height, photo.channels,
      [&](int y, std::span<float> out) { reader.row(y, photo.channels, true, out); }, photo.width,
      photo.height,
      [&](int y, std::span<const float> row) { internal::store_averaged_row(photo, y, row); });
}

// Of a photo of that size as it is shown. The mask of a photo that is turned may be stored like the
// photo or like the picture shown.
std::vector<uint8_t> read_mask(const View& view, int orientation, const ShownPixels& photo,
                               int width, int height) {
  const Image8 mask = read_image_8bit(view.mask_path);
  const std::string name = view.mask_path.string();
  const auto lies = [](double w, double h) { return w / h > 1.02 ? 1 : w / h < 1 / 1.02 ? -1 : 0; };
  const bool transposed = lies(mask.width, mask.height) * lies(photo.width, photo.height) < 0;
  if (transposed && orientation == 1) {
    throw Error(
        fmt::format("the mask is {} x {} pixels and its photo {} x {}: one of them is turned "
                    "by 90 degrees",
                    mask.width, mask.height, photo.width, photo.height),
        name, "store the mask as its photo is stored");
  }
  const ShownPixels shown =
      internal::shown_pixels(transposed ? orientation : 1, mask.width, mask.height);
  std::vector<uint8_t> values;
  values.reserve(static_cast<size_t>(mask.width) * static_cast<size_t>(mask.height));
  uint8_t largest = 0;
  for (int y = 0; y < shown.height; ++y) {
    for (int x = 0; x < shown.width; ++x) {
      values.push_back(mask.pixels[static_cast<size_t>(shown.at(x, y) * mask.channels)]);
      largest = std::max(largest, values.back());
    }
  }
  if (largest == 1) {
    throw Error("the mask has only the values 0 and 1, so nothing would be kept", name,
                "values of 128 and more keep a pixel: multiply the mask by 255");
  }
  values = internal::resize_nearest(values, shown.width, shown.height, width, height);
  for (uint8_t& value : values) value = value >= 128 ? 255 : 0;
  return values;
}

}  // namespace

void Photo::pixel(int x, int y, Real rgba[4]) const {
  const size_t at = (static_cast<size_t>(y) * static_cast<size_t>(width) + static_cast<size_t>(x)) *
                    static_cast<size_t>(channels);
  rgba[3] = 1;
  if (!pixels8.empty()) {
    for (int c = 0; c < channels; ++c) {
      rgba[c] = static_cast<Real>(pixels8[at + static_cast<size_t>(c)]) / 255.0_r;
    }
  } else {
    for (int c = 0; c < channels; ++c) {
      rgba[c] = internal::half_to_float(pixels16[at + static_cast<size_t>(c)]);
    }
  }
}

PhotoSet load_photos(const Scene& scene, ThreadPool& pool,
                     const std::function<void(int done, int total)>& progress) {
  const auto start = std::chrono::steady_clock::now();
  const int downscale = scene.options.downscale;
  if (downscale < 1) {
    throw Error(fmt::format("--downscale {} makes no sense", downscale), "",
                "give a whole number from 1");
  }
  const auto total = static_cast<int64_t>(scene.views.size());
  PhotoSet set;
  set.photos.resize(scene.views.size());
  set.cameras.resize(scene.views.size());

  // Headers first: what is wrong with sizes and memory shows before minutes of decoding.
  std::vector<ImageInfo> infos(scene.views.size());
  std::vector<int> orientation(scene.views.size());
  pool.parallel_for(total, [&](int64_t i) {
    infos[static_cast<size_t>(i)] = read_image_info(scene.views[static_cast<size_t>(i)].image_path);
  });
  internal::PhotoMemory memory;
  for (size_t i = 0; i < infos.size(); ++i) {
    const View& view = scene.views[i];
    if (downscale > std::min(infos[i].width, infos[i].height)) {
      throw Error(fmt::format("--downscale {} leaves nothing of {} x {} pixels", downscale,
                              infos[i].width, infos[i].height),
                  view.image_path.string(), "give a smaller number");
    }
    const Camera& camera = scene.cameras.at(static_cast<size_t>(view.camera));
    orientation[i] = internal::orientation_for(camera, infos[i]);
    const ShownPixels shown =
        internal::shown_pixels(orientation[i], infos[i].width, infos[i].height);
    Photo& photo = set.photos[i];
    photo.width = internal::downscaled(shown.width, downscale);
    photo.height = internal::downscaled(shown.height, downscale);
    set.cameras[i] = internal::camera_of_photo(camera, view, shown.width, shown.height, photo.width,
                                               photo.height);
    if (scene.cut_out) infos[i].channels = 4;
    internal::add_photo(memory, infos[i], !view.mask_path.empty(), downscale);
  }
  internal::check_photo_memory(memory, pool.size(), available_memory_bytes(), downscale,
                               scene.root.string());

  std::mutex progress_mutex;
  int done = 0;
  pool.parallel_for(total, [&](int64_t index) {
    const auto i = static_cast<size_t>(index);
    const View& view = scene.views[i];
    StoredImage stored = internal::decode_image(view.image_path);
    if (stored.width != infos[i].width || stored.height != infos[i].height) {
      throw Error("the image changed while it was read", view.image_path.string());
    }
    if (!view.mask_path.empty()) {
      set.photos[i].mask = read_mask(
          view, orientation[i], internal::shown_pixels(orientation[i], stored.width, stored.height),
          set.photos[i].width, set.photos[i].height);
    }
    if (!view.depth_path.empty()) {
      const ShownPixels shown = internal::shown_pixels(orientation[i], stored.width, stored.height);
      set.photos[i].depth = internal::read_depth_map(view, orientation[i], shown.width,
                                                     shown.height, scene.to_engine.scale);
    }
    if (scene.cut_out) internal::cut_out(stored, *scene.cut_out);
    convert(stored, orientation[i], view.image_path.string(), set.photos[i]);
    const std::lock_guard lock(progress_mutex);
    ++done;
    if (progress) progress(done, static_cast<int>(total));
  });

  uint64_t pixels = 0, masked = 0;
  for (const Photo& photo : set.photos) {
    pixels += static_cast<uint64_t>(photo.width) * static_cast<uint64_t>(photo.height);
    masked += static_cast<uint64_t>(std::count(photo.mask.begin(), photo.mask.end(), uint8_t{0}));
  }
  set.fraction_masked = pixels > 0 ? static_cast<double>(masked) / static_cast<double>(pixels) : 0;
  set.decode_seconds =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  return set;
}

}  // namespace nerf
