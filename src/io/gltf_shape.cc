#include "gltf_shape.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "nerf/base/error.h"

namespace nerf::internal {

namespace {

// Its positions and normals with the targets in by their weights.
void morph(const ObjectPart& part, const std::vector<double>& weights, std::vector<Vec3>& positions,
           std::vector<Vec3>& normals) {
  for (size_t k = 0; k < std::min(weights.size(), part.targets.size()); ++k) {
    const Real weight = static_cast<Real>(weights[k]);
    if (weight == 0) continue;
    for (const MorphTarget::Move& move : part.targets[k].moves) {
      positions[move.vertex] = positions[move.vertex] + move.position * weight;
      normals[move.vertex] = normals[move.vertex] + move.normal * weight;
    }
  }
}

// Linear blend skinning: the weighted sum of the joints' transforms.
GltfTransform blended(const std::vector<GltfTransform>& joints, std::span<const Influence> of) {
  GltfTransform sum{{}, {}};
  sum.linear.m = {};
  for (const Influence& influence : of) {
    const double w = static_cast<double>(influence.weight);
    if (w == 0) continue;
    const GltfTransform& t = joints[influence.joint];
    for (size_t r = 0; r < 3; ++r)
      for (size_t c = 0; c < 3; ++c) sum.linear.m[r][c] += w * t.linear.m[r][c];
    sum.offset = sum.offset + t.offset * w;
  }
  return sum;
}

}  // namespace

std::vector<char> ObjectShape::carrying_nodes() const {
  std::vector<char> carrying(nodes.size());
  for (const ObjectPart& part : parts) {
    if (part.skin < 0)
      nodes.mark_line(part.node, carrying);
    else
      for (const size_t joint : skins[static_cast<size_t>(part.skin)].joints)
        nodes.mark_line(joint, carrying);
  }
  // Their weights count even where a skin says where they stand.
  for (const ObjectPart& part : parts)
    if (!part.targets.empty()) carrying[part.node] = 1;
  return carrying;
}

void ObjectShape::pose(std::optional<double> seconds, TriangleMesh& mesh) {
  std::vector<NodePose> poses = nodes.rest();
  if (seconds && animation) animation->pose(*seconds, poses);
  const std::vector<GltfTransform> to_scene = nodes.to_scene(poses);
  for (ObjectPart& part : parts) pose_part(poses, to_scene, part, mesh);
}

void ObjectShape::pose_part(const std::vector<NodePose>& poses,
                            const std::vector<GltfTransform>& to_scene, ObjectPart& part,
                            TriangleMesh& mesh) const {
  const auto& own = poses[part.node].weights;
  std::vector<Vec3> morphed_positions, morphed_normals;
  if (!part.targets.empty()) {
    morphed_positions = part.positions;
    morphed_normals = part.normals;
    morph(part, own.empty() ? part.weights : own, morphed_positions, morphed_normals);
  }
  const auto& positions = part.targets.empty() ? part.positions : morphed_positions;
  const auto& normals = part.targets.empty() ? part.normals : morphed_normals;
  std::vector<GltfTransform> joints;
  if (part.skin >= 0) {
    // The node's own transform does not count.
    const ObjectSkin& skin = skins[static_cast<size_t>(part.skin)];
    for (size_t j = 0; j < skin.joints.size(); ++j)
      joints.push_back(to_scene[skin.joints[j]] * skin.inverse_bind[j]);
  }
  const size_t each = part.influences.size() / std::max<size_t>(1, positions.size());
  GltfTransform transform = to_scene[part.node];
  Mat3d turn = transform.of_normals();
  bool mirrors = transform.mirrors();
  size_t mirrored_vertices = 0;
  for (size_t i = 0; i < positions.size(); ++i) {
    if (part.skin >= 0) {
      transform = blended(joints, std::span(part.influences).subspan(i * each, each));
      turn = transform.of_normals();
      mirrors = transform.mirrors();
    }
    mirrored_vertices += mirrors;
    const Vec3d p = transform * positions[i].cast<double>();
    if (!(length(p) < 1e15))
      throw Error(fmt::format("{}: position {} is not finite", part.what, i), path_.string(),
                  "export the file again");
    mesh.positions[part.first_vertex + i] = p.cast<Real>();
    const Vec3d v = turn * normals[i].cast<double>() * (mirrors ? -1 : 1);
    mesh.normals[part.first_vertex + i] =
        std::isfinite(length(v)) ? normalized(v).cast<Real>() : Vec3();
  }
  // Blends of turns may mirror a few vertices of a skin.
  const bool mirrored = 2 * mirrored_vertices > positions.size();
  if (mirrored == part.mirrored) return;
  part.mirrored = mirrored;
  for (size_t t = part.first_triangle; t < part.first_triangle + part.triangles; ++t)
    std::swap(mesh.triangles[t][1], mesh.triangles[t][2]);
}

}  // namespace nerf::internal
