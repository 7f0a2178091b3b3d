#include "options_cli.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cctype>
#include <map>

#include "app.h"
#include "nerf/base/nearest_name.h"

namespace nerf::apps {
namespace {

constexpr size_t kNameColumns = 30;
constexpr size_t kTextColumns = 68;

std::string negated(const OptionField& field) { return "--no-" + option_flag(field).substr(2); }

std::string upper(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(), [](unsigned char c) {
    return c == '_' ? '-' : static_cast<char>(std::toupper(c));
  });
  return text;
}

std::string placeholder_of(const OptionField& field) {
  if (!field.metavar.empty()) return field.metavar;
  if (field.positional) return upper(field.name);
  switch (field.type) {
    case OptionType::kInt:
    case OptionType::kUint:
      return "N";
    case OptionType::kNumber:
      return "X";
    case OptionType::kNumbers:
      return "X,...";
    default:
      return field.choices.empty() ? "TEXT" : "NAME";
  }
}

// Line breaks between words; CLI11 indents what follows one.
std::string wrapped(const std::string& text) {
  std::string result;
  size_t line = 0;
  for (size_t i = 0; i < text.size();) {
    const size_t end = std::min(text.find(' ', i), text.size());
    if (line > 0 && line + 1 + (end - i) > kTextColumns) {
      result += '\n';
      line = 0;
    } else if (i > 0) {
      result += ' ';
      ++line;
    }
    result.append(text, i, end - i);
    line += end - i;
    i = end + 1;
  }
  return result;
}

std::string help_of(const OptionField& field) {
  std::string text = field.help;
  const bool ranged = field.type == OptionType::kInt || field.type == OptionType::kUint ||
                      field.type == OptionType::kNumber;
  if (!field.choices.empty() || ranged) {
    OptionField given = field;
    given.optional = false;  // that it may be left out needs no saying here
    text += " (" + option_domain(given) + ")";
  }
  if (field.required && !field.positional) text += " (required)";
  const std::string value = option_text(field);
  if (field.type == OptionType::kBool)
    text += value == "true" ? " [on; " + negated(field) + " turns it off]" : " [off]";
  else if (!field.required && !value.empty() && value != "none")
    text += " [" + value + "]";
  return wrapped(text);
}

bool has_brief(const std::vector<OptionField>& fields) {
  return std::ranges::any_of(fields, [](const OptionField& f) { return !f.brief.empty(); });
}

// Refuses names that no field has, options given twice and options without their value, before
// anything else is looked at: CLI11 would rather complain about a missing argument where a misspelt
// option has swallowed it, and in its own words.
void check_names(int argc, const char* const* argv, const CollectedOptions& options) {
  const std::vector<OptionField>& fields = options.fields;
  struct Known {
    std::string name;
    const OptionField* field = nullptr;
  };
  std::map<std::string, Known> known{
      {"--help", {"--help"}}, {"-h", {"--help"}}, {"--version", {"--version"}}};
  if (has_brief(fields)) known["--help-all"] = {"--help-all"};
  for (const OptionField& field : fields) {
    if (field.positional) continue;
    const std::string flag = option_flag(field);
    known[flag] = {flag, &field};
    if (field.type == OptionType::kBool) known[negated(field)] = {negated(field), &field};
    if (field.short_name) known[std::string{'-', field.short_name}] = {flag, &field};
  }
  std::map<std::string, std::string> seen;  // field and how it was called
  for (int i = 1; i < argc; ++i) {
    const std::string argument = argv[i];
    if (argument == "--") return;
    if (argument.size() < 2 || argument[0] != '-') continue;
    const bool is_long = argument[1] == '-';
    if (!is_long && !std::isalpha(static_cast<unsigned char>(argument[1]))) continue;  // -1.5
    const std::string word = argument.substr(0, argument.find('='));
    const std::string name = is_long ? word : argument.substr(0, 2);
    const auto found = known.find(name);
    if (found == known.end()) {
      const auto is_retired = [&](const RetiredOption& retired) {
        OptionField was;
        was.name = retired.name;
        return option_flag(was) == name;
      };
      if (std::ranges::any_of(options.retired, is_retired))
        throw Error(name + " is no more", "", "leave it out");
      std::vector<std::string> names;
      for (const auto& [key, value] : known)
        if (key.starts_with("--")) names.push_back(key);
      const auto nearest = nearest_name(is_long ? word : "-" + word, names);
      throw Error("unknown option " + word, "",
                  nearest ? "did you mean " + *nearest + "?" : "--help lists the options");
    }
    const Known& option = found->second;
    if (!option.field) continue;
    const auto [earlier, first] = seen.emplace(option.field->name, option.name);
    if (!first && !option.field->repeatable)
      throw Error(earlier->second == option.name
                      ? option.name + " is given twice"
                      : earlier->second + " and " + option.name + " are both given",
                  "", "remove one of the two");
    if (option.field->type == OptionType::kBool) continue;
    const bool value_inside = is_long ? argument.size() > name.size() : argument.size() > 2;
    if (value_inside) continue;
    if (++i >= argc) throw Error(option.name + " needs a value", "", option_domain(*option.field));
  }
}

// In the short help a field without a brief text is hidden.
void add_field(CLI::App& app, const OptionField& field, bool is_short, CommandLine& result) {
  const std::string help = is_short ? wrapped(field.brief) : help_of(field);
  const std::string flag = option_flag(field);
  const auto note = [&result, name = field.name] { result.given.insert(name); };
  CLI::Option* option = nullptr;
  std::string names = field.positional ? placeholder_of(field) : flag;
  if (field.short_name) names = std::string{'-', field.short_name} + "," + names;
  if (field.type == OptionType::kBool) {
    option = app.add_flag_callback(names, [&field, note] { field.set(true), note(); }, help);
    CLI::Option* off =
        app.add_flag_callback(negated(field), [&field, note] { field.set(false), note(); });
    off->group("");
  } else {
    option = app.add_option_function<std::string>(
        names,
        [&field, note, where = field.positional ? placeholder_of(field) : flag](
            const std::string& text) { set_option_text(field, text, where), note(); },
        help);
    if (field.repeatable) option->join(' ');
    option->option_text(field.positional ? " " : placeholder_of(field));
  }
  option->required(field.required);
  if (is_short && field.brief.empty())
    option->group("");
  else if (!field.heading.empty())
    option->group(field.heading);
}

}  // namespace

