// Whole pictures of homogeneous matter against 1 - exp(-density length), the length found in
// double.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "kernels/kernel_test.h"
#include "math/worst_error.h"
#include "stress/stress_field.h"

namespace nerf::stress {
namespace {

// A ray's way through [-half, half]^3, and how far off float may be.
struct Way {
  double t0 = 0, length = 0, error = 0;
};

// Errors of the length: the march steps over the border that it starts on by a millionth of 1 + t,
// and over those of cascades, of which it crosses at most two each; the point where it begins is
// rounded by u half in each coordinate, and so is the border where it ends, twice that and once per
// coordinate along the ray: shifts of the border by 4 u half, seen at the angle of its axis.
Way way_through(const Vec3d& origin, const Vec3d& direction, double near, int cascades) {
  const double half = std::ldexp(1.0, cascades - 1);
  double t0 = near, t1 = 1e30;
  double slowest = 1;
  for (int i = 0; i < 3; ++i) {
    if (direction[i] == 0) {
      if (std::fabs(origin[i]) > half) return {};
      continue;
    }
    const double a = (-half - origin[i]) / direction[i], b = (half - origin[i]) / direction[i];
    if (std::min(a, b) > t0) t0 = std::min(a, b);
    if (std::max(a, b) < t1) {
      t1 = std::max(a, b);
      slowest = std::fabs(direction[i]);
    }
  }
  if (!(t0 < t1)) return {};
  const double length = t1 - t0;
  return {t0, length,
          1e-6 * (1 + length) * (1 + 2 * (cascades - 1)) + 4 * kRoundoff * half / slowest +
              2 * kRoundoff * length};
}

struct Shot {
  const char* name;
  double focal;
  Vec3d eye, target;
};
constexpr double kFar = 1e5;
const Shot kShots[] = {
    {"outside", 20, {2.1, 1.3, -3}, {0, 0, 0}},
    {"inside", 9, {0.3, -0.4, 0.1}, {0.5, 0.5, 0.7}},
    {"on a face", 12, {1, 0.2, 0.1}, {-1, 0.25, 0.3}},
    {"in a corner", 12, {-1, -1, -1}, {0.1, 0, 0.05}},
    {"axis", 30, {0, 0, -3}, {0, 0, 0}},
    {"through corners", 40, {-3, -3, -3}, {0, 0, 0}},
    {"far", 6 * kFar, {kFar + 0.1234, 0.6 * kFar - 0.0217, -0.3 * kFar}, {0, 0, 0}},
    {"far along an axis", 6 * kFar, {0, -kFar, 0}, {0, 0, 0}},
    {"farther", 1e7, {1e7, 2e6, 3e6}, {0, 0, 0}},
    {"away", 12, {2, 2, 2}, {3, 3, 3}},
    {"tiny focal length", 1e-3, {0.2, 0.1, -0.5}, {0.2, 0.1, 0}},
    {"huge focal length", 1e9, {0.2, 0.1, -5}, {0.21, 0.1, 0}}};

// Opacity, colour and depth of every pixel. With density * length = depth:
// - each sample's opacity is off by 3 u of itself (expm1 and its argument), so all together by 3 u
//   (composite_run.h), and density is off by 2 u of itself: depth exp(-depth) 2 u < u;
// - the length's error moves it by density exp(-depth) times that;
// - colours are summed in float over n samples: rounding_bound(n + 2).
void compare(const std::string& name, bool unbounded, int cascades, double density, bool unclipped,
             WorstError& opacity, WorstError& colour, WorstError& depth) {
  ThreadPool pool(2);
  const RadianceField field = constant_field({.unbounded = unbounded,
                                              .cascades = cascades,
                                              .log_density = static_cast<Real>(std::log(density)),
                                              .colour_logit = {0, 2, -3},
                                              .level = 3});
  const double sigma = std::exp(static_cast<double>(static_cast<Real>(std::log(density))));
  RenderOptions options;
  options.skip_nothing();
  options.unclipped = unclipped;
  options.precision = Precision::kF32;  // whose roundings the tolerances are
  options.background = {0.1_r, 0.9_r, 0.3_r};
  for (const Shot& shot : kShots) {
    const Camera camera = pinhole(24, shot.focal);
    const Pose pose = look_at(shot.eye, shot.target);
    const Frame frame = render(field, camera, pose, options, pool);
    expect_picture(frame);
    for (int y = 0; y < camera.height; ++y)
      for (int x = 0; x < camera.width; ++x) {
        const size_t at = static_cast<size_t>(y * camera.width + x);
        const Vec3d in_camera = normalized(*unproject(camera, {x + 0.5, y + 0.5}));
        const Way way = way_through(pose.translation, pose.rotation * in_camera, 1e-3, cascades);
        const double tau = sigma * way.length, left = std::exp(-tau);
        const double moved = sigma * std::exp(-std::max(0.0, tau - sigma * way.error)) * way.error;
        const double tolerance = 4 * kRoundoff + moved + kRoundoff;
        opacity.compare(frame.alpha[at], 1 - left, tolerance, name, density, shot.name, x, y);
        const double samples = unclipped ? 4 * (3 * 33 * cascades) : 48;
        for (size_t k = 0; k < 3; ++k) {
          const double c = 1 / (1 + std::exp(-(k == 0 ? 0.0 : k == 1 ? 2.0 : -3.0)));
          const double background = options.background[static_cast<int>(k)];
          // The logit goes through a product of three factors: 5 u of at most 3, times a slope of
          // at most 1/4.
          colour.compare(frame.rgb[3 * at + k], (1 - left) * c + left * background,
                         tolerance + rounding_bound(samples + 2) + 4 * kRoundoff, name, density,
                         shot.name, x, y, "channel", k);
        }
        // The median: where half of the light is stopped, or none. It is a sample's place, inside
        // the ray's way; where it is to a sample's interval.
        if (left > 0.5 + tolerance) {
          EXPECT_EQ(frame.depth_z[at], 0) << shot.name;
        } else if (left < 0.5 - tolerance) {
          const double t = frame.depth_z[at] / in_camera.z;
          const double middle = way.t0 + 0.5 * way.length;
          depth.compare(t, middle, 0.5 * way.length + way.error + 4 * kRoundoff * middle, name,
                        density, shot.name, x, y);
        }
      }
  }
}

void compare_all(const std::string& name, bool unbounded, int cascades) {
  WorstError opacity(name + "_opacity"), colour(name + "_colour"), depth(name + "_depth");
  for_each_target([&](const std::string&) {
    for (double density : {1e-6, 1e-3, 0.3, 2.0, 40.0, 1e4, 1e12})
      for (bool unclipped : {false, true})
        compare(name, unbounded, cascades, density, unclipped, opacity, colour, depth);
  });
  opacity.report();
  colour.report();
  depth.report();
}

TEST(StressRenderClosedForm, Bounded) { compare_all("bounded", false, 1); }
TEST(StressRenderClosedForm, Unbounded) { compare_all("unbounded", true, 6); }

}  // namespace
}  // namespace nerf::stress
