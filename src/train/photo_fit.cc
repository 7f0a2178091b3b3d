#include "train/photo_fit.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "model/coded_rays.h"
#include "nerf/math/ray.h"
#include "nerf/model/field.h"
#include "nerf/model/integrator.h"
#include "train/least_squares.h"

namespace nerf {

namespace {

constexpr int kRays = 1500;     // of a photo's half, about
constexpr double kError = 0.1;  // beyond it a colour's error counts linearly, and the prior's unit
constexpr double kStep = 0.1;   // of differences, in standard deviations of what was learnt
constexpr double kLeastSpread = 0.02;  // of a number among the photos

// A number of every photo's code.
struct Spread {
  double mean = 0, deviation = kLeastSpread;
};

Spread spread_of(const std::vector<Appearance>& learnt, std::vector<Real> Appearance::* part,
                 size_t i) {
  Spread s;
  double square = 0;
  const double n = static_cast<double>(learnt.size());
  for (const Appearance& a : learnt) s.mean += static_cast<double>((a.*part)[i]) / n;
  for (const Appearance& a : learnt) {
    const double d = static_cast<double>((a.*part)[i]) - s.mean;
    square += d * d / n;
  }
  s.deviation = std::max(kLeastSpread, std::sqrt(square));
  return s;
}

struct Pixels {
  std::vector<Ray> rays;
  std::vector<Real> rgb;  // [rays][3], over the background
};

Pixels left_half(const RadianceField& field, const Camera& camera, const Pose& camera_to_world,
                 const Photo& photo, const RenderOptions& options) {
  Pixels out;
  const Camera own = camera.in_unit(field.info().to_engine.scale);
  const Pose pose = field.info().to_engine.apply(camera_to_world);
  const int width = fitted_columns(photo.width);
  const double apart = std::max(1.0, std::sqrt(double{1} * width * photo.height / kRays));
  for (double v = 0.5 * apart; v < photo.height; v += apart)
    for (double u = 0.5 * apart; u < width; u += apart) {
      const int x = static_cast<int>(u), y = static_cast<int>(v);
      if (photo.masked_out(x, y)) continue;
      const Vec2d at{x + 0.5, y + 0.5};
      auto ray = camera_ray(own, pose, at);
      if (!ray) continue;
      ray->near = field.info().near;
      ray->radius = static_cast<Real>(pixel_cone_radius(own, at));
      ray->time = options.time;
      ray->background = options.background;
      out.rays.push_back(*ray);
      Real rgba[4];
      photo.pixel(x, y, rgba);
      for (int k = 0; k < 3; ++k)
        out.rgb.push_back(rgba[k] * rgba[3] + options.background[k] * (1 - rgba[3]));
    }
  return out;
}

// Whose square grows like a Huber loss.
double robust(double e) {
  const double size = std::abs(e);
  return size <= kError ? e : std::copysign(std::sqrt(kError * (2 * size - kError)), e);
}

}  // namespace

Appearance fit_appearance(const RadianceField& field, const Camera& camera,
                          const Pose& camera_to_world, const Photo& photo,
                          const RenderOptions& options, ThreadPool& pool, const Cancel* cancel) {
  const CodeBooks& books = field.field().codes();
  if (books.light() == 0 && books.colours.out == 0) return {};
  std::vector<Appearance> learnt;
  for (int p = 0; p < books.rows(); ++p)
    learnt.push_back(appearance_of(books, field.field().all_weights(), p));
  const size_t codes = learnt.front().code.size(), changes = learnt.front().colours.size();
  std::vector<Spread> spread;
  for (size_t i = 0; i < codes; ++i) spread.push_back(spread_of(learnt, &Appearance::code, i));
  for (size_t i = 0; i < changes; ++i) {
    spread.push_back(spread_of(learnt, &Appearance::colours, i));
    spread.back().mean = 0;  // what pictures without a photo have
  }

  const Pixels pixels = left_half(field, camera, camera_to_world, photo, options);
  const auto rays = internal::coded_rays(field, pixels.rays, options, pool, cancel);
  std::vector<Real> rendered, code_of_rendered, opacity(pixels.rays.size(), 1.0_r);
  if (changes > 0) opacity = integrate(field, pixels.rays, {}, options, pool, {}, cancel).opacity;
  // x: deviations from the mean, in units of the spread.
  const auto appearance_at = [&](std::span<const double> x) {
    Appearance a;
    for (size_t i = 0; i < x.size(); ++i)
      (i < codes ? a.code : a.colours)
          .push_back(static_cast<Real>(spread[i].mean + spread[i].deviation * x[i]));
    return a;
  };
  const auto residuals = [&](std::span<const double> x, std::vector<double>& r) {
    if (cancel && cancel->requested()) throw Cancelled();
    const Appearance a = appearance_at(x);
    if (rendered.empty() || a.code != code_of_rendered) {
      code_of_rendered = a.code;
      rendered = rays->pixels(a.code);
    }
    r.clear();
    for (size_t i = 0; i < pixels.rays.size(); ++i) {
      const auto rgb = a.changed(rendered.data() + 3 * i, opacity[i], pixels.rays[i].background);
      for (size_t k = 0; k < 3; ++k)
        r.push_back(robust(static_cast<double>(rgb[k] - pixels.rgb[3 * i + k])));
    }
    for (const double d : x) r.push_back(kError * d);
  };
  std::vector<double> x(codes + changes, 0.0);
  if (!pixels.rays.empty())
    minimise_squares(residuals, std::vector<double>(x.size(), kStep), x, {.most_iterations = 12});
  return appearance_at(x);
}

}  // namespace nerf
