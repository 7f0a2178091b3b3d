#include "nerf/geometry/object.h"

#include <algorithm>
#include <cmath>

#include "nerf/math/srgb.h"

namespace nerf {

namespace {

// Index of a pixel on an axis of n of them.
int wrapped(int i, int n, TextureWrap wrap) {
  switch (wrap) {
    case TextureWrap::kClamp:
      return std::clamp(i, 0, n - 1);
    case TextureWrap::kMirror: {
      const int at = ((i % (2 * n)) + 2 * n) % (2 * n);
      return at < n ? at : 2 * n - 1 - at;
    }
    case TextureWrap::kRepeat:
      break;
  }
  return ((i % n) + n) % n;
}

// A coordinate without the whole turns that change nothing, so that pixels are numbers of an int.
double reduced(double u, TextureWrap wrap) {
  if (!std::isfinite(u)) return 0;
  return wrap == TextureWrap::kClamp ? std::clamp(u, -1.0, 2.0) : u - 2 * std::floor(u / 2);
}

const std::array<float, 256>& linear_of_byte() {
  static const std::array<float, 256> table = [] {
    std::array<float, 256> t;
    for (size_t i = 0; i < 256; ++i)
      t[i] = static_cast<float>(srgb_to_linear(static_cast<double>(i) / 255));
    return t;
  }();
  return table;
}

// Weighted sum of something that the corners have.
template <class T>
T mixed(const T& a, const T& b, const T& c, double u, double v) {
  return a * (1 - u - v) + b * u + c * v;
}

struct Corners {
  const SceneObject& object;
  const TriangleMesh::Triangle& t;
  double u, v;

  std::array<double, 4> texture(const TextureUse& use) const {
    if (use.texture < 0) return {1, 1, 1, 1};
    double x = use.origin.x, y = use.origin.y;
    if (const auto& uv = object.uv[static_cast<size_t>(use.uv)]; !uv.empty()) {
      const auto along = [&](auto member) {
        return mixed(static_cast<double>(uv[t[0]].*member), static_cast<double>(uv[t[1]].*member),
                     static_cast<double>(uv[t[2]].*member), u, v);
      };
      const double s = along(&Vec2::x), r = along(&Vec2::y);
      x += use.along_u.x * s + use.along_v.x * r;
      y += use.along_u.y * s + use.along_v.y * r;
    }
    return object.textures[static_cast<size_t>(use.texture)].at(x, y);
  }
  double colour(size_t k) const {
    if (object.colours.empty()) return 1;
    return mixed(static_cast<double>(object.colours[t[0]][k]),
                 static_cast<double>(object.colours[t[1]][k]),
                 static_cast<double>(object.colours[t[2]][k]), u, v);
  }
};

double alpha_of(const Material& material, double texture, double colour) {
  if (material.alpha_mode == AlphaMode::kOpaque) return 1;
  const double alpha = std::clamp(material.alpha * texture * colour, 0.0, 1.0);
  if (material.alpha_mode == AlphaMode::kMask) return alpha < material.alpha_cutoff ? 0 : 1;
  return alpha;
}

}  // namespace

std::array<double, 4> Texture::at(double u, double v) const {
  const double x = reduced(u, wrap_x) * width - 0.5, y = reduced(v, wrap_y) * height - 0.5;
  const auto pixel = [&](int i, int j) {
    const uint8_t* p = pixels.data() + 4 * (static_cast<size_t>(wrapped(j, height, wrap_y)) *
                                                static_cast<size_t>(width) +
                                            static_cast<size_t>(wrapped(i, width, wrap_x)));
    std::array<double, 4> c;
    for (size_t k = 0; k < 4; ++k)
      c[k] = srgb && k < 3 ? static_cast<double>(linear_of_byte()[p[k]]) : p[k] / 255.0;
    return c;
  };
  if (nearest)
    return pixel(static_cast<int>(std::floor(x + 0.5)), static_cast<int>(std::floor(y + 0.5)));
  const double i = std::floor(x), j = std::floor(y), s = x - i, t = y - j;
  std::array<double, 4> sum{};
  for (int k = 0; k < 4; ++k) {
    const auto c = pixel(static_cast<int>(i) + (k & 1), static_cast<int>(j) + (k >> 1));
    const double w = (k & 1 ? s : 1 - s) * (k >> 1 ? t : 1 - t);
    for (size_t n = 0; n < 4; ++n) sum[n] += w * c[n];
  }
  return sum;
}

double surface_alpha(const SceneObject& object, uint32_t triangle, double u, double v) {
  const Material& m = object.materials[static_cast<size_t>(object.material[triangle])];
  if (m.alpha_mode == AlphaMode::kOpaque) return 1;
  const Corners at{object, object.mesh.triangles[triangle], u, v};
  return alpha_of(m, at.texture(m.base_texture)[3], at.colour(3));
}

SurfacePoint surface_point(const SceneObject& object, uint32_t triangle, double u, double v) {
  const Material& m = object.materials[static_cast<size_t>(object.material[triangle])];
  const Corners at{object, object.mesh.triangles[triangle], u, v};
  const auto& t = at.t;
  SurfacePoint p;
  const auto base = at.texture(m.base_texture);
  p.base = {m.base.x * base[0] * at.colour(0), m.base.y * base[1] * at.colour(1),
            m.base.z * base[2] * at.colour(2)};
  p.alpha = alpha_of(m, base[3], at.colour(3));
  const auto rough = at.texture(m.metallic_roughness_texture);
  p.metallic = std::clamp(m.metallic * rough[2], 0.0, 1.0);
  p.roughness = std::clamp(m.roughness * rough[1], 0.0, 1.0);
  const auto emissive = at.texture(m.emissive_texture);
  p.emissive = {m.emissive.x * emissive[0], m.emissive.y * emissive[1], m.emissive.z * emissive[2]};
  const auto corner = [&](size_t k) { return object.mesh.positions[t[k]].cast<double>(); };
  p.geometric = normalized(cross(corner(1) - corner(0), corner(2) - corner(0)));
  p.normal = p.geometric;
  if (!object.mesh.normals.empty()) {
    const auto normal = [&](size_t k) { return object.mesh.normals[t[k]].cast<double>(); };
    const Vec3d n = normalized(mixed(normal(0), normal(1), normal(2), u, v));
    if (n != Vec3d()) p.normal = n;
  }
  p.unlit = m.unlit;
  p.double_sided = m.double_sided;
  return p;
}

}  // namespace nerf
