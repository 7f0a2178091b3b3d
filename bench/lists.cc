#include "lists.h"

#include <fmt/format.h>

#include <charconv>
#include <cmath>
#include <cstdlib>
#include <limits>

#include "nerf/base/error.h"

namespace nerf::apps {

std::vector<std::string> parts_of(const std::string& list) {
  std::vector<std::string> parts(1);
  for (const char c : list) {
    if (c == ',')
      parts.emplace_back();
    else
      parts.back() += c;
  }
  return parts;
}

std::vector<double> positive_numbers(const std::string& list, const std::string& flag,
                                     const std::string& example) {
  std::vector<double> out;
  for (const std::string& part : parts_of(list)) {
    char* end = nullptr;
    const double value = std::strtod(part.c_str(), &end);
    if (part.empty() || *end || !(value > 0) || !std::isfinite(value))
      throw Error("'" + part + "' is not a number above 0", flag, "for example " + example);
    out.push_back(value);
  }
  return out;
}

std::vector<uint64_t> whole_numbers(const std::string& list, uint64_t low, uint64_t high,
                                    const std::string& flag, const std::string& example) {
  std::vector<uint64_t> out;
  for (const std::string& part : parts_of(list)) {
    uint64_t value = 0;
    const char* end = part.data() + part.size();
    const auto [stop, code] = std::from_chars(part.data(), end, value);
    if (code != std::errc() || stop != end || value < low || value > high) {
      const bool open = high == std::numeric_limits<uint64_t>::max();
      throw Error(fmt::format("'{}' is not a whole number from {}{}", part, low,
                              open ? "" : fmt::format(" to {}", high)),
                  flag, "for example " + example);
    }
    out.push_back(value);
  }
  return out;
}

}  // namespace nerf::apps
