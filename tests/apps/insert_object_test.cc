// Where --insert stands an object.
#include "insert_object.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>

#include "geometry/shapes.h"
#include "io/some_gltf.h"
#include "model/analytic_field.h"
#include "model/homogeneous_field.h"
#include "nerf/io/mesh_file.h"
#include "nerf/math/srgb.h"
#include "support/cameras.h"
#include "support/temp_folder.h"

namespace nerf::apps {
namespace {

TEST(ParsePlace, TakesAViewAndAPixel) {
  const auto place = parse_place("left/a@b.jpg@12.5,7");
  ASSERT_TRUE(place);
  EXPECT_EQ(place->view, "left/a@b.jpg");
  EXPECT_EQ(place->pixel, (Vec2d{12.5, 7}));
  const auto share = parse_place("a@50%,8");
  ASSERT_TRUE(share);
  EXPECT_TRUE(share->percent_x);
  EXPECT_FALSE(share->percent_y);
  for (const char* text :
       {"", "a@1%2,3", "a@nan,1", "a", "@1,2", "a@", "a@1", "a@1,", "a@1,2,3", "a@x,2", "a@1,2 "})
    EXPECT_FALSE(parse_place(text)) << text;
}

TEST(ParseLights, TakesDirectionsAndColours) {
  const auto lights = parse_lights("0,3,-4 2,0,0:0.5,0.25,0");
  ASSERT_EQ(lights.size(), 2u);
  EXPECT_LT(length(lights[0].towards - Vec3d{0, 0.6, -0.8}), 1e-12);
  EXPECT_EQ(lights[0].light, (Vec3d{5, 5, 5}));
  EXPECT_EQ(lights[1].towards, (Vec3d{1, 0, 0}));
  EXPECT_EQ(lights[1].light, (Vec3d{0.5, 0.25, 0}));
  EXPECT_TRUE(parse_lights("").empty());
  for (const char* text : {"1,2", "1,2,3,4", "x,1,2", "0,0,0", "nan,1,2", "1,2,3:", "1,2,3:1,1",
                           "1,2,3:-1,1,1", "1,2,3:1,1,1:1", "1,2,3 4", "1,2,3:1,1,1,", "1,2,1e300"})
    EXPECT_TRUE(test::contains(test::error_of([&] { parse_lights(text); }), "--light: '")) << text;
}

TEST(InsertOptions, CombinationsAreChecked) {
  const auto problem = [](const auto& change) {
    InsertOptions o;
    change(o);
    return test::error_of([&] { o.check_options(); });
  };
  EXPECT_EQ(problem([](InsertOptions&) {}), "");
  EXPECT_TRUE(test::contains(problem([](auto& o) { o.scale = 2; }), "--insert"));
  EXPECT_TRUE(test::contains(problem([](auto& o) { o.object_start = 2; }), "--insert"));
  EXPECT_TRUE(test::contains(problem([](auto& o) {
                               o.insert = "a.glb";
                               o.at = Vec3d{};
                               o.place = "floor@1,2";
                             }),
                             "--place"));
  EXPECT_TRUE(test::contains(problem([](auto& o) {
                               o.insert = "a.glb";
                               o.place = "floor";
                             }),
                             "VIEW@X,Y"));
  EXPECT_TRUE(test::contains(problem([](auto& o) {
                               o.insert = "a.glb";
                               o.field_light = false;
                             }),
                             "--light"));
  EXPECT_TRUE(test::contains(problem([](auto& o) { o.light = "1,2,3"; }), "--insert"));
  EXPECT_TRUE(test::contains(problem([](auto& o) {
                               o.insert = "a.glb";
                               o.light = "1,2,3 1,2";
                             }),
                             "'1,2' is no light"));
}

TEST(PlayedTime, GoesRoundBetweenTheKeysOrStaysAtTheLast) {
  EXPECT_EQ(played_time(0.5, 1, 3, true), 1);  // before the first key
  EXPECT_EQ(played_time(3, 1, 3, true), 3);
  EXPECT_EQ(played_time(3.5, 1, 3, true), 1.5);
  EXPECT_EQ(played_time(8, 1, 3, true), 2);
  EXPECT_EQ(played_time(8, 1, 3, false), 3);
  EXPECT_EQ(played_time(8, 2, 2, true), 2);
}

// A floor at engine z = -0.2 that a camera looks down on.
RadianceField floor_field() {
  const RadianceField field =
      test::surface_field(test::tilted(), [](const Vec3d& p) { return p.z + 0.2; });
  ModelInfo info = field.info();
  ModelView view;
  view.name = "left/a.jpg";
  view.camera = test::pinhole(80, 60, 90);
  view.pose = info.to_engine.apply_inverse(test::looking_at({1.5, 0.3, 1}, {0, 0, -0.2}));
  info.views = {view};
  return RadianceField(info, std::make_shared<GridField>(field.grid()));
}

// Two metres high, its origin in the middle.
SceneObject post() {
  SceneObject object;
  object.mesh.positions = {{-0.1_r, -1, -0.1_r}, {0.1_r, -1, 0.1_r}, {0, 1, 0}};
  object.mesh.triangles = {{0, 1, 2}};
  object.material = {0};
  object.materials.resize(1);
  return object;
}

TEST(ObjectToInput, StandsUprightWhereItIsPut) {
  const RadianceField field = floor_field();
  const ModelInfo& info = field.info();
  ThreadPool pool(1);
  const RenderOptions render;
  InsertOptions options;
  options.insert = "post.glb";
  const Vec3d up = info.to_engine.rotation.transposed() * Vec3d{0, 0, 1};
  // By itself: in the frame of the files that nerf_export writes.
  Similarity s = object_to_input(options, field, post(), render, pool);
  const Vec3d p{0.3, -2, 5};
  EXPECT_LT(length(s.apply(p) - input_to_gltf(info).inverse().apply(p)), 1e-9);
  options.at = Vec3d{7, 8, 9};
  options.scale = 0.5;
  options.rotate = {0, 90, 0};
  s = object_to_input(options, field, post(), render, pool);
  EXPECT_LT(length(s.apply(Vec3d{}) - *options.at), 1e-9);
  EXPECT_LT(length(s.apply(Vec3d{0, 1, 0}) - (*options.at + up * 0.5)), 1e-9);
  // A quarter of a turn about its y: its z is where its x was.
  InsertOptions straight = options;
  straight.rotate = {};
  const Similarity t = object_to_input(straight, field, post(), render, pool);
  EXPECT_LT(length(s.apply(Vec3d{0, 0, 1}) - t.apply(Vec3d{1, 0, 0})), 1e-9);
}

// A triangle that rises by a metre a second for two seconds.
TEST(InsertObject, PlaysItsAnimation) {
  const RadianceField field = floor_field();
  const test::TempFolder folder;
  test::SomeGltf gltf;
  gltf.animate(0, "translation", {0, 2}, {0, 0, 0, 0, 2, 0}, "VEC3");
  gltf.write(folder / "rising.glb");
  ThreadPool pool(1);
  const RenderOptions render;
  InsertOptions options;
  options.insert = folder / "rising.glb";
  options.at = field.info().to_engine.center;
  options.object_start = 0.5;
  options.rotate = {-90, 0, 0};
  options.object_shadow = false;
  const auto height = [](const InsertedObject& o) { return o.mesh.positions[0].y; };
  InsertedObject object = insert_object(options, field, 0.25, render, pool);
  EXPECT_EQ(height(object), 0.75_r);
  object.show(1, render, pool);
  EXPECT_EQ(height(object), 1.5_r);
  object.show(2, render, pool);
  EXPECT_EQ(height(object), 0.5_r) << "from the start again";
  options.object_loop = false;
  InsertedObject once = insert_object(options, field, 9, render, pool);
  EXPECT_EQ(height(once), 2);
  // It faces a camera above and grows as it comes nearer.
  const ModelInfo& info = field.info();
  const Pose pose = info.to_engine.apply_inverse(test::looking_at({0.02, 0.01, 1.5}, {0.02, 0, 0}));
  const auto pixels = [&](double seconds) {
    once.show(seconds - options.object_start, render, pool);
    const auto picture = [&](const Insertion* with) {
      return nerf::render(field, test::pinhole(80, 80, 100), pose, render, pool, {}, nullptr, with);
    };
    const Frame with = picture(once.insertion.get()), without = picture(nullptr);
    int changed = 0;
    for (size_t i = 0; i < with.depth_z.size(); ++i)
      changed += with.depth_z[i] != without.depth_z[i];
    return changed;
  };
  const int far = pixels(0), near = pixels(1);
  EXPECT_GT(far, 20);
  EXPECT_GT(near, far + 5);
  EXPECT_EQ(pixels(0), far);
}

// Light is linear: that of two lights is the sum, and what one lacks it does not give.
TEST(InsertObject, ItsLightsAddUp) {
  const RadianceField field = floor_field();
  const ModelInfo& info = field.info();
  const test::TempFolder folder;
  test::SomeGltf gltf;
  gltf.json["materials"][0].erase("alphaMode");
  gltf.json["materials"][0].erase("emissiveFactor");
  gltf.write(folder / "triangle.glb");
  ThreadPool pool(1);
  const RenderOptions render;
  InsertOptions options;
  options.insert = folder / "triangle.glb";
  options.at = info.to_engine.center;
  options.rotate = {-90, 0, 0};  // it faces upwards
  options.object_shadow = false;
  options.field_light = false;
  const Pose pose = info.to_engine.apply_inverse(test::looking_at({0.1, 0.1, 1.5}, {0.1, 0.1, 0}));
  const auto shown = [&](const std::string& lights) {
    options.light = lights;
    const InsertedObject object = insert_object(options, field, 0, render, pool);
    const Frame f = nerf::render(field, test::pinhole(9, 9, 200), pose, render, pool, {}, nullptr,
                                 object.insertion.get());
    Vec3d linear;
    for (int k = 0; k < 3; ++k)
      linear[k] = srgb_to_linear(static_cast<double>(f.rgb[3 * 40 + static_cast<size_t>(k)]));
    return linear;
  };
  const auto light = [&](const Vec3d& towards, const std::string& colour) {
    const Vec3d d = info.to_engine.rotation.transposed() * towards;
    return fmt::format("{},{},{}:{}", d.x, d.y, d.z, colour);
  };
  const std::string red = light({0.3, 0, 1}, "0.5,0,0"), other = light({0, -0.5, 1}, "0.2,0.6,0.4");
  const Vec3d a = shown(red), b = shown(other), both = shown(red + " " + other);
  EXPECT_GT(a.x, 0.2);
  EXPECT_NEAR(a.y, 0, 1e-6);
  EXPECT_GT(b.y, 0.1);
  EXPECT_LT(length(both - (a + b)), 1e-4);
  // Lights are in input coordinates: from below nothing comes.
  EXPECT_NEAR(shown(light({0, 0, -1}, "1,1,1")).x, 0, 1e-6);
}

TEST(ObjectToInput, StandsOnTheSurfaceUnderAPixel) {
  const RadianceField field = floor_field();
  const ModelInfo& info = field.info();
  ThreadPool pool(1);
  InsertOptions options;
  options.insert = "post.glb";
  options.place = "a@47,33";
  options.scale = 0.3;
  options.rotate = {0, 30, 0};
  const Similarity s = object_to_input(options, field, post(), {}, pool);
  const Vec3d below = info.to_engine.apply(s.apply(Vec3d{0, -1, 0}));
  EXPECT_NEAR(below.z, -0.2, 0.01);
  const Vec3d above = info.to_engine.apply(s.apply(Vec3d{0, 1, 0}));
  EXPECT_LT(length(above - below - Vec3d{0, 0, 2 * 0.3 * info.to_engine.scale}), 1e-9);
  // Seen in that pixel.
  const ModelView& view = info.views[0];
  const auto pixel = project(view.camera, view.pose.inverse() * s.apply(Vec3d{0, -1, 0}));
  ASSERT_TRUE(pixel);
  EXPECT_NEAR(pixel->x, 47, 0.1);
  EXPECT_NEAR(pixel->y, 33, 0.1);
  options.place = "floor@58.75%,55%";  // the same pixel
  EXPECT_LT(
      length(object_to_input(options, field, post(), {}, pool).apply(Vec3d{}) - s.apply(Vec3d{})),
      1e-9);
  const auto problem = [&](const std::string& place) {
    options.place = place;
    return test::error_of([&] { object_to_input(options, field, post(), {}, pool); });
  };
  EXPECT_TRUE(test::contains(problem("b@1,1"), "no view"));
  EXPECT_TRUE(test::contains(problem("floor@90,1"), "80 x 60"));
  EXPECT_TRUE(test::contains(problem("floor@1,1"), "nothing is seen"));
}

}  // namespace
}  // namespace nerf::apps
