// Colours that several samples share, on the tape, where samples have next to no light, and where
// groups are as short, as long or as few as can be.
#include <gtest/gtest.h>

#include <algorithm>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "autodiff/reference_ops.h"
#include "nerf/autodiff/operations.h"
#include "nerf/base/threads.h"
#include "stress/magnitudes.h"

namespace nerf::stress {
namespace {

const std::vector<Rays> kLayouts = {{0}, {0, 0}, {0, 1}, {0, 17, 17, 37}, {0, 64}};
// Where a gradient by complex step takes long.
const std::vector<Rays> kFewSamples = {{0}, {0, 0}, {0, 1}, {0, 5, 5, 18}};

// Powers of ten of the samples' light, which about half of them have: denormal, and of any size.
constexpr std::pair<double, double> kLights[] = {{-45, -37}, {-45, -1}};
// A sample with any light has a group of its own, or none is ever full.
constexpr Real kMosts[] = {0, 1e-40_r, 0.125_r, 2};
// No light is too little, or as soon as there is less than all of it, or all of it is: no groups.
constexpr Real kStops[] = {0, 0.25_r, 1, 1.5_r};

template <class Body>
void for_each_case(const Body& body) {
  for (const auto& [low, high] : kLights)
    for (const Real most : kMosts)
      for (const Real stop : kStops)
        for (const bool flush : {false, true}) {
          SCOPED_TRACE("light up to 1e" + std::to_string(high) + ", most " + std::to_string(most) +
                       ", stop " + std::to_string(stop) + (flush ? ", flushed" : ""));
          const auto guard = flush ? std::make_unique<FlushDenormals>() : nullptr;
          body(TestInput{1, kSamples, true, low, high, /*unit=*/false, /*any_size=*/true}, most,
               stop);
        }
}

// A sum of up to 64 weights in double, whose gradient is that of the sum.
TEST(StressGroupOperations, LightOfEveryMagnitude) {
  for_each_case([](TestInput light, Real most, Real stop) {
    check_operation(
        {"stress_group_light",
         {light},
         {},
         [=](Tape& t, const Values& v) {
           const Value weights = relu(t, v[0]);
           return Values{group_light(t, weights, most, stop), weights};
         },
         4,
         0,
         1,
         /*norms=*/false},
        [=]<class T>(const Given<T>& v) -> Outputs<T> {
          const auto weights = on_columns::relu(v[0]);
          return {on_columns::group_light(weights, v.rays, most, stop), weights};
        },
        kLayouts);
  });
}

// Means, a view for each group, and pixels of them. A mean is a sum of 18 products with shares of
// three roundings, a colour its product with a code of 8, a pixel a sum of up to 18; gradients go
// back through as many, and those of weights are sums over the three rows.
TEST(StressGroupOperations, PixelsOfEveryMagnitude) {
  for_each_case([](TestInput light, Real most, Real stop) {
    check_operation(
        {"stress_group_pixels",
         {light,
          {3, kSamples, true, -1, 1},
          {3, kRays, false, -1, 1, /*unit=*/true},
          {3, kRays, false, 0, 1}},
         {},
         [=](Tape& t, const Values& v) {
           const Value weights = relu(t, v[0]);
           const Value of_groups = group_light(t, weights, most, stop);
           const Value means = mean_of_groups(t, of_groups, v[1]);
           const Value code = slice(t, view_code(t, v[2], kGroups), 1, 3);
           const Value colour = multiply(t, means, code);
           return Values{accumulate(t, of_groups, colour, v[3]), means, of_groups, weights, v[1]};
         },
         110,
         0,
         1,
         /*norms=*/false},
        [=]<class T>(const Given<T>& v) -> Outputs<T> {
          const auto weights = on_columns::relu(v[0]);
          const Rays groups = on_columns::groups_of_rays(weights, v.rays, most, stop);
          const auto of_groups = on_columns::group_light(weights, v.rays, most, stop);
          const auto means = on_columns::mean_of_groups(weights, v[1], v.rays, most, stop);
          const auto code = on_columns::slice(on_columns::view_code(v[2], groups), 1, 3);
          const auto colour = on_columns::multiply(means, code);
          return {on_columns::accumulate(of_groups, colour, v[3], groups), means, of_groups,
                  weights, v[1]};
        },
        kFewSamples);
  });
}

// What the cases above are made for: how many groups there are of samples that all have light.
TEST(StressGroupOperations, AsManyGroupsAsTheBordersSay) {
  const Rays rays{0, 5, 5, 21};
  const auto count = [&](Real light, Real most, Real stop) {
    Tape tape(32, 3);
    const Value weights = tape.input(1, kSamples);
    group_light(tape, weights, most, stop);
    tape.plan();
    Chunk chunk(tape);
    chunk.samples = rays.back();
    chunk.rays = 3;
    chunk.ray_begin = rays.data();
    std::fill_n(chunk.data(weights), chunk.samples, light);
    tape.forward(chunk);
    return chunk.groups;
  };
  for (const Real light : {kDenormal, 1e-30_r, 0x1p-5_r}) {
    SCOPED_TRACE(light);
    EXPECT_EQ(count(light, 0, 0), 21);     // each sample its own
    EXPECT_EQ(count(light, 2, 0), 2);      // each ray with samples one
    EXPECT_EQ(count(light, 0, 1.5_r), 0);  // no light is enough
  }
  EXPECT_EQ(count(0, 0, 0), 2);           // none is not more than none
  EXPECT_EQ(count(0x1p-5_r, 0, 1), 2);    // the first sample of a ray alone
  EXPECT_EQ(count(kDenormal, 0, 1), 21);  // less than a rounding of 1 leaves all of the light
}

}  // namespace
}  // namespace nerf::stress
