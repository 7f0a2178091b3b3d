// Light along rays, forward and backward (Mildenhall et al. 2020, equation 3), for many rays at
// once:
//
//   w_i = T_i alpha_i,   T_i = prod_{j<i} (1 - alpha_j),   alpha_i = 1 - exp(-density_i delta_i)
//
// Products and sums along a ray are made in double: 1 - alpha in float is off by half a unit in the
// last place of 1, always the same way where samples are alike, and a million of them lose or gain
// percents of the light. Rows of samples and of rays may begin anywhere; what belongs to no ray is
// neither read nor written.
#pragma once

#include <cstdint>

#include "nerf/base/real.h"

namespace nerf {

// Ray r has the samples begin[r] to begin[r + 1], from front to back.
struct RayRanges {
  const int32_t* begin;  // count + 1 of them, never falling
  int count;
};

// The colours of samples or of rays: three rows, `stride` apart.
template <class T>
struct ColourRows {
  T* data;
  int64_t stride;
  T* row(int k) const { return data + k * stride; }
};

// Turns opacities into weights, in place. With `opaque_end` a ray's last sample takes all light
// that reaches it, whatever its opacity.
void render_weights_forward(RayRanges rays, bool opaque_end, Real* w);

// Derivatives by density, from the weights and the loss's derivatives dw by them:
//   d_density_i = delta_i (T_{i+1} dw_i - sum_{j>i} w_j dw_j)
// since more of sample i is seen and less of what is behind it. 0 for an opaque end. A length delta
// beyond kLongestInterval (elementwise.h) counts as that.
void render_weights_backward(RayRanges rays, bool opaque_end, const Real* density,
                             const Real* delta, const Real* w, const Real* dw, Real* d_density);

// Turns opacities into weights, in place, and blends the samples' colours over the background:
//   pixel = sum_i w_i colour_i + T_n background
// with the opacity 1 - T_n in a fourth row of the pixels.
void composite_forward(RayRanges rays, Real* w, ColourRows<const Real> colour,
                       ColourRows<const Real> background, ColourRows<Real> pixel);

// Finds derivatives from those by the four rows of pixels. The opacity behaves as a fourth colour
// of 1 over a background of 0; what is behind a sample ends in the background.
void composite_backward(RayRanges rays, const Real* density, const Real* delta, const Real* w,
                        ColourRows<const Real> colour, ColourRows<const Real> background,
                        ColourRows<const Real> d_pixel, Real* d_density, ColourRows<Real> d_colour);

// composite_forward() from weights that stay as they are; the light that is left is 1 less their
// sum.
void accumulate_forward(RayRanges rays, const Real* w, ColourRows<const Real> colour,
                        ColourRows<const Real> background, ColourRows<Real> pixel);

// Adds to dw, and sets d_colour; either may be null.
void accumulate_backward(RayRanges rays, const Real* w, ColourRows<const Real> colour,
                         ColourRows<const Real> background, ColourRows<const Real> d_pixel,
                         Real* dw, ColourRows<Real> d_colour);

}  // namespace nerf
