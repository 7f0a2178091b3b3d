// Specification of the rigid motion of a point by a screw (Park et al. 2021, section 3.2).
#pragma once

#include <cmath>
#include <cstddef>
#include <vector>

#include "nerf/math/reference/scalar.h"

namespace nerf::reference {

// sum over k of (-s)^k / (2 k + n)!: for s = angle^2 and n = 1, 2, 3 it is sin(angle) / angle,
// (1 - cos(angle)) / angle^2 and (angle - sin(angle)) / angle^3. For s below 1 it is summed, since
// the quotients cancel there, and have no derivative at 0.
template <class T>
T angle_series(int n, T s) {
  using std::cos, std::sin, std::sqrt;
  if (real_part(s) < 1) {
    double factorial = 1;
    for (int i = 2; i <= n; ++i) factorial *= i;
    T sum(0), power(1);
    for (int k = 0; k < 12; ++k) {
      sum += power * T(1 / factorial);
      power = power * -s;
      factorial *= (2 * k + n + 1) * (2 * k + n + 2);
    }
    return sum;
  }
  const T angle = sqrt(s);
  if (n == 1) return sin(angle) / angle;
  if (n == 2) return (T(1) - cos(angle)) / s;
  return (angle - sin(angle)) / (s * angle);
}

// The screw [6] is a rotation vector w, whose length is the angle, above a velocity v. With W the
// matrix of the cross product by w:
//   x' = R x + G v,   R = exp(W) = I + sin(|w|) / |w| W + (1 - cos(|w|)) / |w|^2 W^2,
//   G = I + (1 - cos(|w|)) / |w|^2 W + (|w| - sin(|w|)) / |w|^3 W^2
template <class T>
std::vector<T> rigid_motion(const std::vector<T>& screw, const std::vector<T>& x) {
  const T &a = screw[0], &b = screw[1], &c = screw[2];
  const T s = a * a + b * b + c * c;
  const T zero(0);
  const T w[3][3] = {{zero, -c, b}, {c, zero, -a}, {-b, a, zero}};
  const T of_r[2] = {angle_series(1, s), angle_series(2, s)};
  const T of_g[2] = {angle_series(2, s), angle_series(3, s)};
  std::vector<T> out;
  for (size_t i = 0; i < 3; ++i) {
    out.push_back(x[i] + screw[3 + i]);
    for (size_t j = 0; j < 3; ++j) {
      T square(0);
      for (size_t k = 0; k < 3; ++k) square += w[i][k] * w[k][j];
      out[i] += (of_r[0] * w[i][j] + of_r[1] * square) * x[j];
      out[i] += (of_g[0] * w[i][j] + of_g[1] * square) * screw[3 + j];
    }
  }
  return out;
}

}  // namespace nerf::reference
