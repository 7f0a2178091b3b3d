// nerf_train as a user runs it: what it writes, how it stops and goes on, and what it refuses.
#include <gtest/gtest.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <nlohmann/json.hpp>
#include <numeric>
#include <thread>

#include "app.h"
#include "blender_scene.h"
#include "nerf/model/radiance_field.h"
#include "nerf/train/evaluation.h"
#include "nerf/train/metrics.h"
#include "nerf/train/run.h"
#include "run_program.h"
#include "support/sanitizers.h"
#include "support/tiny_options.h"
#include "train_options.h"

namespace nerf {
namespace {

namespace fs = std::filesystem;
using testing_apps::expect_refused;
using testing_apps::Program;
using testing_apps::ProgramResult;
using testing_apps::TempFolder;
using Arguments = std::vector<std::string>;

// The options of support/tiny_options.h as arguments, and no evaluation but the last.
Arguments tiny(Arguments more = {}) {
  TrainOptions options = test::tiny_options(0), usual;
  const auto fields = option_fields(options), defaults = option_fields(usual);
  Arguments a = {"--eval-every", "0"};
  for (size_t i = 0; i < fields.size(); ++i)
    if (option_text(fields[i]) != option_text(defaults[i]))
      a.insert(a.end(), {option_flag(fields[i]), option_text(fields[i])});
  a.insert(a.end(), more.begin(), more.end());
  return a;
}

class NerfTrain : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    capture = new TempFolder;
    test::write_blender_scene(capture->path());
  }
  static void TearDownTestSuite() { delete capture; }

