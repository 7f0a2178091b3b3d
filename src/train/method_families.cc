// What the methods over tables, and those over wide networks, have in common.
#include <fmt/format.h>

#include <algorithm>

#include "nerf/base/error.h"
#include "train/grid_trainer.h"
#include "train/method_rows.h"
#include "train/network_trainer.h"

namespace nerf {

namespace {

using internal::MethodLine;
using internal::MethodRow;
using Names = std::set<std::string>;

template <class T>
std::unique_ptr<TrainerImpl> make(const Scene& scene, const PhotoSet& photos,
                                  const TrainOptions& options, ThreadPool& pool) {
  return std::make_unique<T>(scene, photos, options, pool);
}

template <class T>
Names names_of(T own) {
  Names names;
  for (const OptionField& field : option_fields(own)) names.insert(field.name);
  return names;
}

// The groups that a family alone reads, under the names that they have in TrainOptions.
struct GridOwn {
  GridRecipe recipe;
  GridOptions field;
  template <class V>
  void visit_options(V& v) {
    recipe.visit_options(v);
    v("grid", field, "");
  }
};
struct NetworkOwn {
  NetworkOptions field;
  NetworkRecipe recipe;
  template <class V>
  void visit_options(V& v) {
    v("network", field, "");
    v("recipe", recipe, "");
  }
};

void unused_by_grid(const TrainOptions& options, const Names& given, const Scene& scene,
                    std::vector<std::string>& out) {
  if (given.contains("keep_transparent") && !scene.alpha)
    out.emplace_back("--keep-transparent is not used: the photos have no alpha");
  if (given.contains("keep_free") && !scene.unbounded)
    out.emplace_back("--keep-free is not used: the scene ends with its box");
  if (given.contains("stop_transmittance") && options.grid_recipe.shared_colour == 0)
    out.emplace_back("--stop-transmittance is not used: no samples share a colour");
  const Switch sky = options.grid_recipe.light.sky;
  if (sky == Switch::kOn && !learns_sky(options, scene))
    out.push_back(fmt::format("--sky is not used: {}", scene.alpha
                                                           ? "the photos have alpha"
                                                           : "a medium is learnt (--medium)"));
  if (given.contains("sky_clearing") && sky != Switch::kAuto && !learns_sky(options, scene))
    out.emplace_back("--sky-clearing is not used: no sky is learnt (--sky)");
  if (given.contains("far") && !scene.unbounded)
    out.emplace_back("--far is not used: the scene ends with its box (--bbox)");
}

void unused_by_networks(const TrainOptions& options, const Names& given, const Scene& scene,
                        std::vector<std::string>& out) {
  if (options.network.sampling.resampling != Resampling::kProposal &&
      (given.contains("recipe.anneal") || given.contains("recipe.anneal_steps")))
    out.emplace_back(
        "--recipe-anneal and --recipe-anneal-steps are not used: only proposals are annealed");
  if (options.network.transient_code == 0 &&
      (given.contains("recipe.transient_density") || given.contains("recipe.least_deviation")))
    out.emplace_back(
        "--recipe-transient-density and --recipe-least-deviation are not used: nothing is "
        "transient (--network-transient-code)");
  const DeformOptions& deform = options.network.deform;
  const auto unused = [&](const std::string& name, const char* why) {
    if (!given.contains(name)) return;
    OptionField field;
    field.name = name;
    out.push_back(option_flag(field) + " is not used: " + why);
  };
  if (deform.warp == WarpKind::kNone)
    for (const char* name :
         {"network.deform.degrees", "network.deform.depth", "network.deform.width",
          "network.deform.skip", "recipe.window_steps", "recipe.elastic", "recipe.still"})
      unused(name, "nothing is warped (--network-deform-warp)");
  if (!deform.has_sheet())
    for (const char* name : {"network.deform.sheet_degrees", "network.deform.sheet_depth",
                             "network.deform.sheet_width"})
      unused(name, "ambient coordinates are no sheet (--network-deform-slice)");
  if (deform.slice == Slice::kNone)
    for (const char* name : {"network.deform.ambient", "network.deform.ambient_degrees",
                             "recipe.ambient_start", "recipe.ambient_steps"})
      unused(name, "there are no ambient coordinates (--network-deform-slice)");
  if (deform.code > 0)
    unused("network.deform.time_degrees", "moments have numbers (--network-deform-code)");
  if (scene.points.empty() && options.recipe.still > 0)
    for (const char* name : {"recipe.still", "recipe.still_points"})
      unused(name, "the capture has no sparse points");
  if (given.contains("network.last_interval") && options.network.sampling.intervals())
    out.emplace_back("--network-last-interval is not used: samples are intervals");
  if (given.contains("recipe.photo_range") && scene.observations.empty())
    out.emplace_back("--recipe-photo-range is not used: no photo is known to see a sparse point");
  if (options.network.space != Space::kNdc) return;
  if (given.contains("recipe.near") || given.contains("recipe.far"))
    out.emplace_back(
        "--recipe-near and --recipe-far are not used: normalised device coordinates go from the "
        "near plane to infinity");
  if (given.contains("far"))
    out.emplace_back("--far is not used: normalised device coordinates go to infinity");
}

bool anneals_to_the_end(const TrainOptions& options) {
  return options.recipe.anneal && options.recipe.anneal_steps == 0;
}

void check_networks(const TrainOptions& options) {
  const NetworkOptions& network = options.network;
  if (network.sampling.rounds == 0 || network.shared) return;
  const bool bounded =
      network.sampling.resampling == Resampling::kProposal && options.recipe.interlevel > 0;
  if (!bounded && !(options.recipe.coarse > 0 && network.proposal_colour))
    throw Error("no loss would train the network that samples are drawn from",
                "--recipe-coarse, --recipe-interlevel",
                "give the first above 0, or with proposal resampling the second");
}

template <class E>
std::string name_of(E value) {
  return std::get<std::string>(OptionTraits<E>::to_value(value));
}

MethodLine grid_line(const MethodRow& row) {
  const TrainOptions o = internal::options_of(row, Scale::kPaper);
  const GridOptions& g = o.grid;
  Scene unbounded;
  unbounded.unbounded = true;
  std::string losses = fmt::format("Huber {}", o.grid_recipe.huber_delta);
  if (const double weight = distortion_weight(o, unbounded); weight > 0)
    losses += fmt::format(", distortion {} unbounded", weight);
  return {row.name,
          "point",
          "identity/contract",
          fmt::format("hash grid {}x{}", g.levels, g.features),
          fmt::format("up to {}", g.sampler.max_samples),
          "occupancy march",
          fmt::format("{}x{} + {}x{}", g.density_layers, g.hidden, g.colour_layers, g.hidden),
          "exp",
          "background",
          losses,
          row.source};
}

std::string losses_text(const TrainOptions& o) {
  const NetworkRecipe& r = o.recipe;
  const bool transient = o.network.transient_code > 0;
  std::string out = transient           ? fmt::format("uncertain {}", r.least_deviation)
                    : r.charbonnier > 0 ? fmt::format("Charbonnier {}", r.charbonnier)
                                        : "squared";
  if (transient && r.transient_density > 0)
    out += fmt::format(", transient density {}", r.transient_density);
  if (r.coarse > 0) out += fmt::format(", {} of coarse levels", r.coarse);
  if (r.interlevel > 0) out += fmt::format(", interlevel {}", r.interlevel);
  if (r.distortion > 0) out += fmt::format(", distortion {}", r.distortion);
  if (r.elastic > 0) out += fmt::format(", elastic {}", r.elastic);
  if (r.still > 0) out += fmt::format(", still points {}", r.still);
  return out;
}

std::string space_text(const NetworkOptions& n) {
  if (!n.deform.any()) return name_of(n.space);
  std::string out = name_of(n.deform.warp);
  if (n.deform.slice != Slice::kNone)
    out += fmt::format(" + {} {}", name_of(n.deform.slice), n.deform.ambient);
  return out + (n.deform.code > 0 ? " of moments" : " of time");
}

MethodLine network_line(const MethodRow& row) {
  const TrainOptions o = internal::options_of(row, Scale::kPaper);
  const NetworkOptions& n = o.network;
  std::string samples;
  for (int i = 0; i < n.sampling.rounds; ++i) samples += fmt::format("{}+", n.sampling.coarse);
  samples += std::to_string(n.sampling.fine);
  if (n.sampling.spacing == Spacing::kInverse) samples += " inverse";
  std::string networks = fmt::format("{}x{}", n.depth, n.width);
  if (!n.shared) networks = fmt::format("{}x{} + ", n.proposal_depth, n.proposal_width) + networks;
  return {row.name,
          name_of(n.cast),
          space_text(n),
          fmt::format("{} {}/{}", name_of(n.encoding), n.position_degrees, n.direction_degrees),
          samples,
          name_of(n.sampling.resampling),
          networks,
          name_of(n.density),
          n.opaque_end ? "opaque end" : "background",
          losses_text(o),
          row.source};
}

}  // namespace

const internal::MethodFamily internal::kGridFamily{
    .one_preset = true,
    .learns_from_reduced_photos = false,
    .draws_masked = true,
    .minutes = [](Scale) { return 5.0; },
    .make_trainer = make<GridTrainer>,
    .memory_bytes = GridTrainer::memory_bytes,
    .depends_on_length = [](const TrainOptions&) { return false; },
    .check = [](const TrainOptions&) {},
    .own_options = [] { return names_of(GridOwn()); },
    .unused = unused_by_grid,
    .line = grid_line,
};

const internal::MethodFamily internal::kNetworkFamily{
    .one_preset = false,
    .learns_from_reduced_photos = true,
    .draws_masked = false,  // a few thousand steps leave what is kept half empty (wild.md)
    .minutes = [](Scale scale) { return scale == Scale::kTiny ? 4.0 : 50.0; },
    .make_trainer = make<NetworkTrainer>,
    .memory_bytes = NetworkTrainer::memory_bytes,
    .depends_on_length = anneals_to_the_end,
    .check = check_networks,
    .own_options = [] { return names_of(NetworkOwn()); },
    .unused = unused_by_networks,
    .line = network_line,
};

}  // namespace nerf
