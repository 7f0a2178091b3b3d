// Whole pictures of the paper methods: a slab, and two layers of different density and colour, of
// points against closed forms, of cones against the same quadrature in double.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "kernels/kernel_test.h"
#include "math/worst_error.h"
#include "nerf/model/network_field.h"
#include "nerf/model/network_ray.h"
#include "stress/composite_run.h"
#include "stress/stress_field.h"
#include "support/network_options.h"

namespace nerf::stress {
namespace {

// Where the first feature f is from begin to end there is this density; within kRamp of there, and
// not within kGap of 0, it falls to that of nothing. f is x to points; to cones it is the mean of
// sin x over an interval of the cone.
struct Layer {
  double begin, end, density;
  std::array<Real, 3> logit;  // of the colour of x < 0 or of x > 0, whichever the layer is in
};
constexpr double kRamp = 0.125, kGap = 0.0625;
// A colour's logit also grows so much per unit of the view direction's x.
constexpr Real kTurn = 0.5_r;
// What a softplus is given where cones are to meet nothing: less than 1e-17, below double's digits.
constexpr Real kNothing = -40;

// What the density's activation is given in the middle of a layer, above what it is outside.
Real height(const NetworkOptions& o, double density) {
  if (o.density == DensityActivation::kRelu) return static_cast<Real>(density);
  const double before = density > 30 ? density : std::log(std::expm1(density));
  return static_cast<Real>(before - double{kNothing} - double{o.density_bias});
}

NetworkOptions layered(NetworkOptions o, int samples) {
  o = test::small_network(o);
  o.depth = 2;
  o.skip = 0;
  o.sampling.rounds = 0;
  o.sampling.fine = samples;
  return o;
}
NetworkOptions points(int samples) { return layered(test::nerf_options(), samples); }
NetworkOptions cones(int samples) { return layered(test::mipnerf_options(), samples); }

// Units of the first layer: how far f is below and above each layer's middle part, and on which
// side of 0. Of the second: each layer's ReLU(height - slope (below + above)), exactly 0 outside,
// and shares of the two colours, each exactly 1 on its own side.
std::shared_ptr<NetworkField> layered_network(const NetworkOptions& o,
                                              const std::vector<Layer>& layers, double near,
                                              double far) {
  auto field = std::make_shared<NetworkField>(o, near, far);
  for (const RadianceNetwork& n : field->networks) {
    const auto weight = [&](const LinearWeights& w, int row, int column) -> Real& {
      return field->weights[w.offset + static_cast<size_t>(row * weight_stride(w.in) + column)];
    };
    const auto bias = [&](const LinearWeights& w, int row) -> Real& {
      return field->weights[w.bias_offset() + static_cast<size_t>(row)];
    };
    const LinearWeights &first = n.trunk[0], &second = n.trunk[1];
    const int left = 4, right = 5, colours = 2;
    for (int i = 0; i < static_cast<int>(layers.size()); ++i) {
      const Layer& layer = layers[static_cast<size_t>(i)];
      const Real top = height(o, layer.density);
      weight(first, 2 * i, 0) = -1;
      bias(first, 2 * i) = static_cast<Real>(layer.begin);
      weight(first, 2 * i + 1, 0) = 1;
      bias(first, 2 * i + 1) = static_cast<Real>(-layer.end);
      for (const int side : {0, 1}) weight(second, i, 2 * i + side) = -top / Real{kRamp};
      bias(second, i) = top;
      weight(n.density, 0, i) = 1;
      const int colour = layer.end < 0 ? 0 : 1;
      for (int k = 0; k < 3; ++k) weight(n.colour, k, colour) = layer.logit[static_cast<size_t>(k)];
    }
    if (o.density == DensityActivation::kSoftplus) bias(n.density, 0) = kNothing;
    weight(first, left, 0) = 1;
    weight(first, right, 0) = -1;
    for (const int unit : {left, right}) {
      bias(first, unit) = kGap;
      const int colour = unit - left;
      weight(second, colours + colour, unit) = -0.5_r / Real{kGap};
      bias(second, colours + colour) = 1;
      weight(n.bottleneck, colour, colours + colour) = 1;
      weight(n.view, colour, colour) = 1;
    }
    weight(n.view, 2, o.bottleneck) = 1;  // x of the direction
    bias(n.view, 2) = 2;
    for (int k = 0; k < 3; ++k) {
      weight(n.colour, k, 2) = kTurn;
      bias(n.colour, k) = -2 * kTurn;
    }
  }
  return field;
}

// Distances between which all rays of a shot pass all layers that they meet.
struct Shot {
  const char* name;
  double focal;  // of 6 x 6 pixels
  Vec3d eye, target;
  double near, far;
};

struct Expected {
  double left = 1;
  std::array<double, 3> rgb{0, 0, 0};  // without background
  double tolerance = 0;                // of each by roundings, but for those of compositing
};

struct RayOf {
  Vec3d origin, direction;
  double radius;
};

double colour_of(const NetworkOptions& o, const Layer& layer, size_t k, double direction_x) {
  const double pad = double{o.colour_padding};
  const double c = 1 / (1 + std::exp(-double{layer.logit[k]} - double{kTurn} * direction_x));
  return (1 + 2 * pad) * c - pad;
}
// Of that: a logit is a sum of 4 terms of at most 3 each, 8 u of 3 together, times a slope of at
// most 1/4; the sigmoid and the padding.
constexpr double kColourError = 6 * kRoundoff + 8 * kRoundoff;

// The sum that the networks are to find, of `o`'s samples in double. By roundings
// - x is off by 2 u of the origin's, and by 6 u far along the ray, what distances, directions and
//   sums add up to; the sine by 4 u, and by half the variance's error: u far / length twelve times,
//   which squares and a difference of distances have, and 20 u of its products;
// - on a layer's ramps its activation is off by the slope times that, and by 6 u of its height;
// - a softplus passes that on by its slope, with 4 u of what it is given, and adds 8 u of itself;
// - the posts are off by 4 u far, which counts by how much the density changes between samples.
// An optical depth's error moves at most the light behind it.
Expected quadrature(const NetworkOptions& o, const std::vector<Layer>& layers, const Shot& shot,
                    const RayOf& ray) {
  const bool soft = o.density == DensityActivation::kSoftplus;
  const int n = o.sampling.fine;
  const double near = static_cast<Real>(shot.near), far = static_cast<Real>(shot.far);
  const double step = (far - near) / (soft ? n : n - 1), dx = ray.direction.x;
  const double off_x = 2 * kRoundoff * std::fabs(ray.origin.x) + 6 * kRoundoff * far;
  Expected e;
  double before = 0;  // density of the last sample
  for (int i = 0; i < n; ++i) {
    const double t0 = near + step * i;
    double f = ray.origin.x + dx * t0, off = off_x;
    if (soft) {
      // Barron et al. 2021, equation 7.
      const double m = t0 + step / 2, h = step / 2, under = 3 * m * m + h * h;
      const double along =
          h * h / 3 - 4.0 / 15 * std::pow(h, 4) * (12 * m * m - h * h) / under / under;
      const double across = ray.radius * ray.radius *
                            (m * m / 4 + 5.0 / 12 * h * h - 4.0 / 15 * std::pow(h, 4) / under);
      const double mean = ray.origin.x + dx * (m + 2 * m * h * h / under);
      const double variance = along * dx * dx + across * (1 - dx * dx);
      f = std::sin(mean) * std::exp(-variance / 2);
      off += 4 * kRoundoff + kRoundoff * (6 * far / step + 10) * variance + 2 * kRoundoff * across;
    }
    double given = soft ? double{kNothing} : 0, off_given = 0;
    const Layer* met = nullptr;
    for (const Layer& layer : layers) {
      const double top = height(o, layer.density), slope = top / kRamp;
      const double outside = std::max({0.0, layer.begin - f, f - layer.end});
      if (outside - off >= kRamp) continue;
      given += std::max(0.0, top - slope * outside);
      if (std::max(layer.begin - f, f - layer.end) > -off)
        off_given += slope * off + 6 * kRoundoff * top;
      met = &layer;
    }
    double density = std::max(0.0, given), off_density = off_given;
    if (soft) {
      const double at = given + double{o.density_bias};
      density = at > 30 ? at : std::log1p(std::exp(at));
      off_density = (off_given + 4 * kRoundoff * std::fabs(at)) / (1 + std::exp(-at)) +
                    8 * kRoundoff * density;
    }
    // The last point's interval has no end: shots end where nothing is.
    const bool endless = !soft && i + 1 == n;
    EXPECT_TRUE(!endless || density + off_density == 0) << shot.name;
    const double depth = endless ? 0 : density * step;
    const double off_depth = (endless ? 0 : off_density * step) +
                             4 * kRoundoff * far * (std::fabs(density - before) + off_density);
    before = density;
    const double through = std::exp(-depth);
    if (met)
      for (size_t k = 0; k < 3; ++k) e.rgb[k] += e.left * (1 - through) * colour_of(o, *met, k, dx);
    e.left *= through;
    e.tolerance += e.left * std::min(std::exp(off_depth) * off_depth, 1.0);
  }
  return e;
}

// The integral itself, of points: the density is piecewise linear along the ray, and 0 at both
// ends.
// - On one level the sum over its points is then the trapezoid rule, which a bend of the density,
// by
//   b per unit of length, keeps off by at most b step^2 / 8. Of a layer's four bends each is
//   height / kRamp by |dx|.
// - Samples that were drawn stand among even ones, of the level before: no interval is longer than
//   theirs, so that the trapezoid rule is off by no more, and the sum from it by half an interval's
//   length for what the density changes there, which is twice the height in all.
Expected integral(const NetworkOptions& o, const std::vector<Layer>& layers, const Shot& shot,
                  const RayOf& ray) {
  const bool drawn = o.sampling.rounds > 0;
  const double dx = ray.direction.x;
  const double step = (shot.far - shot.near) / ((drawn ? o.sampling.coarse : o.sampling.fine) - 1);
  std::vector<const Layer*> order;
  for (const Layer& layer : layers) order.push_back(&layer);
  if (dx < 0) std::ranges::reverse(order);
  Expected e;
  for (const Layer* layer : order) {
    const double a = layer->begin - kRamp, b = layer->begin, c = layer->end, d = c + kRamp;
    const auto up_to = [&](double x) {  // integral along x of the density, as a share of the top
      const double rise = std::clamp(x - a, 0.0, kRamp), fall = std::clamp(x - c, 0.0, kRamp);
      return rise * rise / (2 * kRamp) + std::clamp(x - b, 0.0, c - b) + fall -
             fall * fall / (2 * kRamp);
    };
    const double x0 = ray.origin.x + dx * shot.near, x1 = ray.origin.x + dx * shot.far;
    for (const double x : {x0, x1}) EXPECT_TRUE(x <= a || x >= d) << shot.name << ' ' << x;
    const double top = double{height(o, layer->density)};
    const double depth = std::fabs(dx) > 1e-9 ? top * (up_to(x1) - up_to(x0)) / dx : 0;
    const double through = std::exp(-depth);
    for (size_t k = 0; k < 3; ++k) e.rgb[k] += e.left * (1 - through) * colour_of(o, *layer, k, dx);
    e.left *= through;
    const double bends = 4 * (top / kRamp * std::fabs(dx)) * step * step / 8;
    const double off = depth > 0 ? bends + (drawn ? top * step : 0) : 0;
    e.tolerance += e.left * std::min(1.0, std::exp(off) * off);
  }
  return e;
}

struct Errors {
  WorstError opacity, colour;
  explicit Errors(const std::string& name) : opacity(name + "_opacity"), colour(name + "_colour") {}
  void report() const {
    opacity.report();
    colour.report();
  }
  int between = 0;  // pixels that show both matter and background
};

// With roundings of compositing and of colours.
void compare(const NetworkOptions& o, const std::vector<Layer>& layers, std::span<const Shot> shots,
             Errors* sums, Errors* integrals) {
  ThreadPool pool(2);
  RenderOptions options;
  options.precision = Precision::kF32;  // whose roundings the tolerances are
  options.background = {0.1_r, 0.9_r, 0.3_r};
  for (const Shot& shot : shots) {
    ModelInfo info;
    info.method = "composed";
    info.alpha = true;
    const RadianceField field(std::move(info), layered_network(o, layers, shot.near, shot.far));
    const Camera camera = pinhole(6, shot.focal);
    const Pose pose = look_at(shot.eye, shot.target);
    const Frame frame = render(field, camera, pose, options, pool);
    expect_picture(frame);
    for (int y = 0; y < camera.height; ++y)
      for (int x = 0; x < camera.width; ++x) {
        const size_t at = static_cast<size_t>(y * camera.width + x);
        const Vec2d pixel{x + 0.5, y + 0.5};
        const RayOf ray{pose.translation, pose.rotation * normalized(*unproject(camera, pixel)),
                        pixel_cone_radius(camera, pixel)};
        const auto check = [&](const Expected& want, double tolerance, Errors& errors) {
          const std::string density = std::to_string(layers.front().density) + " and " +
                                      std::to_string(layers.back().density);
          tolerance += kPixelErrorInHalves + summing_error(o.sampling.fine);
          errors.opacity.compare(frame.alpha[at], 1 - want.left, tolerance, density, shot.name, x,
                                 y);
          for (size_t k = 0; k < 3; ++k)
            errors.colour.compare(
                frame.rgb[3 * at + k],
                want.rgb[k] + want.left * double{options.background[static_cast<int>(k)]},
                tolerance + kColourError, density, shot.name, x, y, "channel", k);
          errors.between += want.left > 0.05 && want.left < 0.95;
        };
        // Of samples that were drawn roundings are no larger than of as many even ones.
        const Expected sum = quadrature(o, layers, shot, ray);
        if (sums) check(sum, sum.tolerance, *sums);
        if (!integrals) continue;
        const Expected whole = integral(o, layers, shot, ray);
        check(whole, sum.tolerance + whole.tolerance, *integrals);
      }
  }
}

std::vector<std::vector<Layer>> slabs() {
  std::vector<std::vector<Layer>> scenes;
  for (const double density : {1e-3, 0.3, 2.0, 40.0})
    for (const auto& [begin, end] : {std::pair{-0.75, -0.25}, {0.25, 0.3125}})
      scenes.push_back({{begin, end, density, {0, 2, -3}}});
  return scenes;
}

std::vector<std::vector<Layer>> two_layers() {
  std::vector<std::vector<Layer>> scenes;
  for (const auto& [first, second] : {std::pair{0.3, 2.0}, {2.0, 0.3}, {1e-3, 40.0}, {40.0, 1.0}})
    scenes.push_back({{-0.75, -0.25, first, {3, -1, 0.5_r}}, {0.25, 0.75, second, {-2, 1, 2}}});
  return scenes;
}

const Shot kShotsOfPoints[] = {{"through", 30, {-3, 0.1, 0.2}, {0, 0, 0}, 0.5, 5},
                               {"from the other side", 30, {3, -0.1, 0.2}, {0, 0, 0}, 0.5, 5},
                               {"slanting", 30, {-1.5, 1.3, -1.7}, {0, 0, 0}, 0.25, 6},
                               {"between them", 20, {0.03, 0.1, 0.2}, {-1, 0.3, 0.1}, 0.01, 2}};

void compare_points(const std::vector<std::vector<Layer>>& scenes) {
  Errors sums("sum"), integrals("integral");
  for_each_target([&](const std::string&) {
    for (const auto& layers : scenes)
      compare(points(1024), layers, kShotsOfPoints, &sums, &integrals);
  });
  sums.report();
  integrals.report();
  EXPECT_GT(integrals.between, 200);
}

// Two levels and their networks: merged samples.
void compare_drawn_points(const std::vector<std::vector<Layer>>& scenes) {
  NetworkOptions o = points(512);
  o.sampling.rounds = 1;
  o.sampling.coarse = 512;
  Errors integrals("integral");
  for_each_target([&](const std::string&) {
    for (const auto& layers : scenes) compare(o, layers, kShotsOfPoints, nullptr, &integrals);
  });
  integrals.report();
  EXPECT_GT(integrals.between, 200);
}

// x from -pi/2 to pi/2 alone, where its sine grows; from pixels that are narrow to some as wide as
// a layer, and intervals of the lengths that they have in the paper and of a ramp's.
const Shot kShotsOfCones[] = {{"narrow", 300, {-1.5, 0.1, 0.2}, {0, 0, 0}, 0.01, 3},
                              {"from the other side", 30, {1.5, -0.1, 0.2}, {0, 0, 0}, 0.01, 3},
                              {"slanting", 30, {-1.5, 1.3, -1.7}, {0, 0, 0}, 0.2, 4.5},
                              {"wide", 5, {-1.5, 0.1, 0.2}, {0, 0, 0}, 0.1, 3},
                              {"inside of one", 12, {-0.5, 0.1, 0.2}, {1, 0.2, 0.4}, 0.01, 2},
                              {"along them", 6, {0.03, 0.1, -3}, {0.03, 0, 0}, 0.5, 5}};

void compare_cones(const std::vector<std::vector<Layer>>& scenes) {
  Errors sums("sum");
  for_each_target([&](const std::string&) {
    for (const auto& layers : scenes)
      for (const int samples : {32, 128})
        compare(cones(samples), layers, kShotsOfCones, &sums, nullptr);
  });
  sums.report();
  EXPECT_GT(sums.between, 200);
}

TEST(StressNetworkLayers, SlabOfPoints) { compare_points(slabs()); }
TEST(StressNetworkLayers, TwoLayersOfPoints) { compare_points(two_layers()); }
TEST(StressNetworkLayers, SlabOfDrawnPoints) { compare_drawn_points(slabs()); }
TEST(StressNetworkLayers, TwoLayersOfDrawnPoints) { compare_drawn_points(two_layers()); }
TEST(StressNetworkLayers, SlabOfCones) { compare_cones(slabs()); }
TEST(StressNetworkLayers, TwoLayersOfCones) { compare_cones(two_layers()); }

}  // namespace
}  // namespace nerf::stress
