#include "composed_method.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <optional>
#include <span>
#include <vector>

#include "nerf/autodiff/operations.h"
#include "nerf/kernels/adam.h"
#include "nerf/kernels/hash_grid.h"
#include "nerf/math/camera.h"
#include "nerf/math/contraction.h"
#include "nerf/math/random.h"
#include "nerf/math/step_function.h"
#include "nerf/parts/interval_sampler.h"
#include "nerf/parts/losses.h"

namespace {

using nerf::Real;
using nerf::operator""_r;

constexpr int kRays = 128, kProposed = 32, kFine = 16;

struct RayInput {
  nerf::Vec3d origin, direction;
  Real target[3];
  nerf::Random random{0, 0, 0};
};

// position -> contract -> hash grid -> MLP -> density [-> MLP with the view -> colour].
class Field {
 public:
  Field(int samples, int levels, int log2_entries, double finest, bool colour, uint64_t seed)
      : samples_(samples),
        colour_(colour),
        shape_(nerf::hash_grid_shape(levels, log2_entries, 16, finest)),
        tape_(samples * kRays, kRays),
        position_(static_cast<size_t>(3 * samples * kRays)) {
    std::size_t size = 0;
    const auto layers = [&](std::initializer_list<int> widths) {
      std::vector<nerf::LinearWeights> out;
      for (auto w = widths.begin(); w + 1 < widths.end(); ++w) {
        nerf::LinearWeights layer;
        layer.offset = size;
        layer.in = w[0];
        layer.out = w[1];
        size += layer.size();
        out.push_back(layer);
      }
      return out;
    };
    const auto density_layers = layers({shape_.features(), 32, 16});
    const auto colour_layers = layers({16 + 16, 32, 3});
    weights_ = gradient_ = m_ = v_ = nerf::AlignedArray<Real>(size);
    table_ = nerf::AlignedArray<Real>(shape_.size());
    table_gradient_ = nerf::AlignedArray<Real>(shape_.size());
    states_ = nerf::AlignedArray<Real>(nerf::kRowParts * shape_.size());
    marks_ = nerf::AlignedArray<std::uint8_t>(shape_.rows);
    listed_.resize(shape_.rows);
    correction_.resize(2 * nerf::kBiasCorrections);
    nerf::bias_corrections({}, correction_.data());

    nerf::Random random(seed, 0, colour);
    for (Real& x : table_) x = 1e-4_r * (2 * random.uniform() - 1);
    for (const auto* group : {&density_layers, &colour_layers})
      for (const nerf::LinearWeights& w : *group)
        for (int j = 0; j < w.out; ++j)
          for (int k = 0; k < w.in; ++k)
            weights_[w.offset + static_cast<std::size_t>(j * nerf::weight_stride(w.in) + k)] =
                std::sqrt(6.0_r / static_cast<Real>(w.in + w.out)) * (2 * random.uniform() - 1);

    features_ = tape_.input(shape_.features(), nerf::Domain::kSamples, /*gradient=*/true);
    delta_ = tape_.input(1, nerf::Domain::kSamples);
    const nerf::Value h = mlp(tape_, features_, density_layers);
    const nerf::Value density = truncated_exp(tape_, slice(tape_, h, 0, 1));
    light_ = render_weights(tape_, density, delta_, /*opaque_end=*/true);
    if (colour) {
      directions_ = tape_.input(3, nerf::Domain::kRays);
      background_ = tape_.input(3, nerf::Domain::kRays);
      target_ = tape_.input(3, nerf::Domain::kRays);
      scale_ = tape_.input(1, nerf::Domain::kRays);
      const nerf::Value rgb = sigmoid(
          tape_, mlp(tape_, concat(tape_, h, view_code(tape_, directions_)), colour_layers));
      pixel_ = accumulate(tape_, light_, rgb, background_);
      charbonnier_loss(tape_, pixel_, target_, scale_, 0.001_r);
    }
    light_gradient_ = tape_.input(1, nerf::Domain::kSamples);
    add_gradient(tape_, light_, light_gradient_);
    tape_.plan();
    chunk_.emplace(tape_);
    chunk_->weights = weights_.data();
    chunk_->weight_gradient = gradient_.data();
    chunk_->samples = samples * kRays;
    chunk_->rays = kRays;
    for (int r = 0; r <= kRays; ++r) ray_begin_.push_back(r * samples);
    chunk_->ray_begin = ray_begin_.data();
  }

