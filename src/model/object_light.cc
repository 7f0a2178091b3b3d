#include "model/object_light.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "nerf/base/error.h"
#include "nerf/math/random.h"
#include "nerf/math/srgb.h"
#include "nerf/model/integrator.h"
#include "nerf/model/radiance_field.h"

namespace nerf::internal {

namespace {

constexpr double kPi = std::numbers::pi;

// The nine real spherical harmonics of degree 0 to 2.
std::array<double, 9> harmonics_at(const Vec3d& d) {
  return {0.282095,
          0.488603 * d.y,
          0.488603 * d.z,
          0.488603 * d.x,
          1.092548 * d.x * d.y,
          1.092548 * d.y * d.z,
          0.315392 * (3 * d.z * d.z - 1),
          1.092548 * d.x * d.z,
          0.546274 * (d.x * d.x - d.y * d.y)};
}

// Each pixel the mean of 2 x 2, by solid angle.
Environment::Map halved(const Environment::Map& map) {
  Environment::Map half{map.width / 2, map.height / 2, {}};
  for (int y = 0; y < half.height; ++y)
    for (int x = 0; x < half.width; ++x) {
      Vec3d sum;
      double weights = 0;
      for (int k = 0; k < 4; ++k) {
        const int v = 2 * y + (k >> 1);
        const double w = map.solid_angle(v);
        sum = sum + map.pixels[static_cast<size_t>(v * map.width + 2 * x + (k & 1))] * w;
        weights += w;
      }
      half.pixels.push_back(sum / weights);
    }
  return half;
}

// By the cosine to a power.
Environment::Map blurred(const Environment::Map& map, double power) {
  Environment::Map out{map.width, map.height, {}};
  std::vector<Vec3d> directions;
  for (int y = 0; y < map.height; ++y)
    for (int x = 0; x < map.width; ++x) directions.push_back(map.direction(x, y));
  for (const Vec3d& to : directions) {
    Vec3d sum;
    double weights = 0;
    for (size_t i = 0; i < directions.size(); ++i) {
      const double cosine = dot(to, directions[i]);
      if (!(cosine > 0)) continue;
      const double w = std::pow(cosine, power) * map.solid_angle(static_cast<int>(i) / map.width);
      sum = sum + map.pixels[i] * w;
      weights += w;
    }
    out.pixels.push_back(sum / weights);
  }
  return out;
}

}  // namespace

Vec3d Environment::Map::direction(int x, int y) const {
  const double azimuth = 2 * kPi * ((x + 0.5) / width - 0.5), polar = kPi * (y + 0.5) / height;
  return {std::sin(polar) * std::cos(azimuth), std::sin(polar) * std::sin(azimuth),
          std::cos(polar)};
}

double Environment::Map::solid_angle(int y) const {
  return 2 * kPi / width * (std::cos(kPi * y / height) - std::cos(kPi * (y + 1) / height));
}

// Between four pixels.
Vec3d Environment::Map::at(const Vec3d& d) const {
  const double x = (std::atan2(d.y, d.x) / (2 * kPi) + 0.5) * width - 0.5;
  const double y = std::acos(std::clamp(d.z, -1.0, 1.0)) / kPi * height - 0.5;
  const double i = std::floor(x), j = std::floor(y), s = x - i, t = y - j;
  Vec3d sum;
  for (int k = 0; k < 4; ++k) {
    const int below = static_cast<int>(j) + (k >> 1), row = std::clamp(below, 0, height - 1);
    // Beyond a pole the other side begins.
    const int across = below == row ? 0 : width / 2;
    const int column = (static_cast<int>(i) + (k & 1) + across + width) % width;
    sum = sum + pixels[static_cast<size_t>(row * width + column)] *
                    ((k & 1 ? s : 1 - s) * (k >> 1 ? t : 1 - t));
  }
  return sum;
}

Environment::Environment(const Vec3d& radiance) : map_{1, 1, {radiance}} {
  harmonics_[0] = radiance * (4 * kPi * harmonics_at({})[0]);
  blurred_.fill(map_);
}

void Environment::prepare() {
  harmonics_ = {};
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x) {
      const auto h = harmonics_at(map_.direction(x, y));
      const Vec3d& radiance = map_.pixels[static_cast<size_t>(y * kWidth + x)];
      for (size_t k = 0; k < 9; ++k)
        harmonics_[k] = harmonics_[k] + radiance * (h[k] * map_.solid_angle(y));
    }
  // Lobes of the cosine to a power that belongs to the roughness (alpha = roughness^2; exponent of
  // the Phong lobe that is as wide, Walter et al. 2007).
  const Map half = halved(map_);
  for (size_t level = 0; level < 3; ++level) {
    const double rough = static_cast<double>(level + 1) / 3, alpha = rough * rough;
    blurred_[level] = blurred(half, std::max(0.0, 2 / (alpha * alpha) - 2) / 4 + 1);
  }
}

Vec3d Environment::mirrored(const Vec3d& d, double roughness) const {
  const double at = std::clamp(roughness, 0.0, 1.0) * 3;
  const auto level = [&](int i) {
    return i == 0 ? map_.at(d) : blurred_[static_cast<size_t>(i - 1)].at(d);
  };
  const int low = std::min(2, static_cast<int>(at));
  const double share = at - low;
  if (share == 0) return level(low);
  return level(low) * (1 - share) + level(low + 1) * share;
}

Vec3d Environment::diffuse(const Vec3d& normal) const {
  // The clamped cosine's own coefficients, over pi.
  constexpr double kBand[3] = {1, 2.0 / 3, 0.25};
  const auto h = harmonics_at(normal);
  Vec3d sum;
  for (size_t k = 0; k < 9; ++k)
    sum = sum + harmonics_[k] * (h[k] * kBand[k == 0 ? 0 : k < 4 ? 1 : 2]);
  for (int k = 0; k < 3; ++k) sum[k] = std::max(sum[k], 0.0);
  return sum;
}

