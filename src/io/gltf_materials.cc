#include "gltf_materials.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "colmap.h"
#include "gltf_document.h"
#include "gltf_nodes.h"
#include "image_decode.h"
#include "nerf/base/error.h"

namespace nerf::internal {

namespace {

namespace fs = std::filesystem;

class MaterialReader {
 public:
  MaterialReader(const tinygltf::Model& model, const fs::path& path, SceneObject& object,
                 std::vector<std::string>& notes)
      : model_(model), path_(path), object_(object), notes_(notes) {}

  void read() {
    if (const auto names = ignored_extensions(model_); !names.empty())
      note_once("does not use the extensions " + name_list(names));
    for (const tinygltf::Material& given : model_.materials) {
      Material m;
      const auto& pbr = given.pbrMetallicRoughness;
      m.base = vector_of(pbr.baseColorFactor, {1, 1, 1});
      if (pbr.baseColorFactor.size() == 4) m.alpha = pbr.baseColorFactor[3];
      m.base_texture = texture(pbr.baseColorTexture, true);
      m.metallic = pbr.metallicFactor;
      m.roughness = pbr.roughnessFactor;
      m.metallic_roughness_texture = texture(pbr.metallicRoughnessTexture, false);
      m.emissive = vector_of(given.emissiveFactor, {0, 0, 0});
      const auto strength = given.extensions.find("KHR_materials_emissive_strength");
      if (strength != given.extensions.end() && strength->second.IsObject() &&
          strength->second.Has("emissiveStrength"))
        m.emissive = m.emissive * strength->second.Get("emissiveStrength").GetNumberAsDouble();
      m.emissive_texture = texture(given.emissiveTexture, true);
      m.alpha_mode = given.alphaMode == "BLEND"  ? AlphaMode::kBlend
                     : given.alphaMode == "MASK" ? AlphaMode::kMask
                                                 : AlphaMode::kOpaque;
      m.alpha_cutoff = given.alphaCutoff;
      m.double_sided = given.doubleSided;
      m.unlit = given.extensions.contains("KHR_materials_unlit");
      for (const double x : {m.base.x, m.base.y, m.base.z, m.alpha, m.metallic, m.roughness,
                             m.emissive.x, m.emissive.y, m.emissive.z, m.alpha_cutoff})
        if (!(std::fabs(x) < 1e9)) fail("a material's number is not finite");
      if (given.normalTexture.index >= 0) note_once("normal maps are not used");
      if (given.occlusionTexture.index >= 0) note_once("occlusion textures are not used");
      object_.materials.push_back(m);
    }
    object_.materials.emplace_back();  // of primitives without one
  }

 private:
  [[noreturn]] void fail(const std::string& what, const std::string& hint = kExportAgain) const {
    throw Error(what, path_.string(), hint);
  }

  void note_once(const std::string& text) {
    const std::string whole = path_.string() + ": " + text;
    if (std::ranges::find(notes_, whole) == notes_.end()) notes_.push_back(whole);
  }

  static Vec3d vector_of(const std::vector<double>& v, const Vec3d& otherwise) {
    return v.size() < 3 ? otherwise : Vec3d{v[0], v[1], v[2]};
  }

  TextureUse texture(const tinygltf::TextureInfo& info, bool srgb) {
    if (info.index < 0) return {};
    TextureUse use;
    use.uv = info.texCoord;
    const auto transform = info.extensions.find("KHR_texture_transform");
    if (transform != info.extensions.end()) place(transform->second, info.index, use);
    if (use.uv < 0 || use.uv > 1)
      fail(fmt::format("texture {} takes coordinates {}", info.index, use.uv));
    use.texture = texture_of(info.index, srgb);
    return use;
  }

