// Specification of the losses of pixels (autodiff/operations.h): value and derivative for one
// channel's error e. The Huber loss has a header of its own (huber.h).
#pragma once

#include <array>
#include <cmath>
#include <cstddef>

#include "nerf/math/reference/scalar.h"

namespace nerf::reference {

template <class T>
T squared(T e) {
  return e * e;
}
template <class T>
T squared_slope(T e) {
  return T(2) * e;
}

// sqrt(e^2 + epsilon^2) (Barron et al. 2022, section 5).
template <class T>
T charbonnier(T e, double epsilon) {
  using std::sqrt;
  return sqrt(e * e + T(epsilon * epsilon));
}
// 0 where the loss is: at an error of 0 without an epsilon.
template <class T>
T charbonnier_slope(T e, double epsilon) {
  const T value = charbonnier(e, epsilon);
  return real_part(value) > 0 ? e / value : T(0);
}

// f of each colour channel's error, pixel - target, added up, times the ray's scale. The pixel's
// opacity takes no part.
template <class T, class F>
T pixel_loss(const std::array<T, 4>& pixel, const std::array<T, 3>& target, T scale, const F& f) {
  T sum(0);
  for (size_t k = 0; k < 3; ++k) sum += f(pixel[k] - target[k]);
  return sum * scale;
}

}  // namespace nerf::reference
