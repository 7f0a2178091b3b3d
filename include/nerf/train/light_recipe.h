// What differs between photos: the light that each was taken in, and what was in the way.
#pragma once

#include <string>

#include "nerf/base/options.h"

namespace nerf {

// A number, none, or as many as the capture asks for.
struct AutoCount {
  bool automatic = true;
  int count = 0;  // where not automatic
  bool operator==(const AutoCount&) const = default;
};

// A number, none (0), or the one that the capture asks for.
template <class Limit>
struct AutoNumber {
  bool automatic = true;
  double number = 0;  // where not automatic
  bool operator==(const AutoNumber&) const = default;
};
struct ShareLimit {
  static constexpr double kMost = 0.5;
  static constexpr const char* kExpected = "expected auto, off or a share up to 0.5";
};
struct FactorLimit {
  static constexpr double kMost = 2;
  static constexpr const char* kExpected = "expected auto, off or a factor up to 2";
};
using AutoShare = AutoNumber<ShareLimit>;
using AutoFactor = AutoNumber<FactorLimit>;

enum class Switch { kAuto, kOff, kOn };
inline auto option_names(Switch) {
  return std::array{OptionName{Switch::kAuto, "auto"}, OptionName{Switch::kOff, "off"},
                    OptionName{Switch::kOn, "on"}};
}

inline constexpr int kMostAppearance = 64;

template <>
struct OptionTraits<AutoCount> {
  static constexpr OptionType kType = OptionType::kText;
  static void describe(OptionField& f);
  static OptionValue to_value(const AutoCount& x);
  static AutoCount from_value(const OptionValue& v);
};

template <class Limit>
struct OptionTraits<AutoNumber<Limit>> {
  static constexpr OptionType kType = OptionType::kText;
  static void describe(OptionField& f);
  static OptionValue to_value(const AutoNumber<Limit>& x);
  static AutoNumber<Limit> from_value(const OptionValue& v);
};

struct LightRecipe {
  AutoShare robust;
  AutoCount appearance;
  Switch colour_correction = Switch::kAuto;
  double code_rate = 0.05, code_decay = 0.01;
  double colour_rate = 0.02, colour_decay = 0.01;
  AutoFactor exif_exposure;
  Switch vignetting = Switch::kAuto, sky = Switch::kAuto;
  double sky_clearing = 0.03;
  double vignetting_rate = 0.1, vignetting_decay = 0.01;

  template <class V>
  void visit_options(V& v) {
    v("robust", robust,
      "share of the pixels that people in the way and other things that move may cover: those are "
      "left out whose error stays large together with their surroundings'; auto, off or a share");
    v("appearance", appearance,
      "numbers learnt for each photo that its colours depend on (weather, shadows, time of day): "
      "auto, off or how many",
      brief("numbers learnt for each photo's light: auto, off or N"));
    v("colour_correction", colour_correction,
      "a change of exposure and white balance that is learnt for each photo");
    v("code_rate", code_rate, "step size of the appearance numbers, as a share of the networks'",
      above(0), at_most(10));
    v("code_decay", code_decay,
      "how fast the appearance numbers fall to 0, as a share of their "
      "step size",
      at_least(0), at_most(100));
    v("colour_rate", colour_rate,
      "step size of the colour corrections, as a share of the networks'", above(0), at_most(10));
    v("colour_decay", colour_decay,
      "how fast the colour corrections fall to none, as a share of "
      "their step size",
      at_least(0), at_most(100));
    v("exif_exposure", exif_exposure,
      "stops that a photo is expected to be brighter for each that its EXIF lets in more, where "
      "colour corrections begin and what they fall to; auto (where sparse points show it), off or "
      "a factor");
    v("vignetting", vignetting,
      "how each lens darkens its photos towards their corners is learnt, and left out of pictures");
    v("vignetting_rate", vignetting_rate,
      "step size of the lenses' falloff, as a share of the networks'", above(0), at_most(10));
    v("vignetting_decay", vignetting_decay,
      "how fast the lenses' falloff falls to none, as a share of its step size", at_least(0),
      at_most(100));
    v("sky", sky,
      "what is behind all matter is learnt by direction and by the photo's appearance numbers");
    v("sky_clearing", sky_clearing,
      "weight of a loss that thins what stands before the sky, so that matter does not take its "
      "place; it falls to a tenth",
      at_least(0), at_most(10));
  }
};

}  // namespace nerf
