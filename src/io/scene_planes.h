// Planes that the points of a capture lie on: floors, tables, walls.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <optional>
#include <vector>

#include "nerf/io/scene.h"

namespace nerf::internal {

// The points that say something about the shape of a scene: finite and not far from the others.
// At most a few thousand, spread over the list.
class PointCloudShape {
 public:
  explicit PointCloudShape(const std::vector<ScenePoint>& points);

  struct Plane {
    Eigen::Vector3d normal;  // unit, towards most of the cameras
    double share = 0;        // of the points that lie on it
    double beyond = 0;       // share of the points on the far side, clearly off the plane
    double cameras = 0;      // share of the cameras on the near side
  };

  // The plane with the most points among those whose normal `admitted` says yes to (it is asked
  // with unit normals of either sign): RANSAC (Fischler and Bolles 1981) with counter-based random
  // numbers, then least squares over its points. Nothing where it holds no more points than any
  // other slice of the scene would.
  std::optional<Plane> largest_plane(const std::function<bool(const Eigen::Vector3d&)>& admitted,
                                     const std::vector<Eigen::Vector3d>& cameras) const;

 private:
  std::vector<Eigen::Vector3d> points_;
  double radius_ = 0;  // median distance from the median point
};

}  // namespace nerf::internal
