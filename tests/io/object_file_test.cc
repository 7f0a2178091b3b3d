// glTF as exporters write it, and as damage leaves it.
#include "nerf/io/object_file.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "io/some_gltf.h"
#include "nerf/base/file.h"
#include "nerf/io/image.h"
#include "nerf/math/random.h"
#include "nerf/math/srgb.h"
#include "support/temp_folder.h"

namespace nerf {
namespace {

using test::Json;
using test::SomeGltf;

std::vector<uint8_t> some_png(const test::TempFolder& folder) {
  Image8 image{2, 2, 4, {255, 0, 0, 255, 0, 255, 0, 255, 0, 0, 255, 255, 255, 255, 255, 0}};
  write_image(folder / "t.png", image);
  return read_file(folder / "t.png");
}

class ReadObjectTest : public ::testing::Test {
 protected:
  SceneObject read(SomeGltf& gltf) {
    gltf.write(file_);
    return read_object(file_).object;
  }
  std::string error(SomeGltf& gltf) {
    return test::error_of([&] { read(gltf); });
  }
  test::TempFolder folder_;
  std::filesystem::path file_ = folder_ / "object.glb";
};

TEST_F(ReadObjectTest, TakesMaterialsAndTextures) {
  SomeGltf gltf;
  gltf.add_texture(some_png(folder_));
  gltf.primitive()["attributes"]["COLOR_0"] = gltf.add(
      std::vector<uint16_t>{65535, 0, 0, 65535, 65535, 0, 65535, 65535, 65535}, 5123, 3, "VEC3");
  gltf.json["accessors"].back()["normalized"] = true;
  const SceneObject o = read(gltf);
  ASSERT_EQ(o.mesh.triangles.size(), 1u);
  const Material& m = o.materials[0];
  EXPECT_EQ(m.base, (Vec3d{0.5, 0.25, 1}));
  EXPECT_EQ(m.alpha, 0.5);
  EXPECT_EQ(m.emissive, (Vec3d{0, 0, 0.5}));
  EXPECT_EQ(m.alpha_mode, AlphaMode::kBlend);
  // At the first corner: the texture's upper left pixel, the first vertex's colour.
  const SurfacePoint p = surface_point(o, 0, 0, 0);
  EXPECT_EQ(p.base, (Vec3d{0.5, 0, 0}));
  EXPECT_EQ(p.alpha, 0.5);
  EXPECT_EQ(p.metallic, 0.25);
  EXPECT_EQ(p.normal, (Vec3d{0, 0, 1}));
  EXPECT_EQ(o.textures[0].wrap_x, TextureWrap::kClamp);
  EXPECT_EQ(o.textures[0].wrap_y, TextureWrap::kMirror);
  EXPECT_TRUE(o.textures[0].nearest);
  // The lower right pixel is transparent.
  EXPECT_EQ(o.textures[0].at(0.9, 0.9)[3], 0);
}

// Metallic in blue and roughness in green are numbers; emitted light is a colour in sRGB.
TEST_F(ReadObjectTest, TakesTheOtherTextures) {
  SomeGltf g;
  Image8 image{1, 1, 4, {51, 128, 204, 255}};
  write_image(folder_ / "one.png", image);
  g.add_texture(read_file(folder_ / "one.png"));
  Json& material = g.json["materials"][0];
  material["pbrMetallicRoughness"].erase("baseColorTexture");
  material["pbrMetallicRoughness"]["metallicRoughnessTexture"] = {{"index", 0}};
  material["emissiveFactor"] = {1, 0.5, 0.25};
  material["emissiveTexture"] = {{"index", 0}};
  const SurfacePoint p = surface_point(read(g), 0, 0.3, 0.3);
  EXPECT_NEAR(p.metallic, 0.25 * 204 / 255, 1e-12);
  EXPECT_NEAR(p.roughness, 0.75 * 128 / 255, 1e-12);
  // In float, as the table of the 256 values is.
  EXPECT_NEAR(p.emissive.x, srgb_to_linear(51 / 255.0), 1e-7);
  EXPECT_NEAR(p.emissive.y, 0.5 * srgb_to_linear(128 / 255.0), 1e-7);
  EXPECT_NEAR(p.emissive.z, 0.25 * srgb_to_linear(204 / 255.0), 1e-7);
  EXPECT_EQ(p.base, (Vec3d{0.5, 0.25, 1}));
}

// KHR_texture_transform: T R S of the coordinates, R counter-clockwise where v points down.
Vec2d transformed(const Vec2d& offset, double rotation, const Vec2d& scale, const Vec2d& uv) {
  const double x = scale.x * uv.x, y = scale.y * uv.y;
  return {offset.x + std::cos(rotation) * x + std::sin(rotation) * y,
          offset.y - std::sin(rotation) * x + std::cos(rotation) * y};
}

TEST_F(ReadObjectTest, TransformsTextureCoordinates) {
  constexpr double kTurn = 1.57079632679;
  // some_png(): red and green above blue and white.
  const Vec3d kColours[2][2] = {{{1, 0, 0}, {0, 1, 0}}, {{0, 0, 1}, {1, 1, 1}}};
  const auto colour_at = [&](const Vec2d& at) {
    const auto half = [](double x) { return static_cast<size_t>(x - std::floor(x) >= 0.5); };
    return kColours[half(at.y)][half(at.x)];
  };
  struct Case {
    Vec2d offset;
    double rotation;
    Vec2d scale;
  };
  for (const bool required : {false, true})
    for (const Case& c : {Case{{0, 0}, 0, {1, 1}},
                          {{0.5, 0}, 0, {1, 1}},
                          {{0, 0}, kTurn, {1, 1}},
                          {{0, 0}, 0, {2, 1}},
                          {{0.3, -0.4}, 0.7, {1.5, -0.6}}}) {
      SomeGltf g;
      g.add_texture(some_png(folder_));
      g.json["samplers"] = {{{"magFilter", 9728}}};
      Json& material = g.json["materials"][0];
      material["pbrMetallicRoughness"].erase("baseColorFactor");
      material["emissiveFactor"] = {1, 1, 1};
      material["emissiveTexture"] = {{"index", 0}};
      material["pbrMetallicRoughness"]["baseColorTexture"]["extensions"]["KHR_texture_transform"] =
          {{"offset", {c.offset.x, c.offset.y}},
           {"rotation", c.rotation},
           {"scale", {c.scale.x, c.scale.y}}};
      g.json["extensionsUsed"] = {"KHR_texture_transform"};
      if (required) g.json["extensionsRequired"] = {"KHR_texture_transform"};
      g.write(file_);
      const ReadObject read = read_object(file_);
      EXPECT_TRUE(read.notes.empty());
      for (const Vec2d& uv : {Vec2d{0.1, 0.2}, {0.7, 0.1}, {0.1, 0.8}, {0.3, 0.4}}) {
        const SurfacePoint p = surface_point(read.object, 0, uv.x, uv.y);
        EXPECT_EQ(p.base, colour_at(transformed(c.offset, c.rotation, c.scale, uv)))
            << c.rotation << " at " << uv.x << ", " << uv.y;
        EXPECT_EQ(p.emissive, colour_at(uv));  // which has no transform of its own
      }
    }
}

// The extension's own examples, and what its texCoord says.
TEST_F(ReadObjectTest, TransformsTextureCoordinatesAsTheExamplesSay) {
  const auto with = [&](const Json& transform) {
    SomeGltf g;
    g.add_texture(some_png(folder_));
    g.json["samplers"] = {{{"magFilter", 9728}}};
    Json& pbr = g.json["materials"][0]["pbrMetallicRoughness"];
    pbr.erase("baseColorFactor");
    pbr["baseColorTexture"]["extensions"]["KHR_texture_transform"] = transform;
    g.primitive()["attributes"]["TEXCOORD_1"] =
        g.add_floats({0.75f, 0.25f, 0.75f, 0.25f, 0.75f, 0.25f}, "VEC2");
    return g;
  };
  // The lower left quadrant, turned.
  SomeGltf quadrant =
      with({{"offset", {0, 1}}, {"rotation", 1.57079632679}, {"scale", {0.5, 0.5}}});
  const SceneObject lower_left = read(quadrant);
  for (const Vec2d& uv : {Vec2d{0.1, 0.1}, {0.8, 0.1}, {0.1, 0.8}})
    EXPECT_EQ(surface_point(lower_left, 0, uv.x, uv.y).base, (Vec3d{0, 0, 1}));
  // Upside down.
  SomeGltf turned = with({{"offset", {0, 1}}, {"scale", {1, -1}}});
  const SceneObject upside_down = read(turned);
  EXPECT_EQ(surface_point(upside_down, 0, 0.1, 0.1).base, (Vec3d{0, 0, 1}));
  EXPECT_EQ(surface_point(upside_down, 0, 0.1, 0.8).base, (Vec3d{1, 0, 0}));
  SomeGltf other_set = with({{"texCoord", 1}});
  EXPECT_EQ(surface_point(read(other_set), 0, 0.1, 0.1).base, (Vec3d{0, 1, 0}));
  for (const Json& wrong :
       {Json{{"texCoord", 2}}, Json{{"texCoord", 1e300}}, Json{{"texCoord", 0.5}},
        Json{{"offset", {1}}}, Json{{"scale", {1, "x"}}}, Json{{"rotation", 1e300}}}) {
    SomeGltf g = with(wrong);
    EXPECT_TRUE(test::contains(error(g), "texture 0")) << wrong;
  }
}

TEST_F(ReadObjectTest, SaysWhatItDoesNotUse) {
  SomeGltf g;
  g.add_texture(some_png(folder_));
  g.json["materials"].push_back(g.json["materials"][0]);
  for (Json& material : g.json["materials"])
    material["normalTexture"] = material["occlusionTexture"] = {{"index", 0}};
  g.json["extensionsUsed"] = {"KHR_materials_unlit", "KHR_materials_clearcoat",
                              "KHR_materials_sheen", "KHR_materials_clearcoat"};
  g.write(file_);
  std::vector<std::string> expected{
      "does not use the extensions KHR_materials_clearcoat, KHR_materials_sheen",
      "normal maps are not used", "occlusion textures are not used"};
  for (std::string& text : expected) text = file_.string() + ": " + text;
  EXPECT_EQ(read_object(file_).notes, expected);
}

TEST_F(ReadObjectTest, MakesTheNodesTransforms) {
  SomeGltf gltf;
  const double s = std::sqrt(0.5);
  gltf.json["nodes"] = {{{"translation", {1, 2, 3}}, {"children", {1}}},
                        {{"mesh", 0}, {"rotation", {0, 0, s, s}}, {"scale", {2, 3, -4}}}};
  const SceneObject o = read(gltf);
  // x goes to y by the turn about z. One axis is mirrored: the triangle's order turns with it.
  EXPECT_LT(length(o.mesh.corner(0, 0) - Vec3{1, 2, 3}), 1e-6_r);
  EXPECT_LT(length(o.mesh.corner(0, 1) - Vec3{-2, 2, 3}), 1e-6_r);
  EXPECT_LT(length(o.mesh.corner(0, 2) - Vec3{1, 4, 3}), 1e-6_r);
  gltf.json["nodes"] = {
      {{"mesh", 0}, {"matrix", {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 5, 6, 7, 1}}}};
  EXPECT_EQ(read(gltf).mesh.corner(0, 0), (Vec3{5, 6, 7}));
}

TEST_F(ReadObjectTest, TakesStripsFansAndTextFiles) {
  SomeGltf gltf;
  gltf.primitive()["attributes"] = {
      {"POSITION", gltf.add_floats({0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0}, "VEC3")}};
  gltf.primitive().erase("indices");
  for (const int mode : {5, 6}) {
    gltf.primitive()["mode"] = mode;
    const SceneObject o = read(gltf);
    EXPECT_EQ(o.mesh.triangles.size(), 2u);
    if (mode == 6) continue;  // this one is folded
    for (uint32_t t = 0; t < 2; ++t) EXPECT_GT(surface_point(o, t, 0.3, 0.3).normal.z, 0.9);
  }
  gltf.json["buffers"] = {{{"byteLength", gltf.bin.size()}, {"uri", "object.bin"}}};
  test::write_text(folder_ / "o.gltf", gltf.json.dump());
  EXPECT_TRUE(
      test::contains(test::error_of([&] { read_object(folder_ / "o.gltf"); }), "object.bin"));
  write_file_atomically(folder_ / "object.bin", gltf.bin);
  EXPECT_EQ(read_object(folder_ / "o.gltf").object.mesh.triangles.size(), 2u);
}

TEST_F(ReadObjectTest, SaysWhatIsWrong) {
  const auto expect = [&](const std::string& part, const auto& change) {
    SCOPED_TRACE(part);
    SomeGltf gltf;
    change(gltf);
    const std::string text = error(gltf);
    EXPECT_TRUE(test::contains(text, part));
    EXPECT_TRUE(test::contains(text, "object.glb"));
  };
  expect("reached twice", [](SomeGltf& g) {
    g.json["nodes"] = {{{"children", {1}}}, {{"children", {0}}, {"mesh", 0}}};
  });
  expect("degenerate", [](SomeGltf& g) {
    g.primitive()["attributes"]["POSITION"] = g.add_floats({0, 0, 0, 1, 1, 1, 2, 2, 2}, "VEC3");
  });
  expect("more than its buffer view holds",
         [](SomeGltf& g) { g.json["accessors"][0]["count"] = 4'000'000'000u; });
  expect("behind its buffer",
         [](SomeGltf& g) { g.json["bufferViews"][0]["byteLength"] = 4'000'000'000u; });
  expect("no data", [](SomeGltf& g) { g.json["accessors"][0].erase("bufferView"); });
  expect("KHR_draco_mesh_compression", [](SomeGltf& g) {
    g.json["extensionsUsed"] = g.json["extensionsRequired"] = {"KHR_draco_mesh_compression"};
  });
  expect("index 7 of 3", [](SomeGltf& g) {
    g.primitive()["indices"] = g.add(std::vector<uint16_t>{0, 1, 7}, 5123, 3, "SCALAR");
  });
  for (const float odd :
       {std::numeric_limits<float>::quiet_NaN(), -std::numeric_limits<float>::infinity()})
    for (const auto& [name, type] : {std::pair{"POSITION", "VEC3"},
                                     {"NORMAL", "VEC3"},
                                     {"TEXCOORD_0", "VEC2"},
                                     {"TEXCOORD_1", "VEC2"},
                                     {"COLOR_0", "VEC3"},
                                     {"COLOR_0", "VEC4"}})
      expect(std::string("mesh 0, primitive 0, ") + name + ": element 1 is not finite",
             [&](SomeGltf& g) {
               const size_t components = static_cast<size_t>(type[3] - '0');
               std::vector<float> numbers(3 * components, 1);
               numbers[2 * components - 1] = odd;
               g.primitive()["attributes"][name] = g.add_floats(numbers, type);
             });
  expect("no triangles", [](SomeGltf& g) { g.primitive()["mode"] = 1; });
  expect("no material 9", [](SomeGltf& g) { g.primitive()["material"] = 9; });
  expect("neither PNG nor JPEG",
         [](SomeGltf& g) { g.add_texture({'G', 'I', 'F', '8', '9', 'a'}); });
  expect("image", [&](SomeGltf& g) {
    auto png = some_png(folder_);
    const std::string data = "IDAT";
    *(std::search(png.begin(), png.end(), data.begin(), data.end()) + 8) ^= 0x55;
    g.add_texture(png);
  });
  expect("2 elements for 3 positions", [](SomeGltf& g) {
    g.primitive()["attributes"]["TEXCOORD_0"] = g.add_floats({0, 0, 1, 0}, "VEC2");
  });
}

TEST_F(ReadObjectTest, NeedsAWholeGltf) {
  SomeGltf gltf;
  const auto whole = gltf.glb();
  for (const size_t length :
       {size_t{0}, size_t{3}, size_t{15}, whole.size() / 2, whole.size() - 5}) {
    SCOPED_TRACE(length);
    write_file_atomically(file_, std::span(whole).first(length));
    EXPECT_NE(test::error_of([&] { read_object(file_); }), "");
  }
  test::write_text(file_, "solid cube");
  EXPECT_TRUE(test::contains(test::error_of([&] { read_object(file_); }), "not a glTF file"));
  EXPECT_NE(test::error_of([&] { read_object(folder_ / "none.glb"); }), "");
}

// Every damaged file is either read or refused by an Error.
TEST_F(ReadObjectTest, SurvivesDamage) {
  SomeGltf gltf;
  gltf.add_texture(some_png(folder_));
  gltf.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]["extensions"] = {
      {"KHR_texture_transform",
       {{"offset", {0.5, 0.25}}, {"rotation", 1.5}, {"scale", {2, 3}}, {"texCoord", 0}}}};
  const auto whole = gltf.glb();
  const size_t text_end = whole.size() - gltf.bin.size();
  int refused = 0;
  for (uint64_t round = 0; round < 1500; ++round) {
    Random random(7, 0, round);
    auto bytes = whole;
    const int changes = 1 + static_cast<int>(random.uniform() * 4);
    for (int i = 0; i < changes; ++i) {
      // Mostly the text, where digits become other digits and names are broken.
      const size_t end = random.uniform() < 0.8_r ? text_end : whole.size();
      const size_t at = static_cast<size_t>(random.uniform() * static_cast<Real>(end));
      const Real kind = random.uniform();
      const auto drawn = static_cast<uint8_t>(random.uniform() * 256);
      if (at >= 20 && at < text_end && bytes[at] >= '0' && bytes[at] <= '9' && kind < 0.7_r)
        bytes[at] = static_cast<uint8_t>(kind < 0.1_r ? '-' : '0' + drawn % 10);
      else
        bytes[at] = drawn;
    }
    {
      std::ofstream out(file_, std::ios::binary);
      out.write(reinterpret_cast<const char*>(bytes.data()),
                static_cast<std::streamsize>(bytes.size()));
    }
    refused += !test::error_of([&] { read_object(file_); }).empty();
  }
  EXPECT_GT(refused, 500);
  EXPECT_LT(refused, 1500);
}

}  // namespace
}  // namespace nerf
