// The papers' methods' integral along rays.
#pragma once

#include <mutex>
#include <vector>

#include "model/field_integrator.h"
#include "model/medium_ray.h"
#include "nerf/model/network_levels.h"

namespace nerf::internal {

class MatterCells;

class NetworkIntegrator final : public FieldIntegrator {
 public:
  // `occupancy` may be null: nothing is skipped. The field must outlive this.
  NetworkIntegrator(const NetworkField& field, const MatterCells* occupancy,
                    const RenderOptions& options, const std::optional<ObliqueBox>& box,
                    const std::optional<EngineMedium>& medium, ThreadPool& pool);

  void integrate(std::span<const Ray> rays, const RaySink& sink, int thread) override;
  RenderStatistics statistics() const override { return statistics_; }
  // Rays of a network call.
  int chunk() const { return per_chunk_; }

 private:
  // Levels of one thread: as they are, or of rays whose parts outside [near, far] are cut off.
  struct Worker {
    std::unique_ptr<NetworkLevels> whole, cut;
  };
  const NetworkField& field_of(bool cut);
  NetworkLevels& levels(bool cut, int thread);
  void give(const NetworkLevels& levels, int r, const Ray& ray, size_t place,
            const RaySink& sink) const;
  // Of the last level's samples, and of what is behind them: what the medium does to their light.
  std::vector<Veil> veils(const NetworkLevels& levels, int r, const Ray& ray) const;
  // The pixel again, seen through it.
  void see_through(const NetworkLevels& levels, int r, const Ray& ray, size_t place,
                   const RaySink& sink) const;
  void give_deep(const NetworkLevels& levels, int r, const Ray& ray,
                 std::vector<DeepSample>& deep) const;

  const NetworkField& field_;
  const MatterCells* occupancy_;
  std::optional<ObliqueBox> box_;
  std::optional<EngineMedium> medium_;
  std::vector<Real> code_;  // of the pictures' light; empty: the field's default
  // Made when first needed: without an opaque end, which would be that of what is cut off.
  std::optional<NetworkField> open_end_;
  std::once_flag open_end_made_;
  LayerPacks packs_;
  int per_chunk_;
  std::vector<Worker> workers_;
  std::mutex mutex_;
  RenderStatistics statistics_;
};

}  // namespace nerf::internal
