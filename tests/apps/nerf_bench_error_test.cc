// nerf_bench error: that its files are there and whole, and that its curves show what they must.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <set>

#include "blender_scene.h"
#include "csv.h"
#include "error_bench.h"
#include "nerf/kernels/bf16.h"
#include "nerf_train_fixture.h"
#include "quadrature.h"
#include "run_program.h"
#include "svg.h"

namespace nerf {
namespace {

namespace fs = std::filesystem;
using testing_apps::csv_rows;
using testing_apps::expect_refused;
using testing_apps::expect_svg;
using testing_apps::ProgramResult;
using testing_apps::read_text;
using testing_apps::run_program;
using testing_apps::TempFolder;
using Row = std::map<std::string, std::string>;

std::vector<Row> rows_of(const fs::path& csv) { return csv_rows(read_text(csv)); }

// The words of each row's command, as a shell takes it apart.
std::vector<std::vector<std::string>> commands_of(const std::vector<Row>& rows) {
  std::string script = "nerf_bench() { printf '%s\\n' $# \"$@\"; }\n";
  for (const Row& row : rows) script += row.at("command") + "\n";
  const std::vector<std::string> lines =
      testing_apps::lines_of(run_program("/bin/sh", {"-c", script}).out);
  std::vector<std::vector<std::string>> commands;
  for (size_t at = 0; at < lines.size();) {
    const size_t count = std::stoul(lines[at++]);
    EXPECT_LE(at + count, lines.size());
    if (at + count > lines.size()) break;
    commands.emplace_back(lines.begin() + static_cast<int64_t>(at),
                          lines.begin() + static_cast<int64_t>(at + count));
    at += count;
  }
  EXPECT_EQ(commands.size(), rows.size());
  return commands;
}

// Each row's command chooses its name, and no other's.
void expect_own_filters(const std::vector<Row>& rows,
                        const std::function<std::string(const Row&)>& name_of) {
  std::set<std::string> names;
  for (const Row& row : rows) names.insert(name_of(row));
  const std::vector<std::vector<std::string>> commands = commands_of(rows);
  for (size_t i = 0; i < std::min(rows.size(), commands.size()); ++i) {
    const auto flag = std::ranges::find(commands[i], "--filter");
    ASSERT_TRUE(flag != commands[i].end() && flag + 1 != commands[i].end()) << i;
    apps::ErrorBenchOptions options;
    options.filter = *(flag + 1);
    for (const std::string& name : names)
      EXPECT_EQ(options.selected(name), name == name_of(rows[i])) << options.filter << ": " << name;
  }
}

// Whether a row of the skips did other work than another one, or shows another picture.
bool differ(const Row& a, const Row& b) {
  for (const char* column :
       {"segments", "density_evaluations", "colour_evaluations", "rms_difference", "psnr"})
    if (a.at(column) != b.at(column)) return true;
  return false;
}

void expect_all_differ(const std::vector<Row>& rows) {
  for (size_t i = 0; i < rows.size(); ++i)
    for (size_t j = 0; j < i; ++j)
      EXPECT_TRUE(differ(rows[i], rows[j]))
          << rows[i].at("setting") << ", " << rows[j].at("setting");
}

TEST(Quadrature, ConvergesToTheClosedForm) {
  ThreadPool pool(1);
  // Second order in smooth media: 4096 samples leave a relative error of about 1e-7.
  for (const auto medium : {apps::MediumKind::kHomogeneous, apps::MediumKind::kExponential})
    for (const auto sampling : apps::kSamplings) {
      if (sampling == apps::Sampling::kUniformJittered) continue;
      EXPECT_LT(apps::quadrature_error(medium, sampling, 4096, 50, 3, pool), 3e-6)
          << apps::medium_name(medium) << ", " << apps::sampling_name(sampling);
    }
  // First order where a face falls anywhere into an interval of up to 1/270 (16 near to far) of
  // the ray.
  for (const auto medium : {apps::MediumKind::kSlab, apps::MediumKind::kTwoLayers})
    for (const auto sampling : apps::kSamplings)
      EXPECT_LT(apps::quadrature_error(medium, sampling, 4096, 50, 3, pool), 5e-3)
          << apps::medium_name(medium) << ", " << apps::sampling_name(sampling);
}

TEST(NerfBenchError, QuadratureErrorsFallAtTheirOrder) {
  TempFolder folder;
  const fs::path out = folder.path() / "curves";
  const ProgramResult result = run_program(
      NERF_BENCH_PROGRAM, {"error", "--curves", "quadrature", "--samples", "16,32,64,128,256",
                           "--rays", "300", "-o", out.string() + "/"});
  ASSERT_EQ(result.exit_code, 0) << result.err;
  const std::vector<Row> rows = rows_of(out / "quadrature.csv");
  ASSERT_EQ(rows.size(), 4u * 4 * 5);
  std::map<std::string, double> first, last;
  for (const Row& row : rows) {
    const std::string name = row.at("medium") + ", " + row.at("sampling");
    const int n = std::stoi(row.at("evaluations"));
    const double error = std::stod(row.at("rms_error"));
    if (n == 16) first[name] = error;
    if (n == 256) last[name] = error;
    EXPECT_EQ(row.at("order").empty(), n == 16) << name;
    const bool smooth = row.at("medium") == "homogeneous" || row.at("medium") == "exponential";
    if (smooth && row.at("sampling") == "uniform" && n >= 64) {
      EXPECT_NEAR(std::stod(row.at("order")), 2, 0.08) << name << ' ' << n;
    }
    EXPECT_EQ(row.at("command").rfind("nerf_bench error --curves quadrature ", 0), 0u);
  }
  ASSERT_EQ(first.size(), 16u);
  for (const auto& [name, error] : first) {
    const double order = std::log(error / last.at(name)) / std::log(16.0);
    const bool smooth = name.rfind("slab", 0) != 0 && name.rfind("two", 0) != 0;
    const bool jittered = name.ends_with("jittered");
    EXPECT_GT(order, smooth ? jittered ? 1.3 : 1.6 : 0.6) << name;
    EXPECT_LT(order, smooth ? jittered ? 1.8 : 2.3 : 1.9) << name;
  }
  for (const auto medium : apps::kMediumKinds)
    expect_svg(out / ("quadrature_" + std::string(apps::medium_name(medium)) + ".svg"));
  EXPECT_TRUE(fs::exists(out / "report.html"));

  // A row's command gives that row again, and no other, in another folder.
  expect_own_filters(rows,
                     [](const Row& row) { return row.at("medium") + ", " + row.at("sampling"); });
  const std::vector<std::vector<std::string>> commands = commands_of(rows);
  int taken = 0;
  for (size_t i = 0; i < rows.size(); ++i) {
    if (rows[i].at("evaluations") != "64" || rows[i].at("medium") != "slab") continue;
    const ProgramResult one = run_program(NERF_BENCH_PROGRAM, commands[i]);
    ASSERT_EQ(one.exit_code, 0) << one.err;
    const std::vector<Row> same = rows_of(folder.path() / "curves_again" / "quadrature.csv");
    ASSERT_EQ(same.size(), 1u) << rows[i].at("command");
    for (const char* column : {"medium", "sampling", "evaluations", "rms_error"})
      EXPECT_EQ(same[0].at(column), rows[i].at(column)) << column;
    ++taken;
  }
  EXPECT_EQ(taken, 4);
  EXPECT_EQ(rows_of(out / "quadrature.csv"), rows);
}

TEST(NerfBenchError, TrainingSkipsAndWidthOfATinyCapture) {
  TempFolder folder;
  test::write_blender_scene(folder.path() / "capture", 16);
  // Trained until the cache knows that the sphere is opaque: else there is nothing to stop at.
  const fs::path run = folder.path() / "run";
  const ProgramResult trained = run_program(
      NERF_TRAIN_PROGRAM, testing_apps::tiny({(folder.path() / "capture").string(), "-o",
                                              run.string(), "--split", "dev", "--steps", "400"}));
  ASSERT_EQ(trained.exit_code, 0) << trained.err;
  const fs::path out = folder.path() / "error";
  const ProgramResult result =
      run_program(NERF_BENCH_PROGRAM, {"error",        (folder.path() / "capture").string(),
                                       "--curves",     "training,skips,width",
                                       "--run",        run.string(),
                                       "--minutes",    "0.01",
                                       "--tables",     "12,14",
                                       "--precisions", "f32",
                                       "--widths",     "16,32",
                                       "--steps",      "5",
                                       "--views",      "1",
                                       "--repeats",    "1",
                                       "-o",           out.string()});
  ASSERT_EQ(result.exit_code, 0) << result.err;

  const std::vector<Row> training = rows_of(out / "training.csv");
  ASSERT_EQ(training.size(), 2u);
  EXPECT_EQ(training[0].at("log2_entries"), "12");
  EXPECT_EQ(training[1].at("log2_entries"), "14");
  EXPECT_EQ(training[0].at("precision"), "f32");
  const std::vector<Row> widths = rows_of(out / "width.csv");
  ASSERT_EQ(widths.size(), 2u);
  EXPECT_EQ(widths[1].at("width"), "32");
  for (const auto& rows : {training, widths})
    for (const Row& row : rows) {
      EXPECT_GT(std::stod(row.at("psnr")), 5);
      EXPECT_GT(std::stod(row.at("seconds")), 0);
      EXPECT_EQ(row.at("command").rfind("nerf_train ", 0), 0u) << row.at("command");
    }
  EXPECT_EQ(widths[0].at("steps"), "5");

  const std::vector<Row> skip_rows = rows_of(out / "skips.csv");
  std::map<std::string, Row> skips;
  for (const Row& row : skip_rows) skips[row.at("setting")] = row;
  expect_own_filters(skip_rows, [](const Row& row) { return row.at("setting"); });
  const auto number = [&](const std::string& setting, const char* column) {
    EXPECT_TRUE(skips.contains(setting)) << setting;
    return skips.contains(setting) ? std::stod(skips[setting].at(column)) : 0.0;
  };
  const std::string off = "every skip off";
  EXPECT_EQ(number(off, "rms_difference"), 0);
  EXPECT_EQ(number(off, "psnr_loss"), 0);
  EXPECT_EQ(number(off, "worst_psnr_loss"), 0);
  EXPECT_EQ(number(off, "density_evaluations"), 4 * number(off, "segments"));
  EXPECT_GT(number("every skip off, empty cells too", "density_evaluations"),
            2 * number(off, "density_evaluations"));
  // Of this capture no switch is without effect: a row that repeats another would be left out.
  expect_all_differ(skip_rows);
  std::vector<std::string> expected = {off, off + ", empty cells too"};
  if (bf16_unit() != Bf16Unit::kNone) expected.push_back("bf16");
  const auto expect_series = [&](const std::string& series,
                                 const std::vector<std::string>& values) {
    for (const std::string& value : values) expected.push_back(series + " " + value);
  };
  expect_series("unshaded", {"1/1024", "1/256", "1/64"});
  expect_series("shared colour", {"1/64", "1/32", "1/16", "1/8", "1/4"});
  expect_series("network's stop", {"1e-6", "1e-4", "1e-3", "1e-2"});
  expect_series("cache, factor", {"4", "2", "1.5", "1.25", "1", "0.5"});
  expect_series("cache, stop", {"1e-6", "1e-4", "1e-3"});
  expect_series("together, factor", {"2", "1.5", "1.25", "1", "0.75", "0.5"});
  expect_series("together, at most", {"32", "64", "192"});
  expect_series("together, spread", {"0.5", "1", "4"});
  expect_series("together, shared colour", {"1/64", "1/32", "1/16"});
  for (const std::string& name : expected) EXPECT_TRUE(skips.contains(name)) << name;
  EXPECT_EQ(skips.size(), expected.size());
  for (const auto& [name, row] : skips) {
    EXPECT_LT(std::stod(row.at("rms_difference")), 0.1) << name;
    // Of one view the worst is the mean.
    EXPECT_EQ(row.at("worst_psnr_loss"), row.at("psnr_loss")) << name;
  }

  const std::string page = read_text(out / "report.html");
  for (const char* chart :
       {"training", "skips_difference", "skips_psnr", "width", "width_seconds"}) {
    expect_svg(out / (std::string(chart) + ".svg"));
    EXPECT_NE(page.find(read_text(out / (std::string(chart) + ".svg"))), std::string::npos)
        << chart;
  }
  EXPECT_EQ(page.find("src="), std::string::npos);  // needs no other file

  // The skips again from the run alone, one row of them beside the reference.
  const fs::path again = folder.path() / "again";
  const ProgramResult one = run_program(
      NERF_BENCH_PROGRAM, {"error", "--curves", "skips", "--run", run.string(), "--views", "1",
                           "--repeats", "1", "--filter", "=unshaded 1/64", "-o", again.string()});
  ASSERT_EQ(one.exit_code, 0) << one.err;
  const std::vector<Row> same = rows_of(again / "skips.csv");
  ASSERT_EQ(same.size(), 2u);
  for (const char* column : {"rms_difference", "psnr", "segments", "colour_evaluations"})
    EXPECT_EQ(same[1].at(column), skips["unshaded 1/64"].at(column)) << column;
}

TEST(NerfBenchError, SkipsOfAPapersMethodAreThoseOfItsBakedCache) {
  TempFolder folder;
  test::write_blender_scene(folder.path() / "capture");
  const fs::path run = folder.path() / "run", out = folder.path() / "error";
  const auto skips = [&](const std::string& method, const std::string& steps,
                         const std::string& networks) {
    const ProgramResult trained =
        run_program(NERF_TRAIN_PROGRAM, {(folder.path() / "capture").string(),
                                         "-o",
                                         run.string(),
                                         "--overwrite",
                                         "--method",
                                         method,
                                         "--scale",
                                         "tiny",
                                         "--steps",
                                         steps,
                                         "--eval-every",
                                         "0",
                                         "--rate",
                                         "5e-3",
                                         networks,
                                         "--network-depth",
                                         "2",
                                         "--network-width",
                                         "16",
                                         "--network-bottleneck",
                                         "16",
                                         "--network-view-width",
                                         "16",
                                         "--network-position-degrees",
                                         "4",
                                         "--network-sampling-coarse",
                                         "16",
                                         "--network-sampling-fine",
                                         "16",
                                         "--recipe-rays",
                                         "96"});
    EXPECT_EQ(trained.exit_code, 0) << trained.err;
    const ProgramResult result =
        run_program(NERF_BENCH_PROGRAM, {"error", "--curves", "skips", "--run", run.string(),
                                         "--views", "1", "--repeats", "1", "-o", out.string()});
    EXPECT_EQ(result.exit_code, 0) << result.err;
    const std::vector<Row> rows = rows_of(out / "skips.csv");
    expect_all_differ(rows);
    std::map<std::string, Row> by_name;
    for (const Row& row : rows) by_name[row.at("setting")] = row;
    return by_name;
  };
  const bool in_bf16 = resolve_precision(Precision::kAuto) == Precision::kBf16;
  auto rows = skips("nerf", "200", "--network-shared");
  std::string page = read_text(out / "report.html");
  ASSERT_TRUE(rows.contains("every skip off") && rows.contains("cache"));
  EXPECT_LT(std::stoi(rows["cache"].at("density_evaluations")),
            std::stoi(rows["every skip off"].at("density_evaluations")));
  EXPECT_LT(std::stod(rows["cache"].at("rms_difference")), 0.01);
  EXPECT_NE(page.find("The cache says where the networks are empty: it was baked once, in "),
            std::string::npos);
  EXPECT_EQ(rows.contains("together"), in_bf16);
  EXPECT_EQ(page.find("The same as cache: together.") != std::string::npos, !in_bf16);

  // Of warped cones none is baked: what repeats the first row is left out and named.
  rows = skips("mipnerf360", "2", "--no-network-shared");
  page = read_text(out / "report.html");
  EXPECT_FALSE(rows.contains("cache"));
  EXPECT_NE(page.find("Of such a model no cache can be baked."), std::string::npos);
  EXPECT_NE(page.find("The same as every skip off: cache."), std::string::npos);
}

// That every switch does other work or gives other views, train/every_option_test.cc asserts.
TEST(NerfBenchError, SwitchesOfATinyCapture) {
  TempFolder folder;
  test::write_blender_scene(folder.path() / "capture");
  const auto switches = [&](const std::string& filter, const fs::path& out) {
    const ProgramResult result = run_program(
        NERF_BENCH_PROGRAM, {"error", (folder.path() / "capture").string(), "--curves", "switches",
                             "--steps", "5", "--filter", filter, "-o", out.string()});
    EXPECT_EQ(result.exit_code, 0) << result.err;
    std::map<std::string, Row> rows;
    for (const Row& row : rows_of(out / "switches.csv")) rows[row.at("setting")] = row;
    for (const auto& [name, row] : rows) {
      EXPECT_EQ(row.at("steps"), "5") << name;
      EXPECT_GT(std::stod(row.at("psnr")), 5) << name;
      EXPECT_GT(std::stod(row.at("samples")), 0) << name;
    }
    return rows;
  };
  const fs::path out = folder.path() / "error";
  auto rows = switches("distortion", out);
  // Of a bounded scene the distortion loss is off by default: a row that repeats the first one is
  // left out and named in the text.
  ASSERT_EQ(rows.size(), 2u);
  ASSERT_TRUE(rows.contains("as it is") && rows.contains("distortion 0.02"));
  EXPECT_NE(rows["distortion 0.02"].at("command").find("--distortion 0.02"), std::string::npos);
  const std::string page = read_text(out / "report.html");
  EXPECT_NE(page.find("The same as it is: distortion 0."), std::string::npos);
  EXPECT_EQ(page.find("The same as it is: distortion 0.02"), std::string::npos);
  expect_svg(out / "switches.svg");

  rows = switches("=a colour for each sample", folder.path() / "one");
  ASSERT_EQ(rows.size(), 2u);
  EXPECT_GT(std::stod(rows["a colour for each sample"].at("colours")),
            std::stod(rows["as it is"].at("colours")));
}

TEST(NerfBenchError, MistakesAreFoundBeforeAnythingIsWritten) {
  TempFolder folder;
  const std::string out = (folder.path() / "error").string();
  const auto refused = [&](std::vector<std::string> arguments,
                           const std::vector<std::string>& parts) {
    arguments.insert(arguments.begin(), "error");
    arguments.insert(arguments.end(), {"-o", out});
    expect_refused(run_program(NERF_BENCH_PROGRAM, arguments), "nerf_bench", parts);
    EXPECT_FALSE(fs::exists(out));
  };
  refused({}, {"training", "SCENE"});
  refused({"--curves", "quadratur"}, {"--curves", "quadratur", "quadrature"});
  refused({"--curves", "skips"}, {"skips", "--run"});
  refused({"--curves", "skips", "--run", folder.path().string()}, {"model.nerf", "--run"});
  refused({"--curves", "quadrature", "--samples", "7"}, {"--samples", "odd"});
  refused({"--curves", "quadrature", "--samples", "8,,16"}, {"--samples"});
  refused({"/nonexistent", "--tables", "9"}, {"--tables", "'9'", "10 to 24"});
  refused({"/nonexistent", "--precisions", "f16"}, {"--precisions", "'f16'", "bf16"});
  refused({"/nonexistent", "--minutes", "0"}, {"--minutes", "'0'"});
}

}  // namespace
}  // namespace nerf
