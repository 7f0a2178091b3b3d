// What a training may correct of the cameras that it was given, and how a ray follows.
//
// A pose is turned about its own centre and moved, apart from each other, so that no rotation
// sweeps a camera through the scene. A lens is corrected on the image plane, where sizes of a photo
// are alike.
#pragma once

#include <array>

#include "nerf/math/camera.h"
#include "nerf/math/vec.h"

namespace nerf {

struct PoseCorrection {
  static constexpr int kParameters = 6;
  Vec3d rotation;     // radians, a vector along the axis; world axes
  Vec3d translation;  // world units
};

struct LensCorrection {
  static constexpr int kParameters = 5;
  double focal = 0;       // logarithm of what both focal lengths are multiplied by
  Vec2d centre;           // shift of the principal point, in given focal lengths
  double k1 = 0, k2 = 0;  // added to the model's first two radial coefficients
  bool operator==(const LensCorrection&) const = default;
};

// Rotation about the vector by its length (Rodrigues).
Mat3d rotation_by(const Vec3d& vector);

// exp(rotation) R, t + translation.
Pose corrected(const Pose& camera_to_world, const PoseCorrection& correction);

// Panoramas and FOV lenses stay as they are.
bool can_correct_lens(CameraModel model);
// The camera, of a model that has k1 and k2 where the correction does. Of a lens that cannot be
// corrected: as it is.
Camera corrected(const Camera& camera, const LensCorrection& correction);

// Gradient by PoseCorrection::rotation, given the sum of cross(direction, gradient by the
// direction) over rays of the corrected pose, both in world axes. That by the translation is the
// sum of the gradients by the origins.
Vec3d rotation_gradient(const Vec3d& rotation, const Vec3d& torque);

// Gradient by the correction's parameters, in their order, of something whose gradient by a ray's
// unit direction is `gradient` (what of it is along the direction does not matter). The pixel stays
// and its direction moves, found by implicit differentiation of the distortion. Both in camera
// axes; `refined` is corrected(given, correction). Zero where the lens has no derivative.
std::array<double, LensCorrection::kParameters> lens_gradient(const Camera& refined,
                                                              const LensCorrection& correction,
                                                              const Vec3d& direction,
                                                              const Vec3d& gradient);

}  // namespace nerf