  static std::string scene() { return capture->path().string(); }
  std::string run_folder(const std::string& name = "a run") const {
    return (folder_.path() / name).string();
  }
  static ProgramResult train(const Arguments& arguments) {
    return testing_apps::run_program(NERF_TRAIN_PROGRAM, arguments);
  }
  // A run of so many steps in the folder of that name; its model.
  std::string model_after(const std::string& name, const Arguments& more) {
    Arguments arguments = tiny({scene(), "-o", run_folder(name)});
    arguments.insert(arguments.end(), more.begin(), more.end());
    const ProgramResult result = train(arguments);
    EXPECT_EQ(result.exit_code, 0) << result.err;
    return model(name);
  }
  std::string model(const std::string& name = "a run") const {
    return testing_apps::read_text(fs::path(run_folder(name)) / "model.nerf");
  }
  std::string file(const std::string& name, const std::string& run = "a run") const {
    return testing_apps::read_text(fs::path(run_folder(run)) / name);
  }
  static void expect_line(const ProgramResult& result, const std::string& part) {
    EXPECT_NE(result.err.find(part), std::string::npos) << result.err << "\nlacks: " << part;
  }
  // The steps of the lines of metrics.jsonl.
  std::vector<int> steps_of_metrics() const {
    std::vector<int> steps;
    std::istringstream lines(file("metrics.jsonl"));
    for (std::string line; std::getline(lines, line);) {
      const auto json = nlohmann::json::parse(line, nullptr, false);
      if (json.is_object() && json["kind"] == "step") steps.push_back(json["step"]);
    }
    return steps;
  }
  // The command that the program printed behind `lead`, to the line's end.
  static std::string printed_command(const ProgramResult& result, const std::string& lead) {
    const size_t at = result.err.find(lead + "nerf_train ");
    EXPECT_NE(at, std::string::npos) << result.err;
    if (at == std::string::npos) return "false";
    const size_t begin = at + lead.size();
    return result.err.substr(begin, result.err.find('\n', begin) - begin);
  }
  // Arguments for /bin/sh that make it the command, with this build's programs in PATH.
  static Arguments in_shell(const std::string& command) {
    const std::string programs = fs::path(NERF_TRAIN_PROGRAM).parent_path().string();
    return {"-c", "PATH=" + apps::shell_quoted(programs) + ":$PATH; exec " + command};
  }
  // Waits until the run has a checkpoint and some steps after it.
  void wait_for_checkpoint(const Program& program) const {
    const fs::path checkpoint = fs::path(run_folder()) / "checkpoint.nerf";
    for (int i = 0; i < 3000; ++i) {
      if (fs::exists(checkpoint) && steps_of_metrics().size() > 3) return;
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
    ADD_FAILURE() << "no checkpoint after a minute: " << program.err_so_far();
  }

  TempFolder folder_;
  static inline TempFolder* capture = nullptr;
};

TEST_F(NerfTrain, WritesWhatItPromises) {
  const ProgramResult result =
      train(tiny({scene(), "-o", run_folder(), "--steps", "180", "--report-every", "60"}));
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_EQ(result.out, "");
  EXPECT_EQ(result.lines()[0].rfind("nerf_train ", 0), 0u);
  EXPECT_NE(result.lines()[0].find("thread"), std::string::npos);
  EXPECT_NE(result.lines()[0].find("f32"), std::string::npos);
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

TEST_F(NerfTrain, ARunIsNotOverwrittenUnasked) {
  const std::string before = model_after("a run", {"--steps", "5"});
  expect_refused(train(tiny({scene(), "-o", run_folder(), "--steps", "6"})), "nerf_train",
                 {run_folder(), "holds a run", "--resume", "--overwrite"});
  EXPECT_TRUE(before == model());
  EXPECT_FALSE(before == model_after("a run", {"--steps", "6", "--overwrite"}));
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

TEST_F(NerfTrain, WhatHasNoEffectIsTold) {
  const ProgramResult result = train(tiny({scene(), "-o", run_folder(), "--steps", "2",
                                           "--camera-model", "OPENCV", "--holdout", "none"}));
  ASSERT_EQ(result.exit_code, 0) << result.err;
  expect_line(result, "warning: --camera-model is not used");
  expect_line(result, "warning: --eval-every and --eval-views are not used");  // tiny() has one
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

TEST_F(NerfTrain, AFailedColmapLeavesNoEmptyFolder) {
  const fs::path bin = folder_.path() / "bin";
  fs::create_directories(bin);
  testing_apps::write_text(bin / "colmap", "#!/bin/sh\necho the reason\nexit 7\n");
  fs::permissions(bin / "colmap", fs::perms{0755});
  const ProgramResult result = testing_apps::run_program(
      "/bin/sh", {"-c", "PATH=" + apps::shell_quoted(bin.string()) + ":$PATH exec \"$@\"", "sh",
                  NERF_TRAIN_PROGRAM, (fs::path(scene()) / "train").string(), "-o", run_folder()});
  EXPECT_EQ(result.exit_code, 2) << result.err;
  expect_line(result, "the reason");
  EXPECT_FALSE(fs::exists(run_folder()));
}

TEST_F(NerfTrain, ResumeChecksItsOptions) {
  model_after("a run", {"--steps", "5"});
  const auto resume = [&](Arguments more) {
    more.insert(more.end(), {"-o", run_folder(), "--resume"});
    return train(more);
  };
  EXPECT_EQ(resume({"--steps", "5"}).exit_code, 0);
  expect_refused(resume({"--steps", "9"}), "nerf_train", {"begun with --steps 5, not 9"});
  expect_refused(resume({"--grid-levels", "5"}), "nerf_train",
                 {"begun with --grid-levels 4, not 5"});
  expect_refused(resume({"--downscale", "2"}), "nerf_train", {"--downscale 1, not 2"});
  TempFolder other;
  test::write_blender_scene(other.path(), 7);
  const ProgramResult result = resume({other.path().string()});
  EXPECT_EQ(result.exit_code, 2);
  expect_line(result, "another scene: the names of the images differ");
  expect_refused(train({scene(), "-o", run_folder("none"), "--resume"}), "nerf_train",
                 {run_folder("none"), "no run to resume"});
  EXPECT_FALSE(fs::exists(run_folder("none")));
}

TEST_F(NerfTrain, DamagedOrOtherCheckpointsAreRefused) {
  model_after("a run", {"--steps", "5"});
  const fs::path path = fs::path(run_folder()) / "checkpoint.nerf";
  const std::string good = testing_apps::read_text(path);
  const auto resume_with = [&](const std::string& bytes, const std::string& part) {
    testing_apps::write_text(path, bytes);
    const ProgramResult result = train({"-o", run_folder(), "--resume"});
    EXPECT_EQ(result.exit_code, 2) << result.err;
    expect_line(result, "nerf_train: " + path.string());
    expect_line(result, part);
  };
  std::string changed = good;
  changed[8] = 7;
  resume_with(changed, "checkpoint of version 7; this program reads version 2");
  changed = good;
  changed[good.size() / 2] ^= 1;
  resume_with(changed, "checksum");
  resume_with(changed, "begin the run anew with --overwrite");
  resume_with(good.substr(0, good.size() / 2), "truncated");
  resume_with("", "is not a checkpoint");
}

TEST_F(NerfTrain, AFullDiskLeavesTheLastCheckpoint) {
  model_after("a run", {"--steps", "5"});
  const std::string before = file("checkpoint.nerf");
  // Room for the small files, not for a checkpoint (in units of 1024 bytes).
  const ProgramResult result =
      testing_apps::run_program("/bin/bash", {"-c", "ulimit -f 1000; exec \"$@\"", "bash",
                                              NERF_TRAIN_PROGRAM, "-o", run_folder(), "--resume"});
  EXPECT_EQ(result.exit_code, 2) << result.err;
  expect_line(result, "nerf_train: " + run_folder() + "/checkpoint.nerf: cannot write");
  EXPECT_TRUE(before == file("checkpoint.nerf"));
  for (const auto& entry : fs::recursive_directory_iterator(run_folder()))
    EXPECT_EQ(entry.path().string().find(".tmp"), std::string::npos) << entry.path();
}

TEST_F(NerfTrain, MistakesAreOneLine) {
  const std::string run = run_folder();
  expect_refused(train({}), "nerf_train", {"SCENE is missing"});
  expect_refused(train({"/nonexistent/capture", "-o", run}), "nerf_train",
                 {"/nonexistent/capture"});
  EXPECT_FALSE(fs::exists(run));
  fs::create_directories(folder_.path() / "empty");
  EXPECT_EQ(train({(folder_.path() / "empty").string(), "-o", run}).exit_code, 2);
  EXPECT_FALSE(fs::exists(run));
  expect_refused(train({scene(), "-o", "/dev/null/run"}), "nerf_train", {"/dev/null/run"});
  expect_refused(train({scene(), "-o", run, "--step", "5"}), "nerf_train",
                 {"--step", "did you mean --steps?"});
  expect_refused(train({scene(), "-o", run, "--steps", "many"}), "nerf_train", {"--steps"});
  expect_refused(train({scene(), "-o", run, "--grid-levels", "99"}), "nerf_train",
                 {"--grid-levels"});
  expect_refused(train({scene(), "-o", run, "--split", "tset"}), "nerf_train", {"--split", "test"});
  expect_refused(train({scene(), "-o", run, "--steps", "5", "--minutes", "1"}), "nerf_train",
                 {"--minutes", "--steps"});
  expect_refused(train({scene(), "-o", run, "--resume", "--overwrite"}), "nerf_train",
                 {"--resume", "--overwrite"});
  expect_refused(train({scene(), "-o", run, "--steps", "0"}), "nerf_train",
                 {"--steps: a training has at least one step"});
  expect_refused(train({scene(), "-o", run, "--grid-occupancy-side", "40"}), "nerf_train",
                 {"--grid-occupancy-side: 40 is no multiple of 16"});
  expect_refused(train({scene(), "-o", run, "--grid-finest-resolution", "8"}), "nerf_train",
                 {"--grid-finest-resolution: 8 is less than --grid-base-resolution 16"});
  expect_refused(train({scene(), "-o", run, "--camera-model", "OPENCVV"}), "nerf_train",
                 {"--camera-model", "OPENCVV", "did you mean OPENCV"});
  EXPECT_FALSE(fs::exists(run));
}

#ifndef NERF_SANITIZED  // their shadow memory does not fit under ulimit -v
TEST_F(NerfTrain, MemoryIsCheckedBeforePhotosAreDecoded) {
  const ProgramResult result = testing_apps::run_program(
      "/bin/bash", {"-c", "ulimit -v 2000000; exec \"$@\"", "bash", NERF_TRAIN_PROGRAM, scene(),
                    "-o", run_folder(), "--grid-log2-entries", "22", "--grid-levels", "16"});
  EXPECT_EQ(result.exit_code, 2) << result.err;
  expect_line(result, "training needs about");
  expect_line(result, "may use 1953 MB");
  EXPECT_EQ(result.err.find("decoding"), std::string::npos) << result.err;
  EXPECT_FALSE(fs::exists(run_folder()));
}

// The trainer of the default options against one too small to matter: what is between their peaks
// is the trainer's, resume included.
TEST_F(NerfTrain, MemoryEstimateHoldsWhatIsUsed) {
  const auto peak = [&](const std::string& run) {
    const ProgramResult resumed = train({"-o", run_folder(run), "--resume"});
    EXPECT_EQ(resumed.exit_code, 0) << resumed.err;
    return nlohmann::json::parse(file("result.json", run))["peak_memory_bytes"].get<double>();
  };
  model_after("tiny", {"--steps", "2"});
  const ProgramResult usual = train(
      {scene(), "-o", run_folder("usual"), "--steps", "2", "--eval-every", "0", "--threads", "2"});
  ASSERT_EQ(usual.exit_code, 0) << usual.err;
  const double used = peak("usual") - peak("tiny");
  const double estimate =
      static_cast<double>(training_memory_bytes(TrainOptions(), /*unbounded=*/false, 2));
  EXPECT_LE(used, estimate);
  // A moment's extra memory is counted in full, and arrays that two steps leave untouched too.
  EXPECT_GE(used, estimate / 3);
}
#endif

TEST(TrainOptionsText, EquivalentCommandKeepsWhatWasGiven) {
  apps::TrainCommand command;
  command.scene = "my photos/it's";
  command.minutes = 3;
  command.downscale = 2;
  command.train.rate = 0.5;
  EXPECT_EQ(apps::equivalent_command(command, 77),
            "nerf_train 'my photos/it'\\''s' --downscale 2 --rate 0.5 --steps 77");
}

TEST(TrainOptionsText, DefaultRunFolderIsNamedAfterTheScene) {
  TempFolder folder;
  fs::create_directories(folder.path() / "garden.v2");
  EXPECT_EQ(apps::default_run_folder(folder.path() / "garden.v2"), "runs/garden.v2");
  EXPECT_EQ(apps::default_run_folder(folder.path() / "garden.v2/"), "runs/garden.v2");
  EXPECT_EQ(apps::default_run_folder(folder.path() / "walk.mp4"), "runs/walk");
}

}  // namespace
}  // namespace nerf
