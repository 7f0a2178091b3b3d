#include "model/coded_rays.h"

#include <algorithm>
#include <numeric>
#include <utility>

#include "model/field_integrator.h"
#include "model/medium_ray.h"
#include "model/sky.h"
#include "nerf/kernels/elementwise.h"
#include "nerf/model/grid_field.h"
#include "nerf/model/integrator.h"
#include "nerf/model/network_levels.h"
#include "nerf/model/radiance_field.h"

namespace nerf::internal {

namespace {

// Integrated anew for every code.
class IntegratedRays final : public CodedRays {
 public:
  IntegratedRays(const RadianceField& field, std::span<const Ray> rays,
                 const RenderOptions& options, ThreadPool& pool, const Cancel* cancel)
      : field_(field), rays_(rays), options_(options), pool_(pool), cancel_(cancel) {
    options_.appearance = {};
  }
  std::vector<Real> pixels(const std::vector<Real>& code) override {
    options_.appearance.code = code;
    return integrate(field_, rays_, {}, options_, pool_, {}, cancel_).rgb;
  }

 private:
  const RadianceField& field_;
  std::span<const Ray> rays_;
  RenderOptions options_;
  ThreadPool& pool_;
  const Cancel* cancel_;
};

// Samples that share a colour are placed once; then only the colour network is asked.
class TableRays final : public CodedRays {
 public:
  TableRays(const RadianceField& field, std::span<const Ray> rays, const RenderOptions& options,
            ThreadPool& pool, const Cancel* cancel)
      : field_(field.grid()),
        rays_(rays),
        pool_(pool),
        cancel_(cancel),
        heads_(static_cast<size_t>(pool.size())),
        blocks_((rays.size() + kRaysOfBlock - 1) / kRaysOfBlock),
        opacity_(rays.size()) {
    pack_layers(field_.layers(), field_.weights.data(), options.precision, packs_, pool);
    RenderOptions any_light = options;
    any_light.appearance = {};
    const auto integrator = make_integrator(field, any_light, pool);
    std::vector<Real> rgb(3 * rays.size());
    pool.parallel_for_thread(static_cast<int64_t>(blocks_.size()), [&](int64_t b, int thread) {
      if (cancel && cancel->requested()) throw Cancelled();
      const size_t begin = static_cast<size_t>(b) * kRaysOfBlock;
      const RaySink sink{.rgb = rgb.data() + 3 * begin,
                         .opacity = opacity_.data() + begin,
                         .shared = &blocks_[static_cast<size_t>(b)]};
      integrator->integrate(rays.subspan(begin, std::min(kRaysOfBlock, rays.size() - begin)), sink,
                            thread);
    });
  }

  std::vector<Real> pixels(const std::vector<Real>& code) override {
    std::vector<Real> rgb;
    for (size_t i = 0; i < rays_.size(); ++i)
      for (int k = 0; k < 3; ++k) rgb.push_back((1 - opacity_[i]) * rays_[i].background[k]);
    const std::vector<Real> numbers = code.empty() ? field_.default_code(0) : code;
    pool_.parallel_for_thread(static_cast<int64_t>(blocks_.size()), [&](int64_t b, int thread) {
      if (cancel_ && cancel_->requested()) throw Cancelled();
      auto& head = heads_[static_cast<size_t>(thread)];
      if (!head) head = std::make_unique<Head>(field_, packs_);
      const size_t first = static_cast<size_t>(b) * kRaysOfBlock;
      const SharedSamples& block = blocks_[static_cast<size_t>(b)];
      for (size_t begin = 0; begin < block.places.size(); begin += kChunkSamples)
        head->add(block, begin, numbers, rays_.subspan(first), rgb.data() + 3 * first);
      if (!block.sky_places.empty())
        head->add_sky(block, numbers, rays_.subspan(first), rgb.data() + 3 * first);
    });
    return rgb;
  }

 private:
  static constexpr size_t kRaysOfBlock = 256;

