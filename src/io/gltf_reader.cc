#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <optional>

#include "colmap.h"
#include "gltf_document.h"
#include "image_decode.h"
#include "nerf/base/error.h"
#include "nerf/io/object_file.h"
#include "nerf/math/camera_paths.h"

namespace nerf {

namespace {

namespace fs = std::filesystem;
using internal::GltfNumbers;
using internal::printable;

constexpr size_t kMostTriangles = 50'000'000;
constexpr const char* kHint = "export the object again";

// x -> linear * x + offset.
struct Transform {
  Mat3d linear;
  Vec3d offset;
  Transform operator*(const Transform& first) const {
    return {linear * first.linear, linear * first.offset + offset};
  }
  Vec3d operator*(const Vec3d& x) const { return linear * x + offset; }
  // Of normals: rows are cross products of the columns, the inverse's transpose times a number.
  Mat3d of_normals() const {
    const Vec3d a = linear.column(0), b = linear.column(1), c = linear.column(2);
    Mat3d m;
    m.set_column(0, cross(b, c));
    m.set_column(1, cross(c, a));
    m.set_column(2, cross(a, b));
    return m;
  }
  bool mirrors() const {
    return dot(linear.column(0), cross(linear.column(1), linear.column(2))) < 0;
  }
};

class ObjectReader {
 public:
  explicit ObjectReader(const fs::path& path) : path_(path), model_(internal::load_gltf(path)) {}

  ReadObject read() {
    materials();
    for (const int root : roots()) add_tree(root);
    SceneObject& o = out_.object;
    if (o.mesh.triangles.empty())
      fail(degenerate_ > 0 ? "all triangles are degenerate: they have no area"
                           : "there are no triangles in it",
           "export a mesh");
    if (degenerate_ > 0) note(fmt::format("{} triangles without an area left out", degenerate_));
    if (!model_.animations.empty()) note("animations are not played");
    if (!model_.skins.empty()) note("skins are not applied");
    if (no_uv_) o.uv = {};
    if (no_colours_) o.colours.clear();
    return std::move(out_);
  }

 private:
  [[noreturn]] void fail(const std::string& what, const std::string& hint = kHint) const {
    throw Error(what, path_.string(), hint);
  }
  void note(const std::string& text) { out_.notes.push_back(path_.string() + ": " + text); }

  std::vector<int> roots() const {
    if (model_.scenes.empty()) {
      // Nodes that are no node's child.
      std::vector<char> child(model_.nodes.size());
      for (const auto& node : model_.nodes)
        for (const int c : node.children)
          if (c >= 0 && static_cast<size_t>(c) < child.size()) child[static_cast<size_t>(c)] = 1;
      std::vector<int> found;
      for (size_t i = 0; i < child.size(); ++i)
        if (!child[i]) found.push_back(static_cast<int>(i));
      return found;
    }
    const int scene = model_.defaultScene < 0 ? 0 : model_.defaultScene;
    if (static_cast<size_t>(scene) >= model_.scenes.size())
      fail(fmt::format("there is no scene {}", scene));
    return model_.scenes[static_cast<size_t>(scene)].nodes;
  }

  // A node and all below it, without recursion: files may be as deep as they like.
  void add_tree(int root) {
    struct Waiting {
      int node;
      Transform to_world;
    };
    std::vector<Waiting> waiting{{root, {}}};
    visited_.resize(model_.nodes.size());
    while (!waiting.empty()) {
      const Waiting next = waiting.back();
      waiting.pop_back();
      if (next.node < 0 || static_cast<size_t>(next.node) >= model_.nodes.size())
        fail(fmt::format("there is no node {}", next.node));
      const size_t i = static_cast<size_t>(next.node);
      if (visited_[i]) fail(fmt::format("node {} is reached twice: nodes are no tree", i));
      visited_[i] = 1;
      const tinygltf::Node& node = model_.nodes[i];
      const Transform to_world = next.to_world * transform_of(node, i);
      if (node.mesh >= 0) add_mesh(node.mesh, to_world);
      for (const int child : node.children) waiting.push_back({child, to_world});
    }
  }