CommandLine parse_fields(int argc, const char* const* argv, const ProgramText& text,
                         const CollectedOptions& options) {
  const std::vector<OptionField>& fields = options.fields;
  check_names(argc, argv, options);
  CommandLine result;
  CLI::App app(text.description, text.name);
  app.get_formatter()->column_width(kNameColumns);
  const bool is_short =
      has_brief(fields) && std::none_of(argv, argv + argc, [](const std::string& argument) {
        return argument == "--help-all";
      });
  app.footer(is_short                ? text.examples
             : text.examples.empty() ? text.footer
                                     : text.footer + "\n\n" + text.examples);
  app.set_help_flag(is_short ? "-h,--help" : "-h,--help,--help-all", "print this and leave");
  if (is_short) app.add_flag_callback("--help-all", [] {}, "print every option and leave");
  app.set_version_flag("--version", version_text(text.name), "print the version and leave");
  for (const OptionField& field : fields) add_field(app, field, is_short, result);
  try {
    app.parse(argc, argv);
  } catch (const CLI::Success& request) {  // --help, --version
    app.exit(request);
    result.exit = true;
    return result;
  } catch (const CLI::RequiredError&) {  // said below, in terms of the fields
  } catch (const CLI::ParseError& error) {
    std::string what = error.what();
    std::replace(what.begin(), what.end(), '\n', ' ');
    throw Error(what, "", text.name + " --help lists the options");
  }
  for (const OptionField& field : fields)
    if (field.required && !result.given.contains(field.name))
      throw Error((field.positional ? placeholder_of(field) : option_flag(field)) + " is missing",
                  "", field.help);
  return result;
}

}  // namespace nerf::apps
