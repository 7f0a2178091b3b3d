// Objects from glTF 2.0 files (GLB, or JSON with its files beside it).
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "nerf/geometry/object.h"

namespace nerf {

namespace internal {
class ObjectShape;
}

// How an object moves: nodes' animations (linear, in steps, cubic), skins, morph targets.
class ObjectMotion {
 public:
  explicit ObjectMotion(std::unique_ptr<internal::ObjectShape> shape);
  ~ObjectMotion();

  // Seconds of the first key and of the last, in the file's own time, which begins at 0.
  double first() const;
  double last() const;
  // Where the object is at a moment; before the first key as at it, after the last likewise. `mesh`
  // is the object's as it was read, or as this made it. Throws Error where positions are not
  // finite.
  void pose(double seconds, TriangleMesh& mesh);

 private:
  std::unique_ptr<internal::ObjectShape> shape_;
};

struct ReadObject {
  SceneObject object;                    // glTF's coordinates: metres, +y up; at second 0
  std::unique_ptr<ObjectMotion> motion;  // null: it stands still
  std::vector<std::string> notes;        // for the user: what in the file was not used
};

// The triangles of the file's scene where its nodes, skins and morph targets take them, with
// materials and textures (PNG and JPEG), and how they move. `animation` names the one that plays;
// without a name it is the first, with those that drive nothing that it does. Throws Error that
// names the part of the file: not glTF, truncated, buffers missing, accessors beyond their buffers
// or of a wrong kind, nodes in a circle, no triangle with an area, coordinates that are not finite,
// joints that the skin has not, vertices without a weight, times that do not rise, textures that do
// not decode, extensions that are required and not known here, no such animation.
ReadObject read_object(const std::filesystem::path& path, const std::string& animation = "");

}  // namespace nerf
