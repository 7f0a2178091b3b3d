// nerf_bench as a user runs it: that it measures and writes what it promises, never how fast.
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <set>

#include "blender_scene.h"
#include "csv.h"
#include "nerf/kernels/bf16.h"
#include "nerf/kernels/simd.h"
#include "run_program.h"

namespace nerf {
namespace {

namespace fs = std::filesystem;
using testing_apps::expect_refused;
using testing_apps::fields_of;
using testing_apps::lines_of;
using testing_apps::ProgramResult;
using testing_apps::run_program;
using testing_apps::TempFolder;

// Each number in it, decimals included, is an N. (No std::regex: GCC 12 warns inside of it where a
// sanitizer is on.)
std::string without_numbers(const std::string& text) {
  const auto digit = [&](size_t i) { return i < text.size() && '0' <= text[i] && text[i] <= '9'; };
  std::string out;
  for (size_t i = 0; i < text.size();) {
    if (!digit(i)) {
      out += text[i++];
      continue;
    }
    while (digit(i)) ++i;
    if (i < text.size() && text[i] == '.' && digit(i + 1)) {
      ++i;
      while (digit(i)) ++i;
    }
    out += 'N';
  }
  return out;
}

TEST(NerfBench, SceneWritesItsTableAndItsCurve) {
  TempFolder folder;
  test::write_blender_scene(folder.path() / "capture");
  const fs::path out = folder.path() / "bench";
  const ProgramResult result = run_program(
      NERF_BENCH_PROGRAM, {"scene", (folder.path() / "capture").string(), "-o", out.string(),
                           "--minutes", "0.02,0.01", "--seeds", "1", "--scaling-minutes", "0"});
  ASSERT_EQ(result.exit_code, 0) << result.err;
  const std::vector<std::string> lines = lines_of(result.out);
  ASSERT_GE(lines.size(), 4u) << result.out;
  for (const char* column : {"training s", "decoding s", "evaluation s", "peak memory MB"})
    EXPECT_NE(lines[0].find(column), std::string::npos) << lines[0];
  for (size_t i = 1; i < 4; ++i)  // as many columns in every line
    EXPECT_EQ(std::count(lines[i].begin(), lines[i].end(), '|'),
              std::count(lines[0].begin(), lines[0].end(), '|'))
        << lines[i];
  EXPECT_EQ(lines[2].rfind("| 0.02 | 1 | ", 0), 0u) << lines[2];
  // The model that is rendered is that of the largest budget; both held-out views are.
  EXPECT_NE(result.out.find("rendering 2 held-out views of m0.02_s1, 32x32"), std::string::npos)
      << result.out;
  EXPECT_NE(result.out.find("with every skip off, in f32, "), std::string::npos) << result.out;
  EXPECT_NE(result.out.find("largest difference of PSNR"), std::string::npos) << result.out;

  // The same again from the run's folder alone, of one view at half the size.
  const ProgramResult again = run_program(
      NERF_BENCH_PROGRAM,
      {"render", (out / "m0.01_s1").string(), "--views", "1", "--downscale", "2", "--usual-only"});
  ASSERT_EQ(again.exit_code, 0) << again.err;
  EXPECT_NE(again.out.find("rendering 1 held-out views of m0.01_s1, 16x16"), std::string::npos)
      << again.out;
  EXPECT_NE(again.out.find("mean PSNR "), std::string::npos) << again.out;
  EXPECT_EQ(again.out.find("every skip off"), std::string::npos) << again.out;

  const std::vector<std::string> curve = lines_of(testing_apps::read_text(out / "quality.csv"));
  ASSERT_GE(curve.size(), 3u);  // a run that a busy machine draws out is evaluated on its way too
  EXPECT_EQ(curve[0], "run,seed,seconds,step,psnr,ssim,views");
  EXPECT_EQ(curve[1].rfind("m0.02_s1,1,", 0), 0u) << curve[1];
  EXPECT_TRUE(curve[1].ends_with(",2")) << curve[1];
  EXPECT_EQ(curve.back().rfind("m0.01_s1,1,", 0), 0u) << curve.back();
}

TEST(NerfBench, MistakesAreFoundBeforeAnythingIsWritten) {
  TempFolder folder;
  const std::string out = (folder.path() / "bench").string();
  const auto refused = [&](const char* option, const char* value) {
    expect_refused(
        run_program(NERF_BENCH_PROGRAM, {"scene", "/nonexistent", "-o", out, option, value}),
        "nerf_bench", {option});
    EXPECT_FALSE(fs::exists(out));
  };
  for (const char* minutes : {"", "2,", ",2", "2,,6", "0", "-1", "nan", "inf", "2;6"})
    refused("--minutes", minutes);
  for (const char* seeds : {"", "1,", "1.5", "-1", "one"}) refused("--seeds", seeds);
  refused("--split", "tset");
}

TEST(NerfBench, AblationTakesOnePartOutAtATime) {
  TempFolder folder;
  test::write_blender_scene(folder.path() / "capture");
  const fs::path out = folder.path() / "ablation";
  const ProgramResult result =
      run_program(NERF_BENCH_PROGRAM, {"ablation", (folder.path() / "capture").string(), "-o",
                                       out.string(), "--steps", "3", "--split", "test", "--filter",
                                       "view", "--with=--network-width 24 --recipe-rays 64"});
  ASSERT_EQ(result.exit_code, 0) << result.err;
  const std::vector<std::string> rows = lines_of(testing_apps::read_text(out / "ablation.csv"));
  ASSERT_EQ(rows.size(), 3u);
  EXPECT_EQ(rows[1].rfind("whole,", 0), 0u) << rows[1];
  EXPECT_NE(rows[1].find(",+0.000,"), std::string::npos) << rows[1];
  EXPECT_EQ(rows[2].rfind("without view dependence,", 0), 0u) << rows[2];
  EXPECT_NE(rows[2].find("--no-network-view-dependence"), std::string::npos) << rows[2];
  EXPECT_TRUE(fs::exists(out / "report.html"));
  EXPECT_TRUE(fs::exists(out / "ablation.svg"));
  const std::string model = testing_apps::read_text(out / "runs/whole/options.json");
  EXPECT_NE(model.find("\"method\": \"nerf\""), std::string::npos);
  EXPECT_NE(model.find("\"rays\": 64"), std::string::npos);
  // What was given for all is counted in the even samples, and replaced where a variant needs to.
  const ProgramResult even = run_program(
      NERF_BENCH_PROGRAM,
      {"ablation", (folder.path() / "capture").string(), "-o", out.string(), "--steps", "2",
       "--filter", "hierarchical",
       "--with=--network-sampling-coarse 5 --network-sampling-fine=7 --network-width 24"});
  ASSERT_EQ(even.exit_code, 0) << even.err;
  const std::vector<std::string> both = lines_of(testing_apps::read_text(out / "ablation.csv"));
  ASSERT_EQ(both.size(), 3u);
  EXPECT_NE(both[1].find("--network-sampling-fine=7"), std::string::npos) << both[1];
  EXPECT_EQ(both[2].find("--network-sampling-fine=7"), std::string::npos) << both[2];
  EXPECT_NE(both[2].find("--network-sampling-fine 17"), std::string::npos) << both[2];
  EXPECT_NE(both[2].find("--network-width 24"), std::string::npos) << both[2];

  expect_refused(run_program(NERF_BENCH_PROGRAM,
                             {"ablation", "/nonexistent", "-o", out.string(), "--method", "grid"}),
                 "nerf_bench", {"--method", "paper's method"});
  // Every variant is one that nerf_train takes: what fails is that there is no capture.
  for (const char* method : {"nerf", "mipnerf", "mipnerf360"}) {
    const ProgramResult none = run_program(
        NERF_BENCH_PROGRAM, {"ablation", "/nonexistent", "-o", out.string(), "--method", method});
    EXPECT_EQ(none.exit_code, 2);
    EXPECT_NE(none.err.find("/nonexistent: there is no such"), std::string::npos) << none.err;
  }
  const ProgramResult ndc =
      run_program(NERF_BENCH_PROGRAM,
                  {"ablation", "/nonexistent", "-o", out.string(), "--with=--network-space ndc"});
  EXPECT_NE(ndc.err.find("/nonexistent: there is no such"), std::string::npos) << ndc.err;
  expect_refused(run_program(NERF_BENCH_PROGRAM,
                             {"ablation", "/nonexistent", "-o", out.string(), "--with=--no-such"}),
                 "nerf_bench", {"--no-such"});
}

TEST(NerfBench, KernelsAreMeasuredBesideTheMachinesCeilings) {
  TempFolder folder;
  const fs::path csv = folder.path() / "kernels.csv";
  const auto measured = [&](const std::string& filter) {
    const ProgramResult result =
        run_program(NERF_BENCH_PROGRAM, {"kernels", "--seconds", "1e-4", "--threads", "2",
                                         "--stream-mb", "4", "--filter", filter, "--csv", csv});
    EXPECT_EQ(result.exit_code, 0) << result.err;
    const std::string row = std::to_string(4 * sizeof(Real)) + " bytes, 64 MB | M rows/s | ";
    EXPECT_NE(result.out.find("| random rows of " + row), std::string::npos) << result.out;
    const std::vector<std::string> lines = lines_of(testing_apps::read_text(csv));
    std::set<std::string> names;
    EXPECT_EQ(lines.empty() ? "" : lines[0],
              "kernel,target,threads,rate,unit,bound,ceiling,fraction,processor_share,"
              "gb_per_second");
    for (size_t i = 1; i < lines.size(); ++i) {
      const std::vector<std::string> fields = fields_of(lines[i]);
      EXPECT_EQ(fields.size(), 10u) << lines[i];
      if (fields.size() != 10) continue;
      EXPECT_GT(std::stod(fields[3]), 0) << lines[i];
      if (fields[0].rfind("ceiling: ", 0) == 0) continue;
      EXPECT_NE(fields[0].find(filter), std::string::npos) << lines[i];
      EXPECT_GT(std::stod(fields[6]), 0) << lines[i];
      EXPECT_GT(std::stod(fields[7]), 0) << lines[i];
      names.insert(fields[0]);
    }
    return names;
  };
  EXPECT_EQ(measured("linear 64-16"),
            (std::set<std::string>{"linear 64-16 forward", "linear 64-16 backward input",
                                   "linear 64-16 backward weights"}));
  EXPECT_EQ(measured("2^15 entries"),
            (std::set<std::string>{
                "hash grid 10x4 forward, 2^15 entries, 2^16 samples",
                "hash grid 10x4 forward in 16 bits, 2^15 entries, 2^16 samples",
                "hash grid 10x4 backward, 2^15 entries, 2^16 samples",
                "hash grid 10x4 position gradient in 16 bits, 2^15 entries, 2^16 samples",
                "hash grid 16x2 forward, 2^15 entries, 2^18 samples",
                "hash grid 16x2 forward in 16 bits, 2^15 entries, 2^18 samples",
                "hash grid 16x2 backward, 2^15 entries, 2^18 samples",
                "hash grid 16x2 position gradient in 16 bits, 2^15 entries, 2^18 samples"}));
  EXPECT_EQ(measured("Adam dense").size(), 1u);
  for (const char* kernel : {"list of rows", "ReLU backward", "transpose"})
    EXPECT_EQ(measured(kernel).size(), 1u) << kernel;
  // In f32 wide layers alone are packed, and none in double.
  if (sizeof(Real) == sizeof(float)) {
    EXPECT_EQ(measured("weight packing 63-256x8-4").size(), 1u);
  }
  if (!bf16_units().empty()) {
    EXPECT_EQ(measured("weight packing 32-64-64-16").size(), 1u);
  }
  EXPECT_EQ(measured("compositing"),
            (std::set<std::string>{"compositing forward+backward, 16 samples per ray",
                                   "compositing forward, 16 samples per ray",
                                   "compositing backward, 16 samples per ray"}));
  expect_refused(run_program(NERF_BENCH_PROGRAM, {"kernels", "--filter", "nothing of this name"}),
                 "nerf_bench", {"--filter", "nothing of this name"});
}

// A printed table's lines, by their first cell, cut into the others.
std::map<std::string, std::vector<std::string>> table_of(const std::string& out) {
  std::map<std::string, std::vector<std::string>> table;
  for (const std::string& line : lines_of(out)) {
    if (line.rfind("| ", 0) != 0) continue;
    std::vector<std::string> cells;
    for (size_t at = 1, end; (end = line.find('|', at)) != std::string::npos; at = end + 1) {
      const std::string cell = line.substr(at, end - at);
      const size_t first = cell.find_first_not_of(' ');
      cells.push_back(first == std::string::npos
                          ? ""
                          : cell.substr(first, cell.find_last_not_of(' ') + 1 - first));
    }
    table[cells[0]] = {cells.begin() + 1, cells.end()};
  }
  return table;
}

// Of each column its target and threads; those of bf16 units come last.
std::vector<std::string> columns_of(const std::vector<int>& threads, size_t& of_f32) {
  std::vector<std::string> names = simd_targets(), columns = {"unit"};
  of_f32 = names.size() * threads.size();
  for (const Bf16Unit unit : bf16_units()) names.push_back(bf16_unit_name(unit));
  for (const std::string& name : names)
    for (const int n : threads)
      columns.push_back(name + ", " + std::to_string(n) + (n == 1 ? " thread" : " threads"));
  return columns;
}

TEST(NerfBench, KernelsHaveUnitShareAndAColumnForEachTargetAndThreads) {
  TempFolder folder;
  const fs::path csv = folder.path() / "kernels.csv";
  size_t of_f32 = 0;
  const auto row_of = [&](const std::string& kernel, int threads,
                          const std::vector<int>& columns) -> std::vector<std::string> {
    const ProgramResult result = run_program(
        NERF_BENCH_PROGRAM, {"kernels", "--seconds", "1e-4", "--threads", std::to_string(threads),
                             "--stream-mb", "4", "--filter", kernel, "--csv", csv});
    EXPECT_EQ(result.exit_code, 0) << result.err;
    auto table = table_of(result.out);
    const std::vector<std::string> expected = columns_of(columns, of_f32);
    EXPECT_EQ(table["kernel"], expected);
    EXPECT_EQ(table["ceiling"], expected);
    EXPECT_TRUE(table.contains(kernel)) << result.out;
    table[kernel].resize(expected.size());
    return table[kernel];
  };
  const std::string flops = "N (N %)", samples = "N, N GB/s (N %)";

  const std::vector<std::string> mlp = row_of("MLP 32-64-64-16 forward, 2^18 samples", 2, {1, 2});
  EXPECT_EQ(mlp[0], "GFLOP/s, FMA");
  for (size_t i = 1; i < mlp.size(); ++i) EXPECT_EQ(without_numbers(mlp[i]), flops) << mlp[i];

  const auto grid = [&](const std::string& pass, int threads, const std::vector<int>& columns) {
    return row_of("hash grid 10x4 " + pass + ", 2^15 entries, 2^16 samples", threads, columns);
  };
  // Bytes of a sample: at each of ten levels a point, four features and eight rows of as many.
  const auto expect_grid = [&](const std::vector<std::string>& row, double row_bytes) {
    EXPECT_EQ(row[0], "M samples/s, random rows");
    for (size_t i = 1; i < row.size(); ++i)
      EXPECT_EQ(without_numbers(row[i]), i <= of_f32 ? samples : "") << row[i];
    const double bytes = 10 * ((3 + 4) * sizeof(Real) + 8 * row_bytes);
    for (const auto& measured : testing_apps::csv_rows(testing_apps::read_text(csv))) {
      if (measured.at("unit") != "M samples/s") continue;
      const double rate = std::stod(measured.at("rate"));
      EXPECT_NEAR(std::stod(measured.at("gb_per_second")) / (1e-3 * bytes * rate), 1, 1e-4);
      EXPECT_NEAR(rate / std::stod(measured.at("ceiling")), std::stod(measured.at("fraction")),
                  1e-3 * std::stod(measured.at("fraction")));
    }
  };
  expect_grid(grid("forward", 1, {1}), 4 * sizeof(Real));
  expect_grid(grid("forward in 16 bits", 3, {1, 2, 3}), 4 * sizeof(uint16_t));
  expect_grid(grid("backward", 2, {1, 2}), 2 * 4 * sizeof(Real) + 1);
}

TEST(NerfBench, SaysItsVersion) {
  const ProgramResult result = run_program(NERF_BENCH_PROGRAM, {"--version"});
  EXPECT_EQ(result.exit_code, 0);
  EXPECT_EQ(result.out.rfind("nerf_bench ", 0), 0u) << result.out;
}

}  // namespace
}  // namespace nerf
