// Matches against COLMAP's rule written out, pair by pair of descriptors.
#include "io/cameras/descriptor_matches.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "nerf/math/random.h"

namespace nerf::internal {
namespace {

using Bytes = std::vector<uint8_t>;

// FindBestMatchesOneWay of COLMAP 3.8's src/feature/sift.cc, of `a` among `b`; -1: no match.
std::vector<int> best_one_way(const Bytes& a, const Bytes& b, const MatchRule& rule) {
  std::vector<int> out;
  for (size_t i = 0; i < a.size(); i += kDescriptorBytes) {
    int best = -1, best_dot = 0, second_dot = 0;
    for (size_t j = 0; j < b.size(); j += kDescriptorBytes) {
      int dot = 0;
      for (size_t k = 0; k < kDescriptorBytes; ++k) dot += a[i + k] * b[j + k];
      if (dot > best_dot) {
        best = static_cast<int>(j / kDescriptorBytes);
        second_dot = best_dot;
        best_dot = dot;
      } else if (dot > second_dot) {
        second_dot = dot;
      }
    }
    const float scale = 1.0f / (512.0f * 512.0f);
    const float angle = std::acos(std::min(scale * static_cast<float>(best_dot), 1.0f));
    const float second = std::acos(std::min(scale * static_cast<float>(second_dot), 1.0f));
    out.push_back(angle > rule.max_distance || angle >= rule.max_ratio * second ? -1 : best);
  }
  return out;
}

std::vector<FeatureMatch> expected(const Bytes& a, const Bytes& b, const MatchRule& rule = {}) {
  const std::vector<int> there = best_one_way(a, b, rule), back = best_one_way(b, a, rule);
  std::vector<FeatureMatch> out;
  for (size_t i = 0; i < there.size(); ++i) {
    if (there[i] >= 0 && back[static_cast<size_t>(there[i])] == static_cast<int>(i))
      out.push_back({static_cast<uint32_t>(i), static_cast<uint32_t>(there[i])});
  }
  return out;
}

// A descriptor of length 512, or one near another.
Bytes descriptor(Random& random, const Bytes& near = {}, double noise = 0) {
  std::vector<double> v(kDescriptorBytes);
  double squares = 0;
  for (size_t k = 0; k < v.size(); ++k) {
    const double u = static_cast<double>(random.uniform());
    v[k] = near.empty() ? u * u : std::max(0.0, near[k] + noise * (u - 0.5));
    squares += v[k] * v[k];
  }
  Bytes out;
  for (const double x : v)
    out.push_back(static_cast<uint8_t>(std::min(255.0, std::round(512 * x / std::sqrt(squares)))));
  return out;
}

// The same features in both, more and more disturbed, in another order, some of them twice, and
// others that only one photo has.
TEST(DescriptorMatches, AreThoseOfColmapsRule) {
  Random random(11, 0, 0);
  Bytes a, b;
  const auto add = [](Bytes& to, const Bytes& d) { to.insert(to.end(), d.begin(), d.end()); };
  for (int i = 0; i < 200; ++i) {
    const Bytes d = descriptor(random);
    add(a, d);
    if (i % 3 == 0) continue;
    const Bytes e = descriptor(random, d, 2 * i);
    b.insert(b.begin(), e.begin(), e.end());
    if (i % 5 == 0) add(b, e);                          // equally near
    if (i % 7 == 0) add(b, descriptor(random, e, 40));  // nearly
    if (i % 11 == 0) add(a, descriptor(random, d, 30));
  }
  for (const MatchRule& rule : {MatchRule(), MatchRule{0.95f, 1.2f}, MatchRule{0.7f, 0.3f}}) {
    const std::vector<FeatureMatch> truth = expected(a, b, rule);
    EXPECT_GT(truth.size(), 10u);
    EXPECT_LT(truth.size(), 160u);
    EXPECT_TRUE(match_descriptors(a, b, rule) == truth);
  }
  EXPECT_TRUE(match_descriptors(a, a) == expected(a, a));
  EXPECT_TRUE(match_descriptors(a, {}).empty());
  EXPECT_TRUE(match_descriptors({}, b).empty());
}

}  // namespace
}  // namespace nerf::internal
