// What the hash grid's kernels share on each target: the rows and weights of a group of samples,
// found in vectors and asked for ahead. Highway's pattern for headers that are compiled once per
// target.
#if defined(NERF_KERNELS_HASH_GRID_CORNERS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef NERF_KERNELS_HASH_GRID_CORNERS_INL_H_
#undef NERF_KERNELS_HASH_GRID_CORNERS_INL_H_
#else
#define NERF_KERNELS_HASH_GRID_CORNERS_INL_H_
#endif

#include <hwy/highway.h>

#include "nerf/kernels/hash_grid.h"
#include "nerf/kernels/linear.h"

HWY_BEFORE_NAMESPACE();
namespace nerf {
namespace HWY_NAMESPACE {

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
HWY_INLINE hn::Vec<D> to_floats(D, hn::Vec<D> row) {
  return row;
}
template <class D>
HWY_INLINE hn::Vec<D> to_floats(D d, hn::Vec<hn::Rebind<uint16_t, D>> row) {
  return hn::PromoteTo(d, hn::BitCast(hn::Rebind<hwy::float16_t, D>(), row));
}
template <class D, class T>
HWY_INLINE hn::Vec<D> load_features(D d, const T* row) {
  return to_floats(d, hn::LoadU(hn::Rebind<T, D>(), row));
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
  alignas(64) float far_y[kGroup];       // shares of the higher y and the higher z
  alignas(64) float far_z[kGroup];
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
    hn::Store(ay.far, d, out.far_y + first);
    hn::Store(az.far, d, out.far_z + first);
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

}  // namespace HWY_NAMESPACE
}  // namespace nerf
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
