#include "nerf/model/grid_field.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <tuple>
#include <vector>

#include "autodiff/reference_ops.h"
#include "kernels/row_states.h"
#include "model/small_grid.h"
#include "nerf/math/contraction.h"
#include "nerf/math/reference/hash_grid.h"

namespace nerf {
namespace {

using test::small_options;

// The whole model from features to the loss: its values, and its gradients by features and weights.
TEST(GridTape, GradientOfTheWholeModel) {
  constexpr Real kShared = 0.05_r, kStop = 0.4_r;
  for (const auto& [density_layers, colour_layers, on_weights, shared] :
       {std::tuple{1, 1, false, false},
        {2, 2, false, false},
        {1, 1, true, false},
        {1, 2, false, true},
        {1, 1, true, true}}) {
    const GridOptions options = small_options(density_layers, colour_layers);
    const GridField field(options, false, 1);
    const GridTape tape(field, /*training=*/true,
                        {.huber_delta = 0.1_r,
                         .on_weights = on_weights,
                         .shared_colour = shared ? kShared : 0,
                         .stop_transmittance = kStop});
    TapeUnderTest test{&tape.tape, {}, {}, {}, {}, 0, /*shared=*/1, /*weight_range=*/0.7};
    test.specs = {{field.shape.features(), Domain::kSamples, true},
                  {3, Domain::kRays, false, -1, 1, /*unit=*/true},
                  {1, Domain::kSamples, false, 0.01, 0.4},
                  {3, Domain::kRays, false, 0, 1},
                  {3, Domain::kRays, false, 0, 1},
                  {1, Domain::kRays, false, 0.01, 0.1}};
    test.inputs = {tape.features,   tape.directions, tape.delta,
                   tape.background, tape.target,     tape.scale};
    if (on_weights) {  // nothing is added
      test.specs.push_back({1, Domain::kSamples, false, 0, 0});
      test.inputs.push_back(tape.weight_gradient);
    }
    for (const auto* layers : {&field.density_layers, &field.colour_layers})
      test.layers.insert(test.layers.end(), layers->begin(), layers->end());
    // The longest chain: sums over 21 inputs and widths of 16 there and back, and over the samples.
    test.roundings = 2 * (8 + 16 * density_layers + 21 + 16 * colour_layers) + 60;
    check_gradients(
        "grid_tape_" + std::to_string(density_layers), test,
        [&]<class T>(const Given<T>& v) -> Outputs<T> {
          const auto h = on_columns::mlp(v[0], v.weights, field.density_layers);
          const auto density = on_columns::truncated_exp(on_columns::slice(h, 0, 1));
          const auto colour_of = [&](const Columns<T>& features, const Columns<T>& code) {
            return on_columns::sigmoid(on_columns::mlp(on_columns::concat(features, code),
                                                       v.weights, field.colour_layers));
          };
          Columns<T> pixel;
          if (shared) {
            const auto most = static_cast<double>(kShared), stop = static_cast<double>(kStop);
            const auto w = on_columns::render_weights(density, v[2], v.rays, false);
            const Rays groups = on_columns::groups_of_rays(w, v.rays, most, stop);
            const auto colour = colour_of(on_columns::mean_of_groups(w, h, v.rays, most, stop),
                                          on_columns::view_code(v[1], groups));
            pixel = on_columns::accumulate(on_columns::group_light(w, v.rays, most, stop), colour,
                                           v[3], groups);
          } else {
            const auto colour = colour_of(h, on_columns::view_code(v[1], v.rays));
            pixel = on_columns::composite(density, colour, v[2], v[3], v.rays).first;
          }
          return {on_columns::huber_loss(pixel, v[4], v[5], static_cast<double>(0.1_r))};
        },
        {{0}, {0, 0, 7, 8, 19}});
  }
}

// What the tape leaves half-way: density and colour before compositing, weights after it.
TEST(GridTape, PartialForwardsAndWeights) {
  const GridField made = [] {
    GridField f(small_options(1, 2), false, 1);
    f.initialise(3);
    return f;
  }();
  for_each_target([&](const std::string&) {
    const GridTape tape(made, /*training=*/false);
    Chunk chunk(tape.tape);
    Random random(92, 0, 0);
    const Rays rays{0, 3, 3, 20};
    chunk.samples = 20;
    chunk.rays = 3;
    chunk.ray_begin = rays.data();
    chunk.weights = made.weights.data();
    Columns<double> features(20), directions(3), delta(20), background(3);
    const auto fill = [&](Value value, Columns<double>& columns, double low, double high) {
      for (size_t s = 0; s < columns.size(); ++s)
        for (int r = 0; r < tape.tape.rows(value); ++r) {
          const Real v = uniform(random, low, high);
          columns[s].push_back(v);
          chunk.data(value)[r * chunk.stride(value) + static_cast<int64_t>(s)] = v;
        }
    };
    fill(tape.features, features, -2, 2);
    fill(tape.directions, directions, -0.6, 0.6);
    fill(tape.delta, delta, 0.05, 0.3);
    fill(tape.background, background, 0, 1);
    // density, colour, pixel and weights by the templates; as Magnitude they say how large an error
    // each rounding may leave.
    const auto by_template = [&]<class T>(T) {
      const auto columns = [](const Columns<double>& from) {
        Columns<T> to;
        for (const auto& column : from) to.emplace_back(column.begin(), column.end());
        return to;
      };
      const std::vector<T> weights(made.weights.begin(), made.weights.end());
      const auto h = on_columns::mlp(columns(features), weights, made.density_layers);
      const auto sigma = on_columns::truncated_exp(on_columns::slice(h, 0, 1));
      const auto code = on_columns::view_code(columns(directions), rays);
      const auto rgb = on_columns::sigmoid(
          on_columns::mlp(on_columns::concat(h, code), weights, made.colour_layers));
      const auto [pixel, weight] =
          on_columns::composite(sigma, rgb, columns(delta), columns(background), rays);
      return std::vector<Columns<T>>{sigma, rgb, pixel, weight};
    };
    const auto wanted = by_template(0.0);
    const auto sizes = by_template(Magnitude());
    // The longest chain: sums over 8 features, widths of 16 and 21 inputs, then over the samples.
    constexpr double kRoundings = 8 + 16 + 21 + 2 * 16 + 60;

    const auto expect = [&](Value value, size_t which, const char* what) {
      const Columns<double>& want = wanted[which];
      for (size_t s = 0; s < want.size(); ++s)
        for (size_t r = 0; r < want[s].size(); ++r)
          ASSERT_NEAR(
              chunk.data(
                  value)[static_cast<int64_t>(r) * chunk.stride(value) + static_cast<int64_t>(s)],
              want[s][r], kRoundings * kRoundoff * sizes[which][s][r].size)
              << what << " row " << r << " column " << s;
    };
    const auto stale = [&](Value value) { return chunk.data(value)[0] == 0; };
    tape.forward_density(chunk);
    expect(tape.density, 0, "density");
    EXPECT_TRUE(stale(tape.colour)) << "colour is not computed for density's sake";
    tape.forward_field(chunk);
    expect(tape.density, 0, "density");
    expect(tape.colour, 1, "colour");
    EXPECT_TRUE(stale(tape.image.pixel));
    tape.tape.forward(chunk);
    expect(tape.image.pixel, 2, "pixel");
    expect(tape.image.weights, 3, "weights");
  });
}

TEST(GridField, EncodeIsEveryLevelOfTheTemplate) {
  GridOptions options = small_options(1, 1);
  options.levels = 4;
  options.finest_resolution = 64;
  GridField field(options, false, 1);
  Random random(93, 0, 0);
  for (Real& v : field.table) v = uniform(random, -1, 1);
  const Matrix places(3, 37, random, 0, 1);
  for_each_target([&](const std::string&) {
    Matrix features(field.shape.features(), 37);
    const Real* x = places.data.data();
    encode(field, {x, x + places.ld, x + 2 * places.ld}, 37, features.data.data(), features.ld);
    for (size_t l = 0; l < field.shape.levels.size(); ++l) {
      const HashGridLevel& level = field.shape.levels[l];
      const size_t per_entry = static_cast<size_t>(level.features);
      const auto begin = field.table.begin() + level.begin();
      const std::vector<double> table(begin, begin + level.entries * per_entry);
      for (int64_t s = 0; s < 37; ++s) {
        const auto want = reference::grid_interpolate<double>(
            {level.scale, level.resolution, level.entries, level.dense, per_entry}, table,
            {places.at(0, s), places.at(1, s), places.at(2, s)});
        for (int f = 0; f < level.features; ++f)
          ASSERT_NEAR(features.at(static_cast<int>(l) * level.features + f, s),
                      want[static_cast<size_t>(f)], 8 * kRoundoff * (level.scale + 4))
              << "level " << l << " sample " << s;
      }
    }
  });
}

TEST(GridField, PositionsOnTheGrid) {
  const GridField bounded(small_options(1, 1), false, 1), unbounded(small_options(1, 1), true, 2);
  EXPECT_EQ(bounded.grid_position({-1, 0, 1}), (Vec3{0, 0.5_r, 1}));
  EXPECT_EQ(bounded.grid_position({0.5_r, -0.5_r, 0.25_r}), (Vec3{0.75_r, 0.25_r, 0.625_r}));
  // Contracted space reaches from -2 to 2; all of it, and infinity, lies within the grid.
  EXPECT_EQ(unbounded.grid_position({0.5_r, -0.5_r, 0}), (Vec3{0.625_r, 0.375_r, 0.5_r}));
  for (const Vec3& p : {Vec3{3, -4, 12}, Vec3{1e6_r, 1, 1}, Vec3{0, -1e18_r, 0}}) {
    const Vec3 g = unbounded.grid_position(p), want = contract(p);
    for (int i = 0; i < 3; ++i) {
      EXPECT_FLOAT_EQ(g[i], want[i] / 4 + 0.5_r);
      EXPECT_GE(g[i], 0);
      EXPECT_LE(g[i], 1);
    }
  }
}

TEST(GridField, InitialWeightsFollowTheSeedAndKeepPaddingZero) {
  GridField a(small_options(1, 2), false, 1), b(small_options(1, 2), false, 1),
      c(small_options(1, 2), false, 1);
  a.initialise(1);
  std::fill(b.weights.begin(), b.weights.end(), 9.0_r);  // whatever was there before
  b.initialise(1);
  c.initialise(2);
  EXPECT_TRUE(std::equal(a.table.begin(), a.table.end(), b.table.begin()));
  EXPECT_TRUE(std::equal(a.weights.begin(), a.weights.end(), b.weights.begin()));
  EXPECT_FALSE(std::equal(a.table.begin(), a.table.end(), c.table.begin()));
  EXPECT_FALSE(std::equal(a.weights.begin(), a.weights.end(), c.weights.begin()));
  double most = 0;
  for (Real v : a.table) most = std::max(most, static_cast<double>(std::fabs(v)));
  EXPECT_GT(most, 0);
  EXPECT_LE(most, 1e-4 * (1 + 1e-6));
  for (const auto* layers : {&a.density_layers, &a.colour_layers})
    for (const LinearWeights& w : *layers) {
      double sum = 0, square = 0;
      const double bound = std::sqrt(6.0 / (w.in + w.out));
      for (int j = 0; j < w.out; ++j)
        for (int k = 0; k < weight_stride(w.in); ++k) {
          const double v = a.weights[gradient_check::Problem::index(w, j, k)];
          if (k >= w.in) {
            ASSERT_EQ(v, 0) << "padding";
            continue;
          }
          ASSERT_LE(std::fabs(v), bound * (1 + 1e-6));
          sum += v;
          square += v * v;
        }
      // Mean 0 and variance bound^2 / 3 of n uniform numbers, within six standard deviations.
      const double n = w.in * w.out;
      EXPECT_LT(std::fabs(sum / n), 6 * bound / std::sqrt(3 * n));
      EXPECT_NEAR(square / n, bound * bound / 3, 6 * bound * bound * std::sqrt(4.0 / 45 / n));
    }
}

}  // namespace
}  // namespace nerf
