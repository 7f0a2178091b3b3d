// What the kernels of linear layers share on each target: unrolled loops, and the size of their
// register blocks.
// Highway's pattern for headers that are compiled once per target.
#if defined(NERF_KERNELS_LINEAR_BLOCKS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef NERF_KERNELS_LINEAR_BLOCKS_INL_H_
#undef NERF_KERNELS_LINEAR_BLOCKS_INL_H_
#else
#define NERF_KERNELS_LINEAR_BLOCKS_INL_H_
#endif

#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace nerf {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;
using D = hn::ScalableTag<float>;
using V = hn::Vec<D>;

#undef NERF_INLINE
#define NERF_INLINE HWY_ATTR __attribute__((always_inline))
#include "kernels/unrolled.inc"

// Register blocks: kRows x 3 vectors of accumulators, so that the loads of a step (3 vectors and
// kRows broadcasts) stay below its multiply-adds. 16 vector registers on AVX2, 32 on AVX-512 and
// NEON.
#if HWY_TARGET == HWY_AVX2
constexpr int kRows = 4;
#else
constexpr int kRows = 8;
#endif
constexpr int kVectors = 3;

// NERF_CASE of the numbers of rows below a whole block, of outputs and of weight gradients.
#undef NERF_EACH_ROW_COUNT
#if HWY_TARGET == HWY_AVX2
#define NERF_EACH_ROW_COUNT NERF_CASE(1) NERF_CASE(2) NERF_CASE(3)
#else
#define NERF_EACH_ROW_COUNT \
  NERF_CASE(1) NERF_CASE(2) NERF_CASE(3) NERF_CASE(4) NERF_CASE(5) NERF_CASE(6)
#endif

// Both widths from here on: layers that take other ways (measured: nerf_bench kernels). The same on
// every target.
constexpr int kWide = 96;
constexpr bool is_wide(int in, int out) { return in >= kWide && out >= kWide; }

}  // namespace HWY_NAMESPACE
}  // namespace nerf
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
