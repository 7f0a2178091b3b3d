#include "nerf/base/process.h"

#include <gtest/gtest.h>
#include <signal.h>
#include <stdlib.h>
#include <sys/stat.h>

#include <chrono>
#include <fstream>
#include <thread>

#include "nerf/base/error.h"
#include "support/temp_folder.h"

namespace nerf {
namespace {

using test::contains;
using test::error_of;
using test::TempFolder;

std::vector<std::string> lines_of(const std::vector<std::string>& command,
                                  ProcessOptions options = {}) {
  std::vector<std::string> lines;
  options.on_line = [&](std::string_view line) { lines.emplace_back(line); };
  run_process_or_throw(command, options);
  return lines;
}

double seconds_of(const std::function<void()>& body) {
  const auto start = std::chrono::steady_clock::now();
  body();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

TEST(Process, GivesLinesOfBothStreams) {
  const auto lines = lines_of({"sh", "-c", "printf 'one\\ntwo\\rthree\\n\\n'; echo four >&2"});
  EXPECT_EQ(lines, (std::vector<std::string>{"one", "two", "three", "four"}));
}

TEST(Process, LastLineNeedsNoEnd) {
  EXPECT_EQ(lines_of({"printf", "no end"}), (std::vector<std::string>{"no end"}));
}

TEST(Process, ArgumentsAreNotSeenByAShell) {
  const std::string text = "a b; $(echo c) 'd' \"e\" *";
  EXPECT_EQ(lines_of({"printf", "%s\\n", text, ""}), (std::vector<std::string>{text}));
}

TEST(Process, InputIsEmpty) { EXPECT_TRUE(lines_of({"cat"}).empty()); }

TEST(Process, EnvironmentIsAddedAndReplaced) {
  ::setenv("NERF_TEST_A", "old", 1);
  ::setenv("NERF_TEST_AB", "stays", 1);
  ProcessOptions options;
  options.environment = {"NERF_TEST_A=new"};
  EXPECT_EQ(lines_of({"sh", "-c", "echo $NERF_TEST_A $NERF_TEST_AB ${PATH:+path}"}, options),
            (std::vector<std::string>{"new stays path"}));
}

TEST(Process, RunsInAFolder) {
  const TempFolder folder;
  ProcessOptions options;
  options.folder = folder.path();
  EXPECT_EQ(lines_of({"pwd"}, options), (std::vector<std::string>{folder.path().string()}));
  options.folder = folder / "none";
  EXPECT_THROW(run_process({"pwd"}, options), Error);
}

TEST(Process, OutputAsBytesAndErrorsAsLines) {
  std::vector<uint8_t> bytes;
  std::vector<std::string> lines;
  ProcessOptions options;
  options.on_output = [&](std::span<const uint8_t> piece) {
    bytes.insert(bytes.end(), piece.begin(), piece.end());
  };
  options.on_line = [&](std::string_view line) { lines.emplace_back(line); };
  const ProcessResult result = run_process(
      {"sh", "-c", "echo told >&2; head -c 1000000 /dev/zero; printf 'a\\n\\000b'"}, options);
  EXPECT_TRUE(result.good());
  ASSERT_EQ(bytes.size(), 1000004u);
  EXPECT_EQ(bytes[1000000], 'a');
  EXPECT_EQ(bytes[1000002], 0);
  EXPECT_EQ(lines, (std::vector<std::string>{"told"}));
}

TEST(Process, ExitCodesAndSignals) {
  EXPECT_EQ(run_process({"true"}).exit_code, 0);
  const ProcessResult three = run_process({"sh", "-c", "echo why; exit 3"});
  EXPECT_EQ(three.exit_code, 3);
  EXPECT_EQ(three.last_lines, "why");
  const ProcessResult killed = run_process({"sh", "-c", "kill -KILL $$"});
  EXPECT_EQ(killed.exit_code, -1);
  EXPECT_EQ(killed.signal, SIGKILL);
  EXPECT_FALSE(killed.good());
  EXPECT_THROW(run_process({"sh", "-c", "kill -INT $$"}), Cancelled);
}

// ffmpeg repeats a filter of thousands of characters in its errors.
TEST(Process, LongLinesAreToldInPart) {
  const std::string told = run_process({"sh", "-c", "printf '%01000d\\nend\\n' 7"}).last_lines;
  EXPECT_EQ(told, std::string(300, '0') + "... | end");
}

TEST(Process, FailureSaysWhatTheProgramSaidLast) {
  const std::string error =
      error_of([] { run_process_or_throw({"sh", "-c", "seq 20; exit 3"}, {}, "try again"); });
  EXPECT_EQ(error, "sh failed with exit code 3: 16 | 17 | 18 | 19 | 20 (try again)");
  EXPECT_TRUE(contains(error_of([] { run_process_or_throw({"sh", "-c", "kill -KILL $$"}); }),
                       "lack of memory"));
}

TEST(Process, EndlessLineIsCut) {
  size_t longest = 0, total = 0;
  ProcessOptions options;
  options.on_line = [&](std::string_view line) {
    longest = std::max(longest, line.size());
    total += line.size();
  };
  run_process({"sh", "-c", "head -c 3000000 /dev/zero | tr '\\0' x"}, options);
  EXPECT_EQ(total, 3000000u);
  EXPECT_LE(longest, 65536u);
}

TEST(Process, CancelEndsTheChild) {
  Cancel cancel;
  ProcessOptions options;
  options.cancel = &cancel;
  options.on_line = [&](std::string_view) { cancel.request(); };
  EXPECT_LT(seconds_of([&] {
              EXPECT_THROW(run_process({"sh", "-c", "echo started; exec sleep 60"}, options),
                           Cancelled);
            }),
            20);
}

TEST(Process, ChildThatIgnoresSigtermIsKilled) {
  pid_t child = 0;
  ProcessOptions options;
  options.on_line = [&](std::string_view line) {
    child = std::stoi(std::string(line));
    throw Error("the callback had enough");
  };
  EXPECT_THROW(
      run_process({"sh", "-c", "trap '' TERM; echo $$; while :; do sleep 0.1; done"}, options),
      Error);
  ASSERT_GT(child, 0);
  EXPECT_EQ(::kill(child, 0), -1);  // gone, and no zombie
}

TEST(Process, SilentChildIsCancelledToo) {
  Cancel cancel;
  ProcessOptions options;
  options.cancel = &cancel;
  std::thread other([&] {
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
    cancel.request();
  });
  EXPECT_LT(seconds_of([&] {
              // Even one that has closed its streams.
              EXPECT_THROW(run_process({"sh", "-c", "exec sleep 60 >/dev/null 2>&1"}, options),
                           Cancelled);
            }),
            20);
  other.join();
}

TEST(Process, GrandchildThatKeepsThePipeIsNotWaitedFor) {
  EXPECT_LT(seconds_of([] {
              EXPECT_EQ(lines_of({"sh", "-c", "sleep 30 & echo done"}),
                        (std::vector<std::string>{"done"}));
            }),
            15);
}

TEST(Process, FindsProgramsInPath) {
  EXPECT_TRUE(find_program("sh"));
  EXPECT_FALSE(find_program("no-such-program-anywhere"));
  EXPECT_FALSE(find_program(""));
  EXPECT_EQ(find_program("/bin/sh"), std::filesystem::path("/bin/sh"));
  EXPECT_FALSE(find_program("/etc/passwd"));  // not executable
  EXPECT_FALSE(find_program("/bin/"));

  const TempFolder folder;
  std::ofstream(folder / "tool") << "#!/bin/sh\necho mine\n";
  const std::string path = ::getenv("PATH");
  ::setenv("PATH", (folder.path().string() + ":" + path).c_str(), 1);
  EXPECT_FALSE(find_program("tool"));
  std::filesystem::permissions(folder / "tool", std::filesystem::perms{0755});
  EXPECT_EQ(find_program("tool"), folder / "tool");
  EXPECT_EQ(lines_of({"tool"}), (std::vector<std::string>{"mine"}));
  ::setenv("PATH", path.c_str(), 1);
}

TEST(Process, MissingProgramIsAnErrorThatInstallsIt) {
  EXPECT_EQ(error_of([] { require_program("no-such-tool", "some-package", "does things"); }),
            "the program no-such-tool is not installed, which does things (install it with: sudo "
            "apt-get install some-package)");
  EXPECT_TRUE(contains(error_of([] { run_process({"no-such-tool"}); }), "no-such-tool"));
}

}  // namespace
}  // namespace nerf
