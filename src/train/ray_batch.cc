#include "train/ray_batch.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <span>

#include "nerf/kernels/roulette.h"
#include "nerf/parts/losses.h"

namespace nerf {

RayBatch::RayBatch(int max) : max_chunks(max) {
  const size_t n = static_cast<size_t>(max) * kChunkSamples;
  for (auto* a : {&x, &y, &z, &delta, &middle, &width, &cell_width}) *a = AlignedArray<Real>(n);
  cell = AlignedArray<int32_t>(n);
  samples.resize(static_cast<size_t>(max));
  rays.resize(static_cast<size_t>(max));
  ray_begin.resize(static_cast<size_t>(max) * (kChunkRays + 1));
  const size_t r = static_cast<size_t>(max) * 3 * kChunkRays;
  direction = AlignedArray<Real>(r);
  background = AlignedArray<Real>(r);
  target = AlignedArray<Real>(r);
  weight.resize(static_cast<size_t>(max) * kChunkRays);
  depth.resize(weight.size());
  photo.resize(weight.size());
  time.resize(weight.size());
  corner.resize(weight.size());
  cover.resize(weight.size());
  matter_begin.resize(weight.size());
  matter_end.resize(weight.size());
  tile.resize(weight.size());
}

void RayBatch::keep_points(int chunk, const int32_t* kept, int64_t count) {
  const size_t first = static_cast<size_t>(chunk) * kChunkSamples;
  for (auto* a : {&x, &y, &z}) keep_columns(1, kept, count, a->data() + first, kChunkSamples);
  if (!lines) return;
  keep_columns(1, kept, count, lines->distance.data() + first, kChunkSamples);
  const int32_t* const begin = ray_begin.data() + static_cast<size_t>(chunk) * (kChunkRays + 1);
  int32_t ray = 0;
  for (int64_t i = 0; i < count; ++i) {
    while (kept[i] >= begin[ray + 1]) ++ray;
    lines->ray[first + static_cast<size_t>(i)] = ray;
  }
}

void RayBatch::keep_lines() {
  lines = std::make_unique<RayLines>();
  lines->distance = AlignedArray<Real>(x.size());
  lines->ray.resize(x.size());
  lines->source.resize(weight.size());
  lines->share.resize(weight.size());
}

RayBatchMaker::RayBatchMaker(const PixelSource& source, const GridField& field, bool intervals,
                             ThreadPool& pool)
    : source_(source), field_(field), intervals_(intervals), pool_(pool) {
  for (int i = 0; i < pool.size(); ++i)
    samplers_.emplace_back(field.occupancy, field.sampler(), field.clip);
  scratch_.resize(static_cast<size_t>(pool.size()));
  randoms_.resize(scratch_.size());
}

void RayBatchMaker::draw_block(uint64_t seed, int64_t step, int64_t index, int64_t rays,
                               std::span<const Ray> given, int thread) {
  constexpr Real kUncachedShare = 1.0_r / 16;  // of rays, which ignore the cached density
  Block& block = blocks_[static_cast<size_t>(index)];
  for (auto* v : {&block.x, &block.y, &block.z, &block.delta, &block.middle, &block.width,
                  &block.cell_width, &block.distance})
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
  if (given.empty()) {
    for (size_t i = 0; i < n; ++i) found[i] = source_.locate(randoms[i], pixels[i]);
    // One after the other, so that the processor waits for several photos' memory at a time.
    for (size_t i = 0; i < n; ++i) found[i] = found[i] && source_.read(pixels[i]);
  } else {
    for (size_t i = 0; i < n; ++i) {
      pixels[i].ray = given[static_cast<size_t>(index * kBlock) + i];
      found[i] = true;
    }
  }
  for (int i = 0; i < kBlock; ++i) {
    RayRecord& record = block.rays[i];
    record = RayRecord();
    if (!found[i]) continue;
    Random& random = randoms[static_cast<size_t>(i)];
    PixelSource::Pixel& pixel = pixels[i];
    record.valid = true;
    if (given.empty() && !pixel.masked) {
      record.source = static_cast<int32_t>(pixel.source);
      record.share = line_share(*pixel.camera, pixel.centre());
    }
    record.weight = pixel.weight;
    record.photo = pixel.ray.photo;
    record.time = pixel.ray.time;
    if (field_.books.falloff.out > 0 && pixel.camera)
      record.corner = static_cast<Real>(corner_square(*pixel.camera, pixel.centre()));
    if (robust_ && given.empty() && !pixel.masked)
      record.tile = robust_->tile_of(pixel.source, pixel.x, pixel.y);
    if (skylines_ && given.empty() && !pixel.masked) {
      const auto matter = skylines_->matter(pixel.source, pixel.ray.direction);
      const auto place = [](double d) { return inverse_place(static_cast<Real>(d)); };
      record.matter_begin = matter ? place(matter->near) : 1;
      record.matter_end = matter ? place(matter->far) : 1;
    }
    record.cover = field_.has_sky() && !pixel.masked && !pixel.ray.ends ? 1 : 0;
    record.depth = inverse_place(static_cast<Real>(pixel.distance));
    for (int k = 0; k < 3; ++k) {
      // A background that is never the same twice leaves no way to paint it with matter.
      record.background[k] = given.empty() ? random.uniform() : pixel.ray.background[k];
      if (background_) record.background[k] = (*background_)[k];
      if (record.cover > 0) record.background[k] = 0;
      record.direction[k] = static_cast<Real>(pixel.ray.direction[k]);
      record.target[k] = pixel.rgb[k] * pixel.alpha + record.background[k] * (1 - pixel.alpha);
      const Real e = record.background[k] - record.target[k];
      record.squared_error += e * e;
    }
    if (lists_) record.line = pixel.ray;
    const bool follow_cache = random.uniform() >= kUncachedShare;
    record.block_begin = static_cast<int>(block.delta.size());
    record.count = sampler.sample(pixel.ray, &random, follow_cache, samples);
    place_samples(sampler.entry(), pixel.ray.direction.cast<Real>(),
                  static_cast<Real>(sampler.start()), samples, block);
  }
}

void RayBatchMaker::place_samples(const Vec3& entry, const Vec3& direction, Real start,
                                  const RaySamples& samples, Block& block) {
  const size_t first = block.delta.size(), end = first + samples.t.size();
  for (auto* v : {&block.x, &block.y, &block.z, &block.cell_width}) v->resize(end);
  block.delta.insert(block.delta.end(), samples.delta.begin(), samples.delta.end());
  block.cell.resize(end);
  if (intervals_)
    for (auto* v : {&block.middle, &block.width}) v->resize(end);
  if (lines_)
    for (const Real t : samples.t) block.distance.push_back(start + t);
  nerf::place_samples(field_, entry, direction, samples.t.data(), static_cast<int64_t>(end - first),
                      block.x.data() + first, block.y.data() + first, block.z.data() + first);
  const OccupancyGrid& grid = field_.occupancy;
  for (size_t s = first; s < end; ++s) {
    const Real t = samples.t[s - first];
    if (intervals_) {
      const Real inverse = 1 / (1 + (start + t));
      block.middle[s] = inverse_place(start + t);
      block.width[s] = samples.delta[s - first] * inverse * inverse;
    }
    const Vec3 p = entry + direction * t;
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
    copy(block.x, batch.x);
    copy(block.y, batch.y);
    copy(block.z, batch.z);
    if (intervals_) {
      copy(block.middle, batch.middle);
      copy(block.width, batch.width);
    }
    if (lines_) {
      copy(block.distance, batch.lines->distance);
      batch.lines->source[static_cast<size_t>(r.chunk * kChunkRays + r.ray)] = r.source;
      batch.lines->share[static_cast<size_t>(r.chunk * kChunkRays + r.ray)] = r.share;
    }
    copy(block.delta, batch.delta);
    copy(block.cell, batch.cell);
    copy(block.cell_width, batch.cell_width);
    batch.weight[static_cast<size_t>(r.chunk * kChunkRays + r.ray)] = r.weight;
    batch.depth[static_cast<size_t>(r.chunk * kChunkRays + r.ray)] = r.depth;
    batch.photo[static_cast<size_t>(r.chunk * kChunkRays + r.ray)] = r.photo;
    batch.time[static_cast<size_t>(r.chunk * kChunkRays + r.ray)] = r.time;
    batch.corner[static_cast<size_t>(r.chunk * kChunkRays + r.ray)] = r.corner;
    batch.tile[static_cast<size_t>(r.chunk * kChunkRays + r.ray)] = r.tile;
    batch.cover[static_cast<size_t>(r.chunk * kChunkRays + r.ray)] = r.cover;
    batch.matter_begin[static_cast<size_t>(r.chunk * kChunkRays + r.ray)] = r.matter_begin;
    batch.matter_end[static_cast<size_t>(r.chunk * kChunkRays + r.ray)] = r.matter_end;
    for (int k = 0; k < 3; ++k) {
      batch.direction_of(r.chunk)[k * kChunkRays + r.ray] = r.direction[k];
      batch.background_of(r.chunk)[k * kChunkRays + r.ray] = r.background[k];
      batch.target_of(r.chunk)[k * kChunkRays + r.ray] = r.target[k];
    }
  }
}

RayBatch::Listed RayBatchMaker::listed_of(const RayRecord& record) {
  RayBatch::Listed listed{record.line, {}, record.weight, -1};
  for (int k = 0; k < 3; ++k) {
    listed.ray.background[k] = record.background[k];
    listed.target[k] = record.target[k];
  }
  return listed;
}

void RayBatchMaker::fill(uint64_t seed, int64_t step, int64_t rays, Real samples_per_cell,
                         std::span<const Ray> given, RayBatch& batch) {
  for (RaySampler& sampler : samplers_) sampler.set_samples_per_cell(samples_per_cell);
  lists_ = batch.lists;
  lines_ = batch.lines != nullptr;
  const int64_t blocks = (rays + kBlock - 1) / kBlock;
  if (static_cast<int64_t>(blocks_.size()) < blocks) blocks_.resize(static_cast<size_t>(blocks));
  pool_.parallel_for_thread(
      blocks, [&](int64_t b, int thread) { draw_block(seed, step, b, rays, given, thread); });

  // Whole rays into chunks, in order, until the batch is full.
  batch.chunks = 1;
  batch.rays_considered = batch.rays_masked = batch.total_samples = 0;
  batch.empty_squared_error = 0;
  batch.listed.clear();
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
      // A sky learns from rays that meet no matter as well.
      const bool kept = r.count > 0 || field_.has_sky();
      if (kept && (samples + r.count > kChunkSamples || count == kChunkRays)) {
        if (batch.chunks == batch.max_chunks) {
          full = true;
          break;
        }
        close();
        ++batch.chunks;
        samples = count = 0;
      }
      ++batch.rays_considered;
      const bool masked = given.empty() && r.photo < 0;
      batch.rays_masked += masked;
      if (batch.lists) batch.listed.push_back(listed_of(r));
      if (!kept) {
        if (!masked) batch.empty_squared_error += static_cast<double>(r.squared_error);
        continue;
      }
      r.chunk = batch.chunks - 1;
      r.ray = count;
      r.offset = samples;
      if (batch.lists) batch.listed.back().place = r.chunk * kChunkRays + r.ray;
      begin_of(r.chunk)[count] = samples;
      ++count;
      samples += r.count;
      batch.total_samples += r.count;
    }
  close();
  pool_.parallel_for(blocks,
                     [&](int64_t b) { copy_block(blocks_[static_cast<size_t>(b)], batch); });
  for (int c = 0; c < batch.chunks; ++c) {
    const size_t at = static_cast<size_t>(c) * kChunkSamples;
    const size_t used = static_cast<size_t>(batch.samples[static_cast<size_t>(c)]);
    const size_t padded = static_cast<size_t>(round_up(static_cast<int64_t>(used), kLane));
    for (size_t s = at + used; s < at + padded; ++s) {
      batch.delta[s] = 0;
      batch.x[s] = batch.y[s] = batch.z[s] = 0.5_r;
    }
  }
}

}  // namespace nerf
