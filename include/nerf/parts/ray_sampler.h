// Where on a ray the network is asked: a march through the occupancy grid gives segments of matter
// and, from their remembered opacity, a coarse distribution; the fine samples are drawn from it.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "nerf/base/aligned.h"
#include "nerf/base/real.h"
#include "nerf/math/random.h"
#include "nerf/math/ray.h"
#include "nerf/math/vec.h"
#include "nerf/parts/occupancy.h"

namespace nerf {

// Narrows [t0, t1] to the ray's passage through a box; false where it misses.
bool clip_to_box(const Ray& ray, const Box3& box, double& t0, double& t1);

struct SamplerOptions {
  int max_samples = 32;           // per ray
  int min_samples = 2;            // of a ray that meets any matter
  Real samples_per_cell = 3.0_r;  // of the effective number of cells that a ray's light comes from
  Real uniform_share = 1.0_r;     // drawn over all occupied cells, whatever the cache says
  Real min_transmittance = 1e-4_r;  // the march stops where the cache lets less through; 0 = never
};

// Samples of a ray. The interval lengths of a ray add up to the length of matter that it passes,
// and each position lies inside its interval.
struct RaySamples {
  std::vector<Real> t;      // distance from the sampler's entry() along the ray
  std::vector<Real> delta;  // interval length
  // Where each interval begins, on request: it ends where the next begins, or before a gap.
  bool with_fronts = false;
  std::vector<Real> front;
};

// A ray's passage through one occupied cell.
struct Segment {
  Real t0, t1;     // relative to the entry point of the march
  Real thickness;  // optical, of this passage
};

class RaySampler {
 public:
  RaySampler(const OccupancyGrid& grid, const SamplerOptions& options, const Box3& clip);

  // Draws samples; with `random` jittered in their intervals, without it at the intervals' middles.
  // Returns their number (0: the ray meets no matter). Positions are entry() + t * direction.
  // Without `follow_cache` every occupied cell of the ray is sampled alike, up to its end.
  int sample(const Ray& ray, Random* random, bool follow_cache, RaySamples& out);

  void set_samples_per_cell(Real samples) { options_.samples_per_cell = samples; }

  // Every occupied cell of the ray cut into `per_cell` equal intervals: the quadrature with nothing
  // skipped, however many samples it takes.
  int sample_all(const Ray& ray, int per_cell, RaySamples& out);

  // Occupied segments of the last ray, the point where its march began (found in double, since far
  // from the scene float has no digits left for it) and that point's distance from the origin.
  std::span<const Segment> segments() const {
    return {segments_.data(), static_cast<size_t>(segment_count_)};
  }
  const Vec3& entry() const { return entry_; }
  double start() const { return start_; }

 private:
  struct Traversal;
  struct Passage;
  void march(const Ray& ray, Real min_transmittance);
  // Marches through the bricks of one cascade from t on, until the ray leaves it. Returns where,
  // and changes `cascade` to the one it enters (cascades() behind the outermost).
  Real march_cascade(Traversal& v, int& cascade, Real t);
  void march_brick(Traversal& v, int cascade, const Passage& passage);
  int choose_count(bool follow_cache);

  const OccupancyGrid& grid_;
  SamplerOptions options_;
  Box3 clip_;
  std::vector<Segment> segments_;  // of fixed size; the first segment_count_ are in use
  int segment_count_ = 0;
  // What each segment and one cell's length of it stop, and its mass in the coarse distribution.
  AlignedArray<Real> thickness_, one_, opacity_;
  std::vector<Real> mass_;
  // Where each begins and ends, and the mass up to there; mass and matter below each, and of all.
  std::vector<Real> ends_, mass_at_ends_, matter_below_, mass_below_;
  std::vector<Real> targets_;
  double start_ = 0;
  Vec3 entry_;
};

}  // namespace nerf
