// Texts that nerf_train makes from its options.
#include "train_options.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>

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

TEST(TrainOptionsText, WhatDepthsAndMasksTeachNeedsSome) {
  Scene scene;
  scene.views.resize(2);
  apps::TrainCommand command;
  const auto unused = [&] {
    return apps::unused_options(command, {"depth_loss", "point_depth", "masked_share"}, scene);
  };
  EXPECT_EQ(unused(),
            (std::vector<std::string>{
                "--masked-share is not used: the capture has no masks",
                "--point-depth is not used: no photo is known to see a sparse point",
                "--depth-loss is not used: the capture has no depth maps, and distances of points "
                "are not learnt (--point-depth)"}));
  scene.views[1].mask_path = "masks/1.png";
  scene.observations.resize(1);
  EXPECT_EQ(unused().size(), 1u);
  command.train.pixel_recipe.point_depth = 0.1;
  EXPECT_TRUE(unused().empty());
  command.train.pixel_recipe.point_depth = 0;
  scene.views[1].depth_path = "depth/1.png";
  EXPECT_TRUE(unused().empty());
  command.train = method_options("nerf", Scale::kTiny);
  EXPECT_TRUE(unused().empty());
  command.train.network.space = Space::kNdc;
  EXPECT_EQ(unused().size(), 2u);
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
  EXPECT_EQ(decided.minutes, default_minutes("mipnerf360", Scale::kTiny));
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

// Each recipe and each field belongs to one kind of method; the help says so above them.
TEST(TrainOptionsText, AMethodIsToldWhatItDoesNotRead) {
  Scene scene;
  scene.alpha = scene.unbounded = true;  // so that nothing of the scene's leaves an option out
  scene.views.resize(1);
  scene.views[0].depth_path = "depth.png";
  scene.views[0].mask_path = "mask.png";
  scene.observations.resize(1);
  apps::TrainCommand grid, nerf;
  nerf.train = method_options("nerf", Scale::kTiny);
  int of_grid = 0, of_papers = 0;
  for (const OptionField& field : option_fields(nerf.train)) {
    const std::string flag = option_flag(field);
    const bool grids = field.heading.find("grid method") != std::string::npos;
    const bool papers = field.heading.find("papers' methods") != std::string::npos;
    const auto by_grid = nerf::unused_options(grid.train, {field.name}, scene);
    const auto by_nerf = nerf::unused_options(nerf.train, {field.name}, scene);
    const std::vector<std::string> none;
    const auto refused = [&](const char* method) {
      return std::vector<std::string>{flag + " is not used by --method " + method};
    };
    EXPECT_EQ(by_grid, papers ? refused("grid") : none) << flag;
    // What needs another option, a warp, or sparse points.
    const bool conditional = std::ranges::any_of(
        std::array{"anneal", "recipe.photo_range", "transient_density", "least_deviation",
                   "network.deform.", "recipe.window", "recipe.ambient", "recipe.elastic",
                   "recipe.still"},
        [&](const char* part) { return field.name.find(part) != std::string::npos; });
    if (!conditional) {
      EXPECT_EQ(by_nerf, grids ? refused("nerf") : none) << flag;
    }
    of_grid += grids;
    of_papers += papers;
  }
  EXPECT_GT(of_grid, 25);
  EXPECT_GT(of_papers, 25);
}

TEST(TrainOptionsText, StopNeedsSharedColours) {
  const Scene scene;
  apps::TrainCommand command;
  const std::set<std::string> both = {"shared_colour", "stop_transmittance"};
  EXPECT_TRUE(apps::unused_options(command, both, scene).empty());
  command.train.grid_recipe.shared_colour = 0;
  EXPECT_EQ(
      apps::unused_options(command, both, scene),
      std::vector<std::string>{"--stop-transmittance is not used: no samples share a colour"});
}

// A person's first look: forty lines, and everything else one step away.
TEST(TrainOptionsText, HelpIsShort) {
  const auto lines_of = [](const char* flag) {
    apps::TrainCommand command;
    const char* arguments[] = {"nerf_train", flag};
    testing::internal::CaptureStdout();
    EXPECT_TRUE(apps::parse_command_line(2, arguments, apps::train_program_text(), command).exit);
    const std::string text = testing::internal::GetCapturedStdout();
    return std::pair(std::ranges::count(text, '\n'), text);
  };
  const auto [brief_lines, brief_text] = lines_of("--help");
  const auto [all_lines, all_text] = lines_of("--help-all");
  EXPECT_LE(brief_lines, 40) << brief_text;
  EXPECT_NE(brief_text.find("--minutes"), std::string::npos);
  EXPECT_EQ(brief_text.find("--grid-levels"), std::string::npos);
  EXPECT_NE(all_text.find("--grid-levels"), std::string::npos);
  EXPECT_GT(all_lines, 3 * brief_lines);
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
