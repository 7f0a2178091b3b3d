// Where a photo that was not trained on was taken, by what a field shows of it: held-out cameras
// are moved to there before they are compared with a field whose own cameras moved.
#pragma once

#include "nerf/base/cancel.h"
#include "nerf/base/threads.h"
#include "nerf/io/photos.h"
#include "nerf/math/camera.h"
#include "nerf/model/radiance_field.h"
#include "nerf/model/renderer.h"

namespace nerf {

struct CameraFit {
  Pose pose;                     // camera-to-world, input coordinates
  double before = 0, after = 0;  // mean squared error of the pixels looked at
};

// Fits the six numbers of PoseCorrection by some 1500 pixels spread over the photo, by least
// squares with differences that span many pixels at first and one at last. Of `options` background,
// time and precision. A pose that finds nothing better stays. Nothing moves where rays do not begin
// in one centre. Throws Cancelled.
CameraFit fit_camera(const RadianceField& field, const Camera& camera, const Pose& pose,
                     const Photo& photo, const RenderOptions& options, ThreadPool& pool,
                     const Cancel* cancel = nullptr);

}  // namespace nerf
