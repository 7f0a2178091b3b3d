// Kept measurements: how their files are read, what is refused, which rows a table shows.
#include "results_table.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <string>

#include "nerf/base/error.h"
#include "nerf/base/file.h"
#include "run_program.h"

namespace nerf {
namespace {

namespace fs = std::filesystem;
using apps::markdown_table;
using apps::parse_results;
using apps::Results;
using apps::TableChoice;
using testing_apps::expect_refused;
using testing_apps::run_program;
using testing_apps::TempFolder;

const std::string kHead = "date,commit,machine,load,seed,command,case,PSNR (dB),steps (1)\n";
const std::string kRows =
    "2026-01-02,aa,M,alone,1,train a,first,30.5,100\n"
    "2026-01-01,bb,M,alone,1,train a,first,29.5,100\n"  // older, though it stands below
    "2026-01-03,cc,M,shared,1,train a,first,31.5,100\n"
    "2026-01-02,dd,M,alone,2,train a,first,30.75,\n"
    "2026-01-02,ee,M,alone,1,\"train \"\"b\"\", c\",second,,7\n";

std::string table(const TableChoice& choice) {
  return markdown_table(parse_results(kHead + kRows, "file.csv"), choice);
}

TEST(ResultsTable, ShowsTheNewestRowOfEachKeyThatWasMeasuredAlone) {
  EXPECT_EQ(table({}),
            "| date | machine | seed | command | case | PSNR (dB) | steps |\n"
            "|---|---|---|---|---|---|---|\n"
            "| 2026-01-02 | M | 1 | `train a` | first | 30.5 | 100 |\n"
            "| 2026-01-02 | M | 2 | `train a` | first | 30.75 |  |\n"
            "| 2026-01-02 | M | 1 | `train \"b\", c` | second |  | 7 |\n");
}

TEST(ResultsTable, TakesOtherLoadsAndOlderRowsWhereAsked) {
  EXPECT_EQ(table({.columns = {"PSNR", "seed"}, .any_load = true}),
            "| PSNR (dB) | seed |\n|---|---|\n| 31.5 | 1 |\n| 30.75 | 2 |\n");
  EXPECT_EQ(table({.columns = {"PSNR"}, .history = true}),
            "| PSNR (dB) |\n|---|\n| 30.5 |\n| 29.5 |\n| 30.75 |\n");
}

TEST(ResultsTable, KeepsRowsByWhatTheirColumnsContain) {
  EXPECT_EQ(table({.columns = {"case", "steps"}, .where = {{"case", "eco"}}}),
            "| case | steps |\n|---|---|\n| second | 7 |\n");
  EXPECT_EQ(table({.columns = {"case", "steps"}, .where = {{"case", "eco", true}}}),
            "| case | steps |\n|---|---|\n| first | 100 |\n");
  EXPECT_EQ(table({.where = {{"case", "third"}}}), "");
}

TEST(ResultsTable, PutsFiguresBesideEachOther) {
  EXPECT_EQ(table({.columns = {"case", "PSNR", "steps"}, .across = {"seed"}}),
            "| case: PSNR (dB), steps | 1 | 2 |\n|---|---|---|\n"
            "| first | 30.5, 100 | 30.75 |\n"
            "| second | 7 |  |\n");
  EXPECT_THROW(table({.across = {"PSNR"}}), Error);
}

TEST(ResultsTable, ReadsQuotesAndLineBreaks) {
  const Results r = parse_results(kHead + ",,,,,\"a, \"\"b\"\"\nc\",d,1e-3,\r\n", "file.csv");
  ASSERT_EQ(r.rows.size(), 1u);
  EXPECT_EQ(r.rows[0][5], "a, \"b\"\nc");
  EXPECT_EQ(r.rows[0][7], "1e-3");
}

// What is wrong, and in which line.
void expect_error(const std::string& text, const std::string& where, const std::string& what) {
  try {
    parse_results(text, "file.csv");
    FAIL() << text;
  } catch (const Error& e) {
    EXPECT_EQ(e.where(), where) << text;
    EXPECT_NE(e.message().find(what), std::string::npos) << e.message();
  }
}

TEST(ResultsTable, NamesTheLineThatIsWrong) {
  const std::string good = "2026-01-02,,M,alone,1,c,d,1,2\n";
  expect_error("", "file.csv", "empty");
  expect_error("date,commit,machine,seed,load,command\n", "file.csv:1", "column 4 is not 'load'");
  expect_error("date,commit\n", "file.csv:1", "column 3 is not 'machine'");
  expect_error("date,commit,machine,load,seed,command,a,a\n", "file.csv:1", "'a' is there twice");
  expect_error(kHead + good + "2026-01-02,,M,alone,1,c,d,1\n", "file.csv:3", "8 fields");
  expect_error(kHead + good + good + "2.1.2026,,M,alone,1,c,d,1,2\n", "file.csv:4", "no date");
  expect_error(kHead + "2026-01-02,,M,busy,1,c,d,1,2\n", "file.csv:2", "unknown load 'busy'");
  expect_error(kHead + "2026-01-02,,M,alone,1,c,d,30 dB,2\n", "file.csv:2", "'30 dB' is no number");
  expect_error(kHead + "2026-01-02,,M,alone,1,c,d,nan,2\n", "file.csv:2", "'nan' is no number");
  expect_error(kHead + "2026-01-02,,\"M,alone,1,c,d,1,2\n", "file.csv:2", "no end");
  expect_error(kHead + "2026-01-02,,\"M\"x,alone,1,c,d,1,2\n", "file.csv:2", "closing quote");
  expect_error(kHead + "2026-01-02,,M\"x,alone,1,c,d,1,2\n", "file.csv:2", "a quote stands");
  // Line breaks within quotes count.
  expect_error(kHead + ",,,,,\"a\nb\",c,1,2\n,,,,,a,c,x,2\n", "file.csv:4", "'x' is no number");
}

TEST(ResultsTable, NamesColumnsThatAreNotThere) {
  const Results r = parse_results(kHead + kRows, "file.csv");
  EXPECT_EQ(r.column("PSNR", "--columns"), 7u);
  EXPECT_EQ(r.column("PSNR (dB)", "--columns"), 7u);
  try {
    r.column("PSRN", "--columns");
    FAIL();
  } catch (const Error& e) {
    EXPECT_EQ(e.where(), "--columns");
    EXPECT_NE(e.hint().find("PSNR"), std::string::npos) << e.hint();
  }
  const Results two = parse_results(
      "date,commit,machine,load,seed,command,rate (GB/s),rate (GFLOP/s)\n", "file.csv");
  EXPECT_THROW(two.column("rate", "--columns"), Error);
  EXPECT_EQ(two.column("rate (GB/s)", "--columns"), 6u);
}

TEST(NerfBenchTables, PrintsAFolderAndRefusesWhatIsNotThere) {
  TempFolder folder;
  write_file_atomically(folder.path() / "one.csv", kHead + kRows);
  write_file_atomically(folder.path() / "two.csv", kHead + "2026-01-02,,M,shared,1,c,d,1,2\n");
  const std::string results = folder.path().string();
  const auto run = [&](std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), {"tables", "--results", results});
    return run_program(NERF_BENCH_PROGRAM, arguments);
  };
  const auto one = run({"one", "--columns", "case,PSNR", "--where", "seed=2"});
  ASSERT_EQ(one.exit_code, 0) << one.err;
  EXPECT_EQ(one.out, "| case | PSNR (dB) |\n|---|---|\n| first | 30.75 |\n");
  const auto all = run({"--any-load", "--columns", "steps", "--where", "seed=1;command!=train"});
  ASSERT_EQ(all.exit_code, 0) << all.err;
  EXPECT_EQ(all.out, "## two\n\n| steps |\n|---|\n| 2 |\n");
  expect_refused(run({"three"}), "nerf_bench", {"three.csv"});
  expect_refused(run({"two"}), "nerf_bench", {"--any-load"});
  expect_refused(run({"one", "--where", "seed"}), "nerf_bench", {"has no ="});
  write_file_atomically(folder.path() / "two.csv", kHead + "2026-01-02,,M,shared,1,c,d,1\n");
  expect_refused(run({"two", "--any-load"}), "nerf_bench", {"two.csv:2"});
}

// Every file that is kept can be read.
TEST(NerfBenchTables, ReadsWhatIsKept) {
  int files = 0;
  for (const auto& entry : fs::directory_iterator(fs::path(NERF_SOURCE_DIR) / "bench/results")) {
    const Results r = parse_results(read_text_file(entry.path()), entry.path().string());
    EXPECT_FALSE(r.rows.empty()) << entry.path();
    ++files;
  }
  EXPECT_GE(files, 1);
}

}  // namespace
}  // namespace nerf
