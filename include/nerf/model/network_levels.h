// A few rays through all levels of a network field: samples, networks, pixels, and back.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "nerf/math/random.h"
#include "nerf/math/vec.h"
#include "nerf/model/network_field.h"
#include "nerf/parts/interval_sampler.h"

namespace nerf {

// Engine coordinates; the direction has unit length, so that t is Euclidean distance.
struct NetworkRay {
  Vec3 origin, direction;
  float radius = 0;  // of the pixel's cone at t = 1: distance to the neighbouring ray, 2 / sqrt(12)
  Vec3 background;
  // Training only.
  Vec3 target;      // colour of the pixel
  float scale = 0;  // of its squared error, summed over channels, in the loss
  Random random{0, 0, 0};
};

struct NetworkLosses {
  float coarse = 1;         // of the colour error of the levels before the last
  float interlevel = 0;     // of the proposals' (Barron et al. 2022, equation 13), for a mean over
                            // rays and samples
  float distortion = 0;     // of the last level's (equation 15), for a mean over rays
  float charbonnier = 0;    // epsilon of the colour loss; 0: squared error
  float density_noise = 0;  // standard deviation of what is added to the raw density
};

class NetworkLevels {
 public:
  // For `rays` rays at a time.
  NetworkLevels(const NetworkField& field, int rays, bool training, const NetworkLosses& losses);
  NetworkLevels(const NetworkField& field, int rays) : NetworkLevels(field, rays, false, {}) {}

  // How many rays a chunk of the cache's size has.
  static int rays_per_chunk(const NetworkField& field);

  // At most as many rays as the constructor was told; they must stay until backward() is done.
  // exponent: what weights are raised to before they are drawn from (kProposal). Training draws
  // every position from the ray's random numbers.
  void forward(std::span<NetworkRay> rays, float exponent);

  // Adds the gradients of the rays' losses to `weight_gradient` (laid out as field.weights) and
  // returns the loss.
  double backward(float* weight_gradient);

  uint64_t arena_bytes() const;
  int levels() const { return static_cast<int>(levels_.size()); }
  int samples(int level) const { return sampler_.samples(level); }
  // Of the last forward(): colour (over the background) and opacity of a ray's pixel.
  void pixel(int ray, float rgb[3], float& opacity) const;
  // Weights and distances of a ray's samples, and the distances of its posts.
  std::span<const float> weights(int level, int ray) const;
  std::span<const float> posts(int level, int ray) const;  // entries, see IntervalSampler
  const IntervalSampler& sampler() const { return sampler_; }
  // Distance up to which half of the light is stopped; below 0 where less than half is.
  float median_distance(int ray) const;

 private:
  struct Level {
    Level(const NetworkField& field, int level, int rays, bool training,
          const NetworkTape::Losses& losses)
        : tape(field, level, rays,
               training ? NetworkTape::Purpose::kTrain : NetworkTape::Purpose::kRender, losses),
          chunk(tape.tape) {}
    NetworkTape tape;
    Chunk chunk;
    std::vector<int32_t> ray_begin;
    std::vector<float> posts;  // entries of all rays
  };

  void place_samples(Level& level, int samples);
  void place_sample(const NetworkRay& ray, float t0, float t1, int column, Level& level);
  double losses_on_weights(size_t level);

  const NetworkField& field_;
  bool training_;
  NetworkLosses losses_;
  IntervalSampler sampler_;
  std::span<const Vec3> axes_;
  std::vector<std::unique_ptr<Level>> levels_;
  std::span<NetworkRay> rays_;
};

}  // namespace nerf
