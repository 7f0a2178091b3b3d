// An object of triangles with materials, as glTF 2.0 has them (section 3.9), without a file.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "nerf/geometry/triangle_mesh.h"
#include "nerf/math/vec.h"

namespace nerf {

enum class TextureWrap { kRepeat, kClamp, kMirror };

// 8-bit picture, rows from the top, red, green, blue and alpha, not premultiplied.
struct Texture {
  int width = 0, height = 0;
  TextureWrap wrap_x = TextureWrap::kRepeat, wrap_y = TextureWrap::kRepeat;
  bool nearest = false;  // no interpolation
  bool srgb = false;     // colours; else numbers
  std::vector<uint8_t> pixels;

  // Red, green, blue (linear) and alpha at a place; (0, 0) is the upper left corner, (1, 1) the
  // lower right one.
  std::array<double, 4> at(double u, double v) const;
};

struct TextureUse {
  int texture = -1;  // index into SceneObject::textures; below 0: none
  int uv = 0;        // which of the vertices' coordinates
  // Where on the texture coordinates (u, v) are: origin + along_u * u + along_v * v.
  Vec2d origin{0, 0}, along_u{1, 0}, along_v{0, 1};
};

enum class AlphaMode { kOpaque, kMask, kBlend };

// Factors are linear and are multiplied by what textures say.
struct Material {
  Vec3d base{1, 1, 1};
  double alpha = 1;
  TextureUse base_texture;  // sRGB and alpha
  double metallic = 1, roughness = 1;
  TextureUse metallic_roughness_texture;  // blue and green
  Vec3d emissive;
  TextureUse emissive_texture;
  AlphaMode alpha_mode = AlphaMode::kOpaque;
  double alpha_cutoff = 0.5;  // kMask: what has less is not there
  bool double_sided = false;  // else it is seen from outside only
  bool unlit = false;         // its base colour is what is seen
};

struct SceneObject {
  TriangleMesh mesh;                         // normals, no colours
  std::array<std::vector<Vec2>, 2> uv;       // of each vertex; empty: none
  std::vector<std::array<Real, 4>> colours;  // linear, with alpha; empty: white
  std::vector<int32_t> material;             // of each triangle
  std::vector<Material> materials;
  std::vector<Texture> textures;
};

// What an object's surface is at a point of a triangle: textures and vertex colours in.
struct SurfacePoint {
  Vec3d base;
  double alpha = 1;  // 0, or 1, or between (kBlend)
  double metallic = 0, roughness = 1;
  Vec3d emissive;
  Vec3d normal;     // unit, from the vertices', towards the outside
  Vec3d geometric;  // unit, of the triangle
  bool unlit = false, double_sided = false;
};

// u, v: weights of the second and the third corner.
SurfacePoint surface_point(const SceneObject& object, uint32_t triangle, double u, double v);
// Its alpha alone.
double surface_alpha(const SceneObject& object, uint32_t triangle, double u, double v);

}  // namespace nerf
