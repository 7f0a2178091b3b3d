// Sine and cosine features of one coordinate at one frequency: what frequency encoding (Mildenhall
// et al. 2020, equation 4), its windowed form (Park et al. 2021, equation 8) and integrated
// encoding (Barron et al. 2021, equation 14) are made of; and spherical harmonics of directions.
#pragma once

#include <cstdint>

#include "nerf/base/real.h"

namespace nerf {

// With a = weight exp(-frequency^2 variance / 2):
//   sine[i] = a_i sin(frequency x_i),  cosine[i] = a_i cos(frequency x_i).
// variance may be null (0 everywhere) and is at least 0. frequency is a power of two, so that the
// argument is exact; both results are then within 2 units in the last place of `a` at any finite
// argument. Vectors with an argument beyond 2^20 in them take a slower way, which may differ in the
// last place. n is rounded up to kLane (linear.h); pointers are aligned to 64 bytes.
void sine_cosine_forward(int64_t n, const Real* x, const Real* variance, Real frequency,
                         Real weight, Real* sine, Real* cosine);

// Adds to dx and, unless null, to dvariance what the gradients of both features leave there. Needs
// the features, not the arguments:
//   dx += frequency (cosine d_sine - sine d_cosine)
//   dvariance -= frequency^2 / 2 (sine d_sine + cosine d_cosine)
void sine_cosine_backward(int64_t n, const Real* sine, const Real* cosine, const Real* d_sine,
                          const Real* d_cosine, Real frequency, Real* dx, Real* dvariance);

// Real spherical harmonics of degree 0 to 3, in the order and with the signs of their template in
// math/reference, of unit directions. direction: 3 rows, `direction_stride` apart; code: 16 rows,
// `code_stride` apart. n is rounded up to kLane; rows are aligned to 64 bytes.
inline constexpr int kSphericalHarmonics = 16;
void spherical_harmonics(int64_t n, const Real* direction, int64_t direction_stride, Real* code,
                         int64_t code_stride);

}  // namespace nerf
