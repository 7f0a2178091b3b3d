#include "nerf/train/methods.h"

#include <fmt/format.h>

#include <algorithm>

#include "nerf/base/error.h"
#include "nerf/base/nearest_name.h"
#include "train/method_rows.h"

namespace nerf {

namespace {

using internal::MethodRow;

// bmild/nerf, paper_configs/blender_config.txt.
void nerf_paper(TrainOptions& o) {
  o.steps = 500000;
  o.rate = 5e-4;
  o.final_rate = 0.1;
  o.warmup_steps = 0;
  o.hold = 0;
  o.recipe.one_photo = true;
  o.recipe.crop_steps = 500;
}

// google/mipnerf, configs/blender.gin and internal/{models,utils}.py.
void mipnerf_paper(TrainOptions& o) {
  NetworkOptions& n = o.network;
  n.cast = Cast::kCone;
  n.encoding = Encoding::kIntegrated;
  n.position_degrees = 16;
  n.sampling.resampling = Resampling::kBlurred;
  n.sampling.coarse = n.sampling.fine = 128;
  n.shared = true;
  n.density = DensityActivation::kSoftplus;
  n.density_bias = -1;
  n.colour_padding = 0.001_r;
  o.steps = 1000000;
  o.rate = 5e-4;
  o.final_rate = 0.01;
  o.warmup_steps = 2500;
  o.hold = 0;
  o.recipe.rays = 4096;
  o.recipe.one_photo = true;
  o.recipe.coarse = 0.1_r;
  o.recipe.epsilon = 1e-8;
  o.recipe.warmup_rate = 0.01;
}

// google-research/multinerf, configs/360.gin and internal/configs.py.
void mipnerf360_paper(TrainOptions& o) {
  mipnerf_paper(o);
  NetworkOptions& n = o.network;
  n.space = Space::kContract;
  n.encoding = Encoding::kOffAxis;
  n.position_degrees = 12;
  n.sampling.resampling = Resampling::kProposal;
  n.sampling.spacing = Spacing::kInverse;
  n.sampling.rounds = 2;
  n.sampling.coarse = 64;
  n.sampling.fine = 32;
  n.sampling.padding = 0;
  n.shared = false;
  n.width = 1024;
  n.bottleneck = 256;
  n.proposal_depth = 4;
  n.proposal_width = 256;
  n.proposal_colour = false;
  n.opaque_end = true;
  n.initialisation = Initialisation::kHe;
  o.steps = 250000;
  o.rate = 2e-3;
  o.warmup_steps = 512;
  o.recipe.rays = 16384;
  o.recipe.one_photo = false;
  o.recipe.coarse = 0;
  o.recipe.interlevel = 1;
  o.recipe.distortion = 0.01_r;
  o.recipe.charbonnier = 0.001_r;
  o.recipe.epsilon = 1e-6;
  o.recipe.clip = 0.001;
  o.recipe.near = 0.2;
  o.recipe.far = 1e6;
  o.recipe.anneal = true;
}

constexpr MethodRow kRows[] = {
    {"nerf", "Mildenhall et al. 2020", nerf_paper},
    {"mipnerf", "Barron et al. 2021", mipnerf_paper},
    {"mipnerf360", "Barron et al. 2022", mipnerf360_paper},
};

// What a smaller preset changes: widths, samples and rays, so that a step takes a fraction of a
// second, and a rate and a schedule for thousands of steps instead of hundreds of thousands.
void shrink(TrainOptions& o, int width, int divide_samples, int rays) {
  NetworkOptions& n = o.network;
  n.width = n.bottleneck = width;
  n.view_width = width / 2;
  n.proposal_width = n.proposal_colour ? width : width / 2;
  if (!n.shared && n.proposal_colour) n.proposal_depth = n.depth;
  n.sampling.coarse /= divide_samples;
  n.sampling.fine /= divide_samples;
  o.steps = 0;
  o.rate = std::max(o.rate, 2e-3);
  o.hold = 0.25;  // a plan of minutes is made when empty samples are already known
  o.recipe.rays = rays;
  o.recipe.one_photo = false;
  o.recipe.crop_steps = std::min(o.recipe.crop_steps, 100);
  o.warmup_steps = std::min(o.warmup_steps, 128);
  o.recipe.negligible = 1e-4_r;
  // A plan of minutes does not know its length while it begins.
  o.recipe.anneal_steps = kAnnealSteps;
}

template <class E>
std::string name_of(E value) {
  return std::get<std::string>(OptionTraits<E>::to_value(value));
}

constexpr size_t kColumns = 11;
using Line = std::array<std::string, kColumns>;

Line grid_line() {
  const TrainOptions o = method_options(kGridMethod, Scale::kPaper);
  const GridOptions& g = o.grid;
  Scene unbounded;
  unbounded.unbounded = true;
  std::string losses = fmt::format("Huber {}", o.huber_delta);
  if (const double weight = distortion_weight(o, unbounded); weight > 0)
    losses += fmt::format(", distortion {} unbounded", weight);
  return {kGridMethod,
          g.cone_points > 1 ? "cone" : "point",
          "identity/contract",
          fmt::format("hash grid {}x{}", g.levels, g.features),
          fmt::format("up to {}", g.sampler.max_samples),
          "occupancy march",
          fmt::format("{}x{} + {}x{}", g.density_layers, g.hidden, g.colour_layers, g.hidden),
          "exp",
          "background",
          losses,
          "Mueller et al. 2022"};
}

std::string losses_of(const NetworkRecipe& r) {
  std::string out = r.charbonnier > 0 ? fmt::format("Charbonnier {}", r.charbonnier) : "squared";
  if (r.coarse > 0) out += fmt::format(", {} of coarse levels", r.coarse);
  if (r.interlevel > 0) out += fmt::format(", interlevel {}", r.interlevel);
  if (r.distortion > 0) out += fmt::format(", distortion {}", r.distortion);
  return out;
}

Line line_of(const MethodRow& row) {
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
          name_of(n.space),
          fmt::format("{} {}/{}", name_of(n.encoding), n.position_degrees, n.direction_degrees),
          samples,
          name_of(n.sampling.resampling),
          networks,
          name_of(n.density),
          n.opaque_end ? "opaque end" : "background",
          losses_of(o.recipe),
          row.source};
}

}  // namespace

