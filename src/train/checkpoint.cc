// Trainer::save_checkpoint and load_checkpoint. docs/model_file.md describes the file.
#include <algorithm>
#include <nlohmann/json.hpp>
#include <type_traits>

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
    "NERFCKPT", 6, "checkpoint", "copy it again, or begin the run anew with --overwrite"};

// Weights and moments are stored as they are: one build cannot continue another's run bit for bit.
constexpr const char* kReal = std::is_same_v<Real, float> ? "float" : "double";

void check_real(const JsonFields& header) {
  const std::string saved = header.has("real") ? header.text("real") : "float";
  if (saved != kReal)
    throw Error(
        "the checkpoint is of a program that computes in " + saved + ", this one does in " + kReal,
        header.where(),
        "resume with a program built as that one was (NERF_DOUBLE), or begin another run");
}

void check_scene(const JsonFields& header, const internal::SceneFingerprint& own) {
  const JsonFields saved = header.object("scene");
  for (const auto& [aspect, hash] : own)
    if (saved.text(aspect.c_str()) != hash)
      throw Error("the checkpoint is of another scene: the " + aspect + " differ", header.where(),
                  "resume with the scene and the options that it was begun with");
}

internal::SceneFingerprint fingerprint_of(const TrainerImpl& t) {
  const bool clock = t.options.grid_recipe.cameras.rolling_shutter.any();
  return internal::scene_fingerprint(t.scene, t.photos, clock);
}

// Everything but the planned length, which the checkpoint decides.
TrainOptions checked_options(const JsonFields& header, const TrainOptions& own) {
  TrainOptions saved;
  options_from_json(saved, header.at("options").dump(), header.where() + ": options");
  TrainOptions wanted = own;
  wanted.steps = saved.steps;
  wanted.plan_changes = saved.plan_changes;
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
  const TrainerImpl& t = *impl_;
  Json header;
  header["options"] = Json::parse(options_to_json(t.options));
  for (const auto& [aspect, hash] : fingerprint_of(t)) header["scene"][aspect] = hash;
  header["real"] = kReal;
  header["run"] = run_state;
  Json state = {{"done", t.done}, {"salt", t.salt}, {"rate_factor", t.rate_factor}};
  internal::ContainerWriter file;
  t.save_state(file, state);
  header["state"] = state;
  file.set_header(header.dump());
  file.save(path, kFormat);
}

std::string Trainer::load_checkpoint(const std::filesystem::path& path) {
  TrainerImpl& t = *impl_;
  const internal::ContainerReader file(path, kFormat);
  const JsonFields header = JsonFields::parse(file.header(), path.string());
  check_real(header);
  check_scene(header, fingerprint_of(t));
  const TrainOptions options = checked_options(header, t.options);
  const std::string run_state = header.text("run");
  const JsonFields state = header.object("state");
  t.done = state.integer("done", 0, INT64_MAX);
  t.salt = state.unsigned_integer("salt");
  t.rate_factor = state.number("rate_factor");
  t.options = options;
  t.load_state(file, state);
  return run_state;
}

}  // namespace nerf
