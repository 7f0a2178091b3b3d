// Trainer::save_checkpoint and load_checkpoint. docs/model_file.md describes the file.
#include <algorithm>
#include <nlohmann/json.hpp>

#include "base/container.h"
#include "model/json_fields.h"
#include "nerf/model/options_json.h"
#include "train/scene_fingerprint.h"
#include "train/trainer_impl.h"

namespace nerf {
namespace {

using Json = nlohmann::ordered_json;
using internal::JsonFields;

// Raise the version whenever a step computes something else than before: a checkpoint continues bit
// for bit or not at all.
constexpr internal::ContainerFormat kFormat{
    "NERFCKPT", 2, "checkpoint", "copy it again, or begin the run anew with --overwrite"};

// Every array that a step reads and the step before wrote. Gradients are zero between steps.
template <class Trainer, class Visit>
void visit_arrays(Trainer& t, Visit&& visit) {
  visit("table", t.field.table.span());
  visit("table_m", t.optimiser.table_m.span());
  visit("table_v", t.optimiser.table_v.span());
  visit("row_steps", t.optimiser.row_steps.span());
  visit("networks", t.field.weights.span());
  visit("networks_m", t.optimiser.network_m.span());
  visit("networks_v", t.optimiser.network_v.span());
  visit("opacity", t.field.occupancy.training_state());
  visit("pixel_errors", t.errors.errors());
  visit("pixel_chances", t.errors.chances());
}
constexpr const char* kLevels = "occupancy";  // as of its last rebuild

// The scalars of the same kind.
template <class Trainer>
Json scalars_to_json(const Trainer& t) {
  return {{"done", t.done},
          {"salt", t.salt},
          {"rate_factor", t.rate_factor},
          {"samples_per_ray", t.samples_per_ray}};
}

template <class Trainer>
void scalars_from_json(const JsonFields& f, Trainer& t) {
  t.done = f.integer("done", 0, INT64_MAX);
  t.salt = f.unsigned_integer("salt");
  t.rate_factor = f.number("rate_factor");
  t.samples_per_ray = f.number("samples_per_ray");
}

void check_scene(const JsonFields& header, const internal::SceneFingerprint& own) {
  const JsonFields saved = header.object("scene");
  for (const auto& [aspect, hash] : own)
    if (saved.text(aspect.c_str()) != hash)
      throw Error("the checkpoint is of another scene: the " + aspect + " differ", header.where(),
                  "resume with the scene and the options that it was begun with");
}

// Everything but the planned length, which the checkpoint decides.
TrainOptions checked_options(const JsonFields& header, const TrainOptions& own) {
  TrainOptions saved;
  options_from_json(saved, header.at("options").dump(), header.where() + ": options");
  TrainOptions wanted = own;
  wanted.steps = saved.steps;
  const auto a = option_fields(saved), b = option_fields(wanted);
  for (size_t i = 0; i < a.size(); ++i) {
    const std::string was = option_text(a[i]), is = option_text(b[i]);
    if (was != is)
      throw Error("the checkpoint was made with " + option_flag(a[i]) + " " + was + ", not " + is,
                  header.where(), "resume with the same options, or begin another run");
  }
  return saved;
}

}  // namespace

void Trainer::save_checkpoint(const std::filesystem::path& path,
                              const std::string& run_state) const {
  const Impl& t = *impl_;
  Json header;
  header["options"] = Json::parse(options_to_json(t.options));
  header["state"] = scalars_to_json(t);
  for (const auto& [aspect, hash] : internal::scene_fingerprint(t.scene, t.photos))
    header["scene"][aspect] = hash;
  header["run"] = run_state;
  internal::ContainerWriter file(header.dump());
  visit_arrays(t, [&](const char* name, auto values) { file.add(name, values); });
  file.add(kLevels, t.field.occupancy.levels(), internal::SectionEncoding::kZlib);
  file.save(path, kFormat);
}

std::string Trainer::load_checkpoint(const std::filesystem::path& path) {
  Impl& t = *impl_;
  const internal::ContainerReader file(path, kFormat);
  const JsonFields header = JsonFields::parse(file.header(), path.string());
  check_scene(header, internal::scene_fingerprint(t.scene, t.photos));
  const TrainOptions options = checked_options(header, t.options);
  const std::string run_state = header.text("run");
  const JsonFields state = header.object("state");

  std::vector<uint8_t> levels(t.field.occupancy.levels().size());
  file.read(kLevels, std::span(levels));
  std::fill(t.optimiser.table_gradient.begin(), t.optimiser.table_gradient.end(), 0.0f);
  std::fill(t.optimiser.touched.begin(), t.optimiser.touched.end(), uint8_t{0});
  visit_arrays(t, [&](const char* name, auto values) { file.read(name, values); });
  t.field.occupancy.set_levels(levels);
  scalars_from_json(state, t);
  t.options = options;
  return run_state;
}

}  // namespace nerf
