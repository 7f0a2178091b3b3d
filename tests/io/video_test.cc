// Films out and in, with the installed ffmpeg.
#include "nerf/io/video.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>

#include "nerf/base/file.h"
#include "nerf/base/process.h"
#include "nerf/io/capture_tools.h"
#include "nerf/io/image.h"
#include "test_images.h"

namespace nerf {
namespace {

namespace fs = std::filesystem;
using test::contains;
using test::error_of;
using test::make_image;
using test::TempFolder;

class Video : public ::testing::Test {
 protected:
  void SetUp() override {
    ASSERT_TRUE(find_program("ffmpeg")) << "scripts/install-deps installs it";
  }
  // Frame i is a checkerboard on brightness i * step; blurred ones are nearly flat.
  fs::path frame(int i, bool blurred = false, int width = 65, int height = 49) {
    const fs::path path = folder_ / ("view " + std::to_string(i) + ".png");
    make_image(path, {width, height, 3, OIIO::TypeDesc::UINT8, {}}, [&](int x, int y, int) {
      const float amplitude = blurred ? 0.02f : 0.2f;
      return 0.25f + 0.02f * static_cast<float>(i) + ((x / 4 + y / 4) % 2 ? amplitude : 0);
    });
    return path;
  }
  std::vector<fs::path> frames(int count) {
    std::vector<fs::path> result;
    for (int i = 0; i < count; ++i) result.push_back(frame(i, i % 5 != 2));
    return result;
  }
  static std::string probe(const fs::path& film) {
    std::string text;
    ProcessOptions options;
    options.on_line = [&](std::string_view line) { text.append(line) += ' '; };
    run_process_or_throw({"ffprobe", "-v", "error", "-count_frames", "-show_entries",
                          "stream=codec_name,width,height,pix_fmt,r_frame_rate,nb_read_frames,"
                          "color_space",
                          "-of", "default=nw=1", film.string()},
                         options);
    return text;
  }

