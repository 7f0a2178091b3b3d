// Intrinsics of a transforms.json frame.
#pragma once

#include <nlohmann/json.hpp>
#include <string>

#include "nerf/math/camera.h"

namespace nerf::internal {

// A frame's values before the file's common ones; `where` names file and frame in errors.
struct FrameJson {
  const nlohmann::json& frame;
  const nlohmann::json& common;
  std::string where;

  const nlohmann::json* find(const char* key) const;
  // No value where absent or null; Error where it is not a finite number.
  std::optional<double> number(const char* key) const;
  std::string text(const char* key) const;  // empty where absent
  bool flag(const char* key) const;         // false where absent
  [[noreturn]] void fail(const std::string& what, const std::string& hint = "") const;
};

// The image's size where the frame says it (w, h); {0, 0} where it does not.
struct FrameSize {
  int width = 0, height = 0;
};
FrameSize frame_size(const FrameJson& frame);

// Camera for an image of this size. Focal lengths from fl_x, fl_y or camera_angle_x,
// camera_angle_y; principal point from cx, cy or the middle; lens from camera_model, is_fisheye,
// latlong, k1.. p1 p2; an equirectangular picture is the whole sphere. `warning` is set where a
// value could not be used.
Camera frame_camera(const FrameJson& frame, const FrameSize& size, std::string* warning);

}  // namespace nerf::internal
