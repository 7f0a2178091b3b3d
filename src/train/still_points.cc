#include "train/still_points.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "nerf/math/contraction.h"
#include "nerf/math/random.h"
#include "nerf/math/window.h"

namespace nerf {

namespace {

// google/nerfies, nerfies/training.py: of the points' places, and from where on a motion of a point
// hardly counts more. Engine units here, of scene.json's there, which are about as large.
constexpr Real kNoise = 0.001_r, kPenalty = 0.001_r;

}  // namespace

StillPoints::Worker::Worker(const NetworkField& field)
    : tape(kAtOnce, 1),
      point(tape.input(3, Domain::kSamples)),
      moment(tape.input(1, Domain::kSamples)),
      scale(tape.input(1, Domain::kRays)),
      window(
          std::make_shared<std::vector<Real>>(static_cast<size_t>(field.options.deform.degrees))) {
  const DeformNetworks& deform = field.networks.back().deform;
  const Value code = table_rows(tape, moment, deform.codes);
  still_loss(tape, record_warp(tape, deform.warp, point, code, window), point, scale, kPenalty);
  tape.plan();
  chunk = std::make_unique<Chunk>(tape);
  chunk->weights = field.weights.data();
}

StillPoints::StillPoints(const Scene& scene, const NetworkField& field, const NetworkRecipe& recipe,
                         int threads)
    : field_(field), weight_(recipe.still) {
  const Space space = field.options.space;
  if (recipe.still == 0 || field.options.deform.warp == WarpKind::kNone ||
      field.books.deformation.out == 0 || space == Space::kNdc)
    return;
  for (const ScenePoint& p : scene.points) {
    const Vec3 at = scene.to_engine.apply(p.position).cast<Real>();
    points_.push_back(space == Space::kContract ? contract(at) : at);
  }
  if (points_.empty()) return;
  count_ = recipe.still_points;
  for (int i = 0; i < threads; ++i) workers_.push_back(std::make_unique<Worker>(field));
}

void StillPoints::use_packs(const LayerPacks* packs) {
  for (const auto& worker : workers_) worker->chunk->packs = packs;
}

double StillPoints::backward(uint64_t seed, int64_t step, int64_t chunk, int thread,
                             Real* weight_gradient) {
  Worker& w = *workers_[static_cast<size_t>(thread)];
  Chunk& c = *w.chunk;
  const int64_t begin = chunk * kAtOnce, n = std::min(kAtOnce, count_ - begin);
  const int32_t ray_begin[] = {0, static_cast<int32_t>(n)};
  c.samples = static_cast<int>(n);
  c.rays = 1;
  c.ray_begin = ray_begin;
  c.loss = 0;
  c.weight_gradient = weight_gradient;
  window_weights(field_.windows.warp, *w.window);
  const int64_t ld = c.stride(w.point);
  for (int64_t i = 0; i < n; ++i) {
    Random random(seed, static_cast<uint64_t>(step),
                  random_key(RandomStream::kStillPoints, begin + i));
    const Vec3& p = points_[static_cast<size_t>(random.below(points_.size()))];
    c.data(w.moment)[i] =
        static_cast<Real>(random.below(static_cast<uint64_t>(field_.books.deformation.out)));
    for (int k = 0; k < 3; ++k) c.data(w.point)[k * ld + i] = p[k] + kNoise * random.normal();
  }
  c.data(w.scale)[0] = weight_ / static_cast<Real>(count_);
  w.tape.forward(c);
  w.tape.backward(c);
  return c.loss;
}

}  // namespace nerf
