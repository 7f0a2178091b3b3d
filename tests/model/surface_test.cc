// The surface of a field whose surface has a closed form.
#include "nerf/model/surface.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "geometry/mesh_measures.h"
#include "geometry/shapes.h"
#include "model/analytic_field.h"
#include "model/homogeneous_field.h"
#include "nerf/base/error.h"
#include "support/cameras.h"
#include "support/temp_folder.h"

namespace nerf {
namespace {

constexpr double kRadius = 0.55;

// Six cameras around, in an input frame of its own.
RadianceField seen_by_cameras(const RadianceField& field) {
  ModelInfo info = field.info();
  for (int i = 0; i < 14; ++i) {
    const double z = 1 - 2 * (i + 0.5) / 14, r = std::sqrt(1 - z * z);
    const Vec3d from = Vec3d{r * std::cos(2.4 * i), r * std::sin(2.4 * i), z} * 2.5;
    ModelView view;
    view.name = "r_" + std::to_string(i);
    view.camera = test::pinhole(90, 80, 110);
    view.pose = info.to_engine.apply_inverse(test::looking_at(from, {}));
    info.views.push_back(view);
  }
  // Held out: not looked through.
  info.views.push_back(info.views.front());
  info.views.back().held_out = true;
  info.views.back().pose.translation = {1e6, 0, 0};
  return RadianceField(info, std::make_shared<GridField>(field.grid()));
}

RadianceField ball() {
  return seen_by_cameras(
      test::surface_field(test::tilted(), [](const Vec3d& p) { return length(p) - kRadius; }));
}

SurfaceOptions options_of(int resolution) {
  SurfaceOptions o;
  o.resolution = resolution;
  o.render.precision = Precision::kF32;
  return o;
}

TEST(Surface, OfABallIsWithinHalfAVoxel) {
  const RadianceField field = ball();
  ThreadPool pool(2);
  const SurfaceWork work{pool};
  const SurfaceOptions options = options_of(64);
  const SurfaceRegion region = find_region(field, options, work);
  const double longest = std::max({region.box.size().x, region.box.size().y, region.box.size().z});
  EXPECT_NEAR(longest, 2 * kRadius * 1.1, 0.06);
  const double voxel = longest / options.resolution;
  const auto views = depth_views(field, region, options, work);
  ASSERT_EQ(views.size(), 14u);
  const auto off = [&](const Vec3d& p) { return std::fabs(length(region.to_engine(p)) - kRadius); };
  for (const bool from_depth : {true, false}) {
    SCOPED_TRACE(from_depth ? "depth" : "density");
    TriangleMesh mesh = from_depth ? mesh_from_depth(region, views, options, work)
                                   : mesh_from_density(field, region, views, options, work);
    drop_small_components(mesh, 4 * voxel, 0.02);
    EXPECT_LT(test::mean_distance(mesh, off), 0.5 * voxel);
    EXPECT_NEAR(test::area(mesh), 4 * std::acos(-1.0) * kRadius * kRadius, 0.25);
    const auto colours = surface_colours(field, region, views, mesh.positions, mesh.normals,
                                         2 * voxel, options, work);
    for (const Vec3& c : colours) ASSERT_NEAR(c.y, 0.5, 0.01);
  }
}

// What is not in the box is not in the mesh; its axes are the input's.
TEST(Surface, KeepsToItsBox) {
  const RadianceField field = ball();
  ThreadPool pool(2);
  const SurfaceWork work{pool};
  const SurfaceOptions options = options_of(48);
  Box3 bbox;  // the half of the ball with input x below its centre's
  const Vec3d centre = field.info().to_engine.center;
  bbox.extend(centre - Vec3d{3, 3, 3});
  bbox.extend(centre + Vec3d{0, 3, 3});
  const SurfaceRegion region = region_of(field, bbox);
  const auto views = depth_views(field, region, options, work);
  const TriangleMesh mesh = mesh_from_depth(region, views, options, work);
  ASSERT_GT(mesh.triangles.size(), 100u);
  const double voxel = region.box.size().y / options.resolution;
  for (const Vec3& p : mesh.positions) {
    const Vec3d input = field.info().to_engine.apply_inverse(region.to_engine(p.cast<double>()));
    EXPECT_LT(input.x, centre.x + 2 * voxel / field.info().to_engine.scale);
  }
}

TEST(Surface, HasTheSameBitsForAnyThreads) {
  const RadianceField field = ball();
  ThreadPool one(1), two(2);
  const SurfaceOptions options = options_of(32);
  const auto mesh_of = [&](ThreadPool& pool) {
    const SurfaceWork work{pool};
    const SurfaceRegion region = find_region(field, options, work);
    const auto views = depth_views(field, region, options, work);
    TriangleMesh mesh = mesh_from_depth(region, views, options, work);
    mesh.colours =
        surface_colours(field, region, views, mesh.positions, mesh.normals, 0.02, options, work);
    return mesh;
  };
  const TriangleMesh a = mesh_of(one), b = mesh_of(two);
  EXPECT_EQ(a.positions, b.positions);
  EXPECT_EQ(a.triangles, b.triangles);
  EXPECT_EQ(a.colours, b.colours);
}

// Fog before half of a wall: where it stands light is stopped over all of its depth, and the
// median, which lies in it, is no surface.
TEST(Surface, LeavesOutPixelsWhoseLightIsStoppedOverFar) {
  constexpr double kWall = -0.3, kDensity = 1.5;
  const Box3 fog{{-0.25, 0.05, -0.6}, {0.55, 0.6, 0.6}};
  // The distance at which surface_field() is so dense; e^(-1.5 * 0.8) gets through all of it.
  const double thin = std::log(2000 * std::log(2.0) / kDensity) / 2000;
  const RadianceField half = test::surface_field(Similarity(), [&](const Vec3d& p) {
    double outside = 0;
    for (int k = 0; k < 3; ++k) outside = std::max({outside, fog.min[k] - p[k], p[k] - fog.max[k]});
    return std::min(p.x - kWall, thin + outside);
  });
  ModelInfo info = half.info();
  ModelView view;
  view.name = "a";
  view.camera = test::pinhole(90, 80, 150);
  view.pose = test::looking_at({2.5, 0.02, 0.01}, {});
  info.views = {view};
  auto grid = std::make_shared<GridField>(half.grid());
  // What the cells remember of fog, 1 - e^(-1.5 width) = (level / 255)^2, is not that of a surface.
  const double width = grid->occupancy.cell_width(0);
  std::vector<uint8_t> levels(grid->occupancy.levels().begin(), grid->occupancy.levels().end());
  for (size_t i = 0; i < levels.size(); ++i)
    if (levels[i] > 0 &&
        double{grid->occupancy.cell_corner(static_cast<int64_t>(i), 0).x} > kWall + 2 * width)
      levels[i] = static_cast<uint8_t>(255 * std::sqrt(1 - std::exp(-kDensity * width)));
  grid->occupancy.set_levels(levels);
  const RadianceField field(info, grid);
  ThreadPool pool(2);
  const SurfaceWork work{pool};
  const auto views =
      depth_views(field, region_of(field, {{-1, -1, -1}, {1, 1, 1}}), options_of(64), work);
  ASSERT_EQ(views.size(), 1u);
  const DepthView& seen = views[0];
  const Vec3d o = seen.to_world.translation;
  int left_out = 0, walls = 0;
  for (int y = 0; y < seen.height; ++y)
    for (int x = 0; x < seen.width; ++x) {
      const Vec3d d = seen.to_world.rotation * seen.direction(x, y);  // to a depth of 1
      const double wall = (kWall - o.x) / d.x;
      const Vec3d at = o + d * wall;
      if (std::max(std::fabs(at.y), std::fabs(at.z)) > 0.9) continue;
      const auto inside = [&](double margin) {  // how much of the way is in the fog
        double near = 0, far = wall;
        for (int k = 0; k < 3; ++k) {
          const double a = (fog.min[k] - margin - o[k]) / d[k],
                       b = (fog.max[k] + margin - o[k]) / d[k];
          near = std::max(near, std::min(a, b));
          far = std::min(far, std::max(a, b));
        }
        return far - near;
      };
      const float depth = seen.depth[static_cast<size_t>(y * seen.width + x)];
      // The fog's border is a vertex' distance wide.
      if (inside(-0.03) > 0.65) {
        ++left_out;
        EXPECT_EQ(depth, DepthView::kUnknown) << x << ", " << y;
      } else if (inside(0.03) < 0) {
        ++walls;
        EXPECT_NEAR(depth, wall, 0.01) << x << ", " << y;
      }
    }
  EXPECT_GT(left_out, 200);
  EXPECT_GT(walls, 500);
}

// A ball on a round table in the middle of a dome: the region is that of ball and table, which all
// cameras see. Photos with alpha show nothing that is not meant, so that theirs is everything.
TEST(Surface, FindsTheObjectAndItsTableWithoutTheDome) {
  constexpr double kDome = 0.93, kBall = 0.12, kTable = 0.25, kTop = -0.2, kRim = 0.06;
  const RadianceField scene = test::surface_field(Similarity(), [](const Vec3d& p) {
    const double ball = length(p - Vec3d{0, 0, kTop + kBall}) - kBall;
    const double table = std::max({std::hypot(p.x, p.y) - kTable, p.z - kTop, kTop - kRim - p.z});
    return std::min({ball, table, kDome - length(p)});
  });
  ThreadPool pool(2);
  const SurfaceWork work{pool};
  const auto region = [&](bool alpha) {
    ModelInfo info = scene.info();
    info.alpha = alpha;
    for (int i = 0; i < 16; ++i) {
      const double a = 2 * std::acos(-1.0) * i / 16;
      ModelView view;
      view.name = std::to_string(i);
      view.camera = test::pinhole(90, 80, 70);
      view.pose =
          test::looking_at({0.55 * std::cos(a), 0.55 * std::sin(a), 0.05}, {0, 0, kTop + 0.05});
      info.views.push_back(view);
    }
    return find_region(RadianceField(info, std::make_shared<GridField>(scene.grid())),
                       options_of(64), work)
        .box;
  };
  // 5 % of the longest side is added on each, and the outermost hundredth of the points left away.
  const Box3 box = region(false);
  const double margin = 0.05 * 2 * kTable;
  for (int k = 0; k < 2; ++k) {
    EXPECT_NEAR(box.max[k], kTable + margin, 0.04);
    EXPECT_NEAR(box.min[k], -kTable - margin, 0.04);
  }
  EXPECT_NEAR(box.max.z, kTop + 2 * kBall + margin, 0.04);
  // The table's rim is seen by half of the cameras.
  EXPECT_LT(box.min.z, kTop - margin + 0.01);
  EXPECT_GT(box.min.z, kTop - kRim - margin - 0.01);
  const Box3 all = region(true);
  EXPECT_GT(all.max.x, 0.8);
  EXPECT_LT(all.min.y, -0.8);
}

TEST(Surface, SaysWhereThereIsNone) {
  const RadianceField fog = seen_by_cameras(test::homogeneous_field(test::tilted()));
  ThreadPool pool(1);
  const SurfaceWork work{pool};
  SurfaceOptions options = options_of(32);
  options.opaque = 0.99;  // its longest way, the cube's diagonal, lets 3 % of the light through
  EXPECT_TRUE(
      test::contains(test::error_of([&] { find_region(fog, options, work); }), "see no surface"));
}

}  // namespace
}  // namespace nerf
