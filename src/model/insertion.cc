#include "nerf/model/insertion.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "model/medium_ray.h"
#include "model/object_light.h"
#include "model/object_pixels.h"
#include "model/object_shading.h"
#include "model/object_shadow.h"
#include "nerf/base/error.h"
#include "nerf/math/srgb.h"
#include "nerf/model/integrator.h"
#include "nerf/model/radiance_field.h"

namespace nerf {

using internal::Environment;
using internal::ObjectPixels;

namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr int kMostSurfaces = 16;      // that a ray passes
constexpr double kSmooth = 0.3;        // up to this roughness reflections have rays of their own
constexpr double kLeastMirror = 0.02;  // share of a reflection that is worth a ray

// A surface that a pixel's ray meets.
struct Met {
  double t = 0;
  double alpha = 1;
  Vec3d light;  // linear, but for `mirror` times what the mirrored ray sees
  Vec3d mirror;
  Ray reflected;  // where mirror is not 0
  Vec3d normal;
};

// A pixel with an object in it.
struct Sight {
  size_t pixel = 0;
  Ray ray;
  std::vector<Met> met;  // front to back
  // What lies behind the surfaces that were done so far, sRGB, its opacity, and where half of the
  // light is stopped.
  Vec3 behind{};
  double opacity = 0, half = 0;
  Vec3d normal;                   // there
  double cover = 0;               // share of the light that the surfaces take
  std::vector<DeepSample> stops;  // of the light, back to front; engine distances
  // Of everything behind only so much light is seen.
  void dim(double left) {
    cover *= left;
    for (DeepSample& s : stops) {
      s.weight *= static_cast<Real>(left);
      for (Real& c : s.rgb) c *= static_cast<Real>(left);
    }
  }
};

Vec3d times(const Vec3d& a, const Vec3d& b) { return {a.x * b.x, a.y * b.y, a.z * b.z}; }

Vec3 to_picture(const Vec3d& linear) {
  Vec3 c;
  for (int k = 0; k < 3; ++k)
    c[k] = static_cast<Real>(linear_to_srgb(std::clamp(linear[k], 0.0, 1.0)));
  return c;
}

}  // namespace

struct Insertion::Impl {
  const RadianceField& field;
  SceneObject object;
  InsertionOptions options;
  TriangleBvh bvh;
  Vec3d centre;
  double radius = 0;
  Environment around;
  Vec3 backdrop;               // sRGB, behind the field where it is mirrored
  std::vector<Real> openness;  // of each vertex
  // Where it moves: of its first shape, to which what only moves comes back, whatever was between.
  std::vector<Real> first_openness;
  std::vector<Vec3> first_shape;

  Impl(const RadianceField& field, SceneObject given, const InsertionOptions& insertion,
       const RenderOptions& render, ThreadPool& pool)
      : field(field), object(std::move(given)), options(insertion) {
    stand(render, pool);
    if (options.moves && !bvh.empty()) {
      first_openness = openness;
      first_shape = object.mesh.positions;
    }
    if (bvh.empty() && !options.moves)
      throw Error("the object has no triangle with an area", "--insert");
  }

  // Where its mesh is now.
  void stand(const RenderOptions& render, ThreadPool& pool) {
    bvh = TriangleBvh(object.mesh.positions, object.mesh.triangles);
    if (bvh.empty()) return;
    centre = bvh.box().center();
    radius = 0.5 * length(bvh.box().size());
    RenderOptions looking = render;
    looking.layers.reset();
    backdrop = field.shows_background() ? render.background : Vec3{};
    // From inside the object, but not so far out that what it stands on would be missed.
    const Vec3d size = bvh.box().size();
    const double near = 0.45 * std::min({size.x, size.y, size.z});
    if (options.field_light) around = internal::environment_of(field, centre, near, looking, pool);
    openness = internal::same_shape(first_shape, object.mesh.positions)
                   ? first_openness
                   : internal::vertex_openness(object, bvh, radius, pool);
  }

  double open_at(const TriangleHit& hit) const {
    const auto& t = object.mesh.triangles[hit.triangle];
    return static_cast<double>(openness[t[0]]) * (1 - hit.u - hit.v) +
           static_cast<double>(openness[t[1]]) * hit.u +
           static_cast<double>(openness[t[2]]) * hit.v;
  }

