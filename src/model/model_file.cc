// docs/model_file.md describes the file.
#include "model/model_file.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "base/half.h"
#include "model/model_info_json.h"
#include "nerf/base/file.h"
#include "nerf/model/grid_field.h"
#include "nerf/model/network_field.h"
#include "nerf/model/options_json.h"

namespace nerf {
namespace internal {
namespace {

using Json = nlohmann::ordered_json;

Json corner_to_json(const Vec3d& v) { return {v.x, v.y, v.z}; }

Box3 clip_from(const JsonFields& header) {
  const JsonFields f = header.object("clip");
  const auto low = f.numbers("min", 3), high = f.numbers("max", 3);
  return {{low[0], low[1], low[2]}, {high[0], high[1], high[2]}};
}

Json ndc_to_json(const NdcFrame& frame) {
  return {{"rotation", rotation_to_json(frame.reference.rotation)},
          {"centre", corner_to_json(frame.reference.translation)},
          {"scale", {frame.scale_x, frame.scale_y}},
          {"near", frame.near}};
}

NdcFrame ndc_from(const JsonFields& f) {
  NdcFrame frame;
  frame.reference.rotation = rotation_from(f, "rotation");
  const auto centre = f.numbers("centre", 3), scale = f.numbers("scale", 2);
  frame.reference.translation = {centre[0], centre[1], centre[2]};
  frame.scale_x = scale[0];
  frame.scale_y = scale[1];
  frame.near = f.number("near");
  if (!(frame.scale_x > 0 && frame.scale_y > 0)) f.fail("must be above 0", "scale");
  if (!(frame.near > 0)) f.fail("must be above 0", "near");
  return frame;
}

// Of a table in the file, whatever the training had. Half floats take half the room, and rounding
// to them costs less than 0.01 dB (tests/train measures it).
constexpr int kTableBits = 16;

std::vector<uint16_t> to_half(std::span<const Real> values) {
  std::vector<uint16_t> out(values.size());
  for (size_t i = 0; i < out.size(); ++i) out[i] = float_to_half(static_cast<float>(values[i]));
  return out;
}

// Networks are stored in 32 bits, whatever the field computes in.
std::vector<float> to_single(std::span<const Real> values) {
  std::vector<float> out(values.size());
  std::transform(values.begin(), values.end(), out.begin(),
                 [](Real x) { return static_cast<float>(x); });
  return out;
}

void read_weights(const ContainerReader& file, const char* section, std::span<Real> weights) {
  if (weights.empty()) return;
  std::vector<float> stored(weights.size());
  file.read(section, std::span(stored));
  std::copy(stored.begin(), stored.end(), weights.begin());
}

// The networks, and what was learnt of each photo.
void read_weights(const ContainerReader& file, std::span<Real> weights, size_t networks) {
  read_weights(file, "networks", weights.first(networks));
  read_weights(file, "codes", weights.subspan(networks));
}

Json motion_to_json(const MotionShape& s) {
  return {{"deform", s.warp.kind == WarpKind::kSe3 ? "se3" : "translation"},
          {"position_degrees", s.warp.position_degrees},
          {"depth", s.warp.depth},
          {"width", s.warp.width},
          {"ambient", s.ambient},
          {"time_code", s.time_code},
          {"time_degrees", s.time_degrees},
          {"time_width", s.time_width},
          {"point_degrees", s.point_degrees}};
}

const char* medium_name(LearntMedium medium) {
  return medium == LearntMedium::kFog ? "fog" : "water";
}

// Files of photos that were taken through none do not name it.
LearntMedium medium_from(const JsonFields& header) {
  if (!header.has("medium")) return LearntMedium::kNone;
  const std::string name = header.text("medium");
  for (const LearntMedium medium : {LearntMedium::kFog, LearntMedium::kWater})
    if (name == medium_name(medium)) return medium;
  header.fail("is no known medium", "medium");
}

// Files of scenes that stand still do not name it.
MotionShape motion_from(const JsonFields& header) {
  MotionShape s;
  if (!header.has("motion")) return s;
  const JsonFields f = header.object("motion");
  const std::string deform = f.text("deform");
  if (deform != "translation" && deform != "se3") f.fail("is no known warp", "deform");
  s.warp.kind = deform == "se3" ? WarpKind::kSe3 : WarpKind::kTranslation;
  const auto number = [&](const char* name, int least, int most) {
    return static_cast<int>(f.integer(name, least, most));
  };
  s.warp.position_degrees = number("position_degrees", 0, 32);
  s.warp.depth = number("depth", 1, 32);
  s.warp.width = number("width", 1, 1024);
  s.ambient = number("ambient", 0, 32);
  s.time_code = number("time_code", 1, 1024);
  s.time_degrees = number("time_degrees", 0, 32);
  s.time_width = number("time_width", 1, 1024);
  s.point_degrees = number("point_degrees", 0, 32);
  return s;
}

Json codes_to_json(const CodeShape& shape) {
  Json out{{"appearance", shape.appearance}, {"colours", shape.colours}, {"photos", shape.photos}};
  if (shape.transient > 0) out["transient"] = shape.transient;
  if (!shape.moments.empty()) {
    out["deformation"] = shape.deformation;
    out["plane"] = shape.plane;
    out["moments"] = shape.moments;
    out["photo_moments"] = shape.photo_moments;
  }
  if (!shape.cameras.empty()) {
    out["camera"] = shape.camera;
    out["cameras"] = shape.cameras;
    out["photo_cameras"] = shape.photo_cameras;
  }
  if (!shape.lenses.empty()) {
    out["lenses"] = shape.lenses;
    out["photo_lenses"] = shape.photo_lenses;
  }
  return out;
}

// Of each photo, a row of so many.
std::vector<int> rows_from(const JsonFields& f, const char* key, size_t photos, size_t rows) {
  std::vector<int> out;
  if (f.at(key).empty()) return out;
  for (const double row : f.numbers(key, photos)) {
    if (!(row >= 0 && row < static_cast<double>(rows) && row == std::floor(row)))
      f.fail("expected whole numbers from 0 to " + std::to_string(rows) + " less 1", key);
    out.push_back(static_cast<int>(row));
  }
  return out;
}

void moments_from(const JsonFields& f, CodeShape& shape) {
  if (f.has("moments")) {
    shape.deformation = static_cast<int>(f.integer("deformation", 0, 256));
    shape.plane = static_cast<int>(f.integer("plane", 0, 256));
    shape.moments = f.numbers("moments", f.at("moments").size());
    const auto in_order = [&] {
      return std::ranges::is_sorted(shape.moments) && shape.moments.front() >= 0 &&
             shape.moments.back() <= 1;
    };
    if (shape.moments.empty() || !in_order())
      f.fail("expected times from 0 to 1, ascending", "moments");
    shape.photo_moments = rows_from(f, "photo_moments", shape.photos.size(), shape.moments.size());
  }
  if (f.has("cameras")) {
    shape.camera = static_cast<int>(f.integer("camera", 0, 256));
    for (const double id : f.numbers("cameras", f.at("cameras").size()))
      shape.cameras.push_back(static_cast<int>(id));
    shape.photo_cameras = rows_from(f, "photo_cameras", shape.photos.size(), shape.cameras.size());
  }
  if (f.has("lenses")) {
    shape.lenses = f.texts("lenses");
    shape.photo_lenses = rows_from(f, "photo_lenses", shape.photos.size(), shape.lenses.size());
  }
}

// Files without codes do not name any. Allocates no more than the file has shown to hold.
CodeShape codes_from(const ContainerReader& file, const JsonFields& header) {
  CodeShape shape;
  if (!header.has("codes")) return shape;
  const JsonFields f = header.object("codes");
  shape.appearance = static_cast<int>(f.integer("appearance", 0, 256));
  shape.colours = f.boolean("colours");
  shape.photos = f.texts("photos");
  if (f.has("transient")) shape.transient = static_cast<int>(f.integer("transient", 0, 256));
  moments_from(f, shape);
  if (file.decoded_bytes("codes") != CodeBooks(shape, 0).size() * sizeof(float))
    throw Error("is a damaged model file: its codes do not have the size that its photos ask for",
                file.where());
  return shape;
}

// What the options ask for is allocated only when the file has shown to hold as much.
RadianceField read_network(const ContainerReader& file, const JsonFields& header, ModelInfo info) {
  NetworkOptions options;
  options_from_json(options, header.at("options").dump(), file.where() + ": header: options");
  options.check_options();
  const double near = header.number("sample_near"), far = header.number("sample_far");
  if (!(near >= 0 && near < far)) header.fail("must be below sample_far", "sample_near");
  if (options.sampling.spacing == Spacing::kInverse && !(near > 0))
    header.fail("must be above 0 with inverse spacing", "sample_near");
  if (file.decoded_bytes("networks") != place_networks(options).back().end * sizeof(float))
    throw Error(
        "is a damaged model file: its networks do not have the size that its options ask for",
        file.where());
  const CodeShape codes = codes_from(file, header);
  if (!codes.photos.empty() && codes.appearance != options.image_code)
    header.fail("does not fit the codes' size", "options.image_code");
  if (!codes.photos.empty() && codes.transient != options.transient_code)
    header.fail("does not fit the codes' size", "options.transient_code");
  const CodeShape asked = code_shape(options, {});
  if (codes.deformation != asked.deformation || codes.plane != asked.plane)
    header.fail("does not fit the moments' codes", "options.deform");
  if (codes.camera != asked.camera)
    header.fail("does not fit the codes' size", "options.camera_code");
  auto field = std::make_shared<NetworkField>(codes, options, near, far);
  if (header.has("windows")) {
    const JsonFields windows = header.object("windows");
    field->windows = {windows.number("warp"), windows.number("ambient")};
  }
  if (options.space == Space::kNdc) field->ndc = ndc_from(header.object("ndc"));
  read_weights(file, field->weights.span(), field->network_size());
  return RadianceField(std::move(info), std::move(field));
}

RadianceField read_model(const ContainerReader& file) {
  const JsonFields header = JsonFields::parse(file.header(), file.where() + ": header");
  ModelInfo info = model_info_from_json(header);
  if (info.method != "grid") return read_network(file, header, std::move(info));
  GridOptions options;
  options_from_json(options, header.at("options").dump(), file.where() + ": header: options");
  const int cascades = static_cast<int>(header.integer("cascades", 1, 16));
  // The options alone may ask for gigabytes: nothing is allocated before the file has shown to hold
  // as much.
  const uint64_t entries = hash_grid_shape(options).size();
  if (file.decoded_bytes("table") != entries * sizeof(uint16_t))
    throw Error(
        "is a damaged model file: its table does not have the size that its options ask for",
        file.where());
  const uint64_t side = static_cast<uint64_t>(occupancy_side(options, info.unbounded));
  if (file.decoded_bytes("occupancy") != static_cast<uint64_t>(cascades) * side * side * side)
    throw Error(
        "is a damaged model file: its occupancy does not have the size that its options ask for",
        file.where());

  options.table_bits = kTableBits;
  auto field =
      std::make_shared<GridField>(options, info.unbounded, cascades,
                                  GridParts{.codes = codes_from(file, header),
                                            .motion = motion_from(header),
                                            .medium = medium_from(header),
                                            .sky = header.has("sky") && header.boolean("sky")});
  file.read("table", field->half_table.span());
  read_weights(file, field->weights.span(), field->network_size());
  std::vector<uint8_t> levels(field->occupancy.levels().size());
  file.read("occupancy", std::span(levels));
  field->occupancy.set_levels(levels);
  field->occupancy.forget_training();
  field->clip = clip_from(header);
  return RadianceField(std::move(info), std::move(field));
}

}  // namespace

RadianceField parse_model(std::vector<uint8_t> bytes, const std::string& where) {
  return read_model(ContainerReader(std::move(bytes), where, kModelFormat));
}

}  // namespace internal

RadianceField RadianceField::load(const std::filesystem::path& path) {
  return internal::read_model(internal::ContainerReader(path, internal::kModelFormat));
}

void RadianceField::save(const std::filesystem::path& path) const {
  using internal::Json;
  Json header = internal::model_info_to_json(info_);
  const CodeBooks& books = field().codes();
  if (!books.empty()) header["codes"] = internal::codes_to_json(books.shape());
  const std::vector<float> weights = internal::to_single(field().all_weights());
  const std::span<const float> networks = std::span(weights).first(weights.size() - books.size());
  const auto add_weights = [&](internal::ContainerWriter& file) {
    file.add("networks", networks);
    if (!books.empty()) file.add("codes", std::span(weights).subspan(networks.size()));
  };
  if (network_) {
    header["options"] = Json::parse(options_to_json(network_->options));
    header["sample_near"] = network_->near;
    header["sample_far"] = network_->far;
    if (network_->options.deform.any())
      header["windows"] = {{"warp", network_->windows.warp},
                           {"ambient", network_->windows.ambient}};
    if (network_->options.space == Space::kNdc)
      header["ndc"] = internal::ndc_to_json(network_->ndc);
    internal::ContainerWriter file(header.dump(-1, ' ', false, Json::error_handler_t::replace));
    add_weights(file);
    file.save(path, internal::kModelFormat);
    return;
  }
  GridOptions options = grid_->options;
  options.table_bits = internal::kTableBits;
  header["options"] = Json::parse(options_to_json(options));
  header["cascades"] = grid_->occupancy.cascades();
  if (!grid_->motion.empty()) header["motion"] = internal::motion_to_json(grid_->motion.shape);
  if (const LearntMedium medium = grid_->learnt_medium(); medium != LearntMedium::kNone)
    header["medium"] = internal::medium_name(medium);
  if (grid_->has_sky()) header["sky"] = true;
  header["clip"] = {{"min", internal::corner_to_json(grid_->clip.min)},
                    {"max", internal::corner_to_json(grid_->clip.max)}};
  internal::ContainerWriter file(header.dump(-1, ' ', false, Json::error_handler_t::replace));
  std::vector<uint16_t> half;
  std::span<const uint16_t> table = grid_->half_table.span();
  if (table.empty()) table = half = internal::to_half(grid_->table.span());
  file.add("table", table);
  add_weights(file);
  file.add("occupancy", grid_->occupancy.levels(), internal::SectionEncoding::kZlib);
  file.save(path, internal::kModelFormat);
}

}  // namespace nerf
