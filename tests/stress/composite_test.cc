// Volume rendering of hard rays: any density, any length, empty, opaque at once, endless.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

#include "kernels/kernel_test.h"
#include "nerf/base/threads.h"
#include "stress/composite_run.h"

namespace nerf::stress {
namespace {

constexpr Real kInf = std::numeric_limits<Real>::infinity();
constexpr Real kDensities[] = {0,     1e-30_r, 1e-10_r, 1e-5_r, 1e-3_r, 0.1_r,
                               1.0_r, 10.0_r,  1e3_r,   1e5_r,  1e8_r,  1e10_r};
constexpr Real kLengths[] = {1e-7_r, 1e-5_r, 1e-3_r, 0.1_r, 1.0_r, 1e2_r, 1e4_r, 1e7_r};

Colour some_colour(Random& random) {
  return {random.uniform(), random.uniform(), random.uniform()};
}

// Every density over every length, alone on a ray, and with something in front and behind.
TEST(StressComposite, EveryDensityOverEveryLength) {
  CompositeErrors errors;
  for_each_target([&](const std::string&) {
    Random random(1, 0, 0);
    for (Real density : kDensities)
      for (Real length : kLengths)
        for (int around : {0, 1, 40}) {
          Matter m;
          for (int i = 0; i < around; ++i) m.add(0.02_r, 0.5_r, some_colour(random));
          m.add(density, length, some_colour(random));
          for (int i = 0; i < around; ++i) m.add(0.3_r, 0.1_r, some_colour(random));
          check_ray(m, errors, "density", density, "length", length, "around", around);
        }
  });
  errors.report();
}

// Densities and lengths that jump over all magnitudes from one sample to the next.
TEST(StressComposite, RandomMagnitudes) {
  CompositeErrors errors;
  for_each_target([&](const std::string&) {
    for (uint64_t i = 0; i < 200; ++i) {
      Random random(2, 0, i);
      Matter m;
      const int n = 1 + static_cast<int>(random.below(240));
      // Thin matter nearly everywhere, or the ray would end at its first samples.
      const double most = i % 2 ? 10 : -1;
      for (int s = 0; s < n; ++s)
        m.add(static_cast<Real>(std::pow(10.0, uniform(random, -12, most))),
              static_cast<Real>(std::pow(10.0, uniform(random, -7, i % 2 ? 7 : 0))),
              some_colour(random));
      check_ray(m, errors, "ray", i, "samples", n);
    }
  });
  errors.report();
}

// The last interval has no end: it stops all light where there is any matter in it, and none where
// there is none.
TEST(StressComposite, EndlessLastInterval) {
  CompositeErrors errors;
  for_each_target([&](const std::string&) {
    Random random(3, 0, 0);
    for (Real length : {1e10_r, 1e20_r, std::numeric_limits<Real>::max(), kInf})
      for (Real density : kDensities)
        for (int before : {0, 1, 30}) {
          Matter m;
          for (int i = 0; i < before; ++i) m.add(0.02_r, 0.5_r, some_colour(random));
          m.add(density, length, {0.25_r, 0.5_r, 1.0_r});
          check_ray(m, errors, "density", density, "length", length, "before", before);
          const Rendered got = run_composite(m);
          const double front = std::exp(-0.01 * before);
          if (density == 0) {
            EXPECT_EQ(got.weights.back(), 0) << "nothing stops light";
          } else if (density >= 1e-5_r) {
            EXPECT_NEAR(got.weights.back(), front, 2 * kOpacityError) << "all that is left";
            EXPECT_EQ(got.pixel[3], 1);
          }
        }
  });
  errors.report();
}

// What stands behind a wall takes no light and receives no gradient, not even of size 1e-30: with
// lengths of up to 1e7 it would be seen.
TEST(StressComposite, OpaqueAtTheFirstSample) {
  CompositeErrors errors;
  for_each_target([&](const std::string&) {
    for (Real density : {1e3_r, 1e10_r})
      for (Real behind : {0.0_r, 1.0_r, 1e10_r})
        for (int n : {1, 2, 239}) {
          Matter m;
          m.add(density, 1.0_r, {0.3_r, 0.6_r, 0.9_r});
          Random random(4, 0, 0);
          for (int i = 1; i < n; ++i)
            m.add(behind, kLengths[static_cast<size_t>(i) % std::size(kLengths)],
                  some_colour(random));
          check_ray(m, errors, "density", density, "behind", behind, "samples", n);
          const Rendered got = run_composite(m);
          EXPECT_EQ(got.weights[0], 1);
          EXPECT_EQ(got.pixel[3], 1);
          for (size_t k = 0; k < 3; ++k) EXPECT_EQ(got.pixel[k], m.colour[0][k]);
          for (size_t i = 0; i < m.size(); ++i) {
            EXPECT_EQ(got.d_density[i], 0) << "sample " << i;
            if (i > 0) {
              EXPECT_EQ(got.weights[i], 0) << "sample " << i;
            }
          }
        }
  });
  errors.report();
}

// No samples, samples of no matter and samples of no length show the background bit for bit.
TEST(StressComposite, EmptyRaysShowTheBackground) {
  CompositeErrors errors;
  for_each_target([&](const std::string&) {
    for (int n : {0, 1, 16, 240})
      for (int kind = 0; kind < 3; ++kind) {
        Matter m;
        for (int i = 0; i < n; ++i)
          m.add(kind == 1 ? 1e10_r : 0.0_r,
                kind == 0   ? 1e7_r
                : kind == 1 ? 0.0_r
                            : kInf,
                {1, 1, 1});
        if (n > 0) check_ray(m, errors, "kind", kind, "samples", n);
        const Rendered got = run_composite(m);
        for (size_t k = 0; k < 3; ++k) EXPECT_EQ(got.pixel[k], m.background[k]);
        EXPECT_EQ(got.pixel[3], 0);
      }
  });
  errors.report();
}

// One sample that stops light among many that do not, at every place.
TEST(StressComposite, OneSpike) {
  CompositeErrors errors;
  for_each_target([&](const std::string&) {
    Random random(5, 0, 0);
    for (Real density : {1e-20_r, 1e-3_r, 1.0_r, 1e10_r})
      for (size_t at : {size_t{0}, size_t{1}, size_t{63}, size_t{126}, size_t{127}}) {
        Matter m;
        for (size_t i = 0; i < 128; ++i)
          m.add(i == at ? density : 0.0_r, i % 2 ? 1e-7_r : 1.0_r, some_colour(random));
        check_ray(m, errors, "density", density, "at", at);
        const Rendered got = run_composite(m);
        for (size_t i = 0; i < 128; ++i)
          if (i != at) {
            EXPECT_EQ(got.weights[i], 0) << i;
          }
      }
  });
  errors.report();
}

// Adding samples behind others never lets more light through.
TEST(StressComposite, OpacityNeverFallsAsSamplesAreAdded) {
  for_each_target([&](const std::string&) {
    for (uint64_t i = 0; i < 20; ++i) {
      Random random(6, 0, i);
      Matter m;
      double before = 0;
      for (int s = 0; s < 100; ++s) {
        m.add(static_cast<Real>(std::pow(10.0, uniform(random, -9, i % 2 ? 1 : 4))),
              static_cast<Real>(std::pow(10.0, uniform(random, -7, 0))), some_colour(random));
        const double opacity = run_composite(m).pixel[3];
        EXPECT_GE(opacity, before) << "ray " << i << " sample " << s;
        before = opacity;
      }
    }
  });
}

// Gradients that the loss hands down, from nearly nothing to huge.
TEST(StressComposite, GradientsOfEverySize) {
  CompositeErrors errors;
  for (Real size : {1e-30_r, 1e-10_r, 1e10_r, 1e25_r}) {
    Random random(7, 0, 0);
    Matter m;
    for (Real& g : m.gradient) g *= size;
    for (int i = 0; i < 100; ++i)
      m.add(static_cast<Real>(std::pow(10.0, uniform(random, -3, 2))),
            static_cast<Real>(std::pow(10.0, uniform(random, -7, 7))), some_colour(random));
    for_each_target([&](const std::string&) { check_ray(m, errors, "size", size); });
  }
  errors.report();
}

}  // namespace
}  // namespace nerf::stress
