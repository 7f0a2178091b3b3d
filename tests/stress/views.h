// Places that a camera can stand at, whatever it looks at.
#pragma once

#include <cmath>
#include <string>
#include <vector>

#include "stress/stress_field.h"

namespace nerf::stress {

struct View {
  std::string name;
  Camera camera;
  Pose pose;  // engine coordinates
};

// Pictures of size x size pixels: from inside, on faces and corners, far away, looking away, with
// lenses that see nearly all or nothing.
inline std::vector<View> views(int size = 20) {
  std::vector<View> out;
  const auto add = [&](const std::string& name, double focal, const Vec3d& eye,
                       const Vec3d& target) {
    out.push_back({name, pinhole(size, focal), look_at(eye, target)});
  };
  add("in the middle", 15, {0, 0, 0}, {0, 0, 1});
  add("along an axis from the middle", 15, {0, 0, 0}, {1, 0, 0});
  add("on a face, inwards", 15, {1, 0.2, 0.1}, {0, 0.2, 0.1});
  add("on a face, along it", 15, {1, 0.2, 0.1}, {1, 0.9, 0.1});
  add("in a corner, inwards", 15, {-1, -1, -1}, {0, 0, 0});
  add("in a corner, outwards", 15, {-1, -1, -1}, {-2, -2, -2});
  add("before a corner", 15, {-2, -2, -2}, {0, 0, 0});
  add("at a distance", 30, {2, 3, -2.5}, {0, 0, 0});
  add("looking away", 30, {2, 3, -2.5}, {4, 6, -5});
  add("looking past", 30, {2, 3, -2.5}, {2, 3, 2.5});
  for (double far : {1e3, 1e5, 1e7}) {
    add("far away", 8 * far, {far, 0.6 * far, -0.3 * far}, {0, 0, 0});
    add("far away along an axis", 8 * far, {0, 0, far}, {0, 0, 0});
    add("far away, looking away", 8 * far, {far, 0.6 * far, -0.3 * far}, {2 * far, 0, 0});
    add("far away, wide", 10, {far, 0.6 * far, -0.3 * far}, {0, 0, 0});
  }
  for (double focal : {1e-200, 1e-12, 1e-3, 1e4, 1e12, 1e200}) {
    add("focal length " + std::to_string(focal), focal, {0.1, 0.2, -3}, {0.1, 0.2, 0});
    add("inside, focal length " + std::to_string(focal), focal, {0.1, 0.2, -0.3}, {0.5, 0.2, 0});
  }
  View view = out.front();
  view.name = "principal point far outside of the picture";
  view.camera.params[2] = 1e9;
  out.push_back(view);
  view.name = "a fisheye that sees more than half of everything";
  view.camera.model = CameraModel::kSimpleRadialFisheye;
  view.camera.params = {0.3 * size, 0.5 * size, 0.5 * size, 0};
  out.push_back(view);
  view.name = "a lens that folds";
  view.camera.model = CameraModel::kSimpleRadial;
  view.camera.params = {0.5 * size, 0.5 * size, 0.5 * size, -0.4};
  out.push_back(view);
  return out;
}

// Turned, off centre and of another unit than the capture.
inline Similarity engine_frame(double offset, double scale) {
  Similarity s;
  const double a = 0.4;
  s.rotation.m = {{{std::cos(a), 0, std::sin(a)}, {0, 1, 0}, {-std::sin(a), 0, std::cos(a)}}};
  s.center = {offset, -2 * offset, 0.3 * offset};
  s.scale = scale;
  return s;
}

}  // namespace nerf::stress
