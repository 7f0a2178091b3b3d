// What the programs share: the one place that catches errors, signals, logging, the first line.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "nerf/base/cancel.h"
#include "nerf/kernels/bf16.h"

namespace nerf::apps {

// Exit codes. A program stopped by a signal leaves with 128 + its number.
inline constexpr int kExitOk = 0;
inline constexpr int kExitBug = 1;   // a failed check, no memory, anything unforeseen
inline constexpr int kExitUser = 2;  // Error: something that the user can put right

// Runs body() and returns its result, or an exit code and one line "program: what" on stderr for
// what it throws. Sets up logging first. The only catcher of a program.
int run_main(const std::string& program, const std::function<int()>& body);

// `text` on one line: control characters, line breaks among them, become spaces.
std::string one_line(const std::string& text);

// `text` as one word of a shell's command line.
std::string shell_quoted(const std::string& text);

// While it lives, the first SIGINT or SIGTERM requests the cancel, and a second one ends the
// program at once. One at a time.
class SignalCancel {
 public:
  SignalCancel();
  ~SignalCancel();
  SignalCancel(const SignalCancel&) = delete;
  SignalCancel& operator=(const SignalCancel&) = delete;

  const Cancel& cancel() const { return cancel_; }
  // Number of the signal that came; 0 while none has.
  int signal() const;
  // Exit code after a stop: 128 + the signal's number.
  int exit_code() const { return 128 + signal(); }

 private:
  Cancel cancel_;
};

// "program 0.1.0", the answer to --version.
std::string version_text(const std::string& program);

// Lines for the user on stderr, through spdlog; a warning gets "warning: " in front.
void log_info(const std::string& text);
void log_warning(const std::string& text);

// While it lives, keeps the lines that log_info and log_warning print, the first ten thousand.
class LogRecord {
 public:
  LogRecord();
  ~LogRecord();
  LogRecord(const LogRecord&) = delete;
  LogRecord& operator=(const LogRecord&) = delete;

  std::vector<std::string> lines() const;  // as printed
  static bool is_warning(const std::string& line);

 private:
  struct Impl;
  std::shared_ptr<Impl> impl_;
};

// First line of every program: name and version, SIMD target, threads, precision. Throws Error
// where the processor lacks what the kernels or the precision need.
void log_machine(const std::string& program, int threads, Precision precision);

}  // namespace nerf::apps
