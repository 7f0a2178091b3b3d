// Photos to a model: with a stand-in for colmap that plays its part, and once with the real one.
#include "nerf/io/capture_tools.h"

#include <cmath>
#include <cstdlib>
#include <fstream>

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

// Notes every command line in $STANDIN_LOG and prints what colmap prints.
constexpr const char* kStandIn = R"sh(#!/bin/sh
if [ "$2" = -h ]; then
  case $1 in
    feature_extractor)
      echo '  --database_path arg'
      echo "  --$STANDIN_EXTRACTION.use_gpu arg (=1)"
      echo "  --$STANDIN_EXTRACTION.num_threads arg (=-1)"
      echo "  --$STANDIN_EXTRACTION.max_image_size arg (=3200)" ;;
    *_matcher)
      echo '  --SiftMatching.use_gpu arg (=1)'
      echo '  --SiftMatching.num_threads arg' ;;
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
    --database_path) echo database > "$2" ;;
    --image_list_path) cat "$2" > "$STANDIN_LOG.list" ;;
  esac
  shift
done
case $command in
  feature_extractor) echo 'Processed file [1/2]' ;;
  exhaustive_matcher) printf 'Matching block [1/1, 1/1]'; echo ' in 0.1s' ;;
  sequential_matcher) echo 'Matching image [1/151] in 0.1s' ;;
  mapper)
    echo 'Registering image #2 (2)'
    if [ -z "$STANDIN_NO_MODEL" ]; then mkdir "$out/0"; echo model > "$out/0/cameras.bin"; fi ;;
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
    for (int i = 0; i < 3; ++i) photo("p" + std::to_string(i) + ".jpg");
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
  fs::path run(const Cancel* cancel = nullptr) {
    lines_.clear();
    return run_colmap_on_photos(
        folder_ / "photos", {folder_ / "work", folder_ / "run"}, "SIMPLE_RADIAL",
        [this](const std::string& line) { lines_.push_back(line); }, cancel);
  }
  std::string log() const { return read_text_file(folder_ / "log"); }

  TempFolder folder_;
  std::string path_;
  std::vector<std::string> variables_, lines_;
};

TEST_F(CaptureTools, RunsTheStepsOnTheProcessorWithoutADisplay) {
  const fs::path model = run();
  EXPECT_EQ(read_text_file(model / "sparse" / "0" / "cameras.bin"), "model\n");
  EXPECT_EQ(read_image_info(model / "images" / "p1.jpg").width, 32);
  EXPECT_FALSE(fs::exists(model / "database.db"));
  const std::string text = log();
  for (const char* part :
       {"feature_extractor --database_path", "--ImageReader.camera_model SIMPLE_RADIAL",
        "--ImageReader.single_camera_per_folder 1", "--SiftExtraction.use_gpu 0",
        "--SiftExtraction.max_image_size", "exhaustive_matcher", "--SiftMatching.use_gpu 0",
        "mapper", "platform=offscreen"}) {
    EXPECT_TRUE(contains(text, part));
  }
  EXPECT_EQ(read_text_file(folder_ / "log.list"), "p0.jpg\np1.jpg\np2.jpg\n");
  EXPECT_EQ(lines_, (std::vector<std::string>{
                        "colmap: finding the cameras of 3 photos, camera model SIMPLE_RADIAL",
                        "colmap: looked for features in 1/2 photos",
                        "colmap: matched block 1/1, 1/1", "colmap: placed photo 2 of 3"}));
  // Nothing beside the photos.
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_ / "photos"), fs::directory_iterator()), 3);
}

TEST_F(CaptureTools, OptionsOfNewerVersionsAreFound) {
  set("STANDIN_EXTRACTION", "FeatureExtraction");
  run();
  EXPECT_TRUE(contains(log(), "--FeatureExtraction.use_gpu 0"));
  EXPECT_FALSE(contains(log(), "--SiftExtraction"));
}

TEST_F(CaptureTools, PhotosOfSeveralSizesHaveTheirOwnCameras) {
  photo("sub/q.jpg", 40);  // another folder may have another camera
  run();
  EXPECT_TRUE(contains(log(), "single_camera_per_folder 1"));
  EXPECT_TRUE(contains(read_text_file(folder_ / "log.list"), "sub/q.jpg\n"));
  photo("p9.jpg", 48);
  run();
  EXPECT_TRUE(contains(log(), "single_camera_per_folder 0"));
}

TEST_F(CaptureTools, ManyPhotosAreMatchedWithTheirNeighbours) {
  const fs::path first = folder_ / "photos" / "p0.jpg";
  for (int i = 0; i < 148; ++i) fs::copy(first, folder_ / "photos" / (std::to_string(i) + ".jpg"));
  run();
  EXPECT_TRUE(contains(log(), "sequential_matcher"));
  EXPECT_FALSE(contains(log(), "exhaustive_matcher"));
  EXPECT_TRUE(contains(lines_.at(2), "151 photos are too many to match every pair"));
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
  run_colmap_on_photos(folder_ / "photos", {run / "capture", run}, "OPENCV", {});
  EXPECT_EQ(read_text_file(folder_ / "log.list"), "p0.jpg\np1.jpg\np2.jpg\n");
}

