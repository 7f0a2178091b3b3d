// What a trained model knows of the capture that it came from: its frame, unit and cameras.
#pragma once

#include <string>
#include <vector>

#include "nerf/math/camera.h"
#include "nerf/math/vec.h"
#include "nerf/model/capture_times.h"

namespace nerf {

struct ModelView {
  std::string name;  // as Scene::View::name
  Camera camera;     // at the size of the photos trained on
  Pose pose;         // camera-to-world, input coordinates, OpenCV axes
  bool held_out = false;
  double time = 0;  // [0, 1]; ModelInfo::times has its unit
  ViewIds ids = {};
  // While the photo's lines were read, input unit: for what is compared with it. `camera` reads all
  // lines at once, as new views do.
  LineMotion motion = {};
};

struct ModelInfo {
  std::string method = "grid";
  std::vector<ModelView> views;  // sorted by name
  Similarity to_engine;          // input coordinates to engine coordinates (+z up)
  bool unbounded = false;
  bool alpha = false;  // trained on photos with alpha: a background can be chosen
  // sRGB; behind evaluations and pictures where none is chosen. Without alpha the grid method's
  // evaluations take mid-grey, and paper methods have black.
  Vec3 background{1, 1, 1};
  double near = 0, far = 0;  // engine units
  CaptureTimes times;        // of the views
};

// Whether the views are of different moments.
bool has_times(const ModelInfo& info);

}  // namespace nerf
