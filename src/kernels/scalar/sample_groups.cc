#include "nerf/kernels/sample_groups.h"

#include <algorithm>

#include "nerf/kernels/linear.h"

namespace nerf {

void mean_of_groups_forward(const SampleGroups& groups, int rows, const Real* x, int64_t ldx,
                            Real* y, int64_t ldy) {
  for (int k = 0; k < rows; ++k) {
    std::fill_n(y + k * ldy, round_up(groups.count, kLane), 0.0_r);
    for (int64_t i = 0; i < groups.samples; ++i)
      y[k * ldy + groups.of[i]] += groups.share[i] * x[k * ldx + i];
  }
}

void mean_of_groups_backward(const SampleGroups& groups, int rows, const Real* x, int64_t ldx,
                             const Real* y, const Real* dy, int64_t ldy, Real* dw, Real* dx) {
  for (int k = 0; k < rows; ++k)
    for (int64_t i = 0; i < groups.samples; ++i) {
      const Real slope = dy[k * ldy + groups.of[i]], mean = y[k * ldy + groups.of[i]];
      if (dw) dw[i] += groups.per_light[i] * slope * (x[k * ldx + i] - mean);
      if (dx) dx[k * ldx + i] += groups.share[i] * slope;
    }
}

}  // namespace nerf
