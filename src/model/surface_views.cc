// Where a field's surface is, as its training cameras see it.
#include "model/surface_views.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "model/field_integrator.h"
#include "model/oblique_box.h"
#include "nerf/base/error.h"
#include "nerf/model/grid_field.h"
#include "nerf/model/integrator.h"
#include "nerf/model/radiance_field.h"
#include "nerf/parts/beam.h"

namespace nerf {

namespace internal {

namespace {

constexpr double kWidestTangent = 1.2;  // of half the view of one picture

// One of the pictures that stand for a camera.
struct Face {
  Mat3d to_camera;
  double tangent_x = 1, tangent_y = 1;  // of half its view
};

std::vector<Face> faces_of(const Camera& camera) {
  std::vector<Face> faces;
  if (is_panorama(camera)) {
    const Vec3d axes[6] = {{0, 0, 1}, {1, 0, 0}, {0, 0, -1}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}};
    for (const Vec3d& z : axes) {
      const Vec3d up = z.y == 0 ? Vec3d{0, 1, 0} : Vec3d{0, 0, 1};
      const Vec3d x = cross(up, z);
      Face face;
      face.to_camera.set_column(0, x);
      face.to_camera.set_column(1, cross(z, x));
      face.to_camera.set_column(2, z);
      faces.push_back(face);
    }
    return faces;
  }
  Face face;
  face.tangent_x = face.tangent_y = 1e-3;
  constexpr int kSteps = 16;  // along each border
  for (int i = 0; i <= kSteps; ++i) {
    const double x = camera.width * i / double{kSteps}, y = camera.height * i / double{kSteps};
    for (const Vec2d& pixel : {Vec2d{x, 0}, Vec2d{x, double(camera.height)}, Vec2d{0, y},
                               Vec2d{double(camera.width), y}}) {
      const auto d = unproject(camera, pixel);
      const bool ahead = d && d->z > 0;
      face.tangent_x = std::max(face.tangent_x, ahead ? std::fabs(d->x / d->z) : kWidestTangent);
      face.tangent_y = std::max(face.tangent_y, ahead ? std::fabs(d->y / d->z) : kWidestTangent);
    }
  }
  face.tangent_x = std::min(face.tangent_x, kWidestTangent);
  face.tangent_y = std::min(face.tangent_y, kWidestTangent);
  return {face};
}

}  // namespace

std::vector<SurfaceCamera> surface_cameras(const ModelInfo& info) {
  std::vector<SurfaceCamera> cameras;
  for (const ModelView& view : info.views) {
    if (view.held_out) continue;
    const Pose pose = info.to_engine.apply(view.pose);
    for (const Face& face : faces_of(view.camera)) {
      SurfaceCamera camera{&view.camera, face.to_camera, {}, face.tangent_x, face.tangent_y};
      camera.to_engine = {pose.rotation * face.to_camera, pose.translation};
      cameras.push_back(camera);
    }
  }
  return cameras;
}

namespace {

constexpr int kTile = 16;  // pixels along the side of what becomes 256 rays, an item of work

// The rays of a picture, tile by tile.
class PictureRays {
 public:
  PictureRays(const RadianceField& field, const SurfaceCamera& camera, const DepthView& view,
              const ObliqueBox* box, Real time)
      : field_(field), camera_(camera), view_(view), box_(box), time_(time) {
    for (int y = 0; y < view.height; y += kTile)
      for (int x = 0; x < view.width; x += kTile) add_tile(x, y);
  }

  const std::vector<Ray>& rays() const { return rays_; }
  const std::vector<size_t>& pixels() const { return pixels_; }  // of the rays

 private:
  void add_tile(int x0, int y0) {
    const size_t first = rays_.size();
    Vec3d sum;
    for (int y = y0; y < std::min(y0 + kTile, view_.height); ++y)
      for (int x = x0; x < std::min(x0 + kTile, view_.width); ++x) {
        const Vec3d d = view_.direction(x, y);
        const Vec3d in_camera = camera_.to_camera * d;
        const auto pixel = project(*camera_.camera, in_camera);
        if (!pixel || !(pixel->x >= 0 && pixel->y >= 0 && pixel->x <= camera_.camera->width &&
                        pixel->y <= camera_.camera->height))
          continue;
        Ray ray;
        ray.origin = camera_.to_engine.translation;
        ray.direction = normalized(camera_.to_engine.rotation * d);
        ray.near = field_.info().near;
        ray.radius = static_cast<Real>(0.577 / view_.focal);
        ray.time = time_;
        if (box_ && !box_->clip(ray.origin, ray.direction, ray.near, ray.far)) continue;
        sum = sum + ray.direction;
        rays_.push_back(ray);
        pixels_.push_back(static_cast<size_t>(y) * static_cast<size_t>(view_.width) +
                          static_cast<size_t>(x));
      }
    if (field_.is_grid() && rays_.size() > first) find_clear(first, normalized(sum));
  }

