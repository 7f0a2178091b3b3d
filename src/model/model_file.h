// The model file behind RadianceField::load and save.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "base/container.h"
#include "nerf/model/radiance_field.h"

namespace nerf::internal {

inline constexpr ContainerFormat kModelFormat{
    "NERFMODL", 1, "model file", "copy it again, or save it anew with nerf_train --resume"};

// The field that the bytes of a model file hold; `where` names it in messages. Throws Error.
RadianceField parse_model(std::vector<uint8_t> bytes, const std::string& where);

}  // namespace nerf::internal
