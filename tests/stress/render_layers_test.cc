// Whole pictures of a slab, of two layers of different density and colour with nothing between
// them, of black mist, of a slab cut in two and of an exponential medium, against closed forms.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "kernels/kernel_test.h"
#include "math/worst_error.h"
#include "nerf/math/reference/hash_grid.h"
#include "stress/stress_field.h"

namespace nerf::stress {
namespace {

// Matter where begin <= x <= end, across all of [-1, 1]^2 in y and z.
struct Layer {
  double begin, end, density;
  std::array<Real, 3> logit;
};

// The borders are those of the occupancy's cells, a sixteenth wide. A feature for either side of
// x = 0 is 1 there and fades to 0 within a cell of the table, between -2 / 15 and 2 / 15, where
// there is no matter; a hidden unit carries it to the density and to the colour.
RadianceField layered_field(const std::vector<Layer>& layers) {
  GridOptions options = small_options();
  options.levels = 1;
  options.log2_entries = 13;
  options.base_resolution = options.finest_resolution = 16;
  auto grid = std::make_shared<GridField>(options, /*unbounded=*/false, 1);
  const HashGridLevel& level = grid->shape.levels[0];
  EXPECT_TRUE(level.dense);
  const size_t features = static_cast<size_t>(level.features);
  const reference::GridLevel exact{level.scale, level.resolution, level.entries, level.dense,
                                   features};
  for (uint32_t z = 0; z < level.resolution; ++z)
    for (uint32_t y = 0; y < level.resolution; ++y)
      for (uint32_t x = 0; x < level.resolution; ++x)
        grid->table[reference::grid_row(exact, x, y, z) * features + (x < 8 ? 0 : 1)] = 1;
  const auto weight = [&](const LinearWeights& w, int row, int column) -> Real& {
    return grid->weights[w.offset + static_cast<size_t>(row * weight_stride(w.in) + column)];
  };
  for (const Layer& layer : layers) {
    const int side = layer.begin < 0 ? 0 : 1;
    weight(grid->density_layers[0], side, side) = 1;
    weight(grid->density_layers[1], 0, side) = static_cast<Real>(std::log(layer.density));
    weight(grid->density_layers[1], 1 + side, side) = 1;
    weight(grid->colour_layers[0], side, 1 + side) = 1;
    for (int k = 0; k < 3; ++k)
      weight(grid->colour_layers[1], k, side) = layer.logit[static_cast<size_t>(k)];
  }
  std::vector<uint8_t> levels(grid->occupancy.levels().size(), 0);
  for (size_t i = 0; i < levels.size(); ++i) {
    const double x = double{grid->occupancy.cell_corner(static_cast<int64_t>(i), 0).x} + 1.0 / 32;
    for (const Layer& layer : layers)
      if (x > layer.begin && x < layer.end) levels[i] = 3;
  }
  grid->occupancy.set_levels(levels);
  ModelInfo info;
  info.near = 1e-3;
  info.alpha = true;
  return RadianceField(std::move(info), std::move(grid));
}

// A ray's way through a layer, and how far off float may be.
struct Way {
  double t0 = 0, length = 0, error = 0;
};

// As in render_closed_form_test.cc, from border to border: the march steps over either by a
// millionth of 1 + t, t being at most the diagonal of the box, and a border's place is rounded by
// 4 u, seen at the angle of its axis.
Way way_through(const Layer& layer, const Vec3d& origin, const Vec3d& direction, double near) {
  const Vec3d low{layer.begin, -1, -1}, high{layer.end, 1, 1};
  double t0 = near, t1 = 1e30, slowest = 1;
  for (int i = 0; i < 3; ++i) {
    if (direction[i] == 0) {
      if (origin[i] < low[i] || origin[i] > high[i]) return {};
      continue;
    }
    const double a = (low[i] - origin[i]) / direction[i], b = (high[i] - origin[i]) / direction[i];
    for (const double t : {std::min(a, b), std::max(a, b)}) {
      double& end = t == std::min(a, b) ? t0 : t1;
      const bool ends = &end == &t0 ? t > t0 : t < t1;
      if (!ends) continue;
      end = t;
      slowest = std::min(slowest, std::fabs(direction[i]));
    }
  }
  if (!(t0 < t1)) return {};
  const double length = t1 - t0;
  return {t0, length,
          2e-6 * (1 + 2 * std::sqrt(3.0)) + 8 * kRoundoff / slowest + 2 * kRoundoff * length};
}

struct Shot {
  const char* name;
  double focal;
  Vec3d eye, target;
};
constexpr double kFar = 1e5;
const Shot kShots[] = {{"through both", 30, {-3, 0.1, 0.2}, {0, 0, 0}},
                       {"from the other side", 30, {3, -0.1, 0.2}, {0, 0, 0}},
                       {"slanting", 20, {-2.1, 1.3, -3}, {0, 0, 0}},
                       {"between them", 12, {0.03, 0.1, 0.2}, {-1, 0.3, 0.1}},
                       {"inside of one", 12, {-0.5, 0.1, 0.2}, {1, 0.2, 0.4}},
                       {"along them", 20, {0.013, 0.021, -3}, {0.013, 0.021, 0}},
                       {"far", 6 * kFar, {-kFar + 0.1234, 0.6 * kFar, -0.3 * kFar}, {0, 0, 0}},
                       {"far along the axis", 6 * kFar, {kFar, 0, 0}, {0, 0, 0}},
                       {"away", 12, {2, 2, 2}, {3, 3, 3}}};

// With layers of depth tau, from front to back, T the light before each:
// - a feature is a sum of 8 products of three factors of one rounding each, off by 13 u, and with
// it
//   the density by 13 u + 2 u of the layers of its logarithm, and by 4 u for the exponential; the
//   light left by tau exp(-tau) < 0.37 of that;
// - the length's error moves it by density exp(-tau) times that;
// - each moves what is behind, too, by no more than itself; the sum over samples is composited with
//   kOpacityError (composite_run.h) and rounded in float: rounding_bound(n + 2).
// - a colour's logit, of at most 3, is off by 15 u and two products, times a slope of 1/4.
void compare(const std::string& name, const std::vector<Layer>& layers, bool unclipped,
             WorstError& opacity, WorstError& colour) {
  ThreadPool pool(2);
  const RadianceField field = layered_field(layers);
  RenderOptions options;
  options.skip_nothing();
  options.unclipped = unclipped;
  options.precision = Precision::kF32;  // whose roundings the tolerances are
  options.background = {0.1_r, 0.9_r, 0.3_r};
  for (const Shot& shot : kShots) {
    const Camera camera = pinhole(16, shot.focal);
    const Pose pose = look_at(shot.eye, shot.target);
    const Frame frame = render(field, camera, pose, options, pool);
    expect_picture(frame);
    for (int y = 0; y < camera.height; ++y)
      for (int x = 0; x < camera.width; ++x) {
        const size_t at = static_cast<size_t>(y * camera.width + x);
        const Vec3d direction = pose.rotation * normalized(*unproject(camera, {x + 0.5, y + 0.5}));
        std::vector<std::pair<Way, const Layer*>> met;
        for (const Layer& layer : layers)
          met.push_back({way_through(layer, pose.translation, direction, 1e-3), &layer});
        std::ranges::sort(met, {}, [](const auto& m) { return m.first.t0; });
        double left = 1, tolerance = 12 * kRoundoff;
        std::array<double, 3> want{0, 0, 0};
        for (const auto& [way, layer] : met) {
          const double sigma = std::exp(double{static_cast<Real>(std::log(layer->density))});
          const double tau = sigma * way.length, through = std::exp(-tau);
          for (size_t k = 0; k < 3; ++k)
            want[k] += left * (1 - through) / (1 + std::exp(-double{layer->logit[k]}));
          left *= through;
          const double off = (15 * std::fabs(std::log(layer->density)) + 4) * kRoundoff;
          tolerance +=
              0.37 * off + sigma * way.error * std::exp(-std::max(0.0, tau - sigma * way.error));
        }
        opacity.compare(frame.alpha[at], 1 - left, tolerance, name, shot.name, x, y);
        const double samples = unclipped ? 4 * 3 * 33 : 240;
        for (size_t k = 0; k < 3; ++k)
          colour.compare(frame.rgb[3 * at + k],
                         want[k] + left * double{options.background[static_cast<int>(k)]},
                         tolerance + rounding_bound(samples + 2) + 3 * 17 * kRoundoff / 4, name,
                         shot.name, x, y, "channel", k);
      }
  }
}

// `unclipped` cuts each cell into intervals of its own. Else an interval may begin in one layer and
// end in the other, whose matter counts as that of its middle: not a rounding, so that two layers
// are compared without.
void compare_on_every_target(const std::vector<std::vector<Layer>>& scenes) {
  WorstError opacity("opacity"), colour("colour");
  for_each_target([&](const std::string&) {
    for (const std::vector<Layer>& layers : scenes)
      for (bool unclipped : {true, false}) {
        if (!unclipped && layers.size() > 1) continue;
        compare("densities " + std::to_string(layers.front().density) + " and " +
                    std::to_string(layers.back().density),
                layers, unclipped, opacity, colour);
      }
  });
  opacity.report();
  colour.report();
}

TEST(StressRenderLayers, Slab) {
  std::vector<std::vector<Layer>> scenes;
  for (double density : {1e-6, 1e-3, 0.3, 2.0, 40.0, 1e4})
    for (const auto& [begin, end] : {std::pair{-0.75, -0.25}, {0.25, 0.3125}, {0.25, 1.0}})
      scenes.push_back({{begin, end, density, {0, 2, -3}}});
  compare_on_every_target(scenes);
}

TEST(StressRenderLayers, TwoOfDifferentDensityAndColour) {
  std::vector<std::vector<Layer>> scenes;
  for (const auto& [first, second] :
       {std::pair{0.3, 2.0}, {2.0, 0.3}, {1e-3, 40.0}, {40.0, 1e-3}, {1e4, 1.0}, {1.0, 1e4}})
    scenes.push_back({{-0.75, -0.25, first, {3, -1, 0.5_r}}, {0.25, 0.875, second, {-2, 1, 2}}});
  compare_on_every_target(scenes);
}

// Matter that only absorbs: a wall behind black mist shows its colour times the light that the mist
// lets through, and so does a background, where intervals may follow the cached densities too.
TEST(StressRenderLayers, BlackMist) {
  constexpr std::array<Real, 3> kBlack = {-100, -100, -100};
  std::vector<std::vector<Layer>> scenes;
  for (const double density : {1e-3, 0.3, 2.0, 8.0}) {
    scenes.push_back({{-0.75, -0.25, density, kBlack}});
    scenes.push_back({{-0.75, -0.25, density, kBlack}, {0.25, 0.875, 1e4, {2, -1, 0.5_r}}});
  }
  compare_on_every_target(scenes);
}

// A layer cut in two, at different places: the light that passes both parts is the product of what
// passes each. Three pictures, each off as compare() says of its own layer.
TEST(StressRenderLayers, TransmittanceIsMultiplicativeOverAnySplit) {
  WorstError worst("product_of_parts");
  ThreadPool pool(2);
  constexpr double kBegin = -0.75, kEnd = -0.25;
  for_each_target([&](const std::string&) {
    for (const double density : {1e-3, 0.3, 2.0, 8.0})
      for (const double cut : {-0.6875, -0.5, -0.3125})
        for (const bool unclipped : {true, false})
          for (const Shot& shot : kShots) {
            RenderOptions options;
            options.skip_nothing();
            options.unclipped = unclipped;
            options.precision = Precision::kF32;
            const Camera camera = pinhole(8, shot.focal);
            const Pose pose = look_at(shot.eye, shot.target);
            const std::array<Layer, 3> layers = {{{kBegin, kEnd, density, {0, 0, 0}},
                                                  {kBegin, cut, density, {0, 0, 0}},
                                                  {cut, kEnd, density, {0, 0, 0}}}};
            std::vector<Frame> frames;
            for (const Layer& layer : layers)
              frames.push_back(render(layered_field({layer}), camera, pose, options, pool));
            for (int y = 0; y < camera.height; ++y)
              for (int x = 0; x < camera.width; ++x) {
                const size_t at = static_cast<size_t>(y * camera.width + x);
                const Vec3d direction =
                    pose.rotation * normalized(*unproject(camera, {x + 0.5, y + 0.5}));
                double tolerance = 0;
                std::array<double, 3> left;
                for (size_t i = 0; i < 3; ++i) {
                  left[i] = 1 - double{frames[i].alpha[at]};
                  const Way way = way_through(layers[i], pose.translation, direction, 1e-3);
                  const double off = (15 * std::fabs(std::log(density)) + 4) * kRoundoff;
                  const double sure = density * std::max(0.0, way.length - way.error);
                  tolerance += 12 * kRoundoff + 0.37 * off + density * way.error * std::exp(-sure);
                }
                worst.compare(left[0], left[1] * left[2], tolerance, "density", density, "cut", cut,
                              "unclipped", unclipped, shot.name, x, y);
              }
          }
  });
  worst.report();
}

// Everywhere in [-1, 1]^3 a density of exp(a + slope f) with f = 15 (x + 1) / 2 + 1/2, linear in x.
RadianceField exponential_field(double a, double slope, Real logit) {
  GridOptions options = small_options();
  options.levels = 1;
  options.log2_entries = 13;
  options.base_resolution = options.finest_resolution = 16;
  auto grid = std::make_shared<GridField>(options, /*unbounded=*/false, 1);
  const HashGridLevel& level = grid->shape.levels[0];
  EXPECT_TRUE(level.dense && level.scale == 15);
  const size_t features = static_cast<size_t>(level.features);
  for (size_t row = 0; row < level.entries; ++row) {
    grid->table[row * features] = static_cast<Real>(row % level.resolution);
    grid->table[row * features + 1] = 1;
  }
  const auto weight = [&](const LinearWeights& w, int row, int column) -> Real& {
    return grid->weights[w.offset + static_cast<size_t>(row * weight_stride(w.in) + column)];
  };
  for (int k : {0, 1}) weight(grid->density_layers[0], k, k) = 1;
  weight(grid->density_layers[1], 0, 0) = static_cast<Real>(slope);
  weight(grid->density_layers[1], 0, 1) = static_cast<Real>(a);
  weight(grid->colour_layers[0], 0, grid->options.geometry_features) = 1;
  for (int k = 0; k < 3; ++k) weight(grid->colour_layers[1], k, 0) = logit / 0.28209479177387814_r;
  grid->occupancy.set_levels(std::vector<uint8_t>(grid->occupancy.levels().size(), 3));
  ModelInfo info;
  info.near = 1e-3;
  info.alpha = true;
  return RadianceField(std::move(info), std::move(grid));
}

// An exponential medium: depth sigma(t0) (exp(g L) - 1) / g on a way of length L along which the
// logarithm of the density grows by g per unit. The midpoint rule on intervals that are h wide
// along x is off by (kappa h)^2 / 24 of the depth, kappa being the growth along x: `unclipped`
// takes four in each cell of 1/16, and 240 of the same length, as a large uniform_share has them,
// are 1/120 wide at most (a millionth more). A place off by e moves a density by kappa e of itself,
// and its logarithm is off by 15 u of its terms and 4 u for the exponential (as above); each counts
// with depth exp(-depth) < 0.37. The ends of the way count with the density there.
TEST(StressRenderLayers, ExponentialMedium) {
  WorstError opacity("opacity"), colour("colour");
  ThreadPool pool(2);
  const Layer everywhere{-1, 1, 0, {0, 0, 0}};
  constexpr Real kLogit = 2;
  for_each_target([&](const std::string&) {
    for (const auto& [a, slope] :
         {std::pair{-1.0, 0.2}, {2.0, -0.2}, {-6.0, 0.3}, {1.0, 0.05}, {-3.0, -0.1}}) {
      const RadianceField field = exponential_field(a, slope, kLogit);
      const double k = static_cast<Real>(slope), kappa = 7.5 * k;
      const auto sigma = [&](double x) { return std::exp(a + k * (7.5 * (x + 1) + 0.5)); };
      for (const bool unclipped : {true, false})
        for (const Shot& shot : kShots) {
          RenderOptions options;
          options.skip_nothing();
          options.unclipped = unclipped;
          options.precision = Precision::kF32;
          options.background = {0.1_r, 0.9_r, 0.3_r};
          options.max_samples = 240;
          options.sample_factor = options.uniform_share = 1e6_r;
          const Camera camera = pinhole(12, shot.focal);
          const Pose pose = look_at(shot.eye, shot.target);
          const Frame frame = render(field, camera, pose, options, pool);
          expect_picture(frame);
          const double width = std::fabs(kappa) * (unclipped ? 1.0 / 64 : 1.000001 / 120);
          for (int y = 0; y < camera.height; ++y)
            for (int x = 0; x < camera.width; ++x) {
              const size_t at = static_cast<size_t>(y * camera.width + x);
              const Vec3d d = pose.rotation * normalized(*unproject(camera, {x + 0.5, y + 0.5}));
              const Way way = way_through(everywhere, pose.translation, d, 1e-3);
              const auto at_t = [&](double t) {  // within the box, also of a ray that misses it
                return std::clamp(pose.translation.x + t * d.x, -1.0, 1.0);
              };
              const double x0 = at_t(way.t0), x1 = at_t(way.t0 + way.length);
              const double g = kappa * d.x, grown = g * way.length;
              const double depth = sigma(x0) * way.length *
                                   (std::fabs(grown) < 1e-9 ? 1 : std::expm1(grown) / grown);
              const double left = std::exp(-depth);
              const double off = (15 * (std::fabs(a) + 16 * std::fabs(k)) + 4) * kRoundoff;
              const double tolerance = 12 * kRoundoff +
                                       0.37 * (width * width / 24 * std::exp(width) +
                                               std::fabs(kappa) * way.error + off) +
                                       std::max(sigma(x0), sigma(x1)) * way.error;
              opacity.compare(frame.alpha[at], 1 - left, tolerance, "a", a, "slope", slope,
                              "unclipped", unclipped, shot.name, x, y);
              for (size_t c = 0; c < 3; ++c)
                colour.compare(frame.rgb[3 * at + c],
                               (1 - left) / (1 + std::exp(-double{kLogit})) +
                                   left * double{options.background[static_cast<int>(c)]},
                               tolerance + rounding_bound(4 * 3 * 33 + 2) + 4 * kRoundoff, "a", a,
                               "slope", slope, "unclipped", unclipped, shot.name, x, y, "channel",
                               c);
            }
        }
    }
  });
  opacity.report();
  colour.report();
}

}  // namespace
}  // namespace nerf::stress
