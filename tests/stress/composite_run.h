// One ray through composite(), or through its two halves, forward and backward, and the same ray by
// the scalar template in double, with bounds on how far apart the two may be.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <vector>

#include "math/worst_error.h"
#include "nerf/autodiff/operations.h"
#include "nerf/kernels/elementwise.h"
#include "nerf/math/reference/volume_rendering.h"

namespace nerf::stress {

using Colour = std::array<Real, 3>;

// Samples of a ray from front to back, and what its pixel's gradient is to be.
struct Matter {
  std::vector<Real> density, delta;
  std::vector<Colour> colour;
  Colour background{0.2_r, 0.9_r, 0.5_r};
  std::array<Real, 4> gradient{0.7_r, -1.3_r, 0.4_r, 0.6_r};

  size_t size() const { return density.size(); }
  void add(Real sigma, Real length, const Colour& c) {
    density.push_back(sigma);
    delta.push_back(length);
    colour.push_back(c);
  }
};

struct Rendered {
  std::array<double, 4> pixel;
  std::vector<double> weights, d_density;
  std::vector<std::array<double, 3>> d_colour;
};

// Ends a tape with a gradient that the test chooses.
class GivenGradient : public Operation {
 public:
  GivenGradient(Value pixel, Value out, const std::array<Real, 4>& g)
      : Operation({pixel}, out), g_(g) {}
  const char* name() const override { return "given_gradient"; }
  void forward(Chunk&) const override {}
  void backward(Chunk& c) const override {
    Real* to = c.gradient(inputs()[0]);
    for (int k = 0; k < 4; ++k)
      std::fill_n(to + k * c.stride(inputs()[0]), c.stride(inputs()[0]),
                  g_[static_cast<size_t>(k)]);
  }

