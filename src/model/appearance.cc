#include "model/appearance.h"

#include <string>

#include "nerf/base/error.h"

namespace nerf::internal {

void check_appearance(const Field& field, const Appearance& appearance) {
  const size_t code = static_cast<size_t>(field.codes().light());
  if (!appearance.code.empty() && appearance.code.size() != code)
    throw Error("a code of " + std::to_string(appearance.code.size()) +
                    " numbers was given, and the model's have " + std::to_string(code),
                "RenderOptions::appearance", "take appearance_of() the same model");
  if (!appearance.colours.empty() && appearance.colours.size() != kColourChange)
    throw Error("a change of colour has " + std::to_string(appearance.colours.size()) +
                    " numbers instead of " + std::to_string(kColourChange),
                "RenderOptions::appearance", "take appearance_of() the same model");
}

void check_time(Real time, const char* where) {
  if (time >= 0 && time <= 1) return;
  throw Error("a time of " + std::to_string(time) + " is not from 0 to 1", where,
              "0 is the capture's first moment, 1 its last");
}

}  // namespace nerf::internal
