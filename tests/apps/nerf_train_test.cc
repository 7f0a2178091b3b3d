// nerf_train as a user runs it: what it writes, how it stops and goes on, and what it refuses.
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <nlohmann/json.hpp>
#include <numeric>
#include <thread>

#include "blender_scene.h"
#include "nerf/model/radiance_field.h"
#include "run_program.h"
#include "train_options.h"

namespace nerf {
namespace {

namespace fs = std::filesystem;
using testing_apps::expect_refused;
using testing_apps::Program;
using testing_apps::ProgramResult;
using testing_apps::TemporaryFolder;
using Arguments = std::vector<std::string>;

// Steps of milliseconds.
Arguments tiny(Arguments more = {}) {
  Arguments a = {"--batch-samples",
                 "4800",
                 "--grid-levels",
                 "4",
                 "--grid-log2-entries",
                 "12",
                 "--grid-base-resolution",
                 "8",
                 "--grid-occupancy-side",
                 "64",
                 "--grid-finest-resolution",
                 "64",
                 "--grid-hidden",
                 "16",
                 "--grid-colour-layers",
                 "1",
                 "--eval-every",
                 "0"};
  a.insert(a.end(), more.begin(), more.end());
  return a;
}

class NerfTrain : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    capture = new TemporaryFolder;
    test::write_blender_scene(capture->path());
  }
  static void TearDownTestSuite() { delete capture; }

