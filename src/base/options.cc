#include "nerf/base/options.h"

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>
#include <string_view>

#include "nerf/base/nearest_name.h"

namespace nerf {
namespace {

// Fewest digits that read back as the same number. to_chars without a precision needs at most 24
// characters for a double and 15 for a float.
template <class T>
std::string shortest(T x) {
  char text[32];
  const auto end = std::to_chars(text, text + sizeof(text), x).ptr;
  return std::string(text, end);
}

template <class T>
std::optional<T> parse_number(std::string_view text) {
  if (!text.empty() && text.front() == '+') text.remove_prefix(1);
  T x{};
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), x);
  if (error != std::errc() || end != text.data() + text.size()) return std::nullopt;
  return x;
}

std::optional<bool> parse_bool(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  if (text == "true" || text == "on" || text == "yes" || text == "1") return true;
  if (text == "false" || text == "off" || text == "no" || text == "0") return false;
  return std::nullopt;
}

std::optional<std::vector<double>> parse_numbers(std::string_view text) {
  std::vector<double> numbers;
  while (true) {
    const size_t comma = text.find(',');
    std::string_view item = text.substr(0, comma);
    while (!item.empty() && item.front() == ' ') item.remove_prefix(1);
    while (!item.empty() && item.back() == ' ') item.remove_suffix(1);
    const auto x = parse_number<double>(item);
    if (!x) return std::nullopt;
    numbers.push_back(*x);
    if (comma == std::string_view::npos) return numbers;
    text.remove_prefix(comma + 1);
  }
}

std::string value_text(const OptionValue& value) {
  struct Text {
    std::string operator()(bool x) const { return x ? "true" : "false"; }
    std::string operator()(int64_t x) const { return std::to_string(x); }
    std::string operator()(uint64_t x) const { return std::to_string(x); }
    std::string operator()(double x) const { return shortest(x); }
    std::string operator()(const std::string& x) const { return x; }
    std::string operator()(const std::vector<double>& x) const {
      std::string text;
      for (const double number : x) {
        if (!text.empty()) text += ',';
        text += shortest(number);
      }
      return text;
    }
  };
  return std::visit(Text{}, value);
}

std::string quoted(const std::string& text) {
  constexpr size_t kShown = 60;
  return "'" + (text.size() > kShown ? text.substr(0, kShown) + "..." : text) + "'";
}

// The value as the alternative of `type`; empty where that would change it.
std::optional<OptionValue> converted(const OptionValue& value, OptionType type) {
  if (value.index() == static_cast<size_t>(type)) return value;
  const auto* as_int = std::get_if<int64_t>(&value);
  const auto* as_uint = std::get_if<uint64_t>(&value);
  const auto* as_double = std::get_if<double>(&value);
  constexpr double kExact = 9007199254740992.0;  // 2^53: every integer up to it is a double
  if (type == OptionType::kNumber) {
    if (as_int) return static_cast<double>(*as_int);
    if (as_uint) return static_cast<double>(*as_uint);
  } else if (type == OptionType::kInt) {
    if (as_uint && *as_uint <= uint64_t{INT64_MAX}) return static_cast<int64_t>(*as_uint);
    if (as_double && std::abs(*as_double) <= kExact && std::trunc(*as_double) == *as_double)
      return static_cast<int64_t>(*as_double);
  } else if (type == OptionType::kUint) {
    if (as_int && *as_int >= 0) return static_cast<uint64_t>(*as_int);
    if (as_double && *as_double >= 0 && *as_double <= kExact &&
        std::trunc(*as_double) == *as_double)
      return static_cast<uint64_t>(*as_double);
  }
  return std::nullopt;
}

bool within_limits(const OptionField& f, double x) {
  return std::isfinite(x) && (f.min_open ? x > f.min : x >= f.min) &&
         (f.max_open ? x < f.max : x <= f.max);
}

bool within_limits(const OptionField& f, const OptionValue& value) {
  switch (f.type) {
    case OptionType::kInt:
      return within_limits(f, static_cast<double>(std::get<int64_t>(value)));
    case OptionType::kUint:
      return within_limits(f, static_cast<double>(std::get<uint64_t>(value)));
    case OptionType::kNumber:
      return within_limits(f, std::get<double>(value));
    case OptionType::kNumbers: {
      const auto& numbers = std::get<std::vector<double>>(value);
      return std::all_of(numbers.begin(), numbers.end(),
                         [&](double x) { return within_limits(f, x); });
    }
    default:
      return true;
  }
}

