// Rays and triangles: a tree of boxes over them (binned by surface area, Wald 2007).
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "nerf/geometry/triangle_mesh.h"
#include "nerf/math/vec.h"

namespace nerf {

struct TriangleHit {
  double t = 0;           // along the ray, in units of its direction
  uint32_t triangle = 0;  // index as given
  double u = 0, v = 0;    // weights of its second and third corner
};

class TriangleBvh {
 public:
  TriangleBvh() = default;
  // Copies what it needs. Triangles without an area are never hit.
  TriangleBvh(std::span<const Vec3> positions, std::span<const TriangleMesh::Triangle> triangles);

  const Box3& box() const { return box_; }
  bool empty() const { return nodes_.empty(); }

  // The nearest hit with t in (near, far) that accept(hit) takes; false where there is none. Of
  // equally near ones that of the lesser triangle.
  template <class Accept>
  bool nearest(const Vec3d& origin, const Vec3d& direction, double near, double far,
               TriangleHit& hit, const Accept& accept) const;
  // Calls visit(hit) for hits in (near, far) in no order, each once, until it returns false.
  template <class Visit>
  void each(const Vec3d& origin, const Vec3d& direction, double near, double far,
            const Visit& visit) const;

 private:
  struct Node {
    std::array<float, 3> min, max;
    uint32_t first;  // of its triangles, or of its two children
    uint32_t count;  // of triangles; 0: it has children
  };
  struct Corners {
    Vec3d a, ab, ac;
  };
  struct Slopes {
    Vec3d origin, inverse;
  };
  class Builder;

  // Where a ray enters a node's box; not a number where it misses, which is below no `far`, not
  // even an infinite one.
  static double entry(const Node& node, const Slopes& ray, double near, double far) {
    double t0 = near, t1 = far;
    for (size_t k = 0; k < 3; ++k) {
      const int i = static_cast<int>(k);
      const double a = (double{node.min[k]} - ray.origin[i]) * ray.inverse[i];
      const double b = (double{node.max[k]} - ray.origin[i]) * ray.inverse[i];
      // A ray in a face's plane gives not-a-number, which must not win.
      t0 = std::max(t0, std::min(a, b) == std::min(a, b) ? std::min(a, b) : t0);
      t1 = std::min(t1, std::max(a, b) == std::max(a, b) ? std::max(a, b) : t1);
    }
    return t0 <= t1 ? t0 : std::numeric_limits<double>::quiet_NaN();
  }
  // Moeller and Trumbore 1997.
  static bool hits(const Corners& c, const Vec3d& origin, const Vec3d& direction,
                   TriangleHit& hit) {
    const Vec3d p = cross(direction, c.ac);
    const double determinant = dot(c.ab, p);
    if (determinant == 0) return false;
    const double inverse = 1 / determinant;
    const Vec3d s = origin - c.a;
    hit.u = dot(s, p) * inverse;
    if (!(hit.u >= 0 && hit.u <= 1)) return false;
    const Vec3d q = cross(s, c.ab);
    hit.v = dot(direction, q) * inverse;
    if (!(hit.v >= 0 && hit.u + hit.v <= 1)) return false;
    hit.t = dot(c.ac, q) * inverse;
    return hit.t == hit.t;
  }

  Box3 box_;
  std::vector<Node> nodes_;
  std::vector<Corners> corners_;   // of the triangles, in the order of the leaves
  std::vector<uint32_t> indices_;  // theirs, as given
};

template <class Accept>
bool TriangleBvh::nearest(const Vec3d& origin, const Vec3d& direction, double near, double far,
                          TriangleHit& hit, const Accept& accept) const {
  if (nodes_.empty()) return false;
  const Slopes ray{origin, {1 / direction.x, 1 / direction.y, 1 / direction.z}};
  bool found = false;
  struct Waiting {
    uint32_t node;
    double t;
  };
  Waiting stack[96];
  int waiting = 0;
  const double first = entry(nodes_[0], ray, near, far);
  if (first <= far) stack[waiting++] = {0, first};
  while (waiting > 0) {
    const Waiting next = stack[--waiting];
    if (next.t > far) continue;
    const Node& node = nodes_[next.node];
    if (node.count == 0) {
      const double a = entry(nodes_[node.first], ray, near, far);
      const double b = entry(nodes_[node.first + 1], ray, near, far);
      const bool a_first = !(b < a);
      const Waiting later{a_first ? node.first + 1 : node.first, a_first ? b : a};
      const Waiting sooner{a_first ? node.first : node.first + 1, a_first ? a : b};
      if (later.t <= far) stack[waiting++] = later;
      if (sooner.t <= far) stack[waiting++] = sooner;
      continue;
    }
    for (uint32_t i = node.first; i < node.first + node.count; ++i) {
      TriangleHit h;
      if (!hits(corners_[i], origin, direction, h) || !(h.t > near) || h.t > far) continue;
      h.triangle = indices_[i];
      const bool nearer = h.t < far || (found && h.t == far && h.triangle < hit.triangle);
      if (!nearer || !accept(h)) continue;
      hit = h;
      far = h.t;
      found = true;
    }
  }
  return found;
}

template <class Visit>
void TriangleBvh::each(const Vec3d& origin, const Vec3d& direction, double near, double far,
                       const Visit& visit) const {
  if (nodes_.empty()) return;
  const Slopes ray{origin, {1 / direction.x, 1 / direction.y, 1 / direction.z}};
  uint32_t stack[96];
  int waiting = 0;
  stack[waiting++] = 0;
  while (waiting > 0) {
    const Node& node = nodes_[stack[--waiting]];
    if (!(entry(node, ray, near, far) <= far)) continue;
    if (node.count == 0) {
      stack[waiting++] = node.first;
      stack[waiting++] = node.first + 1;
      continue;
    }
    for (uint32_t i = node.first; i < node.first + node.count; ++i) {
      TriangleHit h;
      if (!hits(corners_[i], origin, direction, h) || !(h.t > near && h.t < far)) continue;
      h.triangle = indices_[i];
      if (!visit(h)) return;
    }
  }
}

}  // namespace nerf
