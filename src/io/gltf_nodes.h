// The tree of nodes of a glTF file: where each stands.
#pragma once

#include <tiny_gltf.h>

#include <cmath>
#include <filesystem>
#include <optional>
#include <span>
#include <vector>

#include "nerf/math/camera_paths.h"
#include "nerf/math/vec.h"

namespace nerf::internal {

inline constexpr double kFarthestGltf = 1e12;  // of any of a file's numbers

// Length of a quaternion as files write it, x y z w.
template <class Numbers>
double quaternion_norm(const Numbers& q) {
  return std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
}

// x -> linear * x + offset.
struct GltfTransform {
  Mat3d linear;
  Vec3d offset;
  GltfTransform operator*(const GltfTransform& first) const {
    return {linear * first.linear, linear * first.offset + offset};
  }
  Vec3d operator*(const Vec3d& x) const { return linear * x + offset; }
  // Of normals, up to their length: the sign says on which side of a mirrored surface they stand.
  Mat3d of_normals() const;
  bool mirrors() const {
    return dot(linear.column(0), cross(linear.column(1), linear.column(2))) < 0;
  }
};

// The first 12 of a 4x4 matrix's numbers, column by column, that count.
template <class Numbers>
GltfTransform gltf_matrix(const Numbers& number) {
  GltfTransform t;
  for (int c = 0; c < 3; ++c)
    t.linear.set_column(c, {number(4 * c), number(4 * c + 1), number(4 * c + 2)});
  t.offset = {number(12), number(13), number(14)};
  return t;
}

// What a node says of where it stands in its parent.
struct NodePose {
  Vec3d move, scale{1, 1, 1};
  Quaternion turn;
  std::optional<GltfTransform> matrix;  // in place of these three
  std::vector<double> weights;          // of its mesh's morph targets; empty: the mesh's own
  GltfTransform transform() const;
};

class GltfNodes {
 public:
  // Throws Error where nodes are no trees (section 3.5.2 of glTF 2.0) or transforms are none.
  GltfNodes(const tinygltf::Model& model, const std::filesystem::path& path);

  size_t size() const { return parent_.size(); }
  // Of the file's scene, each after its parent.
  const std::vector<size_t>& shown() const { return shown_; }
  // As the file has them, without any animation.
  const std::vector<NodePose>& rest() const { return rest_; }
  // From each node's coordinates to the scene's.
  std::vector<GltfTransform> to_scene(std::span<const NodePose> poses) const;
  // The same of one node.
  GltfTransform to_scene(size_t node, std::span<const NodePose> poses) const;
  // Marks a node and all that it hangs on.
  void mark_line(size_t node, std::vector<char>& marked) const;
  // Marks what hangs on marked nodes too.
  std::vector<char> with_all_below(std::vector<char> marked) const;

 private:
  void find_order(const tinygltf::Model& model, const std::filesystem::path& path);
  void find_shown(const tinygltf::Model& model, const std::filesystem::path& path);

  std::vector<int> parent_;  // -1: none
  std::vector<size_t> order_, shown_;
  std::vector<NodePose> rest_;
};

}  // namespace nerf::internal
