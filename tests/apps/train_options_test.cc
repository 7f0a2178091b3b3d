// Texts that nerf_train makes from its options.
#include "train_options.h"

#include <gtest/gtest.h>

#include "support/temp_folder.h"

namespace nerf {
namespace {

namespace fs = std::filesystem;
using test::TempFolder;

TEST(TrainOptionsText, EquivalentCommandKeepsWhatWasGiven) {
  apps::TrainCommand command;
  command.scene = "my photos/it's";
  command.minutes = 3;
  command.downscale = 2;
  command.train.rate = 0.5;
  EXPECT_EQ(apps::equivalent_command(command, {77, 0.1, {}}),
            "nerf_train 'my photos/it'\\''s' --downscale 2 --rate 0.5 --steps 77");
  EXPECT_EQ(apps::equivalent_command(command, {77, 0.1, {{{20, 60}, {40, 90}}}}),
            "nerf_train 'my photos/it'\\''s' --downscale 2 --plan-changes 20:60,40:90 --rate 0.5 "
            "--steps 77");
}

TEST(TrainOptionsText, ABackgroundNeedsPhotosWithAlpha) {
  Scene opaque, cut_out;
  cut_out.alpha = true;
  EXPECT_EQ(apps::unused_options({}, {"background"}, opaque),
            std::vector<std::string>{"--background is not used: the photos have no alpha"});
  EXPECT_TRUE(apps::unused_options({}, {"background"}, cut_out).empty());
  EXPECT_TRUE(apps::unused_options({}, {}, opaque).empty());
  apps::TrainCommand nerf;
  nerf.train = method_options("nerf", Scale::kTiny);
  EXPECT_TRUE(apps::unused_options(nerf, {"recipe.near"}, opaque).empty());
  nerf.train.network.space = Space::kNdc;
  const std::vector<std::string> unused = apps::unused_options(nerf, {"recipe.near"}, opaque);
  ASSERT_EQ(unused.size(), 1u);
  EXPECT_EQ(unused[0].find("--recipe-near and --recipe-far are not used"), 0u) << unused[0];
}

TEST(TrainOptionsText, TheHullNeedsPhotosWithAlpha) {
  Scene opaque, cut_out;
  cut_out.alpha = true;
  EXPECT_EQ(apps::unused_options({}, {"keep_transparent"}, opaque),
            std::vector<std::string>{"--keep-transparent is not used: the photos have no alpha"});
  EXPECT_TRUE(apps::unused_options({}, {"keep_transparent"}, cut_out).empty());
}

TEST(TrainOptionsText, ALossByDepthMapsNeedsSome) {
  Scene scene;
  scene.views.resize(2);
  EXPECT_EQ(apps::unused_options({}, {"depth_loss"}, scene),
            std::vector<std::string>{"--depth-loss is not used: the capture has no depth maps"});
  scene.views[1].depth_path = "depth/1.png";
  EXPECT_TRUE(apps::unused_options({}, {"depth_loss"}, scene).empty());
}

TEST(TrainOptionsText, OnlyProposalsAreAnnealed) {
  const std::set<std::string> given = {"recipe.anneal", "recipe.anneal_steps"};
  for (const char* method : {"nerf", "mipnerf", "mipnerf360"}) {
    apps::TrainCommand command;
    command.train = method_options(method, Scale::kTiny);
    EXPECT_EQ(apps::unused_options(command, given, {}).size(),
              std::string(method) == "mipnerf360" ? 0u : 1u)
        << method;
  }
}

// So that the steps of a plan, taken by themselves, are the same ones.
TEST(TrainOptionsText, APlanOfMinutesAnnealsOverStepsThatItKnows) {
  apps::TrainCommand command;
  command.train.method = "mipnerf360";
  command.scale = Scale::kPaper;
  EXPECT_EQ(apps::with_preset(command, {}).train.recipe.anneal_steps, 0);
  command.minutes = 60;
  EXPECT_EQ(apps::with_preset(command, {}).train.recipe.anneal_steps, kAnnealSteps);
  const std::string again =
      apps::equivalent_command(apps::with_preset(command, {"minutes", "scale"}), {5000, 0.1, {}});
  EXPECT_NE(again.find("--recipe-anneal-steps " + std::to_string(kAnnealSteps)), std::string::npos)
      << again;
  EXPECT_THROW(apps::with_preset(command, {"recipe.anneal_steps"}), Error);
  command.train.recipe.anneal_steps = 100;
  EXPECT_EQ(apps::with_preset(command, {"recipe.anneal_steps"}).train.recipe.anneal_steps, 100);
}

// Neither minutes nor steps: the default's minutes are a plan of minutes like any other.
TEST(TrainOptionsText, ADefaultOfMinutesIsAPlanOfMinutes) {
  apps::TrainCommand command;
  command.train.method = "mipnerf360";
  command.scale = Scale::kTiny;
  const apps::TrainCommand decided = apps::with_preset(command, {"scale"});
  EXPECT_EQ(decided.minutes, apps::default_minutes("mipnerf360", Scale::kTiny));
  EXPECT_THROW(apps::with_preset(command, {"scale", "recipe.anneal_steps"}), Error);
  command.train.steps = 100;
  EXPECT_FALSE(apps::with_preset(command, {"scale", "steps"}).minutes);
  EXPECT_EQ(apps::with_preset(command, {"scale", "steps", "recipe.anneal_steps"})
                .train.recipe.anneal_steps,
            0);
  command.train.steps = 0;
  command.resume = true;  // the run's own length
  EXPECT_FALSE(apps::with_preset(command, {}).minutes);
}

TEST(TrainOptionsText, NearAndFarOfTheCaptureGoBeforeAMethodsOwn) {
  apps::TrainCommand command;
  command.train.method = "mipnerf360";
  command.train.steps = 100;
  const NetworkRecipe usual = apps::with_preset(command, {"steps"}).train.recipe;
  EXPECT_GT(usual.near, 0);
  command.near = 0.5;
  NetworkRecipe recipe = apps::with_preset(command, {"steps", "near"}).train.recipe;
  EXPECT_EQ(recipe.near, 0);  // the scene's
  EXPECT_EQ(recipe.far, usual.far);
  command.far = 9;
  EXPECT_EQ(apps::with_preset(command, {"steps", "near", "far"}).train.recipe.far, 0);
  command.train.recipe.near = 0.1;
  recipe = apps::with_preset(command, {"steps", "near", "recipe.near"}).train.recipe;
  EXPECT_EQ(recipe.near, 0.1);
  EXPECT_EQ(command.scene_options().near, 0.5);
  EXPECT_EQ(command.scene_options().far, 9);
  EXPECT_EQ(apps::unused_options({}, {"far"}, {}),
            std::vector<std::string>{"--far is not used: the scene ends with its box (--bbox)"});
}

// The help marks them, and a warning names them.
TEST(TrainOptionsText, WhatTheGridAloneReadsIsNotUsedByAPapersMethod) {
  Scene cut_out;
  cut_out.alpha = cut_out.unbounded = true;  // so that nothing of the scene's leaves an option out
  apps::TrainCommand grid, nerf;
  nerf.train = method_options("nerf", Scale::kTiny);
  int grid_alone = 0;
  for (const OptionField& field : option_fields(nerf.train)) {
    if (field.name.find('.') != std::string::npos) continue;  // of a group
    EXPECT_TRUE(apps::unused_options(grid, {field.name}, cut_out).empty()) << field.name;
    const std::vector<std::string> unused = apps::unused_options(nerf, {field.name}, cut_out);
    const bool marked = field.help.find("(grid") != std::string::npos;
    ASSERT_EQ(unused.size(), marked ? 1u : 0u) << field.name;
    if (!marked) continue;
    EXPECT_EQ(unused[0], option_flag(field) + " is not used by --method nerf");
    ++grid_alone;
  }
  EXPECT_EQ(grid_alone, 21);
}

TEST(TrainOptionsText, OneColourOfARayIsNotShared) {
  const Scene scene;
  apps::TrainCommand command;
  const std::set<std::string> both = {"shared_colour", "stop_transmittance"};
  EXPECT_TRUE(apps::unused_options(command, both, scene).empty());
  command.train.shared_colour = 0;
  EXPECT_EQ(
      apps::unused_options(command, both, scene),
      std::vector<std::string>{"--stop-transmittance is not used: no samples share a colour"});
  command.train.grid.colour_per_ray = true;
  EXPECT_EQ(apps::unused_options(command, both, scene).size(), 2u);
  command.train.shared_colour = 0.25;
  const std::vector<std::string> unused = apps::unused_options(command, both, scene);
  ASSERT_EQ(unused.size(), 2u);
  EXPECT_EQ(unused[0],
            "--shared-colour is not used: with --grid-colour-per-ray a ray has one colour");
}

TEST(TrainOptionsText, DefaultRunFolderIsNamedAfterTheScene) {
  TempFolder folder;
  fs::create_directories(folder.path() / "garden.v2");
  EXPECT_EQ(apps::default_run_folder(folder.path() / "garden.v2"), "runs/garden.v2");
  EXPECT_EQ(apps::default_run_folder(folder.path() / "garden.v2/"), "runs/garden.v2");
  EXPECT_EQ(apps::default_run_folder(folder.path() / "walk.mp4"), "runs/walk");
}

}  // namespace
}  // namespace nerf
