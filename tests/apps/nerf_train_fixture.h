// What the tests of nerf_train share: a capture, folders and runs of the program.
#pragma once

#include <gtest/gtest.h>

#include <chrono>
#include <nlohmann/json.hpp>
#include <sstream>
#include <thread>

#include "app.h"
#include "blender_scene.h"
#include "run_program.h"
#include "support/tiny_options.h"

namespace nerf::testing_apps {

namespace fs = std::filesystem;
using Arguments = std::vector<std::string>;

// The options of support/tiny_options.h as arguments, and no evaluation but the last.
inline Arguments tiny(Arguments more = {}) {
  TrainOptions options = test::tiny_options(0), usual;
  const auto fields = option_fields(options), defaults = option_fields(usual);
  Arguments a = {"--eval-every", "0"};
  for (size_t i = 0; i < fields.size(); ++i)
    if (option_text(fields[i]) != option_text(defaults[i]))
      a.insert(a.end(), {option_flag(fields[i]), option_text(fields[i])});
  a.insert(a.end(), more.begin(), more.end());
  return a;
}

class NerfTrain : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    capture = new TempFolder;
    test::write_blender_scene(capture->path());
  }
  static void TearDownTestSuite() { delete capture; }

  static std::string scene() { return capture->path().string(); }
  std::string run_folder(const std::string& name = "a run") const {
    return (folder_.path() / name).string();
  }
  static ProgramResult train(const Arguments& arguments) {
    return run_program(NERF_TRAIN_PROGRAM, arguments);
  }
  // A run of so many steps in the folder of that name; its model.
  std::string model_after(const std::string& name, const Arguments& more) {
    Arguments arguments = tiny({scene(), "-o", run_folder(name)});
    arguments.insert(arguments.end(), more.begin(), more.end());
    const ProgramResult result = train(arguments);
    EXPECT_EQ(result.exit_code, 0) << result.err;
    return model(name);
  }
  std::string model(const std::string& name = "a run") const {
    return read_text(fs::path(run_folder(name)) / "model.nerf");
  }
  std::string file(const std::string& name, const std::string& run = "a run") const {
    return read_text(fs::path(run_folder(run)) / name);
  }
  static void expect_line(const ProgramResult& result, const std::string& part) {
    EXPECT_NE(result.err.find(part), std::string::npos) << result.err << "\nlacks: " << part;
  }
  // The steps of the lines of metrics.jsonl.
  std::vector<int> steps_of_metrics() const {
    std::vector<int> steps;
    std::istringstream lines(file("metrics.jsonl"));
    for (std::string line; std::getline(lines, line);) {
      const auto json = nlohmann::json::parse(line, nullptr, false);
      if (json.is_object() && json["kind"] == "step") steps.push_back(json["step"]);
    }
    return steps;
  }
  // The last command that the program printed behind `lead`, to the line's end.
  static std::string printed_command(const ProgramResult& result, const std::string& lead) {
    const size_t at = result.err.rfind(lead + "nerf_train ");
    EXPECT_NE(at, std::string::npos) << result.err;
    if (at == std::string::npos) return "false";
    const size_t begin = at + lead.size();
    return result.err.substr(begin, result.err.find('\n', begin) - begin);
  }
  // Arguments for /bin/sh that make it the command, with this build's programs in PATH.
  static Arguments in_shell(const std::string& command) {
    const std::string programs = fs::path(NERF_TRAIN_PROGRAM).parent_path().string();
    return {"-c", "PATH=" + apps::shell_quoted(programs) + ":$PATH; exec " + command};
  }
  // Waits until the run has a checkpoint and some steps after it.
  void wait_for_checkpoint(const Program& program) const {
    const fs::path checkpoint = fs::path(run_folder()) / "checkpoint.nerf";
    for (int i = 0; i < 3000; ++i) {
      if (fs::exists(checkpoint) && steps_of_metrics().size() > 3) return;
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
    ADD_FAILURE() << "no checkpoint after a minute: " << program.err_so_far();
  }

  TempFolder folder_;
  static inline TempFolder* capture = nullptr;
};

}  // namespace nerf::testing_apps
