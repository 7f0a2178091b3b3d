// The elastic loss of one Jacobian on any scalar of the gradient tests.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "autodiff/magnitude.h"
#include "nerf/math/reference/warp_losses.h"

namespace nerf {

// Of a Jacobian, column by column.
template <class T>
T elastic_of(const std::vector<T>& numbers, double penalty) {
  reference::Matrix3<T> columns;
  for (size_t k = 0; k < 9; ++k) columns[k / 3][k % 3] = numbers[k];
  return reference::geman_mcclure(reference::squared_log_singular_values(columns), penalty);
}

// The roots and the logarithm of a matrix say nothing of the roundings of the eigenvalues that the
// operation takes, in double: what comes out has the errors of its inputs. Next to the identity the
// slopes of rho(sum of logarithms squared) are at most 0.7, and their slopes 2 / penalty.
inline Magnitude elastic_of(const std::vector<Magnitude>& numbers, double penalty) {
  std::vector<reference::Dual> exact;
  double size = 0, largest = 0, derivatives = 0, derivative_size = 0;
  for (const Magnitude& v : numbers) {
    exact.push_back({v.value, v.derivative});
    size += v.size - std::fabs(v.value);
    largest = std::max(largest, v.size);
    derivatives += std::fabs(v.derivative);
    derivative_size += v.derivative_size;
  }
  const reference::Dual y = elastic_of(exact, penalty);
  return {y.value, std::fabs(y.value) + 0.7 * size, y.derivative,
          std::fabs(y.derivative) + 0.7 * derivative_size + 2 / penalty * largest * derivatives};
}

}  // namespace nerf
