// Pictures in the light of a photo.
#include <gtest/gtest.h>

#include <memory>

#include "model/coded_fields.h"
#include "model/some_info.h"
#include "nerf/model/field.h"
#include "nerf/model/integrator.h"
#include "nerf/model/network_field.h"
#include "nerf/model/radiance_field.h"
#include "nerf/model/renderer.h"
#include "support/cameras.h"
#include "support/network_options.h"
#include "support/tables.h"
#include "support/temp_folder.h"

namespace nerf {
namespace {

using test::contains;
using test::error_of;
using test::fill_codes;
using test::grid_with_codes;
using test::kPhotos;

RadianceField network_with_codes() {
  NetworkOptions o = test::small_network(test::nerf_options());
  o.image_code = 6;
  o.density = DensityActivation::kSoftplus;
  auto network = std::make_shared<NetworkField>(o, 0.5, 4, kPhotos);
  network->initialise(3);
  fill_codes(*network);
  ModelInfo info = test::some_info();
  info.method = "network";
  return RadianceField(info, std::move(network));
}

std::vector<Ray> some_rays() {
  std::vector<Ray> rays(60);
  for (size_t i = 0; i < rays.size(); ++i) {
    const double a = 0.01 * static_cast<double>(i) - 0.3;
    rays[i].origin = {a, 0.1, -2};
    rays[i].direction = normalized(Vec3d{0.3 * a, a, 1});
  }
  return rays;
}

std::vector<Real> colours(const RadianceField& field, const Appearance& appearance,
                          int threads = 2) {
  ThreadPool pool(threads);
  RenderOptions options;
  options.appearance = appearance;
  return integrate(field, some_rays(), {}, options, pool).rgb;
}

class InTheLightOf : public ::testing::TestWithParam<bool> {
 protected:
  RadianceField field = GetParam() ? grid_with_codes() : network_with_codes();
  Appearance of(int photo) const {
    return appearance_of(field.field().codes(), field.field().all_weights(), photo);
  }
};
INSTANTIATE_TEST_SUITE_P(Fields, InTheLightOf, ::testing::Bool());

TEST_P(InTheLightOf, PhotosDiffer) {
  const auto dawn = colours(field, of(0)), noon = colours(field, of(1));
  EXPECT_NE(dawn, noon);
  EXPECT_NE(dawn, colours(field, {}));
  EXPECT_EQ(dawn, colours(field, of(0), 1));
}

TEST_P(InTheLightOf, WithoutAPhotoItIsTheFieldsOwn) {
  Appearance own;
  own.code = field.field().default_code(0);
  EXPECT_EQ(own.code.size(), 6u);
  EXPECT_EQ(colours(field, {}), colours(field, own));
}

// What a query at points says of a photo is what rays see in its light, but for their change of
// colour.
TEST_P(InTheLightOf, QueriesKnowPhotos) {
  const auto query = field.field().query(nullptr);
  const Vec3d at{0.1, 0.2, 0.3}, along{0, 0, 1};
  std::vector<Real> a(3), b(3), none(3);
  const auto ask = [&](int photo, std::vector<Real>& rgb) {
    FieldPoints points{std::span(&at, 1), std::span(&along, 1)};
    points.photo = photo;
    query->ask(points, {{}, rgb, {}});
  };
  ask(0, a);
  ask(1, b);
  EXPECT_NE(a, b);
  ask(-1, none);
  ask(0, b);
  EXPECT_EQ(a, b);  // whatever was asked in between
  EXPECT_NE(none, a);
}

TEST_P(InTheLightOf, ModelFilesKeepIt) {
  const test::TempFolder folder;
  field.save(folder / "m");
  const RadianceField loaded = RadianceField::load(folder / "m");
  EXPECT_EQ(loaded.field().codes().photos, kPhotos);
  const auto codes = [](const RadianceField& f) {
    const auto all = f.field().all_weights();
    return std::vector<Real>(all.end() - static_cast<ptrdiff_t>(f.field().codes().size()),
                             all.end());
  };
  const auto written = codes(field), read = codes(loaded);
  ASSERT_EQ(written.size(), read.size());
  for (size_t i = 0; i < read.size(); ++i)  // files hold floats
    EXPECT_EQ(static_cast<float>(written[i]), static_cast<float>(read[i]));
  EXPECT_EQ(colours(loaded, {}).size(), colours(field, {}).size());
}

TEST_P(InTheLightOf, OtherModelsNumbersAreRefused) {
  Appearance other;
  other.code.resize(5);
  EXPECT_TRUE(contains(error_of([&] { colours(field, other); }), "5 numbers"));
  other = {};
  other.colours.resize(3);
  EXPECT_TRUE(contains(error_of([&] { colours(field, other); }), "3 numbers"));
}

TEST(InTheLight, ColoursAreChangedLast) {
  const RadianceField field = grid_with_codes();
  Appearance appearance = appearance_of(field.field().codes(), field.field().all_weights(), 2);
  Appearance code_alone = appearance;
  code_alone.colours.clear();
  ThreadPool pool(2);
  RenderOptions options;
  options.appearance = code_alone;
  const auto rays = some_rays();
  const RayResults before = integrate(field, rays, {}, options, pool);
  const auto after = colours(field, appearance);
  bool any = false;
  for (size_t i = 0; i < rays.size(); ++i) {
    const auto changed =
        appearance.changed(before.rgb.data() + 3 * i, before.opacity[i], rays[i].background);
    for (size_t k = 0; k < 3; ++k) {
      EXPECT_EQ(after[3 * i + k], std::clamp(changed[k], 0.0_r, 1.0_r));
      any = any || after[3 * i + k] != before.rgb[3 * i + k];
    }
  }
  EXPECT_TRUE(any);
}

}  // namespace
}  // namespace nerf
