// Geometry of camera paths: rotations between poses, smooth curves through them, and what a set of
// cameras looks at. Poses are camera-to-world with OpenCV axes (x right, y down, z forward), in any
// one world frame unless said otherwise.
#pragma once

#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "nerf/math/vec.h"

namespace nerf {

// Unit quaternion w + xi + yj + zk of a rotation; q and -q are the same rotation.
struct Quaternion {
  double w = 1, x = 0, y = 0, z = 0;
};
Quaternion to_quaternion(const Mat3d& rotation);
Mat3d to_rotation(const Quaternion& q);

// Along the shorter arc from a (u = 0) to b (u = 1), at constant angular speed (Shoemake 1985).
Quaternion slerp(const Quaternion& a, const Quaternion& b, double u);

// Angle of the rotation from a to b, radians in [0, pi].
double rotation_angle(const Mat3d& a, const Mat3d& b);

// Largest absolute entry of R R^T - 1; infinite where R mirrors (negative determinant) or is not
// finite.
double orthonormality_error(const Mat3d& rotation);

// The rotation next to a matrix that is nearly one: its forward (z) axis keeps its direction, then
// its down (y) axis as far as that allows.
Mat3d orthonormalized(const Mat3d& nearly);

// Rotation of a level camera: z along `forward` (any length > 0), x perpendicular to `up`, y away
// from it. Where forward is parallel to up, some x perpendicular to both.
Mat3d look_rotation(const Vec3d& forward, const Vec3d& up);

// The point with the smallest sum of squared distances to the cameras' optical axes (as lines). No
// value where the axes are too nearly parallel to say how far away it is: an average spread below
// about 6 degrees.
std::optional<Vec3d> nearest_point_to_axes(std::span<const Pose> cameras);

// The value below which the fraction q in [0, 1] of `values` lies, by linear interpolation between
// order statistics. `values` not empty.
double quantile(std::vector<double> values, double q);

// Directions 0 to 2 pi that a set of azimuths (radians, any turn) covers: all of them, or the arc
// that remains when the widest gap without an azimuth is taken out.
struct Arc {
  bool full = false;      // the widest gap is below max_gap
  double middle = 0;      // of the arc, radians
  double half_width = 0;  // pi where full
};
Arc covered_arc(std::vector<double> azimuths, double max_gap);

// A curve of poses over [0, 1] and how far apart two of its points are: length of the path of the
// position and of turn_weight times the angle turned, as the root of the sum of squares.
struct PoseCurve {
  std::function<Pose(double)> at;
  double turn_weight = 0;  // world units per radian
};

// `count` parameters in [0, 1] between which the curve moves equally far (constant speed). Closed:
// the last one stands one step before the end, so that the path can repeat; open: at 1. A curve
// without any motion gives equal parameters.
std::vector<double> constant_speed_parameters(const PoseCurve& curve, int count, bool closed);

// Smooth curve through key poses: centripetal Catmull-Rom (Yuksel, Schaefer and Keyser 2011) for
// the positions, squad (Shoemake 1987) for the rotations, with knots spaced by the square root of
// the distance of PoseCurve. Consecutive keys that do not differ count as one.
class PoseSpline {
 public:
  // At least one key. turn_weight > 0.
  PoseSpline(std::span<const Pose> keys, double turn_weight);
  Pose at(double u) const;  // u in [0, 1], first to last key; clamped
  // Where u stands among the keys given: between `key` and the next one that differs.
  struct Place {
    int key = 0, next = 0;
    double fraction = 0;  // from key to next
  };
  Place place_of(double u) const;
  int distinct_keys() const { return static_cast<int>(keys_.size()); }

 private:
  struct Key {
    int index = 0;  // among the keys given
    double knot = 0;
    Vec3d position, tangent;  // tangent: derivative by the knot
    Quaternion rotation, control_in, control_out;
  };
  int segment(double u, double& fraction) const;
  std::vector<Key> keys_;
};

}  // namespace nerf
