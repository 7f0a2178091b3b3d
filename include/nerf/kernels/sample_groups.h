// Means over groups of successive samples, which share what is dear to find for each of them.
#pragma once

#include <cstdint>

#include "nerf/base/real.h"

namespace nerf {

// The arrays reach up to `samples` rounded up to kLane (kernels/linear.h).
struct SampleGroups {
  int64_t samples;
  int count;
  const int32_t* of;      // group of each sample: 0 first, then the same or the next one
  const Real* share;      // weight of the sample in its group's mean; 0: it belongs to none
  const Real* per_light;  // what that weight grows by with the sample's light: one over the
                          // group's; 0 likewise
};

// y_g = sum of share_i x_i over the samples of group g, for each of `rows` rows. Rows of x and y
// are `ldx` and `ldy` apart and have room for as many columns as the arrays; columns of y beyond
// `count` up to the next multiple of kLane become 0. What a sum is off by does not grow with the
// number of samples.
void mean_of_groups_forward(const SampleGroups& groups, int rows, const Real* x, int64_t ldx,
                            Real* y, int64_t ldy);

// Adds to dw_i = per_light_i sum_k dy_kg (x_ki - y_kg) and dx_ki = share_i dy_kg; either may be
// null.
void mean_of_groups_backward(const SampleGroups& groups, int rows, const Real* x, int64_t ldx,
                             const Real* y, const Real* dy, int64_t ldy, Real* dw, Real* dx);

}  // namespace nerf
