#include "child_training.h"

#include <sstream>

#include "app.h"
#include "nerf/base/file.h"
#include "nerf/base/process.h"

namespace nerf::apps {

namespace fs = std::filesystem;

std::vector<std::string> training_arguments(const std::filesystem::path& scene, SplitChoice split,
                                            int downscale, uint64_t seed, int threads) {
  std::vector<std::string> out = {scene.string(),
                                  "--split",
                                  split == SplitChoice::kDev ? "dev" : "test",
                                  "--seed",
                                  std::to_string(seed),
                                  "--threads",
                                  std::to_string(threads),
                                  "--eval-every",
                                  "0",
                                  "--checkpoint-every",
                                  "0"};
  if (downscale > 0) out.insert(out.end(), {"--downscale", std::to_string(downscale)});
  return out;
}

TrainCommand training_command(const std::vector<std::string>& arguments) {
  std::vector<const char*> argv{"nerf_train"};
  for (const std::string& a : arguments) argv.push_back(a.c_str());
  TrainCommand command;
  const CommandLine line =
      parse_command_line(static_cast<int>(argv.size()), argv.data(), train_program_text(), command);
  TrainCommand out = with_preset(command, line.given);
  validate_options(out);
  return out;
}

ChildTraining train_in_child(std::vector<std::string> arguments, const fs::path& folder) {
  arguments.insert(arguments.end(), {"-o", folder.string(), "--overwrite"});
  ChildTraining out;
  out.command = "nerf_train";
  for (const std::string& a : arguments) out.command.append(" ").append(shell_quoted(a));

  const fs::path self = fs::read_symlink("/proc/self/exe").parent_path() / "nerf_train";
  arguments.insert(arguments.begin(), fs::exists(self) ? self.string() : "nerf_train");
  run_process_or_throw(arguments);
  std::istringstream lines(read_text_file(folder / "metrics.jsonl"));
  for (std::string line; std::getline(lines, line);) {
    nlohmann::json j = nlohmann::json::parse(line);
    if (j.value("kind", "") == "evaluation")
      out.evaluations.push_back(std::move(j));
    else
      out.last_step = std::move(j);
  }
  out.result = nlohmann::json::parse(read_text_file(folder / "result.json"));
  return out;
}

}  // namespace nerf::apps
