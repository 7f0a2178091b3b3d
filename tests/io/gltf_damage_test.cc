// Damaged glTF files with animations, skins and morph targets: either read, or refused by an Error.
// NERF_DAMAGE_ROUNDS=N tries N files of each kind in place of a hundred or so, and
// NERF_DAMAGE_SEED=S others than usual.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <limits>

#include "io/some_gltf.h"
#include "nerf/io/camera_path.h"
#include "nerf/io/object_file.h"
#include "nerf/math/camera_paths.h"
#include "nerf/math/random.h"
#include "support/cameras.h"
#include "support/temp_folder.h"

namespace nerf {
namespace {

using test::Json;
using test::SomeGltf;

uint64_t number_from(const char* variable, uint64_t otherwise) {
  const char* text = std::getenv(variable);
  return text == nullptr ? otherwise : std::strtoull(text, nullptr, 10);
}

// A bent, morphed triangle, another one, and a camera, all of which move.
SomeGltf whole_file() {
  SomeGltf g;
  g.primitive()["attributes"]["NORMAL"] = g.add_floats({0, 0, 1, 0, 0, 1, 0, 0, 1}, "VEC3");
  g.primitive()["attributes"]["COLOR_0"] = g.add_floats({1, 0, 0, 0, 1, 0, 0, 0, 1}, "VEC3");
  g.add_skin({1, 0, 0, 0, 0.5f, 0.5f, 0, 0, 0, 1, 0, 0});
  const int base = g.add_floats({0, 0, 1, 0, 0, 0, 0, 0, 0}, "VEC3");
  const int which = g.add(std::vector<uint16_t>{1}, 5123, 1, "SCALAR");
  const int moved = g.add_floats({0, 1, 0}, "VEC3");
  const Json sparse = {{"count", 1},
                       {"indices", {{"bufferView", which}, {"componentType", 5123}}},
                       {"values", {{"bufferView", moved}}}};
  g.json["accessors"].push_back(
      {{"componentType", 5126}, {"count", 3}, {"type", "VEC3"}, {"sparse", sparse}});
  g.primitive()["targets"] = {{{"POSITION", base}},
                              {{"POSITION", g.json["accessors"].size() - 1}, {"NORMAL", base}}};
  g.json["meshes"][0]["weights"] = {0.5, 0.25};
  Json plain = g.primitive();
  plain.erase("targets");
  plain["attributes"].erase("JOINTS_0");
  g.json["meshes"].push_back({{"primitives", {plain}}});
  g.json["nodes"].push_back({{"mesh", 1}, {"scale", {2, 2, 2}}, {"children", {4}}});
  g.json["nodes"].push_back({{"name", "eye"}, {"camera", 0}, {"rotation", {0, 0, 0, 1}}});
  g.json["cameras"] = {{{"type", "perspective"},
                        {"perspective", {{"yfov", 1.0}, {"aspectRatio", 1.5}, {"znear", 0.1}}}}};
  g.json["scenes"][0]["nodes"] = {0, 1, 3};
  g.json["asset"]["extras"]["input_to_gltf"] = {1, 0, 0, 0, 0, 0, -1, 0, 0, 1, 0, 0, 0, 0, 0, 1};
  const float s = 0.70710678f;
  g.animate(2, "rotation", {0, 1}, {0, 0, 0, 1, 0, s, 0, s}, "VEC4");
  g.animate(1, "translation", {0, 1}, {0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 1, 0, 1, 1, 1, 0, 0, 0},
            "VEC3", "CUBICSPLINE");
  g.animate(0, "weights", {0, 0.5f, 1}, {0, 0, 1, 1, 0, 2}, "SCALAR");
  g.animate(3, "scale", {0, 0.5f, 1}, {1, 1, 1, 2, 2, 2, 1, 2, 1}, "VEC3", "STEP");
  g.animate(4, "translation", {0, 0.5f, 1}, {0, 0, 0, 2, 2, 2, 1, 2, 1}, "VEC3");
  return g;
}

class GltfDamage : public ::testing::Test {
 protected:
  GltfDamage() {
    ModelView view;
    view.name = "a.jpg";
    view.camera = test::pinhole(16, 12, 10);
    view.pose.rotation = look_rotation({-1, 0, 0}, {0, 0, 1});
    info_.views = {view};
  }

