#include "nerf/train/methods.h"

#include <fmt/format.h>

#include <algorithm>

#include "nerf/base/error.h"
#include "nerf/base/nearest_name.h"
#include "nerf/train/run.h"
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

// The publication as far as it says, else kwea123/nerf_pl, branch nerfw (docs/methods/nerfw.md).
void nerfw_paper(TrainOptions& o) {
  nerf_paper(o);
  NetworkOptions& n = o.network;
  n.position_degrees = 15;
  n.sampling.coarse = n.sampling.fine = 512;
  n.width = n.bottleneck = n.proposal_width = 512;
  n.density = DensityActivation::kSoftplus;
  n.last_interval = 100;
  n.image_code = 48;
  n.code_spread = 1;
  n.transient_code = 16;
  o.steps = 300000;
  o.recipe.rays = 2048;
  o.recipe.one_photo = false;
  o.recipe.crop_steps = 0;
  o.recipe.coarse = 0.5_r;
  o.recipe.photo_range = true;
}

// albertpumarola/D-NeRF, run_dnerf.py, run_dnerf_helpers.py and configs/lego.txt.
void dnerf_paper(TrainOptions& o) {
  nerf_paper(o);
  NetworkOptions& n = o.network;
  n.shared = true;
  n.deform.warp = WarpKind::kTranslation;
  n.deform.degrees = n.deform.time_degrees = 10;
  n.deform.depth = 8;
  n.deform.width = 256;
  n.deform.skip = 6;
  n.deform.code = 0;
  n.deform.still_start = true;
  o.steps = 800000;
  o.final_rate = 0.0251188643;  // 0.1^(800 / 500)
  o.recipe.rays = 500;
  o.recipe.coarse = 0;
  o.recipe.curriculum_steps = 10000;
  o.recipe.epsilon = 1e-8;
}

// google/nerfies, configs/gpu_quarterhd.gin and nerfies/{models,modules,warping,training}.py.
void nerfies_paper(TrainOptions& o) {
  NetworkOptions& n = o.network;
  n.position_degrees = 8;
  n.sampling.coarse = n.sampling.fine = 128;
  n.density = DensityActivation::kSoftplus;
  n.image_code = 8;
  n.camera_code = 2;
  n.code_spread = 0.0144337567_r;  // of even numbers in a range of 0.05
  n.deform.warp = WarpKind::kSe3;
  o.steps = 250000;
  o.rate = 1e-3;
  o.final_rate = 0.1;
  o.warmup_steps = 0;
  o.hold = 0;
  o.recipe.rays = 6144;
  o.recipe.epsilon = 1e-8;
  o.recipe.window_steps = 80000;
  o.recipe.elastic = 0.01_r;
  o.recipe.elastic_steps = 50000;
  o.recipe.elastic_fall_steps = 100000;
  o.recipe.still = 1;
}

// google/hypernerf, configs/hypernerf_vrig_ds_2d.gin and hypernerf/{models,modules}.py.
void hypernerf_paper(TrainOptions& o) {
  nerfies_paper(o);
  NetworkOptions& n = o.network;
  n.image_code = n.camera_code = 0;
  n.deform.degrees = 6;
  n.deform.slice = Slice::kSheet;
  o.recipe.ambient_start = 1000;
  o.recipe.ambient_steps = 10000;
  o.recipe.elastic = 0;
  o.recipe.elastic_steps = o.recipe.elastic_fall_steps = 0;
}

using internal::kGridFamily;
using internal::kNetworkFamily;
constexpr MethodRow kRows[] = {
    {kGridMethod, "Mueller et al. 2022", &kGridFamily, [](TrainOptions&) {}},
    {"nerf", "Mildenhall et al. 2020", &kNetworkFamily, nerf_paper},
    {"mipnerf", "Barron et al. 2021", &kNetworkFamily, mipnerf_paper},
    {"mipnerf360", "Barron et al. 2022", &kNetworkFamily, mipnerf360_paper},
    {"nerfw", "Martin-Brualla et al. 2021", &kNetworkFamily, nerfw_paper},
    {"dnerf", "Pumarola et al. 2021", &kNetworkFamily, dnerf_paper},
    {"nerfies", "Park et al. 2021", &kNetworkFamily, nerfies_paper},
    {"hypernerf", "Park et al. 2021b", &kNetworkFamily, hypernerf_paper},
};

// The same of what moves: a plan of minutes is a thirtieth, or a hundredth, of the paper's.
void shrink_motion(TrainOptions& o, int width, int share) {
  DeformOptions& d = o.network.deform;
  if (!d.any()) return;
  d.width = width;
  d.depth = 6;
  d.skip = std::min(d.skip, d.depth);
  d.sheet_width = width / 2;
  NetworkRecipe& r = o.recipe;
  if (d.code == 0) {
    // The paper's ten frequencies need its curriculum and learn less in a short training
    // (docs/methods/dnerf.md).
    d.width = 2 * width;
    d.depth = 4;
    d.skip = 0;
    d.degrees = d.time_degrees = 4;
    r.curriculum_steps = 0;
  }
  for (int* steps : {&r.window_steps, &r.ambient_start, &r.ambient_steps, &r.elastic_steps,
                     &r.elastic_fall_steps})
    *steps /= share;
  r.still_points = 512;
}

