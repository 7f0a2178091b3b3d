#include "train/ray_batch.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <span>

#include "nerf/kernels/roulette.h"

namespace nerf {

namespace {

// Of a distance, engine units, in [0, 1): see RayBatch::middle.
Real inverse_place(Real distance) { return 1 - 1 / (1 + distance); }

}  // namespace

RayBatch::RayBatch(int max, int points_per_sample) : max_chunks(max), points(points_per_sample) {
  const size_t n = static_cast<size_t>(max) * kChunkSamples;
  for (auto* a : {&x, &y, &z, &spread}) *a = AlignedArray<Real>(n * static_cast<size_t>(points));
  delta = AlignedArray<Real>(n);
  middle = AlignedArray<Real>(n);
  width = AlignedArray<Real>(n);
  cell = AlignedArray<int32_t>(n);
  cell_width = AlignedArray<Real>(n);
  samples.resize(static_cast<size_t>(max));
  rays.resize(static_cast<size_t>(max));
  ray_begin.resize(static_cast<size_t>(max) * (kChunkRays + 1));
  const size_t r = static_cast<size_t>(max) * 3 * kChunkRays;
  direction = AlignedArray<Real>(r);
  background = AlignedArray<Real>(r);
  target = AlignedArray<Real>(r);
  tile.resize(static_cast<size_t>(max) * kChunkRays);
  weight.resize(tile.size());
  depth.resize(tile.size());
}

void RayBatch::keep_points(int chunk, const int32_t* kept, int64_t count) {
  const size_t first = static_cast<size_t>(chunk) * static_cast<size_t>(points) * kChunkSamples;
  for (auto* a : {&x, &y, &z, &spread})
    keep_columns(points, kept, count, a->data() + first, kChunkSamples);
}

RayBatchMaker::RayBatchMaker(const PixelSource& source, const ErrorMap& errors,
                             const GridField& field, bool intervals, ThreadPool& pool)
    : source_(source), errors_(errors), field_(field), intervals_(intervals), pool_(pool) {
  for (int i = 0; i < pool.size(); ++i)
    samplers_.emplace_back(field.occupancy, field.options.sampler, field.clip);
  scratch_.resize(static_cast<size_t>(pool.size()));
  randoms_.resize(scratch_.size());
}

void RayBatchMaker::draw_block(uint64_t seed, int64_t step, int64_t index, int64_t rays,
                               int pixel_block, int thread) {
  constexpr Real kUncachedShare = 1.0_r / 16;  // of rays, which ignore the cached density
  Block& block = blocks_[static_cast<size_t>(index)];
  for (auto* v : {&block.x, &block.y, &block.z, &block.spread, &block.delta, &block.middle,
                  &block.width, &block.cell_width})
    v->clear();
  block.cell.clear();
  RaySampler& sampler = samplers_[static_cast<size_t>(thread)];
  RaySamples& samples = scratch_[static_cast<size_t>(thread)];
  const int drawn = static_cast<int>(std::min<int64_t>(kBlock, rays - index * kBlock));
  std::vector<Random>& randoms = randoms_[static_cast<size_t>(thread)];
  randoms.clear();
  for (int i = 0; i < drawn; ++i)
    randoms.emplace_back(seed, static_cast<uint64_t>(step),
                         static_cast<uint64_t>(index * kBlock + i));
  PixelSource::Pixel pixels[kBlock];
  bool found[kBlock] = {};
  const size_t n = static_cast<size_t>(drawn);
  source_.locate(randoms, &errors_, std::span(pixels, n), std::span(found, n), pixel_block);
  // One after the other, so that the processor waits for several photos' memory at a time.
  for (size_t i = 0; i < n; ++i) found[i] = found[i] && source_.read(pixels[i]);
  for (int i = 0; i < kBlock; ++i) {
    RayRecord& record = block.rays[i];
    record = RayRecord();
    if (!found[i]) continue;
    Random& random = randoms[static_cast<size_t>(i)];
    const PixelSource::Pixel& pixel = pixels[i];
    record.valid = true;
    record.tile = pixel.tile;
    record.weight = pixel.weight;
    record.depth = inverse_place(static_cast<Real>(pixel.distance));
    for (int k = 0; k < 3; ++k) {
      // A background that is never the same twice leaves no way to paint it with matter.
      record.background[k] = random.uniform();
      record.direction[k] = static_cast<Real>(pixel.ray.direction[k]);
      record.target[k] = pixel.rgb[k] * pixel.alpha + record.background[k] * (1 - pixel.alpha);
      const Real e = record.background[k] - record.target[k];
      record.squared_error += e * e;
    }
    const bool follow_cache = random.uniform() >= kUncachedShare;
    record.block_begin = static_cast<int>(block.delta.size());
    record.count = sampler.sample(pixel.ray, &random, follow_cache, samples);
    ConeSample sample{sampler.entry(), pixel.ray.direction.cast<Real>()};
    if (field_.options.sees_cones())
      sample.radius =
          static_cast<Real>(pixel.width * pixel_cone_radius(*pixel.camera, pixel.centre()));
    place_samples(sample, static_cast<Real>(sampler.start()), samples, random, block);
  }
}

void RayBatchMaker::place_samples(ConeSample& sample, Real start, const RaySamples& samples,
                                  Random& random, Block& block) {
  const size_t points = static_cast<size_t>(field_.options.cone_points);
  const size_t first = block.delta.size(), end = first + samples.t.size();
  for (auto* v : {&block.x, &block.y, &block.z}) v->resize(points * end);
  if (field_.options.antialias) block.spread.resize(points * end);
  block.delta.insert(block.delta.end(), samples.delta.begin(), samples.delta.end());
  block.cell.resize(end);
  block.cell_width.resize(end);
  if (intervals_)
    for (auto* v : {&block.middle, &block.width}) v->resize(end);
  if (!field_.options.sees_cones())
    nerf::place_samples(field_, sample.entry, sample.direction, samples.t.data(),
                        static_cast<int64_t>(end - first), block.x.data() + first,
                        block.y.data() + first, block.z.data() + first);
  const OccupancyGrid& grid = field_.occupancy;
  for (size_t s = first; s < end; ++s) {
    sample.t = samples.t[s - first];
    sample.delta = samples.delta[s - first];
    sample.distance = start + sample.t;
    if (field_.options.cone_points > 1) {
      const Real turn = 2 * std::numbers::pi_v<Real> * random.uniform();
      sample.cosine = std::cos(turn);
      sample.sine = std::sin(turn);
      sample.reversed = random.uniform() < 0.5_r;
    }
    if (field_.options.sees_cones()) {
      const size_t at = s * points;
      place_points(field_, sample, 1, block.x.data() + at, block.y.data() + at, block.z.data() + at,
                   field_.options.antialias ? block.spread.data() + at : nullptr);
    }
    if (intervals_) {
      const Real inverse = 1 / (1 + sample.distance);
      block.middle[s] = inverse_place(sample.distance);
      block.width[s] = sample.delta * inverse * inverse;
    }
    const Vec3 p = sample.entry + sample.direction * sample.t;
    const int cascade = std::min(grid.cascade_of(p), grid.cascades() - 1);
    block.cell[s] = static_cast<int32_t>(cascade * grid.cells() + grid.cell_of(p, cascade));
    block.cell_width[s] = grid.cell_width(cascade);
  }
}

void RayBatchMaker::copy_block(Block& block, RayBatch& batch) {
  for (const RayRecord& r : block.rays) {
    if (r.chunk < 0) continue;
    const size_t to = static_cast<size_t>(r.chunk) * kChunkSamples + static_cast<size_t>(r.offset);
    const auto copy = [&](const auto& from, auto& array) {
      std::copy_n(from.begin() + r.block_begin, r.count, array.begin() + to);
    };
    // From the points of a sample side by side to those of a chunk's samples.
    const size_t points = static_cast<size_t>(batch.points);
    const size_t first = static_cast<size_t>(r.chunk) * points * kChunkSamples;
    const auto copy_points = [&](const auto& from, auto& array) {
      for (size_t j = 0; j < points; ++j)
        for (size_t s = 0; s < static_cast<size_t>(r.count); ++s)
          array[first + j * kChunkSamples + static_cast<size_t>(r.offset) + s] =
              from[(static_cast<size_t>(r.block_begin) + s) * points + j];
    };
    copy_points(block.x, batch.x);
    copy_points(block.y, batch.y);
    copy_points(block.z, batch.z);
    if (field_.options.antialias) copy_points(block.spread, batch.spread);
    if (intervals_) {
      copy(block.middle, batch.middle);
      copy(block.width, batch.width);
    }
    copy(block.delta, batch.delta);
    copy(block.cell, batch.cell);
    copy(block.cell_width, batch.cell_width);
    batch.tile[static_cast<size_t>(r.chunk * kChunkRays + r.ray)] = r.tile;
    batch.weight[static_cast<size_t>(r.chunk * kChunkRays + r.ray)] = r.weight;
    batch.depth[static_cast<size_t>(r.chunk * kChunkRays + r.ray)] = r.depth;
    for (int k = 0; k < 3; ++k) {
      batch.direction_of(r.chunk)[k * kChunkRays + r.ray] = r.direction[k];
      batch.background_of(r.chunk)[k * kChunkRays + r.ray] = r.background[k];
      batch.target_of(r.chunk)[k * kChunkRays + r.ray] = r.target[k];
    }
  }
}

void RayBatchMaker::fill(uint64_t seed, int64_t step, int64_t rays, Real samples_per_cell,
                         int pixel_block, RayBatch& batch) {
  for (RaySampler& sampler : samplers_) sampler.set_samples_per_cell(samples_per_cell);
  const int64_t blocks = (rays + kBlock - 1) / kBlock;
  if (static_cast<int64_t>(blocks_.size()) < blocks) blocks_.resize(static_cast<size_t>(blocks));
  pool_.parallel_for_thread(
      blocks, [&](int64_t b, int thread) { draw_block(seed, step, b, rays, pixel_block, thread); });

  // Whole rays into chunks, in order, until the batch is full.
  batch.chunks = 1;
  batch.rays_considered = batch.total_samples = 0;
  batch.empty_rays.clear();
  int samples = 0, count = 0;
  const auto begin_of = [&](int chunk) {
    return batch.ray_begin.data() + static_cast<size_t>(chunk) * (kChunkRays + 1);
  };
  const auto close = [&] {
    const size_t c = static_cast<size_t>(batch.chunks - 1);
    batch.samples[c] = samples;
    batch.rays[c] = count;
    begin_of(batch.chunks - 1)[count] = samples;
  };
  bool full = false;
  for (int64_t b = 0; b < blocks && !full; ++b)
    for (RayRecord& r : blocks_[static_cast<size_t>(b)].rays) {
      if (!r.valid) continue;
      if (r.count > 0 && (samples + r.count > kChunkSamples || count == kChunkRays)) {
        if (batch.chunks == batch.max_chunks) {
          full = true;
          break;
        }
        close();
        ++batch.chunks;
        samples = count = 0;
      }
      ++batch.rays_considered;
      if (r.count == 0) {
        batch.empty_rays.push_back({r.tile, r.squared_error});
        continue;
      }
      r.chunk = batch.chunks - 1;
      r.ray = count;
      r.offset = samples;
      begin_of(r.chunk)[count] = samples;
      ++count;
      samples += r.count;
      batch.total_samples += r.count;
    }
  close();
  pool_.parallel_for(blocks,
                     [&](int64_t b) { copy_block(blocks_[static_cast<size_t>(b)], batch); });
  double spread = 0;
  for (int c = 0; c < batch.chunks; ++c) {
    const size_t at = static_cast<size_t>(c) * kChunkSamples;
    const size_t used = static_cast<size_t>(batch.samples[static_cast<size_t>(c)]);
    const size_t padded = static_cast<size_t>(round_up(static_cast<int64_t>(used), kLane));
    std::fill(batch.delta.begin() + at + used, batch.delta.begin() + at + padded, 0.0_r);
    for (size_t j = 0; j < static_cast<size_t>(batch.points); ++j) {
      const size_t from = at * static_cast<size_t>(batch.points) + j * kChunkSamples;
      for (size_t s = from + used; s < from + padded; ++s) {
        batch.x[s] = batch.y[s] = batch.z[s] = 0.5_r;
        batch.spread[s] = 0;
      }
      if (field_.options.antialias)
        for (size_t s = from; s < from + used; ++s) spread += static_cast<double>(batch.spread[s]);
    }
  }
  const int64_t points = batch.total_samples * batch.points;
  batch.mean_spread = static_cast<Real>(spread / static_cast<double>(std::max<int64_t>(points, 1)));
}

}  // namespace nerf