  Met meet(const TriangleHit& hit, const Ray& ray) const {
    const SurfacePoint s = surface_point(object, hit.triangle, hit.u, hit.v);
    Met met;
    met.t = hit.t;
    met.alpha = s.alpha;
    // Both sides of a surface are lit as they are seen.
    const double side = dot(s.geometric, ray.direction) > 0 ? -1 : 1;
    Vec3d normal = s.normal * side;
    const double leaning = dot(normal, ray.direction);
    if (leaning > 0) normal = normalized(normal - ray.direction * (1.01 * leaning));
    met.normal = normal;
    if (s.unlit) {
      met.light = s.base;
      return met;
    }
    const Vec3d at = ray.origin + ray.direction * hit.t;
    const Vec3d above = at + s.geometric * (side * 1e-4 * radius);
    const double open = open_at(hit), cosine = std::max(1e-3, -dot(normal, ray.direction));
    const Vec3d albedo = s.base * (1 - s.metallic);
    const Vec3d facing = Vec3d{0.04, 0.04, 0.04} * (1 - s.metallic) + s.base * s.metallic;
    const Vec3d mirrors = internal::reflectance(facing, s.roughness, cosine);
    const Vec3d reflected = normalized(ray.direction - normal * (2 * dot(normal, ray.direction)));
    met.light = s.emissive + times(albedo, around.diffuse(normal)) * open;
    for (const DistantLight& light : options.lights)
      met.light = met.light + directly(light, s, normal, albedo, facing, above, ray.direction);
    const double most = std::max({mirrors.x, mirrors.y, mirrors.z});
    if (options.field_light && options.reflections && s.roughness < kSmooth &&
        most > kLeastMirror &&
        internal::transmitted(object, bvh, above, reflected, 0, kInfinity) > 0.5) {
      met.mirror = mirrors;
      met.reflected = ray;
      met.reflected.origin = above;
      met.reflected.direction = reflected;
      met.reflected.near = 0;
      met.reflected.far = 1e30;
      met.reflected.clear = 0;
      met.reflected.background = backdrop;
      // A rough mirror shows wide cones.
      met.reflected.radius = static_cast<Real>(0.5 * s.roughness * s.roughness);
    } else {
      met.light = met.light + times(mirrors, around.mirrored(reflected, s.roughness)) * open;
    }
    return met;
  }

  Vec3d directly(const DistantLight& light, const SurfacePoint& s, const Vec3d& normal,
                 const Vec3d& albedo, const Vec3d& facing, const Vec3d& above,
                 const Vec3d& direction) const {
    const Vec3d sent =
        internal::sent_of_distant(light.towards, s, normal, albedo, facing, direction);
    if (sent == Vec3d()) return {};
    return times(light.light, sent) *
           internal::transmitted(object, bvh, above, light.towards, 0, kInfinity);
  }

  // The surfaces on a ray, seen from where they can be seen, up to the first opaque one.
  std::vector<Met> surfaces(const Ray& ray) const {
    std::vector<Met> met;
    double near = 0;
    while (met.size() < kMostSurfaces) {
      TriangleHit hit;
      const bool found =
          bvh.nearest(ray.origin, ray.direction, near, kInfinity, hit, [&](const TriangleHit& h) {
            const Material& m = object.materials[static_cast<size_t>(object.material[h.triangle])];
            if (!m.double_sided && away(h.triangle, ray.direction)) return false;
            return surface_alpha(object, h.triangle, h.u, h.v) > 0;
          });
      if (!found) break;
      met.push_back(meet(hit, ray));
      if (met.back().alpha >= 1) break;
      near = hit.t;
    }
    return met;
  }
  bool away(uint32_t triangle, const Vec3d& direction) const {
    const Vec3d a = object.mesh.corner(triangle, 0).cast<double>();
    return dot(cross(object.mesh.corner(triangle, 1).cast<double>() - a,
                     object.mesh.corner(triangle, 2).cast<double>() - a),
               direction) >= 0;
  }

