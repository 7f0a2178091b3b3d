// Options once: a plain struct whose visitor gives each field's name, help and limits. From it come
// defaults, help, command line (apps/options_cli.h), JSON (model/options_json.h), printing and
// validation. Example:
//
//   enum class Space { kIdentity, kContract };
//   inline auto option_names(Space) {  // found by its argument's namespace
//     return std::array{OptionName{Space::kIdentity, "identity"},
//                       OptionName{Space::kContract, "contract"}};
//   }
//   struct MarchOptions {
//     int steps = 1024;
//     Space space = Space::kIdentity;
//     std::optional<double> near;
//     template <class V>
//     void visit_options(V& v) {
//       v("steps", steps, "samples along the longest ray", at_least(1), at_most(65536));
//       v("space", space, "warp of space before encoding");
//       v("near", near, "no sample closer to a camera than this, input units", above(0));
//     }
//     void check_options() const {}  // optional: throws Error for combinations that cannot be
//   };
//
// Names are snake_case. A field may be another such struct: v("march", march, "...") makes its
// fields "march.steps", ..., an object "march" in JSON and --march-steps on the command line;
// march.visit_options(v) instead takes its fields in without a prefix. Field types: bool, integers,
// float, double, std::string, std::filesystem::path, enums with option_names, types with an
// OptionTraits of their own (math/option_types.h has vectors and boxes), and std::optional of
// these.
#pragma once

#include <array>
#include <concepts>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <type_traits>
#include <utility>
#include <variant>
#include <vector>

#include "nerf/base/error.h"

namespace nerf {

// What every field's value is turned into and set from.
using OptionValue = std::variant<bool, int64_t, uint64_t, double, std::string, std::vector<double>>;

enum class OptionType { kBool, kInt, kUint, kNumber, kText, kNumbers };  // alternatives in order

// One field of a struct of options: description and access. Refers to the struct it came from.
struct OptionField {
  std::string name;  // groups joined by '.'
  std::string help;
  OptionType type = OptionType::kBool;
  bool optional = false;                                  // may have no value
  double min = -std::numeric_limits<double>::infinity();  // numbers: inclusive unless open below
  double max = std::numeric_limits<double>::infinity();
  bool min_open = false, max_open = false;
  int count = 0;                     // kNumbers: how many
  std::vector<std::string> choices;  // kText: nothing else is allowed, where not empty
  // What else must hold of a value, after type, limits and choices: empty text, or what is wrong.
  std::function<std::string(const OptionValue&)> problem;

  // For the command line only.
  char short_name = 0;      // 'o' for -o
  std::string metavar;      // of the value in the help; empty: from the type
  bool positional = false;  // also given without its name
  bool required = false;    // must be given
  bool repeatable = false;  // kText: may be given several times; a space stands between the texts
  std::string heading;      // of the help that the field stands under
  std::string brief;        // the help of those who only begin; empty: the field is not in it

  // Of a program that goes on with what an earlier one began: whether the field belongs to the
  // result, and must stay, and whether its value is taken over where none is given.
  bool of_result = true, inherited = true;

