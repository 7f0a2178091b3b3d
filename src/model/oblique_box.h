// A box of input coordinates, oblique to the engine's axes.
#pragma once

#include <optional>

#include "nerf/math/vec.h"
#include "nerf/parts/ray_sampler.h"

namespace nerf::internal {

// RenderOptions::bbox on the way of engine rays: its axes are the input's, its unit and origin the
// engine's.
struct ObliqueBox {
  Mat3d to_box;
  Box3 box;

  // Cuts [near, far] of a ray in engine coordinates to the part inside; false where there is none.
  // A rotation keeps distances, so t is the same in both frames.
  bool clip(const Vec3d& origin, const Vec3d& direction, double& near, double& far) const {
    return clip_to_box({to_box * origin, to_box * direction}, box, near, far);
  }
};

inline std::optional<ObliqueBox> oblique_box(const Similarity& to_engine,
                                             const std::optional<Box3>& box) {
  if (!box) return std::nullopt;
  ObliqueBox out{to_engine.rotation.transposed(), {}};
  // Only moved and scaled, not turned to the engine's axes and back: sides may be infinite.
  for (const Vec3d& corner : {box->min, box->max})
    out.box.extend((corner - to_engine.center) * to_engine.scale);
  return out;
}

}  // namespace nerf::internal
