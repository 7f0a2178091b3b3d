// For tests: cameras, and a pose.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <initializer_list>

#include "nerf/math/camera.h"
#include "nerf/math/refined_camera.h"

namespace nerf::test {

// Looks through the middle of the picture. `focal` in pixels; focal_y 0: the same.
inline Camera pinhole(int width, int height, double focal, double focal_y = 0) {
  Camera camera;
  camera.model = CameraModel::kPinhole;
  camera.width = width;
  camera.height = height;
  camera.params = {focal, focal_y > 0 ? focal_y : focal, 0.5 * width, 0.5 * height};
  return camera;
}

// 640x480 pixels, with all parameters of the model.
inline Camera make_camera(CameraModel model, std::initializer_list<double> params) {
  Camera camera{model, 640, 480, {}};
  EXPECT_EQ(static_cast<int>(params.size()), camera_model_params(model));
  std::copy(params.begin(), params.end(), camera.params.begin());
  return camera;
}

// Turned by about a radian about none of the axes.
inline Pose some_pose() { return {rotation_by({0.4, -0.9, 0.3}), {0.3, -1.2, 0.5}}; }

}  // namespace nerf::test