  struct Head {
    Head(const GridField& field, const LayerPacks& packs)
        : tape(field, GridTape::Purpose::kPictures),
          chunk(tape.tape),
          sample_begin(kChunkRays + 1) {
      if (field.has_sky()) sky.emplace(field, packs);
      chunk.weights = field.weights.data();
      chunk.packs = &packs;
      std::iota(sample_begin.begin(), sample_begin.end(), 0);
    }
    // The light of the block's samples from `begin` on, as many as a chunk has room for. rays, rgb:
    // of the block.
    void add(const SharedSamples& block, size_t begin, const std::vector<Real>& code,
             std::span<const Ray> rays, Real* rgb) {
      const size_t n = std::min(block.places.size() - begin, size_t{kChunkSamples});
      const size_t features = block.geometry.size() / block.places.size();
      chunk.samples = chunk.rays = static_cast<int>(n);  // a ray for each
      chunk.ray_begin = sample_begin.data();
      transpose(static_cast<int64_t>(features), chunk.samples,
                block.geometry.data() + begin * features, static_cast<int64_t>(features),
                chunk.data(tape.geometry), chunk.stride(tape.geometry));
      Real* const directions = chunk.data(tape.directions);
      const size_t stride = static_cast<size_t>(chunk.stride(tape.directions));
      for (size_t i = 0; i < n; ++i) {
        const Vec3d& d = rays[static_cast<size_t>(block.places[begin + i])].direction;
        for (size_t k = 0; k < 3; ++k)
          directions[k * stride + i] = static_cast<Real>(d[static_cast<int>(k)]);
      }
      if (tape.code >= 0) fill_rows(code, chunk.rays, tape.code, chunk);
      tape.forward_colour(chunk);
      const Real* const colour = chunk.data(tape.colour);
      const size_t row = static_cast<size_t>(chunk.stride(tape.colour));
      for (size_t i = 0; i < n; ++i)
        for (size_t k = 0; k < 3; ++k)
          rgb[3 * static_cast<size_t>(block.places[begin + i]) + k] +=
              block.weights[begin + i] * colour[k * row + i];
    }

    void add_sky(const SharedSamples& block, const std::vector<Real>& code,
                 std::span<const Ray> rays, Real* rgb) {
      sky->set_code(code);
      for (size_t i = 0; i < block.sky_places.size(); ++i) {
        const size_t place = static_cast<size_t>(block.sky_places[i]);
        const Real share = block.sky_shares[i];
        sky->add(rays[place].direction.cast<Real>(), {share, share, share}, rgb + 3 * place);
      }
      sky->finish();
    }

    GridTape tape;
    Chunk chunk;
    std::vector<int32_t> sample_begin;
    std::optional<SkyLight> sky;
  };

  const GridField& field_;
  std::span<const Ray> rays_;
  ThreadPool& pool_;
  const Cancel* cancel_;
  LayerPacks packs_;
  std::vector<std::unique_ptr<Head>> heads_;  // of each thread
  std::vector<SharedSamples> blocks_;
  std::vector<Real> opacity_;
};

// What a network's colours depend on besides the code is kept of each sample that gives light.
class NetworkRays final : public CodedRays {
 public:
  NetworkRays(const NetworkField& field, std::span<const Ray> rays, const RenderOptions& options,
              ThreadPool& pool, const Cancel* cancel)
      : field_(field),
        per_block_(NetworkLevels::rays_per_chunk(field.options)),
        rays_(rays),
        pool_(pool),
        cancel_(cancel),
        heads_(static_cast<size_t>(pool.size())),
        blocks_((rays.size() + static_cast<size_t>(per_block_) - 1) /
                static_cast<size_t>(per_block_)) {
    LayerPacks packs;
    pack_layers(field.layers(), field.weights.data(), options.precision, packs, pool);
    std::vector<std::unique_ptr<NetworkLevels>> levels(static_cast<size_t>(pool.size()));
    pool.parallel_for_thread(static_cast<int64_t>(blocks_.size()), [&](int64_t b, int thread) {
      if (cancel && cancel->requested()) throw Cancelled();
      auto& own = levels[static_cast<size_t>(thread)];
      if (!own) {
        own = std::make_unique<NetworkLevels>(field, per_block_);
        own->use_packs(&packs);
      }
      look(static_cast<size_t>(b), *own);
    });
  }

  std::vector<Real> pixels(const std::vector<Real>& code) override {
    std::vector<Real> rgb;
    for (const Ray& ray : rays_)
      for (int k = 0; k < 3; ++k) rgb.push_back(ray.background[k]);
    pool_.parallel_for_thread(static_cast<int64_t>(blocks_.size()), [&](int64_t b, int thread) {
      if (cancel_ && cancel_->requested()) throw Cancelled();
      auto& head = heads_[static_cast<size_t>(thread)];
      if (!head) head = std::make_unique<Head>(field_, most_samples_of_block(), per_block_);
      const Block& block = blocks_[static_cast<size_t>(b)];
      head->colour(block, code);
      for (size_t r = 0; r < block.places.size(); ++r)
        for (size_t k = 0; k < 3; ++k) rgb[3 * block.places[r] + k] = head->pixel(r, k);
    });
    return rgb;
  }

 private:
  // Less of a pixel's light is left to the samples that have more.
  static constexpr Real kLeastLight = 1.0_r / 512;

  struct Block {
    std::vector<size_t> places;      // of its rays among all
    std::vector<int32_t> ray_begin;  // of its samples
    std::vector<Real> features;      // [bottleneck][samples]
    std::vector<Real> light;         // [samples]
    std::vector<Vec3> directions, backgrounds;
  };

