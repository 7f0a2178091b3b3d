#include <algorithm>

#include "nerf/kernels/resampling.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "kernels/resampling_simd.cc"
// clang-format off: foreach_target.h must come first
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
#include <hwy/contrib/math/math-inl.h>
#include "kernels/part_vectors-inl.h"
// clang-format on

HWY_BEFORE_NAMESPACE();
namespace nerf {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
using D = hn::CappedTag<float, 16>;
using V = hn::Vec<D>;
constexpr size_t kLanes = hn::MaxLanes(D());

// The first n lanes; the others repeat the last of them.
HWY_INLINE V load_some(const float* p, size_t n) {
  const D d;
  if (n >= kLanes) return hn::LoadU(d, p);
  HWY_ALIGN float some[kLanes];
  for (size_t i = 0; i < kLanes; ++i) some[i] = p[std::min(i, n - 1)];
  return hn::Load(d, some);
}

HWY_INLINE void store_some(V v, float* p, size_t n) {
  store_part(v, D(), p, static_cast<int64_t>(n));
}

// values = body(values) for n of them
template <class Body>
HWY_INLINE void each(float* values, size_t n, const Body& body) {
  for (size_t i = 0; i < n; i += kLanes)
    store_some(body(load_some(values + i, n - i)), values + i, n - i);
}

HWY_INLINE float sum_of(const float* values, size_t n) {
  const D d;
  V sum = hn::Zero(d);
  size_t i = 0;
  for (; i + kLanes <= n; i += kLanes) sum = hn::Add(sum, hn::LoadU(d, values + i));
  float out = hn::GetLane(hn::SumOfLanes(d, sum));
  for (; i < n; ++i) out += values[i];
  return out;
}

void cdf_of(const float* weights, size_t n, float* cdf) {
  const float least = 1e-5f, sum = sum_of(weights, n);
  const float padding = sum < least ? (least - sum) / static_cast<float>(n) : 0.0f;
  // One after the other: sums in any other order may fall from one bin to the next.
  float below = 0;
  cdf[0] = 0;
  for (size_t i = 0; i < n; ++i) {
    below += weights[i] + padding;
    cdf[i + 1] = below;
  }
  const V total = hn::Set(D(), std::max(sum, least)), one = hn::Set(D(), 1.0f);
  each(cdf + 1, n, [&](V v) { return hn::Min(one, hn::Div(v, total)); });
  cdf[n] = 1;
}

void inverse(const float* edges, const float* cdf, size_t bins, const float* u, size_t n,
             float* out) {
  const D d;
  const V zero = hn::Zero(d), one = hn::Set(d, 1.0f);
  // Both are sorted: no bin that lies before all values of a vector has to be asked again.
  size_t bin = 0;
  for (size_t i = 0; i < n; i += kLanes) {
    const V at = load_some(u + i, n - i);
    const float last = u[std::min(i + kLanes, n) - 1];
    V low = hn::Set(d, cdf[bin]), high = hn::Set(d, cdf[bin + 1]);
    V begin = hn::Set(d, edges[bin]), end = hn::Set(d, edges[bin + 1]);
    while (bin + 1 < bins && !(last < cdf[bin + 1])) {
      ++bin;
      const V border = hn::Set(d, cdf[bin]);
      const auto behind = hn::Ge(at, border);
      low = hn::IfThenElse(behind, border, low);
      high = hn::IfThenElse(behind, hn::Set(d, cdf[bin + 1]), high);
      begin = hn::IfThenElse(behind, hn::Set(d, edges[bin]), begin);
      end = hn::IfThenElse(behind, hn::Set(d, edges[bin + 1]), end);
    }
    const V mass = hn::Sub(high, low);
    const auto some = hn::Gt(mass, zero);
    const V share = hn::IfThenElseZero(
        some, hn::Clamp(hn::Div(hn::Sub(at, low), hn::IfThenElse(some, mass, one)), zero, one));
    // Of the form that reproduces both edges exactly.
    const V between = hn::MulAdd(share, hn::Sub(end, begin), begin);
    store_some(hn::IfThenElse(hn::Eq(share, one), end, between), out + i, n - i);
  }
}

void anneal(const float* edges, const float* weights, size_t n, float exponent, float* out) {
  const D d;
  const V zero = hn::Zero(d), power = hn::Set(d, exponent);
  const V of_none = hn::Set(d, exponent == 0 ? 1.0f : 0.0f);
  for (size_t i = 0; i < n; i += kLanes) {
    const V w = load_some(weights + i, n - i);
    const auto open = hn::Gt(load_some(edges + i + 1, n - i), load_some(edges + i, n - i));
    V raised = w;
    if (exponent != 1) {
      // Highway's Exp is defined from -104 on, Log from the smallest normal number.
      const V log = hn::Log(d, hn::Max(w, hn::Set(d, 1.17549435e-38f)));
      raised = hn::Exp(d, hn::Clamp(hn::Mul(power, log), hn::Set(d, -100.0f), hn::Set(d, 88.0f)));
    }
    const V value = hn::IfThenElse(hn::Gt(w, zero), raised, of_none);
    store_some(hn::IfThenElseZero(open, value), out + i, n - i);
  }
  const float sum = sum_of(out, n);
  if (sum > 0) each(out, n, [&](V v) { return hn::Div(v, hn::Set(D(), sum)); });
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace nerf
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace nerf {
HWY_EXPORT(cdf_of);
HWY_EXPORT(inverse);
HWY_EXPORT(anneal);

void histogram_cdf(std::span<const float> weights, std::span<float> cdf) {
  HWY_DYNAMIC_DISPATCH(cdf_of)(weights.data(), weights.size(), cdf.data());
}
void histogram_inverse(std::span<const float> edges, std::span<const float> cdf,
                       std::span<const float> u, std::span<float> out) {
  HWY_DYNAMIC_DISPATCH(inverse)
  (edges.data(), cdf.data(), edges.size() - 1, u.data(), u.size(), out.data());
}
void histogram_anneal(std::span<const float> edges, std::span<const float> weights, float exponent,
                      std::span<float> out) {
  HWY_DYNAMIC_DISPATCH(anneal)
  (edges.data(), weights.data(), weights.size(), exponent, out.data());
}
}  // namespace nerf
#endif
