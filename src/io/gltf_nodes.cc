#include "gltf_nodes.h"

#include <fmt/format.h>

#include <cmath>

#include "nerf/base/error.h"

namespace nerf::internal {

namespace {

namespace fs = std::filesystem;

[[noreturn]] void fail(const fs::path& path, const std::string& what) {
  throw Error(what, path.string(), "export the file again");
}

NodePose pose_of(const tinygltf::Node& node, size_t index, const fs::path& path) {
  const auto numbers = [&](const std::vector<double>& given, size_t n,
                           std::vector<double> otherwise) {
    if (given.empty()) return otherwise;
    bool good = given.size() == n;
    for (const double x : given) good = good && std::fabs(x) < kFarthestGltf;
    if (!good) fail(path, fmt::format("node {} has a transform that is none", index));
    return given;
  };
  NodePose pose;
  pose.weights = node.weights;
  for (const double w : pose.weights)
    if (!(std::fabs(w) < kFarthestGltf))
      fail(path, fmt::format("node {} has a weight that is no number", index));
  if (!node.matrix.empty()) {
    const auto m = numbers(node.matrix, 16, {});
    pose.matrix = gltf_matrix([&](int i) { return m[static_cast<size_t>(i)]; });
    return pose;
  }
  const auto move = numbers(node.translation, 3, {0, 0, 0});
  const auto turn = numbers(node.rotation, 4, {0, 0, 0, 1});
  const auto scale = numbers(node.scale, 3, {1, 1, 1});
  const double norm = quaternion_norm(turn);
  if (!(norm > 0)) fail(path, fmt::format("node {} has a rotation that is none", index));
  pose.move = {move[0], move[1], move[2]};
  pose.turn = {turn[3] / norm, turn[0] / norm, turn[1] / norm, turn[2] / norm};
  pose.scale = {scale[0], scale[1], scale[2]};
  return pose;
}

}  // namespace

// Rows are cross products of the columns: the inverse's transpose times the determinant.
Mat3d GltfTransform::of_normals() const {
  const Vec3d a = linear.column(0), b = linear.column(1), c = linear.column(2);
  Mat3d m;
  m.set_column(0, cross(b, c));
  m.set_column(1, cross(c, a));
  m.set_column(2, cross(a, b));
  return m;
}

GltfTransform NodePose::transform() const {
  if (matrix) return *matrix;
  GltfTransform t;
  t.linear = to_rotation(turn);
  for (int c = 0; c < 3; ++c) t.linear.set_column(c, t.linear.column(c) * scale[c]);
  t.offset = move;
  return t;
}

GltfNodes::GltfNodes(const tinygltf::Model& model, const fs::path& path)
    : parent_(model.nodes.size(), -1) {
  for (size_t i = 0; i < model.nodes.size(); ++i) {
    rest_.push_back(pose_of(model.nodes[i], i, path));
    for (const int child : model.nodes[i].children) {
      if (child < 0 || static_cast<size_t>(child) >= size())
        fail(path, fmt::format("there is no node {}", child));
      int& parent = parent_[static_cast<size_t>(child)];
      if (parent >= 0)
        fail(path, fmt::format("node {} is reached twice: nodes are no tree", child));
      parent = static_cast<int>(i);
    }
  }
  find_order(model, path);
  find_shown(model, path);
}

// Parents first, without recursion: files may be as deep as they like.
void GltfNodes::find_order(const tinygltf::Model& model, const fs::path& path) {
  for (size_t i = 0; i < size(); ++i)
    if (parent_[i] < 0) order_.push_back(i);
  for (size_t next = 0; next < order_.size(); ++next)
    for (const int child : model.nodes[order_[next]].children)
      order_.push_back(static_cast<size_t>(child));
  if (order_.size() == size()) return;
  std::vector<char> reached(size());
  for (const size_t i : order_) reached[i] = 1;
  size_t first = 0;
  while (reached[first]) ++first;
  fail(path, fmt::format("node {} is reached twice: nodes go in a circle", first));
}

void GltfNodes::find_shown(const tinygltf::Model& model, const fs::path& path) {
  std::vector<int> roots;
  if (model.scenes.empty()) {
    for (size_t i = 0; i < size(); ++i)
      if (parent_[i] < 0) roots.push_back(static_cast<int>(i));
  } else {
    const int scene = model.defaultScene < 0 ? 0 : model.defaultScene;
    if (static_cast<size_t>(scene) >= model.scenes.size())
      fail(path, fmt::format("there is no scene {}", scene));
    roots = model.scenes[static_cast<size_t>(scene)].nodes;
  }
  std::vector<char> reached(size());
  for (const int root : roots) {
    std::vector<int> waiting{root};
    while (!waiting.empty()) {
      const int next = waiting.back();
      waiting.pop_back();
      if (next < 0 || static_cast<size_t>(next) >= size())
        fail(path, fmt::format("there is no node {}", next));
      const size_t i = static_cast<size_t>(next);
      if (reached[i]) fail(path, fmt::format("node {} is reached twice: nodes are no tree", i));
      reached[i] = 1;
      shown_.push_back(i);
      for (const int child : model.nodes[i].children) waiting.push_back(child);
    }
  }
}

std::vector<GltfTransform> GltfNodes::to_scene(std::span<const NodePose> poses) const {
  std::vector<GltfTransform> to_scene(size());
  for (const size_t i : order_) {
    to_scene[i] = poses[i].transform();
    if (parent_[i] >= 0) to_scene[i] = to_scene[static_cast<size_t>(parent_[i])] * to_scene[i];
  }
  return to_scene;
}

GltfTransform GltfNodes::to_scene(size_t node, std::span<const NodePose> poses) const {
  GltfTransform transform = poses[node].transform();
  for (int i = parent_[node]; i >= 0; i = parent_[static_cast<size_t>(i)])
    transform = poses[static_cast<size_t>(i)].transform() * transform;
  return transform;
}

void GltfNodes::mark_line(size_t node, std::vector<char>& marked) const {
  for (int i = static_cast<int>(node); i >= 0 && !marked[static_cast<size_t>(i)];
       i = parent_[static_cast<size_t>(i)])
    marked[static_cast<size_t>(i)] = 1;
}

std::vector<char> GltfNodes::with_all_below(std::vector<char> marked) const {
  for (const size_t i : order_)
    if (parent_[i] >= 0 && marked[static_cast<size_t>(parent_[i])]) marked[i] = 1;
  return marked;
}

}  // namespace nerf::internal
