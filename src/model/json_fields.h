// Reading the JSON headers of files: every access checks presence, type and size, and names the
// file and the field in its Error.
#pragma once

#include <cmath>
#include <cstdint>
#include <limits>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>
#include <vector>

#include "nerf/base/error.h"

namespace nerf::internal {

class JsonFields {
 public:
  // `where`: the file, and the path of the object in it ("model.nerf: header").
  JsonFields(nlohmann::json value, std::string where)
      : value_(std::move(value)), where_(std::move(where)) {
    if (!value_.is_object()) fail("expected an object");
  }
  static JsonFields parse(std::string_view text, const std::string& where) {
    nlohmann::json value = nlohmann::json::parse(text, nullptr, /*allow_exceptions=*/false);
    if (value.is_discarded()) throw Error("is not valid JSON", where);
    return JsonFields(std::move(value), where);
  }

  const std::string& where() const { return where_; }

  bool has(const char* key) const { return value_.contains(key); }
  const nlohmann::json& at(const char* key) const {
    const auto found = value_.find(key);
    if (found == value_.end()) fail("is missing", key);
    return *found;
  }
  JsonFields object(const char* key) const { return {at(key), where_ + ": " + key}; }
  std::vector<JsonFields> objects(const char* key) const {
    const nlohmann::json& list = at(key);
    if (!list.is_array()) fail("expected a list", key);
    std::vector<JsonFields> out;
    for (size_t i = 0; i < list.size(); ++i)
      out.emplace_back(list[i], where_ + ": " + key + "[" + std::to_string(i) + "]");
    return out;
  }
  std::string text(const char* key) const {
    if (!at(key).is_string()) fail("expected a text", key);
    return at(key).get<std::string>();
  }
  std::vector<std::string> texts(const char* key) const {
    const nlohmann::json& list = at(key);
    if (!list.is_array()) fail("expected a list", key);
    std::vector<std::string> out;
    for (const auto& item : list) {
      if (!item.is_string()) fail("expected texts only", key);
      out.push_back(item.get<std::string>());
    }
    return out;
  }
  bool boolean(const char* key) const {
    if (!at(key).is_boolean()) fail("expected true or false", key);
    return at(key).get<bool>();
  }
  int64_t integer(const char* key, int64_t least, int64_t most) const {
    const nlohmann::json& v = at(key);
    const bool fits = v.is_number_unsigned()
                          ? v.get<uint64_t>() <= uint64_t{std::numeric_limits<int64_t>::max()}
                          : v.is_number_integer();
    if (!fits || v.get<int64_t>() < least || v.get<int64_t>() > most)
      fail("expected a whole number from " + std::to_string(least) + " to " + std::to_string(most),
           key);
    return v.get<int64_t>();
  }
  uint64_t unsigned_integer(const char* key) const {
    if (!at(key).is_number_unsigned()) fail("expected a whole number, 0 or more", key);
    return at(key).get<uint64_t>();
  }
  double number(const char* key) const {
    if (!at(key).is_number()) fail("expected a number", key);
    return at(key).get<double>();  // JSON has no way to write what is not finite
  }
  // A list of `count` numbers.
  std::vector<double> numbers(const char* key, size_t count) const {
    const nlohmann::json& list = at(key);
    if (!list.is_array() || list.size() != count)
      fail("expected a list of " + std::to_string(count) + " numbers", key);
    std::vector<double> out;
    for (const auto& item : list) {
      if (!item.is_number()) fail("expected numbers only", key);
      out.push_back(item.get<double>());
    }
    return out;
  }

  [[noreturn]] void fail(const std::string& what, const char* key = "") const {
    throw Error(what, *key ? where_ + ": " + key : where_);
  }

 private:
  nlohmann::json value_;
  std::string where_;
};

}  // namespace nerf::internal
