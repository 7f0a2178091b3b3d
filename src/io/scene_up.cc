// Up direction of a capture.
#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "math/eigen_vectors.h"
#include "nerf/math/camera_paths.h"
#include "scene_frame.h"
#include "scene_planes.h"

namespace nerf::internal {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr double kDegree = std::numbers::pi / 180;

// Mean squared sine between up and the axes that should be level, above which it is no fit: 13
// degrees.
constexpr double kLevel = 0.05;
// Second smallest spread of the level axes: below this the cameras all look one way, and how far
// down they look stays open.
constexpr double kOneWay = 0.1;

// What of a photo's camera matters here, after the photo was turned as its tag says.
struct Turned {
  Vector3d right, up, forward, position;
};

Turned turned(const View& view) {
  const Vector3d x = to_eigen(view.pose.rotation.column(0));
  const Vector3d y = to_eigen(view.pose.rotation.column(1));
  Turned t{x, -y, to_eigen(view.pose.rotation.column(2)), to_eigen(view.pose.translation)};
  switch (view.orientation) {  // where row 0 and column 0 are shown (EXIF's tag 274)
    case 3:                    // bottom, right
    case 4:                    // bottom, left
      t.up = y;
      break;
    case 5:  // left, top
    case 6:  // right, top
      t.up = -x;
      break;
    case 7:  // right, bottom
    case 8:  // left, bottom
      t.up = x;
      break;
    default:
      break;
  }
  t.right = t.forward.cross(t.up);
  return t;
}

Vector3d mean_of(const std::vector<Turned>& cameras, Vector3d Turned::* axis) {
  Vector3d sum = Vector3d::Zero();
  for (const Turned& c : cameras) sum += c.*axis;
  return sum / static_cast<double>(cameras.size());
}

struct Fit {
  Vector3d up;
  double error = 0;   // mean squared sine between up and what should be level
  double second = 0;  // the same for the second best direction: small where the fit is open
};

// The direction most nearly perpendicular to all axes, near `prior` where that leaves it open.
Fit perpendicular(const std::vector<Vector3d>& axes, const Vector3d& prior, double prior_weight) {
  Matrix3d m = prior_weight * (Matrix3d::Identity() - prior * prior.transpose());
  Matrix3d alone = Matrix3d::Zero();
  for (const Vector3d& a : axes) alone += a * a.transpose() / static_cast<double>(axes.size());
  const Eigen::SelfAdjointEigenSolver<Matrix3d> solver(m + alone);
  const Eigen::SelfAdjointEigenSolver<Matrix3d> spread(alone, Eigen::EigenvaluesOnly);
  Fit fit;
  fit.up = solver.eigenvectors().col(0);
  if (fit.up.dot(prior) < 0) fit.up = -fit.up;
  fit.error = fit.up.dot(alone * fit.up);
  fit.second = spread.eigenvalues()(1);
  return fit;
}

// Of each camera the axis of its picture that is more nearly level when `up` is up.
std::vector<Vector3d> level_axes(const std::vector<Turned>& cameras, const Vector3d& up) {
  std::vector<Vector3d> axes;
  for (const Turned& c : cameras)
    axes.push_back(std::abs(c.right.dot(up)) <= std::abs(c.up.dot(up)) ? c.right : c.up);
  return axes;
}

// The same where photos may lie on their sides: the best of the directions that two cameras' axes
// can agree on. Its sign says nothing.
Fit perpendicular_to_some(const std::vector<Turned>& cameras) {
  constexpr size_t kMostTried = 40;
  const size_t stride = (cameras.size() + kMostTried - 1) / kMostTried;
  std::vector<Turned> few;
  for (size_t i = 0; i < cameras.size(); i += stride) few.push_back(cameras[i]);
  Fit best;
  best.error = 1;
  for (size_t i = 0; i < few.size(); ++i)
    for (size_t j = 0; j < i; ++j)
      for (int pair = 0; pair < 4; ++pair) {
        Vector3d up =
            (pair & 1 ? few[i].right : few[i].up).cross(pair & 2 ? few[j].right : few[j].up);
        if (!(up.norm() > 0.3)) continue;
        up.normalize();
        double error = 0;
        for (const Turned& c : few) {
          const double x = c.right.dot(up), y = c.up.dot(up);
          error += std::min(x * x, y * y) / static_cast<double>(few.size());
        }
        if (error < best.error) {
          best.up = up;
          best.error = error;
        }
      }
  if (best.error < 1) best = perpendicular(level_axes(cameras, best.up), best.up, 1e-9);
  return best;
}

// Normal of the plane that a closed ring of cameras stands on, towards `up`; nothing where they do
// not stand on one.
std::optional<Vector3d> ring_normal(const std::vector<Turned>& cameras, const Vector3d& up) {
  if (cameras.size() < 8) return std::nullopt;
  const Vector3d mean = mean_of(cameras, &Turned::position);
  Matrix3d m = Matrix3d::Zero();
  for (const Turned& c : cameras) m += (c.position - mean) * (c.position - mean).transpose();
  const Eigen::SelfAdjointEigenSolver<Matrix3d> solver(m);
  const Vector3d& variance = solver.eigenvalues();
  // Flat to 1/20 of its width, and about as wide as long.
  if (!(variance(0) < variance(1) / 400 && variance(1) > variance(2) / 4)) return std::nullopt;
  std::vector<double> angles;
  for (const Turned& c : cameras) {
    const Vector3d d = c.position - mean;
    angles.push_back(
        std::atan2(d.dot(solver.eigenvectors().col(1)), d.dot(solver.eigenvectors().col(2))));
  }
  if (!covered_arc(angles, std::numbers::pi / 2).full) return std::nullopt;
  Vector3d normal = solver.eigenvectors().col(0);
  if (normal.dot(up) < 0) normal = -normal;
  // A ring on a slope is a ring as well: only a small correction is believable.
  if (normal.dot(up) < std::cos(10 * kDegree)) return std::nullopt;
  return normal;
}

class UpFinder {
 public:
  UpFinder(const std::vector<View>& views, const std::vector<ScenePoint>& points,
           std::vector<std::string>& warnings)
      : shape_(points), warnings_(warnings) {
    for (const View& view : views) {
      cameras_.push_back(turned(view));
      positions_.push_back(cameras_.back().position);
      tags_ += view.orientation != 1;
    }
  }