  // posts: of kRays rays, samples + 1 each.
  void forward(const std::vector<RayInput>& rays, const nerf::IntervalSampler& sampler,
               const std::vector<Real>& posts) {
    const std::size_t n = static_cast<std::size_t>(samples_ * kRays);
    for (int r = 0; r < kRays; ++r)
      for (int i = 0; i < samples_; ++i) {
        const Real* post = posts.data() + r * (samples_ + 1) + i;
        const double t0 = sampler.distance(post[0]), t1 = sampler.distance(post[1]);
        const RayInput& ray = rays[static_cast<std::size_t>(r)];
        const nerf::Vec3d p = ray.origin + ray.direction * (0.5 * (t0 + t1));
        const nerf::Vec3 z = nerf::contract(p.cast<Real>());
        const std::size_t s = static_cast<std::size_t>(r * samples_ + i);
        for (int k = 0; k < 3; ++k)
          position_[static_cast<std::size_t>(k) * n + s] = 0.25_r * z[k] + 0.5_r;
        chunk_->data(delta_)[s] = static_cast<Real>(t1 - t0);
      }
    if (colour_)
      for (int k = 0; k < 3; ++k)
        for (int r = 0; r < kRays; ++r) {
          const RayInput& ray = rays[static_cast<std::size_t>(r)];
          const auto row = [&](nerf::Value v) {
            return chunk_->data(v) + k * chunk_->stride(v) + r;
          };
          *row(directions_) = static_cast<Real>(ray.direction[k]);
          *row(background_) = 0;
          *row(target_) = ray.target[k];
          chunk_->data(scale_)[r] = 1.0_r / (3 * kRays);
        }
    each_level([&](const nerf::HashGridLevel& level, int64_t row) {
      nerf::hash_grid_forward(level, table_.data() + level.begin(), axis(0), axis(1), axis(2),
                              chunk_->samples, chunk_->data(features_) + row,
                              chunk_->stride(features_));
    });
    chunk_->loss = 0;
    std::fill_n(chunk_->data(light_gradient_), n, 0.0_r);
    tape_.forward(*chunk_);
  }

  void backward_and_update(Real rate) {
    std::fill(gradient_.begin(), gradient_.end(), 0.0_r);
    tape_.backward(*chunk_);
    nerf::AdamStep adam;
    adam.rate = rate;
    each_level([&](const nerf::HashGridLevel& level, int64_t row) {
      Real* const gradient = table_gradient_.data() + level.begin();
      std::uint8_t* const marks = marks_.data() + level.offset;
      nerf::hash_grid_backward(level, axis(0), axis(1), axis(2), chunk_->samples,
                               chunk_->gradient(features_) + row, chunk_->stride(features_),
                               gradient, marks);
      const std::int64_t count = nerf::list_rows(level.entries, marks, listed_.data());
      nerf::adam_rows(adam, level.features, listed_.data(), count, gradient,
                      states_.data() + nerf::kRowParts * level.begin(),
                      table_.data() + level.begin(), correction_.data());
    });
    ++step_;
    nerf::adam_dense(adam, step_, static_cast<int64_t>(weights_.size()), gradient_.data(),
                     m_.data(), v_.data(), weights_.data());
  }

  std::span<const Real> light(int ray) const { return of_ray(light_, ray); }
  std::span<Real> light_gradient(int ray) {
    const std::span<const Real> s = of_ray(light_gradient_, ray);
    return {
        chunk_->data(light_gradient_) + (s.data() - std::as_const(*chunk_).data(light_gradient_)),
        s.size()};
  }
  double loss() const { return chunk_->loss; }
  double squared_error() const {
    double sum = 0;
    for (int k = 0; k < 3; ++k)
      for (int r = 0; r < kRays; ++r)
        sum += std::pow(chunk_->data(pixel_)[k * chunk_->stride(pixel_) + r] -
                            chunk_->data(target_)[k * chunk_->stride(target_) + r],
                        2.0);
    return sum / (3 * kRays);
  }

 private:
  const Real* axis(int k) const {
    return position_.data() + static_cast<std::size_t>(k * samples_ * kRays);
  }
  std::span<const Real> of_ray(nerf::Value v, int ray) const {
    return {std::as_const(*chunk_).data(v) + ray * samples_, static_cast<std::size_t>(samples_)};
  }
  template <class Body>
  void each_level(const Body& body) {
    int64_t row = 0;
    for (const nerf::HashGridLevel& level : shape_.levels) {
      body(level, row);
      row += shape_.features_per_entry() * chunk_->stride(features_);
    }
  }

