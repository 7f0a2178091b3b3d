// Pictures of depth by a field's training cameras, without their lenses.
#pragma once

#include <optional>
#include <vector>

#include "nerf/math/camera.h"
#include "nerf/model/model_info.h"
#include "nerf/model/surface.h"

namespace nerf::internal {

// A pinhole that stands for a training camera, or one of several for one that looks all around.
struct SurfaceCamera {
  const Camera* camera;  // what it shows is seen
  Mat3d to_camera;       // the pinhole's axes in the camera's
  Pose to_engine;
  double tangent_x = 1, tangent_y = 1;  // of half its view
};

// Of all training views. The info must outlive them.
std::vector<SurfaceCamera> surface_cameras(const ModelInfo& info);

struct DepthPicture {
  DepthView view;
  std::vector<float> spread;  // depth over which a pixel's light is stopped, from 5 % to 95 %
};

// What of the region a camera sees, in the region's coordinates; without one of everything, in the
// engine's. focal: pixels.
DepthPicture depth_picture(const RadianceField& field, const SurfaceCamera& camera, double focal,
                           const std::optional<SurfaceRegion>& region,
                           const SurfaceOptions& options, const SurfaceWork& work);

}  // namespace nerf::internal
