#include "app.h"

#include <fmt/format.h>
#include <spdlog/sinks/base_sink.h>
#include <spdlog/sinks/stdout_sinks.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <atomic>
#include <cctype>
#include <csignal>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <memory>
#include <mutex>
#include <new>
#include <string_view>

#include "nerf/base/error.h"
#include "nerf/kernels/simd.h"

namespace nerf::apps {
namespace {

constexpr const char* kWarning = "warning: ";

// A signal handler reaches nothing but globals; these two are the program's, not the library's.
std::atomic<Cancel*> signal_target{nullptr};
volatile std::sig_atomic_t signal_number = 0;

extern "C" void on_signal(int number) {
  if (signal_number != 0) {
    // The second one: as if nobody had caught it.
    std::signal(number, SIG_DFL);
    std::raise(number);
    return;
  }
  signal_number = number;
  if (Cancel* cancel = signal_target.load()) cancel->request();
}

void set_up_logging() {
  auto logger =
      std::make_shared<spdlog::logger>("nerf", std::make_shared<spdlog::sinks::stderr_sink_mt>());
  logger->set_pattern("%v");
  logger->flush_on(spdlog::level::info);
  spdlog::set_default_logger(std::move(logger));
}

// No allocation here: it may be memory that ran out.
int fail(const char* program, const char* what, int code) {
  std::fprintf(stderr, "%s: %s\n", program, what);
  std::fflush(stderr);
  return code;
}

}  // namespace

std::string one_line(const std::string& text) {
  std::string line = text;
  for (char& c : line)
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) c = ' ';
  return line;
}

std::string shell_quoted(const std::string& text) {
  const auto plain = [](unsigned char c) {
    return std::isalnum(c) ||
           std::string_view("-_./,=:+@%").find(static_cast<char>(c)) != std::string_view::npos;
  };
  if (!text.empty() && std::all_of(text.begin(), text.end(), plain)) return text;
  std::string out = "'";
  for (const char c : text) out += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return out + "'";
}

int run_main(const std::string& program, const std::function<int()>& body) {
  const char* name = program.c_str();
  try {
    set_up_logging();
    std::signal(SIGXFSZ, SIG_IGN);  // a file over the size limit is an Error like a full disk
    return body();
  } catch (const Error& error) {
    return fail(name, one_line(error.what()).c_str(), kExitUser);
  } catch (const Cancelled&) {
    return fail(name, "stopped", signal_number ? 128 + signal_number : kExitBug);
  } catch (const std::filesystem::filesystem_error& error) {
    return fail(name, one_line(error.what()).c_str(), kExitUser);
  } catch (const std::bad_alloc&) {
    return fail(name, "out of memory (use smaller images, --downscale or --size, or more memory)",
                kExitBug);
  } catch (const std::exception& error) {
    return fail(name, one_line(std::string("internal error: ") + error.what()).c_str(), kExitBug);
  } catch (...) {
    return fail(name, "internal error of unknown type", kExitBug);
  }
}

SignalCancel::SignalCancel() {
  signal_number = 0;
  signal_target = &cancel_;
  for (const int number : {SIGINT, SIGTERM}) {
    struct sigaction action{};
    action.sa_handler = on_signal;
    action.sa_flags = SA_RESTART;  // a write in the middle of a file goes on
    sigemptyset(&action.sa_mask);
    sigaction(number, &action, nullptr);
  }
}

SignalCancel::~SignalCancel() {
  for (const int number : {SIGINT, SIGTERM}) std::signal(number, SIG_DFL);
  signal_target = nullptr;
}

int SignalCancel::signal() const { return signal_number; }

std::string version_text(const std::string& program) { return program + " " NERF_VERSION; }

void log_info(const std::string& text) { spdlog::info("{}", text); }
void log_warning(const std::string& text) { spdlog::warn("{}{}", kWarning, text); }

struct LogRecord::Impl : spdlog::sinks::base_sink<std::mutex> {
  static constexpr size_t kMost = 10000;
  std::vector<std::string> lines;

  std::vector<std::string> copy() {
    const std::lock_guard lock(mutex_);
    return lines;
  }
  void sink_it_(const spdlog::details::log_msg& message) override {
    if (lines.size() < kMost) lines.emplace_back(message.payload.data(), message.payload.size());
  }
  void flush_() override {}
};

LogRecord::LogRecord() : impl_(std::make_shared<Impl>()) {
  spdlog::default_logger()->sinks().push_back(impl_);
}

LogRecord::~LogRecord() {
  std::erase(spdlog::default_logger()->sinks(),
             std::static_pointer_cast<spdlog::sinks::sink>(impl_));
}

std::vector<std::string> LogRecord::lines() const { return impl_->copy(); }

bool LogRecord::is_warning(const std::string& line) { return line.starts_with(kWarning); }

void log_machine(const std::string& program, int threads, Precision precision) {
  log_info(fmt::format("{}: {}, {} thread{}, {}", version_text(program), simd_target(), threads,
                       threads == 1 ? "" : "s", precision_name(resolve_precision(precision))));
}

}  // namespace nerf::apps
