#include "nerf/train/light_recipe.h"

#include <charconv>
#include <optional>

namespace nerf {

namespace {

std::optional<AutoCount> count_from(const std::string& text) {
  if (text == "auto") return AutoCount{};
  if (text == "off") return AutoCount{false, 0};
  int count = 0;
  const char* const end = text.data() + text.size();
  const auto [at, error] = std::from_chars(text.data(), end, count);
  if (error != std::errc() || at != end || count < 0 || count > kMostAppearance)
    return std::nullopt;
  return AutoCount{false, count};
}

std::optional<AutoShare> share_from(const std::string& text) {
  if (text == "auto") return AutoShare{};
  if (text == "off") return AutoShare{false, 0};
  double share = 0;
  const char* const end = text.data() + text.size();
  const auto [at, error] = std::from_chars(text.data(), end, share);
  if (error != std::errc() || at != end || !(share >= 0 && share <= kMostRobust))
    return std::nullopt;
  return AutoShare{false, share};
}

}  // namespace

void OptionTraits<AutoShare>::describe(OptionField& f) {
  f.metavar = "auto|off|X";
  f.problem = [](const OptionValue& value) {
    return share_from(std::get<std::string>(value)) ? ""
                                                    : "expected auto, off or a share up to 0.5";
  };
}

OptionValue OptionTraits<AutoShare>::to_value(const AutoShare& x) {
  if (x.automatic) return std::string("auto");
  if (x.share == 0) return std::string("off");
  char text[32];
  const auto end = std::to_chars(text, text + sizeof(text), x.share).ptr;
  return std::string(text, end);
}

AutoShare OptionTraits<AutoShare>::from_value(const OptionValue& v) {
  return share_from(std::get<std::string>(v)).value_or(AutoShare{});
}

void OptionTraits<AutoCount>::describe(OptionField& f) {
  f.metavar = "auto|off|N";
  f.problem = [](const OptionValue& value) {
    return count_from(std::get<std::string>(value))
               ? std::string()
               : "expected auto, off or a number from 0 to " + std::to_string(kMostAppearance);
  };
}

OptionValue OptionTraits<AutoCount>::to_value(const AutoCount& x) {
  if (x.automatic) return std::string("auto");
  return x.count == 0 ? std::string("off") : std::to_string(x.count);
}

AutoCount OptionTraits<AutoCount>::from_value(const OptionValue& v) {
  return count_from(std::get<std::string>(v)).value_or(AutoCount{});
}

}  // namespace nerf
