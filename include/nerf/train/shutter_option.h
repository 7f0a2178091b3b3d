// What a training is told of how its photos' lines were read.
#pragma once

#include <array>

#include "nerf/base/options.h"

namespace nerf {

// The share of a frame's time in which a picture's lines are read, or that it is to be learnt.
struct Readout {
  bool learnt = false;
  double share = 0;  // where not learnt; 0: all at once
  bool any() const { return learnt || share > 0; }
  bool operator==(const Readout&) const = default;
};

inline constexpr double kMostReadout = 1.5;

template <>
struct OptionTraits<Readout> {
  static constexpr OptionType kType = OptionType::kText;
  static void describe(OptionField& f);
  static OptionValue to_value(const Readout& x);
  static Readout from_value(const OptionValue& v);
};

// The side of the pixels as they are stored that is read first.
enum class FirstLine { kAuto, kTop, kBottom, kLeft, kRight };
inline auto option_names(FirstLine) {
  return std::array{OptionName{FirstLine::kAuto, "auto"}, OptionName{FirstLine::kTop, "top"},
                    OptionName{FirstLine::kBottom, "bottom"}, OptionName{FirstLine::kLeft, "left"},
                    OptionName{FirstLine::kRight, "right"}};
}

}  // namespace nerf
