// The frame that the engine works in, from cameras and points: which way is up, what the cameras
// look at, how large it is, where content begins and ends.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "scene_input.h"

namespace nerf::internal {

struct UpEstimate {
  Vec3d up;            // unit vector, input coordinates
  std::string source;  // how it was found, for the report
};

// In this order:
// 1. Photos are turned as their EXIF orientation says (View::orientation).
// 2. Cameras are held level more surely than they look at the horizon: up is the direction most
//    nearly perpendicular to all their horizontal axes, with the mean of the cameras' own up as a
//    prior that decides where those are parallel. Where that does not fit, some photos lie on a
//    side: up is the direction that each camera's horizontal or vertical axis is perpendicular to.
//    Cameras that look down and turn (flown over ground) look against it.
// 3. It is corrected by little, by the first of these that is there: the largest plane of the
//    points that lies level below the cameras (a floor, a table), the plane of cameras that stand
//    in a ring, and, where cameras look one way and so leave open how far down they look, the
//    largest upright plane of the points (a wall).
// Adds a warning where which end is up is a guess, or nothing agrees.
UpEstimate estimate_up(const std::vector<View>& views, const std::vector<ScenePoint>& points,
                       std::vector<std::string>& warnings);

// Point nearest to all optical axes, by robust least squares; no value where the axes do not meet
// in front of the cameras (forward-facing or outward-looking captures).
std::optional<Vec3d> estimate_focus(const std::vector<View>& views);

// Rotation that takes the unit vector `up` to +z by the smallest angle.
Mat3d rotation_to_z(const Vec3d& up);

// Fills in to_engine, unbounded, near, far of the scene and up, extent, near, far of its report
// from cameras, views, points and options. Throws Error where cameras stand at one point or an
// option is unusable.
void choose_frame(const SceneInput& input, Scene& scene);

}  // namespace nerf::internal
