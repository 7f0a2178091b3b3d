// Exposures as cameras write them beside the pixels, and what is no exposure.
#include "io/shot_tags.h"

#include <cmath>
#include <limits>

#include "io/test_images.h"
#include "nerf/io/image.h"

namespace nerf::internal {
namespace {

using test::contains;
using test::make_image;
using test::TempFolder;

OIIO::ImageSpec said(const std::vector<std::pair<const char*, float>>& numbers) {
  OIIO::ImageSpec spec(8, 8, 3, OIIO::TypeDesc::UINT8);
  for (const auto& [name, x] : numbers) spec.attribute(name, x);
  return spec;
}

TEST(ShotTags, AreReadFromAFile) {
  const TempFolder folder;
  const auto path = folder / "a.jpg";
  make_image(path,
             {16, 12, 3, OIIO::TypeDesc::UINT8,
              [](OIIO::ImageSpec& spec) {
                spec.attribute("Make", "Maker");
                spec.attribute("Model", "One");
                spec.attribute("ExposureTime", 0.008f);
                spec.attribute("FNumber", 2.8f);
                spec.attribute("Exif:PhotographicSensitivity", 400);
                spec.attribute("Exif:FocalLength", 4.2f);
              }},
             test::texture);
  const ShotTags tags = read_image_info(path).shot;
  EXPECT_NEAR(tags.seconds, 0.008, 1e-6);
  EXPECT_NEAR(tags.aperture, 2.8, 1e-5);
  EXPECT_EQ(tags.sensitivity, 400);
  EXPECT_EQ(tags.camera, "Maker One, 4.2 mm");
  EXPECT_EQ(tags.nonsense, "");
  make_image(folder / "b.png", {16, 12, 3, OIIO::TypeDesc::UINT8, {}}, test::texture);
  const ShotTags none = read_image_info(folder / "b.png").shot;
  EXPECT_EQ(none.seconds, 0);
  EXPECT_EQ(none.camera, "");
}

TEST(ShotTags, NonsenseIsNotSaid) {
  const float inf = std::numeric_limits<float>::infinity();
  const float nan = std::numeric_limits<float>::quiet_NaN();
  for (const float bad : {0.0f, -1.0f, inf, -inf, nan, 1e9f, 1e-12f}) {
    const ShotTags time = shot_tags(said({{"ExposureTime", bad}, {"FNumber", 2}}));
    EXPECT_EQ(time.seconds, 0) << bad;
    EXPECT_EQ(time.aperture, 2);
    EXPECT_TRUE(contains(time.nonsense, "an exposure time of")) << bad;
    EXPECT_EQ(shot_tags(said({{"FNumber", bad}})).aperture, 0) << bad;
    EXPECT_EQ(shot_tags(said({{"Exif:ISOSpeedRatings", bad}})).sensitivity, 0) << bad;
  }
  for (const float bad : {inf, -inf, nan, 300.0f, -1e9f})
    EXPECT_EQ(shot_tags(said({{"Exif:ShutterSpeedValue", bad}})).seconds, 0) << bad;
  EXPECT_EQ(shot_tags(said({{"Exif:ISOSpeedRatings", 1e8f}})).sensitivity, 0);
  OIIO::ImageSpec text = said({});
  text.attribute("ExposureTime", "long");
  EXPECT_EQ(shot_tags(text).seconds, 0);
  EXPECT_EQ(shot_tags(text).nonsense, "");
}

TEST(ShotTags, ComeInSeveralForms) {
  const ShotTags apex = shot_tags(said({{"Exif:ShutterSpeedValue", 5}, {"Exif:ApertureValue", 4}}));
  EXPECT_NEAR(apex.seconds, 1.0 / 32, 1e-12);
  EXPECT_NEAR(apex.aperture, 4, 1e-12);
  EXPECT_EQ(shot_tags(said({{"Exif:ISOSpeedRatings", 64}})).sensitivity, 64);
  // What 16 bits cannot say stands in another tag, or nowhere.
  EXPECT_EQ(shot_tags(said({{"Exif:PhotographicSensitivity", 65535},
                            {"Exif:RecommendedExposureIndex", 102400}}))
                .sensitivity,
            102400);
  const ShotTags too_large = shot_tags(said({{"Exif:PhotographicSensitivity", 65535}}));
  EXPECT_EQ(too_large.sensitivity, 0);
  EXPECT_EQ(too_large.nonsense, "");
  // The three say what the bias made the camera do.
  EXPECT_EQ(shot_tags(said({{"Exif:ExposureBiasValue", 2}})).seconds, 0);
}

std::vector<std::optional<double>> exposures(const std::vector<ShotTags>& tags,
                                             SceneReport* report = nullptr) {
  std::vector<View> views(tags.size());
  for (size_t i = 0; i < views.size(); ++i) views[i].name = "photo" + std::to_string(i);
  SceneReport own;
  find_exposures(tags, views, report ? *report : own);
  std::vector<std::optional<double>> out;
  for (const View& v : views) out.push_back(v.exposure);
  return out;
}

// log2(1/100 * 100 / 2^2), then two stops more by each.
TEST(ShotTags, ExposureIsRelativeToTheMedian) {
  SceneReport report;
  const auto e = exposures({{0.01, 2, 100, "", ""},
                            {0.04, 2, 100, "", ""},
                            {0.01, 1, 100, "", ""},
                            {0.01, 2, 400, "", ""},
                            {0.01, 4, 100, "", ""}},
                           &report);
  const double want[] = {-2, 0, 0, 0, -4};
  for (size_t i = 0; i < e.size(); ++i) EXPECT_NEAR(e[i].value_or(99), want[i], 1e-12) << i;
  EXPECT_EQ(report.exposure, "EXIF of 5 of 5 photos, which differ by 4.0 stops");
  EXPECT_TRUE(report.notes.empty());
}

TEST(ShotTags, PhotosThatSayTooLittleStayUnknown) {
  SceneReport report;
  const auto e = exposures({{0.01, 2, 100, "", ""},
                            {0.01, 0, 100, "", ""},  // others name an aperture
                            {0, 2, 100, "", "an exposure time of 0 s"},
                            {0.02, 2, 100, "", ""}},
                           &report);
  EXPECT_TRUE(e[0] && e[3]);
  EXPECT_FALSE(e[1] || e[2]);
  ASSERT_EQ(report.notes.size(), 1u);
  EXPECT_TRUE(contains(report.notes[0], "1 of 4 photos"));
  EXPECT_TRUE(contains(report.notes[0], "photo2 says an exposure time of 0 s"));
  // A lens that cannot be closed is the same for all.
  const auto fixed = exposures({{0.01, 0, 100, "", ""}, {0.02, 0, 100, "", ""}});
  ASSERT_TRUE(fixed[0] && fixed[1]);
  EXPECT_NEAR(*fixed[1] - *fixed[0], 1, 1e-12);
  SceneReport none;
  EXPECT_FALSE(exposures({{}, {}}, &none)[0]);
  EXPECT_EQ(none.exposure, "");
}

}  // namespace
}  // namespace nerf::internal
