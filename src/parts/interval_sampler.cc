#include "nerf/parts/interval_sampler.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "nerf/base/error.h"
#include "nerf/kernels/resampling.h"
#include "nerf/math/step_function.h"

namespace nerf {

namespace {

constexpr Real kEpsilon = std::numeric_limits<Real>::epsilon();
// mip-NeRF 360's dilation: dilation_bias and dilation_multiplier of multinerf's model.
constexpr Real kDilationBias = 0.0025_r, kDilationFactor = 0.5_r;

}  // namespace

IntervalSampler::IntervalSampler(const IntervalOptions& options, double near, double far)
    : options_(options) {
  set_range(static_cast<Real>(near), static_cast<Real>(far));
}

void IntervalSampler::set_range(Real near, Real far) {
  near_ = near;
  far_ = far;
  NERF_CHECK(near_ < far_);
  NERF_CHECK(options_.spacing == Spacing::kUniform || near_ > 0);
}

int IntervalOptions::samples(int level) const {
  // Each level of coarse+fine keeps those of the level before and adds as many, or the fine ones.
  const int kept = resampling == Resampling::kCoarseFine ? coarse * level : 0;
  return kept + (level + 1 < levels() ? coarse : fine);
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
Real IntervalSampler::even(Real share) const {
  if (options_.spacing == Spacing::kUniform) return near_ * (1 - share) + far_ * share;
  return 1 / ((1 - share) / near_ + share / far_);
}

Real IntervalSampler::distance(Real entry) const { return intervals() ? even(entry) : entry; }

Real IntervalSampler::normalised(Real entry) const {
  if (intervals()) return entry;
  if (options_.spacing == Spacing::kUniform) return (entry - near_) / (far_ - near_);
  return (1 / near_ - 1 / entry) / (1 / near_ - 1 / far_);
}

// Each entry moves within the half intervals around it (stratified sampling, Mildenhall et al.
// 2020, equation 2, in the form of the authors' code).
void IntervalSampler::jitter(Random* random, std::span<Real> x) const {
  if (!random) return;
  Real low = x[0];
  for (size_t i = 0; i < x.size(); ++i) {
    const Real high = i + 1 < x.size() ? 0.5_r * (x[i] + x[i + 1]) : x[i];
    x[i] = low + (high - low) * random->uniform();
    low = high;
  }
}

void IntervalSampler::first(Random* random, std::span<Real> out) {
  NERF_CHECK_EQ(out.size(), static_cast<size_t>(posts(0)));
  if (options_.resampling == Resampling::kProposal) {
    // Drawing from one bin of the whole ray: the same as even centres.
    const int n = samples(0);
    const Real spacing = 1 / static_cast<Real>(n);
    const Real offset = random ? random->uniform() : 0.5_r;
    scratch_.resize(static_cast<size_t>(n));
    for (int i = 0; i < n; ++i)
      scratch_[static_cast<size_t>(i)] = (static_cast<Real>(i) + offset) * spacing;
    posts_around<Real>(scratch_, 0, 1, out);
    return;
  }
  const Real last = static_cast<Real>(out.size() - 1);
  for (size_t i = 0; i < out.size(); ++i) {
    const Real share = static_cast<Real>(i) / last;
    out[i] = intervals() ? share : even(share);
  }
  jitter(random, out);
}

void IntervalSampler::next(int level, std::span<const Real> before, std::span<const Real> weights,
                           Real exponent, Random* random, std::span<Real> out) {
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

void IntervalSampler::merge_fine(std::span<const Real> before, std::span<const Real> weights,
                                 Random* random, std::span<Real> out) {
  const size_t fine = out.size() - before.size();
  u_.resize(fine);
  for (size_t i = 0; i < fine; ++i)
    u_[i] = random ? random->uniform()
                   : (1 - kEpsilon) * static_cast<Real>(i) / static_cast<Real>(fine - 1);
  if (random) std::sort(u_.begin(), u_.end());
  // resample_points(): between the middles, without the first and the last weight.
  const size_t bins = before.size() - 2;
  edges_.resize(bins + 1);
  mass_.resize(bins);
  cdf_.resize(bins + 1);
  scratch_.resize(fine);
  for (size_t i = 0; i <= bins; ++i) edges_[i] = 0.5_r * (before[i] + before[i + 1]);
  for (size_t i = 0; i < bins; ++i) mass_[i] = weights[i + 1] + static_cast<Real>(kRaisedWeight);
  histogram_cdf(mass_, cdf_);
  histogram_inverse(edges_, cdf_, u_, scratch_);
  std::merge(before.begin(), before.end(), scratch_.begin(), scratch_.end(), out.begin());
}

void IntervalSampler::resample_blurred(std::span<const Real> before, std::span<const Real> weights,
                                       Random* random, std::span<Real> out) {
  mass_.resize(weights.size());
  blur_weights<Real>(weights, options_.padding, mass_);
  cdf_.resize(before.size());
  histogram_cdf(mass_, cdf_);
  u_.resize(out.size());
  const Real n = static_cast<Real>(out.size());
  for (size_t i = 0; i < out.size(); ++i) {
    const Real at = static_cast<Real>(i);
    u_[i] = random ? std::min((at + random->uniform()) / n, 1 - kEpsilon)
                   : (1 - kEpsilon) * at / (n - 1);
  }
  histogram_inverse(before, cdf_, u_, out);
}

void IntervalSampler::resample_dilated(int level, std::span<const Real> before,
                                       std::span<const Real> weights, Real exponent, Random* random,
                                       std::span<Real> out) {
  Real product = 1;
  for (int l = 0; l < level; ++l) product *= static_cast<Real>(samples(l));
  const Real dilation = kDilationBias + kDilationFactor / product;
  edges_.resize(dilated_edges(weights.size()));
  mass_.resize(edges_.size() - 1);
  dilate_weights<Real>(before, weights, dilation, 0, 1, edges_, mass_, dilation_);
  // The moved edges at both ends lie outside or on the domain's: multinerf leaves those bins out.
  const std::span<Real> edges = std::span(edges_).subspan(1, edges_.size() - 2);
  const std::span<Real> mass = std::span(mass_).subspan(1, mass_.size() - 2);
  if (options_.padding > 0)
    for (Real& m : mass) m += options_.padding;
  histogram_anneal(edges, mass, exponent, mass);
  cdf_.resize(edges.size());
  histogram_cdf(mass, cdf_);
  const size_t n = static_cast<size_t>(samples(level));
  u_.resize(n);
  scratch_.resize(n);
  const Real offset = random ? random->uniform() : 0.5_r;  // one for the ray
  for (size_t i = 0; i < n; ++i)
    u_[i] = std::min((static_cast<Real>(i) + offset) / static_cast<Real>(n), 1 - kEpsilon);
  histogram_inverse(edges, cdf_, u_, scratch_);
  posts_around<Real>(scratch_, 0, 1, out);
}

}  // namespace nerf