  TempFolder folder_;
};

TEST_F(Video, WritesEveryFrameInEvenSize) {
  const fs::path film = folder_ / "orbit 100%d.mp4";
  VideoOptions options;
  options.frames_per_second = 24;
  int last = 0;
  options.progress = [&](int done, int total) {
    EXPECT_GE(done, last);
    last = done;
    EXPECT_EQ(total, 7);
  };
  write_video(film, frames(7), options);
  EXPECT_EQ(last, 7);
  const std::string text = probe(film);
  for (const char* part : {"codec_name=h264", "width=64", "height=48", "pix_fmt=yuv420p",
                           "r_frame_rate=24/1", "nb_read_frames=7", "color_space=bt709"}) {
    EXPECT_TRUE(contains(text, part));
  }
  EXPECT_EQ(folder_.files(), 8);  // nothing else was left
}

TEST_F(Video, BadFramesAreErrorsAndLeaveTheOldFilm) {
  const fs::path film = folder_ / "film.mp4";
  write_file_atomically(film, "old");
  EXPECT_TRUE(contains(error_of([&] { write_video(film, {}); }), "no frame"));
  EXPECT_TRUE(contains(error_of([&] { write_video(film, {folder_ / "none.png"}); }), "none.png"));
  const auto other = frame(1, false, 32, 32);
  EXPECT_TRUE(contains(error_of([&] { write_video(film, {frame(0), other}); }),
                       "view 1.png: this frame is 32 x 32 pixels and the first one 65 x 49"));
  // Good header, broken pixels: ffmpeg itself fails.
  const auto broken = frame(2);
  fs::resize_file(broken, fs::file_size(broken) / 2);
  EXPECT_TRUE(contains(error_of([&] { write_video(film, {frame(0), broken}); }), "view 2.png"));
  EXPECT_EQ(read_text_file(film), "old");
  VideoOptions options;
  options.frames_per_second = 0;
  EXPECT_TRUE(contains(error_of([&] { write_video(film, {frame(0)}, options); }), "--fps"));
  EXPECT_EQ(read_text_file(film), "old");
  EXPECT_TRUE(contains(error_of([&] { write_video(folder_ / "no" / "film.mp4", {frame(0)}); }),
                       "No such file"));
}

TEST_F(Video, CancelLeavesNothing) {
  Cancel cancel;
  VideoOptions options;
  options.cancel = &cancel;
  options.progress = [&](int, int) { cancel.request(); };
  cancel.request();
  const auto input = frames(3);
  EXPECT_THROW(write_video(folder_ / "film.mp4", input, options), Cancelled);
  EXPECT_EQ(folder_.files(), 3);
}

TEST_F(Video, SharpestFrameOfEveryWindowIsExtracted) {
  const fs::path film = folder_ / "film.mp4";
  write_video(film, frames(25));  // sharp: 2, 7, 12, 17, 22
  const fs::path work = folder_ / "50%work";
  std::vector<std::string> lines;
  const auto progress = [&](const std::string& line) { lines.push_back(line); };
  const fs::path out = extract_video_frames(film, work, 5, progress);
  EXPECT_FALSE(lines.empty());
  int count = 0;
  for (int i = 0; i < 5; ++i) {
    const fs::path path = out / ("frame_00000" + std::to_string(i + 1) + ".jpg");
    const Image8 image = read_image_8bit(path);
    EXPECT_EQ(image.width, 64);
    double mean = 0;
    for (const uint8_t v : image.pixels) mean += v;
    mean /= static_cast<double>(image.pixels.size());
    // Brightness tells the frame: 0.25 + 0.02 i, and half of the amplitude.
    EXPECT_NEAR(mean / 255, 0.35 + 0.02 * (5 * i + 2), 0.01) << path;
    ++count;
  }
  EXPECT_EQ(std::distance(fs::directory_iterator(out), fs::directory_iterator()), count);

  // The second call uses what is there; another number of frames does not.
  const auto time = fs::last_write_time(out / "frame_000001.jpg");
  EXPECT_EQ(extract_video_frames(film, work, 5, progress), out);
  EXPECT_EQ(fs::last_write_time(out / "frame_000001.jpg"), time);
  extract_video_frames(film, work, 100, progress);
  EXPECT_EQ(std::distance(fs::directory_iterator(out), fs::directory_iterator()), 25);
}

// ffmpeg refuses expressions of more than 100 terms, which most films need.
TEST_F(Video, ManyFramesAreExtractedInTheirOrder) {
  constexpr int kFrames = 130;
  std::vector<fs::path> repeated;
  for (int i = 0; i < kFrames; ++i) repeated.push_back(frame(i % 20));
  const fs::path film = folder_ / "film.mp4";
  write_video(film, repeated);
  const fs::path out = extract_video_frames(film, folder_ / "work", kFrames, {});
  EXPECT_EQ(std::distance(fs::directory_iterator(out), fs::directory_iterator()), kFrames);
  for (const int i : {0, 49, 50, 99, 100, 129}) {
    const Image8 image = read_image_8bit(out / fmt::format("frame_{:06}.jpg", i + 1));
    double mean = 0;
    for (const uint8_t v : image.pixels) mean += v;
    mean /= static_cast<double>(image.pixels.size());
    EXPECT_NEAR(mean / 255, 0.35 + 0.02 * (i % 20), 0.01) << i;
  }
}

// A phone held upright writes lying pictures and a note that they are to be turned.
TEST_F(Video, FramesOfATurnedVideoStandUpright) {
  frames(3);
  const fs::path lying = folder_ / "lying.mp4", turned = folder_ / "turned.mov";
  run_process_or_throw({"ffmpeg", "-v", "error", "-i", (folder_ / "view %d.png").string(), "-vf",
                        "scale=64:48", "-c:v", "libx264", "-pix_fmt", "yuv420p", lying.string()});
  run_process_or_throw({"ffmpeg", "-v", "error", "-i", lying.string(), "-c", "copy",
                        "-metadata:s:v:0", "rotate=90", turned.string()});
  const fs::path out = extract_video_frames(turned, folder_ / "work", 3, {});
  const ImageInfo info = read_image_info(out / "frame_000001.jpg");
  EXPECT_EQ(info.width, 48);
  EXPECT_EQ(info.height, 64);
}

TEST_F(Video, TonesOfHdrAreMapped) {
  const fs::path film = folder_ / "hdr.mkv";
  // 0.49 in PQ are 92 nits, of 100 for a photo's white: 125 when taken as it is.
  run_process_or_throw({"ffmpeg",
                        "-v",
                        "error",
                        "-f",
                        "lavfi",
                        "-i",
                        "color=c=0x7d7d7d:s=64x48:d=0.2:r=10",
                        "-pix_fmt",
                        "yuv420p10le",
                        "-c:v",
                        "ffv1",
                        "-color_trc",
                        "smpte2084",
                        "-color_primaries",
                        "bt2020",
                        "-colorspace",
                        "bt2020nc",
                        "-color_range",
                        "tv",
                        film.string()});
  std::vector<std::string> lines;
  const fs::path out = extract_video_frames(
      film, folder_ / "work", 1, [&](const std::string& line) { lines.push_back(line); });
  EXPECT_TRUE(std::ranges::any_of(
      lines, [](const std::string& line) { return contains(line, "the video is HDR"); }));
  const Image8 image = read_image_8bit(out / "frame_000001.jpg");
  EXPECT_GT(image.pixels[0], 135);
  EXPECT_LT(image.pixels[0], 240);
}

// The frames' times are no matter for which are taken; what they are stands beside them.
TEST_F(Video, EveryFrameOfAVariableRateCounts) {
  frames(12);
  const fs::path film = folder_ / "variable.webm";
  run_process_or_throw({"ffmpeg", "-v", "error", "-i", (folder_ / "view %d.png").string(), "-vf",
                        "setpts='if(lt(N,6),N,N*5)/25/TB'", "-vsync", "vfr", "-c:v", "libvpx",
                        film.string()});
  const fs::path out = extract_video_frames(film, folder_ / "work", 100, {});
  EXPECT_EQ(std::distance(fs::directory_iterator(out), fs::directory_iterator()), 12);
  const auto times = nlohmann::json::parse(test::read_text(folder_ / "work" / kFrameTimes));
  ASSERT_EQ(times.size(), 12u);
  for (int i = 0; i < 12; ++i)
    EXPECT_NEAR(times.at(fmt::format("frame_{:06}.jpg", i + 1)).get<double>(),
                (i < 6 ? i : 5 * i) / 25.0, 1e-3);
  // Five steps of 1 / 25 s, one of 25 / 25 and five of 5 / 25: the middle one.
  const auto film_file = nlohmann::json::parse(test::read_text(folder_ / "work" / kFilm));
  EXPECT_NEAR(film_file.at("frame_interval").get<double>(), 5 / 25.0, 1e-3);
}

TEST_F(Video, FilesOf360CamerasAreRefusedClearly) {
  const fs::path film = folder_ / "VID_0001.insv";
  write_file_atomically(film, "x");
  const std::string error = error_of([&] { extract_video_frames(film, folder_ / "work", 5, {}); });
  EXPECT_TRUE(contains(error, "360-degree camera's own file"));
  EXPECT_TRUE(contains(error, "export it"));
}

TEST_F(Video, WhatIsNoVideoIsAnErrorAndLeavesNothing) {
  write_file_atomically(folder_ / "text.mp4", std::string(5000, 'x'));
  const std::string error =
      error_of([&] { extract_video_frames(folder_ / "text.mp4", folder_ / "work", 5, {}); });
  EXPECT_TRUE(contains(error, "text.mp4: no frame can be read from the video"));
  EXPECT_TRUE(contains(
      error_of([&] { extract_video_frames(folder_ / "none.mp4", folder_ / "work", 5, {}); }),
      "No such file"));
  EXPECT_TRUE(fs::is_empty(folder_ / "work"));
}

TEST_F(Video, TruncatedVideoGivesTheFramesThatItHas) {
  const fs::path film = folder_ / "film.mkv";
  const auto input = frames(20);
  run_process_or_throw({"ffmpeg", "-v", "error", "-i", (folder_ / "view %d.png").string(), "-c:v",
                        "mjpeg", film.string()});
  fs::resize_file(film, fs::file_size(film) / 2);
  const fs::path out = extract_video_frames(film, folder_ / "work", 100, {});
  const auto count = std::distance(fs::directory_iterator(out), fs::directory_iterator());
  EXPECT_GT(count, 3);
  EXPECT_LT(count, 20);
}

TEST(VideoTools, MissingTemporaryFolderIsAnErrorThatNamesIt) {
  const TempFolder folder;
  const char* before = ::getenv("TMPDIR");
  const std::string old = before ? before : "";
  ::setenv("TMPDIR", (folder / "none").c_str(), 1);
  const std::string error = error_of([] { check_video_tools(); });
  if (before)
    ::setenv("TMPDIR", old.c_str(), 1);
  else
    ::unsetenv("TMPDIR");
  EXPECT_TRUE(contains(error, (folder / "none").string()));
  EXPECT_TRUE(contains(error, "set TMPDIR to a folder that exists"));
}

TEST(VideoTools, MissingProgramIsAnErrorWithItsCommand) {
  const TempFolder folder;
  write_file_atomically(folder / "film.mp4", "x");
  const std::string path = ::getenv("PATH");
  ::setenv("PATH", folder.path().c_str(), 1);
  const std::string in =
      error_of([&] { extract_video_frames(folder / "film.mp4", folder / "work", 5, {}); });
  const std::string out = error_of([&] { write_video(folder / "new.mp4", {folder / "a.png"}); });
  ::setenv("PATH", path.c_str(), 1);
  EXPECT_TRUE(contains(in, "sudo apt-get install ffmpeg"));
  EXPECT_TRUE(contains(out, "sudo apt-get install ffmpeg"));
  EXPECT_EQ(folder.files(), 1);
}

}  // namespace
}  // namespace nerf
