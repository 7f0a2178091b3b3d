#include "nerf/kernels/adam.h"

#include <cmath>

namespace nerf {

void bias_corrections(const AdamStep& options, Real* correction) {
  correction[0] = correction[1] = 1;
  double power1 = 1, power2 = 1;
  for (int t = 1; t < kBiasCorrections; ++t) {
    power1 *= static_cast<double>(options.beta1);
    power2 *= static_cast<double>(options.beta2);
    correction[2 * t] = static_cast<Real>(1 / (1 - power1));
    correction[2 * t + 1] = static_cast<Real>(1 / std::sqrt(1 - power2));
  }
}

}  // namespace nerf
