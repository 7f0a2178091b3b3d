// JSON as programs write it.
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>

#include "nerf/base/error.h"

namespace nerf::internal {

// A value that must be a number and is none (NaN, infinite).
class NotFinite : public Error {
 public:
  using Error::Error;
};

// Reads a JSON file. NaN, Infinity and what C++ prints for them (nan, -inf, -nan(ind)), which
// Python's and other programs' writers leave in such files though JSON has no such numbers, become
// the texts "NaN" and "Infinity": an entry that nobody needs does no harm, see is_not_finite().
// Throws Error that names file, line and column.
nlohmann::json read_lenient_json(const std::filesystem::path& file);

// Whether a value is a number that is not finite, or one of those texts.
bool is_not_finite(const nlohmann::json& value);

}  // namespace nerf::internal
