// Runs a program and tells what it did.
#pragma once

#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <filesystem>
#include <sstream>
#include <string>
#include <vector>

#include "support/temp_folder.h"

namespace nerf::testing_apps {

using test::read_text;
using test::TempFolder;
using test::write_text;

struct ProgramResult {
  int exit_code = -1;  // 128 + signal where one ended it
  std::string out, err;
  // Lines of `err`.
  std::vector<std::string> lines() const {
    std::vector<std::string> all;
    std::istringstream text(err);
    for (std::string line; std::getline(text, line);) all.push_back(line);
    return all;
  }
};

// A started program; its output goes to files. wait() once.
class Program {
 public:
  Program(const std::string& program, const std::vector<std::string>& arguments) {
    pid_ = fork();
    if (pid_ != 0) return;
    std::vector<char*> argv{const_cast<char*>(program.c_str())};
    for (const std::string& a : arguments) argv.push_back(const_cast<char*>(a.c_str()));
    argv.push_back(nullptr);
    const bool ready = std::freopen("/dev/null", "r", stdin) &&
                       std::freopen(out_file().c_str(), "w", stdout) &&
                       std::freopen(err_file().c_str(), "w", stderr);
    if (ready) execv(program.c_str(), argv.data());
    _exit(127);
  }
  pid_t pid() const { return pid_; }
  std::string err_so_far() const { return read_text(err_file()); }
  ProgramResult wait() {
    int status = 0;
    waitpid(pid_, &status, 0);
    ProgramResult result;
    result.exit_code = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
    result.out = read_text(out_file());
    result.err = read_text(err_file());
    return result;
  }

 private:
  std::string out_file() const { return (folder_.path() / "stdout").string(); }
  std::string err_file() const { return (folder_.path() / "stderr").string(); }
  TempFolder folder_;
  pid_t pid_ = -1;
};

inline ProgramResult run_program(const std::string& program,
                                 const std::vector<std::string>& arguments) {
  return Program(program, arguments).wait();
}

// A user's mistake: exit code 2 and one line "program: ..." with all of `parts`, after at most the
// first line that names the machine.
inline void expect_refused(const ProgramResult& result, const std::string& program,
                           const std::vector<std::string>& parts) {
  EXPECT_EQ(result.exit_code, 2) << result.err;
  EXPECT_EQ(result.out, "");
  std::vector<std::string> lines = result.lines();
  if (lines.size() == 2 && lines[0].find("thread") != std::string::npos) lines.erase(lines.begin());
  ASSERT_EQ(lines.size(), 1u) << result.err;
  EXPECT_EQ(lines[0].rfind(program + ": ", 0), 0u) << lines[0];
  for (const std::string& part : parts)
    EXPECT_NE(lines[0].find(part), std::string::npos) << lines[0] << "\nlacks: " << part;
}

}  // namespace nerf::testing_apps
