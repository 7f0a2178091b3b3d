#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <optional>

#include "colmap.h"
#include "gltf_document.h"
#include "gltf_materials.h"
#include "gltf_shape.h"
#include "nerf/base/error.h"
#include "nerf/io/object_file.h"

namespace nerf {

namespace {

namespace fs = std::filesystem;
using internal::GltfNodes;
using internal::GltfNumbers;
using internal::ObjectShape;

constexpr size_t kMostTriangles = 50'000'000;
// Of what moves vertices: targets and sets of joints may share an accessor, so that a small file
// could ask for any memory.
constexpr size_t kMostMoves = 50'000'000;

class ObjectReader {
 public:
  explicit ObjectReader(const fs::path& path)
      : path_(path),
        model_(internal::load_gltf(path)),
        shape_(std::make_unique<ObjectShape>(GltfNodes(model_, path), path)) {}

  ReadObject read(const std::string& animation) {
    SceneObject& o = out_.object;
    internal::read_gltf_materials(model_, path_, o, out_.notes);
    skins();
    for (const size_t node : shape_->nodes.shown())
      if (model_.nodes[node].mesh >= 0) add_mesh(node);
    if (no_uv_) o.uv = {};
    if (no_colours_) o.colours.clear();
    o.mesh.normals.resize(o.mesh.positions.size());
    const bool moves = choose_animation(animation);
    shape_->pose(moves ? std::optional(0.0) : std::nullopt, o.mesh);
    drop_degenerate(moves);
    if (moves) out_.motion = std::make_unique<ObjectMotion>(std::move(shape_));
    return std::move(out_);
  }

 private:
  [[noreturn]] void fail(const std::string& what,
                         const std::string& hint = internal::kExportAgain) const {
    throw Error(what, path_.string(), hint);
  }
  void note(const std::string& text) { out_.notes.push_back(path_.string() + ": " + text); }

  // Whether anything of the object moves.
  bool choose_animation(const std::string& name) {
    if (model_.animations.empty() && name.empty()) return false;
    internal::GltfAnimation::Choice choice{shape_->carrying_nodes(), {}, name};
    for (const tinygltf::Node& node : model_.nodes) {
      const auto mesh = static_cast<size_t>(node.mesh);
      const bool some = mesh < model_.meshes.size() && !model_.meshes[mesh].primitives.empty();
      choice.morph_targets.push_back(some ? model_.meshes[mesh].primitives[0].targets.size() : 0);
    }
    internal::GltfAnimation animation(model_, shape_->nodes, choice, path_);
    if (!animation.others().empty())
      note("does not play the animations " + internal::name_list(animation.others()) +
           " (--object-animation NAME plays another)");
    if (animation.empty()) {
      note("its animations move nothing of the object");
      return false;
    }
    shape_->animation = std::move(animation);
    return true;
  }

  // Of one that moves triangles without an area may get one, of its nodes or by bending.
  void drop_degenerate(bool moves) {
    SceneObject& o = out_.object;
    size_t kept = 0, in_file = 0;
    const auto area = [&](const TriangleMesh::Triangle& t, const auto& at) {
      return length(cross(at(t[1]) - at(t[0]), at(t[2]) - at(t[0])));
    };
    for (const internal::ObjectPart& part : shape_->parts)
      for (size_t i = part.first_triangle; i < part.first_triangle + part.triangles; ++i) {
        const TriangleMesh::Triangle t = o.mesh.triangles[i];
        const auto in_file_at = [&](uint32_t v) {
          return part.positions[v - part.first_vertex].template cast<double>();
        };
        const auto posed_at = [&](uint32_t v) {
          return o.mesh.positions[v].template cast<double>();
        };
        const bool good =
            moves ? !part.targets.empty() || area(t, in_file_at) > 0 : area(t, posed_at) > 0;
        in_file += !good;
        if (!good && !moves) continue;
        o.mesh.triangles[kept] = t;
        o.material[kept++] = o.material[i];
      }
    if (kept == 0 || in_file == o.mesh.triangles.size())
      fail(in_file > 0 ? "all triangles are degenerate: they have no area"
                       : "there are no triangles in it",
           "export a mesh");
    if (kept < o.mesh.triangles.size())
      note(fmt::format("{} triangles without an area left out", o.mesh.triangles.size() - kept));
    o.mesh.triangles.resize(kept);
    o.material.resize(kept);
  }

