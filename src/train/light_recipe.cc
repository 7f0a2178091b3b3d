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

// auto, off or a number up to `most`.
template <class Number>
std::optional<Number> number_from(const std::string& text, double most) {
  if (text == "auto") return Number{};
  if (text == "off") return Number{false, 0};
  double number = 0;
  const char* const end = text.data() + text.size();
  const auto [at, error] = std::from_chars(text.data(), end, number);
  if (error != std::errc() || at != end || !(number >= 0 && number <= most)) return std::nullopt;
  return Number{false, number};
}

std::string text_of(bool automatic, double number) {
  if (automatic) return "auto";
  if (number == 0) return "off";
  char text[32];
  const auto end = std::to_chars(text, text + sizeof(text), number).ptr;
  return std::string(text, end);
}

std::optional<AutoShare> share_from(const std::string& text) {
  return number_from<AutoShare>(text, kMostRobust);
}
std::optional<AutoFactor> factor_from(const std::string& text) {
  return number_from<AutoFactor>(text, kMostFactor);
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
  return text_of(x.automatic, x.share);
}

AutoShare OptionTraits<AutoShare>::from_value(const OptionValue& v) {
  return share_from(std::get<std::string>(v)).value_or(AutoShare{});
}

void OptionTraits<AutoFactor>::describe(OptionField& f) {
  f.metavar = "auto|off|X";
  f.problem = [](const OptionValue& value) {
    return factor_from(std::get<std::string>(value)) ? ""
                                                     : "expected auto, off or a factor up to 2";
  };
}

OptionValue OptionTraits<AutoFactor>::to_value(const AutoFactor& x) {
  return text_of(x.automatic, x.factor);
}

AutoFactor OptionTraits<AutoFactor>::from_value(const OptionValue& v) {
  return factor_from(std::get<std::string>(v)).value_or(AutoFactor{});
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
