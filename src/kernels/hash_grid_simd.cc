#include "nerf/kernels/hash_grid.h"
#include "nerf/kernels/linear.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "kernels/hash_grid_simd.cc"
// clang-format off: foreach_target.h must come first
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
#include "kernels/hash_grid_corners-inl.h"
// clang-format on

HWY_BEFORE_NAMESPACE();
namespace nerf {
namespace HWY_NAMESPACE {
namespace {

// The features of sample i of a group.
template <bool kDense, int F, class T>
HWY_INLINE hn::Vec<Row<F>> interpolate(const Corners& c, int i, const T* HWY_RESTRICT table) {
  const Row<F> d;
  constexpr hn::CappedTag<float, 2 * F> pair;
  constexpr int kShift = F == 4 ? 2 : 1;
  auto low = hn::Zero(d), high = hn::Zero(d);
  if constexpr (kDense && hn::MaxLanes(pair) == 2 * F) {
    auto both = hn::Zero(pair);  // the rows of a pair are neighbours
    for (int k = 0; k < 4; ++k)
      both =
          hn::MulAdd(hn::Set(pair, c.weight[k][i]), load_features(pair, table + c.low[k][i]), both);
    low = hn::LowerHalf(d, both);
    high = hn::UpperHalf(d, both);
  } else {
    for (int k = 0; k < 4; ++k) {
      const auto weight = hn::Set(d, c.weight[k][i]);
      low = hn::MulAdd(weight, load_features(d, table + c.low[k][i]), low);
      high = hn::MulAdd(weight, load_features(d, table + high_row<kDense, kShift>(c, k, i)), high);
    }
  }
  high = hn::Mul(hn::Set(d, c.far[i]), high);
  return hn::MulAdd(hn::Set(d, c.near[i]), low, high);
}

template <bool kDense, int F, class T>
void forward_level(const HashGridLevel& level, const T* HWY_RESTRICT table, const float* x,
                   const float* y, const float* z, int64_t n, float* HWY_RESTRICT features,
                   int64_t ld) {
  const hn::CappedTag<float, 4> d4;
  constexpr int kShift = F == 4 ? 2 : 1;
  each_group<kDense, kShift>(level, table, x, y, z, n, [&](const Corners& c, int64_t s) HWY_ATTR {
    for (int i = 0; i < kGroup; i += 4) {
      float* to = features + s + i;
      const auto a = interpolate<kDense, F>(c, i, table);
      const auto b = interpolate<kDense, F>(c, i + 1, table);
      const auto e = interpolate<kDense, F>(c, i + 2, table);
      const auto f = interpolate<kDense, F>(c, i + 3, table);
      if constexpr (F == 4) {
        alignas(64) float rows[4 * F];
        hn::Store(a, d4, rows);
        hn::Store(b, d4, rows + F);
        hn::Store(e, d4, rows + 2 * F);
        hn::Store(f, d4, rows + 3 * F);
        hn::Vec<decltype(d4)> f0, f1, f2, f3;
        hn::LoadInterleaved4(d4, rows, f0, f1, f2, f3);
        hn::StoreU(f0, d4, to);
        hn::StoreU(f1, d4, to + ld);
        hn::StoreU(f2, d4, to + 2 * ld);
        hn::StoreU(f3, d4, to + 3 * ld);
      } else {
        // Not by way of memory: a load waits for two smaller stores until both are through.
        const auto ab = hn::Combine(d4, b, a), ef = hn::Combine(d4, f, e);
        hn::StoreU(hn::ConcatEven(d4, ef, ab), d4, to);
        hn::StoreU(hn::ConcatOdd(d4, ef, ab), d4, to + ld);
      }
    }
  });
}

template <bool kDense, int F>
void backward_level(const HashGridLevel& level, const float* x, const float* y, const float* z,
                    int64_t n, const float* HWY_RESTRICT df, int64_t ld,
                    float* HWY_RESTRICT gradient, uint8_t* HWY_RESTRICT marks) {
  const Row<F> d;
  const hn::CappedTag<float, 4> d4;
  constexpr int kShift = F == 4 ? 2 : 1;
  const auto add = [&](size_t at, hn::Vec<Row<F>> weight, hn::Vec<Row<F>> x) HWY_ATTR {
    hn::Store(hn::MulAdd(weight, x, hn::Load(d, gradient + at)), d, gradient + at);
    marks[at >> kShift] = 1;
  };
  each_group<kDense, kShift>(
      level, gradient, x, y, z, n, [&](const Corners& c, int64_t s) HWY_ATTR {
        alignas(64) float g[kGroup * F];
        for (int h = 0; h < kGroup; h += 4) {
          const float* from = df + s + h;
          if constexpr (F == 4)
            hn::StoreInterleaved4(hn::LoadU(d4, from), hn::LoadU(d4, from + ld),
                                  hn::LoadU(d4, from + 2 * ld), hn::LoadU(d4, from + 3 * ld), d4,
                                  g + h * F);
          else
            hn::StoreInterleaved2(hn::LoadU(d4, from), hn::LoadU(d4, from + ld), d4, g + h * F);
        }
        for (int i = 0; i < kGroup; ++i) {
          const auto gi = hn::Load(d, g + i * F);
          if (hn::AllTrue(d, hn::Eq(gi, hn::Zero(d)))) continue;
          const auto low = hn::Mul(hn::Set(d, c.near[i]), gi),
                     high = hn::Mul(hn::Set(d, c.far[i]), gi);
          for (int k = 0; k < 4; ++k) {
            const auto weight = hn::Set(d, c.weight[k][i]);
            add(c.low[k][i], weight, low);
            add(high_row<kDense, kShift>(c, k, i), weight, high);
          }
        }
      });
}

template <class T>
void forward(const HashGridLevel& level, const T* table, const float* x, const float* y,
             const float* z, int64_t n, float* features, int64_t ld) {
  if (n <= 0) return;
  const auto run = level.features == 4
                       ? level.dense ? forward_level<true, 4, T> : forward_level<false, 4, T>
                   : level.dense ? forward_level<true, 2, T>
                                 : forward_level<false, 2, T>;
  run(level, table, x, y, z, n, features, ld);
}

void forward_f32(const HashGridLevel& level, const float* table, const float* x, const float* y,
                 const float* z, int64_t n, float* features, int64_t ld) {
  forward(level, table, x, y, z, n, features, ld);
}

void forward_half(const HashGridLevel& level, const uint16_t* table, const float* x, const float* y,
                  const float* z, int64_t n, float* features, int64_t ld) {
  forward(level, table, x, y, z, n, features, ld);
}

void backward(const HashGridLevel& level, const float* x, const float* y, const float* z, int64_t n,
              const float* df, int64_t ld, float* gradient, uint8_t* marks) {
  if (n <= 0) return;
  const auto run = level.features == 4
                       ? level.dense ? backward_level<true, 4> : backward_level<false, 4>
                   : level.dense ? backward_level<true, 2>
                                 : backward_level<false, 2>;
  run(level, x, y, z, n, df, ld, gradient, marks);
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace nerf
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace nerf {
HWY_EXPORT(forward_f32);
HWY_EXPORT(forward_half);
HWY_EXPORT(backward);

void hash_grid_forward(const HashGridLevel& level, const float* table, const float* x,
                       const float* y, const float* z, int64_t n, float* features, int64_t ld) {
  HWY_DYNAMIC_DISPATCH(forward_f32)(level, table, x, y, z, n, features, ld);
}
void hash_grid_forward(const HashGridLevel& level, const uint16_t* table, const float* x,
                       const float* y, const float* z, int64_t n, float* features, int64_t ld) {
  HWY_DYNAMIC_DISPATCH(forward_half)(level, table, x, y, z, n, features, ld);
}
void hash_grid_backward(const HashGridLevel& level, const float* x, const float* y, const float* z,
                        int64_t n, const float* d_features, int64_t ld, float* gradient,
                        uint8_t* marks) {
  HWY_DYNAMIC_DISPATCH(backward)(level, x, y, z, n, d_features, ld, gradient, marks);
}
}  // namespace nerf
#endif
