// The sky of a field that has learnt one, for rays on which some light is left.
#pragma once

#include <memory>
#include <vector>

#include "nerf/base/real.h"
#include "nerf/math/vec.h"
#include "nerf/model/grid_field.h"
#include "nerf/model/renderer.h"

namespace nerf::internal {

inline bool shows_sky(const GridField& field, const RenderOptions& options) {
  return field.has_sky() && options.sky && !options.bbox;
}

// One thread's. Rays are added, and the network is asked for many at a time.
class SkyLight {
 public:
  // Both must outlive this.
  SkyLight(const GridField& field, const LayerPacks& packs);

  // The appearance code that the sky is seen in, where the field has codes.
  // Before: the mean of the photos'. An empty one changes nothing.
  void set_code(const std::vector<Real>& code);
  // rgb [3] gets share times the sky in this direction, by channel, at the latest in finish().
  void add(const Vec3& direction, const Vec3& share, Real* rgb);
  void finish();

 private:
  struct Waiting {
    Real* rgb;
    Vec3 share;
  };

  Tape tape_;
  Value directions_, code_rows_ = -1, sky_ = 0;
  std::unique_ptr<Chunk> chunk_;
  std::vector<Real> code_;
  std::vector<Waiting> waiting_;
};

}  // namespace nerf::internal
