// A small glTF file for tests, whose parts they change.
#pragma once

#include <cstdint>
#include <cstring>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "nerf/base/file.h"

namespace nerf::test {

using Json = nlohmann::json;

// A triangle with everything that is read, whose parts tests change.
struct SomeGltf {
  Json json;
  std::vector<uint8_t> bin;

  SomeGltf() {
    json["asset"] = {{"version", "2.0"}};
    json["scene"] = 0;
    json["scenes"] = {{{"nodes", {0}}}};
    json["nodes"] = {{{"mesh", 0}}};
    json["materials"] = {{{"pbrMetallicRoughness",
                           {{"baseColorFactor", {0.5, 0.25, 1, 0.5}},
                            {"metallicFactor", 0.25},
                            {"roughnessFactor", 0.75}}},
                          {"emissiveFactor", {0, 0, 0.5}},
                          {"alphaMode", "BLEND"}}};
    const int positions = add_floats({0, 0, 0, 1, 0, 0, 0, 1, 0}, "VEC3");
    const int uv = add_floats({0, 0, 1, 0, 0, 1}, "VEC2");
    const int indices = add(std::vector<uint16_t>{0, 1, 2}, 5123, 3, "SCALAR");
    json["meshes"] = {{{"primitives",
                        {{{"attributes", {{"POSITION", positions}, {"TEXCOORD_0", uv}}},
                          {"indices", indices},
                          {"material", 0}}}}}};
  }
  Json& primitive() { return json["meshes"][0]["primitives"][0]; }

  template <class T>
  int add(const std::vector<T>& numbers, int component_type, size_t count, const char* type) {
    const size_t begin = bin.size(), bytes = numbers.size() * sizeof(T);
    bin.resize(begin + (bytes + 3) / 4 * 4);
    std::memcpy(bin.data() + begin, numbers.data(), bytes);
    json["bufferViews"].push_back({{"buffer", 0}, {"byteOffset", begin}, {"byteLength", bytes}});
    json["accessors"].push_back({{"bufferView", json["bufferViews"].size() - 1},
                                 {"componentType", component_type},
                                 {"count", count},
                                 {"type", type}});
    return static_cast<int>(json["accessors"].size()) - 1;
  }
  int add_floats(const std::vector<float>& numbers, const std::string& type) {
    const size_t components = type == "SCALAR" ? 1 : static_cast<size_t>(type[3] - '0');
    return add(numbers, 5126, numbers.size() / components, type.c_str());
  }
  // Of one of several animations, those before it being there.
  void animate(int node, const std::string& path, const std::vector<float>& times,
               const std::vector<float>& values, const std::string& type,
               const std::string& interpolation = "LINEAR", size_t animation = 0) {
    Json& a = json["animations"][animation];
    a["samplers"].push_back({{"input", add_floats(times, "SCALAR")},
                             {"output", add_floats(values, type)},
                             {"interpolation", interpolation}});
    a["channels"].push_back(
        {{"sampler", a["samplers"].size() - 1}, {"target", {{"node", node}, {"path", path}}}});
  }
  // Nodes 1 and 2 become joints, the second on the first and 1 above it. Vertices hang on them by
  // these weights.
  void add_skin(const std::vector<float>& weights) {
    json["nodes"][0]["skin"] = 0;
    json["nodes"].push_back({{"children", {2}}});
    json["nodes"].push_back({{"translation", {0, 1, 0}}});
    json["scenes"][0]["nodes"] = {0, 1};
    const std::vector<float> bind{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0,  0, 1,
                                  1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, -1, 0, 1};
    json["skins"] = {{{"joints", {1, 2}}, {"inverseBindMatrices", add(bind, 5126, 2, "MAT4")}}};
    const size_t n = weights.size() / 4;
    std::vector<uint8_t> joints;
    for (size_t i = 0; i < n; ++i) joints.insert(joints.end(), {0, 1, 0, 0});
    primitive()["attributes"]["JOINTS_0"] = add(joints, 5121, n, "VEC4");
    primitive()["attributes"]["WEIGHTS_0"] = add_floats(weights, "VEC4");
  }
  // A PNG as the base colour's texture.
  void add_texture(const std::vector<uint8_t>& png) {
    const size_t begin = bin.size();
    bin.insert(bin.end(), png.begin(), png.end());
    bin.resize((bin.size() + 3) / 4 * 4);
    json["bufferViews"].push_back(
        {{"buffer", 0}, {"byteOffset", begin}, {"byteLength", png.size()}});
    json["images"] = {{{"bufferView", json["bufferViews"].size() - 1}, {"mimeType", "image/png"}}};
    json["samplers"] = {{{"wrapS", 33071}, {"wrapT", 33648}, {"magFilter", 9728}}};
    json["textures"] = {{{"source", 0}, {"sampler", 0}}};
    json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = {{"index", 0}};
  }

  std::vector<uint8_t> glb() {
    json["buffers"] = {{{"byteLength", bin.size()}}};
    std::string text = json.dump();
    text.resize((text.size() + 3) / 4 * 4, ' ');
    std::vector<uint8_t> out;
    const auto put = [&](uint32_t w) {
      for (int k = 0; k < 4; ++k) out.push_back(static_cast<uint8_t>(w >> (8 * k)));
    };
    put(0x46546c67);
    put(2);
    put(static_cast<uint32_t>(28 + text.size() + bin.size()));
    put(static_cast<uint32_t>(text.size()));
    put(0x4e4f534a);
    out.insert(out.end(), text.begin(), text.end());
    put(static_cast<uint32_t>(bin.size()));
    put(0x004e4942);
    out.insert(out.end(), bin.begin(), bin.end());
    return out;
  }
  void write(const std::filesystem::path& path) { write_file_atomically(path, glb()); }
};

}  // namespace nerf::test
