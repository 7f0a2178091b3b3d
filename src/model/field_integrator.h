// What integrate() and pictures ask a kind of field for.
#pragma once

#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "model/oblique_box.h"
#include "nerf/base/threads.h"
#include "nerf/math/ray.h"
#include "nerf/model/layers.h"
#include "nerf/model/renderer.h"

namespace nerf {
class RadianceField;
}

namespace nerf::internal {

// What the colours of rays through a table are made of, besides the light that they are seen in:
// the samples that share a colour, in any order.
struct SharedSamples {
  std::vector<int> places;     // of their rays
  std::vector<Real> weights;   // of the ray's light, together
  std::vector<Real> geometry;  // [..][GridOptions::geometry_features], mean over the samples
  // Rays that end in the sky, and what they have left of their light.
  std::vector<int> sky_places;
  std::vector<Real> sky_shares;
};

// Where results go, each at the place of its ray. Zero before; colours and opacities are always
// there, the others where they are wanted. Distances are along the ray, engine units. Median and
// percentiles lie between samples, as if each interval had one density.
struct RaySink {
  Real* rgb = nullptr;  // [..][3]
  Real* opacity = nullptr;
  double* median = nullptr;
  Real *mean = nullptr, *variance = nullptr;
  Real *near = nullptr, *far = nullptr;
  int32_t* samples = nullptr;
  std::vector<DeepSample>* deep = nullptr;
  SharedSamples* shared = nullptr;  // of a table, without a medium
};

inline constexpr double kNearShare = 0.05, kFarShare = 0.95;  // of the light, stopped

class FieldIntegrator {
 public:
  virtual ~FieldIntegrator() = default;
  // A few hundred neighbouring rays, by one of the pool's threads.
  virtual void integrate(std::span<const Ray> rays, const RaySink& sink, int thread) = 0;
  virtual RenderStatistics statistics() const = 0;  // of all rays
};

// The field and the options must outlive it.
std::unique_ptr<FieldIntegrator> make_integrator(const RadianceField& field,
                                                 const RenderOptions& options, ThreadPool& pool);

}  // namespace nerf::internal