  // Before which none of a tile's rays meets matter.
  void find_clear(size_t first, const Vec3d& axis) {
    double spread = 0, near = std::numeric_limits<double>::infinity();
    for (size_t i = first; i < rays_.size(); ++i) {
      spread = std::max(spread, length(rays_[i].direction - axis));
      near = std::min(near, rays_[i].near);
    }
    const double clear = clear_until(field_.grid().occupancy,
                                     {camera_.to_engine.translation, axis, spread, near, 0});
    for (size_t i = first; i < rays_.size(); ++i) rays_[i].clear = clear;
  }

  const RadianceField& field_;
  const SurfaceCamera& camera_;
  const DepthView& view_;
  const ObliqueBox* box_;
  Real time_;
  std::vector<Ray> rays_;
  std::vector<size_t> pixels_;
};

}  // namespace

DepthPicture depth_picture(const RadianceField& field, const SurfaceCamera& camera, double focal,
                           const std::optional<SurfaceRegion>& region,
                           const SurfaceOptions& options, const SurfaceWork& work) {
  DepthPicture picture;
  DepthView& view = picture.view;
  view.focal = focal;
  view.width = std::max(1, static_cast<int>(std::lround(2 * focal * camera.tangent_x)));
  view.height = std::max(1, static_cast<int>(std::lround(2 * focal * camera.tangent_y)));
  view.to_world = camera.to_engine;
  std::optional<ObliqueBox> box;
  if (region) {
    box = {region->from_engine, region->box};
    view.to_world = {region->from_engine * camera.to_engine.rotation,
                     region->from_engine * camera.to_engine.translation};
  }
  const size_t pixels = static_cast<size_t>(view.width) * static_cast<size_t>(view.height);
  view.depth.assign(pixels, DepthView::kUnknown);
  picture.spread.assign(pixels, 0.0f);
  const PictureRays rays(field, camera, view, box ? &*box : nullptr, options.render.time);
  // Neither colours are looked at nor what lies behind the last percentile.
  RenderOptions render = options.render;
  render.unshaded = 2;
  render.stop_transmittance =
      static_cast<Real>(std::min(0.98 * (1 - kFarShare), 1 - options.opaque));
  const RayResults seen =
      integrate(field, rays.rays(), {.percentiles = true}, render, work.pool, {}, work.cancel);
  const Vec3d axis = camera.to_engine.rotation.column(2);
  for (size_t i = 0; i < rays.rays().size(); ++i) {
    const size_t at = rays.pixels()[i];
    const double opacity = static_cast<double>(seen.opacity[i]);
    if (opacity <= options.clear) view.depth[at] = DepthView::kNothing;
    if (opacity < options.opaque || !(seen.median[i] > 0)) continue;
    const double forward = dot(rays.rays()[i].direction, axis);
    view.depth[at] = static_cast<float>(static_cast<double>(seen.median[i]) * forward);
    // Where less than 95 % is stopped the last light goes as far as twice the way to the median.
    const Real end = seen.far[i] > 0 ? seen.far[i] : 2 * seen.median[i] - seen.near[i];
    picture.spread[at] = static_cast<float>(static_cast<double>(end - seen.near[i]) * forward);
  }
  return picture;
}

}  // namespace internal

