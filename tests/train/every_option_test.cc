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
#include "train/option_lines.h"

namespace nerf {
namespace {

using test::option_lines;
using test::OptionLine;
using test::OptionSetting;

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
    {"nerfw", "recipe.empty_steps", "what is transient may be anywhere"},
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
  static constexpr int64_t kPlanned = 24;
  static bool grid() { return GetParam() == kGridMethod; }

  static OptionSetting usual() {
    OptionSetting s{
        test::capture_of(GetParam(), 8, 32),
        grid() ? test::tiny_options(kPlanned) : test::tiny_method_options(GetParam(), kPlanned)};
    s.options.grid_recipe.batch_samples = 1920;
    s.options.precision = Precision::kF32;
    return s;
  }

  // Steps after which it shows; a few where nothing may.
  static int64_t steps(bool expected) { return !expected ? 3 : grid() ? kPlanned : 8; }

  static Outcome outcome_of(const OptionSetting& s, int64_t steps, int threads = 2) {
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
  std::map<std::pair<void (*)(OptionSetting&), int64_t>, Outcome> usuals;  // of what is given
  TrainOptions all;
  int changing = 0;
  for (const OptionField& option : option_fields(all)) {
    const auto has_name = [&](const auto& x) { return x.option == option.name; };
    if (std::ranges::any_of(kExempt, has_name)) continue;
    const auto line = std::ranges::find_if(option_lines(), has_name);
    if (line == option_lines().end()) {
      ADD_FAILURE() << option.name << " has no line in the table";
      continue;
    }
    if (option.name == "precision" && bf16_unit() == Bf16Unit::kNone) continue;  // has no other
    SCOPED_TRACE(option.name);
    const auto idle = std::ranges::find_if(
        kIdle, [&](const Idle& i) { return i.method == GetParam() && i.option == option.name; });
    const bool expected = concerns(option, GetParam()) && idle == std::end(kIdle);
    OptionSetting setting = usual();
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
  for (const OptionLine& line : option_lines()) {
    EXPECT_TRUE(exists(line.option)) << line.option;
    EXPECT_EQ(std::ranges::count(option_lines(), line.option, &OptionLine::option), 1)
        << line.option;
  }
  for (const Exempt& e : kExempt) EXPECT_TRUE(exists(e.option)) << e.option;
  for (const Idle& i : kIdle) EXPECT_TRUE(exists(i.option)) << i.option;
}

}  // namespace
}  // namespace nerf