  // directions: gets those of all pixels.
  std::vector<Sight> sights(const Camera& camera, const Pose& pose, const RenderOptions& render,
                            ThreadPool& pool, const Cancel* cancel,
                            std::vector<Vec3>& directions) const {
    std::vector<std::vector<Sight>> rows(static_cast<size_t>(camera.height));
    const Vec3 background = field.shows_background() ? render.background : Vec3{};
    const size_t width = static_cast<size_t>(camera.width);
    directions.resize(width * static_cast<size_t>(camera.height));
    pool.parallel_for(camera.height, [&](int64_t y) {
      if (cancel && cancel->requested()) throw Cancelled();
      std::vector<Vec3d> row(width);
      unproject_row(camera, 0, static_cast<int>(y), row);
      for (int x = 0; x < camera.width; ++x) {
        const Vec3d& in_camera = row[static_cast<size_t>(x)];
        if (in_camera == Vec3d()) continue;
        Sight sight;
        sight.pixel = static_cast<size_t>(y) * width + static_cast<size_t>(x);
        directions[sight.pixel] = in_camera.cast<Real>();
        const Pose at = ray_pose(camera, pose, {x + 0.5, static_cast<double>(y) + 0.5});
        sight.ray.origin = at.translation;
        sight.ray.direction = at.rotation * in_camera;
        sight.ray.time = render.time;
        sight.ray.background = background;
        sight.met = surfaces(sight.ray);
        if (!sight.met.empty()) rows[static_cast<size_t>(y)].push_back(std::move(sight));
      }
    });
    std::vector<Sight> all;
    for (auto& row : rows) std::move(row.begin(), row.end(), std::back_inserter(all));
    return all;
  }

  // What mirrored rays see goes into the surfaces' light.
  void reflect(std::vector<Sight>& sights, const RenderOptions& render, ThreadPool& pool,
               const Cancel* cancel) const {
    std::vector<Ray> rays;
    std::vector<Met*> of;
    for (Sight& sight : sights)
      for (Met& met : sight.met)
        if (met.mirror != Vec3d()) {
          rays.push_back(met.reflected);
          of.push_back(&met);
        }
    if (rays.empty()) return;
    const RayResults seen = integrate(field, rays, {}, render, pool, {}, cancel);
    for (size_t i = 0; i < rays.size(); ++i) {
      Vec3d c;
      for (int k = 0; k < 3; ++k)
        c[k] = srgb_to_linear(
            std::clamp(static_cast<double>(seen.rgb[3 * i + static_cast<size_t>(k)]), 0.0, 1.0));
      of[i]->light = of[i]->light + times(of[i]->mirror, c);
    }
  }

  // From the last surface of each ray to the first; the field between them is integrated for all
  // rays at once.
  void composite(std::vector<Sight>& sights, const Layers& asked, const RenderOptions& render,
                 ThreadPool& pool, const Cancel* cancel) const {
    size_t most = 0;
    for (const Sight& sight : sights) most = std::max(most, sight.met.size());
    for (size_t round = 0; round < most; ++round) {
      std::vector<Ray> rays;
      std::vector<Sight*> of;
      for (Sight& sight : sights) {
        if (sight.met.size() <= round) continue;
        const size_t i = sight.met.size() - 1 - round;
        if (round == 0) {
          sight.behind = sight.ray.background;
          sight.half = kInfinity;
        }
        if (sight.met[i].alpha < 1) {
          Ray ray = sight.ray;
          ray.near = ray.medium_from = sight.met[i].t;
          if (round > 0) ray.end_on(sight.met[i + 1].t, sight.behind);
          rays.push_back(ray);
          of.push_back(&sight);
        }
      }
      const RayResults seen =
          rays.empty() ? RayResults() : integrate(field, rays, asked, render, pool, {}, cancel);
      for (size_t r = 0; r < rays.size(); ++r) {
        Sight& sight = *of[r];
        for (int k = 0; k < 3; ++k) sight.behind[k] = seen.rgb[3 * r + static_cast<size_t>(k)];
        const double through = 1 - static_cast<double>(seen.opacity[r]);
        sight.opacity = 1 - through * (1 - sight.opacity);
        sight.dim(through);
        if (asked.deep)
          sight.stops.insert(sight.stops.end(), seen.deep[r].rbegin(), seen.deep[r].rend());
        if (seen.median[r] > 0) {
          sight.half = static_cast<double>(seen.median[r]);
          if (asked.normal) sight.normal = seen.normal[r].cast<double>();
        }
      }
      for (Sight& sight : sights) {
        if (sight.met.size() <= round) continue;
        const Met& met = sight.met[sight.met.size() - 1 - round];
        const Real alpha = static_cast<Real>(met.alpha);
        sight.behind = to_picture(met.light) * alpha + sight.behind * (1 - alpha);
        sight.opacity = met.alpha + (1 - met.alpha) * sight.opacity;
        sight.dim(1 - met.alpha);
        sight.cover += met.alpha;
        if (asked.deep && alpha > 0) {
          const Vec3 own = to_picture(met.light) * alpha;
          const Real at = static_cast<Real>(met.t);
          sight.stops.push_back({at, at, alpha, {own.x, own.y, own.z}});
        }
        if (met.alpha >= 0.5) {
          sight.half = met.t;
          sight.normal = met.normal;
        }
      }
    }
  }
};

