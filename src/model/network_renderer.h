// Pictures of the paper methods; renderer.h says what they give.
#pragma once

#include <functional>

#include "model/object_pixels.h"
#include "nerf/base/cancel.h"
#include "nerf/base/threads.h"
#include "nerf/model/model_info.h"
#include "nerf/model/network_field.h"
#include "nerf/model/renderer.h"

namespace nerf::internal {

class MatterCells;

// occupancy: of the picture's moment; may be null.
Frame render_network(const RadianceField& field, const MatterCells* occupancy, const Camera& camera,
                     const Pose& camera_to_world, const RenderOptions& options,
                     const ObjectPixels& objects, ThreadPool& pool,
                     const std::function<void(double)>& progress, const Cancel* cancel);

}  // namespace nerf::internal
