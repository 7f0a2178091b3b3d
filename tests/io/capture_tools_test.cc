// Photos to a model, with a stand-in for colmap that plays its part.
#include "nerf/io/capture_tools.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>
#include <fstream>

#include "io/cameras/find_cameras.h"
#include "io/cameras/made_database.h"
#include "io/colmap.h"
#include "io/scene_input.h"
#include "nerf/base/file.h"
#include "nerf/base/process.h"
#include "nerf/io/image.h"
#include "test_images.h"

namespace nerf {
namespace {

namespace fs = std::filesystem;
using test::contains;
using test::error_of;
using test::make_image;
using test::TempFolder;
using test::texture;

// Notes every command line in $STANDIN_LOG and prints what colmap prints. Its database is one that
// the test made; the models that its mapper finds have as many photos as $STANDIN_PLACED says.
constexpr const char* kStandIn = R"sh(#!/bin/sh
if [ "$1" = help ]; then printf 'Usage:\n  colmap [command]\n\n    mapper\n'; exit 0; fi
if [ "$2" = -h ]; then
  case $1 in
    feature_extractor)
      echo '  --database_path arg'
      echo "  --$STANDIN_EXTRACTION.use_gpu arg (=1)"
      echo "  --$STANDIN_EXTRACTION.num_threads arg (=-1)"
      echo "  --$STANDIN_EXTRACTION.first_octave arg (=-1)"
      echo "  --$STANDIN_EXTRACTION.max_image_size arg (=3200)" ;;
    *_matcher)
      echo '  --SiftMatching.use_gpu arg (=1)'
      echo '  --SiftMatching.num_threads arg' ;;
    mapper)
      echo '  --Mapper.init_min_num_inliers arg (=100)' ;;
  esac
  exit 0
fi
echo "$@ platform=$QT_QPA_PLATFORM" >> "$STANDIN_LOG"
if [ "$1" = "$STANDIN_HANGS_AT" ]; then echo 'Processed file [1/2]'; exec sleep 60; fi
if [ "$1" = "$STANDIN_FAILS_AT" ]; then echo 'something is wrong'; exit 7; fi
command=$1
while [ $# -gt 0 ]; do
  case $1 in
    --output_path) out=$2 ;;
    --database_path) database=$2 ;;
    --image_list_path) cat "$2" >> "$STANDIN_LOG.list" ;;
  esac
  shift
done
model() {
  mkdir -p "$1"
  echo model > "$1/cameras.bin"
  printf "\\$2\\000\\000\\000\\000\\000\\000\\000" > "$1/images.bin"
  head -c 20000 /dev/zero >> "$1/images.bin"
}
case $command in
  feature_extractor)
    [ -e "$database" ] || cp "$STANDIN_DATABASE" "$database"
    echo 'Processed file [1/2]' ;;
  exhaustive_matcher) printf 'Matching block [1/1, 1/1]'; echo ' in 0.1s' ;;
  mapper)
    if [ -z "$STANDIN_PLACED" ]; then echo 'ERROR: failed to create sparse model'; exit 1; fi
    echo 'Registering image #2 (2)'
    n=0
    for placed in $STANDIN_PLACED; do model "$out/$n" "$placed"; n=$((n + 1)); done ;;
  model_merger)
    [ -z "$STANDIN_JOINED" ] || model "$out" "$STANDIN_JOINED" ;;
  bundle_adjuster)
    model "$out" "$STANDIN_JOINED" ;;
esac
exit 0
)sh";