  void skins() {
    for (size_t i = 0; i < model_.skins.size(); ++i) {
      const tinygltf::Skin& given = model_.skins[i];
      const std::string what = fmt::format("skin {}", i);
      internal::ObjectSkin skin;
      for (const int joint : given.joints) {
        if (joint < 0 || static_cast<size_t>(joint) >= model_.nodes.size())
          fail(fmt::format("{}: joint {} is no node", what, joint));
        skin.joints.push_back(static_cast<size_t>(joint));
      }
      skin.inverse_bind.resize(skin.joints.size());  // without an accessor they are none
      if (given.inverseBindMatrices >= 0) {
        const std::string use = what + ", inverseBindMatrices";
        const GltfNumbers numbers(model_, given.inverseBindMatrices, use, path_);
        if (numbers.components() != 16 || numbers.integers()) fail(use + ": are no 4x4 matrices");
        if (numbers.count() < skin.joints.size())
          fail(fmt::format("{}: {} matrices for {} joints", use, numbers.count(),
                           skin.joints.size()));
        for (size_t j = 0; j < skin.joints.size(); ++j) {
          for (int k = 0; k < 16; ++k)
            if (!(std::fabs(numbers.number(j, k)) < internal::kFarthestGltf))
              fail(fmt::format("{}: matrix {} is not finite", use, j));
          skin.inverse_bind[j] = internal::gltf_matrix([&](int k) { return numbers.number(j, k); });
        }
      }
      shape_->skins.push_back(std::move(skin));
    }
  }

  void add_mesh(size_t node) {
    const int index = model_.nodes[node].mesh;
    if (static_cast<size_t>(index) >= model_.meshes.size())
      fail(fmt::format("there is no mesh {}", index));
    const tinygltf::Mesh& mesh = model_.meshes[static_cast<size_t>(index)];
    for (size_t p = 0; p < mesh.primitives.size(); ++p) {
      internal::ObjectPart part;
      part.what = fmt::format("mesh {}, primitive {}", index, p);
      part.node = node;
      part.weights = mesh.weights;
      for (const double w : part.weights)
        if (!(std::fabs(w) < internal::kFarthestGltf))
          fail(fmt::format("mesh {}: a weight is not finite", index));
      if (mesh.primitives[p].targets.size() != mesh.primitives[0].targets.size())
        fail(part.what + ": has another number of morph targets than primitive 0");
      add_primitive(mesh.primitives[p], part);
    }
  }

  // Its numbers are finite. zeros: as GltfNumbers.
  std::optional<GltfNumbers> attribute(const std::map<std::string, int>& attributes,
                                       const std::string& name, const std::string& what, int least,
                                       int most, size_t count, bool zeros = false) const {
    const auto found = attributes.find(name);
    if (found == attributes.end()) return std::nullopt;
    const std::string use = what + ", " + name;
    GltfNumbers numbers(model_, found->second, use, path_, zeros);
    if (numbers.components() < least || numbers.components() > most)
      fail(fmt::format("{}: {} components", use, numbers.components()));
    if (count > 0 && numbers.count() != count)
      fail(fmt::format("{}: {} elements for {} positions", use, numbers.count(), count));
    for (size_t i = 0; !numbers.integers() && i < numbers.count(); ++i)
      for (int k = 0; k < numbers.components(); ++k)
        if (!(std::fabs(numbers.number(i, k)) < internal::kFarthestGltf))
          fail(fmt::format("{}: element {} is not finite", use, i));
    return numbers;
  }

  void add_primitive(const tinygltf::Primitive& primitive, internal::ObjectPart& part) {
    const int mode = primitive.mode < 0 ? TINYGLTF_MODE_TRIANGLES : primitive.mode;
    if (mode < TINYGLTF_MODE_TRIANGLES) return;  // points and lines
    const std::string& what = part.what;
    const auto& own = primitive.attributes;
    const auto positions = attribute(own, "POSITION", what, 3, 3, 0);
    if (!positions) return;
    SceneObject& o = out_.object;
    const size_t first = o.mesh.positions.size(), n = positions->count();
    if (first + n > 3 * kMostTriangles) fail("more vertices than an object can have here");
    part.first_vertex = first;
    o.mesh.positions.resize(first + n);
    const auto normals = attribute(own, "NORMAL", what, 3, 3, n);
    for (size_t i = 0; i < n; ++i) {
      part.positions.push_back(positions->vector(i).cast<Real>());
      part.normals.push_back(normals ? normals->vector(i).cast<Real>() : Vec3());
    }
    add_targets(primitive, part);
    add_influences(primitive, part);
    for (size_t set = 0; set < 2; ++set) {
      const auto uv = attribute(own, set == 0 ? "TEXCOORD_0" : "TEXCOORD_1", what, 2, 2, n);
      no_uv_ = no_uv_ && !uv;
      for (size_t i = 0; i < n; ++i)
        o.uv[set].push_back(
            uv ? Vec2{static_cast<Real>(uv->number(i, 0)), static_cast<Real>(uv->number(i, 1))}
               : Vec2{});
    }
    const auto colours = attribute(own, "COLOR_0", what, 3, 4, n);
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
    part.first_triangle = o.mesh.triangles.size();
    add_triangles(primitive, mode, what, first, n, material);
    part.triangles = o.mesh.triangles.size() - part.first_triangle;
    shape_->parts.push_back(std::move(part));
  }

