// Every option changes the work of a training, as its counters tell, or the pictures of what it
// learnt; an option that did neither would be a lie. They are those of TrainOptions' visitor: a new
// one fails here until it has a line in the table below.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "nerf/model/radiance_field.h"
#include "nerf/model/renderer.h"
#include "nerf/train/trainer.h"
#include "support/synthetic_scene.h"
#include "support/tiny_options.h"

namespace nerf {
namespace {

struct Setting {
  test::SyntheticCapture capture;
  TrainOptions options;
};

struct Line {
  std::string option;
  std::vector<std::string> others;         // the first that is not the method's own value is taken
  void (*given)(Setting&) = [](auto&) {};  // without which there is nothing to change
};

// One camera sees a part of the region only, twice: a scene that moves has several moments.
void one_place(Setting& s) {
  Scene& scene = s.capture.scene;
  scene.train.resize(2);
  const size_t first = static_cast<size_t>(scene.train[0]);
  const size_t second = static_cast<size_t>(scene.train[1]);
  scene.views[second].pose = scene.views[first].pose;
  s.capture.photos.photos[second] = s.capture.photos.photos[first];
}
// Nothing is opaque behind photos with alpha, whatever NetworkOptions::opaque_end says.
void opaque_photos(Setting& s) {
  s.capture.scene.alpha = false;
  for (Photo& p : s.capture.photos.photos)
    for (size_t i = 3; i < p.pixels8.size(); i += 4) p.pixels8[i] = 255;
}
void in_fog(Setting& s) {
  opaque_photos(s);
  s.options.grid_recipe.medium.medium = LearntMedium::kFog;
}
// So thin that the last interval is not opaque by itself; a softplus is nowhere 0, so that one
// without end would be.
void thin_and_opaque_photos(Setting& s) {
  opaque_photos(s);
  s.options.network.density_bias = -8;
  s.options.network.last_interval = 1;
}
// Free space is known of scenes without bounds, from what photos see: here the sphere's middle.
void unbounded_with_points(Setting& s) {
  opaque_photos(s);
  s.capture.scene.unbounded = true;
  for (int i = 0; i < 30; ++i) {
    s.capture.scene.points.push_back({{0.02 * i - 0.3, 0, 0}, 0.5, 3});
    for (const int v : s.capture.scene.train) s.capture.scene.observations.push_back({v, i});
  }
}
// A sensor says where the sphere's middle is.
void with_depth(Setting& s) {
  for (Photo& p : s.capture.photos.photos) {
    const size_t pixels = static_cast<size_t>(p.width) * static_cast<size_t>(p.height);
    p.depth = {p.width, p.height, std::vector<uint16_t>(pixels, 0x4200)};  // 3 as a half float
  }
}
void learnt_light(Setting& s) {
  s.options.grid_recipe.light.appearance = {false, 4};
  s.options.grid_recipe.light.colour_correction = Switch::kOn;
}
void photos_of_two_moments(Setting& s) {
  for (size_t v = 0; v < s.capture.scene.views.size(); v += 2) s.capture.scene.views[v].time = 1;
}
void moving(Setting& s) {
  photos_of_two_moments(s);
  s.options.grid_recipe.motion.deform = Deform::kTranslation;
}
void cameras_at_once(Setting& s) {
  s.options.grid_recipe.cameras.first_step = 2;
  s.options.grid_recipe.cameras.first_levels = 2;
}
void refined(Setting& s) {
  cameras_at_once(s);
  s.options.grid_recipe.cameras.refine = RefineCameras::kOn;
}
void without_crop(Setting& s) { s.options.recipe.crop_steps = 0; }
void warmed_up(Setting& s) { s.options.recipe.warmup_rate = 0.1; }
void annealed(Setting& s) { s.options.recipe.anneal = true; }
// Without a view direction there is no layer that a photo's numbers join.
void without_codes(Setting& s) {
  NetworkOptions& n = s.options.network;
  n.image_code = n.camera_code = n.transient_code = 0;
}
// Cameras' numbers stand in place of photos'.
void without_cameras(Setting& s) { s.options.network.camera_code = 0; }
void with_codes(Setting& s) {
  without_cameras(s);
  s.options.network.image_code = 4;
}
// Integrated encodings have no points that could be moved.
void standing(Setting& s) {
  s.options.network.deform.warp = WarpKind::kNone;
  s.options.network.deform.slice = Slice::kNone;
  s.options.network.deform.still_start = false;  // of warps alone
}
void transient(Setting& s) { s.options.network.transient_code = 4; }
// Photos of several moments, by two cameras, with points that stand still: what every capture of a
// scene that moves has.
void moments(Setting& s) {
  s.capture.scene.points.clear();
  const size_t views = s.capture.scene.views.size();
  for (size_t i = 0; i < views; ++i) {
    View& view = s.capture.scene.views[i];
    view.time = static_cast<double>(i) / static_cast<double>(views - 1);
    view.ids = {static_cast<int>(i), static_cast<int>(i), static_cast<int>(i % 2)};
    s.capture.scene.points.push_back({{0.1 * static_cast<double>(i) - 0.4, 0.2, 0.1}, 0.5, 3});
  }
  // So much that a few steps show it.
  s.options.recipe.curriculum_steps = 0;
}
void two_cameras(Setting& s) {
  moments(s);
  s.options.network.view_dependence = true;
}
void moves_anywhere(Setting& s) {
  moments(s);
  s.options.network.encoding = Encoding::kFrequency;
  s.options.network.deform.still_start = false;
}
void warped(Setting& s) {
  moves_anywhere(s);
  DeformOptions& d = s.options.network.deform;
  if (d.warp == WarpKind::kNone) d.warp = WarpKind::kSe3;
  if (d.slice == Slice::kNone) d.code = 4;
}
void warped_by_time(Setting& s) {
  warped(s);
  s.options.network.deform.code = 0;
}
void translated(Setting& s) {
  warped(s);
  s.options.network.deform.warp = WarpKind::kTranslation;
}
void sliced(Setting& s) {
  warped(s);
  s.options.network.deform.slice = Slice::kSheet;
}
void sliced_in_steps(Setting& s) {
  sliced(s);
  s.options.recipe.ambient_steps = 8;
}
void elastic_for_steps(Setting& s) {
  warped(s);
  s.options.recipe.elastic = 10;
  s.options.recipe.elastic_steps = 1;
  s.options.recipe.elastic_fall_steps = 4;
}
void held_still(Setting& s) {
  warped(s);
  s.options.recipe.still = 10;
}
// What photos see is in a part of the distances that samples would have.
void sampled_by_points(Setting& s) {
  unbounded_with_points(s);
  s.options.recipe.near = s.options.recipe.far = 0;
}
// Cones have intervals, which coarse+fine resampling does not.
void intervals(Setting& s) {
  IntervalOptions& sampling = s.options.network.sampling;
  if (!sampling.intervals()) sampling.resampling = Resampling::kBlurred;
}
// The levels before the last have a network of their own, or learn colours.
void own_network(Setting& s) {
  if (s.options.network.shared) s.options.recipe.coarse = std::max(s.options.recipe.coarse, 0.1_r);
  s.options.network.shared = false;
}
void coloured_proposals(Setting& s) {
  s.options.network.proposal_colour = true;
  s.options.recipe.coarse = std::max(s.options.recipe.coarse, 0.1_r);
}
// What trains them without colours.
void bounded_proposals(Setting& s) {
  own_network(s);
  s.options.network.sampling.resampling = Resampling::kProposal;
  s.options.recipe.coarse = s.options.recipe.interlevel = 1;
}
// So dense that little light reaches most samples of a ReLU, and most of a softplus stop little.
void dense(Setting& s) { s.options.network.density_bias = 2; }
void dense_and_skipping(Setting& s) {
  dense(s);
  s.options.recipe.negligible = 0.25_r;
}

const std::vector<Line>& table() {
  static const std::vector<Line> lines = {
      {"seed", {"2"}},
      {"steps", {"160"}},
      {"plan_changes", {"10:60"}},
      {"background", {"black"}},
      {"batch_samples", {"2880"}},
      {"rate", {"0.02"}},
      {"precision", {"bf16"}},
      {"network_rate", {"0.5"}},
      {"final_rate", {"0.5"}},
      {"warmup_steps", {"16"}, warmed_up},
      {"hold", {"0.5"}},
      {"beta1", {"0.9"}},
      {"final_beta1", {"0.8"}},
      {"beta2", {"0.99"}},
      {"final_beta2", {"0.95"}},
      {"huber_delta", {"0.05"}},
      {"distortion", {"0.01"}},
      {"depth_loss", {"0.5"}, with_depth},
      {"point_depth", {"0.3"}, unbounded_with_points},
      {"early_samples", {"1"}},
      {"shared_colour", {"0"}},
      {"stop_transmittance", {"0.1"}},
      {"gradient_roulette", {"0"}},
      {"occupancy_threshold", {"0.2"}},
      {"keep_unseen", {"true"}, one_place},
      {"keep_transparent", {"true"}},
      {"keep_free", {"true"}, unbounded_with_points},
      {"robust", {"0.4"}},
      {"appearance", {"4"}},
      {"colour_correction", {"on"}},
      {"code_rate", {"0.5"}, learnt_light},
      {"code_decay", {"50"}, learnt_light},
      {"colour_rate", {"0.5"}, learnt_light},
      {"colour_decay", {"50"}, learnt_light},
      {"deform", {"translation"}, photos_of_two_moments},
      {"ambient", {"2"}, moving},
      {"motion_rate", {"0.9"}, moving},
      {"motion_width", {"16"}, moving},
      {"medium", {"water"}, opaque_photos},
      {"medium_rate", {"0.1"}, in_fog},
      {"refine_cameras", {"on"}, cameras_at_once},
      {"camera_rate", {"0.01"}, refined},
      {"camera_final_rate", {"0.5"}, refined},
      {"camera_first_step", {"8"}, refined},
      {"camera_steps", {"2"}, refined},
      {"camera_prior", {"100"}, refined},
      {"camera_lens", {"false"}, refined},
      {"camera_centre", {"true"}, refined},
      {"camera_first_levels", {"3"}, refined},
      {"camera_levels_open", {"0.9"}, refined},
      {"grid.levels", {"3"}},
      {"grid.log2_entries", {"11"}},
      {"grid.features", {"2"}},
      {"grid.base_resolution", {"16", "8"}},
      {"grid.finest_resolution", {"0", "64"}},
      {"grid.hidden", {"32"}},
      {"grid.density_layers", {"2"}},
      {"grid.colour_layers", {"2", "1"}},
      {"grid.geometry_features", {"8"}},
      {"grid.occupancy_side", {"32"}},
      {"grid.max_samples", {"8"}},
      {"grid.min_samples", {"8"}},
      {"grid.samples_per_cell", {"1"}},
      {"grid.uniform_share", {"0.1"}},
      {"grid.min_transmittance", {"0.5"}},
      {"network.cast", {"cone", "point"}, intervals},
      {"network.space", {"contract", "identity"}},
      {"network.encoding", {"integrated", "frequency"}, standing},
      {"network.position_degrees", {"3"}},
      {"network.direction_degrees", {"2"}},
      {"network.view_dependence", {"false"}, without_codes},
      {"network.sampling.resampling", {"blurred", "proposal"}, coloured_proposals},
      {"network.sampling.spacing", {"inverse", "uniform"}},
      {"network.sampling.coarse", {"12"}},
      {"network.sampling.fine", {"12"}},
      {"network.sampling.rounds", {"2", "1"}},
      {"network.sampling.padding", {"0.1"}},
      {"network.shared", {"true", "false"}, coloured_proposals},
      {"network.depth", {"2"}},
      {"network.width", {"16"}},
      {"network.skip", {"1"}},
      {"network.bottleneck", {"16"}},
      {"network.view_width", {"8"}},
      {"network.image_code", {"2"}, without_cameras},
      {"network.camera_code", {"4", "2"}, two_cameras},
      {"network.transient_code", {"2"}},
      {"network.transient_depth", {"1"}, transient},
      {"network.transient_width", {"8"}, transient},
      {"network.code_spread", {"20"}, with_codes},
      {"network.proposal_depth", {"2"}, own_network},
      {"network.proposal_width", {"16"}, own_network},
      {"network.proposal_colour", {"false", "true"}, bounded_proposals},
      {"network.deform.warp", {"se3", "translation"}, moves_anywhere},
      {"network.deform.degrees", {"2"}, warped},
      {"network.deform.depth", {"3"}, warped},
      {"network.deform.width", {"8"}, warped},
      {"network.deform.skip", {"0", "2"}, warped},
      {"network.deform.code", {"3", "0"}, warped},
      {"network.deform.time_degrees", {"2"}, warped_by_time},
      {"network.deform.still_start", {"true", "false"}, translated},
      {"network.deform.slice", {"plane", "sheet"}, moves_anywhere},
      {"network.deform.ambient", {"3"}, sliced},
      {"network.deform.ambient_degrees", {"2"}, sliced},
      {"network.deform.sheet_degrees", {"2"}, sliced},
      {"network.deform.sheet_depth", {"3"}, sliced},
      {"network.deform.sheet_width", {"8"}, sliced},
      {"network.density", {"softplus", "relu"}},
      {"network.density_bias", {"0.5"}},
      {"network.colour_padding", {"0.1"}},
      {"network.opaque_end", {"true", "false"}, thin_and_opaque_photos},
      {"network.last_interval", {"0.01"}},
      {"network.initialisation", {"he", "glorot"}},
      {"recipe.rays", {"48"}},
      {"recipe.one_photo", {"true", "false"}, without_crop},  // a crop is of one photo anyway
      {"recipe.crop_steps", {"1"}},
      {"recipe.crop", {"0.25"}},
      {"recipe.coarse", {"0.5", "1"}, coloured_proposals},
      {"recipe.interlevel", {"1000"}, coloured_proposals},
      {"recipe.distortion", {"0.5"}},
      {"recipe.charbonnier", {"0.1"}},
      {"recipe.density_noise", {"1"}},
      {"recipe.beta2", {"0.9"}},
      {"recipe.epsilon", {"0.001"}},
      {"recipe.clip", {"0.00001"}},
      {"recipe.warmup_rate", {"0.5"}},
      {"recipe.near", {"0.7"}},
      {"recipe.far", {"4.5"}},
      {"recipe.photo_range", {"true", "false"}, sampled_by_points},
      {"recipe.transient_density", {"1"}, transient},
      {"recipe.least_deviation", {"0.2"}, transient},
      {"recipe.curriculum_steps", {"30"}, moments},
      {"recipe.window_steps", {"400"}, warped},
      {"recipe.ambient_start", {"6"}, sliced_in_steps},
      {"recipe.ambient_steps", {"400"}, sliced},
      {"recipe.elastic", {"10"}, warped},
      {"recipe.elastic_steps", {"2"}, elastic_for_steps},
      {"recipe.elastic_fall_steps", {"6"}, elastic_for_steps},
      {"recipe.still", {"10"}, warped},
      {"recipe.still_points", {"20"}, held_still},
      {"recipe.skip", {"false"}, dense_and_skipping},
      {"recipe.negligible", {"0.25"}, dense},
      {"recipe.anneal", {"true", "false"}},
      {"recipe.anneal_steps", {"2"}, annealed},
  };
  return lines;
}

// Options that have no line.
struct Exempt {
  const char *option, *why;
};
constexpr Exempt kExempt[] = {
    {"method", "every method runs all of these tests"},
};

// Options of a method that change nothing with it.
struct Idle {
  const char *method, *option, *why;
};
constexpr Idle kIdle[] = {
    {"nerf", "network.sampling.padding", "coarse+fine samples come from weights as they are"},
    {"nerf", "recipe.anneal", "only proposals are annealed"},
    {"nerf", "recipe.anneal_steps", "only proposals are annealed"},
    {"mipnerf", "recipe.anneal", "only proposals are annealed"},
    {"mipnerf", "recipe.anneal_steps", "only proposals are annealed"},
    {"mipnerf", "network.last_interval", "samples are intervals"},
    {"mipnerf360", "network.last_interval", "samples are intervals"},
    {"nerfw", "network.sampling.padding", "coarse+fine samples come from weights as they are"},
    {"nerfw", "recipe.anneal", "only proposals are annealed"},
    {"nerfw", "recipe.anneal_steps", "only proposals are annealed"},
    {"nerfw", "recipe.skip", "what is transient may be anywhere"},
    {"nerfw", "recipe.negligible", "what is transient may be anywhere"},
    {"dnerf", "network.sampling.padding", "coarse+fine samples come from weights as they are"},
    {"dnerf", "recipe.anneal", "only proposals are annealed"},
    {"dnerf", "recipe.anneal_steps", "only proposals are annealed"},
    {"nerfies", "network.sampling.padding", "coarse+fine samples come from weights as they are"},
    {"nerfies", "recipe.anneal", "only proposals are annealed"},
    {"nerfies", "recipe.anneal_steps", "only proposals are annealed"},
    {"hypernerf", "network.sampling.padding", "coarse+fine samples come from weights as they are"},
    {"hypernerf", "recipe.anneal", "only proposals are annealed"},
    {"hypernerf", "recipe.anneal_steps", "only proposals are annealed"},
};

// Whether an option is one of the method's, by the heading that its help stands under.
bool concerns(const OptionField& field, const std::string& method) {
  const bool grid = method == kGridMethod;
  if (field.heading.find("grid method") != std::string::npos) return grid;
  return field.heading.find("papers' methods") == std::string::npos || !grid;
}

// What must not be the same: the counters of work, or a picture from where no photo was taken.
struct Outcome {
  std::array<int64_t, 5> work{};
  std::vector<Real> picture;
  bool operator==(const Outcome&) const = default;
  double most_beside(const Outcome& other) const {
    double most = 0;
    for (size_t i = 0; i < picture.size(); ++i)
      most = std::max(most, std::fabs(double{picture[i]} - double{other.picture[i]}));
    return most;
  }
};
// What another order of the same sums may change (2e-6 of a layer's output, five layers) is no
// effect of an option. The least of one is 4e-5: the weight of a loss that is a network's only one,
// which Adam takes out again but for its epsilon.
constexpr double kRoundings = 1e-5;

class EveryOption : public ::testing::TestWithParam<std::string> {
 protected:
  static constexpr int64_t kPlanned = 40;
  static bool grid() { return GetParam() == kGridMethod; }

