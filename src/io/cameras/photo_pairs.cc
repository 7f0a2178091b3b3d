#include "io/cameras/photo_pairs.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "nerf/base/error.h"

namespace nerf::internal {

namespace {

void add(std::vector<PhotoPair>& pairs, int a, int b) {
  if (a != b) pairs.emplace_back(std::min(a, b), std::max(a, b));
}

// Summed in lanes, so that the compiler may use vectors.
double dot_product(const std::vector<float>& a, const std::vector<float>& b) {
  constexpr size_t kLanes = 8;
  std::array<float, kLanes> sums{};
  size_t i = 0;
  for (; i + kLanes <= a.size(); i += kLanes)
    for (size_t k = 0; k < kLanes; ++k) sums[k] += a[i + k] * b[i + k];
  for (; i < a.size(); ++i) sums[0] += a[i] * b[i];
  double sum = 0;
  for (const float s : sums) sum += static_cast<double>(s);
  return sum;
}

// Adds each photo's `count` nearest by `distance`, where it has one.
template <class Distance>
void add_nearest(std::vector<PhotoPair>& pairs, int photos, int count, const Distance& distance) {
  for (int i = 0; i < photos; ++i) {
    std::vector<std::pair<double, int>> others;
    for (int j = 0; j < photos; ++j) {
      if (j == i) continue;
      if (const std::optional<double> d = distance(i, j)) others.emplace_back(*d, j);
    }
    const auto kept = std::min<size_t>(others.size(), static_cast<size_t>(count));
    std::partial_sort(others.begin(), others.begin() + static_cast<std::ptrdiff_t>(kept),
                      others.end());
    for (size_t k = 0; k < kept; ++k) add(pairs, i, others[k].second);
  }
}

}  // namespace

std::string PairSettings::text() const {
  return fmt::format("{} {} {} {}", every_pair_up_to, nearest, nearest_places, neighbours);
}

std::vector<PhotoPair> every_pair(int count) {
  std::vector<PhotoPair> pairs;
  for (int i = 0; i < count; ++i)
    for (int j = i + 1; j < count; ++j) pairs.emplace_back(i, j);
  return pairs;
}

std::vector<PhotoPair> likely_pairs(const std::vector<std::vector<float>>& descriptors,
                                    const std::vector<std::optional<std::array<double, 2>>>& places,
                                    const PairSettings& settings) {
  NERF_CHECK_EQ(descriptors.size(), places.size());
  const int count = static_cast<int>(descriptors.size());
  std::vector<PhotoPair> pairs;
  for (int i = 0; i < count; ++i) {
    for (int k = 1; k <= settings.neighbours && i + k < count; ++k) add(pairs, i, i + k);
    for (int k = 16; i + k < count; k *= 2) add(pairs, i, i + k);
  }
  add_nearest(pairs, count, settings.nearest, [&](int i, int j) -> std::optional<double> {
    const std::vector<float>&a = descriptors[static_cast<size_t>(i)],
          &b = descriptors[static_cast<size_t>(j)];
    if (a.empty() || b.empty()) return {};
    return -dot_product(a, b);
  });
  add_nearest(pairs, count, settings.nearest_places, [&](int i, int j) -> std::optional<double> {
    const auto &a = places[static_cast<size_t>(i)], &b = places[static_cast<size_t>(j)];
    if (!a || !b) return {};
    // Degrees of latitude on a sphere; photos of a capture are close together.
    const double east =
        std::remainder((*b)[1] - (*a)[1], 360) * std::cos((*a)[0] * std::numbers::pi / 180);
    return std::hypot((*b)[0] - (*a)[0], east);
  });
  std::ranges::sort(pairs);
  pairs.erase(std::unique(pairs.begin(), pairs.end()), pairs.end());
  return pairs;
}

}  // namespace nerf::internal
