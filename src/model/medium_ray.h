// The medium that a ray passes, in closed form.
#pragma once

#include <optional>

#include "model/oblique_box.h"
#include "nerf/math/ray.h"
#include "nerf/model/medium.h"

namespace nerf {
class RadianceField;
struct RenderOptions;
}  // namespace nerf

namespace nerf::internal {

// A medium in engine coordinates and units.
struct EngineMedium {
  EngineMedium(const Medium& medium, const Similarity& to_engine);

  Vec3d attenuation, backscatter;  // 1 / engine unit
  Vec3d colour;
  double height = 0, falloff = 0;  // along z; 0: the same everywhere
  std::optional<ObliqueBox> box;
};

// What RenderOptions::medium says, or what the field has learnt; none where it would change
// nothing. Throws Error as check_medium() does.
std::optional<EngineMedium> engine_medium(const RadianceField& field, const RenderOptions& options);

// What the medium does to light from behind it: by so much it is weakened, and so much is added.
struct Veil {
  Vec3d through, haze;

  double over(int channel, double light) const { return through[channel] * light + haze[channel]; }
  double mean_through() const { return (through.x + through.y + through.z) / 3; }
};

// One ray's way through it. The medium must outlive this.
class MediumRay {
 public:
  MediumRay(const EngineMedium& medium, const Ray& ray);

  // Engine units of the medium at its full density between Ray::medium_from and a distance.
  double amount(double t) const;
  // Before what stands at a distance.
  Veil before(double t) const { return veil(amount(t), 0, 0); }
  // Before the ray's end.
  Veil behind() const { return before(to_); }
  // Before matter between two distances that spreads an optical depth evenly over the medium
  // there: the mean, by the light that the matter stops.
  Veil before(double front, double back, double optical_depth) const;

 private:
  Veil veil(double amount, double within, double optical_depth) const;

  const EngineMedium* medium_;
  double from_, to_;     // distances between which there is any
  double exponent_ = 0;  // of the density at distance 0
  double slope_ = 0;     // its change per unit
};

// What a ray's samples show through it, added up from the front.
struct SeenLight {
  MediumRay medium;
  // Weights times Veil::through and times Veil::haze of samples that are to get one colour.
  Vec3d through, haze;
  Vec3d light;  // the haze of all samples so far

  // A sample between two distances, and whether it is to get a colour.
  void add(double front, double back, double optical_depth, double weight, bool coloured) {
    const Veil veil = medium.before(front, back, optical_depth);
    light = light + veil.haze * weight;
    if (!coloured) return;
    through = through + veil.through * weight;
    haze = haze + veil.haze * weight;
  }
};

// Mean of exp(-m s) over s in [0, 1], by the light that matter of an optical depth stops which is
// spread evenly there:  integral of a exp(-(a + m) s) ds / (1 - exp(-a)).
double mean_transmittance(double optical_depth, double m);

}  // namespace nerf::internal
