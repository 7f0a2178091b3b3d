// Light and shadows of objects in pictures: closed forms.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "geometry/shapes.h"
#include "model/analytic_field.h"
#include "model/exact_options.h"
#include "model/homogeneous_field.h"
#include "model/object_light.h"
#include "model/some_objects.h"
#include "nerf/math/srgb.h"
#include "nerf/model/insertion.h"
#include "support/cameras.h"

namespace nerf {
namespace {

using internal::Environment;
using test::add_rectangle;
using test::along_x;
using test::box_around;
using test::exact_options;
using test::middle_of;
using test::narrow;
using test::screen;
using test::unlit;
using test::without_shadows;

TEST(Environment, IsItsClosedForms) {
  const Environment grey(Vec3d{0.2, 0.5, 0.7});
  const Environment sloped =
      Environment::from([](const Vec3d& d) { return Vec3d{1 + d.z, 1 + d.x, 1}; });
  for (const Vec3d& n : {Vec3d{0, 0, 1}, normalized(Vec3d{1, -2, 0.5}), Vec3d{-1, 0, 0}}) {
    EXPECT_NEAR(grey.diffuse(n).y, 0.5, 2e-3);
    for (const double roughness : {0.0, 0.5, 1.0})
      EXPECT_NEAR(grey.mirrored(n, roughness).z, 0.7, 2e-3);
    // Irradiance over pi of 1 + z: 1 + 2/3 of the normal's z.
    EXPECT_NEAR(sloped.diffuse(n).x, 1 + 2.0 / 3 * n.z, 5e-3);
    EXPECT_NEAR(sloped.diffuse(n).y, 1 + 2.0 / 3 * n.x, 5e-3);
    EXPECT_NEAR(sloped.radiance(n).y, 1 + n.x, 0.01);
  }
}

// A black disc of radius r at height h above a floor, under an even sky: the point below its centre
// loses r^2 / (r^2 + h^2) of the light.
TEST(Insertion, CastsTheShadowOfADisc) {
  constexpr double kFloor = -0.5, kRadius = 0.2, kHeight = 0.25;
  const RadianceField field =
      test::surface_field(Similarity(), [](const Vec3d& p) { return p.z - kFloor; });
  ThreadPool pool(2);
  RenderOptions options = exact_options();
  InsertionOptions many;
  many.shadow_rays = 400;
  const Insertion above(field, test::black_disc(kFloor + kHeight, kRadius), many, options, pool);
  const Pose pose = test::from_above({0, 0, kFloor});
  const Camera camera = test::pinhole(41, 41, 800);
  const Frame plain = render(field, camera, pose, options, pool);
  const Frame f = render(field, camera, pose, options, pool, {}, nullptr, &above);
  const size_t p = middle_of(f);
  const double left = srgb_to_linear(static_cast<double>(f.rgb[3 * p])) /
                      srgb_to_linear(static_cast<double>(plain.rgb[3 * p]));
  const double expected = 1 - kRadius * kRadius / (kRadius * kRadius + kHeight * kHeight);
  // Nine harmonics say of a half-white sphere's light to 2 %; the floor sends some back.
  EXPECT_NEAR(left, expected, 0.04);
}

TEST(Insertion, AWhiteBallInEvenLightIsWhite) {
  const RadianceField field = test::homogeneous_field(Similarity(), true);
  ThreadPool pool(2);
  const RenderOptions options = exact_options();  // white
  SceneObject object = box_around({-5, 0, 0}, 0.2_r);
  object.materials[0] = {};
  object.materials[0].metallic = 0;
  object.materials[0].base = {0.25, 0.5, 1};
  InsertionOptions plain;
  plain.field_light = false;
  plain.lights = {{{-1, 0, 0}, {1, 1, 1}}};
  const Insertion lit(field, object, plain, options, pool);
  const Frame f = render(field, narrow(), along_x(-8), options, pool, {}, nullptr, &lit);
  const size_t p = middle_of(f);
  // Head on, rough: the base colour and what 4 % of the light a rough surface mirrors.
  for (size_t k = 0; k < 3; ++k)
    EXPECT_NEAR(srgb_to_linear(static_cast<double>(f.rgb[3 * p + k])),
                std::min(1.0, object.materials[0].base[static_cast<int>(k)] + 0.01), 0.01);
}

// Light on an object in a field that is 0.5 wherever one looks.
TEST(Insertion, AnObjectInAnEvenlyLitFieldHasItsBaseColour) {
  const RadianceField field = test::homogeneous_field(Similarity());
  ThreadPool pool(2);
  RenderOptions options = exact_options();
  options.background = {0.5_r, 0.5_r, 0.5_r};
  SceneObject object = box_around({-5, 0, 0}, 0.2_r);
  object.materials[0] = {};
  object.materials[0].metallic = 0;
  object.materials[0].base = {0.25, 0.5, 1};
  const Insertion lit(field, object, {}, options, pool);
  const Frame f = render(field, narrow(), along_x(-8), options, pool, {}, nullptr, &lit);
  const size_t p = middle_of(f);
  // Head on a surface of roughness 1 mirrors 0.04 * 0.452 - 0.002 of the light (Karis's fit).
  const double light = srgb_to_linear(0.5), mirrored = 0.0157;
  for (size_t k = 0; k < 3; ++k)
    EXPECT_NEAR(srgb_to_linear(static_cast<double>(f.rgb[3 * p + k])) / light,
                object.materials[0].base[static_cast<int>(k)] + mirrored, 0.005);
}

// A mirror across the camera's way shows a ball that is out of sight in each pixel whose mirrored
// ray meets it, times its base colour, and the background in the others.
TEST(Insertion, ASmoothMetallicPlateMirrorsABall) {
  constexpr double kRadius = 0.15;
  const Vec3d centre{-0.3, 0, 0.5};
  const RadianceField field = test::surface_field(
      Similarity(), [&](const Vec3d& p) { return length(p - centre) - kRadius; });
  ThreadPool pool(2);
  RenderOptions options = exact_options();
  options.background = {0.9_r, 0.1_r, 0.2_r};
  SceneObject plate;
  plate.materials.resize(1);
  plate.materials[0].base = {1, 0.5, 0.25};
  plate.materials[0].roughness = 0;
  constexpr double kPlate = 0.7;
  const Real x = static_cast<Real>(kPlate);
  add_rectangle({x, -0.5_r, -0.5_r}, {0, 0, 1}, {0, 1, 0}, 0, plate);
  const Insertion mirror(field, plate, without_shadows(), options, pool);
  const Camera camera = test::pinhole(64, 64, 250);  // sees 0.47 of the plate to each side
  const Frame f = render(field, camera, along_x(), options, pool, {}, nullptr, &mirror);
  const auto passes = [&](const Vec3d& origin, const Vec3d& direction) {  // the ball's middle, at
    const Vec3d to = centre - origin;
    return length(to - direction * dot(to, direction));
  };
  int balls = 0, others = 0;
  for (int row = 0; row < camera.height; ++row)
    for (int column = 0; column < camera.width; ++column) {
      const Vec3d origin = along_x().translation;
      const Vec3d d =
          normalized(along_x().rotation * *unproject(camera, {column + 0.5, row + 0.5}));
      if (passes(origin, d) < 1.2 * kRadius) continue;  // before the plate
      const Vec3d at = origin + d * ((kPlate - origin.x) / d.x);
      const double distance = passes(at, {-d.x, d.y, d.z});
      if (std::fabs(distance - kRadius) < 0.2 * kRadius) continue;  // its edge
      const bool ball = distance < kRadius;
      balls += ball;
      others += !ball;
      const size_t p = static_cast<size_t>(row * camera.width + column);
      const double seen[3] = {ball ? 0.5 : 0.9, ball ? 0.5 : 0.1, ball ? 0.5 : 0.2};
      // At these angles Karis's fit reflects 0.994 of a metal's colour and 0.006 more.
      for (size_t k = 0; k < 3; ++k)
        ASSERT_NEAR(srgb_to_linear(static_cast<double>(f.rgb[3 * p + k])),
                    plate.materials[0].base[static_cast<int>(k)] * srgb_to_linear(seen[k]), 0.008)
            << column << ", " << row;
    }
  EXPECT_GT(balls, 100);
  EXPECT_GT(others, 1000);
}

TEST(Insertion, EmittedLightIsDrawnWithoutAnyOther) {
  const RadianceField field = test::homogeneous_field(Similarity());
  ThreadPool pool(2);
  const RenderOptions options = exact_options();
  SceneObject object = screen(-2, 1);
  object.materials[0].unlit = false;
  object.materials[0].emissive = srgb_to_linear(Vec3d{0.3, 0.7, 0.5});
  object.mesh.normals.clear();
  InsertionOptions dark = without_shadows();
  dark.field_light = false;
  const Insertion glowing(field, std::move(object), dark, options, pool);
  const Frame f = render(field, narrow(), along_x(), options, pool, {}, nullptr, &glowing);
  const size_t p = middle_of(f);
  const double expected[3] = {0.3, 0.7, 0.5};
  for (size_t k = 0; k < 3; ++k) EXPECT_NEAR(f.rgb[3 * p + k], expected[k], 1e-5);
}

// What is below the cutoff is not there, and the rest as if it were opaque: drawn and in shadows.
TEST(Insertion, AMaskCutsOutWhatIsDrawnAndItsShadow) {
  const RadianceField field =
      test::surface_field(Similarity(), [](const Vec3d& p) { return p.z + 0.5; });
  ThreadPool pool(2);
  const RenderOptions options = exact_options();
  // Two halves of a table above the floor, with alpha 0.6 and 0.7 by their texture.
  SceneObject table;
  add_rectangle({-0.3_r, -0.4_r, -0.3_r}, {0.6_r, 0, 0}, {0, 0.4_r, 0}, 0, table);
  add_rectangle({-0.3_r, 0, -0.3_r}, {0.6_r, 0, 0}, {0, 0.4_r, 0}, 1, table);
  table.uv[0].assign(8, Vec2{0.25_r, 0.5_r});
  std::fill(table.uv[0].begin() + 4, table.uv[0].end(), Vec2{0.75_r, 0.5_r});
  Texture texture;
  texture.width = 2;
  texture.height = 1;
  texture.nearest = true;
  texture.pixels = {255, 255, 255, 153, 255, 255, 255, 179};
  table.textures = {texture};
  const auto pictures = [&](const Material& first, const Material& second) {
    SceneObject object = table;
    object.materials = {first, second};
    const Insertion above(field, object, {}, options, pool);
    return render(field, test::pinhole(60, 60, 80),
                  test::looking_at({-1.5, 0.2, 0.7}, {0, 0, -0.4}), options, pool, {}, nullptr,
                  &above)
        .rgb;
  };
  Material masked = unlit({0.2, 0.4, 0.9});
  masked.alpha_mode = AlphaMode::kMask;
  masked.base_texture.texture = 0;
  const auto with_cutoff = [&](double cutoff) {
    masked.alpha_cutoff = cutoff;
    return pictures(masked, masked);
  };
  const Material gone = unlit({0.2, 0.4, 0.9}, 0), there = unlit({0.2, 0.4, 0.9});
  EXPECT_EQ(with_cutoff(0.65), pictures(gone, there));
  EXPECT_EQ(with_cutoff(0.55), pictures(there, there));
  EXPECT_EQ(with_cutoff(0.75), pictures(gone, gone));
  EXPECT_NE(pictures(gone, there), pictures(there, there));
  EXPECT_NE(pictures(gone, there), pictures(gone, gone));
}

}  // namespace
}  // namespace nerf
