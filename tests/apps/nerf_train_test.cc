// nerf_train as a user runs it: what it writes, how it stops and goes on.
#include <algorithm>
#include <csignal>
#include <cstdlib>
#include <map>

#include "nerf/io/image.h"
#include "nerf/kernels/bf16.h"
#include "nerf/model/radiance_field.h"
#include "nerf/train/evaluation.h"
#include "nerf/train/metrics.h"
#include "nerf/train/run.h"
#include "nerf_train_fixture.h"
#include "train_options.h"

namespace nerf {
namespace {

namespace fs = std::filesystem;
using namespace testing_apps;

TEST_F(NerfTrain, WritesWhatItPromises) {
  const ProgramResult result =
      train(tiny({scene(), "-o", run_folder(), "--steps", "180", "--report-every", "60"}));
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_EQ(result.out, "");
  EXPECT_EQ(result.lines()[0].rfind("nerf_train ", 0), 0u);
  EXPECT_NE(result.lines()[0].find("thread"), std::string::npos);
  EXPECT_NE(result.lines()[0].find(precision_name(resolve_precision(Precision::kAuto))),
            std::string::npos);
  EXPECT_EQ(result.err.find('\r'), std::string::npos);  // plain lines into a pipe
  for (const char* part : {"Blender", "8 registered of 8", "memory", "100%", "PSNR", "written to"})
    expect_line(result, part);

  const auto json = nlohmann::json::parse(file("result.json"));
  EXPECT_EQ(json["steps"], 180);
  // Half of the squared error (3 dB) that a picture without anything in it has, and more alike.
  ThreadPool pool(1);
  double empty_psnr = 0, empty_ssim = 0;
  const test::SyntheticCapture made = test::sphere_capture(8, 32);
  for (const int v : made.scene.test) {
    const Image8 truth = photo_over(made.photos.photos[static_cast<size_t>(v)], Vec3{1, 1, 1});
    Image8 empty = truth;
    std::fill(empty.pixels.begin(), empty.pixels.end(), uint8_t{255});
    empty_psnr += psnr(truth, empty).value() / 2;
    empty_ssim += ssim(truth, empty, pool).value() / 2;
  }
  EXPECT_GT(json["psnr"].get<double>(), empty_psnr + 3);
  EXPECT_GT(json["ssim"].get<double>(), empty_ssim);
  EXPECT_GT(json["seconds"].get<double>(), 0);
  EXPECT_GT(json["samples_per_second"].get<double>(), 0);
  EXPECT_GT(json["peak_memory_bytes"].get<int64_t>(), 10 << 20);
  ASSERT_EQ(json["views"].size(), 2u);
  EXPECT_NE(json["views"][0]["name"].get<std::string>().find("r_100"), std::string::npos);
  double psnr = 0;
  for (const auto& view : json["views"]) psnr += view["psnr"].get<double>() / 2;
  EXPECT_NEAR(json["psnr"].get<double>(), psnr, 1e-9);

  EXPECT_EQ(steps_of_metrics(), (std::vector<int>{60, 120, 180}));
  EXPECT_NE(file("metrics.jsonl").find("\"kind\":\"evaluation\",\"step\":180"), std::string::npos);
  const auto options = nlohmann::json::parse(file("options.json"));
  EXPECT_EQ(options["steps"], 180);
  EXPECT_EQ(options["grid"]["levels"], 4);
  EXPECT_EQ(options["resume"], false);
  EXPECT_EQ(std::distance(fs::directory_iterator(fs::path(run_folder()) / "eval"), {}), 2);
  const RadianceField field = RadianceField::load(fs::path(run_folder()) / "model.nerf");
  ASSERT_EQ(field.info().views.size(), 8u);
  EXPECT_EQ(std::count_if(field.info().views.begin(), field.info().views.end(),
                          [](const ModelView& v) { return v.held_out; }),
            2);
}

// What it prints of the medium shows the scene as the model does by itself, to the six digits.
TEST_F(NerfTrain, TheMediumIsToldAsAnArgument) {
  const std::string demo = std::string(NERF_SOURCE_DIR) + "/data/demo";
  const ProgramResult result =
      train(tiny({demo, "-o", run_folder(), "--steps", "60", "--medium", "water"}));
  ASSERT_EQ(result.exit_code, 0) << result.err;
  const auto medium = nlohmann::json::parse(file("result.json"))["medium"];
  ASSERT_TRUE(medium.is_object());
  const std::string option = medium["option"];
  EXPECT_EQ(option.rfind("water,sigma=", 0), 0u);
  expect_line(result, "nerf_render RUN --medium " + option);
  EXPECT_NE(file("report.html").find("--medium " + option), std::string::npos);
  EXPECT_EQ(medium["backscatter"].size(), 3u);
  const auto pictures = [&](const std::string& name, const Arguments& more) {
    Arguments arguments{run_folder(), "-o", run_folder(name), "--size", "60x40", "--no-depth"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    const ProgramResult drawn = run_program(NERF_RENDER_PROGRAM, arguments);
    EXPECT_EQ(drawn.exit_code, 0) << drawn.err;
    std::map<std::string, std::vector<uint8_t>> all;
    for (const auto& entry : fs::recursive_directory_iterator(run_folder(name)))
      if (entry.path().extension() == ".png")
        all[entry.path().filename()] = read_image_8bit(entry.path()).pixels;
    return all;
  };
  const auto usual = pictures("usual", {}), told = pictures("told", {"--medium", option}),
             clear = pictures("clear", {"--medium", "off"});
  ASSERT_FALSE(usual.empty());
  ASSERT_EQ(told.size(), usual.size());
  int difference = 0, of_clear = 0;
  for (const auto& [name, pixels] : usual)
    for (size_t i = 0; i < pixels.size(); ++i) {
      difference = std::max(difference, std::abs(int{pixels[i]} - int{told.at(name)[i]}));
      of_clear = std::max(of_clear, std::abs(int{pixels[i]} - int{clear.at(name)[i]}));
    }
  EXPECT_LE(difference, 1);
  EXPECT_GT(of_clear, 3);
}

TEST_F(NerfTrain, ThreadsChangeNothingAndSeedsDo) {
  const std::string one = model_after("a", {"--steps", "30", "--threads", "1"});
  EXPECT_TRUE(one == model_after("b", {"--steps", "30", "--threads", "2"}));
  EXPECT_FALSE(one == model_after("c", {"--steps", "30", "--seed", "2"}));
}

TEST_F(NerfTrain, HoldoutNoneMeasuresNothing) {
  model_after("a run", {"--steps", "5", "--holdout", "none"});
  const auto json = nlohmann::json::parse(file("result.json"));
  EXPECT_TRUE(json["psnr"].is_null());
  EXPECT_TRUE(json["views"].empty());
  EXPECT_FALSE(fs::exists(fs::path(run_folder()) / "eval"));
}

TEST_F(NerfTrain, MinutesNameTheStepsThatRepeatThem) {
  const fs::path link = folder_.path() / "it's a scene";
  fs::create_directory_symlink(scene(), link);
  const std::string run = "it's a run";
  const ProgramResult result =
      train(tiny({link.string(), "-o", run_folder(run), "--minutes", "0.02"}));
  ASSERT_EQ(result.exit_code, 0) << result.err;
  const std::string command = printed_command(result, "the same result again: ");
  EXPECT_EQ(command.find("--minutes"), std::string::npos) << command;
  const ProgramResult repeated = Program("/bin/sh", in_shell(command)).wait();
  ASSERT_EQ(repeated.exit_code, 0) << repeated.err;
  EXPECT_TRUE(model(run) == model(run + "_again"));
}

TEST_F(NerfTrain, KilledAndResumedIsTheSameRun) {
  // A machine that has done all steps before the kill comes gets more of them.
  int steps = 300;
  for (;; steps *= 4) {
    ASSERT_LT(steps, 1000000);
    Program program(NERF_TRAIN_PROGRAM, tiny({scene(), "-o", run_folder(), "--overwrite", "--steps",
                                              std::to_string(steps), "--checkpoint-every", "0.002",
                                              "--report-every", "1", "--threads", "2"}));
    wait_for_checkpoint(program);
    kill(program.pid(), SIGKILL);
    const int code = program.wait().exit_code;
    if (code == 128 + SIGKILL && steps_of_metrics().back() < steps) break;
    ASSERT_TRUE(code == 0 || code == 128 + SIGKILL) << code;
  }
  EXPECT_FALSE(fs::exists(fs::path(run_folder()) / "result.json"));
  // Half a line, as a kill may leave it.
  testing_apps::write_text(fs::path(run_folder()) / "metrics.jsonl",
                           file("metrics.jsonl") + "{\"kind\":\"st");

  const ProgramResult resumed = train({"-o", run_folder(), "--resume", "--threads", "1"});
  ASSERT_EQ(resumed.exit_code, 0) << resumed.err;
  std::vector<int> every(static_cast<size_t>(steps));
  std::iota(every.begin(), every.end(), 1);
  EXPECT_EQ(steps_of_metrics(), every);
  EXPECT_TRUE(model() ==
              model_after("whole", {"--steps", std::to_string(steps), "--checkpoint-every", "0"}));
}

TEST_F(NerfTrain, SigtermSavesAndLeavesWithItsCode) {
  Program program(NERF_TRAIN_PROGRAM, tiny({scene(), "-o", run_folder(), "--steps", "100000000",
                                            "--checkpoint-every", "0.002", "--report-every", "1"}));
  wait_for_checkpoint(program);
  kill(program.pid(), SIGTERM);
  const ProgramResult result = program.wait();
  EXPECT_EQ(result.exit_code, 128 + SIGTERM) << result.err;
  expect_line(result, "stopped by SIGTERM at step ");
  EXPECT_TRUE(fs::exists(fs::path(run_folder()) / "model.nerf"));
  EXPECT_FALSE(fs::exists(fs::path(run_folder()) / "result.json"));
  // What it saved is from its last step.
  const int last = steps_of_metrics().back();
  Program again("/bin/sh", in_shell(printed_command(result, "to go on: ")));
  for (int i = 0; i < 1000 && steps_of_metrics().back() <= last; ++i)
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  kill(again.pid(), SIGINT);
  EXPECT_EQ(again.wait().exit_code, 128 + SIGINT);
  std::vector<int> every(static_cast<size_t>(steps_of_metrics().back()));
  std::iota(every.begin(), every.end(), 1);
  EXPECT_EQ(steps_of_metrics(), every);
}

TEST_F(NerfTrain, AFinishedRunIsExtendedAndRepeatedByTheCommandThatIsPrinted) {
  model_after("a run", {"--steps", "5", "--report-every", "1"});
  const ProgramResult longer = train({"-o", run_folder(), "--resume", "--steps", "12"});
  ASSERT_EQ(longer.exit_code, 0) << longer.err;
  expect_line(longer, "extended to 12 steps");
  EXPECT_EQ(nlohmann::json::parse(file("result.json"))["steps"], 12);
  EXPECT_EQ(nlohmann::json::parse(file("options.json"))["steps"], 12);
  std::vector<int> every(12);
  std::iota(every.begin(), every.end(), 1);
  EXPECT_EQ(steps_of_metrics(), every);
  // Now by minutes.
  const double seconds = nlohmann::json::parse(file("result.json"))["seconds"];
  const std::string minutes = std::to_string((seconds + 1) / 60);
  const ProgramResult timed = train({"-o", run_folder(), "--resume", "--minutes", minutes});
  ASSERT_EQ(timed.exit_code, 0) << timed.err;
  expect_line(timed, "extended to ");
  EXPECT_EQ(nlohmann::json::parse(file("options.json"))["minutes"], std::stod(minutes));
  const std::string command = printed_command(timed, "the same result again: ");
  EXPECT_NE(command.find("--plan-changes 5:5,12:12"), std::string::npos) << command;
  const ProgramResult again = run_program("/bin/sh", in_shell(command));
  ASSERT_EQ(again.exit_code, 0) << again.err;
  EXPECT_TRUE(model("a run") == model("a run_again"));
}

TEST_F(NerfTrain, AnExtendedRunThatIsKilledGoesOnToItsNewLength) {
  model_after("a run", {"--steps", "5", "--report-every", "1"});
  const auto run_until_killed = [&](Arguments more, int step) {
    more.insert(more.end(), {"-o", run_folder(), "--resume"});
    Program program(NERF_TRAIN_PROGRAM, more);
    for (int i = 0; i < 3000 && steps_of_metrics().back() < step; ++i)
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    EXPECT_FALSE(fs::exists(fs::path(run_folder()) / "result.json"));
    kill(program.pid(), SIGKILL);
    EXPECT_EQ(program.wait().exit_code, 128 + SIGKILL);
    EXPECT_GE(steps_of_metrics().back(), step);
  };
  run_until_killed({"--steps", "100000000"}, 6);
  EXPECT_EQ(nlohmann::json::parse(file("options.json"))["steps"], 100000000);
  run_until_killed({}, steps_of_metrics().back() + 1);
  run_until_killed({"--steps", "100000000"}, steps_of_metrics().back() + 1);
}

TEST_F(NerfTrain, ResumedWhenAllWasDoneItMeasuresAgain) {
  model_after("a run", {"--steps", "5"});
  const auto before = nlohmann::json::parse(file("result.json"));
  ASSERT_EQ(train({"-o", run_folder(), "--resume"}).exit_code, 0);
  const auto after = nlohmann::json::parse(file("result.json"));
  EXPECT_EQ(after["seconds"], before["seconds"]);
  EXPECT_EQ(after["views"], before["views"]);
  nlohmann::json last;
  std::istringstream lines(file("metrics.jsonl"));
  for (std::string line; std::getline(lines, line);) last = nlohmann::json::parse(line);
  EXPECT_EQ(last["kind"], "evaluation");
  EXPECT_EQ(last["step"], 5);
  EXPECT_EQ(last["seconds"], before["seconds"]);
  EXPECT_EQ(last["per_view"], before["views"]);
}

// A stand-in for colmap that hangs: the signal stops both, and nothing is left.
TEST_F(NerfTrain, SigtermStopsColmap) {
  const fs::path bin = folder_.path() / "bin", pid_file = folder_.path() / "pid";
  fs::create_directories(bin);
  testing_apps::write_text(bin / "colmap",
                           "#!/bin/sh\n[ \"$2\" = -h ] && exit 0\n"
                           "echo $$ > \"$STANDIN_PID\"\nexec sleep 100\n");
  fs::permissions(bin / "colmap", fs::perms{0755});
  const Arguments command = {"-c",
                             "PATH=" + apps::shell_quoted(bin.string()) + ":$PATH STANDIN_PID=" +
                                 apps::shell_quoted(pid_file.string()) + " exec \"$@\"",
                             "sh",
                             NERF_TRAIN_PROGRAM,
                             (fs::path(scene()) / "train").string(),
                             "-o",
                             run_folder()};
  Program program("/bin/sh", command);
  for (int i = 0; i < 3000 && testing_apps::read_text(pid_file).find('\n') == std::string::npos;
       ++i)
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  const std::string text = testing_apps::read_text(pid_file);
  ASSERT_NE(text.find('\n'), std::string::npos) << program.err_so_far();
  kill(program.pid(), SIGTERM);
  const ProgramResult result = program.wait();
  EXPECT_EQ(result.exit_code, 128 + SIGTERM) << result.err;
  expect_line(result, "stopped");
  EXPECT_EQ(kill(std::stoi(text), 0), -1);
  EXPECT_EQ(errno, ESRCH);
  EXPECT_FALSE(fs::exists(run_folder()));
}

}  // namespace
}  // namespace nerf