[[noreturn]] void refuse(const OptionField& field, const std::string& got,
                         const std::string& where) {
  std::string hint = "allowed: " + option_domain(field);
  if (!field.choices.empty())
    if (const auto name = nearest_name(got, field.choices))
      hint = "did you mean " + *name + "? " + hint;
  throw Error(quoted(got) + " is not allowed", where, hint);
}

std::string limits_text(const OptionField& f) {
  // 100000 rather than 1e+05.
  const auto number = [](double x) {
    const bool whole = std::abs(x) < 1e15 && std::trunc(x) == x;
    return whole ? std::to_string(static_cast<int64_t>(x)) : shortest(x);
  };
  // The natural limits of a type are no news to a reader.
  const bool low = f.min > -2147483648.0;
  const bool high = f.max < 2147483647.0;
  if (low && high && !f.min_open && !f.max_open)
    return ", " + number(f.min) + " to " + number(f.max);
  std::string text;
  if (low) text += (f.min_open ? ", above " : ", at least ") + number(f.min);
  if (high) text += (f.max_open ? ", below " : ", at most ") + number(f.max);
  return text;
}

}  // namespace

double internal::short_double(float x) {
  if (!std::isfinite(x)) return static_cast<double>(x);
  const std::string text = shortest(x);
  const double wide = parse_number<double>(text).value_or(static_cast<double>(x));
  return static_cast<float>(wide) == x ? wide : static_cast<double>(x);
}

void set_option(const OptionField& field, const std::optional<OptionValue>& value,
                const std::string& where) {
  if (!value) {
    if (!field.optional) refuse(field, "null", where);
    field.set(std::nullopt);
    return;
  }
  const auto fitting = converted(*value, field.type);
  if (!fitting || !within_limits(field, *fitting)) refuse(field, value_text(*value), where);
  if (const auto* numbers = std::get_if<std::vector<double>>(&*fitting))
    if (static_cast<int>(numbers->size()) != field.count) refuse(field, value_text(*value), where);
  if (const auto* text = std::get_if<std::string>(&*fitting))
    if (!field.choices.empty() &&
        std::find(field.choices.begin(), field.choices.end(), *text) == field.choices.end())
      refuse(field, *text, where);
  if (field.problem) {
    const std::string problem = field.problem(*fitting);
    if (!problem.empty())
      throw Error(quoted(value_text(*fitting)) + " is not allowed", where, problem);
  }
  field.set(fitting);
}

void set_option_text(const OptionField& field, const std::string& text, const std::string& where) {
  if (field.optional && field.type != OptionType::kText && text == "none") {
    field.set(std::nullopt);
    return;
  }
  const auto set_parsed = [&](const auto& parsed) {
    if (!parsed) refuse(field, text, where);
    set_option(field, std::optional<OptionValue>(std::in_place, *parsed), where);
  };
  switch (field.type) {
    case OptionType::kBool:
      return set_parsed(parse_bool(text));
    case OptionType::kInt:
      return set_parsed(parse_number<int64_t>(text));
    case OptionType::kUint:
      return set_parsed(parse_number<uint64_t>(text));
    case OptionType::kNumber:
      return set_parsed(parse_number<double>(text));
    case OptionType::kNumbers:
      return set_parsed(parse_numbers(text));
    case OptionType::kText:
      return set_option(field, OptionValue(text), where);
  }
}

std::string option_text(const OptionField& field) {
  const auto value = field.get();
  return value ? value_text(*value) : "none";
}

std::string option_domain(const OptionField& f) {
  std::string text;
  switch (f.type) {
    case OptionType::kBool:
      text = "true or false";
      break;
    case OptionType::kInt:
    case OptionType::kUint:
      text = "an integer" + limits_text(f);
      break;
    case OptionType::kNumber:
      text = "a number" + limits_text(f);
      break;
    case OptionType::kNumbers:
      text = std::to_string(f.count) + " numbers joined by commas" + limits_text(f);
      break;
    case OptionType::kText:
      if (f.choices.empty()) return "text";
      for (const std::string& choice : f.choices) text += (text.empty() ? "" : ", ") + choice;
      break;
  }
  return text + (f.optional && f.type != OptionType::kText ? ", or none" : "");
}

std::string option_flag(const OptionField& field) {
  std::string flag = "--" + field.name;
  std::replace_if(flag.begin(), flag.end(), [](char c) { return c == '_' || c == '.'; }, '-');
  return flag;
}

void validate_fields(const std::vector<OptionField>& fields, const std::string& where) {
  for (const OptionField& field : fields)
    set_option(field, field.get(), where.empty() ? field.name : where + ": " + field.name);
}

std::string fields_text(const std::vector<OptionField>& fields) {
  std::string text;
  for (const OptionField& field : fields) text += field.name + " = " + option_text(field) + "\n";
  return text;
}

}  // namespace nerf
