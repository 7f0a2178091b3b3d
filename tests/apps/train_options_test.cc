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
  EXPECT_EQ(apps::equivalent_command(command, 77),
            "nerf_train 'my photos/it'\\''s' --downscale 2 --rate 0.5 --steps 77");
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

TEST(TrainOptionsText, DefaultRunFolderIsNamedAfterTheScene) {
  TempFolder folder;
  fs::create_directories(folder.path() / "garden.v2");
  EXPECT_EQ(apps::default_run_folder(folder.path() / "garden.v2"), "runs/garden.v2");
  EXPECT_EQ(apps::default_run_folder(folder.path() / "garden.v2/"), "runs/garden.v2");
  EXPECT_EQ(apps::default_run_folder(folder.path() / "walk.mp4"), "runs/walk");
}

}  // namespace
}  // namespace nerf
