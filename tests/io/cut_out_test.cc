// Backgrounds of one colour: which photos have one, and the alpha that comes of it.
#include "io/cut_out.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>

#include "nerf/io/photos.h"
#include "nerf/io/scene.h"
#include "test_images.h"
#include "test_scenes.h"

namespace nerf {
namespace {

using namespace nerf::test;
using internal::CutOutSearch;
using internal::StoredImage;
namespace fs = std::filesystem;

constexpr int kWidth = 96, kHeight = 72;
const ImageFile kFile{kWidth, kHeight, 3, OIIO::TypeDesc::UINT8, {}};

// How much of pixel (x, y) a ball of that place covers, from 8 x 8 points.
float covered(int x, int y, double cx, double cy, double radius) {
  int inside = 0;
  for (int s = 0; s < 64; ++s)
    inside += std::hypot(x + (s % 8 + 0.5) / 8 - cx, y + (s / 8 + 0.5) / 8 - cy) < radius;
  return static_cast<float>(inside) / 64;
}

// Photo i of a coloured ball that moves about, before a background.
void write_ball(const fs::path& path, int i, const std::function<float(int x, int y, int c)>& back,
                double radius = 20) {
  fs::create_directories(path.parent_path());
  make_image(path, kFile, [&](int x, int y, int c) {
    const float a = covered(x, y, 46 + 3 * (i % 4), 35 + 2 * (i % 3), radius);
    const float ball = 0.2f + 0.2f * static_cast<float>(c) + 0.002f * static_cast<float>(y);
    return a * ball + (1 - a) * back(x, y, c);
  });
}

std::vector<fs::path> photos_of(const TempFolder& folder, int count, const std::string& extension,
                                const std::function<void(const fs::path&, int)>& write) {
  std::vector<fs::path> paths;
  for (int i = 0; i < count; ++i) {
    paths.push_back(folder / (fmt::format("{:02}", i) + extension));
    write(paths.back(), i);
  }
  return paths;
}

float plain(int, int, int) { return 1; }

TEST(CutOut, FindsTheColourOfThePhotosBorder) {
  const struct {
    Rgb8 colour;
    const char* extension;
  } cases[] = {{{255, 255, 255}, ".png"},
               {{255, 255, 255}, ".jpg"},
               {{0, 0, 0}, ".jpg"},
               {{40, 180, 60}, ".jpg"}};
  for (const auto& k : cases) {
    TempFolder folder;
    const auto paths = photos_of(folder, 20, k.extension, [&](const fs::path& path, int i) {
      write_ball(path, i, [&](int, int, int c) {
        return static_cast<float>(k.colour[static_cast<size_t>(c)]) / 255;
      });
    });
    const CutOutSearch found = internal::find_cut_out(paths);
    ASSERT_TRUE(found.colour);
    for (size_t c = 0; c < 3; ++c) EXPECT_NEAR((*found.colour)[c], k.colour[c], 1);
    EXPECT_FALSE(found.is_frame);
    EXPECT_EQ(found.looked, 12);
  }
}

TEST(CutOut, FindsItWhereTheObjectReachesOneSideAndOnePhotoIsAnother) {
  TempFolder folder;
  const auto paths = photos_of(folder, 12, ".png", [&](const fs::path& path, int i) {
    if (i == 5) return make_image(path, kFile, texture);
    make_image(path, kFile, [&](int x, int y, int c) {
      return std::abs(x - 40 - 2 * (i % 5)) < 20 && y > 20 ? 0.3f + 0.1f * static_cast<float>(c)
                                                           : 1.0f;
    });
  });
  const CutOutSearch found = internal::find_cut_out(paths);
  EXPECT_EQ(found.colour, (Rgb8{255, 255, 255}));
  EXPECT_FALSE(found.is_frame);
}

// Nothing of this is a background that was cut out.
TEST(CutOut, OrdinaryPhotosHaveNone) {
  const auto noise = [](int x, int y, int i) {
    const double at = std::sin(12.9898 * x + 78.233 * y + 37.7 * i) * 43758.5453;
    return static_cast<float>(2 * (at - std::floor(at)) - 1);
  };
  const struct {
    const char* name;
    std::function<float(int i, int x, int y, int c)> back;
  } cases[] = {
      {"textured", [](int, int x, int y, int c) { return texture(x, y, c); }},
      {"white sky above a meadow",
       [](int, int x, int y, int c) { return y < 40 ? 1.0f : texture(x, y, c); }},
      {"wall with the light of a window",
       [](int, int x, int, int) { return 0.85f + 0.001f * static_cast<float>(x); }},
      {"noisy wall", [&](int i, int x, int y, int) { return 0.8f + 0.02f * noise(x, y, i); }},
      {"wall whose exposure drifts",
       [](int i, int, int, int) { return 0.7f + 0.02f * static_cast<float>(i); }},
  };
  for (const auto& k : cases) {
    TempFolder folder;
    const auto paths = photos_of(folder, 8, ".jpg", [&](const fs::path& path, int i) {
      write_ball(path, i, [&](int x, int y, int c) { return k.back(i, x, y, c); });
    });
    EXPECT_FALSE(internal::find_cut_out(paths).colour) << k.name;
  }
}

// Bars of a film, or what a lens does not reach: the same in every photo.
TEST(CutOut, AFrameIsNoBackground) {
  TempFolder folder;
  const auto paths = photos_of(folder, 8, ".png", [&](const fs::path& path, int i) {
    make_image(path, kFile, [&](int x, int y, int c) {
      return covered(x, y, 48, 36, 33) > 0.5f ? 0.2f + 0.7f * texture(x + 5 * i, y, c) : 0.0f;
    });
  });
  const CutOutSearch found = internal::find_cut_out(paths);
  EXPECT_TRUE(found.is_frame);
}

StoredImage decoded_ball(const TempFolder& folder, const char* extension) {
  const fs::path path = folder / (std::string("ball") + extension);
  write_ball(path, 0, plain);
  return internal::decode_image(path);
}

TEST(CutOut, AlphaIsWhatTheObjectCovers) {
  for (const char* extension : {".png", ".jpg"}) {
    TempFolder folder;
    const StoredImage before = decoded_ball(folder, extension);
    StoredImage after = before;
    internal::cut_out(after, {255, 255, 255});
    ASSERT_EQ(after.channels, 4);
    const bool exact = std::string(extension) == ".png";
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x) {
        const size_t at = static_cast<size_t>(y) * kWidth + static_cast<size_t>(x);
        const double truth = static_cast<double>(covered(x, y, 46, 35, 20));
        const double alpha = after.samples8[4 * at + 3] / 255.0;
        // Colours nearby differ by 4 x 0.002 of 0.8, and more once compressed.
        EXPECT_NEAR(alpha, truth, exact ? 0.04 : 0.25) << extension << " " << x << "," << y;
        if (truth == 0 && std::hypot(x + 0.5 - 46, y + 0.5 - 35) > 24) {
          EXPECT_EQ(alpha, 0) << x << "," << y;
        }
        for (size_t c = 0; c < 3; ++c) {
          const double over = after.samples8[4 * at + c] * alpha + 255 * (1 - alpha);
          // What counts as background may be off by six levels.
          EXPECT_NEAR(over, before.samples8[3 * at + c], alpha > 0 ? 1 : 6) << x << "," << y;
        }
      }
  }
}

TEST(CutOut, KeepsWhatIsNotJoinedToTheBorder) {
  StoredImage image;
  image.width = image.height = 32;
  image.channels = 3;
  image.samples8.assign(3 * 32 * 32, 255);
  const auto paint = [&](int x, int y, int level) {
    for (size_t c = 0; c < 3; ++c)
      image.samples8[3 * static_cast<size_t>(32 * y + x) + c] = static_cast<uint8_t>(level);
  };
  for (int y = 8; y < 24; ++y)
    for (int x = 8; x < 24; ++x) paint(x, y, 100);
  for (int y = 14; y < 18; ++y)
    for (int x = 14; x < 18; ++x) paint(x, y, 255);  // a white label
  paint(3, 3, 240);                                  // of compression
  paint(28, 28, 0);                                  // matter, however small
  const auto background = internal::background_of(image, {255, 255, 255});
  const auto at = [&](int x, int y) { return background[static_cast<size_t>(32 * y + x)]; };
  EXPECT_EQ(at(0, 0), 1);
  EXPECT_EQ(at(3, 3), 1);
  EXPECT_EQ(at(28, 28), 0);
  EXPECT_EQ(at(8, 8), 0);
  EXPECT_EQ(at(15, 15), 0);
  EXPECT_EQ(std::count(background.begin(), background.end(), 0), 16 * 16 + 1);
}

// A capture by COLMAP of the ball, moving about before white.
void write_cut_out_capture(const TempFolder& folder, int n = 8) {
  TestModel model = ring_model(n, 60);
  model.cameras[0] = {1, 1, kWidth, kHeight, {100, 100, kWidth / 2.0, kHeight / 2.0}};
  write_binary(model, folder / "sparse" / "0");
  for (int i = 0; i < n; ++i)
    write_ball(folder / "images" / model.images[static_cast<size_t>(i)].name, i, plain);
}

TEST(CutOut, ACaptureIsReadAsOneWithAlpha) {
  TempFolder folder;
  write_cut_out_capture(folder);
  const Scene scene = load_scene(folder.path());
  EXPECT_TRUE(scene.alpha);
  EXPECT_EQ(scene.cut_out, (Rgb8{255, 255, 255}));
  EXPECT_FALSE(scene.unbounded);
  const std::string report = format_report(scene.report);
  EXPECT_NE(report.find("cut out       background of 255,255,255"), std::string::npos) << report;
  ThreadPool pool(1);
  const PhotoSet photos = load_photos(scene, pool);
  ASSERT_EQ(photos.photos[0].channels, 4);
  EXPECT_TRUE(photos.photos[0].transparent(1, 1));
  EXPECT_FALSE(photos.photos[0].transparent(46, 35));

  SceneOptions off;
  off.cut_out.mode = CutOut::Mode::kOff;
  const Scene opaque = load_scene(folder.path(), off);
  EXPECT_FALSE(opaque.alpha);
  EXPECT_EQ(load_photos(opaque, pool).photos[0].channels, 3);
  EXPECT_GT(scene.report.memory_estimate_bytes, opaque.report.memory_estimate_bytes);
}

TEST(CutOut, TheColourMayBeGiven) {
  TempFolder folder;
  write_capture(ring_model(4), folder.path());
  SceneOptions options;
  options.cut_out = {CutOut::Mode::kColour, {1, 2, 3}};
  const Scene scene = load_scene(folder.path(), options);
  EXPECT_EQ(scene.cut_out, (Rgb8{1, 2, 3}));
  EXPECT_TRUE(scene.alpha);
}

struct OneOption {
  CutOut cut_out;
  template <class V>
  void visit_options(V& v) {
    v("cut_out", cut_out, "help");
  }
};

TEST(CutOut, IsAnOption) {
  OneOption options;
  const auto field = [&] { return option_fields(options).front(); };
  EXPECT_EQ(option_text(field()), "auto");
  for (const char* good : {"off", "0,128,255", "auto"}) {
    set_option_text(field(), good, "here");
    EXPECT_EQ(option_text(field()), good);
  }
  for (const char* bad : {"", "on", "1,2", "1,2,3,4", "1,2,256", "-1,2,3", "1,2,", "1 2 3"})
    EXPECT_NE(error_of([&] { set_option_text(field(), bad, "here"); }), "") << bad;
}

}  // namespace
}  // namespace nerf