  std::function<std::optional<OptionValue>()> get;             // no value: an empty optional
  std::function<void(const std::optional<OptionValue>&)> set;  // unchecked; use set_option
};

// An option that is no more. Files of earlier versions that name it are read where its value
// changes nothing.
struct RetiredOption {
  std::string name;  // groups joined by '.'
  OptionValue harmless;
};

template <class E>
struct OptionName {
  E value;
  const char* name;
};
template <class E>
OptionName(E, const char*) -> OptionName<E>;

// Limits and command-line attributes, the arguments after a field's help.
inline auto at_least(double low) {
  return [low](OptionField& f) { f.min = low, f.min_open = false; };
}
inline auto at_most(double high) {
  return [high](OptionField& f) { f.max = high, f.max_open = false; };
}
inline auto above(double low) {
  return [low](OptionField& f) { f.min = low, f.min_open = true; };
}
inline auto below(double high) {
  return [high](OptionField& f) { f.max = high, f.max_open = true; };
}
inline auto one_of(std::vector<std::string> choices) {
  return [choices = std::move(choices)](OptionField& f) { f.choices = choices; };
}
inline auto check_value(std::function<std::string(const OptionValue&)> problem) {
  return [problem = std::move(problem)](OptionField& f) { f.problem = problem; };
}
inline auto short_name(char letter) {
  return [letter](OptionField& f) { f.short_name = letter; };
}
inline auto metavar(std::string text) {
  return [text = std::move(text)](OptionField& f) { f.metavar = text; };
}
inline auto positional() {
  return [](OptionField& f) { f.positional = true; };
}
inline auto required() {
  return [](OptionField& f) { f.required = true; };
}

inline auto repeatable() {
  return [](OptionField& f) { f.repeatable = true; };
}

// Lists the field in the short help too, with this text.
inline auto brief(std::string text) {
  return [text = std::move(text)](OptionField& f) { f.brief = text; };
}
// The result does not depend on the field.
inline auto not_of_result() {
  return [](OptionField& f) { f.of_result = false; };
}
// Nor does a later program take its value over.
inline auto of_this_call() {
  return [](OptionField& f) { f.of_result = f.inherited = false; };
}

// How a type becomes an OptionValue and back: `kType`, `describe(field)` (natural limits),
// `to_value(x)` and `from_value(value)`; from_value gets the alternative of kType, within the
// field's limits. Specialise for a type of your own.
template <class T>
struct OptionTraits;

template <>
struct OptionTraits<bool> {
  static constexpr OptionType kType = OptionType::kBool;
  static void describe(OptionField&) {}
  static OptionValue to_value(bool x) { return x; }
  static bool from_value(const OptionValue& v) { return std::get<bool>(v); }
};

template <std::signed_integral T>
struct OptionTraits<T> {
  static constexpr OptionType kType = OptionType::kInt;
  static void describe(OptionField& f) {
    if (sizeof(T) == sizeof(int64_t)) return;  // the value itself cannot hold more
    f.min = static_cast<double>(std::numeric_limits<T>::min());
    f.max = static_cast<double>(std::numeric_limits<T>::max());
  }
  static OptionValue to_value(T x) { return static_cast<int64_t>(x); }
  static T from_value(const OptionValue& v) { return static_cast<T>(std::get<int64_t>(v)); }
};

template <std::unsigned_integral T>
struct OptionTraits<T> {
  static constexpr OptionType kType = OptionType::kUint;
  static void describe(OptionField& f) {
    f.min = 0;
    if (sizeof(T) < sizeof(uint64_t)) f.max = static_cast<double>(std::numeric_limits<T>::max());
  }
  static OptionValue to_value(T x) { return static_cast<uint64_t>(x); }
  static T from_value(const OptionValue& v) { return static_cast<T>(std::get<uint64_t>(v)); }
};

namespace internal {
// The double that prints as short as the float does (0.1f as 0.1) and converts back to it.
double short_double(float x);
}  // namespace internal

template <std::floating_point T>
struct OptionTraits<T> {
  static constexpr OptionType kType = OptionType::kNumber;
  static void describe(OptionField& f) {
    if (!std::is_same_v<T, float>) return;
    f.min = -static_cast<double>(std::numeric_limits<float>::max());
    f.max = static_cast<double>(std::numeric_limits<float>::max());
  }
  static OptionValue to_value(T x) {
    if constexpr (std::is_same_v<T, float>)
      return internal::short_double(x);
    else
      return static_cast<double>(x);
  }
  static T from_value(const OptionValue& v) { return static_cast<T>(std::get<double>(v)); }
};

template <>
struct OptionTraits<std::string> {
  static constexpr OptionType kType = OptionType::kText;
  static void describe(OptionField&) {}
  static OptionValue to_value(const std::string& x) { return x; }
  static std::string from_value(const OptionValue& v) { return std::get<std::string>(v); }
};

template <>
struct OptionTraits<std::filesystem::path> {
  static constexpr OptionType kType = OptionType::kText;
  static void describe(OptionField& f) { f.metavar = "PATH"; }
  static OptionValue to_value(const std::filesystem::path& x) { return x.string(); }
  static std::filesystem::path from_value(const OptionValue& v) { return std::get<std::string>(v); }
};

template <class E>
  requires std::is_enum_v<E>
struct OptionTraits<E> {
  static constexpr OptionType kType = OptionType::kText;
  static void describe(OptionField& f) {
    for (const auto& entry : option_names(E{})) f.choices.emplace_back(entry.name);
  }
  static OptionValue to_value(E x) {
    for (const auto& entry : option_names(E{}))
      if (entry.value == x) return std::string(entry.name);
    throw std::logic_error("an enum's value is missing in its option_names");
  }
  static E from_value(const OptionValue& v) {
    for (const auto& entry : option_names(E{}))
      if (std::get<std::string>(v) == entry.name) return entry.value;
    throw std::logic_error("set() called with a name that is not in option_names");
  }
};

// Collects the fields of a struct; the `v` of visit_options.
class OptionCollector {
 public:
  OptionCollector(std::vector<OptionField>& out, std::vector<RetiredOption>& retired,
                  std::string prefix = "")
      : out_(out), retired_(retired), prefix_(std::move(prefix)) {}