  UpEstimate find() {
    std::string source;
    const Fit fit = from_cameras(source);
    const Vector3d up = corrected(fit, source).normalized();
    return {{up.x(), up.y(), up.z()}, source};
  }

 private:
  Fit from_cameras(std::string& source) {
    source = tags_ > 0 ? "from the EXIF orientation and the level of the cameras"
                       : "from the level of the cameras";
    const Vector3d own_up = mean_of(cameras_, &Turned::up);
    const Vector3d forward = mean_of(cameras_, &Turned::forward);
    const Vector3d right = mean_of(cameras_, &Turned::right);
    std::vector<Vector3d> rights;
    for (const Turned& c : cameras_) rights.push_back(c.right);
    if (own_up.norm() < 0.3 && right.norm() <= 0.7 && forward.norm() > 0.7) {
      source = "against the view of the cameras, which look down";
      return kept_near(perpendicular(rights, -forward.normalized(), 0.02), -forward.normalized());
    }
    Fit upright;
    upright.error = 1;
    if (own_up.norm() > 1e-6) upright = perpendicular(rights, own_up.normalized(), 0.02);
    if (upright.error < kLevel && own_up.dot(upright.up) >= 0.3) return upright;
    Fit some = perpendicular_to_some(cameras_);
    if (some.error < 0.25 * std::max(upright.error, kLevel)) {
      source += ", of which some lie on a side";
      choose_end(some, own_up, forward, source);
      return some;
    }
    if (own_up.norm() >= 0.3) return kept_near(upright, own_up.normalized());
    if (auto floor = shape_.largest_plane([](const Vector3d&) { return true; }, positions_);
        floor && is_floor(*floor)) {
      source = "the largest plane of the points";
      return {floor->normal, 0, 1};
    }
    warnings_.emplace_back("the cameras do not agree on an up direction (--up x,y,z sets it)");
    const Vector3d prior = own_up.norm() > 1e-6 ? own_up.normalized() : Vector3d(0, 0, 1);
    return kept_near(perpendicular(rights, prior, 0.02), prior);
  }

