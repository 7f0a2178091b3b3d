// Photos without alpha whose background was cut out to one colour: products on white, dancers
// before black.
#pragma once

#include <array>
#include <cstdint>

#include "nerf/base/options.h"
#include "nerf/math/vec.h"

namespace nerf {

using Rgb8 = std::array<uint8_t, 3>;  // sRGB

// What is to be done about it. As text auto, off or R,G,B.
struct CutOut {
  enum class Mode {
    kAuto,   // found by the border of the photos
    kOff,    // photos without alpha are opaque
    kColour  // what the border has of `colour` is background
  };
  Mode mode = Mode::kAuto;
  Rgb8 colour{};
  bool operator==(const CutOut&) const = default;
};

inline Vec3 to_vec3(const Rgb8& c) {
  return Vec3{static_cast<Real>(c[0]), static_cast<Real>(c[1]), static_cast<Real>(c[2])} / 255.0_r;
}

template <>
struct OptionTraits<CutOut> {
  static constexpr OptionType kType = OptionType::kText;
  static void describe(OptionField& field);
  static OptionValue to_value(const CutOut& cut_out);
  static CutOut from_value(const OptionValue& value);
};

}  // namespace nerf
