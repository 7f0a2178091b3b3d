// A participating medium that fills a scene: fog, smoke, water.
//
// What a ray meets at distance t is seen through the medium before it:
//   M_a(t) colour + (1 - M_b(t)) medium colour,   M_a = exp(-attenuation m(t)), M_b likewise,
// m being the amount of medium up to t. With equal coefficients the mean of this over the field's
// light is the volume rendering equation of both, the medium's emission integrated by parts; water
// as SeaThru-NeRF models it has two (Levy et al. 2023, section 4).
#pragma once

#include <optional>

#include "nerf/base/real.h"
#include "nerf/math/vec.h"

namespace nerf {

struct Medium {
  // 1 / input unit, by channel, where the medium is as dense as its coefficients say: of light
  // from what stands in it, and of the light that it sends itself.
  Vec3d attenuation{}, backscatter{};
  // What so much of it shows that nothing is seen through it: in [0, 1], sRGB as the field's
  // colours, which are composited as they are.
  Vec3 colour{};
  // Density falls as exp(-(h - height) / falloff), h being a point's coordinate along the scene's
  // up, input units, and grows below. Without: the same everywhere.
  double height = 0;
  std::optional<double> falloff{};
  std::optional<Box3> box{};  // input coordinates: there is none outside

  // Whether it changes nothing.
  bool empty() const { return attenuation == Vec3d() && backscatter == Vec3d(); }
};

// What a field learns of the medium that its photos were taken through.
enum class LearntMedium {
  kNone,
  kFog,    // one coefficient for all, and a colour
  kWater,  // attenuation and backscatter by channel, and a colour
};

// Throws Error for numbers that are not finite, coefficients below 0, colours outside [0, 1], a
// falloff that is not above 0 and boxes that are inside out. `where`: for the message.
void check_medium(const Medium& medium, const char* where);

}  // namespace nerf
