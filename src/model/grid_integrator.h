// The grid method's integral along rays, a few hundred of them at a time.
#pragma once

#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "model/field_integrator.h"
#include "model/medium_ray.h"
#include "model/motion_lattice.h"
#include "model/sky.h"
#include "nerf/math/ray.h"
#include "nerf/model/grid_field.h"
#include "nerf/parts/ray_sampler.h"

namespace nerf::internal {

// What all rays of a picture share. A lattice is of their time; without one their samples are moved
// one by one, each ray's at its own time.
struct GridMoment {
  const OccupancyGrid& occupancy;  // the field's, or of one moment
  MotionLattice* lattice = nullptr;
};

// One thread's. Rays are added, then all of them are asked for at once: a stretch of each ray after
// the other, from its beginning on, so that next to nothing behind opaque matter is asked for and
// chunks are full nevertheless.
class GridIntegrator {
 public:
  // packs: of the field's networks. All but the box and the medium must outlive this.
  GridIntegrator(const GridField& field, const GridMoment& moment, const LayerPacks& packs,
                 const RenderOptions& options, const std::optional<ObliqueBox>& box,
                 const std::optional<EngineMedium>& medium);

  void begin(const RaySink& sink);
  void add(const Ray& ray, int place);
  void finish();

  const RenderStatistics& statistics() const { return statistics_; }  // of all that were added

 private:
  // A ray on its way.
  struct Way {
    int place = 0;
    size_t begin = 0, end = 0;  // its samples
    size_t next = 0;            // the first that the network was not asked for yet
    double transmittance =
        1;              // a product of many 1 - alpha; in float thin matter loses its opacity
    Real unshaded = 0;  // weight of the samples left without colour
    Real shared = 0;    // weight of those whose features are summed for one colour
    Real median = -1;   // distances from the entry at which so much light is stopped
    Real near = -1, far = -1;
    // Deep only: the stretch that is open, and the light before it; `front` below 0: none is.
    Real front = -1, back = 0;
    double before = 0;
    double light = 0, first_moment = 0, second_moment = 0;  // sums of w, w t and w t^2
    Vec3 entry, direction, background;
    double start = 0;   // distance of the entry
    Real time = 0;      // Ray::time
    bool ends = false;  // Ray::ends
    bool finished = false;
  };

  // Of a sample, for a medium: from the camera. Where its interval has a gap, about the sample.
  std::pair<double, double> stretch_of(const Way& way, size_t sample) const;

  void ask();
  // As many of the ray's samples before `until` as the chunk has room for.
  void add_part(size_t way, size_t until);
  void flush();
  // Of the chunk's samples: where the table is looked up.
  GridPoints looked_up();
  // Takes in what the network said of a part of a ray.
  void composite(int part);
  // The features that a ray's samples have summed, of weight `shared`, wait for the colour network
  // with others. `transmittance`: behind them.
  void add_shaded(size_t way, Real shared, double transmittance);
  void shade();
  void close(Way& way, const SeenLight* seen);
  // What is left of a ray's light comes from its background, or from the sky.
  void add_behind(const Way& way, const SeenLight* seen);
  const SeenLight* seen_of(size_t way) const { return medium_ ? seen_.data() + way : nullptr; }
  // Of a sample, as far as it does not reach beyond the middles between samples: from the entry.
  std::pair<Real, Real> interval_of(const Way& way, size_t sample) const;
  // Distance from the entry at which `left` of the light is left, in a sample that leaves `after`.
  Real stopped_at(const Way& way, size_t sample, double before, double after, double left) const;
  // Deep only: whether a sample does not belong to a stretch that is open; the begin of one, and
  // the end.
  static bool is_apart(const Way& way, Real t, Real delta, Real weight);
  static void begin_stretch(Way& way, Real t, Real delta, double transmittance);
  void close_stretch(Way& way, double transmittance);
  size_t geometry_features() const { return static_cast<size_t>(field_.options.geometry_features); }

  const GridField& field_;
  const RenderOptions& options_;
  std::optional<ObliqueBox> box_;
  std::optional<EngineMedium> medium_;
  std::optional<SkyLight> sky_;
  std::vector<Real> code_;  // of the picture's appearance, where the field has codes
  RaySink sink_;
  bool has_moments_ = false, has_percentiles_ = false, has_deep_ = false;
  GridTape tape_;
  // Neither: the scene stands still.
  std::unique_ptr<MotionChunk> motion_;
  std::unique_ptr<LatticeMotion> lattice_motion_;
  Chunk chunk_, shading_;
  Real *delta_row_ = nullptr, *direction_rows_ = nullptr;  // inputs of chunk_
  RaySampler sampler_;
  RaySamples samples_;
  AlignedArray<Real> x_, y_, z_;  // [kChunkSamples]
  AlignedArray<Real> alphas_{kChunkSamples};
  static constexpr size_t kStretch = 6;  // samples of a ray that are asked for at a time
  // Rays that meet matter, their samples one ray after the other.
  std::vector<Way> ways_;
  std::vector<SeenLight> seen_;          // of each of them
  std::vector<Real> t_, delta_, front_;  // the last with a medium
  std::vector<size_t> waiting_;          // rays that are not finished
  std::vector<Real> geometry_sums_;      // of each ray: features times weights, to be shaded
  // [kChunkSamples][geometry_features()]: of the chunk's samples, and of what waits for a colour.
  AlignedArray<Real> geometry_, shaded_geometry_;
  // Of the chunk: parts of rays.
  size_t part_way_[kChunkRays], part_first_[kChunkRays];  // which ray's, and its first sample
  std::vector<int32_t> ray_begin_;
  int parts_ = 0, samples_used_ = 0;
  std::vector<int32_t> shaded_begin_;
  int shaded_place_[kChunkSamples];
  Real shaded_weight_[kChunkSamples];
  Vec3 shaded_through_[kChunkSamples], shaded_haze_[kChunkSamples];  // SeenLight's
  size_t shaded_stretch_[kChunkSamples];  // deep only: which of its ray's
  int shaded_ = 0, shaded_rays_ = 0;
  // Rays take turns, so that each colour may need a direction of its own.
  static_assert(kChunkRays >= kChunkSamples);
  RenderStatistics statistics_;
};

}  // namespace nerf::internal
