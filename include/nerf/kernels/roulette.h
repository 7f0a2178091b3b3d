// Russian roulette for gradients (Arvo and Kirk 1990, "Particle transport and image synthesis"): a
// few of the samples that hardly change anything go back through the networks, and stand for the
// others.
#pragma once

#include <cstdint>

#include "nerf/base/real.h"

namespace nerf {

// 1-norms, sums of magnitudes, of the n columns of x [rows x n], rows `ld` apart. x is read and
// norms are written up to the next multiple of kLane (kernels/linear.h).
void column_norms(int rows, int64_t n, const Real* x, int64_t ld, Real* norms);

// Chooses the columns to keep, in ascending order, and returns their number. A column is kept if
// its norm is at least `least` times the mean of all n norms, else with the chance p, the share of
// its norm in that bound. factor[j] is 1 or 1 / p, by which the j-th kept column is to be
// multiplied so that its expectation stays. Columns of zeros are never kept, those that are not
// finite always, and all others where the mean is not finite. `offset`, in [0, 1), is the random
// number of the draw, which is systematic: one for all columns.
int64_t gradient_roulette(int64_t n, const Real* norms, Real least, double offset, int32_t* kept,
                          Real* factor);

// Moves `count` columns, `kept` in ascending order, of x [rows x columns], rows `ld` apart, to the
// front. ld is a multiple of kLane. What stands behind them afterwards is as finite as x was.
void keep_columns(int rows, const int32_t* kept, int64_t count, Real* x, int64_t ld);
// The same for values that stand as pairs (kernels/linear_bf16.h).
void keep_pairs(int rows, const int32_t* kept, int64_t count, uint16_t* pairs);

}  // namespace nerf
