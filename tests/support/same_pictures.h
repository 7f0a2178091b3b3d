// The same pictures of a field on every SIMD target.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "kernels/kernel_test.h"
#include "nerf/model/radiance_field.h"
#include "nerf/model/renderer.h"

namespace nerf::test {

// Targets differ in the order of sums and by the last digits of exponentials: 2e-6 of a layer's
// output. Behind ten layers, and by way of the places that samples are drawn from, a colour may be
// off by a quarter of what an 8-bit picture can show.
inline constexpr double kMostBetweenTargets = 0.25 / 255;

inline void expect_same_pictures(const RadianceField& field, const Camera& camera, const Pose& pose,
                                 const RenderOptions& options, double most) {
  ThreadPool pool(2);
  const Frame usual = render(field, camera, pose, options, pool);
  double light = 0, contrast = 0;
  for (size_t i = 0; i < usual.alpha.size(); ++i) light += static_cast<double>(usual.alpha[i]);
  for (size_t i = 3; i < usual.rgb.size(); ++i)
    contrast = std::max(contrast, std::fabs(static_cast<double>(usual.rgb[i] - usual.rgb[i - 3])));
  EXPECT_GT(light, 0.1 * static_cast<double>(usual.alpha.size())) << "there is something to see";
  EXPECT_GT(contrast, 0.01);
  WorstError colour("colour"), opacity("opacity");
  for_each_target([&](const std::string&) {
    const Frame frame = render(field, camera, pose, options, pool);
    for (size_t i = 0; i < frame.rgb.size(); ++i)
      colour.compare(frame.rgb[i], usual.rgb[i], most, "value", i);
    for (size_t i = 0; i < frame.alpha.size(); ++i)
      opacity.compare(frame.alpha[i], usual.alpha[i], most, "pixel", i);
  });
  colour.report();
  opacity.report();
}

// Of networks in f32: with everything asked for, and with what renderers leave out.
inline void expect_same_pictures(const RadianceField& field, const Camera& camera,
                                 const Pose& pose) {
  RenderOptions usual;
  usual.precision = Precision::kF32;
  RenderOptions whole = usual;
  whole.skip_nothing();
  expect_same_pictures(field, camera, pose, whole, kMostBetweenTargets);
  // A last digit decides whether a ray ends a sample earlier.
  expect_same_pictures(field, camera, pose, usual,
                       kMostBetweenTargets + static_cast<double>(usual.stop_transmittance));
}

}  // namespace nerf::test
