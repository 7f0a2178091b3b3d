#include "nerf/kernels/adam.h"

#include <algorithm>
#include <cmath>

#include "base/half.h"

namespace nerf {
namespace {

// One parameter, as in math/reference/adam.h: c1 = rate / (1 - beta1^t), c2 = 1 / sqrt(1 -
// beta2^t).
void update(const AdamStep& o, Real c1, Real c2, Real g, Real& m, Real& v, Real& w) {
  g += o.l2 * w;
  if (std::fabs(g) > kMostGradient) g = std::copysign(kMostGradient, g);
  m = o.beta1 * m + (1 - o.beta1) * g;
  v = o.beta2 * v + (1 - o.beta2) * (g * g);
  w -= c1 * (m / (std::sqrt(v) * c2 + o.epsilon));
}

// Calls step_number(at, kept, step) for each number of each listed row: it stands at [at] of the
// table, `kept` is that of the states, and step(weight) takes the step on whichever it is.
template <class Step>
void each_listed(const AdamStep& options, int features, const uint32_t* list, int64_t count,
                 Real* gradient, Real* states, const Real* correction, const Step& step_number) {
  for (int64_t i = 0; i < count; ++i) {
    const int64_t row = list[i];
    Real* const state = states + row * kRowParts * features;
    Real* const g = gradient + row * features;
    Real* const steps = state + kRowSteps * features;
    steps[0] = std::min(steps[0] + 1, kMostRowSteps);
    const int t = std::min(static_cast<int>(steps[0]), kBiasCorrections - 1);
    const Real c1 = options.rate * correction[2 * t], c2 = correction[2 * t + 1];
    for (int f = 0; f < features; ++f) {
      step_number(row * features + f, state[kRowWeights * features + f], [&](Real& w) {
        update(options, c1, c2, g[f], state[kRowM * features + f], state[kRowV * features + f], w);
      });
      g[f] = 0;
    }
  }
}

}  // namespace

void adam_dense(const AdamStep& options, int64_t step, int64_t n, const Real* gradient, Real* m,
                Real* v, Real* weights) {
  const Real t = static_cast<Real>(step);
  const Real c1 = options.rate / (1 - std::pow(options.beta1, t));
  const Real c2 = 1 / std::sqrt(1 - std::pow(options.beta2, t));
  for (int64_t i = 0; i < n; ++i) update(options, c1, c2, gradient[i], m[i], v[i], weights[i]);
}

int64_t list_rows(int64_t rows, uint8_t* marks, uint32_t* list) {
  int64_t count = 0;
  for (int64_t row = 0; row < rows; ++row)
    if (marks[row]) {
      list[count++] = static_cast<uint32_t>(row);
      marks[row] = 0;
    }
  return count;
}

void adam_rows(const AdamStep& options, int features, const uint32_t* list, int64_t count,
               Real* gradient, Real* states, Real* weights, const Real* correction) {
  each_listed(options, features, list, count, gradient, states, correction,
              [&](int64_t at, Real&, const auto& step) { step(weights[at]); });
}

void adam_rows(const AdamStep& options, int features, const uint32_t* list, int64_t count,
               Real* gradient, Real* states, uint16_t* rounded, const Real* correction) {
  each_listed(options, features, list, count, gradient, states, correction,
              [&](int64_t at, Real& weight, const auto& step) {
                step(weight);
                rounded[at] = internal::float_to_half(static_cast<float>(weight));
              });
}

}  // namespace nerf
