#include "nerf/parts/interval_sampler.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "nerf/base/error.h"
#include "nerf/math/step_function.h"

namespace nerf {

namespace {

constexpr float kEpsilon = std::numeric_limits<float>::epsilon();
// mip-NeRF 360's dilation: dilation_bias and dilation_multiplier of multinerf's model.
constexpr float kDilationBias = 0.0025f, kDilationFactor = 0.5f;

}  // namespace

IntervalSampler::IntervalSampler(const IntervalOptions& options, double near, double far)
    : options_(options), near_(static_cast<float>(near)), far_(static_cast<float>(far)) {
  NERF_CHECK(near_ < far_);
  NERF_CHECK(options.spacing == Spacing::kUniform || near_ > 0);
}

int IntervalOptions::samples(int level) const {
  if (level + 1 < levels()) return coarse;
  const bool merged = resampling == Resampling::kCoarseFine && level > 0;
  return fine + (merged ? coarse * level : 0);
}

int IntervalOptions::most_posts() const {
  int most = 0;
  for (int level = 0; level < levels(); ++level) most = std::max(most, posts(level));
  return most;
}

int IntervalOptions::all_samples() const {
  int sum = 0;
  for (int level = 0; level < levels(); ++level) sum += samples(level);
  return sum;
}

// `share` of the way from near to far, in the spacing of the first samples.
float IntervalSampler::even(float share) const {
  if (options_.spacing == Spacing::kUniform) return near_ * (1 - share) + far_ * share;
  return 1 / ((1 - share) / near_ + share / far_);
}

float IntervalSampler::distance(float entry) const { return intervals() ? even(entry) : entry; }

float IntervalSampler::normalised(float entry) const {
  if (intervals()) return entry;
  if (options_.spacing == Spacing::kUniform) return (entry - near_) / (far_ - near_);
  return (1 / near_ - 1 / entry) / (1 / near_ - 1 / far_);
}

// Each entry moves within the half intervals around it (stratified sampling, Mildenhall et al.
// 2020, equation 2, in the form of the authors' code).
void IntervalSampler::jitter(Random* random, std::span<float> x) const {
  if (!random) return;
  float low = x[0];
  for (size_t i = 0; i < x.size(); ++i) {
    const float high = i + 1 < x.size() ? 0.5f * (x[i] + x[i + 1]) : x[i];
    x[i] = low + (high - low) * random->uniform();
    low = high;
  }
}

void IntervalSampler::first(Random* random, std::span<float> out) {
  NERF_CHECK_EQ(out.size(), static_cast<size_t>(posts(0)));
  if (options_.resampling == Resampling::kProposal) {
    // Drawing from one bin of the whole ray: the same as even centres.
    const int n = samples(0);
    const float spacing = 1 / static_cast<float>(n);
    const float offset = random ? random->uniform() : 0.5f;
    scratch_.resize(static_cast<size_t>(n));
    for (int i = 0; i < n; ++i)
      scratch_[static_cast<size_t>(i)] = (static_cast<float>(i) + offset) * spacing;
    posts_around<float>(scratch_, 0, 1, out);
    return;
  }
  const float last = static_cast<float>(out.size() - 1);
  for (size_t i = 0; i < out.size(); ++i) {
    const float share = static_cast<float>(i) / last;
    out[i] = intervals() ? share : even(share);
  }
  jitter(random, out);
}

void IntervalSampler::next(int level, std::span<const float> before, std::span<const float> weights,
                           float exponent, Random* random, std::span<float> out) {
  NERF_CHECK(level >= 1 && level < levels());
  NERF_CHECK_EQ(before.size(), static_cast<size_t>(posts(level - 1)));
  NERF_CHECK_EQ(weights.size(), static_cast<size_t>(samples(level - 1)));
  NERF_CHECK_EQ(out.size(), static_cast<size_t>(posts(level)));
  switch (options_.resampling) {
    case Resampling::kCoarseFine:
      return merge_fine(before, weights, random, out);
    case Resampling::kBlurred:
      return resample_blurred(before, weights, random, out);
    case Resampling::kProposal:
      return resample_dilated(level, before, weights, exponent, random, out);
  }
}

void IntervalSampler::merge_fine(std::span<const float> before, std::span<const float> weights,
                                 Random* random, std::span<float> out) {
  const size_t fine = out.size() - before.size();
  u_.resize(fine);
  for (size_t i = 0; i < fine; ++i)
    u_[i] = random ? random->uniform()
                   : (1 - kEpsilon) * static_cast<float>(i) / static_cast<float>(fine - 1);
  if (random) std::sort(u_.begin(), u_.end());
  scratch_.resize(2 * before.size());
  edges_.resize(fine);
  resample_points<float>(before, weights, u_, scratch_, edges_);
  std::merge(before.begin(), before.end(), edges_.begin(), edges_.end(), out.begin());
}

void IntervalSampler::resample_blurred(std::span<const float> before,
                                       std::span<const float> weights, Random* random,
                                       std::span<float> out) {
  mass_.resize(weights.size());
  blur_weights<float>(weights, options_.padding, mass_);
  cdf_.resize(before.size());
  cumulative_shares<float>(mass_, cdf_);
  u_.resize(out.size());
  const float n = static_cast<float>(out.size());
  for (size_t i = 0; i < out.size(); ++i) {
    const float at = static_cast<float>(i);
    u_[i] = random ? std::min((at + random->uniform()) / n, 1 - kEpsilon)
                   : (1 - kEpsilon) * at / (n - 1);
  }
  invert_sorted<float>(before, cdf_, u_, out);
}

void IntervalSampler::resample_dilated(int level, std::span<const float> before,
                                       std::span<const float> weights, float exponent,
                                       Random* random, std::span<float> out) {
  float product = 1;
  for (int l = 0; l < level; ++l) product *= static_cast<float>(samples(l));
  const float dilation = kDilationBias + kDilationFactor / product;
  edges_.resize(dilated_edges(weights.size()));
  mass_.resize(edges_.size() - 1);
  dilate_weights<float>(before, weights, dilation, 0, 1, edges_, mass_);
  // The moved edges at both ends lie outside or on the domain's: multinerf leaves those bins out.
  const std::span<float> edges = std::span(edges_).subspan(1, edges_.size() - 2);
  const std::span<float> mass = std::span(mass_).subspan(1, mass_.size() - 2);
  if (options_.padding > 0)
    for (float& m : mass) m += options_.padding;
  anneal_weights<float>(edges, mass, exponent, mass);
  cdf_.resize(edges.size());
  cumulative_shares<float>(mass, cdf_);
  const size_t n = static_cast<size_t>(samples(level));
  u_.resize(n);
  scratch_.resize(n);
  const float offset = random ? random->uniform() : 0.5f;  // one for the ray
  for (size_t i = 0; i < n; ++i)
    u_[i] = std::min((static_cast<float>(i) + offset) / static_cast<float>(n), 1 - kEpsilon);
  invert_sorted<float>(edges, cdf_, u_, scratch_);
  posts_around<float>(scratch_, 0, 1, out);
}

}  // namespace nerf
