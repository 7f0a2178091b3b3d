#include "nerf/base/process.h"

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <deque>
#include <utility>

#include "nerf/base/error.h"
#include "nerf/base/file.h"

extern char** environ;

namespace nerf {
namespace {

namespace fs = std::filesystem;

constexpr int kPollMilliseconds = 50;
constexpr auto kPatience = std::chrono::seconds(3);  // between SIGTERM and SIGKILL
constexpr size_t kLongestTold = 300, kLongestLine = 1 << 16;
constexpr size_t kLinesKept = 5;

struct Pipe {
  int read = -1, write = -1;
  Pipe() {
    int ends[2];
    if (::pipe2(ends, O_CLOEXEC) != 0) {
      throw errno_error(errno, "cannot start a program", "pipe");
    }
    read = ends[0];
    write = ends[1];
  }
  ~Pipe() {
    close_read();
    close_write();
  }
  Pipe(const Pipe&) = delete;
  Pipe& operator=(const Pipe&) = delete;
  void close_read() {
    if (read >= 0) ::close(std::exchange(read, -1));
  }
  void close_write() {
    if (write >= 0) ::close(std::exchange(write, -1));
  }
};

// Cuts bytes into lines; ffmpeg redraws its progress with '\r'.
class Lines {
 public:
  explicit Lines(const std::function<void(std::string_view)>& on_line) : on_line_(on_line) {}
  void add(std::span<const uint8_t> bytes) {
    for (const uint8_t byte : bytes) {
      if (byte == '\n' || byte == '\r' || line_.size() >= kLongestLine) end_line();
      if (byte != '\n' && byte != '\r') line_ += static_cast<char>(byte);
    }
  }
  void end_line() {
    if (line_.empty()) return;
    const std::string line = std::exchange(line_, "");
    last_.push_back(line);
    if (last_.size() > kLinesKept) last_.pop_front();
    if (on_line_) on_line_(line);
  }
  std::string last() const {
    std::string text;
    for (const std::string& line : last_) {
      text += (text.empty() ? "" : " | ") + line.substr(0, kLongestTold);
      if (line.size() > kLongestTold) text += "...";
    }
    return text;
  }

 private:
  const std::function<void(std::string_view)>& on_line_;
  std::string line_;
  std::deque<std::string> last_;
};

// A started child, which ends with this object at the latest.
class Child {
 public:
  explicit Child(pid_t pid) : pid_(pid) {}
  ~Child() {
    if (ended_) return;
    ::kill(pid_, SIGTERM);
    const auto deadline = std::chrono::steady_clock::now() + kPatience;
    while (!poll_end() && std::chrono::steady_clock::now() < deadline) {
      ::poll(nullptr, 0, kPollMilliseconds);
    }
    if (!ended_) {
      ::kill(pid_, SIGKILL);
      wait(0);
    }
  }
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;

  bool poll_end() { return ended_ || wait(WNOHANG); }
  int status() const { return status_; }

 private:
  bool wait(int flags) {
    pid_t result;
    do {
      result = ::waitpid(pid_, &status_, flags);
    } while (result < 0 && errno == EINTR);
    // Someone else has reaped it (a program that ignores SIGCHLD): how it ended is not known.
    if (result < 0) status_ = 0xff00;
    return ended_ = result != 0;
  }
  pid_t pid_;
  int status_ = 0;
  bool ended_ = false;
};

std::vector<char*> pointers(std::vector<std::string>& texts) {
  std::vector<char*> result;
  for (std::string& text : texts) result.push_back(text.data());
  result.push_back(nullptr);
  return result;
}

std::vector<std::string> merged_environment(const std::vector<std::string>& added) {
  std::vector<std::string> result;
  for (char** entry = environ; entry != nullptr && *entry != nullptr; ++entry) {
    const std::string_view old = *entry;
    const std::string_view name = old.substr(0, old.find('='));
    bool replaced = false;
    for (const std::string& a : added) {
      replaced = replaced || (a.size() > name.size() && a.compare(0, name.size(), name) == 0 &&
                              a[name.size()] == '=');
    }
    if (!replaced) result.emplace_back(old);
  }
  result.insert(result.end(), added.begin(), added.end());
  return result;
}

pid_t spawn(const fs::path& program, const std::vector<std::string>& command,
            const ProcessOptions& options, int output, int errors) {
  posix_spawn_file_actions_t actions;
  posix_spawnattr_t attributes;
  ::posix_spawn_file_actions_init(&actions);
  ::posix_spawnattr_init(&attributes);
  ::posix_spawn_file_actions_addopen(&actions, 0, "/dev/null", O_RDONLY, 0);
  ::posix_spawn_file_actions_adddup2(&actions, output, 1);
  ::posix_spawn_file_actions_adddup2(&actions, errors, 2);
  if (!options.folder.empty()) {
    ::posix_spawn_file_actions_addchdir_np(&actions, options.folder.c_str());
  }
  // The child starts with signals as usual, whatever this process blocks or ignores.
  sigset_t none, all;
  ::sigemptyset(&none);
  ::sigfillset(&all);
  ::posix_spawnattr_setsigmask(&attributes, &none);
  ::posix_spawnattr_setsigdefault(&attributes, &all);
  ::posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF);

