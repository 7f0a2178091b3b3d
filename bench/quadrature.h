// Volume rendering by quadrature against its closed form, in double precision, along rays through
// media whose integral is known.
//
// Notation: t in [kNear, kFar] along the ray, density s(t), colour c(t), transmittance
// T(t) = exp(-int_near^t s); the light is C = int T s c dt over the ray.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "nerf/base/options.h"
#include "nerf/base/threads.h"

namespace nerf::apps {

inline constexpr double kNear = 0.5, kFar = 8;  // of every ray

enum class MediumKind {
  kHomogeneous,  // one density, a colour that is linear in t
  kExponential,  // density and colour fall off exponentially
  kSlab,         // one homogeneous layer with sharp faces
  kTwoLayers,    // a thin one in front of a dense one, space between them
};
inline constexpr std::array kMediumKinds = {MediumKind::kHomogeneous, MediumKind::kExponential,
                                            MediumKind::kSlab, MediumKind::kTwoLayers};
const char* medium_name(MediumKind kind);

enum class Sampling {
  kUniform,          // equal intervals, samples at their middles
  kUniformJittered,  // equal intervals, a sample at a random place in each
  kInverseDepth,     // intervals equal in 1 / t, samples at their middles in 1 / t
  kHierarchical,     // half of the evaluations at equal intervals give a distribution; the other
                     // half, at the middles of intervals of equal mass, give the light
};
inline constexpr std::array kSamplings = {Sampling::kUniform, Sampling::kUniformJittered,
                                          Sampling::kInverseDepth, Sampling::kHierarchical};
const char* sampling_name(Sampling sampling);

// Density and colour along one ray. The layers of a medium are homogeneous: density from `from` to
// `to`, colour c0 + c1 (t - from) there, nothing between them.
struct Medium {
  struct Layer {
    double from, to, density, c0, c1;
  };
  std::vector<Layer> layers;

  // Where `layers` is empty: density d0 exp(-fall (t - near)), colour c0 + c1 exp(-fall (t -
  // near)).
  double d0 = 0, fall = 1, c0 = 0, c1 = 0;

  // Parameters drawn from `seed` and `ray` alone: the same for every sampling.
  Medium(MediumKind kind, uint64_t seed, uint64_t ray);
  void evaluate(double t, double& density, double& colour) const;
  double light() const;  // the closed form
};

// The light of one ray by quadrature with so many evaluations of the medium, each interval taken
// for homogeneous: sum T_i (1 - exp(-s_i d_i)) c_i. `evaluations` is even, at least 2.
double quadrature(const Medium& medium, Sampling sampling, int evaluations, uint64_t seed,
                  uint64_t ray);

// Root of the mean squared error over rays; colours and so the light lie in [0, 1].
double quadrature_error(MediumKind kind, Sampling sampling, int evaluations, int rays,
                        uint64_t seed, ThreadPool& pool);

}  // namespace nerf::apps