  static std::string scene() { return capture->path().string(); }
  std::string run_folder(const std::string& name = "run") const {
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
  std::string model(const std::string& name = "run") const {
    return testing_apps::read_text(fs::path(run_folder(name)) / "model.nerf");
  }
  std::string file(const std::string& name, const std::string& run = "run") const {
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
  // Waits until the run has a checkpoint and some steps after it.
  void wait_for_checkpoint(const Program& program) const {
    const fs::path checkpoint = fs::path(run_folder()) / "checkpoint.nerf";
    for (int i = 0; i < 3000; ++i) {
      if (fs::exists(checkpoint) && steps_of_metrics().size() > 3) return;
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
    ADD_FAILURE() << "no checkpoint after a minute: " << program.err_so_far();
  }

  TemporaryFolder folder_;
  static inline TemporaryFolder* capture = nullptr;
};

TEST_F(NerfTrain, WritesWhatItPromises) {
  const ProgramResult result =
      train(tiny({scene(), "-o", run_folder(), "--steps", "60", "--report-every", "20"}));
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_EQ(result.out, "");
  EXPECT_EQ(result.lines()[0].rfind("nerf_train ", 0), 0u);
  EXPECT_NE(result.lines()[0].find("thread"), std::string::npos);
  EXPECT_NE(result.lines()[0].find("f32"), std::string::npos);
  EXPECT_EQ(result.err.find('\r'), std::string::npos);  // plain lines into a pipe
  for (const char* part : {"Blender", "8 registered of 8", "memory", "100%", "PSNR", "written to"})
    expect_line(result, part);

  const auto json = nlohmann::json::parse(file("result.json"));
  EXPECT_EQ(json["steps"], 60);
  EXPECT_GT(json["psnr"].get<double>(), 12);
  EXPECT_GT(json["ssim"].get<double>(), 0.1);
  EXPECT_GT(json["seconds"].get<double>(), 0);
  EXPECT_GT(json["samples_per_second"].get<double>(), 1000);
  EXPECT_GT(json["peak_memory_bytes"].get<int64_t>(), 10 << 20);
  ASSERT_EQ(json["views"].size(), 2u);
  EXPECT_NE(json["views"][0]["name"].get<std::string>().find("r_100"), std::string::npos);
  double psnr = 0;
  for (const auto& view : json["views"]) psnr += view["psnr"].get<double>() / 2;
  EXPECT_NEAR(json["psnr"].get<double>(), psnr, 1e-9);

  EXPECT_EQ(steps_of_metrics(), (std::vector<int>{20, 40, 60}));
  EXPECT_NE(file("metrics.jsonl").find("\"kind\":\"evaluation\",\"step\":60"), std::string::npos);
  const auto options = nlohmann::json::parse(file("options.json"));
  EXPECT_EQ(options["steps"], 60);
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
  model_after("run", {"--steps", "5", "--holdout", "none"});
  const auto json = nlohmann::json::parse(file("result.json"));
  EXPECT_TRUE(json["psnr"].is_null());
  EXPECT_TRUE(json["views"].empty());
  EXPECT_FALSE(fs::exists(fs::path(run_folder()) / "eval"));
}

TEST_F(NerfTrain, MinutesNameTheStepsThatRepeatThem) {
  const ProgramResult result = train(tiny({scene(), "-o", run_folder(), "--minutes", "0.02"}));
  ASSERT_EQ(result.exit_code, 0) << result.err;
  const std::string lead = "the same result again: nerf_train ";
  const size_t at = result.err.find(lead);
  ASSERT_NE(at, std::string::npos) << result.err;
  std::istringstream command(
      result.err.substr(at + lead.size(), result.err.find('\n', at) - at - lead.size()));
  Arguments again;
  for (std::string word; command >> word;) again.push_back(word);
  EXPECT_EQ(std::count(again.begin(), again.end(), "--minutes"), 0);
  const ProgramResult repeated = train(again);
  ASSERT_EQ(repeated.exit_code, 0) << repeated.err;
  EXPECT_TRUE(model() == model("run_again"));
}

TEST_F(NerfTrain, KilledAndResumedIsTheSameRun) {
  const Arguments arguments =
      tiny({scene(), "-o", run_folder(), "--steps", "600", "--checkpoint-every", "0.004",
            "--report-every", "1", "--threads", "2"});
  Program program(NERF_TRAIN_PROGRAM, arguments);
  wait_for_checkpoint(program);
  kill(program.pid(), SIGKILL);
  EXPECT_EQ(program.wait().exit_code, 128 + SIGKILL);
  EXPECT_FALSE(fs::exists(fs::path(run_folder()) / "result.json"));
  // Half a line, as a kill may leave it.
  testing_apps::write_text(fs::path(run_folder()) / "metrics.jsonl",
                           file("metrics.jsonl") + "{\"kind\":\"st");

  const ProgramResult resumed = train({"-o", run_folder(), "--resume", "--threads", "1"});
  ASSERT_EQ(resumed.exit_code, 0) << resumed.err;
  std::vector<int> every(600);
  std::iota(every.begin(), every.end(), 1);
  EXPECT_EQ(steps_of_metrics(), every);
  EXPECT_TRUE(model() == model_after("whole", {"--steps", "600", "--checkpoint-every", "0"}));
}

TEST_F(NerfTrain, SigtermSavesAndLeavesWithItsCode) {
  Program program(NERF_TRAIN_PROGRAM, tiny({scene(), "-o", run_folder(), "--steps", "100000000",
                                            "--checkpoint-every", "0.002", "--report-every", "1"}));
  wait_for_checkpoint(program);
  kill(program.pid(), SIGTERM);
  const ProgramResult result = program.wait();
  EXPECT_EQ(result.exit_code, 128 + SIGTERM) << result.err;
  expect_line(result, "stopped by SIGTERM at step ");
  expect_line(result, "nerf_train -o " + run_folder() + " --resume");
  EXPECT_TRUE(fs::exists(fs::path(run_folder()) / "model.nerf"));
  EXPECT_FALSE(fs::exists(fs::path(run_folder()) / "result.json"));
  // What it saved is from its last step.
  const int last = steps_of_metrics().back();
  Program again(NERF_TRAIN_PROGRAM, {"-o", run_folder(), "--resume"});
  for (int i = 0; i < 1000 && steps_of_metrics().back() <= last; ++i)
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  kill(again.pid(), SIGINT);
  EXPECT_EQ(again.wait().exit_code, 128 + SIGINT);
  std::vector<int> every(static_cast<size_t>(steps_of_metrics().back()));
  std::iota(every.begin(), every.end(), 1);
  EXPECT_EQ(steps_of_metrics(), every);
}

TEST_F(NerfTrain, ARunIsNotOverwrittenUnasked) {
  const std::string before = model_after("run", {"--steps", "5"});
  expect_refused(train(tiny({scene(), "-o", run_folder(), "--steps", "6"})), "nerf_train",
                 {run_folder(), "holds a run", "--resume", "--overwrite"});
  EXPECT_TRUE(before == model());
  EXPECT_FALSE(before == model_after("run", {"--steps", "6", "--overwrite"}));
}

TEST_F(NerfTrain, ResumeChecksItsOptions) {
  model_after("run", {"--steps", "5"});
  const auto resume = [&](Arguments more) {
    more.insert(more.end(), {"-o", run_folder(), "--resume"});
    return train(more);
  };
  EXPECT_EQ(resume({"--steps", "5"}).exit_code, 0);
  expect_refused(resume({"--steps", "9"}), "nerf_train", {"begun with --steps 5, not 9"});
  expect_refused(resume({"--grid-levels", "5"}), "nerf_train",
                 {"begun with --grid-levels 4, not 5"});
  expect_refused(resume({"--downscale", "2"}), "nerf_train", {"--downscale 1, not 2"});
  TemporaryFolder other;
  test::write_blender_scene(other.path(), 7);
  const ProgramResult result = resume({other.path().string()});
  EXPECT_EQ(result.exit_code, 2);
  expect_line(result, "another scene: the names of the images differ");
  expect_refused(train({scene(), "-o", run_folder("none"), "--resume"}), "nerf_train",
                 {run_folder("none"), "no run to resume"});
  EXPECT_FALSE(fs::exists(run_folder("none")));
}

TEST_F(NerfTrain, DamagedOrOtherCheckpointsAreRefused) {
  model_after("run", {"--steps", "5"});
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
  resume_with(changed, "checkpoint of version 7; this program reads version 1");
  changed = good;
  changed[good.size() / 2] ^= 1;
  resume_with(changed, "checksum");
  resume_with(good.substr(0, good.size() / 2), "truncated");
  resume_with("", "is not a checkpoint");
}

TEST_F(NerfTrain, AFullDiskLeavesTheLastCheckpoint) {
  model_after("run", {"--steps", "5"});
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
  EXPECT_FALSE(fs::exists(run));
}

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
  TemporaryFolder folder;
  fs::create_directories(folder.path() / "garden.v2");
  EXPECT_EQ(apps::default_run_folder(folder.path() / "garden.v2"), "runs/garden.v2");
  EXPECT_EQ(apps::default_run_folder(folder.path() / "garden.v2/"), "runs/garden.v2");
  EXPECT_EQ(apps::default_run_folder(folder.path() / "walk.mp4"), "runs/walk");
}

}  // namespace
}  // namespace nerf
