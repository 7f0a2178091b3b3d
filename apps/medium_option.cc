#include "medium_option.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <map>
#include <vector>

#include "nerf/base/error.h"
#include "nerf/base/nearest_name.h"

namespace nerf::apps {
namespace {

constexpr const char* kOption = "--medium";

struct Kind {
  const char* name;
  Vec3d sigma;  // 1 / half the width of the region that the cameras look at
  Vec3 colour;
};
const Kind kKinds[] = {{"fog", {0.4, 0.4, 0.4}, {0.75_r, 0.78_r, 0.8_r}},
                       {"smoke", {1, 1, 1}, {0.2_r, 0.2_r, 0.2_r}},
                       {"water", {0.9, 0.35, 0.3}, {0.05_r, 0.35_r, 0.45_r}}};

std::vector<std::string> parts_of(const std::string& text) {
  std::vector<std::string> parts{""};
  for (const char c : text)
    if (c == ',')
      parts.emplace_back();
    else
      parts.back() += c;
  return parts;
}

double number_of(const std::string& text, const std::string& key) {
  double x = 0;
  const char* const end = text.data() + text.size();
  const auto [at, problem] = std::from_chars(text.data(), end, x);
  if (problem != std::errc() || at != end || !std::isfinite(x))
    throw Error(fmt::format("'{}' is no number for {}", text, key), kOption);
  return x;
}

// What stands behind a key, up to the next one.
using Numbers = std::map<std::string, std::vector<double>>;

Numbers numbers_of(const std::vector<std::string>& parts) {
  const std::vector<std::string> known{"sigma", "colour", "height", "falloff", "box"};
  Numbers numbers;
  std::string key;
  for (size_t i = 1; i < parts.size(); ++i) {
    std::string value = parts[i];
    if (const size_t equals = value.find('='); equals != std::string::npos) {
      key = value.substr(0, equals);
      value = value.substr(equals + 1);
      if (std::find(known.begin(), known.end(), key) == known.end())
        throw Error(fmt::format("a medium has no '{}'", key), kOption,
                    nearest_name_hint(key, known));
      if (numbers.contains(key)) throw Error(fmt::format("{} is given twice", key), kOption);
    } else if (key.empty()) {
      throw Error(fmt::format("'{}' stands behind no key", value), kOption,
                  "give for example fog,sigma=0.2,colour=0.8,0.8,0.8");
    }
    numbers[key].push_back(number_of(value, key));
  }
  return numbers;
}

void expect(const Numbers& numbers, const char* key, size_t one, size_t other) {
  const auto found = numbers.find(key);
  if (found == numbers.end()) return;
  const size_t n = found->second.size();
  if (n == one || n == other) return;
  throw Error(
      fmt::format("{} has {} numbers", key, n), kOption,
      one == other ? fmt::format("give {}", one) : fmt::format("give {} or {}", one, other));
}

}  // namespace

Medium parse_medium(const std::string& text, const ModelInfo& info) {
  const std::vector<std::string> parts = parts_of(text);
  Medium medium;
  if (text == "off") return medium;
  const Kind* kind = nullptr;
  for (const Kind& k : kKinds)
    if (parts.front() == k.name) kind = &k;
  if (!kind)
    throw Error(
        fmt::format("'{}' is no medium", parts.front()), kOption,
        nearest_name_hint(parts.front(), std::vector<std::string>{"fog", "smoke", "water", "off"}));
  const Numbers numbers = numbers_of(parts);
  expect(numbers, "sigma", 1, 3);
  expect(numbers, "colour", 3, 3);
  expect(numbers, "height", 1, 1);
  expect(numbers, "falloff", 1, 1);
  expect(numbers, "box", 6, 6);
  const auto all = [&](const char* key) -> const std::vector<double>* {
    const auto found = numbers.find(key);
    return found == numbers.end() ? nullptr : &found->second;
  };
  medium.attenuation = kind->sigma * info.to_engine.scale;
  medium.colour = kind->colour;
  if (const auto* s = all("sigma"))
    medium.attenuation = {s->front(), (*s)[s->size() / 2], s->back()};
  medium.backscatter = medium.attenuation;
  if (const auto* c = all("colour")) medium.colour = Vec3d{(*c)[0], (*c)[1], (*c)[2]}.cast<Real>();
  if (const auto* h = all("height")) medium.height = h->front();
  if (const auto* f = all("falloff"))
    medium.falloff = f->front();
  else if (all("height"))
    throw Error("height says where sigma holds, but not how fast the medium thins", kOption,
                "give falloff=L too: above it, each L input units weaken it by a factor of e");
  if (const auto* b = all("box"))
    medium.box = Box3{{(*b)[0], (*b)[1], (*b)[2]}, {(*b)[3], (*b)[4], (*b)[5]}};
  check_medium(medium, kOption);
  return medium;
}

}  // namespace nerf::apps