  // The part of the network behind the features, on a tape of its own.
  struct Head {
    Head(const NetworkField& field, int samples, int rays)
        : tape(samples, rays),
          features(tape.input(field.options.bottleneck, Domain::kSamples)),
          light(tape.input(1, Domain::kSamples)),
          directions(tape.input(3, Domain::kRays)),
          background(tape.input(3, Domain::kRays)),
          code(tape.input(field.options.light(), Domain::kRays)) {
      const Value colour =
          record_colour(tape, field.options, field.networks.back(), features, directions, code);
      out = accumulate(tape, light, colour, background);
      tape.plan();
      chunk = std::make_unique<Chunk>(tape);
      chunk->weights = field.weights.data();
    }
    void colour(const Block& b, const std::vector<Real>& numbers) {
      Chunk& c = *chunk;
      const size_t n = b.light.size();
      c.samples = static_cast<int>(n);
      c.rays = static_cast<int>(b.places.size());
      c.ray_begin = b.ray_begin.data();
      for (int row = 0; row < tape.rows(features); ++row)
        std::copy_n(b.features.data() + static_cast<size_t>(row) * n, n,
                    c.data(features) + row * c.stride(features));
      std::ranges::copy(b.light, c.data(light));
      const int64_t lr = c.stride(directions);
      for (int r = 0; r < c.rays; ++r)
        for (int k = 0; k < 3; ++k) {
          c.data(directions)[k * lr + r] = b.directions[static_cast<size_t>(r)][k];
          c.data(background)[k * lr + r] = b.backgrounds[static_cast<size_t>(r)][k];
        }
      fill_rows(numbers, c.rays, code, c);
      tape.forward(c);
    }
    Real pixel(size_t ray, size_t k) const {
      const Chunk& c = *chunk;
      const size_t at = k * static_cast<size_t>(c.stride(out)) + ray;
      return std::clamp(c.data(out)[at], 0.0_r, 1.0_r);
    }

    Tape tape;
    Value features, light, directions, background, code, out = 0;
    std::unique_ptr<Chunk> chunk;
  };

  int most_samples_of_block() const {
    const IntervalOptions& sampling = field_.options.sampling;
    return per_block_ * sampling.samples(sampling.levels() - 1);
  }

  void look(size_t index, NetworkLevels& levels) {
    Block& b = blocks_[index];
    std::vector<NetworkRay> part;
    const size_t begin = index * static_cast<size_t>(per_block_);
    const size_t end = std::min(rays_.size(), begin + static_cast<size_t>(per_block_));
    for (size_t i = begin; i < end; ++i) {
      const auto ray = sampled_ray(field_, rays_[i]);
      if (!ray) continue;
      part.push_back(*ray);
      b.places.push_back(i);
      b.directions.push_back(ray->view);
      b.backgrounds.push_back(ray->background);
    }
    b.ray_begin.assign(part.size() + 1, 0);
    if (part.empty()) return;
    levels.forward(part, 1);
    const int last = levels.levels() - 1;
    std::vector<int> kept;
    for (size_t r = 0; r < part.size(); ++r) {
      const auto weights = levels.weights(last, static_cast<int>(r));
      Real all = 0, of_kept = 0;
      const size_t first = kept.size();
      for (size_t i = 0; i < weights.size(); ++i) {
        all += weights[i];
        if (weights[i] < kLeastLight) continue;
        of_kept += weights[i];
        kept.push_back(static_cast<int>(r * weights.size() + i));
        b.light.push_back(weights[i]);
      }
      for (size_t i = first; i < kept.size(); ++i) b.light[i] *= all / of_kept;
      b.ray_begin[r + 1] = static_cast<int32_t>(kept.size());
    }
    const Chunk& c = levels.chunk(last);
    const Value features = levels.tape(last).features;
    for (int row = 0; row < levels.tape(last).tape.rows(features); ++row)
      for (const int column : kept)
        b.features.push_back(c.data(features)[row * c.stride(features) + column]);
  }

  const NetworkField& field_;
  int per_block_;
  std::span<const Ray> rays_;
  ThreadPool& pool_;
  const Cancel* cancel_;
  std::vector<std::unique_ptr<Head>> heads_;  // of each thread
  std::vector<Block> blocks_;
};

}  // namespace

std::unique_ptr<CodedRays> coded_rays(const RadianceField& field, std::span<const Ray> rays,
                                      const RenderOptions& options, ThreadPool& pool,
                                      const Cancel* cancel) {
  if (field.is_grid() && !engine_medium(field, options))
    return std::make_unique<TableRays>(field, rays, options, pool, cancel);
  if (field.is_grid() || field.network().options.light() == 0 || options.bbox || options.medium)
    return std::make_unique<IntegratedRays>(field, rays, options, pool, cancel);
  return std::make_unique<NetworkRays>(field.network(), rays, options, pool, cancel);
}

}  // namespace nerf::internal
