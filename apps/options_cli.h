// Command lines from structs of options (base/options.h), through CLI11.
#pragma once

#include <set>
#include <string>
#include <vector>

#include "nerf/base/options.h"

namespace nerf::apps {

// What the help says around the list of options.
struct ProgramText {
  std::string name;         // "nerf_render"
  std::string description;  // one line
  std::string footer;       // longer explanations; where some fields are brief, of --help-all alone
  std::string examples = {};
};

struct CommandLine {
  bool exit = false;            // --help or --version has been answered on stdout: leave with 0
  std::set<std::string> given;  // names of the fields that the user gave
};

// Sets the fields that the command line names. A field "max_steps" is --max-steps VALUE or
// --max-steps=VALUE (-x too where it has a short name), or stands without a name where it is
// positional; a bool "depth" is --depth and --no-depth. --help prints the fields that have a brief
// text, --help-all every one; where none has, --help prints all. Throws Error: an unknown option
// (naming the nearest known one), a missing or surplus value, an option given twice, a required one
// missing, a value that set_option_text refuses.
CommandLine parse_fields(int argc, const char* const* argv, const ProgramText& text,
                         const CollectedOptions& options);

// The same for a struct, and then its check_options.
template <class T>
CommandLine parse_command_line(int argc, const char* const* argv, const ProgramText& text,
                               T& options) {
  CommandLine result = parse_fields(argc, argv, text, collect_options(options));
  if constexpr (requires { options.check_options(); })
    if (!result.exit) options.check_options();
  return result;
}

}  // namespace nerf::apps