class CaptureTools : public ::testing::Test {
 protected:
  void SetUp() override {
    fs::create_directory(folder_ / "bin");
    std::ofstream(folder_ / "bin" / "colmap") << kStandIn;
    fs::permissions(folder_ / "bin" / "colmap", fs::perms{0755});
    path_ = ::getenv("PATH");
    set("PATH", (folder_ / "bin").string() + ":" + path_);
    set("STANDIN_LOG", (folder_ / "log").string());
    set("STANDIN_EXTRACTION", "SiftExtraction");
    set("STANDIN_PLACED", "003");  // octal
    set("STANDIN_DATABASE", (folder_ / "made.db").string());
    for (int i = 0; i < 3; ++i) photo(fmt::format("p{}.jpg", i));
  }
  void TearDown() override {
    for (const std::string& name : variables_) ::unsetenv(name.c_str());
    ::setenv("PATH", path_.c_str(), 1);
  }
  void set(const std::string& name, const std::string& value) {
    ::setenv(name.c_str(), value.c_str(), 1);
    variables_.push_back(name);
  }
  void photo(const std::string& name, int width = 32) {
    fs::create_directories((folder_ / "photos" / name).parent_path());
    make_image(folder_ / "photos" / name, {width, 24, 3, OIIO::TypeDesc::UINT8, {}}, texture);
  }
  void copy_photos(int count) {  // beside the three that are there
    for (int i = 0; i < count; ++i)
      fs::copy(folder_ / "photos" / "p0.jpg", folder_ / "photos" / (std::to_string(i) + ".jpg"));
  }
  fs::path run(const Cancel* cancel = nullptr) {
    lines_.clear();
    make_database(folder_ / "photos");
    return run_colmap_on_photos(
        folder_ / "photos", {folder_ / "work", folder_ / "run"}, camera_model_,
        [this](const std::string& line) { lines_.push_back(line); }, cancel);
  }
  void make_database(const fs::path& photos) {
    fs::remove(folder_ / "made.db");
    test::MadeDatabase database(folder_ / "made.db");
    database.run("BEGIN");
    for (const std::string& name : internal::list_images(photos))
      database.add_image(name, std::vector<uint8_t>(20 * kDescriptorBytes, 45));
    database.run("COMMIT");
  }
  bool told(std::string_view part) const {
    return std::ranges::any_of(
        lines_, [&](const std::string& line) { return line.find(part) != std::string::npos; });
  }
  std::string log() const { return read_text_file(folder_ / "log"); }

  TempFolder folder_;
  std::string path_, camera_model_ = "SIMPLE_RADIAL";
  std::vector<std::string> variables_, lines_;
};

TEST_F(CaptureTools, RunsTheStepsOnTheProcessorWithoutADisplay) {
  const fs::path model = run();
  EXPECT_EQ(read_text_file(model / "sparse" / "0" / "cameras.bin"), "model\n");
  EXPECT_EQ(read_image_info(model / "images" / "p1.jpg").width, 32);
  const std::string text = log();
  for (const char* part :
       {"feature_extractor --database_path", "--ImageReader.camera_model SIMPLE_RADIAL",
        "--ImageReader.single_camera 1", "--SiftExtraction.use_gpu 0",
        "--SiftExtraction.max_image_size", "exhaustive_matcher", "--SiftMatching.use_gpu 0",
        "mapper", "platform=offscreen"}) {
    EXPECT_TRUE(contains(text, part));
  }
  EXPECT_FALSE(contains(text, "init_min_num_inliers"));
  EXPECT_EQ(read_text_file(folder_ / "log.list"), "p0.jpg\np1.jpg\np2.jpg\n");
  EXPECT_EQ(lines_,
            (std::vector<std::string>{
                "colmap: finding the cameras of 3 photos, camera model SIMPLE_RADIAL",
                "colmap: looked for features in 1 of 3 photos", "matched 3 of 3 pairs of photos",
                "colmap: verified matches, 1 of 1 blocks of pairs", "colmap: placed 2 of 3 photos",
                "colmap: placed 3 of 3 photos"}));
  // Nothing beside the photos, and of the work nothing but the model.
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_ / "photos"), fs::directory_iterator()), 3);
  EXPECT_FALSE(fs::exists(folder_ / "work" / "cameras"));
}

TEST_F(CaptureTools, OptionsOfNewerVersionsAreFound) {
  set("STANDIN_EXTRACTION", "FeatureExtraction");
  run();
  EXPECT_TRUE(contains(log(), "--FeatureExtraction.use_gpu 0"));
  EXPECT_FALSE(contains(log(), "--SiftExtraction"));
}

TEST_F(CaptureTools, SizesAndFoldersHaveTheirOwnCameras) {
  for (const char* name : {"sub/q0.jpg", "sub/q1.jpg"}) photo(name);
  photo("wide.jpg", 48);
  set("STANDIN_PLACED", "006");
  run();
  const std::string text = log(), list = read_text_file(folder_ / "log.list");
  // Two cameras of several photos, and a call for the one that is left.
  size_t calls = 0;
  for (size_t at = text.find("single_camera 1"); at != std::string::npos;
       at = text.find("single_camera 1", at + 1))
    ++calls;
  EXPECT_EQ(calls, 2u);
  EXPECT_TRUE(contains(text, "single_camera_per_image 1"));
  EXPECT_TRUE(contains(list, "p0.jpg\np1.jpg\np2.jpg\n"));
  EXPECT_TRUE(contains(list, "sub/q0.jpg\nsub/q1.jpg\n"));
}

