// Where the paper methods ask their networks on a ray, level by level: each level's positions are
// drawn from the weights of the level before.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "nerf/base/options.h"
#include "nerf/base/real.h"
#include "nerf/math/random.h"
#include "nerf/math/step_function.h"

namespace nerf {

enum class Resampling {
  kCoarseFine,  // NeRF: positions; fine ones drawn from the coarse weights and merged with them
  kBlurred,     // mip-NeRF: intervals; drawn anew from the blurred weights
  kProposal,    // mip-NeRF 360: intervals; from proposals' dilated and annealed weights
};
enum class Spacing {
  kUniform,  // even in distance
  kInverse,  // even in inverse distance
};

inline auto option_names(Resampling) {
  return std::array{OptionName{Resampling::kCoarseFine, "coarse+fine"},
                    OptionName{Resampling::kBlurred, "blurred"},
                    OptionName{Resampling::kProposal, "proposal"}};
}
inline auto option_names(Spacing) {
  return std::array{OptionName{Spacing::kUniform, "uniform"},
                    OptionName{Spacing::kInverse, "inverse"}};
}

struct IntervalOptions {
  Resampling resampling = Resampling::kCoarseFine;
  Spacing spacing = Spacing::kUniform;
  int coarse = 64;        // samples of each level before the last
  int fine = 128;         // of the last, in addition to the coarse ones where those are merged
  int rounds = 1;         // levels before the last; 0: none, the ray is sampled once
  Real padding = 0.01_r;  // added to every weight that is drawn from (mip-NeRF, section 3.1)

  template <class V>
  void visit_options(V& v) {
    v("resampling", resampling, "how a level's samples come from the weights of the one before");
    v("spacing", spacing, "distances of the first samples");
    v("coarse", coarse, "samples of a ray at every level but the last", at_least(2),
      at_most(kMostSamples));
    v("fine", fine, "samples of the last level; coarse+fine adds the coarse ones", at_least(2),
      at_most(kMostSamples));
    v("rounds", rounds, "levels before the last", at_least(0), at_most(4));
    v("padding", padding, "added to the blurred weights that samples are drawn from", at_least(0),
      at_most(1));
  }
  static constexpr int kMostSamples = 4096;

  int levels() const { return rounds + 1; }
  int samples(int level) const;
  bool intervals() const { return resampling != Resampling::kCoarseFine; }
  int posts(int level) const { return samples(level) + (intervals() ? 1 : 0); }
  int most_posts() const;   // of any level
  int all_samples() const;  // of all levels
};

// A level is a sorted list of numbers on a ray: n positions (kCoarseFine) or the n + 1 posts of n
// intervals, as distances (kCoarseFine) or in normalised distance s in [0, 1], see distance().
class IntervalSampler {
 public:
  // near and far: distances along the ray, 0 < near < far (near may be 0 with uniform spacing).
  IntervalSampler(const IntervalOptions& options, double near, double far);

  // Other distances, of the ray that comes next.
  void set_range(Real near, Real far);

  int levels() const { return options_.levels(); }
  int samples(int level) const { return options_.samples(level); }
  bool intervals() const { return options_.intervals(); }
  int posts(int level) const { return options_.posts(level); }

  // The first level; jittered with `random`, even without.
  void first(Random* random, std::span<Real> out);
  // Level `level` >= 1 from the level before and its weights (one per sample). `exponent`: what
  // weights are raised to (kProposal, annealing_exponent() of step_function.h).
  void next(int level, std::span<const Real> before, std::span<const Real> weights, Real exponent,
            Random* random, std::span<Real> out);

  // Distance of an entry of a level.
  Real distance(Real entry) const;
  // The same for the entry that follows one at distance t, at least t: rounding may take the
  // distance of neighbouring numbers below each other.
  Real distance_after(Real t, Real entry) const { return std::max(t, distance(entry)); }
  // Normalised distance of an entry, in [0, 1].
  Real normalised(Real entry) const;

 private:
  Real even(Real share) const;
  void jitter(Random* random, std::span<Real> even) const;
  void merge_fine(std::span<const Real> before, std::span<const Real> weights, Random* random,
                  std::span<Real> out);
  void resample_blurred(std::span<const Real> before, std::span<const Real> weights, Random* random,
                        std::span<Real> out);
  void resample_dilated(int level, std::span<const Real> before, std::span<const Real> weights,
                        Real exponent, Random* random, std::span<Real> out);

  IntervalOptions options_;
  Real near_, far_;
  std::vector<Real> u_, scratch_, edges_, mass_, cdf_;
  DilationScratch<Real> dilation_;
};

}  // namespace nerf
