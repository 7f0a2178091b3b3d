#include "nerf/kernels/hash_grid.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "kernels/hash_grid_position_simd.cc"
// clang-format off: foreach_target.h must come first
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
#include "kernels/hash_grid_corners-inl.h"
// clang-format on

HWY_BEFORE_NAMESPACE();
namespace nerf {
namespace HWY_NAMESPACE {
namespace {

// Of a group: the products of each corner's row with the gradient of the features, in the order of
// Corners.
struct Products {
  alignas(64) float low[4][kGroup];
  alignas(64) float high[4][kGroup];
};

// The rows of both corners of pair k of sample i, side by side.
template <bool kDense, int F, class T>
HWY_INLINE hn::Vec<hn::CappedTag<float, 2 * F>> load_pair(const Corners& c, int k, int i,
                                                          const T* HWY_RESTRICT table) {
  const hn::CappedTag<float, 2 * F> pair;
  if constexpr (kDense) {
    return load_features(pair, table + c.low[k][i]);
  } else {
    const auto low = hn::LoadU(hn::Rebind<T, Row<F>>(), table + c.low[k][i]);
    const auto high = hn::LoadU(hn::Rebind<T, Row<F>>(), table + c.high[k][i]);
    return to_floats(pair, hn::Combine(hn::Rebind<T, decltype(pair)>(), high, low));
  }
}

// In each block of four the sums of four vectors' blocks.
template <class D, class V = hn::Vec<D>>
HWY_INLINE V sums_of_blocks(D d, V a, V b, V c, V e) {
  const hn::Repartition<uint64_t, D> twos;
  const auto ab =
      hn::BitCast(twos, hn::Add(hn::InterleaveLower(d, a, b), hn::InterleaveUpper(d, a, b)));
  const auto ce =
      hn::BitCast(twos, hn::Add(hn::InterleaveLower(d, c, e), hn::InterleaveUpper(d, c, e)));
  return hn::Add(hn::BitCast(d, hn::InterleaveLower(twos, ab, ce)),
                 hn::BitCast(d, hn::InterleaveUpper(twos, ab, ce)));
}

// Products of samples i to i + 3. g: the gradient of each sample's features, four numbers; of two
// features twice.
template <bool kDense, int F, class T>
HWY_INLINE void multiply_rows(const Corners& c, int i, const T* HWY_RESTRICT table,
                              const float* HWY_RESTRICT g, Products& out) {
  const hn::CappedTag<float, 4> d4;
  const hn::CappedTag<float, 2 * F> pair;
  if constexpr (hn::MaxLanes(pair) == 2 * F) {
    const auto ga = hn::LoadDup128(pair, g), gb = hn::LoadDup128(pair, g + 4),
               gc = hn::LoadDup128(pair, g + 8), ge = hn::LoadDup128(pair, g + 12);
    for (int k = 0; k < 4; ++k) {
      const auto a = hn::Mul(ga, load_pair<kDense, F>(c, k, i, table));
      const auto b = hn::Mul(gb, load_pair<kDense, F>(c, k, i + 1, table));
      const auto e = hn::Mul(gc, load_pair<kDense, F>(c, k, i + 2, table));
      const auto f = hn::Mul(ge, load_pair<kDense, F>(c, k, i + 3, table));
      if constexpr (F == 4) {
        const auto sums = sums_of_blocks(pair, a, b, e, f);
        hn::Store(hn::LowerHalf(d4, sums), d4, out.low[k] + i);
        hn::Store(hn::UpperHalf(d4, sums), d4, out.high[k] + i);
      } else {
        // Of each sample two terms of the lower row, then two of the higher one.
        const auto even_ab = hn::ConcatEven(d4, b, a), odd_ab = hn::ConcatOdd(d4, b, a);
        const auto even_ef = hn::ConcatEven(d4, f, e), odd_ef = hn::ConcatOdd(d4, f, e);
        const auto ab = hn::Add(even_ab, odd_ab), ef = hn::Add(even_ef, odd_ef);
        hn::Store(hn::ConcatEven(d4, ef, ab), d4, out.low[k] + i);
        hn::Store(hn::ConcatOdd(d4, ef, ab), d4, out.high[k] + i);
      }
    }
  } else {  // vectors of a single row
    constexpr int kShift = F == 4 ? 2 : 1;
    const auto product = [&](size_t row, int j) HWY_ATTR {
      return hn::Mul(hn::Load(d4, g + 4 * j), load_features(d4, table + row));
    };
    for (int k = 0; k < 4; ++k) {
      hn::Store(sums_of_blocks(d4, product(c.low[k][i], 0), product(c.low[k][i + 1], 1),
                               product(c.low[k][i + 2], 2), product(c.low[k][i + 3], 3)),
                d4, out.low[k] + i);
      hn::Store(sums_of_blocks(d4, product(high_row<kDense, kShift>(c, k, i), 0),
                               product(high_row<kDense, kShift>(c, k, i + 1), 1),
                               product(high_row<kDense, kShift>(c, k, i + 2), 2),
                               product(high_row<kDense, kShift>(c, k, i + 3), 3)),
                d4, out.high[k] + i);
    }
  }
}

// Adds the gradient along one axis of kStep samples at p: nothing outside of (0, 1), where clamping
// holds the place.
HWY_INLINE void add_along(hn::Vec<DG> per_cell, float scale, const float* p, float* d_p) {
  const DG d;
  const auto at = hn::LoadU(d, p);
  const auto moves = hn::And(hn::Gt(at, hn::Zero(d)), hn::Lt(at, hn::Set(d, 1.0f)));
  const auto slope = hn::IfThenElseZero(moves, per_cell);
  hn::StoreU(hn::MulAdd(slope, hn::Set(d, scale), hn::LoadU(d, d_p)), d, d_p);
}

// Adds the gradient by position of a group, given its products: differences along one axis,
// interpolated along the other two.
HWY_INLINE void add_gradient(const Corners& c, const Products& products, float scale,
                             const float* x, const float* y, const float* z, float* dx, float* dy,
                             float* dz) {
  const DG d;
  for (int i = 0; i < kGroup; i += kStep) {
    const auto far_x = hn::Load(d, c.far + i), far_y = hn::Load(d, c.far_y + i),
               far_z = hn::Load(d, c.far_z + i);
    hn::Vec<DG> inside[4];  // of each pair, at the place's x
    auto along_x = hn::Zero(d);
    for (int k = 0; k < 4; ++k) {
      const auto low = hn::Load(d, products.low[k] + i);
      const auto difference = hn::Sub(hn::Load(d, products.high[k] + i), low);
      inside[k] = hn::MulAdd(far_x, difference, low);
      along_x = hn::MulAdd(hn::Load(d, c.weight[k] + i), difference, along_x);
    }
    const auto y0 = hn::Sub(inside[1], inside[0]), y1 = hn::Sub(inside[3], inside[2]);
    const auto z0 = hn::Sub(inside[2], inside[0]), z1 = hn::Sub(inside[3], inside[1]);
    add_along(along_x, scale, x + i, dx + i);
    add_along(hn::MulAdd(far_z, hn::Sub(y1, y0), y0), scale, y + i, dy + i);
    add_along(hn::MulAdd(far_y, hn::Sub(z1, z0), z0), scale, z + i, dz + i);
  }
}

template <bool kDense, int F, class T>
void position_level(const HashGridLevel& level, const T* HWY_RESTRICT table, const float* x,
                    const float* y, const float* z, int64_t n, const float* HWY_RESTRICT df,
                    int64_t ld, float* HWY_RESTRICT dx, float* HWY_RESTRICT dy,
                    float* HWY_RESTRICT dz) {
  const hn::CappedTag<float, 4> d4;
  constexpr int kShift = F == 4 ? 2 : 1;
  each_group<kDense, kShift>(level, table, x, y, z, n, [&](const Corners& c, int64_t s) HWY_ATTR {
    Products products;
    for (int i = 0; i < kGroup; i += 4) {
      alignas(64) float g[16];
      const float* from = df + s + i;
      const auto g0 = hn::LoadU(d4, from), g1 = hn::LoadU(d4, from + ld);
      if constexpr (F == 4)
        hn::StoreInterleaved4(g0, g1, hn::LoadU(d4, from + 2 * ld), hn::LoadU(d4, from + 3 * ld),
                              d4, g);
      else
        hn::StoreInterleaved4(g0, g1, g0, g1, d4, g);
      multiply_rows<kDense, F>(c, i, table, g, products);
    }
    add_gradient(c, products, level.scale, x + s, y + s, z + s, dx + s, dy + s, dz + s);
  });
}

template <class T>
void position(const HashGridLevel& level, const T* table, const float* x, const float* y,
              const float* z, int64_t n, const float* df, int64_t ld, float* dx, float* dy,
              float* dz) {
  if (n <= 0) return;
  const auto run = level.features == 4
                       ? level.dense ? position_level<true, 4, T> : position_level<false, 4, T>
                   : level.dense ? position_level<true, 2, T>
                                 : position_level<false, 2, T>;
  run(level, table, x, y, z, n, df, ld, dx, dy, dz);
}

void position_f32(const HashGridLevel& level, const float* table, const float* x, const float* y,
                  const float* z, int64_t n, const float* df, int64_t ld, float* dx, float* dy,
                  float* dz) {
  position(level, table, x, y, z, n, df, ld, dx, dy, dz);
}

void position_half(const HashGridLevel& level, const uint16_t* table, const float* x,
                   const float* y, const float* z, int64_t n, const float* df, int64_t ld,
                   float* dx, float* dy, float* dz) {
  position(level, table, x, y, z, n, df, ld, dx, dy, dz);
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace nerf
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace nerf {
HWY_EXPORT(position_f32);
HWY_EXPORT(position_half);

void hash_grid_position_backward(const HashGridLevel& level, const float* table, const float* x,
                                 const float* y, const float* z, int64_t n, const float* d_features,
                                 int64_t ld, float* dx, float* dy, float* dz) {
  HWY_DYNAMIC_DISPATCH(position_f32)(level, table, x, y, z, n, d_features, ld, dx, dy, dz);
}
void hash_grid_position_backward(const HashGridLevel& level, const uint16_t* table, const float* x,
                                 const float* y, const float* z, int64_t n, const float* d_features,
                                 int64_t ld, float* dx, float* dy, float* dz) {
  HWY_DYNAMIC_DISPATCH(position_half)(level, table, x, y, z, n, d_features, ld, dx, dy, dz);
}
}  // namespace nerf
#endif
