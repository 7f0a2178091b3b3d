// nerf_bench error: that its files are there and whole, and that its curves show what they must.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <set>

#include "blender_scene.h"
#include "chart.h"
#include "csv.h"
#include "error_bench.h"
#include "nerf/kernels/bf16.h"
#include "nerf_train_fixture.h"
#include "quadrature.h"
#include "run_program.h"

namespace nerf {
namespace {

namespace fs = std::filesystem;
using testing_apps::csv_rows;
using testing_apps::expect_refused;
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

void expect_svg(const fs::path& file) {
  const std::string svg = read_text(file);
  EXPECT_EQ(svg.rfind("<svg ", 0), 0u) << file;
  EXPECT_TRUE(svg.ends_with("</svg>\n")) << file;
  EXPECT_EQ(svg.find("nan"), std::string::npos) << file;
  EXPECT_EQ(svg.find("inf"), std::string::npos) << file;
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
  const ProgramResult result = run_program(
      NERF_BENCH_PROGRAM, {"error", "--curves", "quadrature", "--samples", "16,32,64,128,256",
                           "--rays", "300", "-o", folder.path().string()});
  ASSERT_EQ(result.exit_code, 0) << result.err;
  const std::vector<Row> rows = rows_of(folder.path() / "quadrature.csv");
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
    expect_svg(folder.path() / ("quadrature_" + std::string(apps::medium_name(medium)) + ".svg"));
  EXPECT_TRUE(fs::exists(folder.path() / "report.html"));

  // A row's command gives that row again, and no other.
  expect_own_filters(
      rows, [](const Row& row) { return row.at("medium") + ", " + row.at("sampling"); });
  const std::vector<std::vector<std::string>> commands = commands_of(rows);
  int taken = 0;
  for (size_t i = 0; i < rows.size(); ++i) {
    if (rows[i].at("evaluations") != "64" || rows[i].at("medium") != "slab") continue;
    const ProgramResult one = run_program(NERF_BENCH_PROGRAM, commands[i]);
    ASSERT_EQ(one.exit_code, 0) << one.err;
    const std::vector<Row> same = rows_of(folder.path() / "quadrature.csv");
    ASSERT_EQ(same.size(), 1u) << rows[i].at("command");
    for (const char* column : {"medium", "sampling", "evaluations", "rms_error"})
      EXPECT_EQ(same[0].at(column), rows[i].at(column)) << column;
    ++taken;
  }
  EXPECT_EQ(taken, 4);
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
  // Whether a setting does other work than another one, or gives another picture.
  const auto differ = [&](const std::string& a, const std::string& b) {
    for (const char* column :
         {"segments", "density_evaluations", "colour_evaluations", "rms_difference"})
      if (number(a, column) != number(b, column)) return true;
    return false;
  };
  const std::string off = "every skip off";
  EXPECT_EQ(number(off, "rms_difference"), 0);
  EXPECT_EQ(number(off, "psnr_loss"), 0);
  EXPECT_EQ(number(off, "worst_psnr_loss"), 0);
  EXPECT_EQ(number(off, "density_evaluations"), 4 * number(off, "segments"));
  EXPECT_GT(number("every skip off, empty cells too", "density_evaluations"),
            2 * number(off, "density_evaluations"));
  EXPECT_TRUE(differ("unshaded 1/1024", off));
  EXPECT_TRUE(differ("unshaded 1/64", "unshaded 1/1024"));
  EXPECT_TRUE(differ("shared colour 1/32", off));
  EXPECT_TRUE(differ("shared colour 1/4", "shared colour 1/32"));
  EXPECT_TRUE(differ("network's stop 1e-2", "network's stop 1e-6"));
  EXPECT_EQ(skips.contains("bf16"), bf16_unit() != Bf16Unit::kNone);
  if (skips.contains("bf16")) {
    EXPECT_TRUE(differ("bf16", off));
  }
  EXPECT_TRUE(differ("cache, factor 4", off));
  EXPECT_TRUE(differ("cache, factor 0.5", "cache, factor 4"));
  EXPECT_TRUE(differ("cache, stop 1e-3", "cache, factor 0.85"));
  EXPECT_TRUE(differ("cache, stop 1e-3", "cache, stop 1e-4"));
  EXPECT_TRUE(differ("cache, stop 1e-4", "cache, stop 1e-6"));
  EXPECT_TRUE(differ("together, factor 0.85", "together, factor 1"));
  EXPECT_TRUE(differ("together, factor 1.5", "cache, factor 1.5"));
  EXPECT_TRUE(differ("together, factor 0.5", "together, factor 2"));
  EXPECT_TRUE(differ("together, spread 0.5", "together, spread 4"));
  EXPECT_TRUE(differ("together, shared colour 1/8", "together, shared colour 1/64"));
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

// That every switch does other work or gives other views, train/grid_switches_test.cc asserts.
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

TEST(Chart, TicksAreRoundAndWithinTheAxis) {
  using apps::axis_ticks;
  EXPECT_EQ(axis_ticks(0, 10, false), (std::vector<double>{0, 2, 4, 6, 8, 10}));
  EXPECT_EQ(axis_ticks(-1, 1, false), (std::vector<double>{-1, -0.5, 0, 0.5, 1}));
  EXPECT_EQ(axis_ticks(1, 1000, true), (std::vector<double>{1, 10, 100, 1000}));
  for (const bool log : {false, true})
    for (const auto& [low, high] :
         {std::pair{3.0, 3.3}, {0.012, 950.0}, {1e-9, 1e6}, {7.0, 60.0}}) {
      const std::vector<double> ticks = axis_ticks(low, high, log);
      EXPECT_GE(ticks.size(), 2u) << low << ' ' << high;
      EXPECT_LE(ticks.size(), 12u) << low << ' ' << high;
      for (const double t : ticks) EXPECT_TRUE(t >= low && t <= high * (1 + 1e-9)) << t;
    }
}

TEST(Chart, DrawsWhateverTheValuesAre) {
  TempFolder folder;
  apps::Chart chart;
  chart.title = "a < b & \"c\"";
  chart.x.log = chart.y.log = true;
  const auto drawn = [&] {
    testing_apps::write_text(folder.path() / "chart.svg", apps::svg_text(chart));
    expect_svg(folder.path() / "chart.svg");
    return apps::svg_text(chart);
  };
  EXPECT_NE(drawn().find("a &lt; b &amp; &quot;c&quot;"), std::string::npos);
  chart.series = {{"empty", {}, true}, {"one", {{5, 5, "<label>"}}, true}};
  EXPECT_NE(drawn().find("&lt;label&gt;"), std::string::npos);
  // Values that a logarithm has no place for are left out, the others drawn.
  chart.series = {{"some", {{0, 1, ""}, {1, 0, ""}, {2, 3, ""}, {4, NAN, ""}, {8, 1, ""}}, true}};
  drawn();
  chart.x.log = chart.y.log = false;
  drawn();
}

}  // namespace
}  // namespace nerf
