// Colours that several samples share: borders, means and gradients of groups.
#include <gtest/gtest.h>

#include <vector>

#include "autodiff/reference_ops.h"
#include "nerf/autodiff/operations.h"

namespace nerf {
namespace {

constexpr double kMost = 0.125, kStop = 0.25;

TEST(Gradient, GroupLight) {
  check_operation(
      {"group_light",
       {{1, kSamples, true, 0, 0.1}},
       {},
       [](Tape& t, const Values& v) { return Values{group_light(t, v[0], kMost, kStop), v[0]}; },
       80},
      []<class T>(const Given<T>& v) -> Outputs<T> {
        return {on_columns::group_light(v[0], v.rays, kMost, kStop), v[0]};
      });
}

TEST(Gradient, MeanOfGroups) {
  for (int needs = 1; needs < 4; ++needs)
    check_operation(
        {"mean_of_groups",
         {{1, kSamples, (needs & 1) != 0, 1e-3, 0.1}, {5, kSamples, (needs & 2) != 0, -1, 1}},
         {},
         [](Tape& t, const Values& v) {
           const Value light = group_light(t, v[0], kMost, kStop);
           return Values{mean_of_groups(t, light, v[1]), light};
         },
         120},
        []<class T>(const Given<T>& v) -> Outputs<T> {
          return {on_columns::mean_of_groups(v[0], v[1], v.rays, kMost, kStop),
                  on_columns::group_light(v[0], v.rays, kMost, kStop)};
        });
}

// From densities to pixels, with what else reads weights and features, as the grid method has it.
TEST(Gradient, ColoursOfGroups) {
  static const LinearWeights w{0, 4 + 16, 3};
  check_operation(
      {"colours_of_groups",
       {{1, kSamples, true, -2, 2},
        {4, kSamples, true, -1, 1},
        {1, kSamples, false, 0.01, 0.3},
        {3, kRays, false, -1, 1, /*unit=*/true},
        {3, kRays, false, 0, 1}},
       {w},
       [](Tape& t, const Values& v) {
         const Value weights = render_weights(t, softplus(t, v[0], -1), v[2], false);
         const Value light = group_light(t, weights, kMost, kStop);
         const Value features = mean_of_groups(t, light, v[1]);
         const Value input = concat(t, features, view_code(t, v[3], kGroups));
         const Value colour = sigmoid(t, linear(t, input, w, LinearActivation::kNone));
         return Values{accumulate(t, light, colour, v[4]), features, weights, v[1]};
       },
       500,
       /*shared=*/4},
      []<class T>(const Given<T>& v) -> Outputs<T> {
        const auto weights =
            on_columns::render_weights(on_columns::softplus(v[0], -1), v[2], v.rays, false);
        const auto light = on_columns::group_light(weights, v.rays, kMost, kStop);
        const auto features = on_columns::mean_of_groups(weights, v[1], v.rays, kMost, kStop);
        const Rays groups = on_columns::groups_of_rays(weights, v.rays, kMost, kStop);
        const auto input = on_columns::concat(features, on_columns::view_code(v[3], groups));
        const auto colour = on_columns::sigmoid(on_columns::linear(input, v.weights, w, false));
        return {on_columns::accumulate(light, colour, v[4], groups), features, weights, v[1]};
      });
}

// Weights of 0.1, 0.05 and so on; the borders are counted by hand.
TEST(Groups, EndWhereTheirLightIsEnough) {
  const std::vector<Real> w{0.0625_r, 0.0625_r, 0.03125_r, 0.5_r, 0, 0.0625_r, 0.25_r, 0.01_r, 0};
  const Rays rays{0, 0, 8, 9};
  Tape tape(16, 4);
  const Value weights = tape.input(1, kSamples), light = group_light(tape, weights, 0.125_r, 0.1_r);
  const Value x = tape.input(1, kSamples), mean = mean_of_groups(tape, light, x);
  tape.plan();
  Chunk chunk(tape);
  chunk.samples = 9;
  chunk.rays = 3;
  chunk.ray_begin = rays.data();
  for (size_t i = 0; i < w.size(); ++i) {
    chunk.data(weights)[i] = w[i];
    chunk.data(x)[i] = static_cast<Real>(i);
  }
  tape.forward(chunk);
  // {0, 1}, {2}, {3} alone, {4, 5}, {6}; 0.09 of the light are left before 7, which is in none; the
  // last ray has no light at all.
  ASSERT_EQ(chunk.groups, 6);
  const GroupState& groups = chunk.state<GroupState>(light);
  const int of[] = {0, 0, 1, 2, 3, 3, 4, 4, 5}, of_rays[] = {0, 0, 5, 6};
  const Real sums[] = {0.125_r, 0.03125_r, 0.5_r, 0.0625_r, 0.25_r, 0},
             means[] = {0.5_r, 2, 3, 5, 6, 8};
  for (size_t i = 0; i < 9; ++i) {
    EXPECT_EQ(groups.of[i], of[i]) << i;
    EXPECT_EQ(groups.share[i] > 0, i != 7) << i;
    EXPECT_EQ(groups.per_light[i] > 0, i != 7) << i;
  }
  for (size_t g = 0; g < 6; ++g) {
    EXPECT_EQ(chunk.data(light)[g], sums[g]) << g;
    EXPECT_NEAR(chunk.data(mean)[g], means[g], 1e-6) << g;
  }
  for (size_t r = 0; r < 4; ++r) EXPECT_EQ(chunk.group_begin[r], of_rays[r]) << r;
}

}  // namespace
}  // namespace nerf
