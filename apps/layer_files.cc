#include "layer_files.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "app.h"
#include "nerf/base/error.h"
#include "nerf/base/file.h"
#include "nerf/base/nearest_name.h"
#include "nerf/io/layer_image.h"
#include "render_plan.h"

namespace nerf::apps {
namespace {

namespace fs = std::filesystem;

std::vector<std::string> parse_formats(const std::string& list) {
  const std::vector<std::string> known{"exr", "png16", "npy"};
  std::vector<std::string> formats;
  for (size_t begin = 0; begin <= list.size();) {
    const size_t end = std::min(list.find(',', begin), list.size());
    const std::string word = list.substr(begin, end - begin);
    if (std::ranges::find(known, word) == known.end())
      throw Error("'" + word + "' is no format of layers", "--aov-format",
                  nearest_name_hint(word, known));
    formats.push_back(word);
    begin = end + 1;
  }
  return formats;
}

// Cameras stand a few engine units from what they see: 16 bits hold eight of them, and a power of
// ten is easily undone.
double lengths_per_unit(const ModelInfo& info) {
  return std::pow(10.0, std::floor(std::log10(65535 * info.to_engine.scale / 8)));
}

std::string name_of(PictureKind picture) {
  return std::get<std::string>(OptionTraits<PictureKind>::to_value(picture));
}

// DIR/format/layer/view.extension, with the folders made.
fs::path file_of(const fs::path& folder, const PlannedFrame& planned, const char* extension) {
  fs::path file = folder / planned.color;
  file.replace_extension(extension);
  make_writable_folder(file.parent_path());
  return file;
}

}  // namespace

void LayerOptions::check_options(bool inserted) const {
  parse_formats(aov_format);
  if (!aov.empty()) parse_layers(aov, "--aov", inserted);
}

LayerFiles::LayerFiles(const LayerOptions& options, bool inserted, double stops,
                       const ModelInfo& info)
    : options_(options), stops_(stops), per_unit_(lengths_per_unit(info)) {
  if (!options.aov.empty()) {
    names_ = parse_layers(options.aov, "--aov", inserted);
    const auto formats = parse_formats(options.aov_format);
    const auto has = [&](const char* f) { return std::ranges::find(formats, f) != formats.end(); };
    exr_ = has("exr");
    png16_ = has("png16");
    npy_ = has("npy");
  }
  layers_ = layers_for(names_);
  layers_.deep = options.deep;
  wanted_ = !options.aov.empty() || options.deep;
}

void LayerFiles::begin(const fs::path& out) const {
  if (exr_) make_writable_folder(out / "exr");
  if (options_.deep) make_writable_folder(out / "deep");
  if (png16_) make_writable_folder(out / "png16");
  if (npy_) make_writable_folder(out / "npy");
  if (!png16_ && !npy_) return;
  nlohmann::ordered_json about;
  about["layers"] = names_;
  about["unit"] = "that of the capture the model was trained on; 0 where there is no surface";
  about["npy"]["rgba"] = "linear light times opacity, before any background";
  about["png16"]["rgba"] = "sRGB, straight opacity";
  about["png16"]["lengths_per_unit"] = per_unit_;
  about["png16"]["variance_per_square_unit"] = per_unit_;
  about["png16"]["directions"] = "value / 32767 - 1";
  about["png16"]["shares"] = "value / 65535";
  write_file_atomically(out / "layers.json", about.dump(2) + "\n");
}

void LayerFiles::write(const fs::path& out, const RenderPlan& plan, const PlannedFrame& planned,
                       const Frame& frame) const {
  ExrHeader header;
  header.camera = planned.camera;
  header.camera_to_world = planned.camera_to_world;
  header.single_eye = !planned.right;
  header.texts = {{"software", version_text("nerf_render")},
                  {"nerf/view", planned.name},
                  {"nerf/picture", name_of(plan.picture)},
                  {"nerf/time", fmt::format("{}", planned.time)},
                  {"nerf/exposure", fmt::format("{} stops", stops_)}};
  if (options_.metres)
    header.texts.emplace_back("nerf/metresPerUnit", fmt::format("{}", *options_.metres));
  const ExrOptions exr{options_.exr_type, options_.exr_tiles};
  if (options_.deep)
    write_deep_exr(file_of(out / "deep", planned, ".exr"), frame, stops_, header, exr);
  if (!exr_ && !png16_ && !npy_) return;
  const LayerImage image = layer_image(frame, names_, planned.camera_to_world, stops_);
  for (const ImageLayer& layer : image.layers) {
    if (npy_) write_layer_npy(file_of(out / "npy" / layer.name, planned, ".npy"), image, layer);
    if (png16_)
      write_image(file_of(out / "png16" / layer.name, planned, ".png"),
                  layer_picture(image, layer, layer.kind == LayerKind::kCount ? 1 : per_unit_));
  }
  if (exr_) write_exr(file_of(out / "exr", planned, ".exr"), image, header, exr);
}

}  // namespace nerf::apps