  // Cameras rolled about as if on a sphere have no common horizon: keep to their mean then.
  static Fit kept_near(Fit fit, const Vector3d& prior) {
    if (fit.up.dot(prior) <= 0.5) fit.up = prior;
    return fit;
  }

  // Which end of an axis is up. What lies below everything is a floor; phones are seldom held
  // upside down; and cameras look down at things more than up.
  void choose_end(Fit& fit, const Vector3d& own_up, const Vector3d& forward, std::string& source) {
    double towards = own_up.dot(fit.up);
    if (const auto floor = floor_near(fit)) {
      towards = floor->normal.dot(fit.up);
    } else if (std::abs(towards) < 0.2) {
      towards = -forward.dot(fit.up);
      source += ", looking down";
      if (std::abs(towards) < 0.1) {
        towards = mean_of(cameras_, &Turned::right).dot(fit.up);
        warnings_.emplace_back(
            "the photos seem to lie on a side: up is a guess and may be down (--up x,y,z sets it)");
      }
    }
    if (towards < 0) fit.up = -fit.up;
  }

  // Below the cameras and nearly all points.
  static bool is_floor(const PointCloudShape::Plane& plane) {
    return plane.cameras >= 0.97 && plane.beyond <= 0.1;
  }

  // How far a plane may correct the cameras. What is no more than a slab of planter or shelf may
  // slope: only by little.
  static double limit(const Fit& fit) { return (fit.second < kOneWay ? 15 : 6) * kDegree; }
  static bool believable(const PointCloudShape::Plane& plane, const Fit& fit) {
    return plane.share >= 0.2 || std::abs(plane.normal.dot(fit.up)) >= std::cos(6 * kDegree);
  }

  std::optional<PointCloudShape::Plane> floor_near(const Fit& fit) const {
    const double least = std::cos(limit(fit));
    const auto plane = shape_.largest_plane(
        [&](const Vector3d& normal) { return std::abs(normal.dot(fit.up)) >= least; }, positions_);
    if (plane && is_floor(*plane) && believable(*plane, fit)) return plane;
    return std::nullopt;
  }

  Vector3d corrected(const Fit& fit, std::string& source) const {
    if (const auto floor = floor_near(fit); floor && floor->normal.dot(fit.up) > 0) {
      source += fmt::format(", corrected by the plane that {:.0f} % of the points lie on",
                            100 * floor->share);
      return floor->normal;
    }
    if (const auto ring = ring_normal(cameras_, fit.up)) {
      source += ", corrected by the plane of the cameras";
      return *ring;
    }
    if (fit.second >= kOneWay) return fit.up;
    const double most = std::sin(limit(fit));
    const auto wall = shape_.largest_plane(
        [&](const Vector3d& normal) { return std::abs(normal.dot(fit.up)) <= most; }, positions_);
    if (!wall || wall->share < 0.3) return fit.up;
    source += ", corrected by an upright plane of the points";
    return fit.up - wall->normal * wall->normal.dot(fit.up);
  }

  std::vector<Turned> cameras_;
  std::vector<Vector3d> positions_;
  PointCloudShape shape_;
  std::vector<std::string>& warnings_;
  int tags_ = 0;  // photos that say how they are to be turned
};

}  // namespace

UpEstimate estimate_up(const std::vector<View>& views, const std::vector<ScenePoint>& points,
                       std::vector<std::string>& warnings) {
  return UpFinder(views, points, warnings).find();
}

}  // namespace nerf::internal