  // Both readers. Whether either refuses it.
  bool refused(const std::vector<uint8_t>& bytes) {
    std::ofstream(file_, std::ios::binary)
        .write(reinterpret_cast<const char*>(bytes.data()),
               static_cast<std::streamsize>(bytes.size()));
    const std::string object = test::error_of([&] {
      ReadObject o = read_object(file_);
      const auto check = [&] {
        for (const auto& t : o.object.mesh.triangles)
          for (const uint32_t v : t) ASSERT_LT(v, o.object.mesh.positions.size());
        for (const Vec3& p : o.object.mesh.positions) ASSERT_LT(length(p), 1e30);
        for (const Vec3& n : o.object.mesh.normals) ASSERT_LT(length(n), 1.001);
        for (const auto& set : o.object.uv)
          for (const Vec2& uv : set) ASSERT_LT(std::hypot(uv.x, uv.y), 1e30);
        for (const auto& colour : o.object.colours)
          for (const Real c : colour) ASSERT_LE(std::fabs(c), 1e6);
      };
      check();
      if (!o.motion) return;
      for (const double t : {0.3, 0.75, 2.0}) {
        o.motion->pose(t, o.object.mesh);
        check();
      }
    });
    const std::string path = test::error_of([&] {
      const CameraPath p = read_camera_path(file_, info_);
      ASSERT_FALSE(p.frames.empty());
      for (const PathFrame& frame : p.frames) {
        ASSERT_LT(length(frame.camera_to_world.translation), 1e30);
        ASSERT_LT(orthonormality_error(frame.camera_to_world.rotation), 1e-6);
        ASSERT_GT(frame.camera.width, 0);
        ASSERT_GT(frame.camera.fx(), 0);
      }
    });
    for (const std::string& text : {object, path})
      EXPECT_TRUE(text.empty() || test::contains(text, file_.string())) << text;
    return !object.empty() || !path.empty();
  }

  // draw(limit): a whole number below it.
  template <class Change>
  void damage(uint64_t rounds, const Change& change) {
    rounds = number_from("NERF_DAMAGE_ROUNDS", rounds);
    const uint64_t seed = number_from("NERF_DAMAGE_SEED", 11);
    uint64_t refused_files = 0;
    for (uint64_t round = 0; round < rounds; ++round) {
      Random random(seed, 0, round);
      const auto draw = [&](size_t limit) {
        return std::min(limit - 1, static_cast<size_t>(static_cast<double>(random.uniform()) *
                                                       static_cast<double>(limit)));
      };
      SomeGltf g = whole_file();
      const size_t changes = 1 + draw(3);
      for (size_t i = 0; i < changes; ++i) change(g, draw);
      if (!g.json.is_object()) continue;  // no file can hold it
      const auto bytes = g.glb();
      if (HasFatalFailure()) FAIL() << "round " << round;
      refused_files += refused(bytes);
    }
    EXPECT_GT(refused_files, rounds / 10);
    EXPECT_LT(refused_files, rounds);
  }

  ModelInfo info_;
  test::TempFolder folder_;
  std::filesystem::path file_ = folder_ / "damaged.glb";
};

TEST_F(GltfDamage, TheWholeFileIsRead) {
  EXPECT_FALSE(refused(whole_file().glb()));
  const CameraPath path = read_camera_path(file_, info_);
  EXPECT_EQ(path.frames.size(), 31u);
}

// Every value of the JSON may become another one, go, or take another's place.
TEST_F(GltfDamage, OfTheStructure) {
  damage(150, [](SomeGltf& g, const auto& draw) {
    const Json flat = g.json.flatten();
    const auto pick = [&] {
      auto it = flat.begin();
      std::advance(it, static_cast<ptrdiff_t>(draw(flat.size())));
      return it;
    };
    const auto at = pick();
    const Json::json_pointer place(at.key());
    static const std::vector<Json> odd{-1,
                                       0,
                                       1,
                                       2,
                                       3,
                                       255,
                                       65536,
                                       2147483647,
                                       -2147483647,
                                       4294967295u,
                                       1e300,
                                       -0.5,
                                       "",
                                       "VEC4",
                                       "MAT4",
                                       "SCALAR",
                                       nullptr,
                                       true,
                                       Json::array(),
                                       Json::object(),
                                       Json::array({1, 2})};
    const size_t kind = draw(8);
    try {
      if (kind == 0) {  // gone
        Json& parent = g.json[place.parent_pointer()];
        if (parent.is_object())
          parent.erase(place.back());
        else
          parent.erase(static_cast<size_t>(std::stoul(place.back())));
      } else if (kind == 1) {
        g.json[place] = pick().value();
      } else if (kind == 2) {  // a whole part elsewhere
        const Json part = g.json[Json::json_pointer(pick().key()).parent_pointer()];
        g.json[place.parent_pointer()] = part;
      } else if (kind < 6 && at.value().is_number_integer()) {
        g.json[place] = at.value().template get<int64_t>() + static_cast<int64_t>(draw(7)) - 3;
      } else {
        g.json[place] = odd[draw(odd.size())];
      }
    } catch (const Json::exception&) {
      // An earlier change took the place away.
    }
  });
}

// Numbers in the buffer become others, among them those that are none.
TEST_F(GltfDamage, OfTheNumbers) {
  damage(100, [](SomeGltf& g, const auto& draw) {
    const float odd[] = {std::numeric_limits<float>::quiet_NaN(),
                         std::numeric_limits<float>::infinity(),
                         -1,
                         0,
                         1e30f,
                         -1e-30f,
                         3.4e38f,
                         1e12f};
    const size_t at = 4 * draw(g.bin.size() / 4);
    if (draw(2) == 0)
      std::memcpy(g.bin.data() + at, &odd[draw(std::size(odd))], 4);
    else
      g.bin[at + draw(4)] = static_cast<uint8_t>(draw(256));
  });
}

}  // namespace
}  // namespace nerf
