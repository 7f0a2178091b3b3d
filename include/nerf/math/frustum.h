// A stretch of a cone or cylinder around a ray, as a Gaussian (Barron et al. 2021, section 3.1).
#pragma once

#include <algorithm>

namespace nerf {

// Along the ray o + t d, in units of t: mean and variance of t, and variance across the ray in
// units of the input's. The Gaussian in space has mean o + t_mean d and covariance t_variance d d^T
// + r_variance (I - d d^T / |d|^2) (equation 16).
template <class T>
struct RayGaussian {
  T t_mean, t_variance, r_variance;
};

// The stretch between t0 and t1 of a cone whose radius is `radius` at t = 1 (equation 7), in the
// form of CamP's code, whose terms do not cancel: s = t0 + t1, d = t1 - t0, q = d^2 / (3 s^2 +
// d^2).
template <class T>
RayGaussian<T> cone_gaussian(T t0, T t1, T radius) {
  const T s = t0 + t1, d = t1 - t0;
  const T ratio = s != T(0) ? d / s : T(0);  // squares alone could overflow
  const T q = s != T(0) ? ratio * ratio / (T(3) + ratio * ratio) : T(1);
  const T d2 = d * d;
  const T r2 = radius * radius;
  return {s * (T(0.5) + q), d2 / T(12) - q * q * (T(12) * s * s - d2) / T(15),
          r2 * (s * s / T(16) + d2 * (T(5) / T(48) - q / T(15)))};
}

// The stretch between t0 and t1 of a cylinder of this radius (for rays in normalised device
// coordinates).
template <class T>
RayGaussian<T> cylinder_gaussian(T t0, T t1, T radius) {
  const T d = t1 - t0;
  return {T(0.5) * (t0 + t1), d * d / T(12), radius * radius / T(4)};
}

}  // namespace nerf
