// Pairs of photos that may show the same things.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace nerf::internal {

using PhotoPair = std::pair<int, int>;  // the lower index first

struct PairSettings {
  int every_pair_up_to = 150;  // photos: 11,175 pairs
  int nearest = 60;            // by the global descriptor
  int nearest_places = 20;     // by GPS
  int neighbours = 12;         // in the order of names, on either side; further ones at 16, 32, ...

  std::string text() const;  // for keys
};

std::vector<PhotoPair> every_pair(int count);

// Pairs by each photo's neighbours in the order of names, by the nearest global descriptors
// (global_descriptor.h; empty ones have none) and the nearest places (latitude and longitude in
// degrees, where known). Ascending, each once.
std::vector<PhotoPair> likely_pairs(const std::vector<std::vector<float>>& descriptors,
                                    const std::vector<std::optional<std::array<double, 2>>>& places,
                                    const PairSettings& settings);

}  // namespace nerf::internal
