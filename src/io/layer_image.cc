#include "nerf/io/layer_image.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>

#include "nerf/base/error.h"
#include "nerf/base/nearest_name.h"
#include "nerf/math/srgb.h"
#include "npy.h"

namespace nerf {

namespace {

struct Known {
  const char* name;
  LayerKind kind;
  std::vector<std::string> channels;
  Layers needs;
};

const std::vector<Known>& known_layers() {
  static const std::vector<Known> known = [] {
    const Layers none{}, moments{.moments = true}, percentiles{.percentiles = true},
        samples{.samples = true}, normal{.normal = true}, apart{.apart = true};
    const auto xyz = [](const std::string& name) {
      return std::vector<std::string>{name + ".X", name + ".Y", name + ".Z"};
    };
    const auto rgba = [](const std::string& name) {
      return std::vector<std::string>{name + ".R", name + ".G", name + ".B", name + ".A"};
    };
    return std::vector<Known>{
        {"depth.z", LayerKind::kLength, {"depth.Z"}, none},
        {"depth.distance", LayerKind::kLength, {"depth.distance.Z"}, none},
        {"depth.mean", LayerKind::kLength, {"depth.mean.Z"}, moments},
        {"depth.p05", LayerKind::kLength, {"depth.p05.Z"}, percentiles},
        {"depth.p95", LayerKind::kLength, {"depth.p95.Z"}, percentiles},
        {"opacity", LayerKind::kShare, {"opacity.Y"}, none},
        {"normal", LayerKind::kDirection, xyz("normal"), normal},
        {"normal_camera", LayerKind::kDirection, xyz("normal_camera"), normal},
        {"transmittance", LayerKind::kShare, {"transmittance.Y"}, none},
        {"samples", LayerKind::kCount, {"samples.Y"}, samples},
        {"variance", LayerKind::kLength, {"variance.Y"}, moments},
        {"object", LayerKind::kColour, rgba("object"), apart},
        {"field", LayerKind::kColour, rgba("field"), apart},
        {"shadow", LayerKind::kShare, {"shadow.R", "shadow.G", "shadow.B"}, apart}};
  }();
  return known;
}

const Known& known_layer(const std::string& name) {
  const auto found = std::ranges::find(known_layers(), name, &Known::name);
  NERF_CHECK(found != known_layers().end());
  return *found;
}

// Linear light times opacity of sRGB times opacity. Light was summed in sRGB, so that it is the
// colour of what is seen that is decoded, not its product with opacity.
double decoded(Real premultiplied, Real opacity, double factor) {
  if (!(opacity > 0)) return 0;
  const double alpha = opacity;
  return factor * alpha * srgb_to_linear(std::max(0.0, premultiplied / alpha));
}

std::vector<Real> colour_values(const Frame& frame, double factor) {
  std::vector<Real> out(4 * frame.alpha.size());
  for (size_t i = 0; i < frame.alpha.size(); ++i) {
    for (size_t k = 0; k < 3; ++k)
      out[4 * i + k] =
          static_cast<Real>(decoded(frame.layers.rgb[3 * i + k], frame.alpha[i], factor));
    out[4 * i + 3] = frame.alpha[i];
  }
  return out;
}

// The field without objects, in linear light.
std::vector<Real> field_values(const Frame& frame, double factor) {
  std::vector<Real> out = frame.layers.field;
  for (size_t i = 0; i < out.size(); i += 4)
    for (size_t k = 0; k < 3; ++k)
      out[i + k] = static_cast<Real>(decoded(out[i + k], out[i + 3], factor));
  return out;
}

// What the field is multiplied by. Where no object stands it is what makes the picture of the
// field, whatever rounding and the mean over a pixel's rays do.
std::vector<Real> shadow_values(const Frame& frame) {
  constexpr Real kDark = 1e-5_r;
  std::vector<Real> out = frame.layers.shadow;
  const std::vector<Real> all = colour_values(frame, 1), field = field_values(frame, 1);
  for (size_t i = 0; i < frame.alpha.size(); ++i)
    for (size_t k = 0; k < 3; ++k)
      if (frame.layers.cover[i] == 0 && field[4 * i + k] > kDark)
        out[3 * i + k] = all[4 * i + k] / field[4 * i + k];
  return out;
}

// What is added to the field times its shadow times what the object lets through: over it, the
// object gives the picture. Blending sums sRGB, so that no light of the object's own does.
std::vector<Real> object_values(const Frame& frame, double factor) {
  std::vector<Real> out = colour_values(frame, factor);
  const std::vector<Real> field = field_values(frame, factor), shadow = shadow_values(frame);
  for (size_t i = 0; i < frame.alpha.size(); ++i) {
    const Real cover = frame.layers.cover[i];
    for (size_t k = 0; k < 3; ++k)
      out[4 * i + k] -= (1 - cover) * field[4 * i + k] * shadow[3 * i + k];
    out[4 * i + 3] = cover;
  }
  return out;
}

std::vector<Real> values_of(const std::string& name, const Frame& frame, const Pose& pose,
                            double factor) {
  const PictureLayers& layers = frame.layers;
  if (name == "depth.z") return frame.depth_z;
  if (name == "depth.distance") return layers.distance;
  if (name == "depth.mean") return layers.mean;
  if (name == "depth.p05") return layers.near;
  if (name == "depth.p95") return layers.far;
  if (name == "opacity") return frame.alpha;
  if (name == "normal") return layers.normal;
  if (name == "normal_camera") return camera_normals(layers.normal, pose.rotation);
  if (name == "samples") return layers.samples;
  if (name == "variance") return layers.variance;
  if (name == "object") return object_values(frame, factor);
  if (name == "field") return field_values(frame, factor);
  if (name == "shadow") return shadow_values(frame);
  NERF_CHECK(name == "transmittance");
  std::vector<Real> out(frame.alpha.size());
  std::ranges::transform(frame.alpha, out.begin(), [](Real a) { return 1 - a; });
  return out;
}

uint16_t in_16_bits(double v) {
  return static_cast<uint16_t>(v > 0 ? std::min(std::round(v), 65535.0) : 0.0);
}

}  // namespace

const std::vector<std::string>& layer_names() {
  static const std::vector<std::string> names = [] {
    std::vector<std::string> all;
    for (const Known& known : known_layers()) all.emplace_back(known.name);
    return all;
  }();
  return names;
}

std::vector<std::string> parse_layers(const std::string& list, const std::string& where,
                                      bool inserted) {
  std::vector<bool> wanted(layer_names().size());
  size_t begin = 0;
  while (begin <= list.size()) {
    const size_t end = std::min(list.find(',', begin), list.size());
    std::string word = list.substr(begin, end - begin);
    std::erase(word, ' ');
    std::ranges::transform(word, word.begin(), [](unsigned char c) { return std::tolower(c); });
    bool found = false;
    for (size_t i = 0; i < wanted.size(); ++i)
      if (const std::string& name = layer_names()[i];
          word == "all" || word == name || name.starts_with(word + ".")) {
        const bool apart = known_layers()[i].needs.apart;
        if (apart && !inserted && word != "all")
          throw Error("the layer '" + name + "' is of pictures with an object in them", where,
                      "add --insert FILE.glb");
        wanted[i] = wanted[i] || !apart || inserted;
        found = true;
      }
    if (!found) {
      std::vector<std::string> known = layer_names();
      known.insert(known.begin(), {"all", "depth"});
      throw Error("'" + word + "' is no layer", where, nearest_name_hint(word, known));
    }
    begin = end + 1;
  }
  std::vector<std::string> names;
  for (size_t i = 0; i < wanted.size(); ++i)
    if (wanted[i]) names.push_back(layer_names()[i]);
  return names;
}

Layers layers_for(std::span<const std::string> names) {
  Layers all;
  for (const std::string& name : names) {
    const Layers& own = known_layer(name).needs;
    all.moments |= own.moments;
    all.percentiles |= own.percentiles;
    all.samples |= own.samples;
    all.normal |= own.normal;
    all.apart |= own.apart;
  }
  return all;
}

std::vector<Real> camera_normals(const std::vector<Real>& normals, const Mat3d& camera_to_world) {
  const Mat3d turn = camera_to_world.transposed();
  std::vector<Real> out(normals.size());
  for (size_t i = 0; i < normals.size(); i += 3) {
    const Vec3d n = turn * Vec3d{normals[i], normals[i + 1], normals[i + 2]};
    out[i] = static_cast<Real>(n.x);
    out[i + 1] = static_cast<Real>(-n.y);
    out[i + 2] = static_cast<Real>(-n.z);
  }
  return out;
}

LayerImage layer_image(const Frame& frame, std::span<const std::string> names,
                       const Pose& camera_to_world, double stops) {
  NERF_CHECK(!frame.layers.empty());
  LayerImage image{frame.width, frame.height, {}};
  const double factor = std::exp2(stops);
  image.layers.push_back(
      {"rgba", LayerKind::kColour, {"R", "G", "B", "A"}, colour_values(frame, factor)});
  for (const std::string& name : names) {
    const Known& known = known_layer(name);
    image.layers.push_back(
        {name, known.kind, known.channels, values_of(name, frame, camera_to_world, factor)});
    NERF_CHECK_EQ(image.layers.back().values.size(), frame.alpha.size() * known.channels.size());
  }
  return image;
}

std::vector<DeepPixelSample> deep_pixel(const Frame& frame, size_t pixel, double stops) {
  const std::vector<DeepSample>& samples = frame.layers.deep[pixel];
  const double factor = std::exp2(stops);
  double own[3] = {0, 0, 0}, wanted[3], weights = 0;
  std::vector<std::array<double, 3>> linear(samples.size());
  for (size_t i = 0; i < samples.size(); ++i) {
    weights += static_cast<double>(samples[i].weight);
    for (size_t k = 0; k < 3; ++k)
      own[k] += linear[i][k] = decoded(samples[i].rgb[k], samples[i].weight, factor);
  }
  const Real* const rgb = frame.layers.rgb.data() + 3 * pixel;
  for (size_t k = 0; k < 3; ++k) wanted[k] = decoded(rgb[k], frame.alpha[pixel], factor);
  std::vector<DeepPixelSample> out;
  double before = 0;  // weights of the samples in front
  for (size_t i = 0; i < samples.size(); ++i) {
    const double weight = samples[i].weight, left = 1 - before;
    before += weight;
    if (!(weight > 0) || !(left > 0)) continue;
    DeepPixelSample& s = out.emplace_back();
    s.z = static_cast<float>(samples[i].front);
    s.z_back = static_cast<float>(samples[i].back);
    for (size_t k = 0; k < 3; ++k) {
      const double share = own[k] > 0 ? linear[i][k] / own[k] : weight / weights;
      s.rgba[k] = static_cast<float>(share * wanted[k] / left);
    }
    s.rgba[3] = static_cast<float>(std::min(weight / left, 1.0));
  }
  return out;
}

Image16 layer_picture(const LayerImage& image, const ImageLayer& layer, double scale) {
  Image16 out{image.width, image.height, static_cast<int>(layer.channels.size()), {}};
  out.pixels.reserve(layer.values.size());
  for (size_t i = 0; i < layer.values.size(); ++i) {
    const double v = layer.values[i];
    switch (layer.kind) {
      case LayerKind::kColour: {
        const double alpha = layer.values[i / 4 * 4 + 3];
        const double straight = i % 4 == 3 ? v : alpha > 0 ? linear_to_srgb(v / alpha) : 0;
        out.pixels.push_back(in_16_bits(straight * 65535));
        break;
      }
      case LayerKind::kShare:
        out.pixels.push_back(in_16_bits(v * 65535));
        break;
      case LayerKind::kDirection:
        out.pixels.push_back(in_16_bits((v + 1) * 32767));
        break;
      case LayerKind::kLength:
      case LayerKind::kCount:
        out.pixels.push_back(in_16_bits(v * scale));
        break;
    }
  }
  return out;
}

void write_layer_npy(const std::filesystem::path& path, const LayerImage& image,
                     const ImageLayer& layer) {
  std::vector<size_t> shape{static_cast<size_t>(image.height), static_cast<size_t>(image.width)};
  if (layer.channels.size() > 1) shape.push_back(layer.channels.size());
  internal::write_npy(path, shape, layer.values);
}

}  // namespace nerf
