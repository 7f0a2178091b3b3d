// Specification of the losses on warps (Park et al. 2021, sections 3.3 and 3.4).
#pragma once

#include <array>
#include <cmath>
#include <cstddef>

#include "nerf/math/reference/scalar.h"

namespace nerf::reference {

// Of a squared residual, as the authors' code has it: the robust loss of Barron (2019) with
// alpha = -2, Geman and McClure's, times its scale once more:
//   rho = scale 2 u / (u + 4),   u = square / scale^2
template <class T>
T geman_mcclure(T square, double scale) {
  const T u = square * T(1 / (scale * scale));
  return T(2 * scale) * u / (u + T(4));
}

template <class T>
using Matrix3 = std::array<std::array<T, 3>, 3>;

template <class T>
Matrix3<T> product(const Matrix3<T>& a, const Matrix3<T>& b) {
  Matrix3<T> out;
  for (size_t i = 0; i < 3; ++i)
    for (size_t j = 0; j < 3; ++j)
      out[i][j] = a[i][0] * b[0][j] + a[i][1] * b[1][j] + a[i][2] * b[2][j];
  return out;
}

// a times the matrix, plus b times the identity.
template <class T>
Matrix3<T> scaled_plus(Matrix3<T> m, double a, double b) {
  for (size_t i = 0; i < 3; ++i)
    for (size_t j = 0; j < 3; ++j) m[i][j] = T(a) * m[i][j] + T(i == j ? b : 0.0);
  return m;
}

template <class T>
Matrix3<T> inverse(const Matrix3<T>& m) {
  Matrix3<T> out;
  T determinant(0);
  for (size_t i = 0; i < 3; ++i)
    for (size_t j = 0; j < 3; ++j) {
      const size_t i1 = (i + 1) % 3, i2 = (i + 2) % 3, j1 = (j + 1) % 3, j2 = (j + 2) % 3;
      out[j][i] = m[i1][j1] * m[i2][j2] - m[i1][j2] * m[i2][j1];
      if (i == 0) determinant += m[0][j] * out[j][0];
    }
  for (auto& row : out)
    for (T& v : row) v = v / determinant;
  return out;
}

// Sum of the squared logarithms of a matrix's singular values, from its columns: a quarter of the
// squared norm of log(J^T J), which is found by square roots (Denman and Beavers 1976) until a
// series of a few terms is enough. Of matrices that are far from singular.
template <class T>
T squared_log_singular_values(const Matrix3<T>& columns) {
  Matrix3<T> a;
  for (size_t i = 0; i < 3; ++i)
    for (size_t j = 0; j < 3; ++j)
      a[i][j] = columns[i][0] * columns[j][0] + columns[i][1] * columns[j][1] +
                columns[i][2] * columns[j][2];
  constexpr int kRoots = 4, kIterations = 9;
  for (int root = 0; root < kRoots; ++root) {
    Matrix3<T> y = a, z = scaled_plus(Matrix3<T>{}, 0, 1);
    for (int i = 0; i < kIterations; ++i) {
      const Matrix3<T> y_inverse = inverse(y), z_inverse = inverse(z);
      for (size_t k = 0; k < 9; ++k) {
        T &of_y = y[k / 3][k % 3], &of_z = z[k / 3][k % 3];
        of_y = T(0.5) * (of_y + z_inverse[k / 3][k % 3]);
        of_z = T(0.5) * (of_z + y_inverse[k / 3][k % 3]);
      }
    }
    a = y;
  }
  // log a = 2 sum of w^(2 k + 1) / (2 k + 1), w = (a - 1) / (a + 1).
  const Matrix3<T> w = product(scaled_plus(a, 1, -1), inverse(scaled_plus(a, 1, 1)));
  const Matrix3<T> square = product(w, w);
  Matrix3<T> power = w, log = w;
  for (int k = 1; k < 8; ++k) {
    power = product(power, square);
    for (size_t i = 0; i < 9; ++i) log[i / 3][i % 3] += power[i / 3][i % 3] * T(1.0 / (2 * k + 1));
  }
  T sum(0);
  for (const auto& row : log)
    for (const T& v : row) sum += v * v;
  const double factor = 2.0 * (1 << kRoots);
  return T(0.25 * factor * factor) * sum;
}

}  // namespace nerf::reference
