// Points that stand for a stretch of a pixel's cone (Barron et al. 2023, section 3.1; the form of
// the authors' code): their mean along the ray and their variances are the frustum's.
#pragma once

#include <array>
#include <cmath>

namespace nerf {

inline constexpr int kConePoints = 6;

// A point of the stretch: `along` from its middle, then across the ray, `across` in the direction
// cosine e1 + sine e2 of two axes that stand on it.
template <class T>
struct ConePoint {
  T along, across, cosine, sine;
};

// Points of a stretch of a cone with this radius at distance 1. The stretch ends `half` before and
// behind its middle, which is `distance` from the apex (half <= distance, distance > 0). The points
// wind around the ray, the other way round when `reversed`, turned by the angle whose cosine and
// sine are given.
template <class T>
std::array<ConePoint<T>, kConePoints> cone_points(T distance, T half, T radius, bool reversed,
                                                  T cosine, T sine) {
  constexpr int kTurns[kConePoints] = {0, 2, 4, 3, 5, 1};  // sixths of a circle
  // With the ratio q = half / distance: the authors' t_j less the middle, without large squares.
  const T q = half / distance, one_less = q * q - T(1);
  const T width = T(3) / std::sqrt(T(7)) * std::sqrt(one_less * one_less + T(4));
  const T root3 = std::sqrt(T(3)) / T(2);
  const T cosines[6] = {T(1), T(0.5), T(-0.5), T(-1), T(-0.5), T(0.5)};
  const T sines[6] = {T(0), root3, root3, T(0), -root3, -root3};
  std::array<ConePoint<T>, kConePoints> out;
  for (int j = 0; j < kConePoints; ++j) {
    ConePoint<T>& p = out[static_cast<size_t>(j)];
    const T step = T(2 * j) / T(kConePoints - 1) - T(1);
    p.along = half / (T(3) + q * q) * (T(2) * q + step * width);
    p.across = std::sqrt(T(0.5)) * radius * (distance + p.along);
    const int turn = kTurns[reversed ? kConePoints - 1 - j : j];
    p.cosine = cosine * cosines[turn] - sine * sines[turn];
    p.sine = sine * cosines[turn] + cosine * sines[turn];
  }
  return out;
}

}  // namespace nerf