  Transform transform_of(const tinygltf::Node& node, size_t index) const {
    const auto numbers = [&](const std::vector<double>& given, size_t n,
                             std::vector<double> otherwise) {
      if (given.empty()) return otherwise;
      bool good = given.size() == n;
      for (const double x : given) good = good && std::isfinite(x) && std::fabs(x) < 1e12;
      if (!good) fail(fmt::format("node {} has a transform that is none", index));
      return given;
    };
    Transform t;
    if (!node.matrix.empty()) {
      const auto m = numbers(node.matrix, 16, {});
      for (int c = 0; c < 3; ++c) {
        const size_t at = static_cast<size_t>(4 * c);
        t.linear.set_column(c, {m[at], m[at + 1], m[at + 2]});
      }
      t.offset = {m[12], m[13], m[14]};
      return t;
    }
    const auto move = numbers(node.translation, 3, {0, 0, 0});
    const auto turn = numbers(node.rotation, 4, {0, 0, 0, 1});
    const auto scale = numbers(node.scale, 3, {1, 1, 1});
    const double norm =
        std::sqrt(turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2] + turn[3] * turn[3]);
    if (!(norm > 0)) fail(fmt::format("node {} has a rotation that is none", index));
    t.linear = to_rotation({turn[3] / norm, turn[0] / norm, turn[1] / norm, turn[2] / norm});
    for (int c = 0; c < 3; ++c)
      t.linear.set_column(c, t.linear.column(c) * scale[static_cast<size_t>(c)]);
    t.offset = {move[0], move[1], move[2]};
    return t;
  }

  void add_mesh(int index, const Transform& to_world) {
    if (static_cast<size_t>(index) >= model_.meshes.size())
      fail(fmt::format("there is no mesh {}", index));
    const tinygltf::Mesh& mesh = model_.meshes[static_cast<size_t>(index)];
    for (size_t p = 0; p < mesh.primitives.size(); ++p)
      add_primitive(mesh.primitives[p], fmt::format("mesh {}, primitive {}", index, p), to_world);
  }

  std::optional<GltfNumbers> attribute(const tinygltf::Primitive& primitive, const char* name,
                                       const std::string& what, int least, int most,
                                       size_t count) const {
    const auto found = primitive.attributes.find(name);
    if (found == primitive.attributes.end()) return std::nullopt;
    const std::string use = what + ", " + name;
    GltfNumbers numbers(model_, found->second, use, path_);
    if (numbers.components() < least || numbers.components() > most)
      fail(fmt::format("{}: {} components", use, numbers.components()));
    if (count > 0 && numbers.count() != count)
      fail(fmt::format("{}: {} elements for {} positions", use, numbers.count(), count));
    return numbers;
  }

  void add_primitive(const tinygltf::Primitive& primitive, const std::string& what,
                     const Transform& to_world) {
    const int mode = primitive.mode < 0 ? TINYGLTF_MODE_TRIANGLES : primitive.mode;
    if (mode < TINYGLTF_MODE_TRIANGLES) return;  // points and lines
    const auto positions = attribute(primitive, "POSITION", what, 3, 3, 0);
    if (!positions) return;
    SceneObject& o = out_.object;
    const size_t first = o.mesh.positions.size(), n = positions->count();
    if (first + n > 3 * kMostTriangles) fail("more vertices than an object can have here");
    for (size_t i = 0; i < n; ++i) {
      const Vec3d p = to_world * vector_of(*positions, i);
      if (!(length(p) < 1e15)) fail(fmt::format("{}: position {} is not finite", what, i));
      o.mesh.positions.push_back(p.cast<Real>());
    }
    const auto normals = attribute(primitive, "NORMAL", what, 3, 3, n);
    const Mat3d turn = to_world.of_normals();
    const double side = to_world.mirrors() ? -1 : 1;
    for (size_t i = 0; i < n; ++i) {
      const Vec3d v = normals ? turn * vector_of(*normals, i) * side : Vec3d();
      o.mesh.normals.push_back(std::isfinite(length(v)) ? normalized(v).cast<Real>() : Vec3());
    }
    for (size_t set = 0; set < 2; ++set) {
      const auto uv = attribute(primitive, set == 0 ? "TEXCOORD_0" : "TEXCOORD_1", what, 2, 2, n);
      no_uv_ = no_uv_ && !uv;
      for (size_t i = 0; i < n; ++i)
        o.uv[set].push_back(
            uv ? Vec2{static_cast<Real>(uv->number(i, 0)), static_cast<Real>(uv->number(i, 1))}
               : Vec2{});
    }
    const auto colours = attribute(primitive, "COLOR_0", what, 3, 4, n);
    no_colours_ = no_colours_ && !colours;
    for (size_t i = 0; i < n; ++i) {
      std::array<Real, 4> c{1, 1, 1, 1};
      for (int k = 0; colours && k < colours->components(); ++k)
        c[static_cast<size_t>(k)] = static_cast<Real>(std::clamp(colours->number(i, k), 0.0, 1e6));
      o.colours.push_back(c);
    }
    const int material =
        primitive.material < 0 ? static_cast<int>(model_.materials.size()) : primitive.material;
    if (static_cast<size_t>(material) >= o.materials.size())
      fail(fmt::format("{}: there is no material {}", what, material));
    add_triangles(primitive, mode, what, first, n, material, to_world.mirrors());
  }

