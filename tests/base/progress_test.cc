#include "nerf/base/progress.h"

#include <gtest/gtest.h>

#include <cmath>

namespace nerf {
namespace {

// A clock that stands until told otherwise, and everything that was written.
struct Bench {
  double now = 100;
  std::string out;
  std::vector<std::string> writes;
  Progress make(ProgressStyle style) {
    return Progress(
        "render", style, [this] { return now; },
        [this](std::string_view text) {
          out += text;
          writes.emplace_back(text);
        });
  }
};

ProgressStyle terminal(int columns = 80) {
  ProgressStyle style;
  style.terminal = true;
  style.columns = columns;
  return style;
}

TEST(Progress, DurationsReadWell) {
  EXPECT_EQ(format_duration(0), "0s");
  EXPECT_EQ(format_duration(59.4), "59s");
  EXPECT_EQ(format_duration(59.6), "1m 00s");
  EXPECT_EQ(format_duration(187), "3m 07s");
  EXPECT_EQ(format_duration(7500), "2h 05m");
  EXPECT_EQ(format_duration(-5), "0s");
  EXPECT_EQ(format_duration(std::nan("")), "0s");
  EXPECT_EQ(format_duration(1e300), "8784h 00m");
}

TEST(Progress, TerminalLineHasBarTextAndTimeLeft) {
  Bench bench;
  {
    Progress progress = bench.make(terminal());
    bench.now += 10;
    progress.update(0.25, "frame 3/12");
    EXPECT_EQ(bench.out, "\r\x1b[Krender [######..................]  25%  frame 3/12  30s left");
    bench.out.clear();
    bench.now += 30;
    progress.update(1, "frame 12/12");
    EXPECT_EQ(bench.out, "\r\x1b[Krender [########################] 100%  frame 12/12  40s");
    bench.out.clear();
  }
  EXPECT_EQ(bench.out, "\n");
}

TEST(Progress, TerminalRedrawsAtMostTenTimesASecond) {
  Bench bench;
  Progress progress = bench.make(terminal());
  for (int i = 0; i < 1000; ++i) {
    bench.now = 100 + i / 1000.0;
    progress.update(i / 1000.0);
  }
  EXPECT_GE(bench.writes.size(), 9u);
  EXPECT_LE(bench.writes.size(), 10u);
  const size_t before = bench.writes.size();
  progress.finish();
  EXPECT_EQ(bench.writes.size(), before + 2) << "the last state, then the line's end";
  progress.update(1);
  progress.finish();
  EXPECT_EQ(bench.writes.size(), before + 2);
}

TEST(Progress, TerminalLineIsCutToTheWidth) {
  Bench bench;
  Progress progress = bench.make(terminal(20));
  progress.update(0.5, "a very long text \xc3\xa9\xc3\xa9\xc3\xa9");
  EXPECT_EQ(bench.out, "\r\x1b[Krender [###########");
  bench.out.clear();
  Progress wide = bench.make(terminal(43));
  wide.update(0.5, "\xc3\xa9\xc3\xa9\xc3\xa9");
  EXPECT_EQ(bench.out.substr(bench.out.size() - 6), "  \xc3\xa9\xc3\xa9") << bench.out;
}

TEST(Progress, ClearTakesTheLineOffAndUpdateBringsItBack) {
  Bench bench;
  Progress progress = bench.make(terminal());
  progress.clear();
  EXPECT_EQ(bench.out, "");
  progress.update(0.5);
  bench.out.clear();
  progress.clear();
  EXPECT_EQ(bench.out, "\r\x1b[K");
  bench.now += 1;
  progress.update(0.6);
  EXPECT_NE(bench.out.find(" 60%"), std::string::npos);
}

TEST(Progress, PipedOutputIsFewWholeLines) {
  Bench bench;
  {
    Progress progress = bench.make(ProgressStyle{});
    for (int i = 0; i <= 100; ++i) {
      bench.now = 100 + i * 0.05;  // five seconds in all
      progress.update(i / 100.0, "step " + std::to_string(i));
    }
  }
  EXPECT_EQ(bench.writes.size(), 5u) << bench.out;
  EXPECT_EQ(bench.writes.front(), "render  20%  step 20  4s left\n");
  EXPECT_EQ(bench.writes.back(), "render 100%  step 100  5s\n");
  for (const std::string& line : bench.writes) {
    EXPECT_EQ(line.find_first_of("\r\x1b"), std::string::npos);
    EXPECT_EQ(line.back(), '\n');
  }
}

TEST(Progress, PipedSlowJobStillSaysSomething) {
  Bench bench;
  Progress progress = bench.make(ProgressStyle{});
  for (int i = 0; i < 60; ++i) {
    bench.now += 1;
    progress.update(i / 10000.0);
  }
  EXPECT_EQ(bench.writes.size(), 6u) << bench.out;
}

TEST(Progress, StrangeFractionsAreClamped) {
  Bench bench;
  Progress progress = bench.make(terminal());
  for (const double fraction : {-1.0, std::nan(""), 2.0}) {
    bench.now += 1;
    bench.out.clear();
    progress.update(fraction);
    EXPECT_NE(bench.out.find(fraction == 2.0 ? "100%" : "  0%"), std::string::npos) << bench.out;
  }
}

TEST(Progress, NothingIsWrittenWithoutAnUpdate) {
  Bench bench;
  {
    Progress progress = bench.make(terminal());
  }
  {
    Progress progress = bench.make(ProgressStyle{});
  }
  EXPECT_EQ(bench.out, "");
}

TEST(Progress, APipeIsNoTerminal) {
  std::FILE* file = std::tmpfile();
  ASSERT_NE(file, nullptr);
  EXPECT_FALSE(style_of(file).terminal);
  {
    Progress("title", file).update(1, "done");
  }
  std::rewind(file);
  char text[64] = {};
  EXPECT_GT(std::fread(text, 1, sizeof(text) - 1, file), 0u);
  EXPECT_EQ(std::string(text), "title 100%  done  0s\n");
  std::fclose(file);
}

}  // namespace
}  // namespace nerf