// Of two cameras, one with ten photos and one with three.
TEST_F(CaptureTools, LensModelsFollowTheNumberOfPhotos) {
  for (int i = 3; i < 10; ++i) photo(fmt::format("p{}.jpg", i));
  for (int i = 0; i < 3; ++i) photo(fmt::format("sub/q{}.jpg", i));
  set("STANDIN_PLACED", "015");
  camera_model_ = "auto";
  run();
  EXPECT_TRUE(contains(log(), "camera_model OPENCV"));
  EXPECT_TRUE(contains(log(), "camera_model SIMPLE_RADIAL"));
  check_camera_model("auto");
  EXPECT_TRUE(contains(error_of([] { check_camera_model("OPENCB"); }), "OPENCV"));
}

// 160 photos are 12,720 pairs.
TEST_F(CaptureTools, OfManyPhotosLikelyPairsAreMatched) {
  copy_photos(157);
  set("STANDIN_PLACED", "240");
  run();
  EXPECT_TRUE(told("of 12720 pairs of photos may show the same things"));
  EXPECT_FALSE(told("12720 of 12720"));
}

// 60 frames are 1770 pairs.
TEST_F(CaptureTools, OfAFilmFewerPairsAreMatched) {
  copy_photos(57);
  set("STANDIN_PLACED", "074");
  run();
  EXPECT_TRUE(told("matched 1770 of 1770"));
  fs::remove_all(folder_ / "work");
  lines_.clear();
  const internal::CameraSearch film{.camera_model = camera_model_, .is_film = true};
  internal::find_cameras(
      folder_ / "photos", {folder_ / "work", folder_ / "run"}, film,
      [this](const std::string& line) { lines_.push_back(line); }, nullptr);
  EXPECT_TRUE(told("of 1770 pairs of photos may show the same things"));
  EXPECT_FALSE(told("matched 1770 of 1770"));
}

TEST_F(CaptureTools, StagesThatWereDoneAreNotDoneAgain) {
  set("STANDIN_FAILS_AT", "mapper");
  EXPECT_TRUE(contains(error_of([&] { run(); }), "colmap mapper failed"));
  EXPECT_TRUE(told("matched 3 of 3"));
  set("STANDIN_FAILS_AT", "");
  fs::remove(folder_ / "log");
  run();
  EXPECT_FALSE(contains(log(), "feature_extractor"));
  EXPECT_FALSE(told("matched"));
  EXPECT_TRUE(contains(log(), "mapper"));
}

TEST_F(CaptureTools, StagesOfOtherPhotosAreDoneAgain) {
  set("STANDIN_FAILS_AT", "mapper");
  EXPECT_TRUE(contains(error_of([&] { run(); }), "colmap mapper failed"));
  set("STANDIN_FAILS_AT", "");
  fs::remove(folder_ / "log");
  photo("p1.jpg", 40);
  run();
  EXPECT_TRUE(contains(log(), "feature_extractor"));
  EXPECT_TRUE(told("matched 3 of 3"));
}

TEST_F(CaptureTools, TooFewPlacedPhotosAreTriedAgain) {
  set("STANDIN_PLACED", "002");
  run();
  const std::string text = log();
  EXPECT_TRUE(told("placed 2 of 3 photos only; trying again with weaker links"));
  EXPECT_TRUE(told("trying again with more features"));
  EXPECT_TRUE(told("colmap: placed 2 of 3 photos"));
  EXPECT_TRUE(contains(text, "--Mapper.init_min_num_inliers 50"));
  EXPECT_TRUE(contains(text, "--SiftExtraction.first_octave -1"));
}

TEST_F(CaptureTools, OfSeveralModelsTheLargestCounts) {
  for (int i = 3; i < 9; ++i) photo(fmt::format("p{}.jpg", i));
  set("STANDIN_PLACED", "002 010");
  const fs::path model = run();
  EXPECT_TRUE(told("a part of 2 photos does not join the largest, of 8"));
  EXPECT_TRUE(told("colmap: placed 8 of 9 photos"));
  EXPECT_EQ(internal::colmap_image_count(model / "sparse" / "0"), 8u);
}

TEST_F(CaptureTools, ModelsThatJoinAreJoined) {
  for (int i = 3; i < 9; ++i) photo(fmt::format("p{}.jpg", i));
  set("STANDIN_PLACED", "005 006");
  set("STANDIN_JOINED", "011");
  const fs::path model = run();
  EXPECT_TRUE(told("joined parts of 6 and 5 photos to one of 9"));
  EXPECT_EQ(internal::colmap_image_count(model / "sparse" / "0"), 9u);
  EXPECT_TRUE(contains(log(), "bundle_adjuster"));
  EXPECT_FALSE(told("trying again"));
}

TEST_F(CaptureTools, FinishedModelIsUsedAgainForTheSamePhotosOnly) {
  run();
  const size_t length = log().size();
  run();
  EXPECT_EQ(log().size(), length);
  EXPECT_TRUE(contains(lines_.at(0), "using the model made earlier"));
  photo("p3.jpg");
  run();
  EXPECT_GT(log().size(), length);
}