  // KHR_texture_transform: scaled, then turned, then moved. The angle counts counter-clockwise as
  // one sees a picture whose v points down, as in the extension's examples and in other readers.
  // (Its listing in GLSL, read column by column, would turn the other way; issue 1563 of
  // KhronosGroup/glTF.)
  void place(const tinygltf::Value& given, int index, TextureUse& use) const {
    const auto number = [&](const tinygltf::Value& value) {
      const double x = value.IsNumber() ? value.GetNumberAsDouble() : kFarthestGltf;
      if (!(std::fabs(x) < kFarthestGltf))
        fail(fmt::format("texture {}: a number of its KHR_texture_transform is none", index));
      return x;
    };
    const auto pair = [&](const char* key, const Vec2d& otherwise) {
      if (!given.Has(key)) return otherwise;
      const tinygltf::Value& value = given.Get(key);
      if (!value.IsArray() || value.ArrayLen() != 2)
        fail(fmt::format("texture {}: {} of its KHR_texture_transform are no two numbers", index,
                         key));
      return Vec2d{number(value.Get(0)), number(value.Get(1))};
    };
    const Vec2d scale = pair("scale", {1, 1});
    const double turn = given.Has("rotation") ? number(given.Get("rotation")) : 0;
    const double c = std::cos(turn), s = std::sin(turn);
    use.origin = pair("offset", {0, 0});
    use.along_u = {c * scale.x, -s * scale.x};
    use.along_v = {s * scale.y, c * scale.y};
    if (!given.Has("texCoord")) return;
    const double set = number(given.Get("texCoord"));
    use.uv = set == 0 ? 0 : set == 1 ? 1 : -1;
    if (use.uv < 0) fail(fmt::format("texture {} takes coordinates {:g}", index, set));
  }

  int texture_of(int index, bool srgb) {
    if (static_cast<size_t>(index) >= model_.textures.size())
      fail(fmt::format("there is no texture {}", index));
    const auto key = std::pair{index, srgb};
    const auto known = textures_.find(key);
    if (known != textures_.end()) return known->second;
    const tinygltf::Texture& given = model_.textures[static_cast<size_t>(index)];
    Texture t = decoded(given.source, fmt::format("texture {}", index));
    t.srgb = srgb;
    if (given.sampler >= 0 && static_cast<size_t>(given.sampler) < model_.samplers.size()) {
      const tinygltf::Sampler& sampler = model_.samplers[static_cast<size_t>(given.sampler)];
      const auto wrap = [](int w) {
        return w == TINYGLTF_TEXTURE_WRAP_CLAMP_TO_EDGE     ? TextureWrap::kClamp
               : w == TINYGLTF_TEXTURE_WRAP_MIRRORED_REPEAT ? TextureWrap::kMirror
                                                            : TextureWrap::kRepeat;
      };
      t.wrap_x = wrap(sampler.wrapS);
      t.wrap_y = wrap(sampler.wrapT);
      t.nearest = sampler.magFilter == TINYGLTF_TEXTURE_FILTER_NEAREST;
    }
    object_.textures.push_back(std::move(t));
    return textures_[key] = static_cast<int>(object_.textures.size()) - 1;
  }

  Texture decoded(int image, const std::string& what) const {
    if (image < 0 || static_cast<size_t>(image) >= model_.images.size())
      fail(what + ": there is no such image", "use PNG or JPEG textures");
    const tinygltf::Image& given = model_.images[static_cast<size_t>(image)];
    const std::string name =
        fmt::format("{}: {}, image {} {}", path_.string(), what, image, printable(given.uri));
    if (given.image.empty()) throw Error("the texture's picture is missing", name, kExportAgain);
    const StoredImage stored = decode_image(given.image, name);
    Texture t;
    t.width = stored.width;
    t.height = stored.height;
    const size_t pixels = static_cast<size_t>(t.width) * static_cast<size_t>(t.height);
    const size_t c = static_cast<size_t>(stored.channels);
    t.pixels.resize(4 * pixels);
    for (size_t i = 0; i < pixels; ++i)
      for (size_t k = 0; k < 4; ++k) {
        const size_t grey = std::min(k, c < 3 ? size_t{0} : size_t{2});
        const float value = k < 3                ? stored.sample(i * c + grey)
                            : stored.has_alpha() ? stored.sample(i * c + c - 1)
                                                 : 1.0f;
        t.pixels[4 * i + k] =
            static_cast<uint8_t>(std::lround(std::clamp(value, 0.0f, 1.0f) * 255));
      }
    return t;
  }

  const tinygltf::Model& model_;
  const fs::path& path_;
  SceneObject& object_;
  std::vector<std::string>& notes_;
  std::map<std::pair<int, bool>, int> textures_;  // by glTF's index and whether it holds colours
};

}  // namespace

void read_gltf_materials(const tinygltf::Model& model, const fs::path& path, SceneObject& object,
                         std::vector<std::string>& notes) {
  MaterialReader(model, path, object, notes).read();
}

}  // namespace nerf::internal
