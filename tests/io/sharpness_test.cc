#include "io/sharpness.h"

#include <gtest/gtest.h>

#include <string>

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
  const std::vector<double> scores{1, 5, 2, 9, 3, 3, 8};
  EXPECT_EQ(sharpest_of_windows(scores, 2), (std::vector<int>{1, 3}));
  EXPECT_EQ(sharpest_of_windows(scores, 3), (std::vector<int>{1, 3, 6}));
  EXPECT_EQ(sharpest_of_windows(scores, 1), (std::vector<int>{3}));
  EXPECT_EQ(sharpest_of_windows(scores, 100), (std::vector<int>{0, 1, 2, 3, 4, 5, 6}));
  EXPECT_TRUE(sharpest_of_windows({}, 3).empty());
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
