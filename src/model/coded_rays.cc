#include "model/coded_rays.h"

#include <algorithm>
#include <utility>

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
  if (field.is_grid() || field.network().options.light() == 0 || options.bbox || options.medium)
    return std::make_unique<IntegratedRays>(field, rays, options, pool, cancel);
  return std::make_unique<NetworkRays>(field.network(), rays, options, pool, cancel);
}

}  // namespace nerf::internal
