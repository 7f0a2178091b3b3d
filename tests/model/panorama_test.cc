// Panoramas of matter whose opacity along every ray has a closed form, from the middle and from the
// eyes of a stereo picture.
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "model/homogeneous_field.h"
#include "nerf/model/renderer.h"
#include "support/boxed_view.h"

namespace nerf {
namespace {

using test::homogeneous_field;
using test::tilted;

// Distance at which a ray that meets the box enters it.
double entry(const Vec3d& origin, const Vec3d& direction, const Box3& box) {
  double t = 0;
  for (int i = 0; i < 3; ++i)
    t = std::max(t, std::min((box.min[i] - origin[i]) / direction[i],
                             (box.max[i] - origin[i]) / direction[i]));
  return t;
}

// Density 1 where x > 0 in the engine's cube, seen from inside and outside of it: what the beams of
// a tile jump over is nothing that one of its rays meets.
TEST(PanoramaPicture, OpacityIsThatOfEveryRay) {
  const Similarity to_engine = tilted();
  const RadianceField field = homogeneous_field(to_engine, /*half_empty=*/true);
  const Box3 matter{{0, -1, -1}, {1, 1, 1}};  // engine coordinates
  ThreadPool pool(2);
  RenderOptions options;
  options.supersample = 1;
  options.interpolated = 0;
  for (const Vec3d& in_engine : {Vec3d{-0.5, 0.1, 0.2}, Vec3d{0.3, -0.2, 0.1}, Vec3d{-2, 1.5, 0.3}})
    for (const double eye : {0.0, -0.9, 0.9}) {  // input units, 0.225 of the engine's
      Camera camera = panorama(48, 24);
      camera.params[4] = eye;
      Pose pose;
      pose.rotation = tilted().rotation * tilted().rotation;
      pose.translation = to_engine.apply_inverse(in_engine);
      const Frame frame = render(field, camera, pose, options, pool);
      int seen = 0, depths = 0;
      for (int y = 0; y < 24; ++y)
        for (int x = 0; x < 48; ++x) {
          const double azimuth = 2 * std::numbers::pi * (x + 0.5 - 24) / 48;
          const double down = std::numbers::pi * (y + 0.5 - 12) / 24;
          const Vec3d d{std::cos(down) * std::sin(azimuth), std::sin(down),
                        std::cos(down) * std::cos(azimuth)};
          const Vec3d from = Vec3d{std::cos(azimuth), 0, -std::sin(azimuth)} * eye;
          const Vec3d direction = to_engine.rotation * (pose.rotation * d);
          // From inside nothing is drawn that is nearer than the model says.
          const Vec3d origin = to_engine.apply(pose * from) + direction * field.info().near;
          const double inside = test::length_inside(origin, direction, matter);
          const size_t at = static_cast<size_t>(y * 48 + x);
          ASSERT_NEAR(frame.alpha[at], 1 - std::exp(-inside), 2e-5)
              << x << ' ' << y << " eye " << eye << " from " << in_engine.x;
          seen += inside > 0.1;
          if (inside < 0.9) continue;
          // Depth is where half of the light is stopped, along the ray, also behind the pose.
          ++depths;
          EXPECT_NEAR(frame.depth_z[at] * to_engine.scale,
                      field.info().near + entry(origin, direction, matter) + std::log(2.0), 0.08)
              << x << ' ' << y;
        }
      EXPECT_GT(seen, 30);
      EXPECT_GT(depths, 10);
    }
}

}  // namespace
}  // namespace nerf
