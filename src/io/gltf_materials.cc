#include "gltf_materials.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "colmap.h"
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
    for (const tinygltf::Material& given : model_.materials) {
      Material m;
      const auto& pbr = given.pbrMetallicRoughness;
      m.base = vector_of(pbr.baseColorFactor, {1, 1, 1});
      if (pbr.baseColorFactor.size() == 4) m.alpha = pbr.baseColorFactor[3];
      m.base_texture = texture(pbr.baseColorTexture.index, pbr.baseColorTexture.texCoord, true);
      m.metallic = pbr.metallicFactor;
      m.roughness = pbr.roughnessFactor;
      m.metallic_roughness_texture =
          texture(pbr.metallicRoughnessTexture.index, pbr.metallicRoughnessTexture.texCoord, false);
      m.emissive = vector_of(given.emissiveFactor, {0, 0, 0});
      const auto strength = given.extensions.find("KHR_materials_emissive_strength");
      if (strength != given.extensions.end() && strength->second.IsObject() &&
          strength->second.Has("emissiveStrength"))
        m.emissive = m.emissive * strength->second.Get("emissiveStrength").GetNumberAsDouble();
      m.emissive_texture =
          texture(given.emissiveTexture.index, given.emissiveTexture.texCoord, true);
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

  TextureUse texture(int index, int uv, bool srgb) {
    if (index < 0) return {};
    if (static_cast<size_t>(index) >= model_.textures.size())
      fail(fmt::format("there is no texture {}", index));
    if (uv < 0 || uv > 1) fail(fmt::format("texture {} takes coordinates {}", index, uv));
    const auto key = std::pair{index, srgb};
    const auto known = textures_.find(key);
    if (known != textures_.end()) return {known->second, uv};
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
    const int place = static_cast<int>(object_.textures.size()) - 1;
    textures_[key] = place;
    return {place, uv};
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
