#include "io/cameras/descriptor_matches.h"

#include <algorithm>
#include <cmath>

namespace nerf::internal {

namespace {

// The same operations in float as COLMAP's, so that the same matches pass.
bool is_distinct(const NearestTwo& two, const MatchRule& rule) {
  constexpr float kScale = 1.0f / (512.0f * 512.0f);  // descriptors have the length 512
  const auto angle = [&](int32_t dot) {
    return std::acos(std::min(kScale * static_cast<float>(dot), 1.0f));
  };
  const float best = angle(two.best);
  return !(best > rule.max_distance) && !(best >= rule.max_ratio * angle(two.second));
}

}  // namespace

std::vector<FeatureMatch> match_descriptors(std::span<const uint8_t> a, std::span<const uint8_t> b,
                                            const MatchRule& rule) {
  std::vector<NearestTwo> of_a(a.size() / kDescriptorBytes), of_b(b.size() / kDescriptorBytes);
  nearest_descriptors(static_cast<int64_t>(of_a.size()), a.data(),
                      static_cast<int64_t>(of_b.size()), b.data(), of_a.data(), of_b.data());
  std::vector<FeatureMatch> matches;
  for (size_t i = 0; i < of_a.size(); ++i) {
    if (of_a[i].index < 0) continue;
    const auto j = static_cast<size_t>(of_a[i].index);
    if (of_b[j].index != static_cast<int32_t>(i)) continue;
    if (is_distinct(of_a[i], rule) && is_distinct(of_b[j], rule))
      matches.push_back({static_cast<uint32_t>(i), static_cast<uint32_t>(j)});
  }
  return matches;
}

}  // namespace nerf::internal