Environment environment_of(const RadianceField& field, const Vec3d& centre, double near,
                           const RenderOptions& options, ThreadPool& pool) {
  std::vector<Ray> rays;
  const Environment::Map map{Environment::kWidth, Environment::kHeight, {}};
  for (int y = 0; y < map.height; ++y)
    for (int x = 0; x < map.width; ++x) {
      Ray ray;
      ray.origin = centre;
      ray.direction = map.direction(x, y);
      ray.near = near;
      ray.radius = static_cast<Real>(kPi / Environment::kHeight / std::sqrt(12.0));
      ray.time = options.time;
      ray.background = field.shows_background() ? options.background : Vec3{};
      rays.push_back(ray);
    }
  const RayResults seen = integrate(field, rays, {}, options, pool);
  size_t next = 0;
  return Environment::from([&](const Vec3d&) {
    const Real* rgb = seen.rgb.data() + 3 * next++;
    Vec3d c;
    for (int k = 0; k < 3; ++k)
      c[k] = srgb_to_linear(std::clamp(static_cast<double>(rgb[k]), 0.0, 1.0));
    return c;
  });
}

double transmitted(const SceneObject& object, const TriangleBvh& bvh, const Vec3d& origin,
                   const Vec3d& direction, double near, double far) {
  double light = 1;
  bvh.each(origin, direction, near, far, [&](const TriangleHit& hit) {
    light *= 1 - surface_alpha(object, hit.triangle, hit.u, hit.v);
    return light > 0;
  });
  return light;
}

// Distances from four corners of a tetrahedron tell, up to a mirror image, which lets as much light
// in: the first point, the farthest from it, from their line, and from the plane of these.
bool same_shape(std::span<const Vec3> a, std::span<const Vec3> b) {
  const size_t n = a.size();
  if (n == 0 || b.size() != n) return false;
  const auto distance = [](std::span<const Vec3> p, size_t i, size_t j) {
    return length(p[i].cast<double>() - p[j].cast<double>());
  };
  double from = 0, to = 0;
  for (size_t i = 0; i < n; ++i) {
    from += distance(a, i, 0);
    to += distance(b, i, 0);
  }
  if (!(from > 0) || !(to > 0)) return false;
  const double scale = to / from, tolerance = 1e-3 * to / static_cast<double>(n);
  size_t corners[4] = {};
  const auto edge = [&](size_t i) { return a[i].cast<double>() - a[0].cast<double>(); };
  const auto farthest = [&](const auto& measure) {
    size_t best = 0;
    for (size_t i = 1; i < n; ++i)
      if (measure(i) > measure(best)) best = i;
    return best;
  };
  corners[1] = farthest([&](size_t i) { return length(edge(i)); });
  const Vec3d along = edge(corners[1]);
  corners[2] = farthest([&](size_t i) { return length(cross(edge(i), along)); });
  const Vec3d normal = cross(along, edge(corners[2]));
  corners[3] = farthest([&](size_t i) { return std::fabs(dot(edge(i), normal)); });
  for (const size_t j : corners)
    for (size_t i = 0; i < n; ++i)
      if (!(std::fabs(distance(b, i, j) - scale * distance(a, i, j)) <= tolerance)) return false;
  return true;
}

std::vector<Real> vertex_openness(const SceneObject& object, const TriangleBvh& bvh, double size,
                                  ThreadPool& pool) {
  constexpr size_t kMostRays = 3'000'000;
  const size_t n = object.mesh.positions.size();
  const size_t rays = std::clamp<size_t>(kMostRays / std::max<size_t>(n, 1), 4, 64);
  // Of vertices without a normal, those of their triangles.
  std::vector<Vec3d> normals(n);
  for (uint32_t t = 0; t < object.mesh.triangles.size(); ++t) {
    const Vec3d geometric = surface_point(object, t, 1.0 / 3, 1.0 / 3).geometric;
    for (const uint32_t v : object.mesh.triangles[t]) {
      const Vec3d own =
          object.mesh.normals.empty() ? Vec3d() : object.mesh.normals[v].cast<double>();
      normals[v] = own == Vec3d() ? normals[v] + geometric : own;
    }
  }
  std::vector<Real> open(n, 1.0_r);
  constexpr size_t kPart = 64;
  pool.parallel_for(static_cast<int64_t>((n + kPart - 1) / kPart), [&](int64_t part) {
    const size_t begin = static_cast<size_t>(part) * kPart;
    for (size_t v = begin; v < std::min(n, begin + kPart); ++v) {
      const Vec3d normal = normalized(normals[v]);
      if (normal == Vec3d()) continue;
      const Vec3d origin = object.mesh.positions[v].cast<double>() + normal * (1e-3 * size);
      Random random(1, 0, v);
      double sum = 0;
      for (size_t i = 0; i < rays; ++i) {
        // A unit vector added to the normal is distributed by its cosine.
        const double z = 2 * (static_cast<double>(i) + static_cast<double>(random.uniform())) /
                             static_cast<double>(rays) -
                         1;
        const double a = 2 * kPi * static_cast<double>(random.uniform()), r = std::sqrt(1 - z * z);
        const Vec3d d = normalized(normal + Vec3d{r * std::cos(a), r * std::sin(a), z});
        sum += d == Vec3d() ? 1 : transmitted(object, bvh, origin, d, 0, 4 * size);
      }
      open[v] = static_cast<Real>(sum / static_cast<double>(rays));
    }
  });
  return open;
}

}  // namespace nerf::internal
