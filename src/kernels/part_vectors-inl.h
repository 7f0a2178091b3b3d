// Vectors of which only the first lanes stand in memory, or whose lanes move. Highway's pattern for
// headers that are compiled once per target.
#if defined(NERF_KERNELS_PART_VECTORS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef NERF_KERNELS_PART_VECTORS_INL_H_
#undef NERF_KERNELS_PART_VECTORS_INL_H_
#else
#define NERF_KERNELS_PART_VECTORS_INL_H_
#endif

#include <hwy/highway.h>

#include <algorithm>
#include <cstdint>

HWY_BEFORE_NAMESPACE();
namespace nerf {
namespace HWY_NAMESPACE {

// Stores the first n lanes, all of them where there are fewer; what stands behind is not touched.
template <class DF>
HWY_INLINE void store_part(hwy::HWY_NAMESPACE::Vec<DF> v, DF d, float* p, int64_t n) {
  constexpr int64_t kLanes = hwy::HWY_NAMESPACE::MaxLanes(DF());
  if (n >= kLanes) {
    hwy::HWY_NAMESPACE::StoreU(v, d, p);
  } else {
    HWY_ALIGN float part[kLanes];
    hwy::HWY_NAMESPACE::Store(v, d, part);
    std::copy_n(part, n, p);
  }
}

// Lane i of the result is lane i + kBy of v, or the nearest one there is.
template <int kBy, class D>
HWY_INLINE hwy::HWY_NAMESPACE::Vec<D> moved_lanes(D d, hwy::HWY_NAMESPACE::Vec<D> v) {
  using Index = hwy::MakeSigned<hwy::HWY_NAMESPACE::TFromD<D>>;
  static constexpr int kLanes = static_cast<int>(hwy::HWY_NAMESPACE::MaxLanes(D()));
  struct Places {
    constexpr Places() {
      for (int i = 0; i < kLanes; ++i) at[i] = std::clamp(i + kBy, 0, kLanes - 1);
    }
    alignas(64) Index at[kLanes] = {};
  };
  static constexpr Places places;
  return hwy::HWY_NAMESPACE::TableLookupLanes(v, hwy::HWY_NAMESPACE::SetTableIndices(d, places.at));
}

}  // namespace HWY_NAMESPACE
}  // namespace nerf
HWY_AFTER_NAMESPACE();

#endif
