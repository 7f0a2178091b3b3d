#include "nerf/kernels/volume_rendering.h"

#include <algorithm>
#include <cmath>

#include "nerf/kernels/elementwise.h"

namespace nerf {
namespace {

double interval_length(Real delta) {
  return static_cast<double>(std::min(delta, kLongestInterval));
}

// body(i, weight before it is rounded). The light that is left.
template <class Body>
double weights_of_ray(int begin, int end, Real* w, const Body& body) {
  double t = 1;
  for (int i = begin; i < end; ++i) {
    const double alpha = w[i], weight = t * alpha;
    w[i] = static_cast<Real>(weight);
    body(i, weight);
    t *= 1 - alpha;
  }
  return t;
}

// From the optical depth, so that it does not drift.
double light_through(const Real* density, const Real* delta, int begin, int end) {
  double depth = 0;
  for (int i = begin; i < end; ++i)
    depth += static_cast<double>(density[i]) * interval_length(delta[i]);
  return std::exp(-depth);
}

// With `t` the light that leaves the last sample, `behind` what all behind it adds to the loss and
// gradient(i) the loss's derivative by weight i.
template <class Gradient>
void density_gradients(const Real* w, const Real* delta, int begin, int end, double t,
                       double behind, const Gradient& gradient, Real* d_density) {
  for (int i = end; i-- > begin;) {
    const double g = gradient(i), weight = static_cast<double>(w[i]);
    d_density[i] = static_cast<Real>(interval_length(delta[i]) * (t * g - behind));
    behind += weight * g;
    t = std::min(1.0, t + weight);
  }
}

}  // namespace

void render_weights_forward(RayRanges rays, bool opaque_end, Real* w) {
  for (int r = 0; r < rays.count; ++r) {
    const int begin = rays.begin[r], end = rays.begin[r + 1];
    if (opaque_end && end > begin) w[end - 1] = 1;
    weights_of_ray(begin, end, w, [](int, double) {});
  }
}

void render_weights_backward(RayRanges rays, bool opaque_end, const Real* density,
                             const Real* delta, const Real* w, const Real* dw, Real* d_density) {
  for (int r = 0; r < rays.count; ++r) {
    const int begin = rays.begin[r];
    int end = rays.begin[r + 1];
    if (end == begin) continue;
    const auto gradient = [&](int i) { return static_cast<double>(dw[i]); };
    double t = 0, behind = 0;
    if (opaque_end) {  // the last sample is the end itself
      --end;
      d_density[end] = 0;
      t = static_cast<double>(w[end]);
      behind = t * gradient(end);
    } else {
      t = light_through(density, delta, begin, end);
    }
    density_gradients(w, delta, begin, end, t, behind, gradient, d_density);
  }
}

void composite_forward(RayRanges rays, Real* w, ColourRows<const Real> colour,
                       ColourRows<const Real> background, ColourRows<Real> pixel) {
  for (int r = 0; r < rays.count; ++r) {
    double sums[3] = {0, 0, 0};
    const double t = weights_of_ray(rays.begin[r], rays.begin[r + 1], w, [&](int i, double weight) {
      for (int k = 0; k < 3; ++k) sums[k] += weight * colour.row(k)[i];
    });
    for (int k = 0; k < 3; ++k)
      pixel.row(k)[r] = static_cast<Real>(sums[k] + t * background.row(k)[r]);
    pixel.row(3)[r] = static_cast<Real>(1 - t);
  }
}

void composite_backward(RayRanges rays, const Real* density, const Real* delta, const Real* w,
                        ColourRows<const Real> colour, ColourRows<const Real> background,
                        ColourRows<const Real> d_pixel, Real* d_density,
                        ColourRows<Real> d_colour) {
  for (int r = 0; r < rays.count; ++r) {
    const int begin = rays.begin[r], end = rays.begin[r + 1];
    double g[4], behind = 0;
    for (int k = 0; k < 4; ++k) g[k] = d_pixel.row(k)[r];
    const double t = light_through(density, delta, begin, end);
    for (int k = 0; k < 3; ++k) behind += t * g[k] * background.row(k)[r];
    const auto toward = [&](int i) {
      return colour.row(0)[i] * g[0] + colour.row(1)[i] * g[1] + colour.row(2)[i] * g[2] + g[3];
    };
    density_gradients(w, delta, begin, end, t, behind, toward, d_density);
    for (int k = 0; k < 3; ++k)
      for (int i = begin; i < end; ++i) d_colour.row(k)[i] = static_cast<Real>(w[i] * g[k]);
  }
}

void accumulate_forward(RayRanges rays, const Real* w, ColourRows<const Real> colour,
                        ColourRows<const Real> background, ColourRows<Real> pixel) {
  for (int r = 0; r < rays.count; ++r) {
    double sums[3] = {0, 0, 0}, opacity = 0;
    for (int i = rays.begin[r]; i < rays.begin[r + 1]; ++i) {
      const double weight = w[i];
      for (int k = 0; k < 3; ++k) sums[k] += weight * colour.row(k)[i];
      opacity += weight;
    }
    for (int k = 0; k < 3; ++k)
      pixel.row(k)[r] = static_cast<Real>(sums[k] + (1 - opacity) * background.row(k)[r]);
    pixel.row(3)[r] = static_cast<Real>(opacity);
  }
}

void accumulate_backward(RayRanges rays, const Real* w, ColourRows<const Real> colour,
                         ColourRows<const Real> background, ColourRows<const Real> d_pixel,
                         Real* dw, ColourRows<Real> d_colour) {
  for (int r = 0; r < rays.count; ++r) {
    double g[3], rest = d_pixel.row(3)[r];
    for (int k = 0; k < 3; ++k) {
      g[k] = d_pixel.row(k)[r];
      rest -= g[k] * background.row(k)[r];
    }
    for (int i = rays.begin[r]; i < rays.begin[r + 1]; ++i) {
      if (dw)
        dw[i] += static_cast<Real>(g[0] * colour.row(0)[i] + g[1] * colour.row(1)[i] +
                                   g[2] * colour.row(2)[i] + rest);
      if (d_colour.data)
        for (int k = 0; k < 3; ++k) d_colour.row(k)[i] = static_cast<Real>(w[i] * g[k]);
    }
  }
}

}  // namespace nerf
