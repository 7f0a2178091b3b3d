#include "nerf/model/medium.h"

#include <algorithm>
#include <cmath>

#include "model/medium_ray.h"
#include "nerf/base/error.h"
#include "nerf/model/radiance_field.h"
#include "nerf/model/renderer.h"

namespace nerf {

void check_medium(const Medium& medium, const char* where) {
  for (int k = 0; k < 3; ++k) {
    for (const Vec3d* sigma : {&medium.attenuation, &medium.backscatter})
      if (!((*sigma)[k] >= 0) || !std::isfinite((*sigma)[k]))
        throw Error("a medium's coefficients are finite and not below 0", where);
    if (!(medium.colour[k] >= 0 && medium.colour[k] <= 1))
      throw Error("a medium's colour is from 0 to 1", where);
  }
  if (!std::isfinite(medium.height)) throw Error("a medium's height is a finite number", where);
  if (medium.falloff && !(*medium.falloff > 0 && std::isfinite(*medium.falloff)))
    throw Error("a medium's falloff is a finite number above 0", where);
  for (int k = 0; medium.box && k < 3; ++k)
    if (!(medium.box->min[k] < medium.box->max[k]))
      throw Error("a medium's box is empty: its first corner has the smaller coordinates", where,
                  "give x,y,z of the lower corner, then of the upper one");
}

namespace internal {

EngineMedium::EngineMedium(const Medium& medium, const Similarity& to_engine)
    : attenuation(medium.attenuation / to_engine.scale),
      backscatter(medium.backscatter / to_engine.scale),
      colour(medium.colour.cast<double>()),
      box(oblique_box(to_engine, medium.box)) {
  if (!medium.falloff) return;
  // The engine's z is the input's height from its own centre on.
  const Vec3d up = to_engine.rotation.transposed() * Vec3d{0, 0, 1};
  height = (medium.height - dot(up, to_engine.center)) * to_engine.scale;
  falloff = *medium.falloff * to_engine.scale;
}

std::optional<EngineMedium> engine_medium(const RadianceField& field,
                                          const RenderOptions& options) {
  const std::optional<Medium> medium = options.medium ? options.medium : field.medium();
  if (!medium || medium->empty()) return std::nullopt;
  check_medium(*medium, "RenderOptions::medium");
  return EngineMedium(*medium, field.info().to_engine);
}

double mean_transmittance(double a, double m) {
  if (m <= 0) return 1;
  if (!(m < 1e300)) return 0;
  if (!(a < 700)) return std::isinf(a) ? 1 : a / (a + m);
  // Thin matter spreads its light evenly.
  if (a < 1e-8) return -std::expm1(-m) / m;
  return a / (a + m) * std::expm1(-(a + m)) / std::expm1(-a);
}

MediumRay::MediumRay(const EngineMedium& medium, const Ray& ray)
    : medium_(&medium), from_(ray.medium_from), to_(ray.far) {
  if (medium.box && !medium.box->clip(ray.origin, ray.direction, from_, to_)) to_ = from_;
  if (medium.falloff > 0) {
    exponent_ = -(ray.origin.z - medium.height) / medium.falloff;
    slope_ = -ray.direction.z / medium.falloff;
  }
}

double MediumRay::amount(double t) const {
  const double end = std::min(t, to_), length = end - from_;
  if (!(length > 0)) return 0;
  if (!(medium_->falloff > 0)) return length;
  // From the denser end on: exp(most) times the mean of exp(-x s) over [0, 1].
  const double x = std::fabs(slope_) * length;
  const double most = exponent_ + slope_ * (slope_ > 0 ? end : from_);
  const double mean = x < 1e-12 ? 1 : -std::expm1(-x) / x;
  return std::exp(most) * (length * mean);
}

Veil MediumRay::veil(double amount, double within, double optical_depth) const {
  Veil veil;
  const auto left = [&](double sigma) {
    if (sigma == 0) return 1.0;
    const double first = std::exp(-sigma * amount);
    return within > 0 ? first * mean_transmittance(optical_depth, sigma * within) : first;
  };
  const Vec3d &a = medium_->attenuation, &b = medium_->backscatter;
  for (int k = 0; k < 3; ++k) {
    const bool again = k > 0 && a[k] == a[k - 1];
    veil.through[k] = again ? veil.through[k - 1] : left(a[k]);
    veil.haze[k] = (1 - (b[k] == a[k] ? veil.through[k] : left(b[k]))) * medium_->colour[k];
  }
  return veil;
}

Veil MediumRay::before(double front, double back, double optical_depth) const {
  const double amount_before = amount(front);
  return veil(amount_before, amount(back) - amount_before, optical_depth);
}

}  // namespace internal
}  // namespace nerf
