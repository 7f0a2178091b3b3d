#include "model/field_integrator.h"

#include <vector>

#include "model/grid_integrator.h"
#include "model/network_integrator.h"
#include "nerf/model/radiance_field.h"

namespace nerf::internal {

namespace {

class GridRays final : public FieldIntegrator {
 public:
  GridRays(const GridField& field, const RenderOptions& options,
           const std::optional<ObliqueBox>& box, const std::optional<EngineMedium>& medium,
           ThreadPool& pool)
      : field_(field),
        options_(options),
        box_(box),
        medium_(medium),
        integrators_(static_cast<size_t>(pool.size())) {
    pack_layers(field.layers(), field.weights.data(), options.precision, packs_, pool);
  }

  void integrate(std::span<const Ray> rays, const RaySink& sink, int thread) override {
    auto& own = integrators_[static_cast<size_t>(thread)];
    if (!own)
      own = std::make_unique<GridIntegrator>(field_, GridMoment{field_.occupancy}, packs_, options_,
                                             box_, medium_);
    own->begin(sink);
    for (size_t i = 0; i < rays.size(); ++i) own->add(rays[i], static_cast<int>(i));
    own->finish();
  }

  RenderStatistics statistics() const override {
    RenderStatistics sum;
    for (const auto& own : integrators_)
      if (own) sum += own->statistics();
    return sum;
  }

 private:
  const GridField& field_;
  const RenderOptions& options_;
  std::optional<ObliqueBox> box_;
  std::optional<EngineMedium> medium_;
  LayerPacks packs_;
  std::vector<std::unique_ptr<GridIntegrator>> integrators_;  // of each thread
};

}  // namespace

std::unique_ptr<FieldIntegrator> make_integrator(const RadianceField& field,
                                                 const RenderOptions& options, ThreadPool& pool) {
  const auto box = oblique_box(field.info().to_engine, options.bbox);
  const auto medium = engine_medium(field, options);
  if (field.is_grid()) return std::make_unique<GridRays>(field.grid(), options, box, medium, pool);
  return std::make_unique<NetworkIntegrator>(field.network(), field.baked(), options, box, medium,
                                             pool);
}

}  // namespace nerf::internal