namespace {

using internal::DepthPicture;
using internal::SurfaceCamera;

void report(const SurfaceWork& work, size_t done, size_t all) {
  if (work.progress) work.progress(static_cast<double>(done) / static_cast<double>(all));
}

double quantile(std::vector<double>& values, double q) {
  const auto at =
      values.begin() + static_cast<ptrdiff_t>(q * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

// How many of the pictures see a point, engine coordinates: in front of what they show there.
int seen_by(const std::vector<DepthPicture>& pictures, const Vec3d& point) {
  constexpr double kTolerance = 0.05;  // of the distance
  int count = 0;
  for (const DepthPicture& picture : pictures) {
    const DepthView& view = picture.view;
    const Vec3d p = view.to_world.inverse() * point;
    if (!(p.z > 0)) continue;
    const double u = view.focal * p.x / p.z + 0.5 * view.width;
    const double v = view.focal * p.y / p.z + 0.5 * view.height;
    if (!(u >= 0 && v >= 0 && u < view.width && v < view.height)) continue;
    const float d = view.depth[static_cast<size_t>(v) * static_cast<size_t>(view.width) +
                               static_cast<size_t>(u)];
    count += d > 0 && p.z < static_cast<double>(d) * (1 + kTolerance);
  }
  return count;
}

}  // namespace

SurfaceRegion region_of(const RadianceField& field, const Box3& bbox) {
  const auto box = internal::oblique_box(field.info().to_engine, bbox);
  return {box->to_box, box->box};
}

SurfaceRegion find_region(const RadianceField& field, const SurfaceOptions& options,
                          const SurfaceWork& work) {
  constexpr size_t kMostPictures = 150, kMostPoints = 20000;
  constexpr double kSide = 64;  // pixels, the longer side of a picture
  std::vector<SurfaceCamera> cameras = internal::surface_cameras(field.info());
  const size_t stride = (cameras.size() + kMostPictures - 1) / kMostPictures;
  std::vector<DepthPicture> pictures;
  std::vector<Vec3d> points;
  for (size_t i = 0; i < cameras.size(); i += stride) {
    const double focal = kSide / (2 * std::max(cameras[i].tangent_x, cameras[i].tangent_y));
    pictures.push_back(internal::depth_picture(field, cameras[i], focal, {}, options, work));
    const DepthView& view = pictures.back().view;
    for (int y = 0; y < view.height; ++y)
      for (int x = 0; x < view.width; ++x) {
        const float d = view.depth[static_cast<size_t>(y) * static_cast<size_t>(view.width) +
                                   static_cast<size_t>(x)];
        if (d > 0 && d < DepthView::kNothing)
          points.push_back(view.to_world * (view.direction(x, y) * double{d}));
      }
    report(work, i + 1, cameras.size());
  }
  if (points.size() < 100)
    throw Error("the training cameras see no surface", "--bbox",
                "say with --bbox where it is, or train longer");
  std::vector<Vec3d> common;
  if (field.info().alpha) {
    common = points;
  } else {
    const size_t every = (points.size() + kMostPoints - 1) / kMostPoints;
    std::vector<Vec3d> some;
    for (size_t i = 0; i < points.size(); i += every) some.push_back(points[i]);
    std::vector<int> counts(some.size());
    work.pool.parallel_for(static_cast<int64_t>(some.size()), [&](int64_t i) {
      counts[static_cast<size_t>(i)] = seen_by(pictures, some[static_cast<size_t>(i)]);
    });
    std::vector<double> sorted(counts.begin(), counts.end());
    const double many = quantile(sorted, 0.95);
    for (size_t i = 0; i < some.size(); ++i)
      if (counts[i] >= 0.5 * many) common.push_back(some[i]);
  }
  // A few are wrong.
  const double share = field.info().alpha ? 0.0005 : 0.01;
  constexpr double kMargin = 0.05;
  SurfaceRegion region;
  for (int k = 0; k < 3; ++k) {
    std::vector<double> along;
    for (const Vec3d& p : common) along.push_back(p[k]);
    region.box.min[k] = quantile(along, share);
    region.box.max[k] = quantile(along, 1 - share);
  }
  const Vec3d size = region.box.size();
  const double margin = kMargin * std::max({size.x, size.y, size.z});
  region.box.min = region.box.min - Vec3d{margin, margin, margin};
  region.box.max = region.box.max + Vec3d{margin, margin, margin};
  return region;
}

std::vector<DepthView> depth_views(const RadianceField& field, const SurfaceRegion& region,
                                   const SurfaceOptions& options, const SurfaceWork& work) {
  const std::vector<SurfaceCamera> cameras = internal::surface_cameras(field.info());
  if (cameras.empty()) throw Error("the model knows of no training cameras", "", "");
  const Vec3d size = region.box.size();
  const double voxel = std::max({size.x, size.y, size.z}) / options.resolution;
  const Vec3d centre = region.to_engine(region.box.center());
  // A pixel is as wide as a voxel, or as one of the photos' where that is wider but not twice so.
  std::vector<double> focal;
  double rays = 0;
  for (const SurfaceCamera& camera : cameras) {
    const double distance = std::max(length(camera.to_engine.translation - centre), voxel);
    focal.push_back(std::clamp(camera.camera->fx(), 0.5 * distance / voxel, distance / voxel));
    rays += 4 * focal.back() * focal.back() * camera.tangent_x * camera.tangent_y;
  }
  const double shrink = std::min(1.0, std::sqrt(static_cast<double>(options.most_rays) / rays));
  std::vector<DepthView> views;
  std::vector<DepthPicture> pictures;
  std::vector<double> spreads;
  for (size_t i = 0; i < cameras.size(); ++i) {
    pictures.push_back(
        internal::depth_picture(field, cameras[i], focal[i] * shrink, region, options, work));
    const DepthPicture& picture = pictures.back();
    for (size_t p = 0; p < picture.spread.size(); p += 31)
      if (picture.spread[p] > 0) spreads.push_back(double{picture.spread[p]});
    report(work, i + 1, cameras.size());
  }
  const double usual = spreads.empty() ? 0 : quantile(spreads, 0.5);
  for (DepthPicture& picture : pictures) {
    for (size_t p = 0; p < picture.spread.size(); ++p) {
      float& depth = picture.view.depth[p];
      const double most =
          std::max({options.most_spread * double{depth}, options.truncation * voxel, 2 * usual});
      if (double{picture.spread[p]} > most) depth = DepthView::kUnknown;
    }
    views.push_back(std::move(picture.view));
  }
  return views;
}

}  // namespace nerf