  // Before memory for them is asked for.
  void count_moves(size_t more) {
    moves_ += more;
    if (moves_ > kMostMoves) fail("more morphed or skinned vertices than an object can have here");
  }

  void add_targets(const tinygltf::Primitive& primitive, internal::ObjectPart& part) {
    const size_t n = part.positions.size();
    count_moves(n * primitive.targets.size());
    for (size_t k = 0; k < primitive.targets.size(); ++k) {
      const std::string what = fmt::format("{}, target {}", part.what, k);
      const auto positions = attribute(primitive.targets[k], "POSITION", what, 3, 3, n, true);
      const auto normals = attribute(primitive.targets[k], "NORMAL", what, 3, 3, n, true);
      internal::MorphTarget target;
      for (size_t i = 0; i < n; ++i) {
        const Vec3d p = positions ? positions->vector(i) : Vec3d();
        const Vec3d v = normals ? normals->vector(i) : Vec3d();
        if (p == Vec3d() && v == Vec3d()) continue;
        target.moves.push_back({static_cast<uint32_t>(i), p.cast<Real>(), v.cast<Real>()});
      }
      part.targets.push_back(std::move(target));
    }
  }

  void add_influences(const tinygltf::Primitive& primitive, internal::ObjectPart& part) {
    const int skin = model_.nodes[part.node].skin;
    if (skin < 0 || !primitive.attributes.contains("JOINTS_0")) return;
    if (static_cast<size_t>(skin) >= shape_->skins.size())
      fail(fmt::format("node {}: there is no skin {}", part.node, skin));
    const size_t n = part.positions.size();
    std::vector<GltfNumbers> joints, weights;  // four in each
    for (int set = 0; set < 4; ++set) {
      const auto name = [&](const char* kind) { return fmt::format("{}_{}", kind, set); };
      auto j = attribute(primitive.attributes, name("JOINTS"), part.what, 4, 4, n);
      if (!j) break;
      auto w = attribute(primitive.attributes, name("WEIGHTS"), part.what, 4, 4, n);
      if (!w) fail(part.what + ": there are " + name("JOINTS") + " and no " + name("WEIGHTS"));
      if (!j->integers()) fail(part.what + ", " + name("JOINTS") + ": are no whole numbers");
      joints.push_back(*j);
      weights.push_back(*w);
    }
    count_moves(4 * n * joints.size());
    part.skin = skin;
    const size_t known = shape_->skins[static_cast<size_t>(skin)].joints.size();
    for (size_t i = 0; i < n; ++i) {
      double sum = 0;
      for (const GltfNumbers& set : weights)
        for (int k = 0; k < 4; ++k) {
          const double w = set.number(i, k);
          if (!(w >= 0)) fail(fmt::format("{}: vertex {} has a weight of {:g}", part.what, i, w));
          sum += w;
        }
      if (!(sum > 0))
        fail(fmt::format("{}: vertex {} has no joint: its weights are all zero", part.what, i),
             "let the weights of each vertex sum to 1 (Blender: Weights > Normalize All)");
      for (size_t set = 0; set < joints.size(); ++set)
        for (int k = 0; k < 4; ++k) {
          const double w = weights[set].number(i, k) / sum;
          const uint32_t joint = joints[set].index(i, k);
          if (w > 0 && joint >= known)
            fail(fmt::format("{}: vertex {} hangs on joint {}, and skin {} has {}", part.what, i,
                             joint, skin, known));
          part.influences.push_back({w > 0 ? joint : 0, static_cast<float>(w)});
        }
    }
  }

  void add_triangles(const tinygltf::Primitive& primitive, int mode, const std::string& what,
                     size_t first, size_t vertices, int material) {
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

  fs::path path_;
  tinygltf::Model model_;
  ReadObject out_;
  std::unique_ptr<ObjectShape> shape_;
  bool no_uv_ = true, no_colours_ = true;
  size_t moves_ = 0;  // of all targets and influences
};

}  // namespace

ReadObject read_object(const fs::path& path, const std::string& animation) {
  return ObjectReader(path).read(animation);
}

ObjectMotion::ObjectMotion(std::unique_ptr<ObjectShape> shape) : shape_(std::move(shape)) {}
ObjectMotion::~ObjectMotion() = default;
double ObjectMotion::first() const { return shape_->animation->first(); }
double ObjectMotion::last() const { return shape_->animation->last(); }
void ObjectMotion::pose(double seconds, TriangleMesh& mesh) { shape_->pose(seconds, mesh); }

}  // namespace nerf
