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

// What Adam keeps of a table's row of F features beside its weights: four parts of F numbers, side
// by side, so that a step waits for one line of memory (64 bytes of float where F is 4) and not for
// one of each array. The last part begins with the number of steps that the row took, and with
// whether the row is listed for the next one (1, else 0).
enum RowPart { kRowGradient, kRowM, kRowV, kRowSteps, kRowParts };
inline constexpr Real kMostRowSteps = 65535;  // counted no further: the correction has long been 1

// Rows that have a gradient, in the order in which they got one (hash_grid_backward).
struct RowList {
  uint32_t* rows;  // room for one more than there are rows
  int64_t count = 0;
};

// One step over `count` listed rows (of 2 or 4 features), each once, each with its own step
// counter. Clears gradient and mark of each; others keep every bit. states:
// [..][kRowParts][features], weights: [..][features], both aligned to 64 bytes; `correction` holds
// bias_corrections(...).
void adam_rows(const AdamStep& options, int features, const uint32_t* rows, int64_t count,
               Real* states, Real* weights, const Real* correction);

// For a step t in [0, kBiasCorrections): correction[2 t] = 1 / (1 - beta1^t) and
// correction[2 t + 1] = 1 / sqrt(1 - beta2^t); later steps use the last entry.
inline constexpr int kBiasCorrections = 4096;
void bias_corrections(const AdamStep& options, Real* correction);

}  // namespace nerf
