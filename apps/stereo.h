// The two eyes of pictures for a headset.
#pragma once

#include "nerf/io/camera_path.h"
#include "nerf/math/camera.h"
#include "nerf/math/vec.h"
#include "nerf/model/renderer.h"

namespace nerf::apps {

// A picture of its own, drawn by nerf::render.
struct Eye {
  Camera camera;
  Pose camera_to_world;  // input coordinates
};

inline bool is_stereo(PictureKind picture) {
  return picture == PictureKind::kOds || picture == PictureKind::kVr180;
}

// The eyes of a stereo picture; `middle` is the panorama that one between them would see, `ipd`
// their distance, input unit. As nerfstudio: those of VR180 stand left and right of the middle,
// those of ODS turn with the azimuth.
Eye left_eye(PictureKind picture, const Eye& middle, double ipd);
Eye right_eye(PictureKind picture, const Eye& middle, double ipd);

// Both pictures as one: left over right (ODS), or left beside right (VR180). Of the same size.
Frame join_eyes(PictureKind picture, const Frame& left, const Frame& right);

}  // namespace nerf::apps
