// Which mapper of colmap places the photos.
#include "io/cameras/mapping_stage.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>

#include "nerf/base/file.h"
#include "support/temp_folder.h"

namespace nerf::internal {
namespace {

namespace fs = std::filesystem;
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
)sh";

class MappingStage : public ::testing::Test {
 protected:
  void SetUp() override {
    fs::create_directory(folder_ / "bin");
    std::ofstream(folder_ / "bin" / "colmap") << kStandIn;
    fs::permissions(folder_ / "bin" / "colmap", fs::perms{0755});
    path_ = ::getenv("PATH");
    ::setenv("PATH", ((folder_ / "bin").string() + ":" + path_).c_str(), 1);
    ::setenv("STANDIN_LOG", (folder_ / "log").c_str(), 1);
  }
  void TearDown() override {
    ::setenv("PATH", path_.c_str(), 1);
    ::unsetenv("STANDIN_LOG");
    ::unsetenv("STANDIN_COMMANDS");
  }
  std::string mapper_for(size_t photos, const char* commands, const MapSettings& map = {}) {
    ::setenv("STANDIN_COMMANDS", commands, 1);
    std::error_code ignored;
    fs::remove(folder_ / "log", ignored);
    const CapturePhotos capture{folder_.path(), std::vector<CapturePhoto>(photos)};
    const MappedModel model = map_photos(ColmapProgram(nullptr), capture, folder_ / "database.db",
                                         folder_ / "sparse", map, {});
    EXPECT_EQ(model.photos, 0);  // it writes none
    return read_text_file(folder_ / "log");
  }

  TempFolder folder_;
  std::string path_;
};

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
