// Pictures whose lines are read one after another.
#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "model/homogeneous_field.h"
#include "nerf/math/refined_camera.h"
#include "nerf/model/network_field.h"
#include "nerf/model/renderer.h"
#include "support/cameras.h"

namespace nerf {
namespace {

// Each row against the picture of the pose that it has.
TEST(LineMotion, PicturesAreThoseOfEachRowsPose) {
  const Similarity to_engine = test::tilted();
  const RadianceField field = test::homogeneous_field(to_engine, /*half_empty=*/true);
  Pose pose;
  pose.translation = to_engine.center + Vec3d{0.3, -0.2, -9};
  Camera still = test::pinhole(20, 14, 20, 22), moving = still;
  moving.motion.twist = {{0.3, -0.5, 0.8}, {2, -1, 0.5}};
  RenderOptions options;
  options.skip_nothing();
  options.unclipped = false;
  ThreadPool pool(2);
  const auto colours = [&](const Camera& camera, const Pose& at) {
    return render(field, camera, at, options, pool).rgb;
  };
  const std::vector<Real> whole = colours(moving, pose);
  double most = 0;  // by which a row differs from that of the given pose
  const std::vector<Real> of_middle = colours(still, pose);
  for (int y = 0; y < still.height; ++y) {
    const Pose row = line_pose(moving, pose, line_share(moving, {0.5, y + 0.5}));
    const std::vector<Real> want = colours(still, row);
    for (size_t x = 0; x < 3 * static_cast<size_t>(still.width); ++x) {
      const size_t i = 3 * static_cast<size_t>(y * still.width) + x;
      EXPECT_NEAR(static_cast<double>(whole[i]), static_cast<double>(want[i]), 1e-5)
          << y << " " << x;
      most = std::max(most, std::abs(static_cast<double>(whole[i] - of_middle[i])));
    }
  }
  EXPECT_GT(most, 0.05);
  // Several rays to a pixel are those of a larger picture, in bands.
  options.supersample = 2;
  const std::vector<Real> two = colours(moving, pose);
  options.supersample = 1;
  const std::vector<Real> large = colours(moving.scaled_to(40, 28), pose);
  for (size_t y = 0; y < 14; ++y)
    for (size_t x = 0; x < 20; ++x)
      for (size_t k = 0; k < 3; ++k) {
        const auto at = [&](size_t u, size_t v) {
          return large[3 * ((2 * y + v) * 40 + 2 * x + u) + k];
        };
        EXPECT_NEAR(static_cast<double>(two[3 * (y * 20 + x) + k]),
                    static_cast<double>((at(0, 0) + at(1, 0) + at(0, 1) + at(1, 1)) / 4), 1e-6);
      }
}

}  // namespace
}  // namespace nerf
