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

// A larger gradient counts as this, with its sign: its square would be infinite, v would stay so
// for ever, and the weight could not move. A gradient that is not a number stays so.
inline constexpr Real kMostGradient = 1e18_r;

// One step over n parameters; `step` counts from 1. n is a multiple of kLane (linear.h); arrays are
// aligned to 64 bytes.
void adam_dense(const AdamStep& options, int64_t step, int64_t n, const Real* gradient, Real* m,
                Real* v, Real* weights);

// What Adam keeps of a table's row of F features beside its weights and gradient: parts of F
// numbers, side by side, so that a step waits for one line of memory and not for one of each array.
// The part of steps begins with the number of steps that the row took. The weights' part is in use
// only where the table holds them rounded (half floats); it is there always, or rows would lie
// across two lines (64 bytes of float where F is 4).
enum RowPart { kRowM, kRowV, kRowSteps, kRowWeights, kRowParts };
inline constexpr Real kMostRowSteps = 65535;  // counted no further: the correction has long been 1

// Lists the rows whose mark is not 0, in their order, and clears the marks (hash_grid_backward()
// sets them, a byte for each row). list: room for all rows. Returns how many are listed.
int64_t list_rows(int64_t rows, uint8_t* marks, uint32_t* list);

// One step over `count` listed rows (of 2 or 4 features), each once, each with its own step
// counter. Clears their gradients; other rows keep every bit. gradient, weights: [..][features],
// states: [..][kRowParts][features], all aligned to 64 bytes; `correction` holds
// bias_corrections(...).
void adam_rows(const AdamStep& options, int features, const uint32_t* list, int64_t count,
               Real* gradient, Real* states, Real* weights, const Real* correction);
// The same for weights that stand in the states (kRowWeights); rounded receives them as half floats
// [..][features], from 32 bits to nearest, ties to even, those beyond the largest (65504) as that
// one.
void adam_rows(const AdamStep& options, int features, const uint32_t* list, int64_t count,
               Real* gradient, Real* states, uint16_t* rounded, const Real* correction);

// For a step t in [0, kBiasCorrections): correction[2 t] = 1 / (1 - beta1^t) and
// correction[2 t + 1] = 1 / sqrt(1 - beta2^t); later steps use the last entry.
inline constexpr int kBiasCorrections = 4096;
void bias_corrections(const AdamStep& options, Real* correction);

}  // namespace nerf