  static Vec3d vector_of(const GltfNumbers& numbers, size_t i) {
    return {numbers.number(i, 0), numbers.number(i, 1), numbers.number(i, 2)};
  }

  void add_triangles(const tinygltf::Primitive& primitive, int mode, const std::string& what,
                     size_t first, size_t vertices, int material, bool mirrored) {
    std::optional<GltfNumbers> indices;
    if (primitive.indices >= 0) {
      indices.emplace(model_, primitive.indices, what + ", indices", path_);
      if (!indices->integers() || indices->components() != 1)
        fail(what + ", indices: are no whole numbers");
    }
    const size_t n = indices ? indices->count() : vertices;
    const auto vertex = [&](size_t i) {
      const size_t v = indices ? indices->index(i) : i;
      if (v >= vertices) fail(fmt::format("{}: index {} of {} vertices", what, v, vertices));
      return static_cast<uint32_t>(first + v);
    };
    SceneObject& o = out_.object;
    const auto add = [&](uint32_t a, uint32_t b, uint32_t c) {
      if (mirrored) std::swap(b, c);
      const auto at = [&](uint32_t v) { return o.mesh.positions[v].cast<double>(); };
      if (!(length(cross(at(b) - at(a), at(c) - at(a))) > 0)) {
        ++degenerate_;
        return;
      }
      if (o.mesh.triangles.size() >= kMostTriangles)
        fail("more triangles than an object can have here");
      o.mesh.triangles.push_back({a, b, c});
      o.material.push_back(material);
    };
    if (mode == TINYGLTF_MODE_TRIANGLES) {
      for (size_t i = 0; i + 2 < n; i += 3) add(vertex(i), vertex(i + 1), vertex(i + 2));
    } else {
      for (size_t i = 0; i + 2 < n; ++i) {
        const bool fan = mode == TINYGLTF_MODE_TRIANGLE_FAN;
        const uint32_t a = vertex(fan ? 0 : i), b = vertex(i + 1), c = vertex(i + 2);
        // Every other triangle of a strip runs the other way round.
        if (!fan && i % 2 == 1)
          add(b, a, c);
        else
          add(a, b, c);
      }
    }
  }

  void materials() {
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
      out_.object.materials.push_back(m);
    }
    out_.object.materials.emplace_back();  // of primitives without one
  }

  void note_once(const std::string& text) {
    const std::string whole = path_.string() + ": " + text;
    if (std::ranges::find(out_.notes, whole) == out_.notes.end()) out_.notes.push_back(whole);
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
    out_.object.textures.push_back(std::move(t));
    const int place = static_cast<int>(out_.object.textures.size()) - 1;
    textures_[key] = place;
    return {place, uv};
  }

  Texture decoded(int image, const std::string& what) const {
    if (image < 0 || static_cast<size_t>(image) >= model_.images.size())
      fail(what + ": there is no such image", "use PNG or JPEG textures");
    const tinygltf::Image& given = model_.images[static_cast<size_t>(image)];
    const std::string name =
        fmt::format("{}: {}, image {} {}", path_.string(), what, image, printable(given.uri));
    if (given.image.empty()) throw Error("the texture's picture is missing", name, kHint);
    const internal::StoredImage stored = internal::decode_image(given.image, name);
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

  fs::path path_;
  tinygltf::Model model_;
  ReadObject out_;
  std::vector<char> visited_;
  std::map<std::pair<int, bool>, int> textures_;  // by glTF's index and whether it holds colours
  size_t degenerate_ = 0;
  bool no_uv_ = true, no_colours_ = true;
};

}  // namespace

ReadObject read_object(const fs::path& path) { return ObjectReader(path).read(); }

}  // namespace nerf