TEST_F(CaptureTools, PicturesOfTheRunInsideThePhotosFolderAreNoPhotos) {
  const fs::path work = folder_ / "photos" / "run";
  fs::create_directories(work);
  make_image(work / "side_by_side.png", {32, 24, 3, OIIO::TypeDesc::UINT8, {}}, texture);
  make_database(folder_ / "photos");
  const fs::path model = run_colmap_on_photos(folder_ / "photos", {work, {}}, "OPENCV", {});
  EXPECT_EQ(read_text_file(folder_ / "log.list"), "p0.jpg\np1.jpg\np2.jpg\n");
  EXPECT_TRUE(fs::exists(model / "sparse" / "0"));
}

// The layout of nerf_train run from inside the photos' folder: RUN/capture and RUN/eval.
TEST_F(CaptureTools, TheWholeRunInsideThePhotosFolderIsNoPhotos) {
  const fs::path run = folder_ / "photos" / "runs" / "garden";
  for (const char* name : {"eval/a.png", "orbit/b.png"}) {
    fs::create_directories((run / name).parent_path());
    make_image(run / name, {32, 24, 3, OIIO::TypeDesc::UINT8, {}}, texture);
  }
  make_database(folder_ / "photos");
  run_colmap_on_photos(folder_ / "photos", {run / "capture", run}, "OPENCV", {});
  EXPECT_EQ(read_text_file(folder_ / "log.list"), "p0.jpg\np1.jpg\np2.jpg\n");
}

// A video's frames lie below the work folder.
TEST_F(CaptureTools, FramesInTheWorkFolderArePhotos) {
  const fs::path run = folder_ / "run", work = run / "capture";
  fs::create_directories(work);
  fs::rename(folder_ / "photos", work / "frames");
  make_database(work / "frames");
  run_colmap_on_photos(work / "frames", {work, run}, "OPENCV", {});
  EXPECT_EQ(read_text_file(folder_ / "log.list"), "p0.jpg\np1.jpg\np2.jpg\n");
}

TEST_F(CaptureTools, FailureOfAnyStepIsAnErrorAndLeavesNoModel) {
  for (const char* step : {"feature_extractor", "exhaustive_matcher", "mapper"}) {
    set("STANDIN_FAILS_AT", step);
    const std::string error = error_of([&] { run(); });
    EXPECT_TRUE(contains(error, std::string("colmap ") + step + " failed with exit code 7"));
    EXPECT_TRUE(contains(error, "something is wrong"));
    EXPECT_FALSE(fs::exists(folder_ / "work" / "colmap")) << step;
  }
}

TEST_F(CaptureTools, NoModelIsAnErrorThatSaysWhatToDo) {
  set("STANDIN_PLACED", "");
  const std::string error = error_of([&] { run(); });
  EXPECT_TRUE(contains(error, "could not place the photos in space"));
  EXPECT_TRUE(contains(error, "overlap"));
  EXPECT_TRUE(fs::is_empty(folder_ / "work"));
}

TEST_F(CaptureTools, CancelStopsColmapAndLeavesNoModel) {
  set("STANDIN_HANGS_AT", "feature_extractor");
  Cancel cancel;
  EXPECT_THROW(run_colmap_on_photos(
                   folder_ / "photos", {folder_ / "work", folder_ / "run"}, "SIMPLE_RADIAL",
                   [&](const std::string& line) {
                     if (line.find("features") != std::string::npos) cancel.request();
                   },
                   &cancel),
               Cancelled);
  EXPECT_FALSE(fs::exists(folder_ / "work" / "colmap"));
}

TEST_F(CaptureTools, BadPhotosAreFoundBeforeColmapRuns) {
  const fs::path broken = folder_ / "photos" / "p1.jpg";
  fs::resize_file(broken, fs::file_size(broken) - 10);
  EXPECT_TRUE(contains(error_of([&] { run(); }), "p1.jpg: the image is truncated"));
  fs::remove(broken);
  fs::remove(folder_ / "photos" / "p2.jpg");
  EXPECT_TRUE(contains(error_of([&] { run(); }), "there are 1 photos"));
  EXPECT_FALSE(fs::exists(folder_ / "log"));
}

TEST_F(CaptureTools, MissingColmapIsAnErrorWithItsCommand) {
  fs::remove(folder_ / "bin" / "colmap");
  ::setenv("PATH", (folder_ / "bin").c_str(), 1);
  const std::string error = error_of([&] { run(); });
  EXPECT_TRUE(contains(error, "the program colmap is not installed"));
  EXPECT_TRUE(contains(error, "sudo apt-get install colmap"));
}

}  // namespace
}  // namespace nerf
