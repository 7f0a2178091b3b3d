// From the features of a step's samples to the loss and back, chunk by chunk.
#include <algorithm>
#include <cmath>
#include <cstring>
#include <numeric>

#include "nerf/parts/losses.h"
#include "train/grid_trainer.h"

namespace nerf {

GridHead::GridHead(const GridField& field, const GridLosses& losses, const DenseParameters& dense,
                   ThreadPool& pool)
    : tape(field, /*training=*/true, losses) {
  for (int i = 0; i < pool.size(); ++i) {
    workers.push_back(std::make_unique<Chunk>(tape.tape));
    workers.back()->packs = &dense.packs();
  }
}

GridLosses GridTrainer::losses(const PixelLoss& pixel) const {
  const GridRecipe& r = options.grid_recipe;
  return {.pixel = pixel,
          .on_weights = has_losses_on_weights(),
          .on_density = clearing > 0,
          .shared_colour = static_cast<Real>(r.shared_colour),
          .stop_transmittance = static_cast<Real>(r.stop_transmittance),
          .roulette = static_cast<Real>(r.gradient_roulette),
          .on_position = moving && cameras};
}

void GridTrainer::bind(int64_t c, const GridTape& tape, Chunk& chunk) {
  const int64_t ld = kChunkSamples, rows = field.shape.features();
  const size_t i = static_cast<size_t>(c);
  chunk.samples = batch.samples[i];
  chunk.rays = batch.rays[i];
  chunk.ray_begin = batch.ray_begin.data() + i * (kChunkRays + 1);
  chunk.loss = 0;
  chunk.bind(tape.features, features.data() + c * rows * ld, d_features.data() + c * rows * ld);
  std::memcpy(chunk.data(tape.delta), batch.delta.data() + c * ld, ld * sizeof(Real));
  const size_t ray_bytes = 3 * kChunkRays * sizeof(Real);
  std::memcpy(chunk.data(tape.directions), batch.direction_of(static_cast<int>(c)), ray_bytes);
  if (has_medium()) {
    std::memset(chunk.data(tape.background), 0, ray_bytes);
    std::memcpy(chunk.data(tape.distance), batch.lines->distance.data() + c * ld,
                ld * sizeof(Real));
  } else {
    std::memcpy(chunk.data(tape.background), batch.background_of(static_cast<int>(c)), ray_bytes);
  }
  if (moving) {
    const auto from = {&batch.x, &batch.y, &batch.z};
    Real* to = chunk.data(tape.position);
    for (const auto* a : from) {
      std::memcpy(to, a->data() + c * ld, ld * sizeof(Real));
      to += chunk.stride(tape.position);
    }
    std::memcpy(chunk.data(tape.time), batch.time.data() + c * kChunkRays,
                kChunkRays * sizeof(Real));
  }
  if (tape.cover >= 0)
    std::copy_n(batch.cover.data() + c * kChunkRays, chunk.rays, chunk.data(tape.cover));
  for (int r = 0; tape.photo >= 0 && r < chunk.rays; ++r)
    chunk.data(tape.photo)[r] =
        static_cast<Real>(batch.photo[static_cast<size_t>(c * kChunkRays + r)]);
  for (int r = 0; tape.lens >= 0 && r < chunk.rays; ++r) {
    const size_t at = static_cast<size_t>(c * kChunkRays + r);
    const int photo = batch.photo[at];
    chunk.data(tape.lens)[r] =
        photo < 0 ? -1 : static_cast<Real>(field.books.photo_lenses[static_cast<size_t>(photo)]);
    chunk.data(tape.corner)[r] = batch.corner[at];
  }
}

Real GridTrainer::scale_of(int64_t c, int ray) const {
  const double rays = static_cast<double>(std::max<int64_t>(batch.rays_considered, 1));
  const Real scale = static_cast<Real>(1 / (3 * source.mean_weight() * rays));
  return scale * batch.weight[static_cast<size_t>(c * kChunkRays + ray)];
}

void GridTrainer::set_loss(int64_t c, const GridTape& tape, Chunk& chunk) {
  const PixelLossInputs& in = tape.pixel_loss;
  if (in.gradient < 0) {
    std::memcpy(chunk.data(in.target), batch.target_of(static_cast<int>(c)),
                3 * kChunkRays * sizeof(Real));
    for (int r = 0; r < chunk.rays; ++r) chunk.data(in.scale)[r] = scale_of(c, r);
    return;
  }
  const int64_t lr = chunk.stride(in.gradient);
  for (int r = 0; r < chunk.rays; ++r) {
    const size_t ray = static_cast<size_t>(listed_at[static_cast<size_t>(c * kChunkRays + r)]);
    for (size_t k = 0; k < 4; ++k)
      chunk.data(in.gradient)[static_cast<int64_t>(k) * lr + r] = pixel_gradient[4 * ray + k];
  }
}

void GridTrainer::note_pixels(int64_t c, const GridTape& tape, const Chunk& chunk) {
  const int64_t lr = chunk.stride(tape.image.pixel);
  const Real* pixel = chunk.data(tape.image.pixel);
  const Real* target = batch.target_of(static_cast<int>(c));
  double squared_error = 0;
  for (int r = 0; r < chunk.rays; ++r) {
    if (batch.photo[static_cast<size_t>(c * kChunkRays + r)] < 0) continue;
    Real sum = 0;
    for (int k = 0; k < 3; ++k) {
      const Real e = pixel[k * lr + r] - target[k * kChunkRays + r];
      sum += e * e;
    }
    squared_error += static_cast<double>(sum);
  }
  chunk_squared_error[static_cast<size_t>(c)] = squared_error;
  // The sky covers everything, also where the field is empty.
  const Real* opacity = chunk.data(tape.matter) + 3 * chunk.stride(tape.matter);
  chunk_opacity[static_cast<size_t>(c)] = std::accumulate(opacity, opacity + chunk.rays, 0.0);
}

void GridTrainer::leave_out(int64_t c, const GridTape& tape, Random& random, Chunk& chunk) {
  const int64_t lr = chunk.stride(tape.image.pixel);
  const Real* pixel = chunk.data(tape.image.pixel);
  const Real* target = batch.target_of(static_cast<int>(c));
  for (int r = 0; r < chunk.rays; ++r) {
    const size_t at = static_cast<size_t>(c * kChunkRays + r);
    Real error = 0;
    for (int k = 0; k < 3; ++k)
      error += std::abs(pixel[k * lr + r] - target[k * kChunkRays + r]) / 3;
    ray_errors[at] = error;
    if (robust->leaves_out(batch.tile[at], error, done, random.uniform()))
      chunk.data(tape.pixel_loss.scale)[r] = 0;
  }
}

double GridTrainer::mean_squared_error() const {
  const double sum =
      std::accumulate(chunk_squared_error.begin(), chunk_squared_error.begin() + batch.chunks,
                      batch.empty_squared_error);
  const int64_t rays = batch.rays_considered - batch.rays_masked;
  return sum / (3 * static_cast<double>(std::max<int64_t>(rays, 1)));
}

TrainerImpl::HeadSums GridTrainer::head(StepReport& report) {
  const int64_t ld = kChunkSamples;
  const GridHead& h = open ? *given_head : *own_head;
  const GridTape& tape = h.tape;
  const int64_t per = (batch.chunks + kAccumulators - 1) / kAccumulators;
  pool.parallel_for_thread(kAccumulators, [&](int64_t a, int thread) {
    Chunk& chunk = *h.workers[static_cast<size_t>(thread)];
    chunk.weights = field.weights.data();
    chunk.weight_gradient = dense->begin_sum(a);
    const int64_t end = std::min<int64_t>(batch.chunks, (a + 1) * per);
    for (int64_t c = a * per; c < end; ++c) {
      bind(c, tape, chunk);
      set_loss(c, tape, chunk);
      Random random(seed(), static_cast<uint64_t>(done), random_key(RandomStream::kRoulette, c));
      chunk.state<RouletteState>(tape.gradient_roulette).offset =
          static_cast<double>(random.uniform());
      tape.tape.forward(chunk);
      chunk_colours[static_cast<size_t>(c)] = chunk.count(tape.colour);
      if (robust && !open) leave_out(c, tape, random, chunk);
      if (has_losses_on_weights()) add_losses_on_weights(c, tape, chunk);
      if (offset_weight > 0) chunk.loss += offset_loss(c, tape, chunk);
      if (clearing > 0) clear_matter(c, tape, chunk);
      tape.tape.backward(chunk);
      keep_samples(c, tape, chunk);
      if (moving && cameras)
        for (int k = 0; k < 3; ++k)
          std::copy_n(chunk.gradient(tape.position) + k * chunk.stride(tape.position),
                      chunk.samples, moving->d_points.data() + (3 * c + k) * ld);
      std::memcpy(densities.data() + c * ld, chunk.data(tape.density), ld * sizeof(Real));
      chunk_loss[static_cast<size_t>(c)] = chunk.loss;
      note_pixels(c, tape, chunk);
    }
    chunk.bind(tape.features, nullptr, nullptr);
  });

  HeadSums sums{.squared_error = given.empty() ? mean_squared_error() : 0};
  for (int c = 0; c < batch.chunks; ++c) {
    report.loss += chunk_loss[static_cast<size_t>(c)];
    sums.opacity += chunk_opacity[static_cast<size_t>(c)];
    report.colours += chunk_colours[static_cast<size_t>(c)];
    report.learning += chunk_kept[static_cast<size_t>(c)];
  }
  report.rays = batch.rays_considered;
  report.samples = batch.total_samples;
  return sums;
}

void GridTrainer::render() {
  if (!given_head)
    given_head = std::make_unique<GridHead>(field, losses({PixelLoss::Kind::kGiven}), *dense, pool);
  const size_t rays = batch.listed.size();
  const bool from_photos = given.empty();
  if (from_photos) {
    pixels.rays.resize(rays);
    pixels.target.resize(3 * rays);
    pixels.scale.resize(rays);
  }
  pixels.rgba.assign(4 * rays, 0.0_r);
  listed_at.assign(batch.weight.size(), -1);
  for (size_t i = 0; i < rays; ++i) {
    const RayBatch::Listed& listed = batch.listed[i];
    if (listed.place >= 0)
      listed_at[static_cast<size_t>(listed.place)] = static_cast<int32_t>(i);
    else  // met no matter
      for (int k = 0; k < 3; ++k)
        pixels.rgba[4 * i + static_cast<size_t>(k)] = listed.ray.background[k];
    if (!from_photos) continue;
    pixels.rays[i] = listed.ray;
    std::copy_n(listed.target, 3, pixels.target.data() + 3 * i);
    pixels.scale[i] =
        listed.place >= 0 ? scale_of(listed.place / kChunkRays, listed.place % kChunkRays) : 0.0_r;
  }
  const GridTape& tape = given_head->tape;
  pool.parallel_for_thread(batch.chunks, [&](int64_t c, int thread) {
    Chunk& chunk = *given_head->workers[static_cast<size_t>(thread)];
    chunk.weights = field.weights.data();
    bind(c, tape, chunk);
    tape.tape.forward(chunk);
    const int64_t lr = chunk.stride(tape.image.pixel);
    const Real* pixel = chunk.data(tape.image.pixel);
    for (int r = 0; r < chunk.rays; ++r) {
      const size_t ray = static_cast<size_t>(listed_at[static_cast<size_t>(c * kChunkRays + r)]);
      for (size_t k = 0; k < 4; ++k)
        pixels.rgba[4 * ray + k] = pixel[static_cast<int64_t>(k) * lr + r];
    }
    chunk.bind(tape.features, nullptr, nullptr);
  });
}

// Means over rays: their scale is that of a mean over three channels too.
void GridTrainer::add_losses_on_weights(int64_t c, const GridTape& tape, Chunk& chunk) {
  const int64_t first_sample = c * kChunkSamples;
  const double depth_now = depth_weight_now();
  Real* gradient = chunk.data(tape.weight_gradient);
  std::fill_n(gradient, chunk.samples, 0.0_r);
  for (int r = 0; r < chunk.rays; ++r) {
    const int32_t begin = chunk.ray_begin[r];
    const size_t n = static_cast<size_t>(chunk.ray_begin[r + 1] - begin);
    const auto of_ray = [&](const Real* data) { return std::span(data + begin, n); };
    const auto middles = of_ray(batch.middle.data() + first_sample);
    const auto weights = of_ray(chunk.data(tape.image.weights));
    const std::span d_weights(gradient + begin, n);
    const Real scale = scale_of(c, r);
    if (distortion > 0)
      chunk.loss += distortion_loss(middles, of_ray(batch.width.data() + first_sample), weights,
                                    static_cast<Real>(3 * distortion) * scale, d_weights);
    const Real depth = batch.depth[static_cast<size_t>(c * kChunkRays + r)];
    if (depth_now > 0 && depth > 0)
      chunk.loss +=
          depth_loss(middles, weights, depth, static_cast<Real>(3 * depth_now) * scale, d_weights);
  }
}

void GridTrainer::clear_matter(int64_t c, const GridTape& tape, Chunk& chunk) {
  const double weight = 3 * clearing_now();
  const Real* middles = batch.middle.data() + c * kChunkSamples;
  Real* gradient = chunk.data(tape.density_gradient);
  std::fill_n(gradient, chunk.samples, 0.0_r);
  for (int r = 0; r < chunk.rays; ++r) {
    const size_t ray = static_cast<size_t>(c * kChunkRays + r);
    const auto clear = [&](int64_t begin, int64_t end) {
      const size_t n = static_cast<size_t>(end - begin);
      chunk.loss +=
          matter_loss({chunk.data(tape.density) + begin, n}, {chunk.data(tape.delta) + begin, n},
                      static_cast<Real>(weight) * scale_of(c, r), {gradient + begin, n});
    };
    const int64_t first = chunk.ray_begin[r], last = chunk.ray_begin[r + 1];
    const auto at = [&](Real place) {
      return std::lower_bound(middles + first, middles + last, place) - middles;
    };
    const int64_t matter = at(batch.matter_begin[ray]), behind = at(batch.matter_end[ray]);
    clear(first, matter);
    clear(behind, last);
  }
}

}  // namespace nerf
