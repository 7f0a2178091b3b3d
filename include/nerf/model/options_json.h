// Structs of options (base/options.h) as JSON text: an object with one key per field, groups as
// nested objects, null for an optional field without a value.
#pragma once

#include <string>
#include <vector>

#include "nerf/base/options.h"

namespace nerf {

std::string fields_to_json(const std::vector<OptionField>& fields);
void fields_from_json(const std::vector<OptionField>& fields,
                      const std::vector<RetiredOption>& retired, const std::string& json,
                      const std::string& where);

// Indented by two spaces, fields in the visitor's order. Reading it back gives the same bits. Text
// that is not UTF-8 (a path may be) gets U+FFFD in the place of what is not.
template <class T>
std::string options_to_json(const T& options) {
  T copy = options;
  return fields_to_json(option_fields(copy));
}

// Sets the fields that the object names; the others stay. All or nothing: on Error `options` is as
// before. Throws Error naming `where` (the file) and the line and column of what is not JSON, or
// the key that is unknown (with the nearest known one), given twice, of another type, outside its
// limits or retired with a value that changed something, or what check_options of the struct
// refuses.
template <class T>
void options_from_json(T& options, const std::string& json, const std::string& where) {
  T copy = options;
  fields_from_json(option_fields(copy), retired_options(copy), json, where);
  if constexpr (requires { copy.check_options(); }) copy.check_options();
  options = copy;
}

}  // namespace nerf
