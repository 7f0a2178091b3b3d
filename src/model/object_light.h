// The light around an inserted object.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "nerf/base/cancel.h"
#include "nerf/base/threads.h"
#include "nerf/geometry/object.h"
#include "nerf/geometry/triangle_bvh.h"
#include "nerf/model/renderer.h"

namespace nerf::internal {

// Radiance from all directions, linear, as an equirectangular picture (z up), and what follows.
class Environment {
 public:
  // Equirectangular, rows from above.
  struct Map {
    int width = 0, height = 0;
    std::vector<Vec3d> pixels;
    Vec3d direction(int x, int y) const;  // of a pixel's middle
    double solid_angle(int y) const;      // of a pixel
    Vec3d at(const Vec3d& direction) const;
  };

  // The same from everywhere.
  explicit Environment(const Vec3d& radiance = {});
  // radiance(unit direction) of each pixel's middle, row by row.
  template <class Radiance>
  static Environment from(const Radiance& radiance) {
    Environment e;
    e.map_ = {kWidth, kHeight, {}};
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x) e.map_.pixels.push_back(radiance(e.map_.direction(x, y)));
    e.prepare();
    return e;
  }
  static constexpr int kWidth = 64, kHeight = 32;

  Vec3d radiance(const Vec3d& direction) const { return map_.at(direction); }
  // Blurred as a surface of this roughness mirrors it.
  Vec3d mirrored(const Vec3d& direction, double roughness) const;
  // On a surface with this normal, over pi: what it shows if it is white.
  Vec3d diffuse(const Vec3d& normal) const;

 private:
  void prepare();

  Map map_;
  std::array<Vec3d, 9> harmonics_{};
  std::array<Map, 3> blurred_;  // roughness 1/3, 2/3, 1
};

// What the field shows around a point, from `near` on.
Environment environment_of(const RadianceField& field, const Vec3d& centre, double near,
                           const RenderOptions& options, ThreadPool& pool);

// Light that gets through between two points: alpha of the triangles on the way. Front and back.
double transmitted(const SceneObject& object, const TriangleBvh& bvh, const Vec3d& origin,
                   const Vec3d& direction, double near, double far);

// The share of the sky above each vertex that the object itself leaves free, by cosine.
std::vector<Real> vertex_openness(const SceneObject& object, const TriangleBvh& bvh, double size,
                                  ThreadPool& pool);

// Whether b is a moved, turned and scaled, to a thousandth of its size.
bool same_shape(std::span<const Vec3> a, std::span<const Vec3> b);

}  // namespace nerf::internal
