// RUN/report.html: that it shows what a run's folder holds, says what is missing, needs no other
// file, and that names from files stay text.
#include "run_report.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "html_page.h"
#include "light_notes.h"
#include "medium_notes.h"
#include "nerf/io/image.h"
#include "nerf_train_fixture.h"
#include "report_pictures.h"
#include "run_program.h"

namespace nerf {
namespace {

namespace fs = std::filesystem;
using testing_apps::expect_refused;
using testing_apps::ProgramResult;
using testing_apps::read_text;
using testing_apps::run_program;
using testing_apps::TempFolder;
using testing_apps::write_text;
using Json = nlohmann::json;

constexpr const char* kOddName = "</script><img src=x onerror=alert(1)>&\"'.jpg";

size_t count_of(const std::string& text, const std::string& part) {
  size_t n = 0;
  for (size_t at = text.find(part); at != std::string::npos; at = text.find(part, at + 1)) ++n;
  return n;
}

void expect_parts(const std::string& page, const std::vector<std::string>& parts) {
  for (const std::string& part : parts)
    EXPECT_NE(page.find(part), std::string::npos) << "lacks: " << part;
}

// Nothing is loaded: no address but the name of SVG's namespace, no file.
void expect_self_contained(std::string page) {
  const std::string space = "http://www.w3.org/2000/svg";
  for (size_t at = page.find(space); at != std::string::npos; at = page.find(space))
    page.erase(at, space.size());
  for (const char* part : {"http:", "https:", "<link", "@import", "url(", "src=\"/", "src=\"."})
    EXPECT_EQ(page.find(part), std::string::npos) << part;
  EXPECT_EQ(count_of(page, "src=\""), count_of(page, "src=\"data:image/jpeg;base64,"));
  EXPECT_NE(page.find("default-src 'none'"), std::string::npos);
}

// Photo, rendering and depth in a row, each of one grey.
Image8 row_of(int width, int height, uint8_t photo, uint8_t rendering) {
  Image8 image{3 * width + 8, height, 3, {}};
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < image.width; ++x) {
      const uint8_t v = x < width ? photo : x < 2 * width + 4 ? rendering : uint8_t{200};
      image.pixels.insert(image.pixels.end(), 3, v);
    }
  return image;
}

// A run's folder without a model, written by hand.
void write_run(const fs::path& run) {
  write_text(
      run / "options.json",
      Json{{"scene", kOddName}, {"method", "grid"}, {"rate", 0.125}, {"grid", {{"levels", 7}}}}
          .dump());
  std::string metrics;
  for (int step = 10; step <= 50; step += 10)
    metrics +=
        Json{{"kind", "step"},  {"step", step}, {"seconds", 0.1 * step},    {"loss", 1.0 / step},
             {"psnr", 20},      {"rays", 100},  {"samples", 1000},          {"colours", 250},
             {"learning", 400}, {"rows", 10},   {"samples_per_second", 1e6}}
            .dump() +
        "\n";
  write_text(run / "metrics.jsonl", metrics);
  write_text(run / "result.json", Json{{"psnr", 24.5},
                                       {"ssim", 0.75},
                                       {"seconds", 5.5},
                                       {"steps", 50},
                                       {"samples", 50000},
                                       {"peak_memory_bytes", 300 << 20},
                                       {"profile", {{"network", 2.25}}},
                                       {"views",
                                        {{{"name", kOddName},
                                          {"scale", 1},
                                          {"psnr", 24.5},
                                          {"ssim", 0.75},
                                          {"picture", "odd.png"},
                                          {"depth", {1.5, 9}}}}}}
                                      .dump());
  write_text(run / "notes.json", Json{{"command", "nerf_train a<b"},
                                      {"scene", {"scene         a & b"}},
                                      {"warnings", {"two <b>photos</b> are missing"}},
                                      {"printed", {"one", "warning: two"}}}
                                     .dump());
  fs::create_directories(run / "eval");
  write_image(run / "eval/odd.png", row_of(40, 30, 100, 130));
}

std::string report_of(const fs::path& run) {
  const ProgramResult result = run_program(NERF_BENCH_PROGRAM, {"report", run.string()});
  EXPECT_EQ(result.exit_code, 0) << result.err;
  EXPECT_EQ(result.out, (run / "report.html").string() + "\n");
  const std::string page = read_text(run / "report.html");
  EXPECT_TRUE(page.ends_with("</html>\n"));
  return page;
}

TEST(HtmlPage, Base64IsThatOfTheStandard) {
  // RFC 4648, section 10.
  const std::vector<std::pair<std::string, std::string>> cases = {{"", ""},
                                                                  {"f", "Zg=="},
                                                                  {"fo", "Zm8="},
                                                                  {"foo", "Zm9v"},
                                                                  {"foob", "Zm9vYg=="},
                                                                  {"fooba", "Zm9vYmE="},
                                                                  {"foobar", "Zm9vYmFy"}};
  for (const auto& [text, encoded] : cases)
    EXPECT_EQ(apps::base64(std::vector<uint8_t>(text.begin(), text.end())), encoded);
  EXPECT_EQ(apps::base64(std::vector<uint8_t>{255, 239, 190}), "/+++");
}

TEST(HtmlPage, DataStaysDataAndTextText) {
  const std::string json = Json{{"a", kOddName}}.dump();
  const std::string data = apps::html_data("d", json);
  EXPECT_EQ(count_of(data, "<"), 2u);  // of the element itself
  const size_t begin = data.find('>') + 1;
  EXPECT_EQ(Json::parse(data.substr(begin, data.rfind("</script>") - begin))["a"], kOddName);
  EXPECT_NE(apps::html_table({"<th>"}, {{kOddName}}).find("&lt;/script&gt;&lt;img"),
            std::string::npos);
  EXPECT_NE(apps::html_document({"<i>", ""}).find("<title>&lt;i&gt;</title>"), std::string::npos);
}

TEST(ReportPictures, ErrorsAreColoursOfTheMeanDifference) {
  const Image8 a{3, 1, 3, {10, 20, 30, 0, 0, 0, 9, 9, 9}};
  const Image8 b{3, 1, 3, {40, 20, 0, 51, 51, 51, 0, 0, 0}};  // means 20, 51, 9
  const Image8 error = apps::error_picture(a, b, {255, 255, 0});
  for (int k = 0; k < 3; ++k) {
    const auto byte = [&](double x) {
      return static_cast<int>(
          std::lround(255 * static_cast<double>(turbo_color(static_cast<Real>(x))[k])));
    };
    EXPECT_EQ(error.pixels[static_cast<size_t>(k)], byte(20 / 51.0));
    EXPECT_EQ(error.pixels[static_cast<size_t>(3 + k)], byte(1));
    EXPECT_EQ(error.pixels[static_cast<size_t>(6 + k)], 128);  // masked out
  }
}

TEST(ReportPictures, AreMeansOfBlocksAndWithinTheirBytes) {
  const Image8 image{5, 3, 1, {0, 2, 4, 6, 99, 4, 6, 8, 11, 99, 99, 99, 99, 99, 99}};
  const Image8 half = apps::reduced(image, 2);
  EXPECT_EQ(half.width, 2);
  EXPECT_EQ(half.height, 1);
  EXPECT_EQ(half.pixels, (std::vector<uint8_t>{3, 7}));  // 29 / 4 rounds to 7

  TempFolder folder;
  Image8 noise = row_of(1000, 40, 0, 0);
  for (size_t i = 0; i < noise.pixels.size(); ++i)
    noise.pixels[i] = static_cast<uint8_t>(i * i * 2654435761u >> 13);
  write_image(folder / "a.png", noise);
  const auto whole = apps::view_pictures(folder / "a.png", folder / "none.png", 1 << 30);
  EXPECT_EQ(whole.width, 1000);
  EXPECT_EQ(whole.factor, 2);  // 960 pixels at most
  const auto size = [](const apps::ViewPictures& p) {
    return p.photo.size() + p.rendering.size() + p.error.size() + p.depth.size();
  };
  const auto less = apps::view_pictures(folder / "a.png", folder / "none.png", size(whole) / 3);
  EXPECT_GT(less.factor, 2);
  EXPECT_LE(size(less), size(whole) / 3);
  write_image(folder / "b.png", Image8{7, 1, 3, std::vector<uint8_t>(21)});
  EXPECT_TRUE(test::contains(
      test::error_of([&] { apps::view_pictures(folder / "b.png", folder / "none.png", 1); }),
      "b.png"));
}

TEST(RunReport, ShowsWhatTheFolderHolds) {
  TempFolder folder;
  const fs::path run = folder / "a <run>";
  write_run(run);
  const std::string page = report_of(run);
  expect_self_contained(page);
  expect_parts(
      page, {"<title>Run a &lt;run&gt;</title>", "24.50 dB", "0.7500", "id=\"curves\"",
             "id=\"views\"", "id=\"time\"", "id=\"skipped\"", "id=\"options\"", "id=\"warnings\"",
             "id=\"scene\"", "two &lt;b&gt;photos&lt;/b&gt; are missing", "scene         a &amp; b",
             "nerf_train a&lt;b", "&lt;/script&gt;&lt;img src=x onerror=alert(1)&gt;&amp;",
             "<span class=\"warning\">warning: two</span>", "300 MB", "2.2 s",
             "model.nerf is missing", "1.5 (red) to 9 (blue)",
             // A quarter of 50000 samples had a colour of their own, two fifths learnt.
             "37.5 k colour evaluations", "30.0 k backward passes", "grid.levels", "rate"});
  EXPECT_EQ(page.find("<img src=x"), std::string::npos);
  EXPECT_EQ(count_of(page, "<figure data-part="), 4u);
  EXPECT_EQ(count_of(page, "</script>"), 1u);
  EXPECT_EQ(count_of(page, "<svg "), 4u);
  EXPECT_EQ(page.find("nan"), std::string::npos);
}

LightReport some_light() {
  LightReport light;
  light.photos = {{"plain.jpg", 0.04, 0.02, {}}, {kOddName, -0.75, {}, -0.8}};
  light.lenses = {{"a <lens>", 12, 0.44}, {"another", 9, -0.25, 0.013}};
  light.exif_factor = 0.91;
  light.exif_explained = 0.8;
  return light;
}

TEST(RunReport, ShowsTheLight) {
  TempFolder folder;
  const fs::path run = folder / "run";
  write_run(run);
  const auto none = report_of(run);
  EXPECT_EQ(none.find("id=\"light\""), std::string::npos);
  auto result = nlohmann::ordered_json::parse(read_text(run / "result.json"));
  result["light"] = apps::light_json(some_light());
  write_text(run / "result.json", result.dump());
  const std::string page = report_of(run);
  expect_self_contained(page);
  expect_parts(page, {"id=\"light\"", "a &lt;lens&gt;", "corners 0.4 stops darker", "learnt",
                      "corners 0.2 stops brighter", "sparse points, ±0.01", "+0.04", "-0.75",
                      "-0.80", "0.91 stops are shown for each that EXIF says", "80 %"});
  EXPECT_EQ(page.find("<img src=x"), std::string::npos);
  EXPECT_EQ(apps::light_json({}), nullptr);
  // Of another type, or of another program.
  for (const char* light : {"3", "{}", R"({"photos": 1, "lenses": [2, {"name": 3}]})",
                            R"({"photos": [{"shown_stops": "x"}], "exif_factor": []})"}) {
    result["light"] = nlohmann::ordered_json::parse(light);
    write_text(run / "result.json", result.dump());
    EXPECT_EQ(report_of(run).find("nan"), std::string::npos) << light;
  }
}

TEST(RunReport, ShowsTheMedium) {
  TempFolder folder;
  const fs::path run = folder / "run";
  write_run(run);
  EXPECT_EQ(report_of(run).find("id=\"medium\""), std::string::npos);
  Medium water;
  water.attenuation = {0.5, 0.25, 0.125};
  water.backscatter = {0.75, 0.5, 0.0625};
  water.colour = {0, 0.5_r, 1};
  auto result = nlohmann::ordered_json::parse(read_text(run / "result.json"));
  result["medium"] = apps::medium_json(water);
  write_text(run / "result.json", result.dump());
  const std::string page = report_of(run);
  expect_self_contained(page);
  const std::string option =
      "water,sigma=0.5,0.25,0.125,backscatter=0.75,0.5,0.0625,colour=0,0.5,1";
  expect_parts(page, {"id=\"medium\"", "attenuation", "0.0625", "--medium " + option});
  const auto lines = apps::medium_lines(water);
  ASSERT_EQ(lines.size(), 2u);
  EXPECT_TRUE(test::contains(lines[0], "attenuation 0.5, 0.25, 0.125, backscatter 0.75"));
  EXPECT_TRUE(test::contains(lines[1], "nerf_render RUN --medium " + option));
  // Of another type, or of another program.
  for (const char* medium : {"3", "{}", R"({"attenuation": 1, "colour": [1, "x"], "option": 3})"}) {
    result["medium"] = nlohmann::ordered_json::parse(medium);
    write_text(run / "result.json", result.dump());
    EXPECT_EQ(report_of(run).find("nan"), std::string::npos) << medium;
  }
}

TEST(LightNotes, AreLinesForTheScreen) {
  const auto lines = apps::light_lines(some_light());
  ASSERT_EQ(lines.size(), 4u);
  EXPECT_TRUE(test::contains(lines[0], "exposure    shown at sparse points: 0.40 stops"));
  EXPECT_TRUE(test::contains(lines[0], "+0.04 (plain.jpg)"));
  EXPECT_TRUE(test::contains(lines[1], "0.91 stops are shown"));
  EXPECT_EQ(lines[2],
            "vignetting  a <lens>, 12 photos: corners 0.4 stops darker than the middle "
            "(learnt)");
  EXPECT_TRUE(test::contains(lines[3], "(shown at sparse points, +-0.01)"));
  EXPECT_TRUE(apps::light_lines({}).empty());
  LightReport many = some_light();
  for (int i = 0; i < 5; ++i) many.lenses.push_back({"one", 1, 0});
  EXPECT_TRUE(test::contains(apps::light_lines(many).back(), "and 4 lenses more"));
}

TEST(RunReport, SaysWhatIsMissing) {
  TempFolder folder;
  const fs::path run = folder / "run";
  write_run(run);
  write_text(run / "metrics.jsonl", read_text(run / "metrics.jsonl") + "{\"kind\":\"st");
  write_text(run / "result.json", "{\"psnr\": 3");
  fs::remove(run / "notes.json");
  write_image(run / "eval/odd.png", Image8{7, 1, 3, std::vector<uint8_t>(21)});
  std::string page = report_of(run);
  expect_self_contained(page);
  expect_parts(page, {"id=\"missing\"", "notes.json is missing", "result.json cannot be read",
                      "1 line cannot be read", "model.nerf is missing",
                      "a held-out view is not shown", "id=\"curves\"", "id=\"options\""});
  EXPECT_EQ(page.find("<figure"), std::string::npos);
  // A picture alone, of a run that was stopped in its first evaluation; no other file is right.
  write_image(run / "eval/odd.png", row_of(40, 30, 100, 130));
  for (const char* file : {"metrics.jsonl", "options.json", "notes.json", "model.nerf"})
    write_text(run / file, "[1, 2]\n");
  page = report_of(run);
  EXPECT_EQ(count_of(page, "<figure data-part="), 4u);
  expect_parts(page, {"options.json cannot be read", "notes.json cannot be read",
                      "model.nerf cannot be read"});
  EXPECT_EQ(page.find("id=\"curves\""), std::string::npos);
}

TEST(RunReport, FieldsOfAnotherTypeAreNoHarm) {
  TempFolder folder;
  const fs::path run = folder / "run";
  write_run(run);
  write_text(run / "result.json",
             R"({"psnr": "x", "seconds": [1], "steps": null, "profile": 3, "samples": 1e300,
                 "views": [3, {"name": 4, "scale": -1e99, "psnr": {}, "depth": [1, "b"],
                 "picture": "../odd.png"}, {"picture": 5}], "peak_memory_bytes": {}})");
  write_text(run / "notes.json",
             R"({"command": 3, "scene": {}, "points": [1, 2, "x", 4, 5], "warnings": [1]})");
  write_text(run / "options.json", R"({"grid": 3, "method": [], "a": {"b": [1]}})");
  expect_self_contained(report_of(run));
}

