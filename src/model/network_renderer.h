// Pictures of the paper methods; renderer.h says what they give.
#pragma once

#include <functional>

#include "nerf/base/cancel.h"
#include "nerf/base/threads.h"
#include "nerf/model/model_info.h"
#include "nerf/model/network_field.h"
#include "nerf/model/renderer.h"

namespace nerf::internal {

class BakedOccupancy;

// `occupancy` may be null: nothing is skipped.
Frame render_network(const NetworkField& field, const ModelInfo& info,
                     const BakedOccupancy* occupancy, const Camera& camera,
                     const Pose& camera_to_world, const RenderOptions& options, ThreadPool& pool,
                     const std::function<void(double)>& progress, const Cancel* cancel);

}  // namespace nerf::internal
