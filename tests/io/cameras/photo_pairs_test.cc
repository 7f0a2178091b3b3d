// Which pairs are matched, and the global descriptor that tells.
#include "io/cameras/photo_pairs.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "io/cameras/global_descriptor.h"
#include "nerf/kernels/descriptors.h"
#include "nerf/math/random.h"

namespace nerf::internal {
namespace {

using Places = std::vector<std::optional<std::array<double, 2>>>;
using Descriptors = std::vector<std::vector<float>>;

bool has(const std::vector<PhotoPair>& pairs, int a, int b) {
  return std::ranges::binary_search(pairs, PhotoPair(a, b));
}

TEST(PhotoPairs, EveryPairOnce) {
  EXPECT_EQ(every_pair(4),
            (std::vector<PhotoPair>{{0, 1}, {0, 2}, {0, 3}, {1, 2}, {1, 3}, {2, 3}}));
  EXPECT_TRUE(every_pair(1).empty());
}

TEST(PhotoPairs, NeighboursByName) {
  const auto pairs = likely_pairs(Descriptors(100), Places(100), {0, 0, 0, 2});
  EXPECT_TRUE(has(pairs, 5, 6) && has(pairs, 5, 7) && has(pairs, 5, 21) && has(pairs, 5, 69));
  EXPECT_FALSE(has(pairs, 5, 8) || has(pairs, 5, 20) || has(pairs, 5, 70));
  EXPECT_TRUE(std::ranges::is_sorted(pairs));
}

TEST(PhotoPairs, NearestDescriptorsAndPlaces) {
  // A round walk: the last photo sees what the first one sees.
  Descriptors circle(60);
  for (int i = 0; i < 60; ++i) {
    const auto angle = static_cast<float>(i) * 6.2831853f / 60;
    circle[static_cast<size_t>(i)] = {std::cos(angle), std::sin(angle)};
  }
  circle[30].clear();  // a photo without features
  const auto by_look = likely_pairs(circle, Places(60), {0, 4, 0, 0});
  EXPECT_TRUE(has(by_look, 0, 59) && has(by_look, 0, 58) && has(by_look, 1, 59));
  EXPECT_FALSE(has(by_look, 0, 57) || has(by_look, 0, 40));

  // Across the date line, far in the north where degrees of longitude are short.
  Places places(6);
  places[0] = {60.0, 179.9999};
  places[1] = {60.0, -179.9999};
  places[2] = {60.00015, 179.9999};
  places[4] = {59.0, 179.9999};
  const auto by_place = likely_pairs(Descriptors(6), places, {0, 0, 1, 0});
  EXPECT_TRUE(has(by_place, 0, 1));  // 11 m apart, and 17 m from 2
  EXPECT_TRUE(has(by_place, 0, 4));  // the nearest of 4
  EXPECT_FALSE(has(by_place, 1, 2) || has(by_place, 2, 4));
  EXPECT_FALSE(has(by_place, 3, 5));  // nobody knows where they are
}

TEST(GlobalDescriptor, PhotosOfTheSameThingsAreNear) {
  // Ten places with 300 features each of their own kind; three photos of each see half of them.
  std::vector<std::vector<uint8_t>> photos;
  std::vector<uint8_t> sample;
  for (int place = 0; place < 10; ++place) {
    Random random(5, static_cast<uint64_t>(place), 0);
    std::vector<uint8_t> features;
    for (int f = 0; f < 300 * kDescriptorBytes; ++f)
      features.push_back(static_cast<uint8_t>(100 * random.uniform() * random.uniform()));
    for (int photo = 0; photo < 3; ++photo) {
      std::vector<uint8_t> seen;
      for (int f = 0; f < 300; ++f) {
        if (random.uniform() < 0.5_r) continue;
        for (int k = 0; k < kDescriptorBytes; ++k)
          seen.push_back(
              static_cast<uint8_t>(features[static_cast<size_t>(f * kDescriptorBytes + k)] +
                                   static_cast<int>(8 * random.uniform())));
      }
      sample.insert(sample.end(), seen.begin(), seen.end());
      photos.push_back(std::move(seen));
    }
  }
  const GlobalDescriptor global(sample), again(sample);
  Descriptors descriptors;
  for (const auto& photo : photos) {
    descriptors.push_back(global.of(photo));
    EXPECT_EQ(descriptors.back(), again.of(photo));
    double squares = 0;
    for (const float x : descriptors.back()) squares += static_cast<double>(x * x);
    EXPECT_NEAR(squares, 1, 1e-4);
  }
  const auto pairs = likely_pairs(descriptors, Places(30), {0, 2, 0, 0});
  for (int place = 0; place < 30; place += 3) {
    EXPECT_TRUE(has(pairs, place, place + 1) && has(pairs, place, place + 2) &&
                has(pairs, place + 1, place + 2))
        << place;
  }
  EXPECT_TRUE(global.of({}).empty());
}

}  // namespace
}  // namespace nerf::internal
