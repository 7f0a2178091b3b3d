// What a few hundred rays give besides colour, opacity and median, on its way into a picture.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "model/field_integrator.h"
#include "nerf/math/ray.h"
#include "nerf/model/field.h"
#include "nerf/model/layers.h"
#include "nerf/model/model_info.h"

namespace nerf::internal {

// Against the gradient of density where half of the light is stopped, engine coordinates: of rays
// with a median above 0, all of one time; the others keep what `normals` holds.
void find_normals(std::span<const Ray> rays, std::span<const double> median, FieldQuery& query,
                  std::span<Vec3> normals);

// One thread's.
class RayLayers {
 public:
  // The field must outlive it.
  RayLayers(const Field& field, const Layers& layers, const Similarity& to_engine);

  // Makes room for n rays and tells the sink where it is.
  void begin(size_t n, RaySink& sink);
  // Behind the integral of these rays.
  void finish(std::span<const Ray> rays, std::span<const double> median);
  // One ray's numbers become a pixel's. `depth_per_distance`: math/camera.h.
  void give(size_t ray, double median, double depth_per_distance, size_t pixel,
            PictureLayers& picture);

 private:
  const Field& field_;
  Layers layers_;
  Similarity to_engine_;
  std::unique_ptr<FieldQuery> query_;
  std::vector<Real> mean_, variance_, near_, far_;
  std::vector<int32_t> samples_;
  std::vector<Vec3> normals_;
  std::vector<std::vector<DeepSample>> deep_;
};

}  // namespace nerf::internal
