// Rigid motions of constant velocity: exponential and logarithm of SE(3) (Murray, Li and Sastry
// 1994, section 2.3).
#pragma once

#include "nerf/math/vec.h"

namespace nerf {

// Angular velocity (radians, a vector along the axis) and velocity, in the axes of what moves, for
// some time that the user of it says.
struct Twist {
  Vec3d rotation, translation;
  Twist operator*(double s) const { return {rotation * s, translation * s}; }
  bool operator==(const Twist&) const = default;
};

// Where what moves so from the identity is after that time: exp of the twist.
Pose motion_by(const Twist& twist);

// The twist whose exponential the motion is; its angle is at most pi.
Twist twist_of(const Pose& motion);

// First `motion`, in the pose's own axes, then the pose.
inline Pose moved(const Pose& pose, const Pose& motion) {
  return {pose.rotation * motion.rotation, pose * motion.translation};
}

}  // namespace nerf
