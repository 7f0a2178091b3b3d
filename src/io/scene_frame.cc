// Centre, scale, near and far. Lengths here are input units until to_engine.scale is known.
#include "scene_frame.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <tuple>

#include "point_cloud.h"
#include "scene_limits.h"
#include "scene_statistics.h"

namespace nerf::internal {
namespace {

double max_abs(const Vec3d& v) { return std::max({std::abs(v.x), std::abs(v.y), std::abs(v.z)}); }

// A camera that stands this many times as far out as most is not what a scene's size is taken from.
constexpr double kFromAfar = 4;

// Geometry of the capture in axes that are level but not yet moved or scaled.
struct Level {
  Mat3d rotation;
  std::vector<Vec3d> cameras, forward, points;  // points: supported ones only
  std::vector<char> central;                    // cameras that are not far from the others
  double spread = 0;                            // median distance of cameras from their median

  // Box of the central cameras and of the middle of the points, from quantile q to 1 - q on each
  // axis.
  Box3 box(double q) const {
    Box3 b;
    for (size_t i = 0; i < cameras.size(); ++i)
      if (central[i]) b.extend(cameras[i]);
    if (points.empty()) return b;
    Vec3d lo, hi;
    for (int k = 0; k < 3; ++k) {
      std::vector<double> values;
      for (const Vec3d& p : points) values.push_back(p[k]);
      lo[k] = quantile(values, q);
      hi[k] = quantile(values, 1 - q);
    }
    b.extend(lo);
    b.extend(hi);
    return b;
  }
};

Level make_level(const Scene& scene, const Mat3d& rotation) {
  Level level;
  level.rotation = rotation;
  for (const View& view : scene.views) {
    level.cameras.push_back(rotation * view.pose.translation);
    // A panorama looks nowhere in particular.
    const bool around = is_panorama(scene.cameras[static_cast<size_t>(view.camera)]);
    level.forward.push_back(around ? Vec3d() : rotation * view.pose.rotation.column(2));
  }
  const std::vector<char> good = supported_points(scene.points);
  for (size_t i = 0; i < scene.points.size(); ++i) {
    if (good[i]) level.points.push_back(rotation * scene.points[i].position);
  }
  const Vec3d middle = median_position(level.cameras);
  std::vector<double> distances;
  for (const Vec3d& c : level.cameras) distances.push_back(length(c - middle));
  level.central = in_the_crowd(distances, kFromAfar);
  level.spread = quantile(distances, 0.5);
  if (level.spread == 0) level.spread = quantile(distances, 1);
  return level;
}

// Those whose optical axis says what they look at.
std::vector<View> views_with_axis(const Scene& scene) {
  std::vector<View> views;
  for (const View& view : scene.views)
    if (!is_panorama(scene.cameras[static_cast<size_t>(view.camera)])) views.push_back(view);
  return views;
}

// Tangent of half the smaller field of view, at most that of 100 degrees.
double half_view(const Camera& camera) {
  return std::min(1.2, std::min(camera.width / camera.fx(), camera.height / camera.fy()) / 2);
}

struct Region {
  Vec3d center;       // level axes
  double radius = 1;  // half the side of the cube that becomes [-1, 1]^3
};

// What all pictures show around the focus: the half side of the object's cube is the distance times
// the tangent of half the field of view. Of cameras at several distances the far ones count, since
// they are the ones that see the object whole.
Region bounded_region(const Scene& scene, const Level& level, const Vec3d& focus) {
  std::vector<double> sizes;
  for (size_t i = 0; i < scene.views.size(); ++i) {
    const double depth = dot(focus - level.cameras[i], level.forward[i]);
    const Camera& camera = scene.cameras[static_cast<size_t>(scene.views[i].camera)];
    if (depth > 0) sizes.push_back(depth * half_view(camera));
  }
  return {focus, sizes.empty() ? level.spread : quantile(sizes, 0.9)};
}

// All cameras but those that stand far out, and for captures that look past each other the central
// points as well.
Region unbounded_region(const Level& level, const std::optional<Vec3d>& focus) {
  constexpr double kMargin = 1.05;  // keeps cameras clear of the box's faces
  Region region;
  if (focus) {
    region.center = *focus;
  } else if (!level.points.empty()) {
    region.center = level.box(0.1).center();
  } else {
    // Nothing says how far the content is: a few camera spreads ahead (nowhere for captures that
    // look all around, whose directions cancel out).
    Vec3d ahead;
    for (const Vec3d& f : level.forward) ahead = ahead + f;
    ahead = ahead / static_cast<double>(level.forward.size());
    region.center = median_position(level.cameras) + ahead * (3 * level.spread);
  }
  std::vector<double> radii;
  for (const Vec3d& c : level.cameras) radii.push_back(max_abs(c - region.center));
  const std::vector<char> counts = in_the_crowd(radii, kFromAfar);
  region.radius = 0;
  for (size_t i = 0; i < radii.size(); ++i)
    if (counts[i]) region.radius = std::max(region.radius, kMargin * radii[i]);
  if (!focus && !level.points.empty()) {
    const Box3 box = level.box(0.1);
    region.radius = std::max(region.radius, max_abs(box.max - region.center));
  }
  return region;
}

// Every supported point well inside the cameras' box, and cameras all around: a turntable before a
// blank wall. Asked strictly, since a background that is cut off cannot be learnt.
bool all_between_cameras(const Level& level, const Region& region) {
  if (level.points.size() < 500 || level.cameras.size() < 12) return false;
  for (const Vec3d& p : level.points) {
    if (max_abs(p - region.center) > 0.6 * region.radius) return false;
  }
  std::array<bool, 12> sector{};
  for (const Vec3d& c : level.cameras) {
    const double turn =
        std::atan2(c.y - region.center.y, c.x - region.center.x) / (2 * std::numbers::pi) + 0.5;
    sector[static_cast<size_t>(std::min(11.0, turn * 12))] = true;
  }
  return std::count(sector.begin(), sector.end(), true) >= 10;
}

// Distances from a point outside or inside to the nearest and the farthest place of [-1, 1]^3.
void box_distances(const Vec3d& p, double* nearest, double* farthest) {
  Vec3d lo, hi;
  for (int k = 0; k < 3; ++k) {
    lo[k] = std::max(0.0, std::abs(p[k]) - 1);
    hi[k] = std::abs(p[k]) + 1;
  }
  *nearest = length(lo);
  *farthest = length(hi);
}

void bounded_near_far(const Level& level, Scene& scene) {
  double near = 1e300, far = 0;
  for (size_t i = 0; i < scene.views.size(); ++i) {
    double n, f;
    box_distances(scene.to_engine.apply(scene.views[i].pose.translation), &n, &f);
    near = std::min(near, n);
    if (level.central[i]) far = std::max(far, f);
  }
  scene.near = std::max(0.02, near);  // of a camera inside the box: clear of its lens
  scene.far = far;
}

// NeRF's load_blender.py: 2 to 6, for cameras that stand 4 units away from the origin.
void published_near_far(Scene& scene) {
  for (const View& view : scene.views)
    if (!(std::abs(length(view.pose.translation) - 4) < 0.25)) return;
  scene.published_near = 2 * scene.to_engine.scale;
  scene.published_far = 6 * scene.to_engine.scale;
}

// Distances of points from the central cameras that see them, engine units. Of points that nobody
// says who sees (a point cloud), from the cameras whose picture they fall into, whatever stands
// before them.
std::vector<double> point_distances(const SceneInput& input, const Scene& scene,
                                    const Level& level) {
  const std::vector<char> good = supported_points(scene.points);
  std::vector<double> distances;
  const auto add = [&](size_t point, size_t view) {
    if (!good[point] || !level.central[view]) return;
    distances.push_back(length(scene.points[point].position - scene.views[view].pose.translation) *
                        scene.to_engine.scale);
  };
  for (const Observation& o : input.observations)
    add(static_cast<size_t>(o.point), static_cast<size_t>(o.image));
  if (!input.observations.empty()) return distances;
  for (size_t v = 0; v < scene.views.size(); ++v) {
    const Camera& camera = scene.cameras[static_cast<size_t>(scene.views[v].camera)];
    for (const size_t p : points_in_picture(scene.points, camera, scene.views[v].pose)) add(p, v);
  }
  return distances;
}

void unbounded_near_far(const SceneInput& input, const Level& level, Scene& scene, bool has_focus) {
  std::vector<double> distances = point_distances(input, scene, level);
  if (!input.depths.empty()) {
    std::vector<double> nears, fars;
    for (const SceneInput::Depths& d : input.depths) {
      nears.push_back(d.near);
      fars.push_back(d.far);
    }
    // One row that is damaged does not decide.
    constexpr double kAbsurd = 50;
    const double usual_near = quantile(nears, 0.5), usual_far = quantile(fars, 0.5);
    double near = usual_near, far = usual_far;
    for (const SceneInput::Depths& d : input.depths) {
      if (d.near * kAbsurd >= usual_near) near = std::min(near, d.near);
      if (d.far <= kAbsurd * usual_far) far = std::max(far, d.far);
    }
    // As NeRF takes them (load_llff.py): a little before the first of what was reconstructed.
    scene.near = 0.9 * near * scene.to_engine.scale;
    scene.far = far * scene.to_engine.scale;
    return;
  }
  if (distances.size() >= 50) {
    std::tie(scene.near, scene.far) = near_far_of(distances);
    return;
  }
  double closest = 1e300;
  for (const View& view : scene.views) {
    closest = std::min(closest, length(scene.to_engine.apply(view.pose.translation)));
  }
  scene.near = has_focus ? std::max(0.01, 0.1 * closest) : 0.02;
  scene.far = 50;
}

Vec3d option_up(const Vec3d& up) {
  if (!coordinate_ok(up) || !(length(up) > 0)) {
    throw Error("the up direction is zero or not finite", "--up", "for example --up 0,0,1");
  }
  return normalized(up);
}

// Without those that stand far out, whose places would tilt the plane of all.
std::vector<View> central_views(const std::vector<View>& views) {
  std::vector<Vec3d> positions;
  for (const View& view : views) positions.push_back(view.pose.translation);
  const Vec3d middle = median_position(positions);
  std::vector<double> distances;
  for (const Vec3d& p : positions) distances.push_back(length(p - middle));
  const std::vector<char> central = in_the_crowd(distances, kFromAfar);
  std::vector<View> kept;
  for (size_t i = 0; i < views.size(); ++i)
    if (central[i]) kept.push_back(views[i]);
  return kept;
}

// What the options say in place of what was found; of every method.
void obey_near_far(Scene& scene) {
  const double scale = scene.to_engine.scale;
  for (const auto& [option, name, used, published] :
       {std::tuple{scene.options.near, "--near", &scene.near, &scene.published_near},
        std::tuple{scene.options.far, "--far", &scene.far, &scene.published_far}}) {
    if (!option) continue;
    if (!(*option > 0 && std::isfinite(*option * scale)))
      throw Error(fmt::format("{} is no distance", *option), name,
                  "a number above 0, in the scene's unit");
    *used = *option * scale;
    if (*published > 0) *published = *used;
  }
  if (!(scene.near < scene.far))
    throw Error(fmt::format("near is {:.4g} and far {:.4g}: nothing lies between",
                            scene.near / scale, scene.far / scale),
                scene.options.near ? "--near" : "--far", "--near and --far set both");
}

void check_bbox(const Box3& box) {
  const Vec3d size = box.size();
  if (!coordinate_ok(box.min) || !coordinate_ok(box.max) ||
      !(size.x > 0 && size.y > 0 && size.z > 0)) {
    throw Error("the box is empty or not finite", "--bbox",
                "six numbers: the smallest x, y, z and the largest, in the scene's coordinates");
  }
}

}  // namespace

void choose_frame(const SceneInput& input, Scene& scene) {
  SceneReport& report = scene.report;
  Vec3d up;
  if (scene.options.up) {
    up = option_up(*scene.options.up);
    report.up_source = "as --up says";
  } else if (input.up) {
    up = *input.up;
    report.up_source = "as the file says";
  } else {
    UpEstimate estimate = estimate_up(central_views(scene.views), scene.points, report.warnings);
    // Blender's world has +z up by its own convention; an estimate near it is rounding.
    if (input.blender && estimate.up.z > 0.98) estimate = {{0, 0, 1}, "Blender's z axis"};
    up = estimate.up;
    report.up_source = estimate.source;
  }
  const Mat3d rotation = rotation_to_z(up);
  const Level level = make_level(scene, rotation);
  if (!(level.spread > 0)) {
    throw Error("all cameras stand at one point: there is no parallax to reconstruct from",
                scene.root.string(), "photos must be taken from different places");
  }
  auto focus = estimate_focus(views_with_axis(scene));
  if (focus) focus = rotation * *focus;

  Region region;
  if (scene.options.bbox) {
    check_bbox(*scene.options.bbox);
    const Box3& box = *scene.options.bbox;
    region.center = rotation * box.center();
    region.radius = 0;
    for (int corner = 0; corner < 8; ++corner) {
      const Vec3d c{corner & 1 ? box.max.x : box.min.x, corner & 2 ? box.max.y : box.min.y,
                    corner & 4 ? box.max.z : box.min.z};
      region.radius = std::max(region.radius, max_abs(rotation * c - region.center));
    }
    // Opaque photos show what is beyond the box too, and it must have a place to be.
    scene.unbounded = !scene.alpha;
  } else if (scene.alpha) {
    region =
        bounded_region(scene, level, focus.value_or(unbounded_region(level, std::nullopt).center));
    scene.unbounded = false;
  } else {
    region = unbounded_region(level, focus);
    scene.unbounded = !(focus && all_between_cameras(level, region));
    if (!scene.unbounded) {
      report.warnings.push_back(
          "every point lies between the cameras: the scene is taken to end there");
    }
  }
  Similarity& to_engine = scene.to_engine;
  to_engine.rotation = rotation;
  to_engine.center = rotation.transposed() * region.center;
  to_engine.scale = 1 / region.radius;
  if (!std::isfinite(to_engine.scale) || !(to_engine.scale > 0)) {
    throw Error("the scene has no size", scene.root.string(), "check the camera positions");
  }
  if (scene.unbounded) {
    unbounded_near_far(input, level, scene, focus.has_value());
  } else {
    bounded_near_far(level, scene);
    if (input.blender && !scene.options.bbox) published_near_far(scene);
  }
  if (input.published) {
    scene.published_near = input.published->near * to_engine.scale;
    scene.published_far = input.published->far * to_engine.scale;
  }
  if (scene.options.near || scene.options.far) obey_near_far(scene);
  report.up = up;
  report.near = scene.near / to_engine.scale;
  report.far = scene.far / to_engine.scale;
  report.extent = make_level(scene, Mat3d{}).box(0.05);
}

}  // namespace nerf::internal