  // Of the help, for the fields that follow. Those of a group stand under its help.
  void heading(const char* text) { heading_ = text; }

  void retired(const char* name, OptionValue harmless) {
    retired_.push_back({prefix_ + name, std::move(harmless)});
  }

  // Not inlined: a struct of options has dozens of fields and a few kinds of them.
  template <class T, class... Attributes>
  [[gnu::noinline]] void operator()(const char* name, T& field, const char* help,
                                    const Attributes&... attributes) {
    if constexpr (requires(T& t, OptionCollector& c) { t.visit_options(c); }) {
      static_assert(sizeof...(attributes) == 0, "attributes belong to the fields of a group");
      OptionCollector group(out_, retired_, prefix_ + name + ".");
      group.heading(prefix_.empty() ? help : heading_.c_str());
      field.visit_options(group);
    } else {
      OptionField f;
      f.name = prefix_ + name;
      f.help = help;
      f.heading = heading_;
      bind(f, field);
      (attributes(f), ...);
      out_.push_back(std::move(f));
    }
  }

 private:
  template <class T>
  static void bind(OptionField& f, T& field) {
    describe<T>(f);
    f.get = [&field] { return std::optional<OptionValue>(OptionTraits<T>::to_value(field)); };
    f.set = [&field](const std::optional<OptionValue>& value) {
      field = OptionTraits<T>::from_value(value.value());
    };
  }
  template <class T>
  static void bind(OptionField& f, std::optional<T>& field) {
    describe<T>(f);
    f.optional = true;
    f.get = [&field] {
      return field ? std::optional<OptionValue>(OptionTraits<T>::to_value(*field)) : std::nullopt;
    };
    f.set = [&field](const std::optional<OptionValue>& value) {
      if (value)
        field = OptionTraits<T>::from_value(*value);
      else
        field.reset();
    };
  }
  template <class T>
  static void describe(OptionField& f) {
    f.type = OptionTraits<T>::kType;
    OptionTraits<T>::describe(f);
  }

  std::vector<OptionField>& out_;
  std::vector<RetiredOption>& retired_;
  std::string prefix_, heading_;
};

// What a struct's visitor tells. The fields refer to the struct.
struct CollectedOptions {
  std::vector<OptionField> fields;  // in the order of the visitor
  std::vector<RetiredOption> retired;
};

// A large struct's header declares this as an extern template, since it takes seconds to compile.
template <class T>
CollectedOptions collect_options(T& options) {
  CollectedOptions collected;
  OptionCollector collector(collected.fields, collected.retired);
  options.visit_options(collector);
  return collected;
}

template <class T>
std::vector<OptionField> option_fields(T& options) {
  return collect_options(options).fields;
}
template <class T>
std::vector<RetiredOption> retired_options(T& options) {
  return collect_options(options).retired;
}

// Sets a field after checking it. Throws Error(what is wrong, where, what is allowed) for a value
// of another type, outside the limits, not finite or not among the choices; the field is then as
// before. Integers are taken for numbers, and numbers without a fraction for integers.
void set_option(const OptionField& field, const std::optional<OptionValue>& value,
                const std::string& where);

// The same from text: "12", "0.5", "true|false|on|off|yes|no|1|0", a name, "1,2,3"; "none" for an
// optional field's empty value unless it is a text.
void set_option_text(const OptionField& field, const std::string& text, const std::string& where);

// The field's value as set_option_text reads it; "none" where empty. Numbers in the fewest digits
// that give the same bits back.
std::string option_text(const OptionField& field);

// What is allowed, for help and hints: "integer, 1 to 64", "one of auto, f32, bf16".
std::string option_domain(const OptionField& field);

// Name on the command line: "march.max_steps" is "--march-max-steps".
std::string option_flag(const OptionField& field);

// Checks every field's value, as set_option would.
void validate_fields(const std::vector<OptionField>& fields, const std::string& where);

// "name = value" lines.
std::string fields_text(const std::vector<OptionField>& fields);

// Throws Error for the first field outside its limits and for what check_options of the struct
// refuses. `where` precedes the field's name in the message.
template <class T>
void validate_options(const T& options, const std::string& where = "options") {
  T copy = options;
  validate_fields(option_fields(copy), where);
  if constexpr (requires { copy.check_options(); }) copy.check_options();
}

template <class T>
std::string options_text(const T& options) {
  T copy = options;
  return fields_text(option_fields(copy));
}

}  // namespace nerf
