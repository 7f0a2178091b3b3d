// Objects that move: nodes' animations, skins and morph targets against closed forms.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "io/some_gltf.h"
#include "nerf/io/object_file.h"
#include "support/temp_folder.h"

namespace nerf {
namespace {

using test::Json;
using test::SomeGltf;

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

class ObjectMotionTest : public ::testing::Test {
 protected:
  ReadObject read(SomeGltf& gltf, const std::string& animation = "") {
    const auto bytes = gltf.glb();
    test::write_text(file_, std::string(bytes.begin(), bytes.end()));
    return read_object(file_, animation);
  }
  std::string error(SomeGltf& gltf, const std::string& animation = "") {
    return test::error_of([&] { read(gltf, animation); });
  }
  test::TempFolder folder_;
  std::filesystem::path file_ = folder_ / "moving.glb";
};

Vec3d corner(const TriangleMesh& mesh, int k) { return mesh.corner(0, k).cast<double>(); }

TEST_F(ObjectMotionTest, ATranslatedObjectIsWhereItShouldBe) {
  SomeGltf gltf;
  gltf.animate(0, "translation", {0, 2}, {0, 0, 0, 4, -2, 1}, "VEC3");
  ReadObject o = read(gltf);
  ASSERT_TRUE(o.motion);
  EXPECT_TRUE(o.notes.empty());
  EXPECT_EQ(o.motion->first(), 0);
  EXPECT_EQ(o.motion->last(), 2);
  EXPECT_LT(length(corner(o.object.mesh, 1) - Vec3d{1, 0, 0}), 1e-6);
  for (const double t : {0.0, 0.25, 1.9, 2.0, 7.0}) {
    o.motion->pose(t, o.object.mesh);
    const double u = std::min(t / 2, 1.0);
    EXPECT_LT(length(corner(o.object.mesh, 1) - Vec3d{1 + 4 * u, -2 * u, u}), 1e-6) << t;
  }
}

// A child of a node that turns, stretched: positions and normals.
TEST_F(ObjectMotionTest, NodesCarryTheirChildren) {
  SomeGltf gltf;
  gltf.primitive()["attributes"]["NORMAL"] = gltf.add_floats({1, 0, 1, 1, 0, 1, 1, 0, 1}, "VEC3");
  gltf.json["nodes"] = {{{"children", {1}}},
                        {{"mesh", 0}, {"translation", {3, 0, 0}}, {"scale", {2, 1, 1}}}};
  const float s = std::sqrt(0.5f);
  gltf.animate(0, "rotation", {0, 1}, {0, 0, 0, 1, 0, s, 0, s}, "VEC4");
  ReadObject o = read(gltf);
  ASSERT_TRUE(o.motion);
  for (const double t : {0.0, 0.5, 1.0}) {
    o.motion->pose(t, o.object.mesh);
    const double a = t * std::acos(-1.0) / 2;  // about y: x goes to -z
    const auto turned = [&](const Vec3d& v) {
      return Vec3d{std::cos(a) * v.x + std::sin(a) * v.z, v.y,
                   -std::sin(a) * v.x + std::cos(a) * v.z};
    };
    EXPECT_LT(length(corner(o.object.mesh, 1) - turned({5, 0, 0})), 1e-5) << t;
    // Stretching x by 2 halves a normal's x.
    const Vec3d normal = normalized(turned(Vec3d{0.5, 0, 1}));
    EXPECT_LT(length(o.object.mesh.normals[0].cast<double>() - normal), 1e-5) << t;
  }
}

// Two joints, the upper one bent about z: linear blend skinning as glTF writes it, in double.
TEST_F(ObjectMotionTest, ASkinBends) {
  SomeGltf gltf;
  const std::vector<float> rest{0, 0, 0, 0.5f, 1, 0, 0, 2, 0};
  gltf.primitive()["attributes"]["POSITION"] = gltf.add_floats(rest, "VEC3");
  gltf.primitive()["attributes"]["NORMAL"] = gltf.add_floats({1, 0, 0, 1, 0, 0, 1, 0, 0}, "VEC3");
  gltf.add_skin({1, 0, 0, 0, 0.75f, 0.25f, 0, 0, 0, 2, 0, 0});  // the last is not normalised
  gltf.json["nodes"][0]["translation"] = {100, 100, 100};       // does not count
  const double end = 1.0;                                       // radians
  gltf.animate(2, "rotation", {0, 1},
               {0, 0, 0, 1, 0, 0, static_cast<float>(std::sin(end / 2)),
                static_cast<float>(std::cos(end / 2))},
               "VEC4");
  gltf.animate(1, "translation", {0, 1}, {0, 0, 0, 0, 0, 3}, "VEC3");
  ReadObject o = read(gltf);
  ASSERT_TRUE(o.motion);
  EXPECT_TRUE(o.notes.empty());
  for (const double t : {0.0, 0.3, 1.0}) {
    o.motion->pose(t, o.object.mesh);
    const double c = std::cos(end * t), s = std::sin(end * t);
    for (size_t v = 0; v < 3; ++v) {
      const double w = v == 0 ? 0 : v == 1 ? 0.25 : 1;
      const Vec3d p{rest[3 * v], rest[3 * v + 1], rest[3 * v + 2]};
      // Of the upper joint: about (0, 1, 0).
      const Vec3d bent{c * p.x - s * (p.y - 1), s * p.x + c * (p.y - 1) + 1, p.z};
      const Vec3d expected = p * (1 - w) + bent * w + Vec3d{0, 0, 3 * t};
      EXPECT_LT(length(o.object.mesh.positions[v].cast<double>() - expected), 2e-6) << t << v;
      // A rotation and the identity blended: x of the inverse's transpose.
      const double a = 1 - w + w * c, b = w * s;
      const Vec3d normal = normalized(Vec3d{a, b, 0});
      EXPECT_LT(length(o.object.mesh.normals[v].cast<double>() - normal), 2e-6) << t << v;
    }
  }
}

// Of eight joints to a vertex the fifth counts as any other.
TEST_F(ObjectMotionTest, ASecondSetOfJointsCounts) {
  SomeGltf gltf;
  gltf.add_skin({1, 0, 0, 0, 0.5f, 0, 0, 0, 1, 0, 0, 0});
  auto& attributes = gltf.primitive()["attributes"];
  attributes["JOINTS_1"] =
      gltf.add(std::vector<uint8_t>{0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0}, 5121, 3, "VEC4");
  attributes["WEIGHTS_1"] = gltf.add_floats({0, 0, 0, 0, 0.5f, 0, 0, 0, 0, 0, 0, 0}, "VEC4");
  gltf.json["nodes"][2]["translation"] = {0, 1, 4};
  EXPECT_EQ(corner(read(gltf).object.mesh, 1), (Vec3d{1, 0, 2}));
}

TEST_F(ObjectMotionTest, ASkinCountsAtRestToo) {
  SomeGltf gltf;
  gltf.add_skin({1, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0});
  gltf.json["nodes"][2]["translation"] = {0, 1, 5};
  ReadObject o = read(gltf);
  EXPECT_FALSE(o.motion);
  EXPECT_EQ(corner(o.object.mesh, 2), (Vec3d{0, 1, 5}));
  // Without matrices they are the identity.
  gltf.json["skins"][0].erase("inverseBindMatrices");
  EXPECT_EQ(corner(read(gltf).object.mesh, 2), (Vec3d{0, 2, 5}));
}

TEST_F(ObjectMotionTest, MorphTargetsAreAdded) {
  SomeGltf gltf;
  const int lift = gltf.add_floats({0, 0, 1, 0, 0, 2, 0, 0, 3}, "VEC3");
  // Only the last vertex, sparse and without a base.
  const int moved = gltf.add_floats({7, 0, 0}, "VEC3");
  const int which = gltf.add(std::vector<uint16_t>{2}, 5123, 1, "SCALAR");
  Json sparse = {{"componentType", 5126}, {"count", 3}, {"type", "VEC3"}};
  sparse["sparse"] = {
      {"count", 1},
      {"indices",
       {{"bufferView", gltf.json["accessors"][static_cast<size_t>(which)]["bufferView"]},
        {"componentType", 5123}}},
      {"values",
       {{"bufferView", gltf.json["accessors"][static_cast<size_t>(moved)]["bufferView"]}}}};
  gltf.json["accessors"].push_back(sparse);
  gltf.primitive()["targets"] = {{{"POSITION", lift}},
                                 {{"POSITION", gltf.json["accessors"].size() - 1}}};
  gltf.json["meshes"][0]["weights"] = {0.5, 1};
  EXPECT_EQ(corner(read(gltf).object.mesh, 2), (Vec3d{7, 1, 1.5}));
  gltf.animate(0, "weights", {0, 1}, {0, 0, 1, 2}, "SCALAR");
  ReadObject o = read(gltf);
  ASSERT_TRUE(o.motion);
  o.motion->pose(0.5, o.object.mesh);
  EXPECT_EQ(corner(o.object.mesh, 2), (Vec3d{7, 1, 1.5}));
  EXPECT_EQ(corner(o.object.mesh, 1), (Vec3d{1, 0, 1}));
}

TEST_F(ObjectMotionTest, AMorphTargetOpensWhatIsFlat) {
  SomeGltf gltf;
  gltf.primitive()["attributes"]["POSITION"] = gltf.add_floats({2, 0, 0, 2, 0, 0, 2, 0, 0}, "VEC3");
  gltf.primitive()["targets"] = {
      {{"POSITION", gltf.add_floats({0, 0, 0, 1, 0, 0, 0, 1, 0}, "VEC3")}}};
  gltf.animate(0, "weights", {0, 1}, {0, 1}, "SCALAR");
  ReadObject o = read(gltf);
  ASSERT_TRUE(o.motion);
  o.motion->pose(1, o.object.mesh);
  EXPECT_EQ(corner(o.object.mesh, 1), (Vec3d{3, 0, 0}));
}

// What grows from nothing keeps its triangles, and what turns inside out their outside.
TEST_F(ObjectMotionTest, MayVanishAndMirror) {
  SomeGltf gltf;
  gltf.animate(0, "scale", {0, 1, 2}, {0, 0, 0, 1, 1, 1, -1, 1, 1}, "VEC3");
  ReadObject o = read(gltf);
  ASSERT_EQ(o.object.mesh.triangles.size(), 1u);
  for (const double t : {2.0, 1.0, 2.0, 0.5}) {
    o.motion->pose(t, o.object.mesh);
    const auto& m = o.object.mesh;
    const Vec3d out = cross(corner(m, 1) - corner(m, 0), corner(m, 2) - corner(m, 0));
    EXPECT_GT(out.z, 0) << t;
  }
}

TEST_F(ObjectMotionTest, OneOfSeveralAnimationsPlays) {
  SomeGltf gltf;
  gltf.json["nodes"] = {{{"mesh", 0}}, {{"mesh", 0}}};
  gltf.json["scenes"][0]["nodes"] = {0, 1};
  gltf.animate(0, "translation", {0, 1}, {0, 0, 0, 1, 0, 0}, "VEC3", "LINEAR", 0);
  gltf.animate(0, "translation", {0, 4}, {0, 0, 0, 0, 4, 0}, "VEC3", "LINEAR", 1);
  gltf.animate(1, "translation", {0, 2}, {0, 0, 0, 0, 0, 2}, "VEC3", "LINEAR", 2);
  for (size_t i = 0; i < 3; ++i)
    gltf.json["animations"][i]["name"] = std::vector<std::string>{"walk", "jump", "lamp"}[i];
  ReadObject o = read(gltf);
  EXPECT_EQ(o.motion->last(), 2);  // walk and lamp
  ASSERT_EQ(o.notes.size(), 1u);
  EXPECT_TRUE(test::contains(o.notes[0], "jump"));
  ReadObject jump = read(gltf, "jump");
  EXPECT_EQ(jump.motion->last(), 4);
  jump.motion->pose(1, jump.object.mesh);
  EXPECT_EQ(jump.object.mesh.positions[0].y, 1);
  EXPECT_TRUE(test::contains(error(gltf, "jmp"), "did you mean jump?"));
}

TEST_F(ObjectMotionTest, StandsStillWhereNothingOfItMoves) {
  SomeGltf gltf;
  gltf.json["nodes"].push_back({{"translation", {1, 2, 3}}});
  gltf.json["scenes"][0]["nodes"] = {0, 1};
  gltf.animate(1, "translation", {0, 1}, {0, 0, 0, 1, 0, 0}, "VEC3");
  const ReadObject o = read(gltf);
  EXPECT_FALSE(o.motion);
  EXPECT_EQ(o.notes.size(), 1u);
}

TEST_F(ObjectMotionTest, SaysWhatIsWrong) {
  const auto expect = [&](const std::string& part, const auto& change) {
    SCOPED_TRACE(part);
    SomeGltf gltf;
    gltf.add_skin({1, 0, 0, 0, 0.5f, 0.5f, 0, 0, 0, 1, 0, 0});
    gltf.animate(2, "translation", {0, 1}, {0, 1, 0, 4, -2, 1}, "VEC3");
    change(gltf);
    const std::string text = error(gltf);
    EXPECT_TRUE(test::contains(text, part)) << text;
    EXPECT_TRUE(test::contains(text, "moving.glb"));
    EXPECT_TRUE(text.ends_with(")")) << "without a hint";
  };
  const auto sampler = [](SomeGltf& g) -> Json& { return g.json["animations"][0]["samplers"][0]; };
  const auto channel = [](SomeGltf& g) -> Json& { return g.json["animations"][0]["channels"][0]; };
  expect("do not rise", [&](SomeGltf& g) { sampler(g)["input"] = g.add_floats({1, 1}, "SCALAR"); });
  expect("time 1 is not finite",
         [&](SomeGltf& g) { sampler(g)["input"] = g.add_floats({0, kNan}, "SCALAR"); });
  expect("is no list of seconds", [&](SomeGltf& g) {
    sampler(g)["input"] = g.add(std::vector<uint16_t>{0, 1}, 5123, 2, "SCALAR");
  });
  expect("3 elements for 2 keys", [&](SomeGltf& g) {
    sampler(g)["output"] = g.add_floats({0, 0, 0, 1, 1, 1, 2, 2, 2}, "VEC3");
  });
  expect("2 elements for 2 keys, and 6 are due",
         [&](SomeGltf& g) { sampler(g)["interpolation"] = "CUBICSPLINE"; });
  expect("vectors of 4 numbers, not of 3", [&](SomeGltf& g) {
    sampler(g)["output"] = g.add_floats({0, 0, 0, 1, 0, 0, 0, 1}, "VEC4");
  });
  expect("output 1 is not finite",
         [&](SomeGltf& g) { sampler(g)["output"] = g.add_floats({0, 0, 0, 1, kNan, 1}, "VEC3"); });
  expect("a rotation that is none", [&](SomeGltf& g) {
    sampler(g)["output"] = g.add_floats({0, 0, 0, 1, 0, 0, 0, 0}, "VEC4");
    channel(g)["target"]["path"] = "rotation";
  });
  expect("unknown interpolation 'SMOOTH'",
         [&](SomeGltf& g) { sampler(g)["interpolation"] = "SMOOTH"; });
  expect("input", [&](SomeGltf& g) { sampler(g).erase("input"); });
  expect("there is no such accessor", [&](SomeGltf& g) { sampler(g)["input"] = 77; });
  expect("has no input", [&](SomeGltf& g) { sampler(g)["input"] = -1; });
  expect("no such sampler", [&](SomeGltf& g) { channel(g)["sampler"] = 5; });
  expect("node 9, which there is not", [&](SomeGltf& g) { channel(g)["target"]["node"] = 9; });
  expect("which has a matrix", [&](SomeGltf& g) {
    g.json["nodes"][2] = {{"matrix", {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 1, 0, 1}}};
  });
  expect("twice",
         [&](SomeGltf& g) { g.json["animations"][0]["channels"].push_back(Json(channel(g))); });
  expect("no morph targets", [&](SomeGltf& g) {
    g.animate(0, "weights", {0}, {1}, "SCALAR");
    g.json["nodes"][0].erase("skin");
  });
  expect("nodes go in a circle", [](SomeGltf& g) { g.json["nodes"][2]["children"] = {1}; });
  expect("joint 9 is no node", [](SomeGltf& g) { g.json["skins"][0]["joints"] = {1, 9}; });
  expect("there is no skin 4", [](SomeGltf& g) { g.json["nodes"][0]["skin"] = 4; });
  expect("hangs on joint 1, and skin 0 has 1",
         [](SomeGltf& g) { g.json["skins"][0]["joints"] = {1}; });
  expect("2 matrices for 3 joints", [](SomeGltf& g) { g.json["skins"][0]["joints"] = {1, 2, 0}; });
  expect("are no 4x4 matrices", [](SomeGltf& g) { g.json["skins"][0]["inverseBindMatrices"] = 0; });
  expect("matrix 0 is not finite", [](SomeGltf& g) {
    std::vector<float> m(32, 1);
    m[3] = kNan;
    g.json["skins"][0]["inverseBindMatrices"] = g.add(m, 5126, 2, "MAT4");
  });
  const auto weights = [](SomeGltf& g) -> Json& {
    return g.primitive()["attributes"]["WEIGHTS_0"];
  };
  expect("target 0, POSITION: element 1 is not finite", [](SomeGltf& g) {
    const int target = g.add_floats({0, 0, 0, kNan, 0, 0, 0, 0, 0}, "VEC3");
    g.primitive()["targets"] = {{{"POSITION", target}}};
  });
  expect("more morphed or skinned vertices", [](SomeGltf& g) {
    const size_t n = 100'000;
    g = SomeGltf();
    g.primitive()["attributes"] = {
        {"POSITION", g.add_floats(std::vector<float>(3 * n, 1), "VEC3")}};
    const int moved = g.add_floats(std::vector<float>(3 * n, 1), "VEC3");
    for (int i = 0; i < 501; ++i) g.primitive()["targets"].push_back({{"POSITION", moved}});
  });
  expect("weights are all zero", [&](SomeGltf& g) {
    weights(g) = g.add_floats({1, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0}, "VEC4");
  });
  expect("vertex 1 has a weight of -1", [&](SomeGltf& g) {
    weights(g) = g.add_floats({1, 0, 0, 0, -1, 0, 0, 0, 0, 1, 0, 0}, "VEC4");
  });
  expect("WEIGHTS_0: element 1 is not finite", [&](SomeGltf& g) {
    weights(g) = g.add_floats({1, 0, 0, 0, kNan, 0, 0, 0, 0, 1, 0, 0}, "VEC4");
  });
  expect("and no WEIGHTS_0", [](SomeGltf& g) { g.primitive()["attributes"].erase("WEIGHTS_0"); });
  expect("do not rise to its last element", [](SomeGltf& g) {
    const int which = g.add(std::vector<uint16_t>{7}, 5123, 1, "SCALAR");
    const int moved = g.add_floats({7, 0, 0}, "VEC3");
    g.json["accessors"][0]["sparse"] = {
        {"count", 1},
        {"indices", {{"bufferView", which}, {"componentType", 5123}}},
        {"values", {{"bufferView", moved}}}};
  });
}

}  // namespace
}  // namespace nerf
