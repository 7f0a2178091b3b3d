#include "nerf/parts/interval_sampler.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <string>
#include <vector>

#include "golden/golden.h"
#include "math/worst_error.h"
#include "nerf/math/step_function.h"

namespace nerf {
namespace {

using Floats = std::vector<Real>;

IntervalOptions options_of(Resampling resampling, Spacing spacing, int rounds = 1) {
  IntervalOptions o;
  o.resampling = resampling;
  o.spacing = spacing;
  o.rounds = rounds;
  o.coarse = 32;
  o.fine = 48;
  if (resampling == Resampling::kProposal) o.padding = 0;
  return o;
}

Floats first_level(IntervalSampler& sampler, Random* random) {
  Floats out(static_cast<size_t>(sampler.posts(0)));
  sampler.first(random, out);
  return out;
}

Floats next_level(IntervalSampler& sampler, int level, const Floats& before, const Floats& weights,
                  Random* random) {
  Floats out(static_cast<size_t>(sampler.posts(level)));
  sampler.next(level, before, weights, 1, random, out);
  return out;
}

constexpr Resampling kAll[] = {Resampling::kCoarseFine, Resampling::kBlurred,
                               Resampling::kProposal};

// Whatever the weights are: sorted, between near and far, the number asked for, from the key alone.
TEST(IntervalSampler, LevelsAreSortedAndInRange) {
  const Floats kinds[] = {Floats(32, 0.0_r), Floats(32, 1.0_r / 32), [] {
                            Floats spike(32, 0.0_r);
                            spike[9] = 1;
                            return spike;
                          }()};
  for (Resampling resampling : kAll)
    for (Spacing spacing : {Spacing::kUniform, Spacing::kInverse})
      for (const Floats& weights : kinds)
        for (uint64_t seed = 0; seed < 20; ++seed) {
          IntervalSampler sampler(options_of(resampling, spacing, 2), 0.5, 1e6);
          Random random(seed, 0, 0);
          Random* key = seed ? &random : nullptr;
          std::vector<Floats> levels{first_level(sampler, key)};
          for (int l = 1; l < sampler.levels(); ++l) {
            // Later levels of coarse+fine have more samples: the weights are repeated.
            Floats w(static_cast<size_t>(sampler.samples(l - 1)));
            for (size_t i = 0; i < w.size(); ++i) w[i] = weights[i % 32];
            levels.push_back(next_level(sampler, l, levels.back(), w, key));
          }
          for (const Floats& level : levels) {
            EXPECT_TRUE(std::is_sorted(level.begin(), level.end()));
            for (const Real entry : level) {
              const Real t = sampler.distance(entry);
              EXPECT_GE(t, 0.5_r * (1 - 1e-6_r));
              EXPECT_LE(t, 1e6_r * (1 + 1e-6_r));
            }
          }
        }
}

// Even samples: linear in distance, or in its inverse.
TEST(IntervalSampler, FirstSamplesAreEven) {
  for (Resampling resampling : {Resampling::kCoarseFine, Resampling::kBlurred}) {
    IntervalSampler uniform(options_of(resampling, Spacing::kUniform), 2, 6);
    IntervalSampler inverse(options_of(resampling, Spacing::kInverse), 2, 6);
    const Floats a = first_level(uniform, nullptr), b = first_level(inverse, nullptr);
    const double n = static_cast<double>(a.size()) - 1;
    for (size_t i = 0; i < a.size(); ++i) {
      const double share = static_cast<double>(i) / n;
      EXPECT_NEAR(uniform.distance(a[i]), 2 + 4 * share, 1e-5);
      EXPECT_NEAR(inverse.distance(b[i]), 1 / ((1 - share) / 2 + share / 6), 1e-5);
      EXPECT_NEAR(uniform.normalised(a[i]), share, 1e-6);
      EXPECT_NEAR(inverse.normalised(b[i]), share, 1e-6);
    }
  }
}

// One draw in each stratum, over its whole width.
TEST(IntervalSampler, JitterStaysInItsStratum) {
  IntervalSampler sampler(options_of(Resampling::kCoarseFine, Spacing::kUniform), 0, 31);
  Floats least(32, 100.0_r), most(32, -100.0_r);
  for (uint64_t seed = 0; seed < 400; ++seed) {
    Random random(seed, 0, 0);
    const Floats t = first_level(sampler, &random);
    for (size_t i = 0; i < t.size(); ++i) {
      least[i] = std::min(least[i], t[i]);
      most[i] = std::max(most[i], t[i]);
    }
  }
  for (size_t i = 0; i < 32; ++i) {
    const Real at = static_cast<Real>(i);
    const Real low = std::max(0.0_r, at - 0.5_r), high = std::min(31.0_r, at + 0.5_r);
    EXPECT_GE(least[i], low);
    EXPECT_LE(most[i], high);
    // 400 draws miss the outer twentieth of a stratum with a chance of 1e-9.
    EXPECT_LT(least[i], low + 0.05_r);
    EXPECT_GT(most[i], high - 0.05_r);
  }
}

// NeRF evaluates its fine network at the coarse positions too.
TEST(IntervalSampler, CoarsePositionsAreMerged) {
  IntervalSampler sampler(options_of(Resampling::kCoarseFine, Spacing::kUniform), 2, 6);
  Random random(5, 0, 0);
  const Floats coarse = first_level(sampler, &random);
  const Floats all = next_level(sampler, 1, coarse, Floats(32, 0.1_r), &random);
  EXPECT_EQ(all.size(), 80u);
  EXPECT_TRUE(std::includes(all.begin(), all.end(), coarse.begin(), coarse.end()));
}

// The drawn positions are those of the template, which has golden values of its own. Every bin has
// at least a fiftieth of the mean weight, so that a share's rounding moves a sample by no more than
// 50 times as much of the ray.
TEST(IntervalSampler, FinePositionsAreThoseOfTheTemplate) {
  IntervalSampler sampler(options_of(Resampling::kCoarseFine, Spacing::kUniform), 2, 6);
  for (uint64_t seed = 0; seed < 20; ++seed) {
    Random random(seed, 1, 0);
    const Floats coarse = first_level(sampler, &random);
    Floats weights(coarse.size());
    for (Real& w : weights) w = 0.02_r + random.uniform();
    const Floats all = next_level(sampler, 1, coarse, weights, nullptr);
    const size_t fine = all.size() - coarse.size();
    std::vector<double> u(fine), drawn(fine), scratch(2 * coarse.size());
    const double last = 1 - static_cast<double>(std::numeric_limits<Real>::epsilon());
    for (size_t i = 0; i < fine; ++i)
      u[i] = last * static_cast<double>(i) / static_cast<double>(fine - 1);
    const std::vector<double> x(coarse.begin(), coarse.end()), w(weights.begin(), weights.end());
    resample_points<double>(x, w, u, scratch, drawn);
    std::vector<double> want(all.size());
    std::merge(x.begin(), x.end(), drawn.begin(), drawn.end(), want.begin());
    for (size_t i = 0; i < all.size(); ++i)
      EXPECT_NEAR(all[i], want[i], 2 * 32 * kRoundoff * 50 * 4) << i;
  }
}

// Nearly all samples go where the weight is.
TEST(IntervalSampler, SamplesFollowTheWeights) {
  for (Resampling resampling : kAll) {
    IntervalSampler sampler(options_of(resampling, Spacing::kUniform), 2, 6);
    const Floats coarse = first_level(sampler, nullptr);
    Floats weights(32, 0.0_r);
    weights[20] = 1;
    const Floats fine = next_level(sampler, 1, coarse, weights, nullptr);
    // The bin, with half a neighbour that blurring and dilation may reach.
    const Real low = coarse[18], high = coarse[22];
    const auto inside =
        std::ranges::count_if(fine, [&](Real entry) { return entry >= low && entry <= high; });
    const Real least = resampling == Resampling::kBlurred ? 0.6_r : 0.95_r;
    const auto merged = resampling == Resampling::kCoarseFine ? 27 : 0;  // coarse ones elsewhere
    EXPECT_GE(static_cast<Real>(inside), least * static_cast<Real>(fine.size() - merged));
  }
}

TEST(IntervalSampler, NumbersOfSamples) {
  IntervalOptions o = options_of(Resampling::kCoarseFine, Spacing::kUniform);
  EXPECT_EQ(IntervalSampler(o, 2, 6).samples(0), 32);
  EXPECT_EQ(IntervalSampler(o, 2, 6).samples(1), 80);
  o.rounds = 0;
  EXPECT_EQ(IntervalSampler(o, 2, 6).samples(0), 48);
  // Each level adds to the one before.
  o.rounds = 2;
  EXPECT_EQ(o.samples(0), 32);
  EXPECT_EQ(o.samples(1), 64);
  EXPECT_EQ(o.samples(2), 112);
  EXPECT_EQ(o.all_samples(), 208);
  o = options_of(Resampling::kProposal, Spacing::kInverse, 2);
  const IntervalSampler proposal(o, 2, 6);
  EXPECT_EQ(proposal.samples(0), 32);
  EXPECT_EQ(proposal.samples(1), 32);
  EXPECT_EQ(proposal.samples(2), 48);
  EXPECT_EQ(proposal.posts(2), 49);
  EXPECT_EQ(o.most_posts(), 49);
  EXPECT_EQ(o.all_samples(), 112);
}

// Every level has positions of its own, and those of the level before.
TEST(IntervalSampler, EachLevelOfCoarseAndFineAddsSamples) {
  IntervalSampler sampler(options_of(Resampling::kCoarseFine, Spacing::kUniform, 3), 2, 6);
  Random random(5, 0, 0);
  Floats before = first_level(sampler, &random);
  for (int l = 1; l < sampler.levels(); ++l) {
    const Floats weights(before.size(), 0.1_r);
    const Floats all = next_level(sampler, l, before, weights, &random);
    EXPECT_TRUE(std::ranges::includes(all, before)) << l;
    Floats added;
    std::ranges::set_difference(all, before, std::back_inserter(added));
    EXPECT_EQ(added.size(), l + 1 < sampler.levels() ? 32u : 48u) << l;
    before = all;
  }
}

// Rounding may take the distance of a post below that of the one before it; no interval is shorter
// than nothing for it.
TEST(IntervalSampler, IntervalsAreNeverNegative) {
  int fell = 0;
  for (const Spacing spacing : {Spacing::kUniform, Spacing::kInverse}) {
    const IntervalSampler sampler(options_of(Resampling::kBlurred, spacing), 2, 6);
    for (const Real from : {0.1_r, 0.5_r, 0.75_r, 0.9_r}) {
      Real post = from, t = sampler.distance(post);
      for (int i = 0; i < 10000; ++i) {
        post = std::nextafter(post, 2.0_r);
        const Real next = sampler.distance(post), end = sampler.distance_after(t, post);
        fell += next < t;
        ASSERT_GE(end, t) << post;
        ASSERT_EQ(end, std::max(next, t));
        t = next;
      }
    }
  }
  EXPECT_GT(fell, 0);
}

// Whole levels against exact fractions (tests/golden/sampling.py), from the weights to the posts.
// No bin holds less than a sixth of the mean density, so that a share that is off by roundings
// moves a post by at most six times that: 32 u of a sum, 6 of its inverse, in units of the ray.
void expect_golden_levels(const char* kind, Resampling resampling) {
  WorstError worst(std::string(kind) + "_posts");
  for (const std::vector<double>& v : golden_lines("sampling.txt", kind)) {
    IntervalOptions o = options_of(resampling, Spacing::kInverse);
    o.coarse = static_cast<int>(v[0]);
    o.fine = static_cast<int>(v[1]);
    const bool annealed = resampling == Resampling::kProposal;
    const Real exponent = annealed ? static_cast<Real>(v[2]) : 1;
    const size_t at = annealed ? 3 : 2, n = static_cast<size_t>(o.coarse);
    const auto part = [&](size_t begin, size_t size) {
      Floats out;
      for (size_t i = 0; i < size; ++i) out.push_back(static_cast<Real>(v[begin + i]));
      return out;
    };
    const Floats before = part(at, n + 1), weights = part(at + n + 1, n);
    IntervalSampler sampler(o, 1, 2);
    Floats out(static_cast<size_t>(sampler.posts(1)));
    ASSERT_EQ(v.size(), at + 2 * n + 1 + out.size());
    sampler.next(1, before, weights, exponent, nullptr, out);
    for (size_t i = 0; i < out.size(); ++i)
      worst.compare(out[i], v[at + 2 * n + 1 + i], 6 * 32 * kFloatRoundoff, "bins", n, "post", i);
  }
  worst.report();
}

TEST(IntervalSampler, BlurredLevelsAreGolden) {
  expect_golden_levels("blurred", Resampling::kBlurred);
}

TEST(IntervalSampler, DilatedLevelsAreGolden) {
  expect_golden_levels("dilated", Resampling::kProposal);
}

}  // namespace
}  // namespace nerf
