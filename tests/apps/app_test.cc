#include "app.h"

#include <gtest/gtest.h>

#include <csignal>
#include <new>

#include "nerf/base/error.h"
#include "run_program.h"

namespace nerf::apps {
namespace {

struct Outcome {
  int code = 0;
  std::string err;
};

Outcome outcome(const std::function<int()>& body) {
  testing::internal::CaptureStderr();
  Outcome o;
  o.code = run_main("program", body);
  o.err = testing::internal::GetCapturedStderr();
  return o;
}

TEST(App, ErrorsBecomeOneLineAndAnExitCode) {
  Outcome o = outcome([]() -> int { throw Error("is broken", "a.bin:12", "make it new"); });
  EXPECT_EQ(o.code, 2);
  EXPECT_EQ(o.err, "program: a.bin:12: is broken (make it new)\n");
  o = outcome([]() -> int { throw Error("two\nlines\x1b[31m\t", "a\rb"); });
  EXPECT_EQ(o.err, "program: a b: two lines [31m \n");
  o = outcome([]() -> int { throw std::bad_alloc(); });
  EXPECT_EQ(o.code, 1);
  EXPECT_EQ(o.err.rfind("program: out of memory", 0), 0u) << o.err;
  o = outcome([]() -> int { throw std::logic_error("x == 1 failed\n"); });
  EXPECT_EQ(o.code, 1);
  EXPECT_EQ(o.err, "program: internal error: x == 1 failed \n");
  o = outcome([]() -> int { throw 3; });
  EXPECT_EQ(o.code, 1);
  EXPECT_EQ(std::count(o.err.begin(), o.err.end(), '\n'), 1);
  o = outcome([] { return 7; });
  EXPECT_EQ(o.code, 7);
  EXPECT_EQ(o.err, "");
}

TEST(App, UtfTextStaysWhole) { EXPECT_EQ(one_line("caf\xc3\xa9\n"), "caf\xc3\xa9 "); }

TEST(App, ShellsReadQuotedTextAsItWas) {
  EXPECT_EQ(shell_quoted("runs/a-b_c.1"), "runs/a-b_c.1");
  for (const std::string text : {"", "a b", "it's", "$HOME `x` \"y\" \\ * ? ; & | < > # ~ !", "''",
                                 "-n", "a\nb", "caf\xc3\xa9"}) {
    const auto result =
        testing_apps::run_program("/bin/sh", {"-c", "printf %s " + shell_quoted(text)});
    EXPECT_EQ(result.exit_code, 0) << result.err;
    EXPECT_EQ(result.out, text);
  }
}

TEST(App, ARecordKeepsWhatIsLogged) {
  std::vector<std::string> lines;
  outcome([&] {
    log_info("before");
    {
      const LogRecord record;
      log_info("one");
      log_warning("two {}");
      lines = record.lines();
    }
    log_info("after");
    return 0;
  });
  ASSERT_EQ(lines, (std::vector<std::string>{"one", "warning: two {}"}));
  EXPECT_FALSE(LogRecord::is_warning(lines[0]));
  EXPECT_TRUE(LogRecord::is_warning(lines[1]));
}

TEST(App, LogGoesToStderr) {
  const Outcome o = outcome([] {
    log_info("100% {} done");
    log_warning("look out");
    return 0;
  });
  EXPECT_EQ(o.err, "100% {} done\nwarning: look out\n");
}

TEST(App, FirstLineNamesTargetThreadsAndPrecision) {
  const Outcome o = outcome([] {
    log_machine("program", 2, Precision::kF32);
    log_machine("program", 1, Precision::kF32);
    return 0;
  });
  EXPECT_EQ(o.err.rfind("program 0.", 0), 0u) << o.err;
  EXPECT_NE(o.err.find(", 2 threads, f32\n"), std::string::npos) << o.err;
  EXPECT_NE(o.err.find(", 1 thread, f32\n"), std::string::npos) << o.err;
}

TEST(App, SignalsRequestTheCancelOnce) {
  for (const int number : {SIGINT, SIGTERM}) {
    SignalCancel stop;
    EXPECT_FALSE(stop.cancel().requested());
    EXPECT_EQ(stop.signal(), 0);
    raise(number);
    EXPECT_TRUE(stop.cancel().requested());
    EXPECT_EQ(stop.signal(), number);
    EXPECT_EQ(stop.exit_code(), 128 + number);
  }
}

TEST(AppDeathTest, TheSecondSignalEndsTheProgram) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  EXPECT_EXIT(
      {
        const SignalCancel stop;
        raise(SIGTERM);
        raise(SIGTERM);
        _exit(0);
      },
      testing::KilledBySignal(SIGTERM), "");
  EXPECT_EXIT(
      {
        {
          const SignalCancel stop;
        }
        raise(SIGINT);
        _exit(0);
      },
      testing::KilledBySignal(SIGINT), "")
      << "afterwards signals do what they did before";
}

TEST(App, CancelledAfterASignalLeavesWithItsNumber) {
  const Outcome o = outcome([]() -> int {
    const SignalCancel stop;
    raise(SIGTERM);
    throw Cancelled();
  });
  EXPECT_EQ(o.code, 128 + SIGTERM);
  EXPECT_EQ(o.err, "program: stopped\n");
}

}  // namespace
}  // namespace nerf::apps
