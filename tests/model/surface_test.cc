// The surface of a field whose surface has a closed form.
#include "nerf/model/surface.h"

#include <gtest/gtest.h>

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
