// Which mapper of colmap places the photos.
#include "io/cameras/mapping_stage.h"

#include <gtest/gtest.h>

#include "io/cameras/can_walk.h"
#include "io/cameras/feature_database.h"
#include "io/cameras/stand_in_colmap.h"
#include "nerf/base/file.h"
#include "support/temp_folder.h"

namespace nerf::internal {
namespace {

namespace fs = std::filesystem;
using test::CanWalk;
using test::contains;
using test::TempFolder;

// Notes its command and knows those of $STANDIN_COMMANDS.
constexpr const char* kStandIn = R"sh(#!/bin/sh
if [ "$1" = help ]; then
  echo Commands:
  for command in $STANDIN_COMMANDS; do echo "    $command"; done
  exit 0
fi
if [ "$2" = -h ]; then
  echo "  --Mapper.ba_refine_focal_length arg (=1)"
  exit 0
fi
echo "$1" >> "$STANDIN_LOG"
echo "$*" > "$STANDIN_LOG.last"
# The first models folder is what the first call finds, and so on.
model=$STANDIN_MODELS/$(wc -l < "$STANDIN_LOG")
if [ -d "$model" ]; then
  while [ "$1" != --output_path ]; do shift; done
  cp -r "$model" "$2/0"
fi
)sh";

class MappingStage : public ::testing::Test {
 protected:
  MappingStage() : colmap_(folder_.path(), kStandIn) {
    colmap_.set("STANDIN_LOG", (folder_ / "log").string());
  }
  std::string mapper_for(size_t photos, const char* commands, const MapSettings& map = {}) {
    colmap_.set("STANDIN_COMMANDS", commands);
    std::error_code ignored;
    fs::remove(folder_ / "log", ignored);
    const CapturePhotos capture{folder_.path(), std::vector<CapturePhoto>(photos)};
    const MappedModel model = map_photos(ColmapProgram(nullptr), capture, folder_ / "database.db",
                                         folder_ / "sparse", map, {});
    EXPECT_EQ(model.photos, 0);  // it writes none
    return read_text_file(folder_ / "log");
  }

  TempFolder folder_;
  test::StandInColmap colmap_;
};

// Photos of a walk round a can, which the mapper folds at first. What the next calls find is in
// models/2 and so on.
class MappingStageOfACan : public MappingStage {
 protected:
  static int folded(int photo) { return photo % CanWalk::kHalf; }
  static int right(int photo) { return photo; }

  MappingStageOfACan() {
    colmap_.set("STANDIN_MODELS", (folder_ / "models").string());
    colmap_.set("STANDIN_COMMANDS", "mapper");
    CanWalk::write_database(folder_ / "database.db", true);
    CanWalk::write_model(folder_ / "models" / "1", folded);
  }
  MappedModel map() {
    const CapturePhotos capture{folder_.path(), std::vector<CapturePhoto>(CanWalk::kPhotos)};
    return map_photos(ColmapProgram(nullptr), capture, folder_ / "database.db", folder_ / "sparse",
                      {}, [&](const std::string& line) { told_ += line + "\n"; });
  }
  size_t verified_pairs() {
    return FeatureDatabase(folder_ / "database.db").verified_pairs().size();
  }
  // The model of the last of so many calls counts, and pairs that misled those before are gone.
  void expect_last_counts(int calls) {
    const size_t before = verified_pairs();
    const MappedModel model = map();
    std::string log;
    for (int i = 0; i < calls; ++i) log += "mapper\n";
    EXPECT_EQ(read_text_file(folder_ / "log"), log);
    EXPECT_EQ(model.photos, CanWalk::kPhotos);
    EXPECT_EQ(read_text_file(model.folder / "images.bin"),
              read_text_file(folder_ / "models" / std::to_string(calls) / "images.bin"));
    EXPECT_LT(verified_pairs(), before);
    EXPECT_TRUE(contains(told_, "placing all again without"));
    EXPECT_FALSE(contains(told_, "wrong places"));
  }

  std::string told_;
};

TEST_F(MappingStageOfACan, PhotosThatAFoldPutsOnTopOfOthersArePlacedAgain) {
  CanWalk::write_model(folder_ / "models" / "2", right);
  expect_last_counts(2);
}

TEST_F(MappingStageOfACan, ASecondFoldIsNotTheLastWord) {
  CanWalk::write_model(folder_ / "models" / "2", folded);
  CanWalk::write_model(folder_ / "models" / "3", right);
  expect_last_counts(3);
}

TEST_F(MappingStageOfACan, WhereThatIsNoBetterTheFirstModelCountsAndNothingIsLost) {
  CanWalk::write_model(folder_ / "models" / "2", folded);
  CanWalk::write_model(folder_ / "models" / "3", folded);
  const size_t before = verified_pairs();
  const MappedModel model = map();
  EXPECT_EQ(read_text_file(folder_ / "log"), "mapper\nmapper\nmapper\n");
  EXPECT_EQ(model.folder, folder_ / "sparse" / "0");
  EXPECT_EQ(verified_pairs(), before);
  EXPECT_TRUE(contains(told_, "may stand in wrong places"));
}

TEST_F(MappingStageOfACan, ARightModelIsMappedOnce) {
  CanWalk::write_model(folder_ / "models" / "1", right);
  EXPECT_EQ(map().photos, CanWalk::kPhotos);
  EXPECT_EQ(read_text_file(folder_ / "log"), "mapper\n");
}

TEST_F(MappingStage, ManyPhotosGoToTheGlobalMapperWhereThereIsOne) {
  // It places none here, and so the other has its turn.
  EXPECT_EQ(mapper_for(500, "mapper global_mapper"), "global_mapper\nmapper\n");
  EXPECT_EQ(mapper_for(500, "mapper"), "mapper\n");
  EXPECT_EQ(mapper_for(500, "mapper hierarchical_global_mapper global_mapper_2"), "mapper\n");
  EXPECT_EQ(mapper_for(50, "mapper global_mapper"), "mapper\n");
  EXPECT_EQ(mapper_for(500, "mapper global_mapper", {.eager = true}), "mapper\n");
}

TEST_F(MappingStage, KnownLensesAreNotAdjusted) {
  const auto last = [&] { return read_text_file(folder_ / "log.last"); };
  mapper_for(20, "mapper");
  EXPECT_EQ(last().find("ba_refine"), std::string::npos) << last();
  mapper_for(20, "mapper", {.lenses_are_known = true});
  EXPECT_NE(last().find("--Mapper.ba_refine_focal_length 0"), std::string::npos) << last();
}

}  // namespace
}  // namespace nerf::internal
