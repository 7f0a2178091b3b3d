// One step of Adam in double, and how far a step in float may be from it.
#pragma once

#include <cmath>
#include <cstdint>

#include "math/worst_error.h"
#include "nerf/kernels/adam.h"
#include "nerf/math/reference/adam.h"

namespace nerf {

inline reference::AdamOptions exact_options(const AdamStep& o) {
  return {o.rate, o.beta1, o.beta2, o.epsilon, o.l2};
}

// One step in double from the same state, and bounds on what rounding may do to each result: each
// line below is the rounded operations of one line of the algorithm, first order in the roundoff.
struct ExactStep {
  ExactStep(const AdamStep& options, int64_t step, double g, double m0, double v0, double w0) {
    const reference::AdamOptions o = exact_options(options);
    m = m0, v = v0, w = w0;
    reference::adam(o, step, g, m, v, w);
    const double total = reference::counted_gradient(g + o.l2 * w0), t = static_cast<double>(step);
    const double total_error = kRoundoff * std::fabs(total);
    m_error = (1 - o.beta1) * total_error + kRoundoff * (std::fabs(o.beta1 * m0) + std::fabs(m));
    v_error = (1 - o.beta2) * std::fabs(total) * (2 * total_error + kRoundoff * std::fabs(total)) +
              kRoundoff * (o.beta2 * v0 + v);
    const double c1 = o.rate / (1 - std::pow(o.beta1, t));
    const double root = std::sqrt(v / (1 - std::pow(o.beta2, t))) + o.epsilon;
    const double move = std::fabs(c1 * m / root);
    // Rounding of c1 (twice where it is a product), c2, the root, the sum and the quotient.
    w_error = c1 / root * m_error + move * (v > 0 ? v_error / (2 * v) : 0) + 6 * kRoundoff * move +
              kRoundoff * (std::fabs(w) + move);
  }
  double m, v, w, m_error, v_error, w_error;
};

}  // namespace nerf
