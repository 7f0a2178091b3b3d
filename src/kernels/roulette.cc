#include "nerf/kernels/roulette.h"

#include <cmath>

namespace nerf {

int64_t gradient_roulette(int64_t n, const Real* norms, Real least, double offset, int32_t* kept,
                          Real* factor) {
  constexpr double kLeastChance = 1e-30;  // its inverse is a float yet
  double sum = 0;
  for (int64_t i = 0; i < n; ++i) sum += static_cast<double>(norms[i]);
  double bound = static_cast<double>(least) * sum / static_cast<double>(n);
  if (!std::isfinite(bound)) bound = 0;
  int64_t count = 0;
  double drawn = offset;
  for (int64_t i = 0; i < n; ++i) {
    const double norm = static_cast<double>(norms[i]);
    double p = 1;
    if (norm == 0) continue;
    if (norm < bound) {
      p = norm / bound;
      const double before = std::floor(drawn);
      drawn += p;
      if (p < kLeastChance || std::floor(drawn) == before) continue;
    }
    kept[count] = static_cast<int32_t>(i);
    factor[count++] = static_cast<Real>(1 / p);
  }
  return count;
}

}  // namespace nerf
