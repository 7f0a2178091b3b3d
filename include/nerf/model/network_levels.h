// A few rays through all levels of a network field: samples, networks, pixels, and back.
#pragma once

#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "nerf/base/real.h"
#include "nerf/math/random.h"
#include "nerf/math/vec.h"
#include "nerf/model/moments.h"
#include "nerf/model/network_field.h"
#include "nerf/model/network_ray.h"
#include "nerf/parts/interval_sampler.h"

namespace nerf {

namespace internal {
class MatterCells;
class MatterMemory;
}  // namespace internal

struct NetworkLosses {
  Real coarse = 1;      // of the colour error of the levels before the last
  Real interlevel = 0;  // of the proposals' (Barron et al. 2022, equation 13), for a mean over
                        // rays and samples
  Real distortion = 0;  // of the last level's (equation 15), for a mean over rays
  PixelLoss pixel;
  Real density_noise = 0;  // standard deviation of what is added to the raw density
  // Share of a ray's light below which a sample is negligible in a training that skips. Of a
  // softplus's samples it is the weight w: with the optical thickness x the pixel's derivative by
  // the raw density is at most w x / (e^x - 1) <= w times a difference of colours, and w by the
  // sample's colour; depth_loss()'s is at most w times a difference of places, below 1. Of a
  // ReLU's, whose derivative does not fall with the density, it is the light that reaches the
  // sample.
  Real negligible = 0;
  // Of networks with transient matter, of the last level: NetworkTape::Losses.
  Real least_deviation = 0.03_r, transient_density = 0;
  // Of the first level of a scene that moves (Park et al. 2021, section 3.3): how far its warp is
  // from motions of rigid parts, for a mean over rays of the sum over samples.
  bool elastic = false;
  // Of levels that learn colours: depth_loss() of rays whose depth is known, for a mean over rays.
  bool depth = false;
};

class NetworkLevels {
 public:
  // For `rays` rays at a time.
  NetworkLevels(const NetworkField& field, int rays, bool training, const NetworkLosses& losses);
  NetworkLevels(const NetworkField& field, int rays) : NetworkLevels(field, rays, false, {}) {}

  // Pictures only: samples whose position cannot hold matter are not asked for. Null: all are.
  // Must outlive this.
  void skip_empty(const internal::MatterCells* occupancy) { occupancy_ = occupancy; }

  // Training only: samples in cells that the memory calls empty are not asked for, and those that
  // are needed are marked in it. Null: all are asked for. Must outlive this.
  void skip_empty(internal::MatterMemory* memory);

  // Pictures only: every ray ends where NetworkRay::drawn_to says and begins at drawn_from. Without
  // NetworkOptions::opaque_end, which would be the end of what is cut off.
  void cut_rays() { cut_ = true; }

  // Pictures only: the light that colours are in (Appearance::code); without it the field's
  // default.
  void use_code(std::vector<Real> code) { code_ = std::move(code); }

  // Training with NetworkLosses::elastic: its weight from the next forward() on.
  void weigh_elastic(Real weight) { elastic_weight_ = weight; }

  // Training with NetworkLosses::depth: its weight from the next forward() on.
  void weigh_depth(Real weight) { depth_weight_ = weight; }

  // The networks' products from these packs, which must outlive this.
  void use_packs(const LayerPacks* packs);

  // How many samples of networks of that width a chunk holds at most, and how many rays those are.
  static int chunk_samples(int width);
  static int rays_per_chunk(const NetworkOptions& options);

  // At most as many rays as the constructor was told; they must stay until backward() is done.
  // exponent: what weights are raised to before they are drawn from (kProposal). Training draws
  // every position from the ray's random numbers.
  void forward(std::span<NetworkRay> rays, Real exponent) { forward(rays, exponent, false); }

  // Training with `skip`: where a ReLU leaves no density a sample has no light and no gradient, so
  // that densities are found first and everything else is computed for the other samples only. The
  // same values, unless NetworkLosses::negligible leaves out more; it pays where less than
  // kSkipPays of all samples are needed.
  void forward(std::span<NetworkRay> rays, Real exponent, bool skip);
  // Of any level. Proposals whose weights must rise where the last level's do leave out only what a
  // ReLU does; a level with transient matter leaves out nothing.
  bool can_skip() const;
  // Samples of the last forward() that are needed (in a picture: that were asked for), and all of
  // them. In training of the levels that can skip, and of what was asked for.
  int64_t dense_samples() const { return dense_; }
  int64_t all_samples() const { return all_; }
  // Samples of any level that were not asked for.
  int64_t unasked_samples() const { return unasked_; }
  // Whose colours the last forward() computed for the picture.
  int64_t coloured_samples() const { return levels_.back()->chunk.samples; }
  // One more evaluation of all against three of the dense.
  static constexpr double kSkipPays = 0.6;

  // Renderings of a forward(): those of the levels that learn colours, the picture's last.
  int renderings() const;
  // Colour and opacity of a ray's pixel in one of them.
  void rendered(int rendering, int ray, Real rgba[4]) const;
  // With PixelLoss::kGiven, before backward(): the gradient of the loss by these.
  void set_gradient(int rendering, int ray, const Real rgba[4]);

