// Which descriptors of two photos match, as COLMAP defines it.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "io/cameras/feature_database.h"

namespace nerf::internal {

// COLMAP's SiftMatchingOptions and their defaults.
struct MatchRule {
  float max_ratio = 0.8f;     // of the angle to the nearest and to the second nearest descriptor
  float max_distance = 0.7f;  // radians
};

// The matches between descriptors a and b, [features x kDescriptorBytes] each, in the order of a's:
// each is the other's nearest, near enough, and nearer than the second nearest from either side.
// Exactly what COLMAP's exhaustive search gives (src/feature/sift.cc, FindBestMatches, with cross
// check); its search through trees, which version 3.8 takes on the CPU, misses some.
std::vector<FeatureMatch> match_descriptors(std::span<const uint8_t> a, std::span<const uint8_t> b,
                                            const MatchRule& rule = {});

}  // namespace nerf::internal
