// What the encoding of a sample reads: its point, or its Gaussian.
#pragma once

#include <algorithm>
#include <span>

#include "nerf/math/contraction.h"
#include "nerf/math/frustum.h"
#include "nerf/model/network_field.h"
#include "nerf/model/network_ray.h"

namespace nerf::internal {

// The Gaussian around [t0, t1] of the ray (or its middle, a point), warped and projected on the
// encoding's axes: with J the warp's Jacobian and q = J p the variance along p is
// t_var (d . q)^2 + r_var (|q|^2 - (d . q)^2 / |d|^2). Into the rows of position and, of
// integrated encodings, of variance, `ld` apart.
inline void place_gaussian(const NetworkOptions& o, std::span<const Vec3> axes,
                           const NetworkRay& ray, Real t0, Real t1, Real* position, Real* variance,
                           int64_t ld) {
  RayGaussian<Real> g{0.5_r * (t0 + t1), 0, 0};
  if (o.cast == Cast::kCone)
    g = o.space == Space::kNdc ? cylinder_gaussian(t0, t1, ray.radius)
                               : cone_gaussian(t0, t1, ray.radius);
  const Vec3 mean = ray.origin + ray.direction * g.t_mean;
  const bool warped = o.space == Space::kContract;
  const Vec3 at = warped ? contract(mean) : mean;
  if (!o.integrated()) {
    for (int k = 0; k < 3; ++k) position[k * ld] = at[k];
    return;
  }
  const auto jacobian = warped ? contraction_jacobian(mean) : ContractionJacobian<Real>{1, 0, mean};
  for (size_t k = 0; k < axes.size(); ++k) {
    const Vec3 q = jacobian(axes[k]);
    const Real along = dot(ray.direction, q);
    const Real across = std::max(0.0_r, dot(q, q) - along * along / (ray.length * ray.length));
    position[static_cast<int64_t>(k) * ld] = dot(axes[k], at);
    variance[static_cast<int64_t>(k) * ld] = g.t_variance * along * along + g.r_variance * across;
  }
}

}  // namespace nerf::internal
