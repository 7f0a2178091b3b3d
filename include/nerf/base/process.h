// Child programs: found in PATH, started without a shell, their output read as it comes.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "nerf/base/cancel.h"

namespace nerf {

// The executable file that a shell would start for `name`: searched in PATH, or itself where it has
// a slash. No value where there is none.
std::optional<std::filesystem::path> find_program(const std::string& name);

// find_program, or an Error that names the Debian package to install.
std::filesystem::path require_program(const std::string& name, const std::string& package,
                                      const std::string& purpose);

struct ProcessOptions {
  std::vector<std::string> environment;  // "NAME=value", added to this process's own
  std::filesystem::path folder;          // where it runs; empty: where this process does
  // Each line of standard output and standard error, without its end ('\n' or '\r').
  std::function<void(std::string_view line)> on_line;
  // If set, standard output comes here in pieces as it is, and on_line gets standard error only.
  std::function<void(std::span<const uint8_t> bytes)> on_output;
  const Cancel* cancel = nullptr;
};

struct ProcessResult {
  int exit_code = -1;      // -1 where a signal ended it
  int signal = 0;          // the signal that ended it, 0 where it left by itself
  std::string last_lines;  // the last few lines of output, joined by " | "

  bool good() const { return exit_code == 0; }
};

// Runs command[0] (a path, or a name searched in PATH) with the arguments that follow and waits for
// its end. Its standard input is empty. Throws Error if it cannot be started, Cancelled after
// cancel->request() or if it died of the SIGINT that a terminal sends to both. Whatever is thrown,
// also by the callbacks: the child has ended then (SIGTERM, 3 s later SIGKILL).
ProcessResult run_process(const std::vector<std::string>& command,
                          const ProcessOptions& options = {});

// The same; an ending other than exit code 0 is an Error that says what the program said last.
ProcessResult run_process_or_throw(const std::vector<std::string>& command,
                                   const ProcessOptions& options = {},
                                   const std::string& hint = "");

}  // namespace nerf
