#include "nerf/io/camera_path.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <numbers>

#include "camera_orbit.h"
#include "nerf/base/error.h"
#include "nerf/base/text.h"
#include "nerf/math/camera_paths.h"

namespace nerf {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr Vec3d kUp{0, 0, 1};  // of the engine's frame

// Cameras with a gap this wide between their azimuths stand on one side (spiral, ellipse).
constexpr double kWidestGap = 150 * kPi / 180;
// Constant speed along paths: a turn by one radian counts as much as a move by this share of the
// distance to what the cameras look at.
constexpr double kTurnShare = 0.5;

// What the generators know of a capture; engine coordinates.
struct Rig {
  std::vector<Pose> cameras;
  Vec3d middle;          // mean position
  Vec3d focus;           // what the cameras look at; of panoramas the middle of the scene
  double distance = 1;   // mean distance from the focus, > 0
  bool outward = false;  // most cameras look away from the focus
  Arc arc;               // azimuths seen from the focus
};

double horizontal(const Vec3d& v) { return std::hypot(v.x, v.y); }

std::vector<const ModelView*> training_views(const ModelInfo& info) {
  std::vector<const ModelView*> views;
  for (const ModelView& view : info.views)
    if (!view.held_out) views.push_back(&view);
  if (views.empty())
    for (const ModelView& view : info.views) views.push_back(&view);
  if (views.empty())
    throw Error("the model holds no cameras to make a path from", "",
                "give a camera path file to --views");
  return views;
}

// Where the axes do not meet: along their mean direction, at the depth of the engine's origin (the
// middle of the scene), else at the depth that LLFF uses between the nearest and farthest content.
Vec3d distant_focus(const ModelInfo& info, const std::vector<Pose>& cameras, const Vec3d& middle) {
  Vec3d forward;
  for (const Pose& c : cameras) forward = forward + c.rotation.column(2);
  if (length(forward) < 0.2 * static_cast<double>(cameras.size())) return middle;
  forward = normalized(forward);
  double depth = dot(-middle, forward);
  if (depth < 0.05) {
    depth = 1;
    if (info.near > 0 && info.far > info.near && std::isfinite(info.far))
      depth = 1 / (0.25 / info.near + 0.75 / info.far);
  }
  return middle + forward * depth;
}

Rig make_rig(const ModelInfo& info) {
  Rig rig;
  for (const ModelView* view : training_views(info)) {
    const Pose pose = info.to_engine.apply(view->pose);
    const bool finite = std::isfinite(dot(pose.translation, pose.translation));
    if (!finite || !(orthonormality_error(pose.rotation) < 1e-3))
      throw Error("the camera of view '" + view->name + "' is no rigid pose", "",
                  "the model file is damaged: train again");
    rig.cameras.push_back(pose);
    rig.middle = rig.middle + pose.translation;
  }
  const auto n = static_cast<double>(rig.cameras.size());
  rig.middle = rig.middle / n;
  const auto views = training_views(info);
  const bool around = std::ranges::all_of(views, [](auto* v) { return is_panorama(v->camera); });
  const auto meeting = around ? std::optional(Vec3d()) : nearest_point_to_axes(rig.cameras);
  rig.focus = meeting ? *meeting : distant_focus(info, rig.cameras, rig.middle);

  double distance = 0;
  int away = 0;
  std::vector<double> azimuths;
  for (const Pose& c : rig.cameras) {
    const Vec3d from_focus = c.translation - rig.focus;
    distance += length(from_focus) / n;
    away += !around && dot(c.rotation.column(2), from_focus) > 0;
    // The azimuth of a camera above the focus says nothing; that of one at it neither.
    if (horizontal(from_focus) > 0.05 * length(from_focus))
      azimuths.push_back(std::atan2(from_focus.y, from_focus.x));
  }
  if (distance > 1e-9) rig.distance = distance;
  rig.outward = 2 * away > static_cast<int>(rig.cameras.size());
  rig.arc = covered_arc(azimuths, kWidestGap);
  return rig;
}

// Level pose at `position`, towards the focus or away from it.
Pose looking(const Rig& rig, const Vec3d& position) {
  const Vec3d ray = rig.outward ? position - rig.focus : rig.focus - position;
  return {look_rotation(length(ray) > 0 ? ray : Vec3d{1, 0, 0}, kUp), position};
}

PoseCurve spherified(const Rig& rig) {
  double square = 0, height = 0;
  const auto n = static_cast<double>(rig.cameras.size());
  for (const Pose& c : rig.cameras) {
    const Vec3d p = c.translation - rig.focus;
    square += dot(p, p) / n;
    height += p.z / n;
  }
  // Cameras straight above would leave a circle of no size.
  const double radius = std::sqrt(std::max(square - height * height, 0.0625 * square));
  return {[rig, radius, height](double u) {
            const double azimuth = 2 * kPi * u;
            return looking(rig, rig.focus + Vec3d{radius * std::cos(azimuth),
                                                  radius * std::sin(azimuth), height});
          },
          0};
}

PoseCurve ellipse(const Rig& rig) {
  const Vec3d center = rig.arc.full ? rig.focus : rig.middle;
  // Principal directions of the positions seen from above, in closed form.
  double xx = 0, xy = 0, yy = 0, height = 0;
  for (const Pose& c : rig.cameras) {
    const Vec3d p = c.translation - center;
    xx += p.x * p.x;
    xy += p.x * p.y;
    yy += p.y * p.y;
    height += c.translation.z / static_cast<double>(rig.cameras.size());
  }
  const double turn = 0.5 * std::atan2(2 * xy, xx - yy);
  const Vec3d a{std::cos(turn), std::sin(turn), 0}, b{-std::sin(turn), std::cos(turn), 0};
  std::vector<double> along, across;
  for (const Pose& c : rig.cameras) {
    along.push_back(std::abs(dot(c.translation - center, a)));
    across.push_back(std::abs(dot(c.translation - center, b)));
  }
  // As mip-NeRF 360: nine in ten cameras lie within. A line of cameras gets some width.
  const double major = std::max(quantile(along, 0.9), 0.05 * rig.distance);
  const double minor = std::max(quantile(across, 0.9), 0.2 * major);
  return {[=](double u) {
            const Vec3d p =
                center + a * (major * std::cos(2 * kPi * u)) + b * (minor * std::sin(2 * kPi * u));
            return looking(rig, {p.x, p.y, height});
          },
          0};
}

PoseCurve spiral(const Rig& rig) {
  Vec3d position = rig.middle, forward;
  for (const Pose& c : rig.cameras) forward = forward + c.rotation.column(2);
  if (rig.arc.full || rig.outward || length(forward) < 1e-6) {
    position = rig.cameras.front().translation;
    forward = rig.cameras.front().rotation.column(2);
  }
  Mat3d base = look_rotation(forward, kUp);
  const double depth = std::max(dot(rig.focus - position, base.column(2)), 0.2 * rig.distance);
  Vec3d radii{0.15 * depth, 0.15 * depth, 0.05 * depth};
  if (!rig.arc.full && !rig.outward) {
    for (int axis = 0; axis < 3; ++axis) {
      std::vector<double> offsets;
      for (const Pose& c : rig.cameras)
        offsets.push_back(std::abs(dot(c.translation - position, base.column(axis))));
      radii[axis] = std::min(quantile(offsets, 0.9), 0.5 * depth);
    }
    if (std::max(radii.x, radii.y) < 0.02 * depth) radii = Vec3d{0.05, 0.05, 0.02} * depth;
  }
  const Vec3d target = position + base.column(2) * depth;
  // Two turns, while the distance goes forth and back once.
  return {[=](double u) {
            const double angle = 4 * kPi * u;
            const Vec3d offset{radii.x * std::cos(angle), radii.y * std::sin(angle),
                               radii.z * std::sin(angle / 2)};
            const Vec3d p = position + base * offset;
            return Pose{look_rotation(target - p, kUp), p};
          },
          0};
}

std::string numbered(const std::string& prefix, size_t i) {
  char number[32];
  std::snprintf(number, sizeof(number), "_%04zu", i);
  return prefix + number;
}

std::vector<double> even_parameters(int count) {
  std::vector<double> parameters(static_cast<size_t>(count));
  for (int i = 0; i < count; ++i)
    parameters[static_cast<size_t>(i)] = i / static_cast<double>(count);
  return parameters;
}

void add_curve(CameraPath& path, const ModelInfo& info, const PoseCurve& curve,
               const std::vector<double>& parameters, const std::string& name) {
  const Camera camera = path_camera(info);
  const bool timed = has_times(info);
  for (size_t i = 0; i < parameters.size(); ++i) {
    PathFrame frame{numbered(name, i), camera,
                    info.to_engine.apply_inverse(curve.at(parameters[i])), 0};
    frame.camera_to_world.rotation = orthonormalized(frame.camera_to_world.rotation);
    if (timed && parameters.size() > 1)
      frame.time = static_cast<double>(i) / static_cast<double>(parameters.size() - 1);
    path.frames.push_back(std::move(frame));
  }
}

// Densities by the engine's unit at points in its coordinates.
std::function<std::vector<double>(std::span<const Vec3d>)> engine_density(
    const ModelInfo& info, const PathOptions::Density& density) {
  return [&info, density](std::span<const Vec3d> points) {
    std::vector<Vec3d> input;
    for (const Vec3d& p : points) input.push_back(info.to_engine.apply_inverse(p));
    std::vector<double> values = density(input);
    for (double& v : values) v /= info.to_engine.scale;
    return values;
  };
}

// Of a rig the views of one camera, that of the most, held out or not: a path through all of them
// would jump from camera to camera at each moment.
std::vector<const ModelView*> views_in_a_row(const ModelInfo& info) {
  std::map<int, std::vector<const ModelView*>> cameras;
  for (const ModelView& view : info.views) cameras[view.ids.camera].push_back(&view);
  if (!has_times(info) || cameras.size() < 2 || cameras.contains(-1)) return training_views(info);
  return std::ranges::max_element(cameras, {}, [](const auto& c) { return c.second.size(); })
      ->second;
}

void add_interpolation(CameraPath& path, const ModelInfo& info, int frames) {
  auto views = views_in_a_row(info);
  const bool timed = has_times(info);
  const auto before = [&](const ModelView* a, const ModelView* b) {
    return timed ? a->time < b->time : natural_less(a->name, b->name);
  };
  // Equal ones in the model's order, which is that of their addresses.
  std::sort(views.begin(), views.end(), [&](const ModelView* a, const ModelView* b) {
    return before(a, b) || (!before(b, a) && a < b);
  });
  const Rig rig = make_rig(info);
  std::vector<Pose> keys;
  for (const ModelView* view : views) keys.push_back(info.to_engine.apply(view->pose));
  const double turn_weight = kTurnShare * rig.distance;
  const PoseSpline spline(keys, turn_weight);
  if (spline.distinct_keys() < 2)
    throw Error("interpolate needs at least two training cameras at different poses", "--views",
                "use orbit or spiral");
  const Camera camera = path_camera(info);
  const PoseCurve curve{[&](double u) { return spline.at(u); }, turn_weight};
  const auto parameters = constant_speed_parameters(curve, frames, false);
  for (size_t i = 0; i < parameters.size(); ++i) {
    PathFrame frame{numbered("interpolate", i), camera,
                    info.to_engine.apply_inverse(curve.at(parameters[i])), 0};
    frame.camera_to_world.rotation = orthonormalized(frame.camera_to_world.rotation);
    if (timed) {
      const auto [key, next, fraction] = spline.place_of(parameters[i]);
      const double from = views[static_cast<size_t>(key)]->time;
      frame.time = from + fraction * (views[static_cast<size_t>(next)]->time - from);
    }
    path.frames.push_back(std::move(frame));
  }
}

void add_views(CameraPath& path, const ModelInfo& info, bool held_out) {
  for (const ModelView& view : info.views)
    if (view.held_out == held_out)
      path.frames.push_back({view.name, view.camera, view.pose, view.time});
  if (path.frames.empty())
    throw Error(held_out ? "the model has no held-out views" : "the model has no training views",
                "--views",
                held_out ? "it was trained with --holdout none: use train, orbit, spiral, "
                           "spherified, ellipse or interpolate"
                         : "use test, or give a camera path file");
}

}  // namespace