std::vector<std::string> internal::method_choices() {
  std::vector<std::string> names{kGridMethod};
  for (const MethodRow& row : kRows) names.emplace_back(row.name);
  return names;
}

std::span<const MethodRow> internal::method_rows() { return kRows; }

std::vector<std::string> method_names() { return internal::method_choices(); }

TrainOptions internal::options_of(const MethodRow& row, Scale scale) {
  TrainOptions o;
  o.method = row.name;
  row.paper(o);
  // Narrow networks take so many more steps in the same time that they win (docs/benchmarks.md).
  if (scale == Scale::kSmall) shrink(o, 96, 2, 256);
  if (scale == Scale::kTiny) {
    shrink(o, 64, 2, 256);
    o.network.depth = o.network.proposal_depth = 4;
  }
  return o;
}

TrainOptions method_options(const std::string& method, Scale scale) {
  if (method == kGridMethod) return {};
  const auto row =
      std::ranges::find_if(kRows, [&](const MethodRow& r) { return r.name == method; });
  if (row == std::end(kRows))
    throw Error("'" + method + "' is no method", "--method",
                nearest_name_hint(method, method_names()));
  return internal::options_of(*row, scale);
}

std::string internal::table_of(std::span<const MethodRow> rows) {
  std::vector<Line> lines{{"method", "cast", "space", "encoding", "samples", "resampling",
                           "networks", "density", "behind", "losses", "source"},
                          grid_line()};
  for (const MethodRow& row : rows) lines.push_back(line_of(row));
  std::array<size_t, kColumns> widths{};
  for (const Line& line : lines)
    for (size_t i = 0; i < kColumns; ++i) widths[i] = std::max(widths[i], line[i].size());
  std::string out;
  for (const Line& line : lines) {
    for (size_t i = 0; i + 1 < kColumns; ++i) out += fmt::format("{:<{}}  ", line[i], widths[i]);
    out += line.back() + "\n";
  }
  return out;
}

std::string methods_table() { return internal::table_of(kRows); }

}  // namespace nerf
