// Whole pictures of a slab, and of two layers of different density and colour with nothing between
// them, against their closed forms.
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

}  // namespace
}  // namespace nerf::stress
