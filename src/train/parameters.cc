#include "train/parameters.h"

#include <algorithm>
#include <cmath>

#include "nerf/train/trainer.h"

namespace nerf {

DenseParameters::DenseParameters(std::span<Real> weights, std::vector<LinearWeights> layers,
                                 std::vector<ParameterSection> sections, int accumulators)
    : gradient(weights.size()),
      m(weights.size()),
      v(weights.size()),
      weights_(weights),
      layers_(std::move(layers)),
      sections_(std::move(sections)) {
  for (int i = 0; i < accumulators; ++i) accumulators_.emplace_back(weights.size());
}

Real* DenseParameters::begin_sum(int64_t a) {
  AlignedArray<Real>& sum = accumulators_[static_cast<size_t>(a)];
  std::fill(sum.begin(), sum.end(), 0.0_r);
  return sum.data();
}

void DenseParameters::pack(Precision precision, ThreadPool& pool) {
  pack_layers(layers_, weights_.data(), precision, packs_, pool);
}

void DenseParameters::reduce(int64_t step, ThreadPool& pool) {
  constexpr int64_t kBlock = 4096;
  const int64_t n = static_cast<int64_t>(gradient.size());
  pool.parallel_for((n + kBlock - 1) / kBlock, [&](int64_t block) {
    const int64_t begin = block * kBlock, end = std::min(n, begin + kBlock);
    std::fill(gradient.data() + begin, gradient.data() + end, 0.0_r);
    for (const AlignedArray<Real>& a : accumulators_)
      for (int64_t i = begin; i < end; ++i) gradient.data()[i] += a.data()[i];
  });
  for (const ParameterSection& section : sections_) {
    const std::span<Real> of = gradient.span().subspan(section.begin, section.end - section.begin);
    if (!std::ranges::all_of(of, [](Real g) { return std::isfinite(g); }))
      throw NonFiniteError("the gradient of " + section.name + " at step " + std::to_string(step) +
                           " is not finite");
    if (!(section.clip > 0)) continue;
    double square = 0;
    for (const Real g : of) square += static_cast<double>(g) * static_cast<double>(g);
    const double norm = std::sqrt(square);
    if (norm <= section.clip) continue;
    const Real factor = static_cast<Real>(section.clip / norm);
    for (Real& g : of) g *= factor;
  }
}

void DenseParameters::update(const AdamStep& adam, int64_t step, Precision precision,
                             ThreadPool& pool) {
  constexpr int64_t kBlock = 1 << 16;
  for (const ParameterSection& section : sections_) {
    AdamStep own = adam;
    own.rate *= static_cast<Real>(section.rate);
    const Real kept = 1 - own.rate * static_cast<Real>(section.decay);
    const int64_t n = static_cast<int64_t>(section.end - section.begin);
    pool.parallel_for((n + kBlock - 1) / kBlock, [&](int64_t block) {
      const size_t at = section.begin + static_cast<size_t>(block * kBlock);
      const int64_t count = std::min(kBlock, n - block * kBlock);
      if (section.decay > 0)
        for (size_t i = at; i < at + static_cast<size_t>(count); ++i) {
          const Real centre = section.centre.empty() ? 0.0_r : section.centre[i - section.begin];
          weights_[i] = centre == 0 ? weights_[i] * kept : centre + kept * (weights_[i] - centre);
        }
      adam_dense(own, step, count, gradient.data() + at, m.data() + at, v.data() + at,
                 weights_.data() + at);
    });
  }
  pack(precision, pool);
}

void DenseParameters::forget() {
  std::fill(m.begin(), m.end(), 0.0_r);
  std::fill(v.begin(), v.end(), 0.0_r);
}

}  // namespace nerf