// What a smaller preset changes: widths, samples and rays, so that a step takes a fraction of a
// second, and a rate and a schedule for thousands of steps instead of hundreds of thousands.
void shrink(TrainOptions& o, int width, int rays) {
  NetworkOptions& n = o.network;
  const int divide_samples = n.sampling.coarse > 128 ? 16 : 2;
  n.width = n.bottleneck = width;
  n.view_width = n.transient_width = width / 2;
  n.transient_depth = 2;
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
  // Not measured with a softplus, which leaves a little density everywhere.
  if (n.density == DensityActivation::kRelu) o.recipe.empty_steps = 256;
  // What is learnt first counts a hundred times as much as what is not yet, and the rest is called
  // transient: a few thousand steps do not undo that (docs/methods/nerfw.md).
  o.recipe.least_deviation = std::max(o.recipe.least_deviation, 0.3_r);
  // A plan of minutes does not know its length while it begins.
  o.recipe.anneal_steps = kAnnealSteps;
}

}  // namespace

std::vector<std::string> internal::method_choices() {
  std::vector<std::string> names;
  for (const MethodRow& row : kRows) names.emplace_back(row.name);
  return names;
}

std::span<const MethodRow> internal::method_rows() { return kRows; }

std::vector<std::string> method_names() { return internal::method_choices(); }

const MethodRow& internal::method_row(const std::string& name) {
  const auto row = std::ranges::find_if(kRows, [&](const MethodRow& r) { return r.name == name; });
  if (row == std::end(kRows))
    throw Error("'" + name + "' is no method", "--method", nearest_name_hint(name, method_names()));
  return *row;
}

TrainOptions internal::options_of(const MethodRow& row, Scale scale) {
  TrainOptions o;
  o.method = row.name;
  row.paper(o);
  if (row.family->one_preset) return o;
  // Narrow networks take so many more steps in the same time that they win (docs/benchmarks.md).
  if (scale == Scale::kSmall) {
    shrink(o, 96, 256);
    shrink_motion(o, 64, 10);
  }
  if (scale == Scale::kTiny) {
    shrink(o, 64, 256);
    shrink_motion(o, 64, 40);
    o.network.deform.depth = 4;
    o.network.depth = o.network.proposal_depth = 4;
  }
  return o;
}

TrainOptions method_options(const std::string& method, Scale scale) {
  return internal::options_of(internal::method_row(method), scale);
}

bool has_scales(const std::string& method) {
  return !internal::method_row(method).family->one_preset;
}

double default_minutes(const std::string& method, Scale scale) {
  return internal::method_row(method).family->minutes(scale);
}

bool reads_option(const std::string& method, const std::string& option) {
  const internal::MethodFamily* own = internal::method_row(method).family;
  return std::ranges::none_of(kRows, [&](const MethodRow& row) {
    return row.family != own && row.family->own_options().contains(option);
  });
}

namespace {

void unused_of_pixels(const TrainOptions& options, const std::set<std::string>& given,
                      const Scene& scene, std::vector<std::string>& out) {
  const auto unused = [&](const char* name, const char* flag, const char* why) {
    if (given.contains(name)) out.push_back(fmt::format("{} is not used: {}", flag, why));
  };
  const auto has_mask = [](const View& view) { return !view.mask_path.empty(); };
  const auto has_depth = [](const View& view) { return !view.depth_path.empty(); };
  if (std::ranges::none_of(scene.views, has_mask))
    unused("masked_share", "--masked-share", "the capture has no masks");
  if (options.network.space == Space::kNdc && reads_option(options.method, "network.space")) {
    constexpr const char* kNdc = "normalised device coordinates are no distances";
    unused("point_depth", "--point-depth", kNdc);
    unused("depth_loss", "--depth-loss", kNdc);
    return;
  }
  if (scene.observations.empty())
    unused("point_depth", "--point-depth", "no photo is known to see a sparse point");
  if (std::ranges::none_of(scene.views, has_depth) && !(point_depth_share(options, scene) > 0))
    unused("depth_loss", "--depth-loss",
           "the capture has no depth maps, and distances of points are not learnt (--point-depth)");
}

}  // namespace

std::vector<std::string> unused_options(const TrainOptions& options,
                                        const std::set<std::string>& given, const Scene& scene) {
  std::vector<std::string> out;
  for (const std::string& name : given)
    if (!reads_option(options.method, name)) {
      OptionField field;
      field.name = name;
      out.push_back(option_flag(field) + " is not used by --method " + options.method);
    }
  unused_of_pixels(options, given, scene, out);
  internal::family_of(options).unused(options, given, scene, out);
  return out;
}

bool depends_on_length(const TrainOptions& options) {
  return internal::family_of(options).depends_on_length(options);
}

bool learns_from_reduced_photos(const TrainOptions& options) {
  return internal::family_of(options).learns_from_reduced_photos;
}

uint64_t training_memory_bytes(const TrainOptions& options, bool unbounded, int threads) {
  return internal::family_of(options).memory_bytes(options, unbounded, threads);
}

std::string internal::table_of(std::span<const MethodRow> rows) {
  std::vector<MethodLine> lines{{"method", "cast", "space", "encoding", "samples", "resampling",
                                 "networks", "density", "behind", "losses", "source"}};
  for (const MethodRow& row : rows) lines.push_back(row.family->line(row));
  std::array<size_t, kMethodColumns> widths{};
  for (const MethodLine& line : lines)
    for (size_t i = 0; i < kMethodColumns; ++i) widths[i] = std::max(widths[i], line[i].size());
  std::string out;
  for (const MethodLine& line : lines) {
    for (size_t i = 0; i + 1 < kMethodColumns; ++i)
      out += fmt::format("{:<{}}  ", line[i], widths[i]);
    out += line.back() + "\n";
  }
  return out;
}

std::string methods_table() { return internal::table_of(kRows); }

}  // namespace nerf
