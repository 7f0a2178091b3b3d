// Rays whose light is looked for: their pixels as a function of the code alone. Where matter is
// does not depend on it, so that a field is asked for that once; a field in a medium every time.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "nerf/base/cancel.h"
#include "nerf/base/threads.h"
#include "nerf/math/ray.h"
#include "nerf/model/renderer.h"

namespace nerf::internal {

class CodedRays {
 public:
  virtual ~CodedRays() = default;
  // [rays][3], sRGB in [0, 1], as integrate() has them with this Appearance::code. Throws
  // Cancelled.
  virtual std::vector<Real> pixels(const std::vector<Real>& code) = 0;
};

// Field, rays, pool and cancel must outlive it.
std::unique_ptr<CodedRays> coded_rays(const RadianceField& field, std::span<const Ray> rays,
                                      const RenderOptions& options, ThreadPool& pool,
                                      const Cancel* cancel);

}  // namespace nerf::internal