Insertion::Insertion(const RadianceField& field, SceneObject object,
                     const InsertionOptions& insertion, const RenderOptions& options,
                     ThreadPool& pool)
    : impl_(std::make_unique<Impl>(field, std::move(object), insertion, options, pool)) {}
Insertion::~Insertion() = default;

void Insertion::move(TriangleMesh mesh, const RenderOptions& options, ThreadPool& pool) {
  NERF_CHECK(mesh.positions.size() == impl_->object.mesh.positions.size());
  NERF_CHECK(mesh.normals.size() == impl_->object.mesh.normals.size());
  NERF_CHECK(mesh.triangles.size() == impl_->object.mesh.triangles.size());
  impl_->object.mesh = std::move(mesh);
  impl_->stand(options, pool);
}

ObjectPixels Insertion::look(const Camera& camera, const Pose& camera_to_engine,
                             const RenderOptions& options, ThreadPool& pool,
                             const Cancel* cancel) const {
  ObjectPixels pixels;
  std::vector<Sight> sights =
      impl_->sights(camera, camera_to_engine, options, pool, cancel, pixels.directions);
  if (sights.empty()) return pixels;
  RenderOptions render = options;
  render.layers.reset();
  impl_->reflect(sights, render, pool, cancel);
  const Layers layers = options.layers.value_or(Layers{});
  const Layers asked{.normal = layers.normal,
                     .deep = layers.moments || layers.percentiles || layers.deep};
  impl_->composite(sights, asked, render, pool, cancel);
  const size_t n = static_cast<size_t>(camera.width) * static_cast<size_t>(camera.height);
  pixels.far.assign(n, kInfinity);
  pixels.background.resize(n);
  pixels.opacity.resize(n);
  pixels.cover.resize(n);
  pixels.half.assign(n, kInfinity);
  pixels.normal.resize(n);
  if (asked.deep) pixels.stops.resize(n);
  for (Sight& sight : sights) {
    const size_t p = sight.pixel;
    pixels.far[p] = sight.met.front().t;
    pixels.background[p] = sight.behind;
    pixels.opacity[p] = static_cast<Real>(sight.opacity);
    pixels.cover[p] = static_cast<Real>(sight.cover);
    pixels.half[p] = sight.half;
    pixels.normal[p] = sight.normal.cast<Real>();
    if (asked.deep) pixels.stops[p].assign(sight.stops.rbegin(), sight.stops.rend());
  }
  return pixels;
}

void Insertion::finish(const ObjectPixels& pixels, const Camera& camera,
                       const Pose& camera_to_engine, const RenderOptions& options, ThreadPool& pool,
                       Frame& frame) const {
  const Impl& own = *impl_;
  const double unit = own.field.info().to_engine.scale;  // engine units of an input unit
  if (own.options.shadows && !own.bvh.empty()) {
    const internal::ShadowCaster caster{own.object,
                                        own.bvh,
                                        own.centre,
                                        own.radius,
                                        own.around,
                                        own.options,
                                        own.field.shows_background() ? options.background : Vec3{},
                                        internal::engine_medium(own.field, options)};
    internal::cast_shadows(caster, pixels, camera, camera_to_engine, unit, pool, frame);
  }
  if (pixels.empty()) return;
  for (size_t p = 0; p < frame.alpha.size(); ++p) {
    if (!pixels.seen(p)) continue;
    const Real before = frame.alpha[p];
    const double forward = depth_per_distance(camera, pixels.directions[p].cast<double>());
    internal::count_in(pixels, p, forward / unit, 1 / unit, own.field.info().to_engine, frame);
    frame.alpha[p] = 1 - (1 - before) * (1 - pixels.opacity[p]);
  }
}

void place_mesh(const Similarity& to_engine, TriangleMesh& mesh) {
  for (Vec3& p : mesh.positions) p = to_engine.apply(p.cast<double>()).cast<Real>();
  for (Vec3& n : mesh.normals) n = (to_engine.rotation * n.cast<double>()).cast<Real>();
}

}  // namespace nerf
