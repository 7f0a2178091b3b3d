// The light of a picture, applied to what was rendered.
#pragma once

#include <algorithm>
#include <span>

#include "nerf/model/field.h"
#include "nerf/parts/codes.h"

namespace nerf::internal {

// Throws Error where the appearance has numbers that the field does not know.
void check_appearance(const Field& field, const Appearance& appearance);
// Throws Error where a time is none from 0 to 1; `where`: of whom.
void check_time(Real time, const char* where);

// Colours [n][3] over backgrounds, sRGB, clipped to [0, 1] where they are changed; opacities [n].
template <class Background>
void change_colours(const Appearance& appearance, std::span<const Real> opacity,
                    const Background& background_of, std::span<Real> rgb) {
  if (appearance.colours.empty()) return;
  for (size_t i = 0; i < opacity.size(); ++i) {
    const auto changed = appearance.changed(rgb.data() + 3 * i, opacity[i], background_of(i));
    for (size_t k = 0; k < 3; ++k) rgb[3 * i + k] = std::clamp(changed[k], 0.0_r, 1.0_r);
  }
}

}  // namespace nerf::internal
