// Specification of the operations that join, cut, add and look up values (autodiff/operations.h).
// A value's column is a vector of its rows.
#pragma once

#include <cmath>
#include <cstddef>
#include <vector>

#include "nerf/math/reference/scalar.h"

namespace nerf::reference {

// Rows of a [n] above rows of b [m]: [n + m].
template <class T>
std::vector<T> concat(std::vector<T> a, const std::vector<T>& b) {
  a.insert(a.end(), b.begin(), b.end());
  return a;
}

// Rows [first, first + rows) of x.
template <class T>
std::vector<T> slice(const std::vector<T>& x, size_t first, size_t rows) {
  const auto begin = x.begin() + static_cast<std::ptrdiff_t>(first);
  return {begin, begin + static_cast<std::ptrdiff_t>(rows)};
}

// a + b, and a b element by element, of the same shape.
template <class T>
std::vector<T> add(std::vector<T> a, const std::vector<T>& b) {
  for (size_t i = 0; i < a.size(); ++i) a[i] += b[i];
  return a;
}
template <class T>
std::vector<T> multiply(std::vector<T> a, const std::vector<T>& b) {
  for (size_t i = 0; i < a.size(); ++i) a[i] *= b[i];
  return a;
}

// factor x + shift.
template <class T>
std::vector<T> scale_shift(std::vector<T> x, double factor, double shift) {
  for (T& v : x) v = T(factor) * v + T(shift);
  return x;
}

// A ray's column for each of its samples, which are [begin[r], begin[r + 1]) of ray r.
template <class T, class Index>
std::vector<std::vector<T>> repeat_for_samples(const std::vector<std::vector<T>>& x,
                                               const std::vector<Index>& begin) {
  std::vector<std::vector<T>> y;
  for (size_t r = 0; r + 1 < begin.size(); ++r)
    for (Index s = begin[r]; s < begin[r + 1]; ++s) y.push_back(x[r]);
  return y;
}

// A term of the loss whose gradient in x is `given`, whatever x is: sum of given x less its value.
template <class T>
T add_gradient(const std::vector<T>& x, const std::vector<double>& given) {
  T sum(0);
  for (size_t i = 0; i < x.size(); ++i) sum += T(given[i]) * (x[i] - stop_gradient(x[i]));
  return sum;
}

// Row floor(index) of the table [rows x columns], whose rows are `stride` apart; zeros where the
// index is below 0 (a code for each photo: Bojanowski et al. 2018).
template <class T>
std::vector<T> table_row(const std::vector<T>& table, size_t columns, size_t stride, T index) {
  const double row = std::floor(static_cast<double>(real_part(index)));
  if (row < 0) return std::vector<T>(columns, T(0));
  return slice(table, static_cast<size_t>(row) * stride, columns);
}

}  // namespace nerf::reference
