#include "model/object_shadow.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <limits>
#include <numbers>
#include <optional>

#include "nerf/math/random.h"
#include "nerf/math/ray.h"
#include "nerf/math/srgb.h"

namespace nerf::internal {

namespace {

constexpr double kReach = 8;  // radii: the ball takes less than 1/64 of the light further away
constexpr double kNear = 2;   // radii: shadows have edges
constexpr double kInfinity = std::numeric_limits<double>::infinity();

// A frame around a direction.
struct Frame3 {
  Vec3d x, y, z;
  explicit Frame3(const Vec3d& axis) : z(axis) {
    x = normalized(cross(std::fabs(z.z) < 0.9 ? Vec3d{0, 0, 1} : Vec3d{1, 0, 0}, z));
    y = cross(z, x);
  }
  Vec3d at(double cosine, const std::complex<double>& azimuth) const {  // of modulus 1
    const double sine = std::sqrt(std::max(0.0, 1 - cosine * cosine));
    return x * (sine * azimuth.real()) + y * (sine * azimuth.imag()) + z * cosine;
  }
};

// The field's surface as the picture shows it.
class SeenSurface {
 public:
  // unit: of depths, per engine unit.
  SeenSurface(const Camera& camera, const Pose& pose, double unit,
              const std::vector<Vec3>& directions, const Frame& frame)
      : camera_(camera), pose_(pose), unit_(unit), directions_(directions), frame_(frame) {}

  // Engine coordinates; no value where the field stops too little before the object.
  std::optional<Vec3d> point(int x, int y) const {
    if (x < 0 || y < 0 || x >= camera_.width || y >= camera_.height) return std::nullopt;
    const size_t p = index(x, y);
    const Vec3d ray = directions_[p].cast<double>();
    if (!(frame_.alpha[p] >= 0.5_r) || !(frame_.depth_z[p] > 0) || ray == Vec3d())
      return std::nullopt;
    const double distance =
        static_cast<double>(frame_.depth_z[p]) * unit_ / depth_per_distance(camera_, ray);
    const Pose pose = ray_pose(camera_, pose_, {x + 0.5, y + 0.5});
    return pose.translation + pose.rotation * ray * distance;
  }
  size_t index(int x, int y) const {
    return static_cast<size_t>(y) * static_cast<size_t>(camera_.width) + static_cast<size_t>(x);
  }
  // Towards the camera, from neighbours on the nearer side, about so far away on the surface.
  Vec3d normal(int x, int y, const Vec3d& here, double reach) const {
    const double pixel = length(here - pose_.translation) / camera_.fx();
    const int step = static_cast<int>(std::clamp(reach / pixel, 2.0, 24.0));
    const auto along = [&](int dx, int dy) {
      const auto after = point(x + dx, y + dy), before = point(x - dx, y - dy);
      if (after && (!before || length(*after - here) < length(here - *before)))
        return *after - here;
      return before ? here - *before : Vec3d();
    };
    const Vec3d back = normalized(pose_.translation - here);
    const Vec3d n = normalized(cross(along(step, 0), along(0, step)));
    if (n == Vec3d()) return back;
    return dot(n, back) < 0 ? -n : n;
  }

