// Renders the pictures of a plan and writes them.
#pragma once

#include <filesystem>
#include <functional>
#include <vector>

#include "nerf/base/cancel.h"
#include "nerf/base/progress.h"
#include "nerf/io/depth_image.h"
#include "nerf/model/renderer.h"
#include "render_plan.h"

namespace nerf::apps {

// As nerf::render with everything but camera, pose and time already given: throws Cancelled. A
// preview takes one ray per pixel.
using RenderFunction = std::function<Frame(const Camera& camera, const Pose& camera_to_world,
                                           const PlannedFrame& frame, bool preview,
                                           const std::function<void(double)>& progress)>;

struct RenderedFiles {
  std::vector<std::filesystem::path> color;  // written, whole, in the plan's order
  std::vector<std::filesystem::path> film;   // frames of a film that does not show these
  DepthRange depth;                          // ends of the depth pictures' colours, input unit
  bool cancelled = false;
};

// More files of a frame, written before its colours.
using FrameWriter = std::function<void(const PlannedFrame& planned, const Frame& frame)>;

// Writes every frame's pictures below `out`, each whole or not at all. All depth pictures have the
// same colours for the same depth: the range comes from a few of the views, rendered small first.
// Once `cancel` is requested the frame in work is dropped and what is there is returned. Throws
// Error where a file cannot be written.
RenderedFiles render_frames(const RenderPlan& plan, const std::filesystem::path& out,
                            const RenderFunction& render, Progress& progress, const Cancel& cancel,
                            const FrameWriter& more = {});

}  // namespace nerf::apps
