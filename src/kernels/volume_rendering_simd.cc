#include <algorithm>
#include <cmath>

#include "nerf/kernels/elementwise.h"
#include "nerf/kernels/volume_rendering.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "kernels/volume_rendering_simd.cc"
// clang-format off: foreach_target.h must come first
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
#include "kernels/part_vectors-inl.h"
// clang-format on

HWY_BEFORE_NAMESPACE();
namespace nerf {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
using D = hn::CappedTag<double, 8>;
using DF = hn::Rebind<float, D>;
using V = hn::Vec<D>;
using VF = hn::Vec<DF>;
constexpr int kLanes = static_cast<int>(hn::MaxLanes(D()));

HWY_INLINE V set(double value) { return hn::Set(D(), value); }
HWY_INLINE double sum(V v) { return hn::GetLane(hn::SumOfLanes(D(), v)); }

// The first n lanes, 0 in the others; nothing beyond them is touched.
HWY_INLINE VF load_floats(const float* p, int n) {
  const DF d;
  if (n >= kLanes) return hn::LoadU(d, p);
#if HWY_ARCH_X86 && HWY_TARGET <= HWY_AVX2
  return hn::MaskedLoad(hn::FirstN(d, static_cast<size_t>(n)), d, p);
#else
  HWY_ALIGN float some[kLanes] = {};
  std::copy_n(p, n, some);
  return hn::Load(d, some);
#endif
}
HWY_INLINE V load(const float* p, int n) { return hn::PromoteTo(D(), load_floats(p, n)); }

HWY_INLINE void store(V v, float* p, int n) { store_part(hn::DemoteTo(DF(), v), DF(), p, n); }

HWY_INLINE V load_lengths(const float* delta, int n) {
  const VF longest = hn::Set(DF(), kLongestInterval);
  return hn::PromoteTo(D(), hn::Min(load_floats(delta, n), longest));
}

// A vector whose lane i is lane i + kBy of v, and `fill` where there is none.
template <int kBy>
HWY_INLINE V shifted(V v, double fill) {
  const D d;
  const V moved = moved_lanes<kBy>(d, v);
  constexpr size_t kMoved = static_cast<size_t>(std::max(0, kLanes - (kBy < 0 ? -kBy : kBy)));
  if constexpr (kBy > 0) return hn::IfThenElse(hn::FirstN(d, kMoved), moved, hn::Set(d, fill));
  return hn::IfThenElse(hn::FirstN(d, kLanes - kMoved), hn::Set(d, fill), moved);
}

// Lane i: the product of lanes 0 to i.
HWY_INLINE V products_up_to(V v) {
  if constexpr (kLanes > 1) v = hn::Mul(v, shifted<-1>(v, 1));
  if constexpr (kLanes > 2) v = hn::Mul(v, shifted<-2>(v, 1));
  if constexpr (kLanes > 4) v = hn::Mul(v, shifted<-4>(v, 1));
  return v;
}

// Lane i: the sum of lanes i to the last.
HWY_INLINE V sums_from(V v) {
  if constexpr (kLanes > 1) v = hn::Add(v, shifted<1>(v, 0));
  if constexpr (kLanes > 2) v = hn::Add(v, shifted<2>(v, 0));
  if constexpr (kLanes > 4) v = hn::Add(v, shifted<4>(v, 0));
  return v;
}

HWY_INLINE V first_lane(V v) { return hn::Set(D(), hn::GetLane(v)); }
HWY_INLINE V last_lane(V v) {
  return hn::Set(D(), hn::ExtractLane(v, static_cast<size_t>(kLanes - 1)));
}

// body(i, n, weights before they are rounded) for n samples from i on. The light that is left.
template <class Body>
HWY_INLINE double weights_of_ray(int begin, int end, float* w, const Body& body) {
  V t = set(1);
  for (int i = begin; i < end; i += kLanes) {
    const int n = end - i;
    const V alpha = load(w + i, n);
    const V through = products_up_to(hn::Sub(set(1), alpha));
    const V weight = hn::Mul(hn::Mul(t, shifted<-1>(through, 1)), alpha);
    store(weight, w + i, n);
    body(i, n, weight);
    t = hn::Mul(t, last_lane(through));
  }
  return hn::GetLane(t);
}

// From the optical depth, so that it does not drift.
HWY_INLINE double light_through(const float* density, const float* delta, int begin, int end) {
  V depth = set(0);
  for (int i = begin; i < end; i += kLanes)
    depth = hn::MulAdd(load(density + i, end - i), load_lengths(delta + i, end - i), depth);
  return std::exp(-sum(depth));
}

// With `t` the light that leaves the last sample, `behind` what all behind it adds to the loss and
// gradient(i, n, weights) the loss's derivatives by the weights of n samples from i on.
template <class Gradient>
HWY_INLINE void density_gradients(const float* w, const float* delta, int begin, int end, double t,
                                  double behind, const Gradient& gradient, float* d_density) {
  V light = set(t), back = set(behind);
  for (int i = begin + (end - begin - 1) / kLanes * kLanes; i >= begin && end > begin;
       i -= kLanes) {
    const int n = end - i;
    const V weight = load(w + i, n);
    const V g = gradient(i, n, weight);
    const V seen = sums_from(hn::Mul(weight, g)), stopped = sums_from(weight);
    const V leaving = hn::Min(set(1), hn::Add(light, shifted<1>(stopped, 0)));
    const V slope = hn::Sub(hn::Mul(leaving, g), hn::Add(back, shifted<1>(seen, 0)));
    store(hn::Mul(load_lengths(delta + i, n), slope), d_density + i, n);
    back = hn::Add(back, first_lane(seen));
    light = hn::Min(set(1), hn::Add(light, first_lane(stopped)));
  }
}

void weights_forward(RayRanges rays, bool opaque_end, float* w) {
  for (int r = 0; r < rays.count; ++r) {
    const int begin = rays.begin[r], end = rays.begin[r + 1];
    if (opaque_end && end > begin) w[end - 1] = 1;
    weights_of_ray(begin, end, w, [](int, int, V) {});
  }
}

void weights_backward(RayRanges rays, bool opaque_end, const float* density, const float* delta,
                      const float* w, const float* dw, float* d_density) {
  for (int r = 0; r < rays.count; ++r) {
    const int begin = rays.begin[r];
    int end = rays.begin[r + 1];
    if (end == begin) continue;
    double t = 0, behind = 0;
    if (opaque_end) {  // the last sample is the end itself
      --end;
      d_density[end] = 0;
      t = static_cast<double>(w[end]);
      behind = t * static_cast<double>(dw[end]);
    } else {
      t = light_through(density, delta, begin, end);
    }
    density_gradients(
        w, delta, begin, end, t, behind, [&](int i, int n, V) { return load(dw + i, n); },
        d_density);
  }
}

void forward(RayRanges rays, float* w, ColourRows<const float> colour,
             ColourRows<const float> background, ColourRows<float> pixel) {
  for (int r = 0; r < rays.count; ++r) {
    V red = set(0), green = set(0), blue = set(0);
    const double t =
        weights_of_ray(rays.begin[r], rays.begin[r + 1], w, [&](int i, int n, V weight) {
          red = hn::MulAdd(weight, load(colour.row(0) + i, n), red);
          green = hn::MulAdd(weight, load(colour.row(1) + i, n), green);
          blue = hn::MulAdd(weight, load(colour.row(2) + i, n), blue);
        });
    const double sums[3] = {sum(red), sum(green), sum(blue)};
    for (int k = 0; k < 3; ++k)
      pixel.row(k)[r] = static_cast<float>(sums[k] + t * background.row(k)[r]);
    pixel.row(3)[r] = static_cast<float>(1 - t);
  }
}

void backward(RayRanges rays, const float* density, const float* delta, const float* w,
              ColourRows<const float> colour, ColourRows<const float> background,
              ColourRows<const float> d_pixel, float* d_density, ColourRows<float> d_colour) {
  for (int r = 0; r < rays.count; ++r) {
    const int begin = rays.begin[r], end = rays.begin[r + 1];
    double g[4], behind = 0;
    for (int k = 0; k < 4; ++k) g[k] = static_cast<double>(d_pixel.row(k)[r]);
    const double t = light_through(density, delta, begin, end);
    for (int k = 0; k < 3; ++k) behind += t * g[k] * static_cast<double>(background.row(k)[r]);
    density_gradients(
        w, delta, begin, end, t, behind,
        [&](int i, int n, V weight) {
          V toward = set(g[3]);
          for (int k = 0; k < 3; ++k) {
            toward = hn::MulAdd(load(colour.row(k) + i, n), set(g[k]), toward);
            store(hn::Mul(weight, set(g[k])), d_colour.row(k) + i, n);
          }
          return toward;
        },
        d_density);
  }
}

void blend_forward(RayRanges rays, const float* w, ColourRows<const float> colour,
                   ColourRows<const float> background, ColourRows<float> pixel) {
  for (int r = 0; r < rays.count; ++r) {
    V red = set(0), green = set(0), blue = set(0), all = set(0);
    const int end = rays.begin[r + 1];
    for (int i = rays.begin[r]; i < end; i += kLanes) {
      const int n = end - i;
      const V weight = load(w + i, n);
      red = hn::MulAdd(weight, load(colour.row(0) + i, n), red);
      green = hn::MulAdd(weight, load(colour.row(1) + i, n), green);
      blue = hn::MulAdd(weight, load(colour.row(2) + i, n), blue);
      all = hn::Add(all, weight);
    }
    const double sums[3] = {sum(red), sum(green), sum(blue)}, opacity = sum(all);
    for (int k = 0; k < 3; ++k)
      pixel.row(k)[r] = static_cast<float>(sums[k] + (1 - opacity) * background.row(k)[r]);
    pixel.row(3)[r] = static_cast<float>(opacity);
  }
}

void blend_backward(RayRanges rays, const float* w, ColourRows<const float> colour,
                    ColourRows<const float> background, ColourRows<const float> d_pixel, float* dw,
                    ColourRows<float> d_colour) {
  for (int r = 0; r < rays.count; ++r) {
    double g[3], rest = static_cast<double>(d_pixel.row(3)[r]);
    for (int k = 0; k < 3; ++k) {
      g[k] = static_cast<double>(d_pixel.row(k)[r]);
      rest -= g[k] * static_cast<double>(background.row(k)[r]);
    }
    const int end = rays.begin[r + 1];
    for (int i = rays.begin[r]; i < end; i += kLanes) {
      const int n = end - i;
      if (dw) {
        V toward = set(rest);
        for (int k = 0; k < 3; ++k)
          toward = hn::MulAdd(load(colour.row(k) + i, n), set(g[k]), toward);
        store(hn::Add(load(dw + i, n), toward), dw + i, n);
      }
      if (d_colour.data) {
        const V weight = load(w + i, n);
        for (int k = 0; k < 3; ++k) store(hn::Mul(weight, set(g[k])), d_colour.row(k) + i, n);
      }
    }
  }
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace nerf
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace nerf {
HWY_EXPORT(weights_forward);
HWY_EXPORT(weights_backward);
HWY_EXPORT(forward);
HWY_EXPORT(backward);
HWY_EXPORT(blend_forward);
HWY_EXPORT(blend_backward);

void render_weights_forward(RayRanges rays, bool opaque_end, float* w) {
  HWY_DYNAMIC_DISPATCH(weights_forward)(rays, opaque_end, w);
}
void render_weights_backward(RayRanges rays, bool opaque_end, const float* density,
                             const float* delta, const float* w, const float* dw,
                             float* d_density) {
  HWY_DYNAMIC_DISPATCH(weights_backward)(rays, opaque_end, density, delta, w, dw, d_density);
}
void composite_forward(RayRanges rays, float* w, ColourRows<const float> colour,
                       ColourRows<const float> background, ColourRows<float> pixel) {
  HWY_DYNAMIC_DISPATCH(forward)(rays, w, colour, background, pixel);
}
void composite_backward(RayRanges rays, const float* density, const float* delta, const float* w,
                        ColourRows<const float> colour, ColourRows<const float> background,
                        ColourRows<const float> d_pixel, float* d_density,
                        ColourRows<float> d_colour) {
  HWY_DYNAMIC_DISPATCH(backward)
  (rays, density, delta, w, colour, background, d_pixel, d_density, d_colour);
}
void accumulate_forward(RayRanges rays, const float* w, ColourRows<const float> colour,
                        ColourRows<const float> background, ColourRows<float> pixel) {
  HWY_DYNAMIC_DISPATCH(blend_forward)(rays, w, colour, background, pixel);
}
void accumulate_backward(RayRanges rays, const float* w, ColourRows<const float> colour,
                         ColourRows<const float> background, ColourRows<const float> d_pixel,
                         float* dw, ColourRows<float> d_colour) {
  HWY_DYNAMIC_DISPATCH(blend_backward)(rays, w, colour, background, d_pixel, dw, d_colour);
}
}  // namespace nerf
#endif