// A video's frames lie below the work folder.
TEST_F(CaptureTools, FramesInTheWorkFolderArePhotos) {
  const fs::path run = folder_ / "run", work = run / "capture";
  fs::create_directories(work);
  fs::rename(folder_ / "photos", work / "frames");
  run_colmap_on_photos(work / "frames", {work, run}, "OPENCV", {});
  EXPECT_EQ(read_text_file(folder_ / "log.list"), "p0.jpg\np1.jpg\np2.jpg\n");
}

TEST_F(CaptureTools, FailureOfAnyStepIsAnErrorAndLeavesNothing) {
  for (const char* step : {"feature_extractor", "exhaustive_matcher", "mapper"}) {
    set("STANDIN_FAILS_AT", step);
    const std::string error = error_of([&] { run(); });
    EXPECT_TRUE(contains(error, std::string("colmap ") + step + " failed with exit code 7"));
    EXPECT_TRUE(contains(error, "something is wrong"));
    EXPECT_TRUE(fs::is_empty(folder_ / "work")) << step;
  }
}

TEST_F(CaptureTools, NoModelIsAnErrorThatSaysWhatToDo) {
  set("STANDIN_NO_MODEL", "1");
  const std::string error = error_of([&] { run(); });
  EXPECT_TRUE(contains(error, "could not place the photos in space"));
  EXPECT_TRUE(contains(error, "overlap"));
  EXPECT_TRUE(fs::is_empty(folder_ / "work"));
}

TEST_F(CaptureTools, CancelStopsColmapAndLeavesNothing) {
  set("STANDIN_HANGS_AT", "feature_extractor");
  Cancel cancel;
  EXPECT_THROW(run_colmap_on_photos(
                   folder_ / "photos", {folder_ / "work", folder_ / "run"}, "SIMPLE_RADIAL",
                   [&](const std::string& line) {
                     if (line.find("features") != std::string::npos) cancel.request();
                   },
                   &cancel),
               Cancelled);
  EXPECT_TRUE(fs::is_empty(folder_ / "work"));
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

// A room's corner with paint on its walls, seen from a row of places.
float corner(double camera_x, int px, int py, int c) {
  const double dx = (px - 159.5) / 280, dy = (py - 119.5) / 280;
  // Walls x = 3, y = 1 (floor), z = 4 of camera axes moved along x; the nearest that is hit.
  double t = 4;
  if (dx > 0) t = std::min(t, (3 - camera_x) / dx);
  if (dy > 0) t = std::min(t, 1 / dy);
  const double x = camera_x + t * dx, y = t * dy, z = t;
  const auto cell = [&](double scale) {
    auto h = static_cast<uint32_t>(std::floor(x * scale) * 73856093 + 4e8) ^
             static_cast<uint32_t>(std::floor(y * scale) * 19349663 + 4e8) ^
             static_cast<uint32_t>(std::floor(z * scale) * 83492791);
    h = (h ^ h >> 15) * 2246822519u + static_cast<uint32_t>(c) * 17;
    return static_cast<double>((h ^ h >> 13) & 255) / 255;
  };
  return static_cast<float>(0.6 * cell(6.01) + 0.4 * cell(17.03));
}

TEST(RealColmap, PlacesPhotosOfAMadeUpRoom) {
  ASSERT_TRUE(find_program("colmap")) << "scripts/install-deps installs it";
  const TempFolder folder;
  fs::create_directory(folder / "photos");
  for (int i = 0; i < 6; ++i) {
    make_image(folder / "photos" / ("v" + std::to_string(i) + ".png"),
               {320, 240, 3, OIIO::TypeDesc::UINT8, {}},
               [&](int x, int y, int c) { return corner(-1 + 0.4 * i, x, y, c); });
  }
  std::vector<std::string> lines;
  const fs::path model =
      run_colmap_on_photos(folder / "photos", {folder / "work", {}}, "SIMPLE_PINHOLE",
                           [&](const std::string& line) { lines.push_back(line); });
  for (const char* file : {"cameras.bin", "images.bin", "points3D.bin"}) {
    EXPECT_TRUE(fs::is_regular_file(model / "sparse" / "0" / file)) << file;
  }
  // Lines of each step: the stand-in above speaks as the real one does.
  std::string all;
  for (const std::string& line : lines) all += line + "\n";
  EXPECT_TRUE(contains(all, "looked for features in 6/6 photos"));
  EXPECT_TRUE(contains(all, "matched block 1/1, 1/1"));
  EXPECT_TRUE(contains(all, "of 6"));
}

}  // namespace
}  // namespace nerf
