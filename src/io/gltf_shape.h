// The triangles of a glTF object in the coordinates of its nodes, and where these take them: node
// transforms, morph targets, skins (sections 3.7.2.2, 3.7.3 of glTF 2.0).
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "gltf_animation.h"
#include "gltf_nodes.h"
#include "nerf/geometry/triangle_mesh.h"

namespace nerf::internal {

// What of a vertex's place is a joint's.
struct Influence {
  uint32_t joint = 0;  // of the skin
  float weight = 0;    // of a vertex they sum to 1
};

struct MorphTarget {
  struct Move {
    uint32_t vertex = 0;
    Vec3 position, normal;
  };
  std::vector<Move> moves;  // of the vertices that it moves
};

// A primitive of a mesh at a node: a range of the object's vertices and of its triangles.
struct ObjectPart {
  std::string what;  // "mesh 0, primitive 1"
  size_t node = 0;
  int skin = -1;  // below 0: none
  size_t first_vertex = 0, first_triangle = 0, triangles = 0;
  std::vector<Vec3> positions, normals;  // normals: zero where there are none
  std::vector<Influence> influences;     // of each vertex equally many, with a skin
  std::vector<MorphTarget> targets;
  std::vector<double> weights;  // of the targets, where the node says none
  bool mirrored = false;        // its triangles in the mesh are turned round
};

struct ObjectSkin {
  std::vector<size_t> joints;  // nodes
  std::vector<GltfTransform> inverse_bind;
};

class ObjectShape {
 public:
  ObjectShape(GltfNodes nodes, std::filesystem::path path)
      : nodes(std::move(nodes)), path_(std::move(path)) {}

  GltfNodes nodes;
  std::optional<GltfAnimation> animation;
  std::vector<ObjectPart> parts;
  std::vector<ObjectSkin> skins;

  // Nodes whose transforms the parts depend on.
  std::vector<char> carrying_nodes() const;
  // Writes positions and normals of all parts, and turns triangles of parts that are mirrored now
  // and were not before, or the other way round. No value: at rest. Throws Error for positions that
  // are not finite.
  void pose(std::optional<double> seconds, TriangleMesh& mesh);

 private:
  void pose_part(const std::vector<NodePose>& poses, const std::vector<GltfTransform>& to_scene,
                 ObjectPart& part, TriangleMesh& mesh) const;
  std::filesystem::path path_;
};

}  // namespace nerf::internal