 private:
  std::array<Real, 4> g_;
};

// The operations that a ray's light can go through.
enum class Path {
  kComposite,  // composite()
  kWeights,    // render_weights() and accumulate()
  kOpaqueEnd,  // the same, whose last sample is opaque
};

inline Rendered run_composite(const Matter& m, Path path = Path::kComposite) {
  const int n = static_cast<int>(m.size());
  Tape tape(std::max(n, 1), 1);
  const Value density = tape.input(1, Domain::kSamples, true);
  const Value colour = tape.input(3, Domain::kSamples, true);
  const Value delta = tape.input(1, Domain::kSamples), background = tape.input(3, Domain::kRays);
  Composite image;
  if (path == Path::kComposite) {
    image = composite(tape, density, colour, delta, background);
  } else {
    image.weights = render_weights(tape, density, delta, path == Path::kOpaqueEnd);
    image.pixel = accumulate(tape, image.weights, colour, background);
  }
  const Value end = tape.output(1, Domain::kRays, {&image.pixel, 1});
  tape.record(std::make_unique<GivenGradient>(image.pixel, end, m.gradient));
  tape.plan();
  Chunk chunk(tape);
  const int32_t begin[] = {0, n};
  chunk.samples = n;
  chunk.rays = 1;
  chunk.ray_begin = begin;
  std::copy(m.density.begin(), m.density.end(), chunk.data(density));
  std::copy(m.delta.begin(), m.delta.end(), chunk.data(delta));
  const int64_t ls = chunk.stride(colour), lr = chunk.stride(background);
  for (int k = 0; k < 3; ++k) {
    const size_t channel = static_cast<size_t>(k);
    for (int i = 0; i < n; ++i)
      chunk.data(colour)[k * ls + i] = m.colour[static_cast<size_t>(i)][channel];
    chunk.data(background)[k * lr] = m.background[channel];
  }
  tape.forward(chunk);
  tape.backward(chunk);

  Rendered out;
  for (int k = 0; k < 4; ++k) out.pixel[static_cast<size_t>(k)] = chunk.data(image.pixel)[k * lr];
  out.weights.assign(chunk.data(image.weights), chunk.data(image.weights) + n);
  out.d_density.assign(chunk.gradient(density), chunk.gradient(density) + n);
  for (int i = 0; i < n; ++i) {
    const Real* d = chunk.gradient(colour) + i;
    out.d_colour.push_back({d[0], d[ls], d[2 * ls]});
  }
  return out;
}

// What has the light of `m` where its last sample is opaque.
inline Matter seen_by(const Matter& m, Path path) {
  Matter out = m;
  if (path == Path::kOpaqueEnd && out.size() > 0) {
    out.density.back() = 1e30_r;
    out.delta.back() = 1;
  }
  return out;
}

// The same in double. Lengths beyond kLongestInterval count as that, as the operation says.
inline Rendered exact_composite(const Matter& m) {
  const std::vector<double> density(m.density.begin(), m.density.end());
  std::vector<double> delta;
  for (Real d : m.delta) delta.push_back(std::min(d, kLongestInterval));
  std::vector<std::array<double, 3>> colour;
  for (const Colour& c : m.colour) colour.push_back({c[0], c[1], c[2]});
  const std::array<double, 3> background{m.background[0], m.background[1], m.background[2]};
  const std::array<double, 4> g{m.gradient[0], m.gradient[1], m.gradient[2], m.gradient[3]};
  Rendered out;
  const auto ray = reference::composite(density, colour, delta, background);
  out.pixel = ray.pixel;
  out.weights = ray.weights;
  reference::composite_backward(density, colour, delta, background, g, out.d_density, out.d_colour);
  return out;
}

// How far from the exact result, u being the unit roundoff, whatever the number of samples:
//
// - An opacity a_i is off by e a_i, e = 9 u: Highway's Expm1 by 4 units in the last place, each at
//   most 2 u, and the product density * length by u.
// - Moving a_j alone moves the light behind it, T_n = prod (1 - a_i), by T_n / (1 - a_j) per unit,
//   which is at most T_j. So T is off by at most e sum T_j a_j <= e, for the weights T_j a_j add up
//   to at most 1; that the product is made in double adds nothing to speak of.
// - In the same way the pixel moves by T_j (c_j - what is behind j): at most e times the largest
//   colour c, plus one rounding of each weight and one of the result: (9 + 2) u c.
// - A weight T_i a_i: e a_i from T_i, e w_i from a_i, u w_i from itself.
// - The gradient delta (T_{i+1} s_i - B_i), with s the size of any s_i or of the background's: T_n
//   from the depth is exact, from it T_{i+1} is built up of weights and so is off by twice the
//   error of T and their rounding, (18 + 1) u; B_i moves as the pixel does but by colours of either
//   sign, (18 + 1) u s, and by T_n, 9 u s; s_i itself is a sum of at most 6 roundings, in both
//   terms; the difference and the product are rounded: (19 + 19 + 9 + 12 + 2) u s delta <= 64.
//
// In two halves weights are rounded before they are added up, and what stands for s_i is the
// difference of it and the background's, of at most twice its size and as many roundings:
// - the pixel and the opacity: 2 u more;
// - the gradient: T_{i+1} and B_i, now without T_n, each by (18 + 1) u 2 s, s_i by 12 u s in both
//   terms; the last weight where it is the light before an opaque end, u 2 s; the difference and
//   the product: (38 + 38 + 24 + 2 + 4) u s delta.
inline constexpr double kOpacityError = 9 * kRoundoff;
inline constexpr double kPixelError = 11 * kRoundoff;
inline constexpr double kGradientError = 64 * kRoundoff;
inline constexpr double kPixelErrorInHalves = 13 * kRoundoff;
inline constexpr double kGradientErrorInHalves = 106 * kRoundoff;
// In double the product and the sums do add something: a rounding for each sample.
inline double summing_error(double n) { return n * kDoubleRoundoff; }
// What is below the smallest normal number may be 0.
inline constexpr double kTiny = std::numeric_limits<Real>::min();

struct CompositeErrors {
  WorstError pixel{"pixel"}, weight{"weight"}, density{"density_gradient"},
      colour{"colour_gradient"};
  void report() const {
    for (const WorstError* e : {&pixel, &weight, &density, &colour}) e->report();
  }
};

// Checks everything that must hold of a ray on one path.
template <class... Where>
void check_path(const Matter& given, Path path, CompositeErrors& errors, const Where&... where) {
  const Matter m = seen_by(given, path);
  const Rendered got = run_composite(given, path), want = exact_composite(m);
  const bool halves = path != Path::kComposite;
  const double pixel_error = halves ? kPixelErrorInHalves : kPixelError;
  const double gradient_error = halves ? kGradientErrorInHalves : kGradientError;
  const double n = static_cast<double>(m.size());
  double largest = 1;
  const auto size_of = [&](const Colour& c) {
    double sum = 0;
    for (size_t k = 0; k < 3; ++k) {
      largest = std::max(largest, std::fabs(double{c[k]}));
      sum += std::fabs(double{c[k]} * double{m.gradient[k]});
    }
    return sum;
  };
  double seen = size_of(m.background);
  for (const Colour& c : m.colour) seen = std::max(seen, size_of(c));
  seen += std::fabs(double{m.gradient[3]});

  const double summed = summing_error(n);
  double sum = 0, light = 1;
  for (size_t i = 0; i < m.size(); ++i) {
    const double w = got.weights[i], alpha = -std::expm1(-double{m.density[i]} *
                                                         std::min(m.delta[i], kLongestInterval));
    ASSERT_TRUE(w >= 0) << "weight " << i << " is " << w;
    sum += w;
    // The light in front of the sample, as its weight tells: up to the errors of its opacity.
    if (w > 1e3 * kTiny) {
      const double here = w / alpha;
      ASSERT_LE(here, light * (1 + 3 * kOpacityError)) << "light rises at sample " << i;
      light = std::min(light, here);
    }
    errors.weight.compare(
        w, want.weights[i],
        kOpacityError * alpha + (kOpacityError + kRoundoff + summed) * want.weights[i] + kTiny,
        where..., "sample", i);
    ASSERT_TRUE(std::isfinite(got.d_density[i])) << "density gradient of sample " << i;
    errors.density.compare(
        got.d_density[i], want.d_density[i],
        (gradient_error + 4 * summed) * seen * std::min(m.delta[i], kLongestInterval) + kTiny,
        where..., "sample", i);
    for (size_t k = 0; k < 3; ++k)
      errors.colour.compare(
          got.d_colour[i][k], want.d_colour[i][k],
          (kOpacityError * alpha + 2 * (kOpacityError + kRoundoff + summed) * want.weights[i]) *
                  std::fabs(double{m.gradient[k]}) +
              kTiny,
          where..., "sample", i, "channel", k);
  }
  EXPECT_LE(sum, 1 + 1e-6) << "sum of weights";
  EXPECT_TRUE(got.pixel[3] >= 0 && got.pixel[3] <= 1 + (halves ? 1e-6 : 0))
      << "opacity " << got.pixel[3];
  for (size_t k = 0; k < 4; ++k)
    errors.pixel.compare(got.pixel[k], want.pixel[k], (pixel_error + summed) * largest + n * kTiny,
                         where..., "channel", k);
}

// Everything that must hold of a ray, whatever path its light takes, and how far it is from the
// exact one.
template <class... Where>
void check_ray(const Matter& m, CompositeErrors& errors, const Where&... where) {
  for (const Path path : {Path::kComposite, Path::kWeights, Path::kOpaqueEnd})
    check_path(m, path, errors, where..., "path", static_cast<int>(path));
}

}  // namespace nerf::stress
