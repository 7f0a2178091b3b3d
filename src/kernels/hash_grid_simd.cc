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

// Corners are found for kGroup samples at a time, kStep of them in a vector; their rows are fetched
// one by one.
constexpr int kGroup = 16;
using DG = hn::CappedTag<float, kGroup>;
using DU = hn::RebindToUnsigned<DG>;
using DI = hn::RebindToSigned<DG>;
constexpr int kStep = static_cast<int>(hn::MaxLanes(DG()));
static_assert(kGroup % kStep == 0 && kLane % kGroup == 0);
template <int F>
using Row = hn::CappedTag<float, F>;

template <class D>
HWY_INLINE hn::Vec<D> load_features(D d, const float* row) {
  return hn::LoadU(d, row);
}
template <class D>
HWY_INLINE hn::Vec<D> load_features(D d, const uint16_t* row) {
  const hn::Rebind<hwy::float16_t, D> half;
  return hn::PromoteTo(d, hn::BitCast(half, hn::LoadU(hn::Rebind<uint16_t, D>(), row)));
}

// A level's table of more bytes than this is far away: its rows are asked for ahead.
constexpr size_t kNear = size_t{3} << 18;

// The eight corners of a cell as four pairs of neighbours in x: what both share is worked out once.
struct Corners {
  alignas(64) uint32_t low[4][kGroup];   // where the row of the lower x begins, in floats
  alignas(64) uint32_t high[4][kGroup];  // of the higher x; a dense table's is the next row
  alignas(64) float weight[4][kGroup];   // of the pair
  alignas(64) float near[kGroup];        // share of the lower x in each pair
  alignas(64) float far[kGroup];         // of the higher x
};

struct Axis {
  hn::Vec<DU> low, high;  // index terms of the two vertices
  hn::Vec<DG> near, far;  // their weights
};

HWY_INLINE Axis axis(const float* p, float scale, uint32_t multiplier) {
  const DG d;
  const DI di;
  const DU du;
  const auto unit = hn::Min(hn::Max(hn::LoadU(d, p), hn::Zero(d)), hn::Set(d, 1.0f));
  const auto at = hn::MulAdd(unit, hn::Set(d, scale), hn::Set(d, 0.5f));
  const auto cell = hn::ConvertTo(di, at);
  Axis a;
  a.far = hn::Sub(at, hn::ConvertTo(d, cell));
  a.near = hn::Sub(hn::Set(d, 1.0f), a.far);
  const auto m = hn::Set(du, multiplier);
  a.low = hn::Mul(hn::BitCast(du, cell), m);
  a.high = hn::Add(a.low, m);
  return a;
}

// kShift: of a row's number, to where it begins.
template <bool kDense, int kShift>
HWY_INLINE void find_corners(const HashGridLevel& level, const float* x, const float* y,
                             const float* z, Corners& out) {
  const DG d;
  const DU du;
  const uint32_t side = level.resolution;
  const auto mask = hn::Set(du, level.entries - 1);
  for (int first = 0; first < kGroup; first += kStep) {
    const Axis ax = axis(x + first, level.scale, 1u);
    const Axis ay = axis(y + first, level.scale, kDense ? side : 2654435761u);
    const Axis az = axis(z + first, level.scale, kDense ? side * side : 805459861u);
    hn::Store(ax.near, d, out.near + first);
    hn::Store(ax.far, d, out.far + first);
    for (int k = 0; k < 4; ++k) {
      const auto iy = k & 1 ? ay.high : ay.low;
      const auto iz = k & 2 ? az.high : az.low;
      const auto wy = k & 1 ? ay.far : ay.near;
      const auto wz = k & 2 ? az.far : az.near;
      hn::Store(hn::Mul(wy, wz), d, out.weight[k] + first);
      if (kDense) {
        const auto row = hn::Add(ax.low, hn::Add(iy, iz));
        hn::Store(hn::ShiftLeft<kShift>(row), du, out.low[k] + first);
      } else {
        const auto term = hn::Xor(iy, iz);
        const auto low = hn::And(hn::Xor(ax.low, term), mask);
        const auto high = hn::And(hn::Xor(ax.high, term), mask);
        hn::Store(hn::ShiftLeft<kShift>(low), du, out.low[k] + first);
        hn::Store(hn::ShiftLeft<kShift>(high), du, out.high[k] + first);
      }
    }
  }
}

template <bool kDense, int kShift>
HWY_INLINE size_t high_row(const Corners& c, int k, int s) {
  return kDense ? size_t{c.low[k][s]} + (size_t{1} << kShift) : c.high[k][s];
}

// Asks for the rows that a group of corners will read or write, into the second-level cache: the
// first one waits for too few at a time (on Zen 4 a lookup takes a third of the time it took with
// it, where the table is 8 MB).
template <bool kDense, int kShift, class T>
HWY_INLINE void prefetch_rows(const Corners& c, const T* rows) {
  for (int k = 0; k < 4; ++k)
    for (int s = 0; s < kGroup; ++s) {
      __builtin_prefetch(rows + c.low[k][s], 0, 2);
      __builtin_prefetch(rows + high_row<kDense, kShift>(c, k, s), 0, 2);
    }
}

// Calls body(corners, s) for each group of samples from s on, the corners of the next one found
// and, where `far`, its rows asked for before.
template <bool kDense, int kShift, class T, class Body>
HWY_INLINE void each_group(const HashGridLevel& level, const T* rows, const float* x,
                           const float* y, const float* z, int64_t n, const Body& body) {
  const bool far = (size_t{level.entries} << kShift) * sizeof(T) > kNear;
  const int64_t end = round_up(n, kLane);
  Corners corners[2];
  find_corners<kDense, kShift>(level, x, y, z, corners[0]);
  for (int64_t s = 0; s < end; s += kGroup) {
    if (s + kGroup < end) {
      Corners& next = corners[(s / kGroup + 1) & 1];
      find_corners<kDense, kShift>(level, x + s + kGroup, y + s + kGroup, z + s + kGroup, next);
      if (far) prefetch_rows<kDense, kShift>(next, rows);
    }
    body(corners[(s / kGroup) & 1], s);
  }
}

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
