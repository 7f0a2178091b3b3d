// Rays through media whose colour is known in closed form: march, samples and compositing together.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <functional>
#include <vector>

#include "math/worst_error.h"
#include "nerf/autodiff/operations.h"
#include "parts/brute_march.h"

namespace nerf {
namespace {

using Colour = std::array<double, 3>;

struct Medium {
  double density;
  Colour colour;
};

// Matter between the planes x = -1/4 and x = 1/2 (cells 48 to 95).
bool in_slab(const CellPlace& p) { return p.x >= 48 && p.x < 96; }
constexpr double kFront = -0.25, kBack = 0.5;

// The colour and opacity that composite() gives a ray, and the samples it came from.
struct Rendered {
  std::array<double, 4> pixel;
  RaySamples samples;
  std::vector<double> x;  // of the samples
};

Rendered render(RaySampler& sampler, const Ray& ray, Random* random, bool follow,
                const Colour& background, const std::function<Medium(double x)>& medium) {
  Rendered out;
  const int n = sampler.sample(ray, random, follow, out.samples);
  Tape tape(std::max(n, 1), 1);
  const Value density = tape.input(1, Domain::kSamples), colour = tape.input(3, Domain::kSamples);
  const Value delta = tape.input(1, Domain::kSamples), behind = tape.input(3, Domain::kRays);
  const Composite image = composite(tape, density, colour, delta, behind);
  tape.plan();
  Chunk chunk(tape);
  const int32_t begin[] = {0, n};
  chunk.samples = n;
  chunk.rays = 1;
  chunk.ray_begin = begin;
  for (int i = 0; i < n; ++i) {
    const size_t s = static_cast<size_t>(i);
    out.x.push_back(static_cast<double>(sampler.entry().x) +
                    ray.direction.x * static_cast<double>(out.samples.t[s]));
    const Medium m = medium(out.x.back());
    chunk.data(density)[i] = static_cast<Real>(m.density);
    chunk.data(delta)[i] = out.samples.delta[s];
    for (int k = 0; k < 3; ++k)
      chunk.data(colour)[k * chunk.stride(colour) + i] =
          static_cast<Real>(m.colour[static_cast<size_t>(k)]);
  }
  for (int k = 0; k < 3; ++k)
    chunk.data(behind)[k * chunk.stride(behind)] =
        static_cast<Real>(background[static_cast<size_t>(k)]);
  tape.forward(chunk);
  for (int k = 0; k < 4; ++k)
    out.pixel[static_cast<size_t>(k)] = chunk.data(image.pixel)[k * chunk.stride(image.pixel)];
  return out;
}

// Light through `first` over a length, then `second` over another, before a background.
std::array<double, 4> closed_form(const Medium& first, double length1, const Medium& second,
                                  double length2, const Colour& background) {
  const double t1 = std::exp(-first.density * length1), t2 = std::exp(-second.density * length2);
  std::array<double, 4> out;
  for (size_t k = 0; k < 3; ++k)
    out[k] = first.colour[k] * (1 - t1) + t1 * (second.colour[k] * (1 - t2) + t2 * background[k]);
  out[3] = 1 - t1 * t2;
  return out;
}

// Rays that pass the slab from in front, oblique, from within and from far away.
std::vector<Ray> rays_through_slab() {
  std::vector<Ray> out;
  for (const auto& [origin, direction] : std::vector<std::pair<Vec3d, Vec3d>>{
           {{-2, 0.1, 0.1}, {1, 0, 0}},
           {{-2, 0.1, 0.1}, {1, 0.1, -0.2}},
           {{-0.9, -0.5, 0.3}, {1, 0.4, 0.1}},
           {{0.03, 0.2, 0.2}, {1, 0, 0.3}},
           {{-1e5, 0.1, 0.1}, {1, 1e-6, 0}},
       }) {
    Ray ray;
    ray.origin = origin;
    ray.direction = normalized(direction);
    out.push_back(ray);
  }
  return out;
}

// A ray's way through the slab, in double.
double way(const Ray& ray, double x0, double x1) {
  const double t0 = std::max((x0 - ray.origin.x) / ray.direction.x, ray.near);
  return std::max(0.0, (x1 - ray.origin.x) / ray.direction.x - t0);
}

template <class Body>
void for_each_sampling(const OccupancyGrid& grid, const Body& body) {
  SamplerOptions options;
  options.min_transmittance = 0;  // nothing is left out
  for (int most : {8, 32, 200}) {
    options.max_samples = most;
    RaySampler sampler(grid, options, kEverywhere);
    const std::vector<Ray> rays = rays_through_slab();
    for (size_t i = 0; i < rays.size(); ++i)
      for (bool follow : {true, false})
        for (int jitter = 0; jitter < 3; ++jitter) {
          Random random(81, static_cast<uint64_t>(jitter), i);
          body(sampler, rays[i], jitter ? &random : nullptr, follow);
        }
  }
}

// 200 factors of a product, each with a few roundings, and the length's error of a few millionths.
constexpr double kRounding = 200 * 6 * kRoundoff;
constexpr double kLengthError = 1e-5;

// Homogeneous matter: the sum telescopes, so neither number nor place of the samples matters.
TEST(VolumeRendering, HomogeneousSlab) {
  const OccupancyGrid grid = make_grid(1, [](const CellPlace& p) -> uint8_t {
    return in_slab(p) ? static_cast<uint8_t>(20 + p.x) : 0;
  });
  const Colour background{0.1, 0.9, 0.4};
  WorstError worst("slab");
  for (double density : {0.0, 0.3, 2.0, 25.0, 1e3}) {
    const Medium medium{density, {0.8, 0.3, 0.5}};
    for_each_sampling(grid, [&](RaySampler& sampler, const Ray& ray, Random* random, bool follow) {
      const Rendered got =
          render(sampler, ray, random, follow, background, [&](double) { return medium; });
      const double length = way(ray, kFront, kBack);
      const auto want = closed_form(medium, length, medium, 0, background);
      const double moved = density * std::exp(-density * length) * kLengthError;
      for (size_t k = 0; k < 4; ++k)
        worst.compare(got.pixel[k], want[k], kRounding + moved, "density", density, "channel", k);
    });
  }
  worst.report();
}

// Two layers that meet inside a cell. All samples but one lie on their side with their whole
// interval; the one whose interval holds the border counts for one side. So the result is exactly
// that of a border moved by no more than this interval, and off by no more than (sum of densities)
// x length.
TEST(VolumeRendering, TwoLayers) {
  const OccupancyGrid grid =
      make_grid(1, [](const CellPlace& p) -> uint8_t { return in_slab(p) ? 60 : 0; });
  const Colour background{0.1, 0.9, 0.4};
  const double border = 0.1234;
  WorstError moved("same_as_moved_border"), shift("shift_of_border"), total("closed_form");
  for (const auto& [d1, d2] : {std::pair{0.5, 3.0}, {6.0, 1.0}, {1.0, 0.0}, {0.0, 40.0}}) {
    const Medium first{d1, {0.9, 0.2, 0.1}}, second{d2, {0.1, 0.3, 0.8}};
    for_each_sampling(grid, [&](RaySampler& sampler, const Ray& ray, Random* random, bool follow) {
      const Rendered got = render(sampler, ray, random, follow, background,
                                  [&](double x) { return x < border ? first : second; });
      double length1 = 0, length2 = 0, widest = 0;
      for (size_t i = 0; i < got.x.size(); ++i) {
        (got.x[i] < border ? length1 : length2) += static_cast<double>(got.samples.delta[i]);
        // The interval with the border is that of the last sample before or the first behind it.
        const bool last = got.x[i] < border && (i + 1 == got.x.size() || got.x[i + 1] >= border);
        const bool next = got.x[i] >= border && (i == 0 || got.x[i - 1] < border);
        if (last || next) widest = std::max(widest, static_cast<double>(got.samples.delta[i]));
      }
      const double exact1 = way(ray, kFront, border), exact2 = way(ray, kFront, kBack) - exact1;
      const auto as_moved = closed_form(first, length1, second, length2, background);
      const auto exact = closed_form(first, exact1, second, exact2, background);
      shift.compare(length1, exact1, widest + kLengthError, "densities", d1, d2);
      for (size_t k = 0; k < 4; ++k) {
        moved.compare(got.pixel[k], as_moved[k], kRounding, "densities", d1, d2, "channel", k);
        total.compare(got.pixel[k], exact[k], (d1 + d2) * (widest + kLengthError) + kRounding,
                      "densities", d1, d2, "channel", k);
      }
    });
  }
  moved.report();
  shift.report();
  total.report();
}

// Mist in front of a wall that stops everything: the wall's colour dimmed by the mist, whatever
// stands behind it; the mist's way is right up to the interval that holds the wall's surface.
TEST(VolumeRendering, AbsorptionBeforeASurface) {
  const OccupancyGrid grid = make_grid(1, [](const CellPlace& p) -> uint8_t {
    return !in_slab(p) ? 0 : p.x < 80 ? 12 : 255;
  });
  const double surface = 0.25;  // cell 80
  const Medium mist{0.9, {0.6, 0.6, 0.7}}, wall{1e5, {0.9, 0.1, 0.05}};
  const Colour background{0, 1, 0};
  WorstError worst("surface");
  double narrowest = 1;
  for_each_sampling(grid, [&](RaySampler& sampler, const Ray& ray, Random* random, bool follow) {
    const Rendered got = render(sampler, ray, random, follow, background,
                                [&](double x) { return x < surface ? mist : wall; });
    double widest = 0;
    for (size_t i = 0; i + 1 < got.x.size(); ++i)
      if (got.x[i] < surface && got.x[i + 1] >= surface)
        widest = std::max(got.samples.delta[i], got.samples.delta[i + 1]);
    const auto want = closed_form(mist, way(ray, kFront, surface), wall, 1, background);
    for (size_t k = 0; k < 4; ++k)
      worst.compare(got.pixel[k], want[k], mist.density * (widest + kLengthError) + kRounding,
                    "channel", k);
    if (follow) narrowest = std::min(narrowest, widest);
  });
  worst.report();
  EXPECT_LT(narrowest, 1.0 / 64) << "the cache puts samples where the surface is";
}

}  // namespace
}  // namespace nerf
