#include "model/object_shading.h"

#include <algorithm>
#include <cmath>

namespace nerf::internal {

Vec3d reflectance(const Vec3d& facing, double roughness, double cosine) {
  const double r0 = 1 - roughness, r1 = 0.0425 - 0.0275 * roughness, r2 = 1.04 - 0.572 * roughness,
               r3 = 0.022 * roughness - 0.04;
  const double a = std::min(r0 * r0, std::exp2(-9.28 * cosine)) * r0 + r1;
  const double scale = -1.04 * a + r2, offset = 1.04 * a + r3;
  return facing * scale + Vec3d{offset, offset, offset};
}

Vec3d sent_of_distant(const Vec3d& towards, const SurfacePoint& s, const Vec3d& normal,
                      const Vec3d& albedo, const Vec3d& facing, const Vec3d& direction) {
  const double nl = dot(normal, towards);
  if (!(nl > 0)) return {};
  const Vec3d half = normalized(towards - direction);
  const double nh = std::max(0.0, dot(normal, half)), vh = std::max(0.0, -dot(direction, half));
  const double nv = std::max(1e-3, -dot(normal, direction));
  const double alpha = std::max(1e-3, s.roughness * s.roughness), a2 = alpha * alpha;
  const double spread = nh * nh * (a2 - 1) + 1;
  const double d = a2 / (spread * spread);  // times pi
  const double v =
      0.5 / (nl * std::sqrt(nv * nv * (1 - a2) + a2) + nv * std::sqrt(nl * nl * (1 - a2) + a2));
  const Vec3d fresnel = facing + (Vec3d{1, 1, 1} - facing) * std::pow(1 - vh, 5);
  return (albedo + fresnel * (d * v)) * nl;
}

}  // namespace nerf::internal
