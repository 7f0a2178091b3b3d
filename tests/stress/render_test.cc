// Whole pictures from every place that a camera can stand at, through the public interface.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "kernels/kernel_test.h"
#include "math/worst_error.h"
#include "nerf/model/renderer.h"
#include "stress/stress_field.h"
#include "stress/views.h"

namespace nerf::stress {
namespace {

// All pixels are numbers in [0, 1], in every mode, whatever the field has learnt.
TEST(StressRender, EveryPixelOfEveryView) {
  ThreadPool pool(2);
  for (bool unbounded : {false, true}) {
    const Similarity frame = engine_frame(unbounded ? 0 : 3e5, unbounded ? 1 : 1e-3);
    std::vector<std::pair<std::string, RadianceField>> fields;
    const int cascades = unbounded ? 4 : 1;
    fields.emplace_back("wild", wild_field(unbounded, cascades, 1, 2, 7, frame));
    fields.emplace_back("huge", wild_field(unbounded, cascades, 1e6_r, 1e3_r, 8, frame));
    fields.emplace_back("huge half floats",  // the largest there are, 65504
                        wild_field(unbounded, cascades, 1e6_r, 1e3_r, 8, frame, 16));
    fields.emplace_back("faint", wild_field(unbounded, cascades, 1e-30_r, 1e-3_r, 9, frame));
    fields.emplace_back("white wall",
                        constant_field({unbounded, cascades, 1e4_r, {1e4_r, 1e4_r, 1e4_r}}, frame));
    fields.emplace_back("white mist",
                        constant_field({unbounded, cascades, -1, {1e4_r, 1e4_r, 1e4_r}}, frame));
    fields.emplace_back("black vacuum",
                        constant_field({unbounded, cascades, -1e4_r, {-1e4_r, 0, 1}}, frame));
    for_each_target([&](const std::string&) {
      for (const auto& [name, field] : fields)
        for (const View& v : views(12))
          for (int mode = 0; mode < 3; ++mode) {
            SCOPED_TRACE(name + (unbounded ? ", unbounded, " : ", bounded, ") + v.name + ", mode " +
                         std::to_string(mode));
            RenderOptions options;
            if (mode == 1) options.unclipped = true;
            if (mode == 2) {
              options.unshaded = 0.2_r;
              options.background = {0, 1, 0.5_r};
              options.sample_factor = 1e-3_r;
            }
            const Frame picture =
                render(field, v.camera, frame.apply_inverse(v.pose), options, pool);
            expect_picture(picture);
          }
    });
  }
}

// Colours of 1/2 everywhere, over black: a pixel is half the sum of its ray's weights, far from
// where pictures are clipped. In double the weights add up to the opacity; each is rounded to Real,
// and so are their sums by colours, the sum of those at the pixel and the opacity, so that of n
// samples rounding_bound(n + 2) of it is lost. n is 240 at most, or four for each cell on the way
// where nothing is cached. The opacity is 1 less a product in double: n 2^-52 more.
TEST(StressRender, WeightsOfEveryRayAddUpToItsOpacity) {
  ThreadPool pool(2);
  WorstError worst("sum_of_weights");
  int64_t clear = 0, opaque = 0, between = 0;
  for (bool unbounded : {false, true}) {
    const int cascades = unbounded ? 4 : 1;
    std::vector<std::pair<std::string, RadianceField>> fields;
    const auto add = [&](const std::string& name, Real features, Real gain, int bits) {
      fields.emplace_back(
          name, wild_field(unbounded, cascades, features, gain, 7, {}, bits, /*grey=*/true));
    };
    add("wild", 1, 2, 32);
    add("wild half floats", 1, 2, 16);
    add("huge", 1e6_r, 1e3_r, 32);
    add("faint", 1e-30_r, 1e-3_r, 32);
    fields.emplace_back("mist", constant_field({unbounded, cascades, -3, {0, 0, 0}}));
    fields.emplace_back("wall", constant_field({unbounded, cascades, 1e4_r, {0, 0, 0}}));
    for_each_target([&](const std::string&) {
      for (const auto& [name, field] : fields)
        for (const View& v : views(12))
          for (int mode = 0; mode < 3; ++mode) {
            RenderOptions options;
            if (mode == 1) options.unclipped = true;
            if (mode == 2) options.skip_nothing();
            options.background = {0, 0, 0};
            options.unshaded = 0;
            const Frame picture = render(field, v.camera, v.pose, options, pool);
            const double samples = options.unclipped ? 4 * 3 * 33 * cascades : 240;
            for (size_t i = 0; i < picture.alpha.size(); ++i) {
              const double alpha = picture.alpha[i];
              ASSERT_TRUE(alpha >= 0 && alpha <= 1 + 1e-6) << name << ' ' << v.name << ' ' << i;
              for (size_t k = 0; k < 3; ++k)
                worst.compare(picture.rgb[3 * i + k], 0.5 * alpha,
                              0.5 * (rounding_bound(samples + 2) * alpha + samples * 0x1p-52), name,
                              v.name, "mode", mode, "pixel", i, "channel", k);
              (alpha == 0 ? clear : alpha > 0.99 ? opaque : between)++;
            }
          }
    });
  }
  worst.report();
  EXPECT_GT(clear, 1000);
  EXPECT_GT(opaque, 1000);
  EXPECT_GT(between, 1000);
}

RenderOptions with(Real RenderOptions::* option, Real value) {
  RenderOptions options;
  options.*option = value;
  return options;
}

// Options at their limits.
void expect_pictures_at_the_limits() {
  ThreadPool pool(2);
  const RadianceField field = wild_field(true, 3, 1, 2, 11);
  const View view = views()[7];
  const auto picture = [&](const RenderOptions& options) {
    const Frame frame = render(field, view.camera, view.pose, options, pool);
    expect_picture(frame);
    return frame;
  };
  const Frame plain = picture({});
  for (Real factor : {0.0_r, 1e-30_r, 1e3_r, 1e30_r, std::numeric_limits<Real>::infinity()})
    for (const auto option : {&RenderOptions::sample_factor, &RenderOptions::uniform_share})
      picture(with(option, factor));
  for (int most : {std::numeric_limits<int>::min(), 0, 1, std::numeric_limits<int>::max()}) {
    RenderOptions options;
    options.max_samples = most;
    picture(options);
  }
  for (Real stop : {0.0_r, 1e-45_r, 1e-30_r, 0.5_r, 1.0_r})
    picture(with(&RenderOptions::min_transmittance, stop));
  for (Real left : {0.0_r, 1e-45_r, 0.5_r, 1.0_r, 1e30_r})
    for (const auto option : {&RenderOptions::unshaded, &RenderOptions::shared_colour,
                              &RenderOptions::stop_transmittance})
      picture(with(option, left));

  // A box without end in some or all directions cuts nothing off; one without volume leaves
  // nothing, and neither does one elsewhere.
  const double inf = std::numeric_limits<double>::infinity();
  for (double far : {1e9, 1e300, inf}) {
    const Frame whole = picture({.bbox = Box3{{-far, -far, -far}, {far, far, far}}});
    EXPECT_EQ(whole.rgb, plain.rgb) << far;
    const Frame half = picture({.bbox = Box3{{-far, -far, 0}, {far, far, far}}});
    const Frame same = picture({.bbox = Box3{{-1e3, -1e3, 0}, {1e3, 1e3, 1e3}}});
    EXPECT_EQ(half.rgb, same.rgb) << far;
    EXPECT_NE(half.rgb, plain.rgb) << far;
  }
  for (const Box3& box : {Box3{{0.1, 0.1, 0.1}, {0.1, 0.1, 0.1}}, Box3{{50, 50, 50}, {60, 60, 60}}})
    for (Real alpha : picture({.bbox = box}).alpha) ASSERT_EQ(alpha, 0);
}

TEST(StressRender, OptionsAtTheirLimits) {
  for_each_target([](const std::string&) { expect_pictures_at_the_limits(); });
}

// Where a capture's coordinates lie, and its unit, make no difference beyond the roundings of
// double: 5e6 units off centre, positions are off by some 1e-9 units, far less than the 2e-6 by
// which a march in float may miss a length (render_closed_form_test.cc). Two such errors times the
// density, and the median depth may be that of the next sample, at most 1/8 away.
TEST(StressRender, CoordinatesOfTheCaptureDoNotMatter) {
  ThreadPool pool(2);
  const View view = views()[7];
  const RadianceField here = constant_field({.log_density = 0.5, .colour_logit = {1, 0, -2}});
  const Frame want = render(here, view.camera, view.pose, {}, pool);
  for (const auto& [offset, scale] : {std::pair{0.0, 1e-9}, {5e6, 1.0}, {5e6, 1e-3}, {1.0, 1e9}}) {
    const Similarity frame = engine_frame(offset, scale);
    const RadianceField there =
        constant_field({.log_density = 0.5, .colour_logit = {1, 0, -2}}, frame);
    for_each_target([&](const std::string&) {
      const Frame got = render(there, view.camera, frame.apply_inverse(view.pose), {}, pool);
      for (size_t i = 0; i < want.alpha.size(); ++i) {
        EXPECT_NEAR(got.alpha[i], want.alpha[i], 2 * 2e-6 * std::exp(0.5) + 1e-6)
            << offset << ' ' << scale;
        EXPECT_NEAR(got.depth_z[i] * scale, want.depth_z[i], 0.125) << offset << ' ' << scale;
      }
    });
  }
}

}  // namespace
}  // namespace nerf::stress