  static Setting usual() {
    Setting s{
        test::capture_of(GetParam(), 8, 32),
        grid() ? test::tiny_options(kPlanned) : test::tiny_method_options(GetParam(), kPlanned)};
    s.options.grid_recipe.batch_samples = 1920;
    s.options.precision = Precision::kF32;
    return s;
  }

  // Steps after which it shows; a few where nothing may.
  static int64_t steps(bool expected) { return !expected ? 3 : grid() ? kPlanned : 8; }

  static Outcome outcome_of(const Setting& s, int64_t steps, int threads = 2) {
    ThreadPool pool(threads);
    Trainer trainer(s.capture.scene, s.capture.photos, s.options, pool);
    Outcome out;
    for (int64_t i = 0; i < steps; ++i) {
      const StepReport r = trainer.step();
      const int64_t work[] = {r.rays, r.samples, r.colours, r.learning, r.rows};
      for (size_t k = 0; k < out.work.size(); ++k) out.work[k] += work[k];
    }
    const RadianceField field = trainer.snapshot();
    RenderOptions options;
    options.background = field.info().background;
    options.precision = Precision::kF32;
    const size_t view = static_cast<size_t>(s.capture.scene.test.front());
    out.picture =
        render(field, test::sphere_camera(12), s.capture.scene.views[view].pose, options, pool).rgb;
    return out;
  }
};

TEST_P(EveryOption, ChangesWorkOrPicturesWithTheMethodsItIsFor) {
  std::map<std::pair<void (*)(Setting&), int64_t>, Outcome> usuals;  // of what is given
  TrainOptions all;
  int changing = 0;
  for (const OptionField& option : option_fields(all)) {
    const auto has_name = [&](const auto& x) { return x.option == option.name; };
    if (std::ranges::any_of(kExempt, has_name)) continue;
    const auto line = std::ranges::find_if(table(), has_name);
    if (line == table().end()) {
      ADD_FAILURE() << option.name << " has no line in the table";
      continue;
    }
    if (option.name == "precision" && bf16_unit() == Bf16Unit::kNone) continue;  // has no other
    SCOPED_TRACE(option.name);
    const auto idle = std::ranges::find_if(
        kIdle, [&](const Idle& i) { return i.method == GetParam() && i.option == option.name; });
    const bool expected = concerns(option, GetParam()) && idle == std::end(kIdle);
    Setting setting = usual();
    line->given(setting);
    Outcome& before = usuals[{line->given, steps(expected)}];
    if (before.picture.empty()) before = outcome_of(setting, steps(expected));
    const std::vector<OptionField> fields = option_fields(setting.options);
    const OptionField& field = *std::ranges::find(fields, option.name, &OptionField::name);
    const std::string own = option_text(field);
    for (const std::string& other : line->others)
      if (option_text(field) == own) set_option_text(field, other, "the table");
    EXPECT_NE(option_text(field), own) << "the table has no other value";
    const Outcome after = outcome_of(setting, steps(expected));
    const std::string what = own + " or " + option_text(field);
    if (expected) {
      EXPECT_TRUE(after.work != before.work || after.most_beside(before) > kRoundings) << what;
    } else {
      EXPECT_TRUE(after == before)
          << what << (idle == std::end(kIdle) ? "" : std::string(": ") + idle->why);
    }
    changing += expected;
  }
  EXPECT_GT(changing, 40);
}

// Neither by doing the same again, nor by sharing it among other threads.
TEST_P(EveryOption, NothingElseChangesThem) {
  const Outcome one = outcome_of(usual(), steps(true), 1);
  EXPECT_EQ(outcome_of(usual(), steps(true), 1), one);
  EXPECT_EQ(outcome_of(usual(), steps(true), 3), one);
  const auto [least, most] = std::ranges::minmax(one.picture);
  EXPECT_GT(most - least, 0.02_r) << "there is something to see";
}

INSTANTIATE_TEST_SUITE_P(Methods, EveryOption,
                         ::testing::Values("grid", "nerf", "mipnerf", "mipnerf360", "nerfw",
                                           "dnerf", "nerfies", "hypernerf"),
                         [](const auto& info) { return info.param; });

TEST(EveryOption, TheTableHasNoOther) {
  TrainOptions all;
  const std::vector<OptionField> fields = option_fields(all);
  const auto exists = [&](const std::string& name) {
    return std::ranges::count(fields, name, &OptionField::name) == 1;
  };
  for (const Line& line : table()) {
    EXPECT_TRUE(exists(line.option)) << line.option;
    EXPECT_EQ(std::ranges::count(table(), line.option, &Line::option), 1) << line.option;
  }
  for (const Exempt& e : kExempt) EXPECT_TRUE(exists(e.option)) << e.option;
  for (const Idle& i : kIdle) EXPECT_TRUE(exists(i.option)) << i.option;
}

}  // namespace
}  // namespace nerf
