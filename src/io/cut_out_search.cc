// Whether photos have a background that was cut out to one colour.
#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdlib>

#include "cut_out.h"
#include "nerf/base/error.h"
#include "paths.h"
#include "photo_plan.h"
#include "scene_input.h"

namespace nerf {
namespace {

std::optional<CutOut> parse(std::string_view text) {
  CutOut out;
  if (text == "auto") return out;
  out.mode = CutOut::Mode::kOff;
  if (text == "off") return out;
  out.mode = CutOut::Mode::kColour;
  const char *at = text.data(), *const end = at + text.size();
  for (size_t c = 0; c < 3; ++c) {
    if (c > 0 && (at == end || *at++ != ',')) return std::nullopt;
    const auto [stop, error] = std::from_chars(at, end, out.colour[c]);
    if (error != std::errc()) return std::nullopt;
    at = stop;
  }
  return at == end ? std::optional(out) : std::nullopt;
}

std::string colour_text(const Rgb8& c) { return fmt::format("{},{},{}", c[0], c[1], c[2]); }

}  // namespace

void OptionTraits<CutOut>::describe(OptionField& field) {
  field.metavar = "auto|off|R,G,B";
  field.problem = [](const OptionValue& value) -> std::string {
    return parse(std::get<std::string>(value))
               ? ""
               : "must be auto, off, or three whole numbers from 0 to 255 with commas between";
  };
}

OptionValue OptionTraits<CutOut>::to_value(const CutOut& cut_out) {
  switch (cut_out.mode) {
    case CutOut::Mode::kAuto:
      return std::string("auto");
    case CutOut::Mode::kOff:
      return std::string("off");
    case CutOut::Mode::kColour:
      break;
  }
  return colour_text(cut_out.colour);
}

CutOut OptionTraits<CutOut>::from_value(const OptionValue& value) {
  return parse(std::get<std::string>(value)).value_or(CutOut());
}

namespace internal {
namespace {

// What is asked of a border: flat, but for what compression does to it, on three sides at least.
// Walls, skies and sheets of paper have shades and noise.
constexpr int kFlat = 3;            // levels of 255
constexpr double kFlatShare = 0.8;  // of a side's pixels
constexpr double kFlatMean = 1;     // levels, of those pixels
constexpr int kBorder = 2;          // pixels deep
constexpr size_t kLooks = 12;       // photos
constexpr size_t kOthers = 1;       // of them, may have another border
// Of a photo's pixels: what the background has at least, and what it leaves.
constexpr double kLeastBackground = 0.05, kLeastMatter = 0.001;
// Of its pixels, in the mean: as little as outlines differ where all photos have the same frame.
constexpr double kSameFrame = 0.005;

// Medians of the channels over the border.
Rgb8 border_colour(const StoredImage& image) {
  std::array<std::array<size_t, 256>, 3> counts{};
  size_t pixels = 0;
  const size_t in = static_cast<size_t>(image.channels);
  for (int y = 0; y < image.height; ++y)
    for (int x = 0; x < image.width; ++x) {
      if (x == kBorder && y >= kBorder && y < image.height - kBorder)
        x = std::max(x, image.width - kBorder);
      const size_t at =
          (static_cast<size_t>(y) * static_cast<size_t>(image.width) + static_cast<size_t>(x)) * in;
      for (size_t c = 0; c < 3; ++c) ++counts[c][image.samples8[at + (in < 3 ? 0 : c)]];
      ++pixels;
    }
  Rgb8 colour{};
  for (size_t c = 0; c < 3; ++c) {
    size_t below = 0;
    for (size_t level = 0; below + counts[c][level] <= pixels / 2; ++level) {
      below += counts[c][level];
      colour[c] = static_cast<uint8_t>(level + 1);
    }
  }
  return colour;
}

bool has_flat_border(const StoredImage& image, const Rgb8& colour) {
  const size_t in = static_cast<size_t>(image.channels);
  const int w = image.width, h = image.height;
  if (std::min(w, h) <= 2 * kBorder) return false;
  const auto is_flat = [&](int x0, int y0, int x1, int y1) {
    int flat = 0;
    double off = 0;
    for (int y = y0; y < y1; ++y)
      for (int x = x0; x < x1; ++x) {
        const size_t at =
            (static_cast<size_t>(y) * static_cast<size_t>(w) + static_cast<size_t>(x)) * in;
        int most = 0;
        for (size_t c = 0; c < 3; ++c)
          most = std::max(most, std::abs(image.samples8[at + (in < 3 ? 0 : c)] - colour[c]));
        if (most > kFlat) continue;
        ++flat;
        off += most;
      }
    return flat >= kFlatShare * (x1 - x0) * (y1 - y0) && off <= kFlatMean * flat;
  };
  return is_flat(0, 0, w, kBorder) + is_flat(0, h - kBorder, w, h) + is_flat(0, 0, kBorder, h) +
             is_flat(w - kBorder, 0, w, h) >=
         3;
}

struct Outline {
  int width, height;
  std::vector<uint8_t> background;
};

// Share of pixels; 1 where the photos are of different shapes.
double difference(const Outline& a, const Outline& b) {
  if (a.width != b.width || a.height != b.height) return 1;
  size_t count = 0;
  for (size_t i = 0; i < a.background.size(); ++i) count += a.background[i] != b.background[i];
  return static_cast<double>(count) / static_cast<double>(a.background.size());
}

double share_of_background(const Outline& o) {
  return static_cast<double>(std::count(o.background.begin(), o.background.end(), 1)) /
         static_cast<double>(o.background.size());
}

// No value for one that cannot be decoded: load_photos says what is wrong with it.
std::optional<StoredImage> decoded(const std::filesystem::path& photo) {
  try {
    StoredImage image = decode_image(photo);
    if (image.type == SampleType::k8) return image;
  } catch (const Error&) {
  }
  return std::nullopt;
}

}  // namespace

CutOutSearch find_cut_out(std::span<const std::filesystem::path> photos) {
  CutOutSearch result;
  const size_t looks = std::min(kLooks, photos.size());
  std::vector<Outline> outlines;
  std::optional<Rgb8> colour;
  for (size_t i = 0, others = 0; i < looks; ++i) {
    const auto image = decoded(photos[i * (photos.size() - 1) / std::max<size_t>(looks - 1, 1)]);
    ++result.looked;
    if (image && !colour) {
      const Rgb8 own = border_colour(*image);
      if (has_flat_border(*image, own)) colour = own;
    }
    if (image && colour && has_flat_border(*image, *colour)) {
      Outline outline{image->width, image->height, background_of(*image, *colour)};
      const double share = share_of_background(outline);
      if (share >= kLeastBackground && share <= 1 - kLeastMatter) {
        outlines.push_back(std::move(outline));
        continue;
      }
    }
    if (++others > kOthers) return result;
  }
  if (outlines.size() < 2) return result;
  double differ = 0;
  for (size_t i = 1; i < outlines.size(); ++i) differ += difference(outlines[i - 1], outlines[i]);
  result.colour = colour;
  result.is_frame = differ < kSameFrame * static_cast<double>(outlines.size() - 1);
  return result;
}

std::optional<Rgb8> resolve_cut_out(const SceneInput& input, const CutOut& option, bool alpha,
                                    int downscale, SceneReport& report) {
  if (alpha || option.mode == CutOut::Mode::kOff) return std::nullopt;
  std::optional<Rgb8> colour;
  if (option.mode == CutOut::Mode::kColour) {
    colour = option.colour;
    report.cut_out = fmt::format("background of {}, as given", colour_text(*colour));
  } else {
    std::vector<std::filesystem::path> photos;
    for (const View& view : input.views) photos.push_back(view.image_path);
    const CutOutSearch search = find_cut_out(photos);
    if (!search.colour) return std::nullopt;
    const std::string text = colour_text(*search.colour);
    if (search.is_frame) {
      report.warnings.push_back(fmt::format(
          "all photos have the same frame of the colour {0}: it is taken for a part of the scene; "
          "masks leave it out, --cut-out {0} makes it transparent",
          text));
      return std::nullopt;
    }
    colour = search.colour;
    report.cut_out = fmt::format(
        "background of {}, found at the border of {} photos: counts as transparent (--cut-out off: "
        "as matter)",
        text, search.looked);
  }
  for (const View& view : input.views) {
    const Camera& camera = input.cameras[static_cast<size_t>(view.camera)];
    report.memory_estimate_bytes += static_cast<uint64_t>(downscaled(camera.width, downscale)) *
                                    static_cast<uint64_t>(downscaled(camera.height, downscale));
  }
  return colour;
}

}  // namespace internal
}  // namespace nerf
