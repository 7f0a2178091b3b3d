// Russian roulette for gradients (Arvo and Kirk 1990, "Particle transport and image synthesis"): of
// the samples that hardly change anything a few go back through the networks, and stand for the
// others.
#pragma once

#include <cstdint>

#include "nerf/base/real.h"

namespace nerf {

// 1-norms, sums of magnitudes, of the n columns of x [rows x n], rows `ld` apart. x is read and
// norms are written up to the next multiple of kLane (kernels/linear.h).
void column_norms(int rows, int64_t n, const Real* x, int64_t ld, Real* norms);

// Which of n columns are kept, in ascending order: those whose norm is at least `least` times the
// mean of all, and of the others each with the chance p, its norm's share in that bound. Returns
// how many; factor[j] is 1, or the 1 / p that the j-th of them is to be multiplied by for its
// expectation to be what it was. Columns of zeros are never kept, those that are not finite always,
// and where the mean is not finite all others. `offset`, in [0, 1), is the random number of the
// draw, which is systematic: one for all columns.
int64_t gradient_roulette(int64_t n, const Real* norms, Real least, double offset, int32_t* kept,
                          Real* factor);

// Moves `count` columns, `kept` in ascending order, of x [rows x columns], rows `ld` apart, to the
// front. ld is a multiple of kLane. What stands behind them afterwards is as finite as x was.
void keep_columns(int rows, const int32_t* kept, int64_t count, Real* x, int64_t ld);
// The same of values that stand as pairs (kernels/linear_bf16.h).
void keep_pairs(int rows, const int32_t* kept, int64_t count, uint16_t* pairs);

}  // namespace nerf