  std::vector<std::string> arguments = command;
  std::vector<std::string> environment = merged_environment(options.environment);
  pid_t pid = -1;
  const int code = ::posix_spawn(&pid, program.c_str(), &actions, &attributes,
                                 pointers(arguments).data(), pointers(environment).data());
  ::posix_spawn_file_actions_destroy(&actions);
  ::posix_spawnattr_destroy(&attributes);
  if (code != 0) throw errno_error(code, "cannot start the program", program);
  return pid;
}

// Hands on what has come; false at the end of the stream.
bool pump(int fd, Lines& lines, const std::function<void(std::span<const uint8_t>)>* raw) {
  std::array<uint8_t, 1 << 16> buffer;
  const ssize_t n = ::read(fd, buffer.data(), buffer.size());
  if (n < 0) return errno == EINTR || errno == EAGAIN;
  if (n == 0) return false;
  const auto bytes = std::span<const uint8_t>(buffer).first(static_cast<size_t>(n));
  if (raw != nullptr) {
    (*raw)(bytes);
  } else {
    lines.add(bytes);
  }
  return true;
}

bool is_executable(const fs::path& path) {
  struct stat info;
  return ::stat(path.c_str(), &info) == 0 && S_ISREG(info.st_mode) &&
         ::access(path.c_str(), X_OK) == 0;
}

}  // namespace

std::optional<fs::path> find_program(const std::string& name) {
  if (name.empty()) return std::nullopt;
  if (name.find('/') != std::string::npos) {
    return is_executable(name) ? std::optional<fs::path>(name) : std::nullopt;
  }
  const char* variable = std::getenv("PATH");
  std::string_view folders = variable != nullptr ? variable : "/usr/local/bin:/usr/bin:/bin";
  for (;;) {
    const size_t colon = std::min(folders.find(':'), folders.size());
    const fs::path folder(colon == 0 ? "." : folders.substr(0, colon));
    if (is_executable(folder / name)) return folder / name;
    if (colon == folders.size()) return std::nullopt;
    folders.remove_prefix(colon + 1);
  }
}

fs::path require_program(const std::string& name, const std::string& package,
                         const std::string& purpose) {
  if (const auto path = find_program(name)) return *path;
  throw Error("the program " + name + " is not installed, which " + purpose, "",
              "install it with: sudo apt-get install " + package);
}

ProcessResult run_process(const std::vector<std::string>& command, const ProcessOptions& options) {
  NERF_CHECK(!command.empty());
  const auto program = find_program(command[0]);
  if (!program) throw Error("the program is not installed or cannot be run", command[0]);
  Pipe output, errors;
  const bool raw = static_cast<bool>(options.on_output);
  Child child(spawn(fs::absolute(*program), command, options, raw ? output.write : errors.write,
                    errors.write));
  output.close_write();
  errors.close_write();

  Lines lines(options.on_line);
  bool ended = false;
  while (output.read >= 0 || errors.read >= 0) {
    pollfd fds[2] = {{output.read, POLLIN, 0}, {errors.read, POLLIN, 0}};
    const int ready = ::poll(fds, 2, kPollMilliseconds);
    if (options.cancel != nullptr && options.cancel->requested()) throw Cancelled();
    if (ready > 0) {
      if (fds[0].revents != 0 && !pump(output.read, lines, raw ? &options.on_output : nullptr)) {
        output.close_read();
      }
      if (fds[1].revents != 0 && !pump(errors.read, lines, nullptr)) errors.close_read();
    } else if (ended) {
      break;  // a grandchild keeps the pipes open
    } else {
      ended = child.poll_end();
    }
  }
  lines.end_line();
  // The streams may be closed long before the end.
  while (!child.poll_end()) {
    if (options.cancel != nullptr && options.cancel->requested()) throw Cancelled();
    ::poll(nullptr, 0, kPollMilliseconds);
  }
  ProcessResult result;
  result.last_lines = lines.last();
  if (WIFEXITED(child.status())) {
    result.exit_code = WEXITSTATUS(child.status());
  } else {
    result.signal = WTERMSIG(child.status());
    if (result.signal == SIGINT) throw Cancelled();
  }
  return result;
}

ProcessResult run_process_or_throw(const std::vector<std::string>& command,
                                   const ProcessOptions& options, const std::string& hint) {
  ProcessResult result = run_process(command, options);
  if (result.good()) return result;
  std::string what = fs::path(command[0]).filename().string();
  // Programs of several tools name the tool first: "colmap mapper".
  if (command.size() > 1 && !command[1].empty() && command[1][0] != '-') what += " " + command[1];
  if (result.signal != 0) {
    what += std::string(" was ended by the signal ") + ::strsignal(result.signal);
    if (result.signal == SIGKILL) what += " (often a lack of memory)";
  } else {
    what += " failed with exit code " + std::to_string(result.exit_code);
  }
  if (!result.last_lines.empty()) what += ": " + result.last_lines;
  throw Error(what, "", hint);
}

}  // namespace nerf
