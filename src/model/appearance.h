// The light of a picture, applied to what was rendered.
#pragma once

#include <span>

#include "nerf/model/field.h"
#include "nerf/parts/codes.h"

namespace nerf::internal {

// Throws Error where the appearance has numbers that the field does not know.
void check_appearance(const Field& field, const Appearance& appearance);

// Colours [n][3], sRGB, clipped to [0, 1] where they are changed.
void change_colours(const Appearance& appearance, std::span<Real> rgb);

}  // namespace nerf::internal
