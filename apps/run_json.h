// Reading of a run's JSON files, whose fields may be missing or of another type.
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "nerf/base/error.h"
#include "nerf/base/file.h"
#include "nerf/base/text.h"

namespace nerf::apps {

// The object in the file. Throws Error: missing, unreadable, no JSON, no object.
inline nlohmann::ordered_json json_of_file(const std::filesystem::path& path) {
  const std::string text = read_text_file(path);
  nlohmann::ordered_json json;
  try {
    json = nlohmann::ordered_json::parse(text);
  } catch (const nlohmann::json::parse_error& error) {
    throw Error("is not JSON", path.string() + ":" + line_and_column(text, error.byte));
  }
  if (!json.is_object()) throw Error("holds no JSON object", path.string());
  return json;
}

inline std::optional<double> number_at(const nlohmann::ordered_json& json, const char* key) {
  if (!json.is_object()) return {};
  const auto found = json.find(key);
  if (found == json.end() || !found->is_number()) return {};
  return found->get<double>();
}

inline std::string text_at(const nlohmann::ordered_json& json, const char* key) {
  if (!json.is_object()) return "";
  const auto found = json.find(key);
  return found != json.end() && found->is_string() ? found->get<std::string>() : "";
}

}  // namespace nerf::apps
