// The frame that the engine works in, from cameras and points: which way is up, what the cameras
// look at, how large it is, where content begins and ends.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "scene_input.h"

namespace nerf::internal {

// Unit vector in input coordinates. Cameras are held level more surely than they look at the
// horizon, so up is the direction most nearly perpendicular to all their x axes, with the mean of
// the cameras' own up as a prior that decides where those x axes are parallel; a closed, planar
// ring of cameras then corrects it by its normal. Adds a warning where photos seem to lie on a
// side.
Vec3d estimate_up(const std::vector<View>& views, std::vector<std::string>& warnings);

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