 private:
  const Camera& camera_;
  const Pose& pose_;
  double unit_;
  const std::vector<Vec3>& directions_;
  const Frame& frame_;
};

// Of the object's ball, which takes `cap` of half of all directions. As much noise everywhere: what
// the ball takes, and with it what a ray counts, falls with its solid angle.
int rays_towards(double cap, int most) {
  constexpr double kWide = 0.1, kLeast = 6;
  const double share = std::min(1.0, cap / kWide);
  return std::min(most, static_cast<int>(std::ceil(std::max(kLeast, most * share * share))));
}

// The share of the light at a point that is left, by colour; nothing where the object takes none.
std::optional<Vec3d> light_left(const ShadowCaster& c, const Vec3d& sent, const Vec3d& point,
                                const Vec3d& normal, uint64_t pixel) {
  const Vec3d to_centre = c.centre - point;
  const double distance = length(to_centre);
  const Vec3d origin = point + normal * (2e-3 * c.radius);
  Vec3d taken;  // over pi
  Vec3d whole = c.around.diffuse(normal);
  const bool inside = distance < 1.05 * c.radius;
  const double rim = inside ? 0 : std::sqrt(1 - std::pow(c.radius / distance, 2));
  const int n = rays_towards(1 - rim, c.options.shadow_rays);
  const Frame3 frame(inside ? normal : to_centre / distance);
  // A golden spiral, turned at random from pixel to pixel.
  const double turn = 2 * std::numbers::pi * static_cast<double>(Random(2, 0, pixel).uniform());
  const std::complex<double> step = std::polar(1.0, std::numbers::pi * (3 - std::sqrt(5.0)));
  std::complex<double> azimuth = std::polar(1.0, turn);
  const double share = 2 * std::numbers::pi * (1 - rim) / n;  // solid angle of a ray
  for (int i = 0; i < n; ++i, azimuth *= step) {
    const double cosine = 1 - (1 - rim) * (i + 0.5) / n;
    const Vec3d d = frame.at(cosine, azimuth);
    const double facing = dot(normal, d);
    if (!(facing > 0)) continue;
    const double through = transmitted(c.object, c.bvh, origin, d, 0, kInfinity);
    if (through == 1) continue;
    Vec3d lost = c.around.radiance(d) - sent;
    for (int k = 0; k < 3; ++k) lost[k] = std::max(lost[k], 0.0);
    taken = taken + lost * ((1 - through) * facing * share / std::numbers::pi);
  }
  for (const DistantLight& light : c.options.lights) {
    const double facing = dot(normal, light.towards);
    if (!(facing > 0)) continue;
    whole = whole + light.light * facing;
    const double through = transmitted(c.object, c.bvh, origin, light.towards, 0, kInfinity);
    taken = taken + light.light * (facing * (1 - through));
  }
  if (taken == Vec3d()) return std::nullopt;
  Vec3d left;
  for (int k = 0; k < 3; ++k)
    left[k] = whole[k] > 0 ? std::clamp(1 - taken[k] / whole[k], 0.0, 1.0) : 1;
  return left;
}

// The light that the object sends on, about: its mean colour, half lit.
Vec3d mean_sent(const ShadowCaster& c) {
  Vec3d sum, light;
  const size_t n = c.object.mesh.triangles.size(), step = std::max<size_t>(1, n / 256);
  double count = 0;
  for (size_t t = 0; t < n; t += step) {
    const SurfacePoint s = surface_point(c.object, static_cast<uint32_t>(t), 1.0 / 3, 1.0 / 3);
    sum = sum + s.base * s.alpha;
    count += s.alpha;
  }
  for (const Vec3d& d : {Vec3d{1, 0, 0}, Vec3d{-1, 0, 0}, Vec3d{0, 1, 0}, Vec3d{0, -1, 0}})
    light = light + c.around.diffuse(d) * 0.25;
  Vec3d sent;
  for (int k = 0; k < 3 && count > 0; ++k) sent[k] = 0.5 * sum[k] / count * light[k];
  return sent;
}

// Of a pixel's colour what the field sends, not what is seen through it nor what a medium before it
// adds.
void darken(const Vec3d& left, const Vec3& behind, Real through, const Vec3d& haze, Real* rgb) {
  for (int k = 0; k < 3; ++k) {
    const double back = static_cast<double>(through * behind[k]) + haze[k];
    const double own = std::max(0.0, static_cast<double>(rgb[k]) - back);
    rgb[k] = static_cast<Real>(linear_to_srgb(srgb_to_linear(own) * left[k]) + back);
  }
}

// What a medium adds before the surface in a pixel, times the surface's share of the pixel.
Vec3d haze_before(const ShadowCaster& caster, const SeenSurface& surface, const Camera& camera,
                  const Pose& camera_to_engine, int x, int y) {
  if (!caster.medium) return {};
  const auto point = surface.point(x, y);
  const auto ray = camera_ray(camera, camera_to_engine, {x + 0.5, y + 0.5});
  if (!point || !ray) return {};
  return MediumRay(*caster.medium, *ray).before(length(*point - ray->origin)).haze;
}

}  // namespace

void cast_shadows(const ShadowCaster& caster, const ObjectPixels& pixels, const Camera& camera,
                  const Pose& camera_to_engine, double unit, ThreadPool& pool, Frame& frame) {
  const SeenSurface surface(camera, camera_to_engine, unit, pixels.directions, frame);
  const Vec3d sent = mean_sent(caster);
  const size_t n = frame.alpha.size();
  // Away from the object every other pixel is that of its neighbours.
  enum class Pixel : uint8_t { kFar, kOfNeighbours, kLit, kShadowed };
  std::vector<Pixel> pixel(n, Pixel::kFar);
  std::vector<Vec3d> left(n, Vec3d{1, 1, 1});
  const auto look = [&](int x, int y, const Vec3d& point) {
    const size_t p = surface.index(x, y);
    const auto light =
        light_left(caster, sent, point, surface.normal(x, y, point, 0.1 * caster.radius), p);
    pixel[p] = light ? Pixel::kShadowed : Pixel::kLit;
    left[p] = light.value_or(Vec3d{1, 1, 1});
  };
  pool.parallel_for(camera.height, [&](int64_t row) {
    const int y = static_cast<int>(row);
    for (int x = 0; x < camera.width; ++x) {
      const auto point = surface.point(x, y);
      if (!point) continue;
      const double distance = length(*point - caster.centre) / caster.radius;
      if (distance > kReach) continue;
      if (distance > kNear && ((x + y) & 1))
        pixel[surface.index(x, y)] = Pixel::kOfNeighbours;
      else
        look(x, y, *point);
    }
  });
  pool.parallel_for(camera.height, [&](int64_t row) {
    const int y = static_cast<int>(row);
    for (int x = 0; x < camera.width; ++x) {
      const size_t p = surface.index(x, y);
      if (pixel[p] == Pixel::kFar || pixel[p] == Pixel::kLit) continue;
      // The mean over a few pixels of the same surface.
      Vec3d sum;
      int count = 0;
      bool shadowed = false;
      for (int j = std::max(0, y - 1); j <= std::min(camera.height - 1, y + 1); ++j)
        for (int i = std::max(0, x - 1); i <= std::min(camera.width - 1, x + 1); ++i) {
          const size_t q = surface.index(i, j);
          const Real ratio = frame.depth_z[q] / frame.depth_z[p];
          if (!(frame.alpha[q] >= 0.5_r) || !(ratio > 0.98_r && ratio < 1.02_r)) continue;
          if (pixel[q] == Pixel::kOfNeighbours) continue;
          sum = sum + left[q];
          shadowed |= pixel[q] == Pixel::kShadowed;
          ++count;
        }
      if (!shadowed) continue;
      const Vec3d light = sum / count;
      const Vec3& behind = pixels.seen(p) ? pixels.background[p] : caster.background;
      for (int k = 0; k < 3 && !frame.layers.shadow.empty(); ++k)
        frame.layers.shadow[3 * p + static_cast<size_t>(k)] = static_cast<Real>(light[k]);
      const Real through = 1 - frame.alpha[p];
      const Vec3d haze = haze_before(caster, surface, camera, camera_to_engine, x, y);
      darken(light, behind, through, haze, frame.rgb.data() + 3 * p);
    }
  });
}

void count_in(const ObjectPixels& pixels, size_t p, double depth, double distance,
              const Similarity& to_engine, Frame& frame) {
  const double before = static_cast<double>(frame.alpha[p]);
  const double weight = (1 - before) * static_cast<double>(pixels.opacity[p]);
  const bool half = before < 0.5 && before + weight >= 0.5 && pixels.half[p] < kInfinity;
  if (half) frame.depth_z[p] = static_cast<Real>(pixels.half[p] * depth);
  PictureLayers& layers = frame.layers;
  if (layers.empty()) return;
  if (!layers.cover.empty())
    layers.cover[p] = static_cast<Real>((1 - before) * static_cast<double>(pixels.cover[p]));
  if (half) {
    layers.distance[p] = static_cast<Real>(pixels.half[p] * distance);
    if (!layers.normal.empty()) {
      const Vec3d n = to_engine.rotation.transposed() * pixels.normal[p].cast<double>();
      for (int k = 0; k < 3; ++k)
        layers.normal[3 * p + static_cast<size_t>(k)] = static_cast<Real>(n[k]);
    }
  }
  if (pixels.stops.empty()) return;
  double stopped = before, first = 0, second = 0;  // and moments of the distances
  if (!layers.mean.empty()) {
    const double mean = static_cast<double>(layers.mean[p]);
    first = before * mean;
    second = before * (static_cast<double>(layers.variance[p]) + mean * mean);
  }
  for (const DeepSample& stop : pixels.stops[p]) {
    const double share = (1 - before) * static_cast<double>(stop.weight);
    const double at = 0.5 * static_cast<double>(stop.front + stop.back) * distance;
    const auto passes = [&](double bound) { return stopped < bound && stopped + share >= bound; };
    if (!layers.near.empty() && passes(0.05)) layers.near[p] = static_cast<Real>(at);
    if (!layers.far.empty() && passes(0.95)) layers.far[p] = static_cast<Real>(at);
    stopped += share;
    first += share * at;
    second += share * at * at;
    if (layers.deep.empty() || !(share > 0)) continue;
    DeepSample sample = stop;
    sample.front = static_cast<Real>(static_cast<double>(stop.front) * depth);
    sample.back = static_cast<Real>(static_cast<double>(stop.back) * depth);
    sample.weight = static_cast<Real>(share);
    for (Real& c : sample.rgb) c *= static_cast<Real>(1 - before);
    layers.deep[p].push_back(sample);
  }
  if (layers.mean.empty() || !(stopped > 0)) return;
  const double mean = first / stopped;
  layers.mean[p] = static_cast<Real>(mean);
  layers.variance[p] = static_cast<Real>(std::max(0.0, second / stopped - mean * mean));
}

}  // namespace nerf::internal
