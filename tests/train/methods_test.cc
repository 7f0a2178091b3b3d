// The table of methods: rows, presets, schedules, and what cannot be trained.
#include "nerf/train/methods.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "nerf/model/network_field.h"
#include "support/network_options.h"
#include "support/synthetic_scene.h"
#include "support/temp_folder.h"
#include "support/tiny_options.h"
#include "train/method_rows.h"

namespace nerf {
namespace {

using test::contains;
using test::error_of;
using test::sphere_capture;
using test::tiny_method_options;

// A row with other parts: what it builds and what is printed are both of the other parts.
TEST(Methods, AChangedRowChangesTheModelAndTheTable) {
  using namespace internal;
  std::vector<MethodRow> rows(method_rows().begin(), method_rows().end());
  ASSERT_EQ(table_of(rows), methods_table());
  rows[2].paper = [](TrainOptions& o) {
    method_rows()[2].paper(o);
    o.network.space = Space::kContract;
    o.network.position_degrees = 7;
    o.network.opaque_end = true;
    o.recipe.distortion = 0.25_r;
  };
  const TrainOptions built = options_of(rows[2], Scale::kPaper);
  // The encoding of 7 frequencies along three axes, sine and cosine, feeds the first layer.
  EXPECT_EQ(place_networks(built.network)[0].trunk[0].in, 2 * 3 * 7);
  const std::string table = table_of(rows);
  const std::string line = table.substr(table.find("\nmipnerf ") + 1);
  for (const char* part : {"contract", "integrated 7/4", "opaque end", "distortion 0.25"})
    EXPECT_LT(line.find(part), line.find('\n')) << part << " in " << line;
}

// The publications' recipes, from the papers and their authors' configurations.
TEST(Methods, PaperRecipes) {
  const TrainOptions nerf = method_options("nerf", Scale::kPaper);
  EXPECT_EQ(nerf.steps, 500000);
  EXPECT_EQ(nerf.rate, 5e-4);
  EXPECT_EQ(nerf.final_rate, 0.1);
  EXPECT_EQ(nerf.warmup_steps, 0);
  EXPECT_EQ(nerf.recipe.rays, 1024);
  EXPECT_TRUE(nerf.recipe.one_photo);
  EXPECT_EQ(nerf.recipe.crop_steps, 500);
  EXPECT_EQ(nerf.recipe.crop, 0.5);
  EXPECT_EQ(nerf.recipe.coarse, 1);
  EXPECT_EQ(nerf.recipe.epsilon, 1e-7);
  EXPECT_EQ(nerf.recipe.beta2, 0.999);
  EXPECT_EQ(nerf.recipe.clip, 0);
  EXPECT_EQ(nerf.recipe.negligible, 0);

  const TrainOptions mip = method_options("mipnerf", Scale::kPaper);
  EXPECT_EQ(mip.steps, 1000000);
  EXPECT_EQ(mip.rate, 5e-4);
  EXPECT_EQ(mip.final_rate, 0.01);  // 5e-6 in the end
  EXPECT_EQ(mip.warmup_steps, 2500);
  EXPECT_EQ(mip.recipe.warmup_rate, 0.01);
  EXPECT_EQ(mip.recipe.rays, 4096);
  EXPECT_EQ(mip.recipe.coarse, 0.1_r);
  EXPECT_EQ(mip.recipe.epsilon, 1e-8);
  EXPECT_EQ(mip.recipe.clip, 0);
  EXPECT_EQ(mip.network.density_bias, -1);
  EXPECT_EQ(mip.network.colour_padding, 0.001_r);
  EXPECT_EQ(mip.network.sampling.padding, 0.01_r);

  const TrainOptions mip360 = method_options("mipnerf360", Scale::kPaper);
  EXPECT_EQ(mip360.steps, 250000);
  EXPECT_EQ(mip360.rate, 2e-3);
  EXPECT_EQ(mip360.final_rate, 0.01);
  EXPECT_EQ(mip360.warmup_steps, 512);
  EXPECT_EQ(mip360.recipe.warmup_rate, 0.01);
  EXPECT_EQ(mip360.recipe.rays, 16384);
  EXPECT_FALSE(mip360.recipe.one_photo);
  EXPECT_EQ(mip360.recipe.coarse, 0);
  EXPECT_EQ(mip360.recipe.interlevel, 1);
  EXPECT_EQ(mip360.recipe.distortion, 0.01_r);
  EXPECT_EQ(mip360.recipe.charbonnier, 0.001_r);
  EXPECT_EQ(mip360.recipe.epsilon, 1e-6);
  EXPECT_EQ(mip360.recipe.clip, 0.001);
  EXPECT_EQ(mip360.recipe.near, 0.2);
  EXPECT_EQ(mip360.recipe.far, 1e6);
  EXPECT_TRUE(mip360.recipe.anneal);
  EXPECT_EQ(mip360.recipe.anneal_steps, 0);  // all

  const TrainOptions nerfw = method_options("nerfw", Scale::kPaper);
  EXPECT_EQ(nerfw.steps, 300000);
  EXPECT_EQ(nerfw.rate, 5e-4);
  EXPECT_EQ(nerfw.recipe.rays, 2048);
  EXPECT_FALSE(nerfw.recipe.one_photo);
  EXPECT_EQ(nerfw.recipe.coarse, 0.5_r);
  EXPECT_EQ(nerfw.recipe.transient_density, 0.01_r);
  EXPECT_EQ(nerfw.recipe.least_deviation, 0.03_r);
  EXPECT_TRUE(nerfw.recipe.photo_range);
}

// lr0^(1 - p) lr1^p at progress p, below it a quarter sine from warmup_rate to 1 (methods of
// mip-NeRF's math.py); NeRF's lr0 0.1^p has no warm-up.
TEST(Methods, RatesFollowTheSchedule) {
  const auto c = sphere_capture();
  ThreadPool pool(1);
  for (const char* method : {"nerf", "mipnerf"}) {
    TrainOptions o = tiny_method_options(method, 16);
    const TrainOptions paper = method_options(method, Scale::kPaper);
    o.rate = paper.rate;
    o.final_rate = paper.final_rate;
    o.hold = paper.hold;
    o.recipe.warmup_rate = paper.recipe.warmup_rate;
    o.warmup_steps = paper.warmup_steps > 0 ? 8 : 0;
    Trainer trainer(c.scene, c.photos, o, pool);
    for (int i = 0; i < 16; ++i) {
      const double rise = o.warmup_steps == 0 || i >= 8
                              ? 1
                              : 0.01 + 0.99 * std::sin(std::numbers::pi / 2 * i / 8.0);
      const double want = paper.rate * rise * std::pow(paper.final_rate, i / 16.0);
      EXPECT_NEAR(trainer.step().rate, want, 1e-6 * want) << method << " step " << i;
    }
  }
}

TEST(Methods, TheTableIsMadeFromTheOptionsThatBuildTheModels) {
  const std::string table = methods_table();
  for (const std::string& name : method_names()) EXPECT_NE(table.find(name), std::string::npos);
  EXPECT_NE(table.find("8x256 + 8x256"), std::string::npos);
  EXPECT_NE(table.find("64+64+32 inverse"), std::string::npos);
  EXPECT_NE(table.find("off-axis 12/4"), std::string::npos);
  const TrainOptions o = method_options("mipnerf360", Scale::kPaper);
  EXPECT_EQ(o.network.position_degrees, 12);
  EXPECT_EQ(o.network.sampling.fine, 32);
  EXPECT_EQ(o.steps, 250000);
}

// The model layer's tests do not see the table and state the papers' networks once more.
TEST(Methods, TheTablesModelsAreThoseOfTheModelLayersTests) {
  const auto text = [](const std::string& method) {
    return options_text(method_options(method, Scale::kPaper).network);
  };
  EXPECT_EQ(text("nerf"), options_text(test::nerf_options()));
  EXPECT_EQ(text("mipnerf"), options_text(test::mipnerf_options()));
  EXPECT_EQ(text("mipnerf360"), options_text(test::mipnerf360_options()));
  EXPECT_EQ(text("nerfw"), options_text(test::nerfw_options()));
}

TEST(Methods, EveryPresetIsValid) {
  for (const std::string& name : method_names())
    for (Scale scale : {Scale::kTiny, Scale::kSmall, Scale::kPaper})
      EXPECT_EQ(error_of([&] { validate_options(method_options(name, scale)); }), "") << name;
}

TEST(Methods, AnUnknownNameIsAnErrorWithAHint) {
  EXPECT_TRUE(test::contains(error_of([] { method_options("mipnef", Scale::kTiny); }), "mipnerf"));
}

TEST(Methods, ANetworkThatNothingTrainsIsAnError) {
  TrainOptions nerf = method_options("nerf", Scale::kTiny);
  nerf.recipe.coarse = 0;
  EXPECT_TRUE(contains(error_of([&] { validate_options(nerf); }), "--recipe-coarse"));
  nerf.network.shared = true;
  EXPECT_EQ(error_of([&] { validate_options(nerf); }), "");
  TrainOptions mip360 = method_options("mipnerf360", Scale::kTiny);
  mip360.recipe.interlevel = 0;
  EXPECT_TRUE(contains(error_of([&] { validate_options(mip360); }), "--recipe-interlevel"));
}

TEST(Methods, RangesThatHoldNoSamplesAreErrors) {
  const auto c = sphere_capture();
  ThreadPool pool(1);
  const auto error = [&](const char* method, auto change) {
    TrainOptions o = tiny_method_options(method, 1);
    change(o);
    return error_of([&] { Trainer trainer(c.scene, c.photos, o, pool); });
  };
  EXPECT_TRUE(contains(error("nerf", [](TrainOptions& o) { o.recipe.near = 10; }),
                       "--recipe-near, --recipe-far"));
  EXPECT_TRUE(contains(error("mipnerf360", [](TrainOptions& o) { o.recipe.far = 0.1; }),
                       "--recipe-near, --recipe-far"));
  EXPECT_TRUE(contains(error("mipnerf360", [](TrainOptions& o) { o.network.space = Space::kNdc; }),
                       "--network-sampling-spacing"));
}

// Where the papers' code has a rule it counts; what is asked for counts more.
TEST(Methods, SamplesBeginAndEndAsInThePapersCode) {
  auto c = sphere_capture();
  ThreadPool pool(1);
  const auto first_loss = [&](double near) {
    TrainOptions o = tiny_method_options("nerf", 1);
    o.recipe.near = near;
    Trainer trainer(c.scene, c.photos, o, pool);
    return trainer.step().loss;
  };
  const double own = first_loss(0), asked = first_loss(1.5);
  c.scene.published_near = 1;
  const double nearer = first_loss(0);
  EXPECT_NE(nearer, own);
  c.scene.published_near = 0;
  c.scene.published_far = 4.5;
  EXPECT_NE(first_loss(0), own);
  EXPECT_NE(first_loss(0), nearer);
  c.scene.published_near = 1;
  c.scene.published_far = c.scene.far;
  EXPECT_EQ(first_loss(1.5), asked);
}

}  // namespace
}  // namespace nerf
