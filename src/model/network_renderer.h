// Pictures and queries of the paper methods; renderer.h and radiance_field.h say what they give.
#pragma once

#include <functional>
#include <span>

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

void query_network(const NetworkField& field, const Similarity& to_engine,
                   std::span<const Vec3d> points, std::span<const Vec3d> directions,
                   std::span<Real> density, std::span<Real> rgb, ThreadPool& pool);

}  // namespace nerf::internal