TEST(RunReport, MistakesAreNamed) {
  TempFolder folder;
  const auto report = [&](const fs::path& run) {
    return run_program(NERF_BENCH_PROGRAM, {"report", run.string()});
  };
  expect_refused(report(folder / "none"), "nerf_bench", {"none", "no such folder"});
  write_text(folder / "file", "x");
  expect_refused(report(folder / "file"), "nerf_bench", {"is a file, not the folder of a run"});
  fs::create_directories(folder / "empty");
  expect_refused(report(folder / "empty"), "nerf_bench", {"empty", "holds no run"});
  EXPECT_FALSE(fs::exists(folder / "empty/report.html"));
  expect_refused(run_program(NERF_BENCH_PROGRAM, {"report"}), "nerf_bench", {"RUN"});
  // The page cannot be written: what stands in its place stays.
  write_run(folder / "run");
  fs::create_directories(folder / "run/report.html/x");
  expect_refused(report(folder / "run"), "nerf_bench", {"report.html"});
  EXPECT_TRUE(fs::exists(folder / "run/report.html/x"));
}

class TrainReport : public testing_apps::NerfTrain {};

TEST_F(TrainReport, IsWrittenAtTheEnd) {
  const ProgramResult result = train(testing_apps::tiny(
      {scene(), "-o", run_folder(), "--steps", "60", "--report-every", "10", "--threads", "1"}));
  ASSERT_EQ(result.exit_code, 0) << result.err;
  expect_line(result, "report      " + run_folder() + "/report.html");
  const std::string page = file("report.html");
  expect_self_contained(page);
  expect_parts(page,
               {"id=\"scene\"", "id=\"curves\"", "id=\"views\"", "id=\"space\"", "id=\"time\"",
                "id=\"skipped\"", "id=\"options\"", "id=\"printed\"", "Blender", "nerf_train ",
                "--report-every 10", "networks, forward and backward", "training cameras"});
  EXPECT_EQ(page.find("id=\"missing\""), std::string::npos);
  const Json json = Json::parse(file("result.json"));
  EXPECT_EQ(count_of(page, "<figure data-part="), 4 * json["views"].size());
  EXPECT_GT(json["profile"]["network"].get<double>(), 0);

  // Written anew it is the same, for any number of threads.
  EXPECT_EQ(report_of(run_folder()), page);
  run_program(NERF_BENCH_PROGRAM, {"report", run_folder(), "--threads", "2"});
  EXPECT_EQ(file("report.html"), page);

  // A run that begins anew leaves nothing of the old one; nothing is held out now.
  const ProgramResult again =
      train(testing_apps::tiny({scene(), "-o", run_folder(), "--overwrite", "--steps", "5",
                                "--holdout", "none", "--report-every", "1"}));
  ASSERT_EQ(again.exit_code, 0) << again.err;
  const std::string other = file("report.html");
  EXPECT_EQ(other.find("<figure"), std::string::npos);
  expect_parts(other, {"no held-out views were scored", "id=\"curves\"", "id=\"space\""});
}

TEST_F(TrainReport, ThatCannotBeWrittenIsAWarning) {
  fs::create_directories(fs::path(run_folder()) / "report.html/x");
  const ProgramResult result =
      train(testing_apps::tiny({scene(), "-o", run_folder(), "--steps", "5"}));
  EXPECT_EQ(result.exit_code, 0) << result.err;
  expect_line(result, "warning: the report is not written: ");
  EXPECT_FALSE(model().empty());
  EXPECT_FALSE(file("result.json").empty());
}

}  // namespace
}  // namespace nerf
