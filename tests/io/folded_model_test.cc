// Given models that take two sides of a can for one, with a stand-in for colmap.
#include "io/folded_model.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>

#include "io/cameras/can_walk.h"
#include "io/cameras/stand_in_colmap.h"
#include "nerf/base/file.h"
#include "nerf/math/camera_paths.h"

namespace nerf::internal {
namespace {

namespace fs = std::filesystem;
using test::CanWalk;
using test::contains;
using test::TempFolder;

// Its features and matches are those of a database that the test made, its model one as well.
constexpr const char* kStandIn = R"sh(#!/bin/sh
if [ "$1" = help ]; then printf 'Usage:\n  colmap [command]\n\n    mapper\n'; exit 0; fi
if [ "$2" = -h ]; then exit 0; fi
echo "$1" >> "$STANDIN_LOG"
command=$1
while [ $# -gt 0 ]; do
  case $1 in
    --output_path) out=$2 ;;
    --database_path) database=$2 ;;
  esac
  shift
done
case $command in
  feature_extractor) [ -e "$database" ] || cp "$STANDIN_DATABASE" "$database" ;;
  mapper) cp -r "$STANDIN_MODEL" "$out/0" ;;
esac
)sh";

class FoldedModel : public ::testing::Test {
 protected:
  static std::string linked(int photo) { return fmt::format("0/{:06}.png", photo); }

  FoldedModel() : colmap_(folder_.path(), kStandIn) {
    colmap_.set("STANDIN_LOG", (folder_ / "log").string());
    colmap_.set("STANDIN_DATABASE", (folder_ / "made.db").string());
    colmap_.set("STANDIN_MODEL", (folder_ / "model").string());
    CanWalk::write_database(folder_ / "made.db", true, linked);
    CanWalk::write_model(folder_ / "model", [](int photo) { return photo; }, linked);
    write_file_atomically(folder_ / "log", "");
    options_.work_folder = folder_ / "work";
  }

  // Photo i stands where photo `stands_at(i)` does in truth; those that follow each other share
  // points unless one of them is in `apart`.
  template <class F>
  SceneInput capture(F&& stands_at, const std::vector<int>& apart) {
    SceneInput input;
    input.keypoints = true;
    Camera camera;
    camera.model = CameraModel::kPinhole;
    camera.width = 400;
    camera.height = 300;
    camera.params = {CanWalk::kFocal, CanWalk::kFocal, 200, 150};
    input.cameras = {camera};
    int32_t point = 0;
    for (int i = 0; i < CanWalk::kPhotos; ++i) {
      View view;
      view.name = fmt::format("walk {}.png", i);  // not the order of bytes
      view.image_path = folder_ / view.name;
      view.pose = CanWalk::place(stands_at(i));
      if (!fs::exists(view.image_path)) test::write_picture(view.image_path, 400, 300);
      input.views.push_back(view);
      if (i == 0 || std::ranges::find(apart, i) != apart.end()) continue;
      for (int k = 0; k < 60; ++k, ++point)
        for (const int image : {i - 1, i}) input.observations.push_back({image, point});
    }
    return input;
  }
  bool unfold_it(SceneInput& input) { return unfold(input, options_, {}, nullptr); }
  std::string log() const { return read_text_file(folder_ / "log"); }

  TempFolder folder_;
  test::StandInColmap colmap_;
  SceneOptions options_;
};

// Where the folded walk jumps back: from photo 13 to 14, and a half turn later.
int folded(int photo) { return (photo + 6) % CanWalk::kHalf; }
const std::vector<int> kJumps{14, 34};

TEST_F(FoldedModel, JumpsAreFoundInTheOrderOfNumbers) {
  EXPECT_EQ(find_jumps(capture(folded, kJumps)), (std::vector<ViewPair>{{13, 14}, {33, 34}}));
  const auto right = [](int photo) { return photo; };
  EXPECT_TRUE(find_jumps(capture(right, {})).empty());
  EXPECT_TRUE(find_jumps(capture(right, kJumps)).empty());  // it does not turn
  EXPECT_TRUE(find_jumps(capture(folded, {})).empty());     // they share points
  EXPECT_TRUE(find_jumps(capture(folded, {14})).empty());   // one is none
  // A collection of photos has no order.
  EXPECT_TRUE(
      find_jumps(capture([](int photo) { return 17 * photo % CanWalk::kPhotos; }, kJumps)).empty());
}

TEST_F(FoldedModel, CamerasOfAFoldedModelAreFoundAnew) {
  SceneInput input = capture(folded, kJumps);
  EXPECT_TRUE(unfold_it(input));
  EXPECT_TRUE(contains(log(), "mapper"));
  // Up to one rotation of all.
  for (int i = 0; i < CanWalk::kPhotos; ++i) {
    const auto turn = [&](int photo, auto&& pose_of) {
      return pose_of(photo).rotation.transposed() * pose_of(0).rotation;
    };
    const auto found = [&](int photo) { return input.views[static_cast<size_t>(photo)].pose; };
    EXPECT_LT(rotation_angle(turn(i, found), turn(i, CanWalk::place)), 1e-6) << i;
  }
  std::string notes;
  for (const std::string& note : input.notes) notes += note + "\n";
  EXPECT_TRUE(contains(notes, "walk 13.png and walk 14.png, which match, stand apart"));
  EXPECT_TRUE(contains(notes, "cameras of 40 of 40 photos were found anew"));
  EXPECT_FALSE(fs::exists(folder_ / "work" / "jumps"));
}

TEST_F(FoldedModel, PhotosThatDoStandApartStayAndAreComparedOnce) {
  // The photographer steps to the other side for photos 10 to 29, in truth.
  const auto stands = [](int photo) { return photo < 10 || photo >= 30 ? photo : photo + 14; };
  CanWalk::write_database(folder_ / "other.db", false, linked, stands);
  colmap_.set("STANDIN_DATABASE", (folder_ / "other.db").string());
  const SceneInput given = capture(stands, {10, 30});
  ASSERT_EQ(find_jumps(given).size(), 2u);
  SceneInput input = given;
  EXPECT_FALSE(unfold_it(input));
  EXPECT_EQ(log(), "feature_extractor\nexhaustive_matcher\n");
  EXPECT_FALSE(unfold_it(input));
  EXPECT_EQ(log(), "feature_extractor\nexhaustive_matcher\n");
  EXPECT_TRUE(input.notes.empty());
  EXPECT_EQ(input.views[20].pose.translation, given.views[20].pose.translation);
}

TEST_F(FoldedModel, NothingHappensWithoutAFolderOrWhereColmapFails) {
  SceneInput input = capture(folded, kJumps);
  options_.work_folder.clear();
  EXPECT_FALSE(unfold_it(input));
  EXPECT_EQ(log(), "");
  options_.work_folder = folder_ / "work";
  colmap_.set("STANDIN_MODEL", (folder_ / "nowhere").string());
  EXPECT_FALSE(unfold_it(input));
  EXPECT_TRUE(contains(input.notes.back(), "cameras were not found anew"));
  EXPECT_EQ(input.views[20].pose.translation, CanWalk::place(folded(20)).translation);
}

}  // namespace
}  // namespace nerf::internal
