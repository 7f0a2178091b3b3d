#include "io/cameras/colmap_program.h"

#include <algorithm>
#include <charconv>

#include "nerf/base/process.h"

namespace nerf::internal {

namespace {

// Newer versions keep some options under other groups (SiftExtraction, FeatureExtraction). Empty
// where there is no such option.
std::string option_ending_in(const std::string& help, const std::string& ending) {
  for (size_t at = help.find("--"); at != std::string::npos; at = help.find("--", at + 2)) {
    const size_t end = std::min(help.find_first_of(" =\n\r\t", at), help.size());
    const std::string option = help.substr(at, end - at);
    if (option.ends_with("." + ending)) return option;
  }
  return "";
}

ProcessOptions process_options(const Cancel* cancel, const ColmapProgram::OnLine& on_line) {
  ProcessOptions result;
  result.environment = {"QT_QPA_PLATFORM=offscreen"};  // no display is needed
  result.on_line = on_line;
  result.cancel = cancel;
  return result;
}

}  // namespace

ColmapProgram::ColmapProgram(const Cancel* cancel)
    : program_(require_program("colmap", "colmap", "finds the cameras of photos").string()),
      cancel_(cancel) {}

void ColmapProgram::run(const std::string& command, Arguments arguments, const Settings& settings,
                        const OnLine& on_line) const {
  const std::string help = help_of({command, "-h"});
  for (const auto& [name, value] : settings) {
    const std::string option = option_ending_in(help, name);
    if (!option.empty()) arguments.insert(arguments.end(), {option, value});
  }
  arguments.insert(arguments.begin(), {program_, command});
  run_process_or_throw(arguments, process_options(cancel_, on_line),
                       "look at the photos: sharp, well lit, much overlap from one to the next");
}

bool ColmapProgram::has_command(const std::string& command) const {
  std::string help(1, '\n');
  help += help_of({"help"});
  // A line of its own, indented.
  for (size_t at = help.find(command); at != std::string::npos; at = help.find(command, at + 1)) {
    const size_t before = help.find_last_not_of(" \t", at - 1), end = at + command.size();
    if (help[before] == '\n' && (end == help.size() || help[end] == '\n')) return true;
  }
  return false;
}

std::string ColmapProgram::help_of(const Arguments& arguments) const {
  Arguments command = arguments;
  command.insert(command.begin(), program_);
  std::string help;
  run_process(command, process_options(cancel_, [&](std::string_view line) {
                help.append(line.substr(0, line.find_last_not_of(" \t") + 1)) += '\n';
              }));
  return help;
}

std::string_view between(std::string_view line, std::string_view before, std::string_view after) {
  const size_t at = line.find(before);
  if (at == std::string_view::npos) return {};
  line.remove_prefix(at + before.size());
  return line.substr(0, line.find(after));
}

int64_t leading_number(std::string_view text) {
  int64_t value = 0;
  std::from_chars(text.data(), text.data() + text.size(), value);
  return value;
}

}  // namespace nerf::internal