Camera panorama_of(PictureKind picture, int width, int height) {
  NERF_CHECK(picture != PictureKind::kPerspective);
  return panorama(width, height, picture == PictureKind::kVr180 ? kPi : 2 * kPi);
}

Camera path_camera(const ModelInfo& info) {
  const auto views = training_views(info);
  // Of a photo that lies on a side the picture as it is seen upright.
  const auto on_a_side = [&](const ModelView* view) {
    const Mat3d& level = info.to_engine.apply(view->pose).rotation;
    return std::abs(level.column(0).z) > 0.7 && std::abs(level.column(1).z) < 0.5;
  };
  const auto size_of = [&](const ModelView* view) {
    const auto [w, h] = std::pair(view->camera.width, view->camera.height);
    return on_a_side(view) ? std::pair(h, w) : std::pair(w, h);
  };
  std::map<std::pair<int, int>, int> sizes;
  for (const ModelView* view : views) ++sizes[size_of(view)];
  const auto common =
      std::max_element(sizes.begin(), sizes.end(), [](const auto& a, const auto& b) {
        return a.second < b.second;
      })->first;
  std::vector<double> fx, fy;
  bool fisheye = false;
  for (const ModelView* view : views) {
    const Camera& c = view->camera;
    if (size_of(view) != common) continue;
    fx.push_back(on_a_side(view) ? c.fy() : c.fx());
    fy.push_back(on_a_side(view) ? c.fx() : c.fy());
    fisheye |= is_panorama(c) || c.model == CameraModel::kOpenCVFisheye ||
               c.model == CameraModel::kFov || c.model == CameraModel::kSimpleRadialFisheye ||
               c.model == CameraModel::kRadialFisheye ||
               c.model == CameraModel::kThinPrismFisheye ||
               c.model == CameraModel::kRadTanThinPrismFisheye;
  }
  Camera camera;
  camera.model = CameraModel::kPinhole;
  camera.width = common.first;
  camera.height = common.second;
  double f_x = quantile(fx, 0.5), f_y = quantile(fy, 0.5);
  if (fisheye) {
    const double least = 0.5 * std::max(camera.width, camera.height);  // 90 degrees
    f_x = std::max(f_x, least);
    f_y = std::max(f_y, least);
  }
  camera.params = {f_x, f_y, camera.width * 0.5, camera.height * 0.5};
  return camera;
}

