// Adam (Kingma and Ba 2015, algorithm 1), dense and for sparsely touched rows.
#pragma once

#include <cstdint>

#include "nerf/base/real.h"

namespace nerf {

struct AdamStep {
  Real rate = 1e-2_r;
  Real beta1 = 0.9_r, beta2 = 0.99_r;
  Real epsilon = 1e-15_r;
  Real l2 = 0;  // added to the gradient as l2 * weight
};

// A gradient beyond this counts as this, of its sign: its square would be infinite, and so would v
// be for ever after, which holds a weight where it is. One that is no number stays none.
inline constexpr Real kMostGradient = 1e18_r;

// One step over n parameters; `step` counts from 1. n is a multiple of kLane (linear.h); arrays are
// aligned to 64 bytes.
void adam_dense(const AdamStep& options, int64_t step, int64_t n, const Real* gradient, Real* m,
                Real* v, Real* weights);

// One step over the rows (of 2 or 4 floats each) whose touched flag is 1 and not 0, each with its
// own step counter (saturating at 65535, where the bias correction has long been 1). Clears flag
// and gradient of every touched row. `correction` holds bias_corrections(...). rows is a multiple
// of 8.
void adam_rows(const AdamStep& options, int features, int64_t rows, uint8_t* touched,
               Real* gradient, Real* m, Real* v, uint16_t* steps, Real* weights,
               const Real* correction);

// For a step t in [0, kBiasCorrections): correction[2 t] = 1 / (1 - beta1^t) and
// correction[2 t + 1] = 1 / sqrt(1 - beta2^t); later steps use the last entry.
inline constexpr int kBiasCorrections = 4096;
void bias_corrections(const AdamStep& options, Real* correction);

}  // namespace nerf
