// Vectors as Eigen's and back.
#pragma once

#include <Eigen/Core>

#include "nerf/math/vec.h"

namespace nerf::internal {

inline Eigen::Vector3d to_eigen(const Vec3d& v) { return {v.x, v.y, v.z}; }
inline Vec3d from_eigen(const Eigen::Vector3d& v) { return {v.x(), v.y(), v.z()}; }

}  // namespace nerf::internal
