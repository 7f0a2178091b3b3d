#include "quadrature.h"

#include <algorithm>
#include <cmath>

#include "nerf/base/error.h"
#include "nerf/math/random.h"

namespace nerf::apps {
namespace {

// Streams of random numbers of one seed.
constexpr uint64_t kMediumStream = 0, kJitterStream = 1;

double between(Random& random, double low, double high) {
  return std::lerp(low, high, static_cast<double>(random.uniform()));
}

// A layer of optical thickness up to about `most`, with colours within [0, 1] at both faces.
Medium::Layer layer(Random& random, double from, double to, double least, double most) {
  const double thickness = std::exp(between(random, std::log(least), std::log(most)));
  const double first = between(random, 0, 1), last = between(random, 0, 1);
  return {from, to, thickness / (to - from), first, (last - first) / (to - from)};
}

// int_0^D exp(-u) (a + b u) du
double attenuated(double a, double b, double depth) {
  const double through = std::exp(-depth);
  return a * (1 - through) + b * (1 - through * (1 + depth));
}

// Borders of intervals that have equal mass under a density that is constant in each of `mass`'s
// equal bins over [kNear, kFar].
std::vector<double> borders_of_equal_mass(const std::vector<double>& mass, int intervals) {
  double total = 0;
  for (const double m : mass) total += m;
  const double width = (kFar - kNear) / static_cast<double>(mass.size());
  std::vector<double> borders = {kNear};
  size_t bin = 0;
  double below = 0;  // mass of the bins before
  for (int k = 1; k < intervals; ++k) {
    const double target = total * k / intervals;
    while (bin + 1 < mass.size() && below + mass[bin] < target) below += mass[bin++];
    const double inside = std::clamp((target - below) / mass[bin], 0.0, 1.0);
    borders.push_back(kNear + (static_cast<double>(bin) + inside) * width);
  }
  borders.push_back(kFar);
  return borders;
}

double sum_over(const Medium& medium, const std::vector<double>& borders,
                const std::vector<double>& places) {
  double light = 0, through = 1;
  for (size_t i = 0; i < places.size(); ++i) {
    double density = 0, colour = 0;
    medium.evaluate(places[i], density, colour);
    const double alpha = -std::expm1(-density * (borders[i + 1] - borders[i]));
    light += through * alpha * colour;
    through *= 1 - alpha;
  }
  return light;
}

// Of each of n equal intervals the light that comes from it, spread to the neighbours as mip-NeRF
// does it (a face may stand in either), and a share that keeps every place within reach of a
// sample.
std::vector<double> coarse_mass(const Medium& medium, int n) {
  constexpr double kEverywhere = 0.05;
  const double width = (kFar - kNear) / n;
  std::vector<double> light(static_cast<size_t>(n) + 2, 0.0);  // empty space in front and behind
  double through = 1;
  for (int i = 0; i < n; ++i) {
    double density = 0, colour = 0;
    medium.evaluate(kNear + (i + 0.5) * width, density, colour);
    const double alpha = -std::expm1(-density * width);
    light[static_cast<size_t>(i) + 1] = through * alpha;
    through *= 1 - alpha;
  }
  std::vector<double> mass;
  for (size_t i = 1; i + 1 < light.size(); ++i)
    mass.push_back(0.5 * (std::max(light[i - 1], light[i]) + std::max(light[i], light[i + 1])) +
                   kEverywhere / n);
  return mass;
}

}  // namespace

const char* medium_name(MediumKind kind) {
  switch (kind) {
    case MediumKind::kHomogeneous:
      return "homogeneous";
    case MediumKind::kExponential:
      return "exponential";
    case MediumKind::kSlab:
      return "slab";
    case MediumKind::kTwoLayers:
      return "two_layers";
  }
  return "";
}

const char* sampling_name(Sampling sampling) {
  switch (sampling) {
    case Sampling::kUniform:
      return "uniform";
    case Sampling::kUniformJittered:
      return "uniform, jittered";
    case Sampling::kInverseDepth:
      return "inverse depth";
    case Sampling::kHierarchical:
      return "hierarchical";
  }
  return "";
}

Medium::Medium(MediumKind kind, uint64_t seed, uint64_t ray) {
  Random random(seed, kMediumStream, ray);
  switch (kind) {
    case MediumKind::kHomogeneous:
      layers = {layer(random, kNear, kFar, 0.5, 20)};
      break;
    case MediumKind::kExponential:
      d0 = std::exp(between(random, std::log(0.3), std::log(4.0)));
      fall = between(random, 0.2, 1.5);
      c0 = between(random, 0, 0.5);
      c1 = between(random, 0, 0.5);
      break;
    case MediumKind::kSlab: {
      const double from = between(random, 1, 6);
      layers = {layer(random, from, from + between(random, 0.3, 1.5), 0.5, 20)};
      break;
    }
    case MediumKind::kTwoLayers: {
      const double first = between(random, 1, 3), second = between(random, 4, 6);
      layers = {layer(random, first, first + between(random, 0.1, 0.5), 0.2, 1),
                layer(random, second, second + between(random, 0.3, 1.5), 2, 50)};
      break;
    }
  }
}

void Medium::evaluate(double t, double& density, double& colour) const {
  density = colour = 0;
  if (layers.empty()) {
    const double e = std::exp(-fall * (t - kNear));
    density = d0 * e;
    colour = c0 + c1 * e;
  }
  for (const Layer& l : layers)
    if (t >= l.from && t < l.to) {
      density = l.density;
      colour = l.c0 + l.c1 * (t - l.from);
    }
}

double Medium::light() const {
  if (layers.empty()) {
    // With u the optical depth, exp(-fall (t - near)) = 1 - u fall / d0.
    const double depth = d0 / fall * -std::expm1(-fall * (kFar - kNear));
    return attenuated(c0 + c1, -c1 * fall / d0, depth);
  }
  double light = 0, through = 1;
  for (const Layer& l : layers) {
    const double depth = l.density * (l.to - l.from);
    light += through * attenuated(l.c0, l.c1 / l.density, depth);
    through *= std::exp(-depth);
  }
  return light;
}

double quadrature(const Medium& medium, Sampling sampling, int evaluations, uint64_t seed,
                  uint64_t ray) {
  NERF_CHECK(evaluations >= 2 && evaluations % 2 == 0);
  const int n = sampling == Sampling::kHierarchical ? evaluations / 2 : evaluations;
  std::vector<double> borders, places;
  if (sampling == Sampling::kHierarchical) {
    borders = borders_of_equal_mass(coarse_mass(medium, n), n);
    for (size_t i = 0; i + 1 < borders.size(); ++i)
      places.push_back(0.5 * (borders[i] + borders[i + 1]));
    return sum_over(medium, borders, places);
  }
  Random random(seed, kJitterStream, ray);
  const auto place = [&](double share) {
    return sampling == Sampling::kInverseDepth ? 1 / std::lerp(1 / kNear, 1 / kFar, share)
                                               : std::lerp(kNear, kFar, share);
  };
  for (int i = 0; i <= n; ++i) borders.push_back(place(static_cast<double>(i) / n));
  for (int i = 0; i < n; ++i) {
    const double inside =
        sampling == Sampling::kUniformJittered ? static_cast<double>(random.uniform()) : 0.5;
    places.push_back(place((i + inside) / n));
  }
  return sum_over(medium, borders, places);
}

double quadrature_error(MediumKind kind, Sampling sampling, int evaluations, int rays,
                        uint64_t seed, ThreadPool& pool) {
  std::vector<double> squares(static_cast<size_t>(rays));
  pool.parallel_for(rays, [&](int64_t i) {
    const uint64_t ray = static_cast<uint64_t>(i);
    const Medium medium(kind, seed, ray);
    const double error = quadrature(medium, sampling, evaluations, seed, ray) - medium.light();
    squares[static_cast<size_t>(i)] = error * error;
  });
  double sum = 0;
  for (const double s : squares) sum += s;
  return std::sqrt(sum / rays);
}

}  // namespace nerf::apps
