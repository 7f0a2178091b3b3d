#include "model/appearance.h"

#include <string>

#include "nerf/base/error.h"

namespace nerf::internal {

void check_appearance(const Field& field, const Appearance& appearance) {
  const size_t code = static_cast<size_t>(field.codes().shape().appearance);
  if (!appearance.code.empty() && appearance.code.size() != code)
    throw Error("a code of " + std::to_string(appearance.code.size()) +
                    " numbers was given, and the model's have " + std::to_string(code),
                "RenderOptions::appearance", "take appearance_of() the same model");
  if (!appearance.colours.empty() && appearance.colours.size() != kColourChange)
    throw Error("a change of colour has " + std::to_string(appearance.colours.size()) +
                    " numbers instead of " + std::to_string(kColourChange),
                "RenderOptions::appearance", "take appearance_of() the same model");
}

}  // namespace nerf::internal
