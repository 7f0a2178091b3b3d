// Rays and triangles: Embree's tree of boxes, whose hits are computed anew in double.
#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "nerf/geometry/triangle_mesh.h"
#include "nerf/math/vec.h"

namespace nerf {

struct TriangleHit {
  double t = 0;           // along the ray, in units of its direction
  uint32_t triangle = 0;  // index as given
  double u = 0, v = 0;    // weights of its second and third corner
};

// Which triangles a ray meets is decided in float, without gaps between neighbours (Woop et al.
// 2013): a ray within a rounding of a triangle's edge may go to either side.
class TriangleBvh {
 public:
  TriangleBvh();
  // Copies what it needs. Triangles without an area are never hit.
  TriangleBvh(std::span<const Vec3> positions, std::span<const TriangleMesh::Triangle> triangles);
  ~TriangleBvh();
  TriangleBvh(TriangleBvh&&) noexcept;
  TriangleBvh& operator=(TriangleBvh&&) noexcept;

  const Box3& box() const { return box_; }
  bool empty() const { return !tree_; }

  // The nearest hit with t in (near, far) that accept(hit) takes; false where there is none.
  // `near` is not below 0.
  template <class Accept>
  bool nearest(const Vec3d& origin, const Vec3d& direction, double near, double far,
               TriangleHit& hit, const Accept& accept) const {
    return find_nearest(origin, direction, near, far, hit, &accept, call<Accept>);
  }
  // Calls visit(hit) for hits in (near, far) in no order, each once, until it returns false.
  template <class Visit>
  void each(const Vec3d& origin, const Vec3d& direction, double near, double far,
            const Visit& visit) const {
    find_each(origin, direction, near, far, &visit, call<Visit>);
  }

 private:
  struct Tree;
  using Call = bool (*)(const void* body, const TriangleHit& hit);
  template <class Body>
  static bool call(const void* body, const TriangleHit& hit) {
    return (*static_cast<const Body*>(body))(hit);
  }
  bool find_nearest(const Vec3d& origin, const Vec3d& direction, double near, double far,
                    TriangleHit& hit, const void* body, Call accept) const;
  void find_each(const Vec3d& origin, const Vec3d& direction, double near, double far,
                 const void* body, Call visit) const;

  Box3 box_;
  std::unique_ptr<Tree> tree_;
};

}  // namespace nerf
