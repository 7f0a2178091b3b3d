#include "io/sharpness.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "nerf/math/random.h"
#include "support/temp_folder.h"

namespace nerf::internal {
namespace {

using test::contains;
using test::error_of;

TEST(Sharpness, IsTheVarianceOfTheLaplacian) {
  // Inside a 4 x 3 picture: two Laplacians, 4 * 10 - 0 = 40 and 4 * 0 - 10 = -10: variance 625.
  const std::vector<uint8_t> grey{0, 0, 0, 0, 0, 10, 0, 0, 0, 0, 0, 0};
  EXPECT_EQ(sharpness(grey, 4, 3), 625);
  EXPECT_EQ(sharpness(std::vector<uint8_t>(12, 77), 4, 3), 0);
  EXPECT_EQ(sharpness(grey, 6, 2), 0);  // nothing inside
}

TEST(Sharpness, BestOfEveryWindow) {
  const std::vector<double> scores{1, 5, 2, 9, 3, 3, 8}, still(7, 0), moving{0, 1, 0, 2, 0, 3, 0};
  EXPECT_EQ(sharpest_of_windows(scores, still, 2), (std::vector<int>{1, 3}));
  EXPECT_EQ(sharpest_of_windows(scores, still, 3), (std::vector<int>{1, 3, 6}));
  EXPECT_EQ(sharpest_of_windows(scores, still, 1), (std::vector<int>{3}));
  for (const auto& motions : {still, moving}) {
    EXPECT_EQ(sharpest_of_windows(scores, motions, 100), (std::vector<int>{0, 1, 2, 3, 4, 5, 6}));
  }
  EXPECT_TRUE(sharpest_of_windows({}, {}, 3).empty());
}

// A camera that waits for 60 frames and then moves for 40 of them.
TEST(Sharpness, WindowsAreThoseOfEqualMotion) {
  std::vector<double> motions(100, 0);
  for (size_t i = 60; i < 100; ++i) motions[i] = 0.01;
  const std::vector<int> chosen = sharpest_of_windows(std::vector<double>(100, 1), motions, 20);
  EXPECT_EQ(chosen.size(), 20u);
  const auto waiting = std::ranges::count_if(chosen, [](int i) { return i < 60; });
  // A quarter by time: 60 % of 5 windows.
  EXPECT_GE(waiting, 3);
  EXPECT_LE(waiting, 4);
}

// A texture that slides over a picture of 480 x 270 by so many pixels a frame.
std::vector<uint8_t> slid(double x, double y, int brighter = 0) {
  std::vector<uint8_t> out;
  for (int row = 0; row < 270; ++row)
    for (int column = 0; column < 480; ++column) {
      const double u = column + x, v = row + y;
      const double value =
          110 + 50 * std::sin(u / 13) * std::cos(v / 9 + u / 70) + 40 * std::sin(u / 31 + v / 23);
      out.push_back(static_cast<uint8_t>(value + brighter));
    }
  return out;
}

// A picture of random squares, 480 x 270: nothing of one is in another.
std::vector<uint8_t> squares(uint64_t seed) {
  std::vector<uint8_t> out;
  for (int row = 0; row < 270; ++row)
    for (int column = 0; column < 480; ++column)
      out.push_back(static_cast<uint8_t>(mix64(seed << 32 | static_cast<uint64_t>(row / 8) << 16 |
                                               static_cast<uint64_t>(column / 8)) &
                                         255));
  return out;
}

TEST(FrameMotion, IsTheDisplacementAsAShareOfTheLongerSide) {
  FrameMotion motion;
  EXPECT_EQ(motion.add(slid(0, 0), 480, 270), 0);  // nothing to compare with
  EXPECT_EQ(motion.add(slid(0, 0, 20), 480, 270), 0);
  EXPECT_NEAR(motion.add(slid(12, 0), 480, 270), 12.0 / 480, 1e-3);
  EXPECT_NEAR(motion.add(slid(4, 16), 480, 270), std::hypot(8, 16) / 480, 2e-3);
  // What has moved too far to be found counts as far as can be told.
  FrameMotion pan;
  pan.add(squares(1), 480, 270);
  EXPECT_EQ(pan.add(squares(2), 480, 270), 0.05);
  // A picture without texture tells nothing.
  EXPECT_EQ(motion.add(std::vector<uint8_t>(480 * 270, 90), 480, 270), 0);
  // Another size than before, and sizes without a block.
  EXPECT_EQ(motion.add(slid(0, 0), 270, 480), 0);
  EXPECT_EQ(motion.add(std::vector<uint8_t>(1), 1, 1), 0);
}

std::vector<uint8_t> bytes_of(const std::string& text) { return {text.begin(), text.end()}; }

TEST(GreyStream, ScoresFramesHoweverTheyArrive) {
  std::string text = "YUV4MPEG2 W4 H3 F25:1 Ip A1:1 Cmono XCOLORRANGE=FULL\n";
  const std::string flat(12, 'M'), spot = std::string(5, '\0') + '\n' + std::string(6, '\0');
  text += "FRAME\n" + flat + "FRAME Ip\n" + spot + "FRAME\n" + flat;
  const std::vector<uint8_t> bytes = bytes_of(text);
  for (size_t piece : {size_t{1}, size_t{7}, bytes.size()}) {
    GreyStream stream;
    for (size_t at = 0; at < bytes.size(); at += piece) {
      stream.add(std::span<const uint8_t>(bytes).subspan(at, std::min(piece, bytes.size() - at)));
    }
    EXPECT_EQ(stream.scores(), (std::vector<double>{0, 625, 0})) << piece;
    EXPECT_EQ(stream.motions().size(), 3u);
  }
  GreyStream cut;  // the last frame is not whole
  cut.add(std::span<const uint8_t>(bytes).first(bytes.size() - 1));
  EXPECT_EQ(cut.scores().size(), 2u);
}

TEST(GreyStream, OtherStreamsAreErrors) {
  for (const char* header : {"garbage\n", "YUV4MPEG2 W4 H3 C420jpeg\n", "YUV4MPEG2 W0 H3 Cmono\n",
                             "YUV4MPEG2 W4 Cmono\n", "YUV4MPEG2 W99999999999 H3 Cmono\n"}) {
    GreyStream stream;
    EXPECT_TRUE(contains(error_of([&] { stream.add(bytes_of(header)); }), "no grey frames"));
  }
  GreyStream endless;
  EXPECT_TRUE(
      contains(error_of([&] { endless.add(std::vector<uint8_t>(5000, 'x')); }), "no grey frames"));
}

}  // namespace
}  // namespace nerf::internal
