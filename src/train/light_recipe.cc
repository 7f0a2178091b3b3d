#include "nerf/train/light_recipe.h"

#include <charconv>
#include <optional>

#include "nerf/base/text.h"

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

template <class Limit>
std::optional<AutoNumber<Limit>> number_from(const std::string& text) {
  if (text == "auto") return AutoNumber<Limit>{};
  if (text == "off") return AutoNumber<Limit>{false, 0};
  const auto number = number_in(text, 0, Limit::kMost);
  if (!number) return std::nullopt;
  return AutoNumber<Limit>{false, *number};
}

}  // namespace

template <class Limit>
void OptionTraits<AutoNumber<Limit>>::describe(OptionField& f) {
  f.metavar = "auto|off|X";
  f.problem = [](const OptionValue& value) {
    return number_from<Limit>(std::get<std::string>(value)) ? "" : Limit::kExpected;
  };
}

template <class Limit>
OptionValue OptionTraits<AutoNumber<Limit>>::to_value(const AutoNumber<Limit>& x) {
  if (x.automatic) return std::string("auto");
  if (x.number == 0) return std::string("off");
  char text[32];
  const auto end = std::to_chars(text, text + sizeof(text), x.number).ptr;
  return std::string(text, end);
}

template <class Limit>
AutoNumber<Limit> OptionTraits<AutoNumber<Limit>>::from_value(const OptionValue& v) {
  return number_from<Limit>(std::get<std::string>(v)).value_or(AutoNumber<Limit>{});
}

template struct OptionTraits<AutoShare>;
template struct OptionTraits<AutoFactor>;

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
