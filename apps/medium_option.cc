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
  const std::vector<std::string> known{"sigma",  "backscatter", "colour",
                                       "height", "falloff",     "box"};
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
  expect(numbers, "backscatter", 1, 3);
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
  const auto channels = [](const std::vector<double>& x) {  // one for all, or three
    return Vec3d{x.front(), x[x.size() / 2], x.back()};
  };
  if (const auto* s = all("sigma")) medium.attenuation = channels(*s);
  const auto* b = all("backscatter");
  medium.backscatter = b ? channels(*b) : medium.attenuation;
  if (const auto* c = all("colour")) medium.colour = Vec3d{(*c)[0], (*c)[1], (*c)[2]}.cast<Real>();
  if (const auto* h = all("height")) medium.height = h->front();
  if (const auto* f = all("falloff"))
    medium.falloff = f->front();
  else if (all("height"))
    throw Error("height says where sigma holds, but not how fast the medium thins", kOption,
                "give falloff=L too: above it, each L input units weaken it by a factor of e");
  if (const auto* c = all("box"))
    medium.box = Box3{{(*c)[0], (*c)[1], (*c)[2]}, {(*c)[3], (*c)[4], (*c)[5]}};
  check_medium(medium, kOption);
  return medium;
}

std::string medium_text(const Medium& medium) {
  const auto grey = [](const Vec3d& v) { return v.x == v.y && v.y == v.z; };
  const auto channels = [&](const Vec3d& v) {
    return grey(v) ? fmt::format("{:.6g}", v.x)
                   : fmt::format("{:.6g},{:.6g},{:.6g}", v.x, v.y, v.z);
  };
  const bool one = medium.backscatter == medium.attenuation;
  const Vec3d colour = medium.colour.cast<double>();
  std::string text = one && grey(medium.attenuation) ? "fog" : "water";
  text += ",sigma=" + channels(medium.attenuation);
  if (!one) text += ",backscatter=" + channels(medium.backscatter);
  text += fmt::format(",colour={:.6g},{:.6g},{:.6g}", colour.x, colour.y, colour.z);
  if (medium.falloff)
    text += fmt::format(",height={:.6g},falloff={:.6g}", medium.height, *medium.falloff);
  if (const auto& box = medium.box)
    text += fmt::format(",box={:.6g},{:.6g},{:.6g},{:.6g},{:.6g},{:.6g}", box->min.x, box->min.y,
                        box->min.z, box->max.x, box->max.y, box->max.z);
  return text;
}

}  // namespace nerf::apps