CameraPath make_camera_path(const ModelInfo& info, PathKind kind, const PathOptions& options) {
  NERF_CHECK_GT(options.frames, 0);
  CameraPath path;
  path.fps = options.fps;
  switch (kind) {
    case PathKind::kTest:
    case PathKind::kTrain:
      add_views(path, info, kind == PathKind::kTest);
      break;
    case PathKind::kOrbit: {
      const Rig rig = make_rig(info);
      internal::OrbitInput input{rig.cameras, rig.focus, rig.outward, {}};
      if (options.density) input.density = engine_density(info, options.density);
      const PoseCurve curve = internal::make_orbit(input, path.notes);
      // Even parameters: a circle at constant speed, a swing that slows down where it turns.
      add_curve(path, info, curve, even_parameters(options.frames), "orbit");
      break;
    }
    case PathKind::kSpiral: {
      const PoseCurve curve = spiral(make_rig(info));
      add_curve(path, info, curve, constant_speed_parameters(curve, options.frames, true),
                "spiral");
      break;
    }
    case PathKind::kSpherified:
      add_curve(path, info, spherified(make_rig(info)), even_parameters(options.frames),
                "spherified");
      break;
    case PathKind::kEllipse: {
      const PoseCurve curve = ellipse(make_rig(info));
      add_curve(path, info, curve, constant_speed_parameters(curve, options.frames, true),
                "ellipse");
      break;
    }
    case PathKind::kInterpolate:
      add_interpolation(path, info, options.frames);
      break;
  }
  return path;
}

}  // namespace nerf