  // Adds the gradients of the rays' losses to `weight_gradient` (laid out as field.weights) and
  // returns the loss.
  double backward(Real* weight_gradient);

  // What one with these options would allocate.
  static uint64_t memory_bytes(const NetworkOptions& options, int rays, bool training,
                               const NetworkLosses& losses);
  int levels() const { return static_cast<int>(levels_.size()); }
  int samples(int level) const { return sampler_.samples(level); }
  // Of the last forward(): colour (over the background) and opacity of a ray's pixel.
  void pixel(int ray, Real rgb[3], Real& opacity) const;
  // Colours of the samples of a ray's picture, [samples][3]; 0 where they were not asked for.
  void colours(int ray, std::vector<Real>& rgb) const;
  // Weights and distances of a ray's samples, and the distances of its posts.
  std::span<const Real> weights(int level, int ray) const;
  std::span<const Real> posts(int level, int ray) const;  // entries, see IntervalSampler
  const IntervalSampler& sampler() const { return sampler_; }
  // What a level's network was given by the last forward(), and all that it computed.
  const NetworkTape& tape(int level) const { return levels_[static_cast<size_t>(level)]->tape; }
  const Chunk& chunk(int level) const { return levels_[static_cast<size_t>(level)]->chunk; }
  // Distance up to which half of the light is stopped; below 0 where less than half is.
  Real median_distance(int ray) const;

 private:
  struct Level {
    Level(const NetworkField& field, int level, int samples, int rays, bool training,
          const NetworkTape::Losses& losses)
        : tape(field.options, field.network_of(level), samples * rays, rays,
               training ? NetworkTape::Purpose::kTrain : NetworkTape::Purpose::kRender, losses),
          chunk(tape.tape) {}
    NetworkTape tape;
    Chunk chunk;
    std::vector<int32_t> ray_begin;      // of all samples
    std::vector<Real> posts;             // entries of all rays
    std::unique_ptr<NetworkTape> probe;  // finds the densities of all samples, can_skip() only
    std::unique_ptr<Chunk> probe_chunk;
    std::vector<int32_t> dense_begin;   // of those that have density
    std::vector<int32_t> packed_begin;  // of those that were asked for
    std::vector<int> asked;             // columns of those that were asked for, if not of all
    std::vector<int> kept;              // columns of those that the tape was given, if not of all
    std::vector<int64_t> cells;         // of those that were asked for, with a memory
    std::vector<Real> all_weights;      // of all samples, where only some were asked for
    bool packed = false;                // only some were asked for by the last forward()
    bool probed = false;                // it asked the probe first
    bool skipped() const { return packed || probed; }
  };

  struct Sample {
    int ray, column;     // of all samples
    Real t0, t1, delta;  // t0 = t1 of a position
  };
  // body(sample) for every sample of the rays, in order.
  template <class Body>
  void each_sample(const Level& level, int samples, const Body& body);
  void place_rays(Level& level);
  void place_samples(const Level& level, int samples, const NetworkTape& tape, Chunk& chunk);
  void place_sample(const NetworkRay& ray, const Sample& sample, int column,
                    const NetworkTape& tape, Chunk& chunk) const;
  void aim(const NetworkRay& ray);
  void normalised_edges(int level, int ray, std::vector<Real>& edges);
  void keep_dense(Level& level);
  void place_packed(Level& level, int samples, const NetworkTape& tape, Chunk& chunk);
  bool asks_for(const NetworkRay& ray, const Sample& sample, const Vec3& at, bool last) const;
  void spread_weights(Level& level, int samples, const NetworkTape& tape, const Chunk& chunk);
  void mark(const Level& level, const NetworkTape& tape, const Chunk& chunk);
  // body(column) for every sample that is needed, end_of_ray(ray) behind each ray.
  template <class Body, class EndOfRay>
  void each_needed(const NetworkTape& tape, const Chunk& chunk, const Body& body,
                   const EndOfRay& end_of_ray) const;
  void count_dense(const NetworkTape& tape, const Chunk& chunk);
  double losses_on_weights(size_t level);
  double depth_loss_of(int level, int ray, Real scale, std::span<Real> d_weights);
  Level& rendering_level(int rendering) const;

  const NetworkField& field_;
  bool training_;
  NetworkLosses losses_;
  IntervalSampler sampler_;
  std::span<const Vec3> axes_;
  std::vector<std::unique_ptr<Level>> levels_;
  std::span<NetworkRay> rays_;
  const internal::MatterCells* occupancy_ = nullptr;
  internal::MatterMemory* memory_ = nullptr;
  bool cut_ = false;
  std::vector<Real> code_;
  Moments moments_;
  Real elastic_weight_ = 0, depth_weight_ = 0;
  int64_t dense_ = 0, all_ = 0, unasked_ = 0;
  std::vector<Real> edges_, final_edges_, middles_, gradient_of_all_;  // of losses on weights
};

}  // namespace nerf
