// Points of a capture that stand still: where the warp takes them at any moment, they should stay
// (Park et al. 2021, section 3.4).
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "nerf/autodiff/operations.h"
#include "nerf/io/scene.h"
#include "nerf/model/network_field.h"
#include "nerf/train/network_recipe.h"

namespace nerf {

class StillPoints {
 public:
  // None where the recipe gives them no weight, the field has no warp of moments, or the capture no
  // points. The field must outlive this.
  StillPoints(const Scene& scene, const NetworkField& field, const NetworkRecipe& recipe,
              int threads);
  void use_packs(const LayerPacks* packs);

  static constexpr int64_t kAtOnce = 256;
  // Of a step's points, as many at once.
  int64_t chunks() const { return (count_ + kAtOnce - 1) / kAtOnce; }
  // Draws the points of a chunk and their moments, adds the gradient of the loss and returns it.
  double backward(uint64_t seed, int64_t step, int64_t chunk, int thread, Real* weight_gradient);

 private:
  struct Worker {
    Worker(const NetworkField& field);
    Tape tape;
    Value point, moment, scale;
    std::shared_ptr<std::vector<Real>> window;
    std::unique_ptr<Chunk> chunk;
  };

  const NetworkField& field_;
  std::vector<Vec3> points_;  // engine coordinates, contracted where the field's space is
  int64_t count_ = 0;         // of a step
  Real weight_;
  std::vector<std::unique_ptr<Worker>> workers_;
};

}  // namespace nerf
