// The integral of a field along rays: what pictures, mirrors, inserted objects and viewers are made
// of. Cameras only make rays (math/ray.h); a ray ends at its own far distance, before a background
// of its own.
//
//   light that reaches t:  T(t) = exp(-integral of density up to t)
//   colour:                integral of T density colour dt + T(far) background
// (Mildenhall et al. 2020, equation 1, by quadrature.)
#pragma once

#include <functional>
#include <span>
#include <vector>

#include "nerf/base/cancel.h"
#include "nerf/base/real.h"
#include "nerf/base/threads.h"
#include "nerf/math/ray.h"
#include "nerf/model/layers.h"
#include "nerf/model/renderer.h"

namespace nerf {

// A number (or three) for each ray; empty where not wanted. Distances are along the ray, engine
// units; 0 where the ray does not stop so much light.
struct RayResults {
  std::vector<Real> rgb;      // [n][3], sRGB, the ray's background composited in
  std::vector<Real> opacity;  // [n], 1 - T(far)
  std::vector<Real> median;
  std::vector<Real> mean, variance;  // of the light that is stopped, not of the background's
  std::vector<Real> near, far;       // 5 % and 95 %
  std::vector<int32_t> samples;
  std::vector<Vec3> normal;  // unit, engine coordinates, towards where density falls; else 0
  std::vector<std::vector<DeepSample>> deep;  // front to back
  RenderStatistics statistics;
};

// Of RenderOptions neither background, time, supersample nor layers are looked at: the rays have
// theirs.
// Neighbouring rays should follow each other, since they read the same memory. The same bits for
// any number of threads. Throws Cancelled.
RayResults integrate(const RadianceField& field, std::span<const Ray> rays, const Layers& layers,
                     const RenderOptions& options, ThreadPool& pool,
                     const std::function<void(double)>& progress = {},
                     const Cancel* cancel = nullptr);

}  // namespace nerf
