// The installed colmap, of whatever version: its commands and options are found by its own help.
#pragma once

#include <functional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "nerf/base/cancel.h"

namespace nerf::internal {

class ColmapProgram {
 public:
  using Arguments = std::vector<std::string>;
  using Settings = std::vector<std::pair<std::string, std::string>>;
  using OnLine = std::function<void(std::string_view)>;

  // Throws Error with the command that installs it.
  explicit ColmapProgram(const Cancel* cancel);

  // Adds --<Group>.<name> value for every setting whose option this command has, in whatever group
  // its version keeps it. Throws Error where colmap fails, Cancelled.
  void run(const std::string& command, Arguments arguments, const Settings& settings,
           const OnLine& on_line) const;

  bool has_command(const std::string& command) const;

 private:
  std::string help_of(const Arguments& arguments) const;

  std::string program_;
  const Cancel* cancel_;
};

// What stands between `before` and the next `after`; empty where the line has no `before`.
std::string_view between(std::string_view line, std::string_view before, std::string_view after);

// The number that a text begins with, 0 where there is none.
int64_t leading_number(std::string_view text);

}  // namespace nerf::internal