  int samples_;
  bool colour_;
  nerf::HashGridShape shape_;
  nerf::Tape tape_;
  nerf::AlignedArray<Real> position_;  // x, y, z of all samples
  nerf::AlignedArray<Real> weights_, gradient_, m_, v_;
  nerf::AlignedArray<Real> table_, table_gradient_, states_;
  nerf::AlignedArray<std::uint8_t> marks_;
  std::vector<std::uint32_t> listed_;
  std::vector<Real> correction_;
  nerf::Value features_ = 0, delta_ = 0, light_ = 0, light_gradient_ = 0;
  nerf::Value directions_ = 0, background_ = 0, target_ = 0, scale_ = 0, pixel_ = 0;
  std::optional<nerf::Chunk> chunk_;
  std::vector<int32_t> ray_begin_;
  int64_t step_ = 0;
};

std::vector<RayInput> draw_rays(const nerf::Scene& scene, const nerf::PhotoSet& photos,
                                uint64_t seed, int step) {
  std::vector<RayInput> rays;
  for (uint64_t i = 0; rays.size() < kRays; ++i) {
    RayInput ray;
    ray.random = nerf::Random(seed, static_cast<uint64_t>(step), i);
    const int v = scene.train[ray.random.below(scene.train.size())];
    const nerf::Photo& photo = photos.photos[static_cast<std::size_t>(v)];
    const int x = static_cast<int>(ray.random.below(static_cast<uint64_t>(photo.width)));
    const int y = static_cast<int>(ray.random.below(static_cast<uint64_t>(photo.height)));
    const auto direction =
        nerf::unproject(photos.cameras[static_cast<std::size_t>(v)], {x + 0.5, y + 0.5});
    if (!direction) continue;
    const nerf::Pose pose = scene.to_engine.apply(scene.views[static_cast<std::size_t>(v)].pose);
    ray.origin = pose.translation;
    ray.direction = nerf::normalized(pose.rotation * *direction);
    Real rgba[4];
    photo.pixel(x, y, rgba);
    std::copy(rgba, rgba + 3, ray.target);
    rays.push_back(ray);
  }
  return rays;
}

}  // namespace

ComposedResult train_composed_method(const nerf::Scene& scene, const nerf::PhotoSet& photos,
                                     int steps, uint64_t seed) {
  nerf::IntervalOptions sampling;
  sampling.resampling = nerf::Resampling::kProposal;
  sampling.spacing = nerf::Spacing::kInverse;
  sampling.coarse = kProposed;
  sampling.fine = kFine;
  nerf::IntervalSampler sampler(sampling, scene.near, 1e4);
  Field proposal(kProposed, 5, 12, 128, /*colour=*/false, seed);
  Field field(kFine, 8, 14, 512, /*colour=*/true, seed);

  ComposedResult result;
  const int tenth = std::max(1, steps / 10);
  std::vector<Real> coarse(kRays * (kProposed + 1)), fine(kRays * (kFine + 1));
  const auto posts_of = [](std::vector<Real>& posts, int ray, int n) {
    return std::span<Real>(posts).subspan(static_cast<std::size_t>(ray * n),
                                          static_cast<std::size_t>(n));
  };
  for (int step = 0; step < steps; ++step) {
    std::vector<RayInput> rays = draw_rays(scene, photos, seed, step);
    for (int r = 0; r < kRays; ++r)
      sampler.first(&rays[static_cast<std::size_t>(r)].random, posts_of(coarse, r, kProposed + 1));
    proposal.forward(rays, sampler, coarse);
    const Real exponent =
        nerf::annealing_exponent(static_cast<Real>(step) / static_cast<Real>(steps));
    for (int r = 0; r < kRays; ++r)
      sampler.next(1, posts_of(coarse, r, kProposed + 1), proposal.light(r), exponent,
                   &rays[static_cast<std::size_t>(r)].random, posts_of(fine, r, kFine + 1));
    field.forward(rays, sampler, fine);

    double loss = field.loss();
    for (int r = 0; r < kRays; ++r) {
      const auto edges = posts_of(fine, r, kFine + 1), bounds = posts_of(coarse, r, kProposed + 1);
      loss += nerf::distortion_loss(edges, field.light(r), 0.01_r / kRays, field.light_gradient(r));
      loss += nerf::interlevel_loss(edges, field.light(r), bounds, proposal.light(r), 1.0_r / kRays,
                                    proposal.light_gradient(r));
    }
    for (auto [part, counts] :
         {std::pair{&result.first, step < tenth}, std::pair{&result.last, step >= steps - tenth}}) {
      if (!counts) continue;
      part->squared_error += field.squared_error() / tenth;
      part->loss += loss / tenth;
    }
    field.backward_and_update(1e-2_r);
    proposal.backward_and_update(1e-2_r);
  }
  return result;
}
