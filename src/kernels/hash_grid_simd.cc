#include "nerf/kernels/hash_grid.h"
#include "nerf/kernels/linear.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "kernels/hash_grid_simd.cc"
// clang-format off: foreach_target.h must come first
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
// clang-format on

HWY_BEFORE_NAMESPACE();
namespace nerf {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

// Corners are found for 8 samples at a time: more would only fill registers, since the rows are
// fetched one by one.
constexpr int kGroup = 8;
using D8 = hn::CappedTag<float, kGroup>;
using DU8 = hn::RebindToUnsigned<D8>;
using DI8 = hn::RebindToSigned<D8>;
using D4 = hn::CappedTag<float, kGridFeatures>;
constexpr int kStep = static_cast<int>(hn::MaxLanes(D8()));  // 8; 4 where vectors are of 128 bits
static_assert(kGroup % kStep == 0);

struct Corners {
  alignas(64) uint32_t row[8][kGroup];
  alignas(64) float weight[8][kGroup];
};

struct Axis {
  hn::Vec<DU8> low, high;  // index terms of the two vertices
  hn::Vec<D8> near, far;   // their weights
};

HWY_INLINE Axis axis(const float* p, float scale, uint32_t multiplier, hn::Vec<DI8>* cell) {
  const D8 d;
  const DI8 di;
  const DU8 du;
  const auto unit = hn::Min(hn::Max(hn::LoadU(d, p), hn::Zero(d)), hn::Set(d, 1.0f));
  const auto at = hn::MulAdd(unit, hn::Set(d, scale), hn::Set(d, 0.5f));
  const auto c = hn::ConvertTo(di, at);
  Axis a;
  a.far = hn::Sub(at, hn::ConvertTo(d, c));
  a.near = hn::Sub(hn::Set(d, 1.0f), a.far);
  const auto m = hn::Set(du, multiplier);
  a.low = hn::Mul(hn::BitCast(du, c), m);
  a.high = hn::Add(a.low, m);
  *cell = c;
  return a;
}

// Of the kStep samples from `first` of the group on.
template <bool kDense>
HWY_INLINE void find_corners_from(int first, const HashGridLevel& level, const float* x,
                                  const float* y, const float* z, Corners& out) {
  const D8 d;
  const DU8 du;
  const uint32_t side = level.resolution;
  hn::Vec<DI8> cell;
  const Axis ax = axis(x + first, level.scale, 1u, &cell);
  const Axis ay = axis(y + first, level.scale, kDense ? side : 2654435761u, &cell);
  const Axis az = axis(z + first, level.scale, kDense ? side * side : 805459861u, &cell);
  const auto mask = hn::Set(du, level.entries - 1);
  for (int c = 0; c < 8; ++c) {
    const auto ix = c & 1 ? ax.high : ax.low;
    const auto iy = c & 2 ? ay.high : ay.low;
    const auto iz = c & 4 ? az.high : az.low;
    const auto wx = c & 1 ? ax.far : ax.near;
    const auto wy = c & 2 ? ay.far : ay.near;
    const auto wz = c & 4 ? az.far : az.near;
    auto row = kDense ? hn::Add(ix, hn::Add(iy, iz)) : hn::Xor(ix, hn::Xor(iy, iz));
    if (!kDense) row = hn::And(row, mask);
    hn::Store(row, du, out.row[c] + first);
    hn::Store(hn::Mul(wx, hn::Mul(wy, wz)), d, out.weight[c] + first);
  }
}

template <bool kDense>
HWY_INLINE void find_corners(const HashGridLevel& level, const float* x, const float* y,
                             const float* z, Corners& out) {
  for (int first = 0; first < kGroup; first += kStep)
    find_corners_from<kDense>(first, level, x, y, z, out);
}

// Asks for the rows that a group of corners will read, or write.
template <bool kWrite>
HWY_INLINE void prefetch_rows(const Corners& c, const float* rows) {
  for (int i = 0; i < 8; ++i)
    for (int s = 0; s < kGroup; ++s)
      __builtin_prefetch(rows + static_cast<size_t>(c.row[i][s]) * kGridFeatures, kWrite, 3);
}

template <bool kDense>
void forward_level(const HashGridLevel& level, const float* HWY_RESTRICT table, const float* x,
                   const float* y, const float* z, int64_t n, float* HWY_RESTRICT features,
                   int64_t ld) {
  const D4 d4;
  const int64_t end = round_up(n, kLane);
  // Two groups of corners: the rows of the next group are asked for while this one is summed.
  Corners corners[2];
  find_corners<kDense>(level, x, y, z, corners[0]);
  for (int64_t s = 0; s < end; s += kGroup) {
    const Corners& c = corners[(s / kGroup) & 1];
    if (s + kGroup < end) {
      Corners& next = corners[(s / kGroup + 1) & 1];
      find_corners<kDense>(level, x + s + kGroup, y + s + kGroup, z + s + kGroup, next);
      if (!kDense) prefetch_rows<false>(next, table);
    }
    alignas(64) float sum[kGroup * kGridFeatures];
    for (int i = 0; i < kGroup; ++i) {
      auto acc0 = hn::Zero(d4), acc1 = hn::Zero(d4);
      for (int k = 0; k < 8; k += 2) {
        acc0 = hn::MulAdd(hn::Set(d4, c.weight[k][i]),
                          hn::Load(d4, table + static_cast<size_t>(c.row[k][i]) * kGridFeatures),
                          acc0);
        acc1 = hn::MulAdd(
            hn::Set(d4, c.weight[k + 1][i]),
            hn::Load(d4, table + static_cast<size_t>(c.row[k + 1][i]) * kGridFeatures), acc1);
      }
      hn::Store(hn::Add(acc0, acc1), d4, sum + i * kGridFeatures);
    }
    for (int h = 0; h < kGroup; h += 4) {
      hn::Vec<D4> f0, f1, f2, f3;
      hn::LoadInterleaved4(d4, sum + h * kGridFeatures, f0, f1, f2, f3);
      float* to = features + s + h;
      hn::StoreU(f0, d4, to);
      hn::StoreU(f1, d4, to + ld);
      hn::StoreU(f2, d4, to + 2 * ld);
      hn::StoreU(f3, d4, to + 3 * ld);
    }
  }
}

void forward(const HashGridLevel& level, const float* table, const float* x, const float* y,
             const float* z, int64_t n, float* features, int64_t ld) {
  if (n <= 0) return;
  if (level.dense)
    forward_level<true>(level, table, x, y, z, n, features, ld);
  else
    forward_level<false>(level, table, x, y, z, n, features, ld);
}

template <bool kDense>
void backward_level(const HashGridLevel& level, const float* x, const float* y, const float* z,
                    int64_t n, const float* HWY_RESTRICT df, int64_t ld,
                    float* HWY_RESTRICT gradient, uint8_t* HWY_RESTRICT touched) {
  const D4 d4;
  const int64_t end = round_up(n, kLane);
  Corners corners[2];  // as forward
  find_corners<kDense>(level, x, y, z, corners[0]);
  for (int64_t s = 0; s < end; s += kGroup) {
    const Corners& c = corners[(s / kGroup) & 1];
    if (s + kGroup < end) {
      Corners& next = corners[(s / kGroup + 1) & 1];
      find_corners<kDense>(level, x + s + kGroup, y + s + kGroup, z + s + kGroup, next);
      if (!kDense) prefetch_rows<true>(next, gradient);
    }
    alignas(64) float g[kGroup * kGridFeatures];
    for (int h = 0; h < kGroup; h += 4) {
      const float* from = df + s + h;
      hn::StoreInterleaved4(hn::LoadU(d4, from), hn::LoadU(d4, from + ld),
                            hn::LoadU(d4, from + 2 * ld), hn::LoadU(d4, from + 3 * ld), d4,
                            g + h * kGridFeatures);
    }
    for (int i = 0; i < kGroup; ++i) {
      const auto gi = hn::Load(d4, g + i * kGridFeatures);
      if (hn::AllTrue(d4, hn::Eq(gi, hn::Zero(d4)))) continue;
      for (int k = 0; k < 8; ++k) {
        const uint32_t row = c.row[k][i];
        float* at = gradient + static_cast<size_t>(row) * kGridFeatures;
        hn::Store(hn::MulAdd(hn::Set(d4, c.weight[k][i]), gi, hn::Load(d4, at)), d4, at);
        touched[row] = 1;
      }
    }
  }
}

void backward(const HashGridLevel& level, const float* x, const float* y, const float* z, int64_t n,
              const float* df, int64_t ld, float* gradient, uint8_t* touched) {
  if (n <= 0) return;
  if (level.dense)
    backward_level<true>(level, x, y, z, n, df, ld, gradient, touched);
  else
    backward_level<false>(level, x, y, z, n, df, ld, gradient, touched);
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace nerf
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace nerf {
HWY_EXPORT(forward);
HWY_EXPORT(backward);

void hash_grid_forward(const HashGridLevel& level, const float* table, const float* x,
                       const float* y, const float* z, int64_t n, float* features, int64_t ld) {
  HWY_DYNAMIC_DISPATCH(forward)(level, table, x, y, z, n, features, ld);
}
void hash_grid_backward(const HashGridLevel& level, const float* x, const float* y, const float* z,
                        int64_t n, const float* d_features, int64_t ld, float* gradient,
                        uint8_t* touched) {
  HWY_DYNAMIC_DISPATCH(backward)(level, x, y, z, n, d_features, ld, gradient, touched);
}
}  // namespace nerf
#endif
