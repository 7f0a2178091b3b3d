// nerf_train as a user runs it: what it refuses, and how it says so.
#include <algorithm>
#include <cerrno>

#include "nerf/train/run.h"
#include "nerf_train_fixture.h"
#include "support/sanitizers.h"

namespace nerf {
namespace {

namespace fs = std::filesystem;
using namespace testing_apps;

TEST_F(NerfTrain, ARunIsNotOverwrittenUnasked) {
  const std::string before = model_after("a run", {"--steps", "5"});
  expect_refused(train(tiny({scene(), "-o", run_folder(), "--steps", "6"})), "nerf_train",
                 {run_folder(), "holds a run", "--resume", "--overwrite"});
  EXPECT_TRUE(before == model());
  EXPECT_FALSE(before == model_after("a run", {"--steps", "6", "--overwrite"}));
}

TEST_F(NerfTrain, WhatHasNoEffectIsTold) {
  const ProgramResult result = train(tiny({scene(), "-o", run_folder(), "--steps", "2",
                                           "--camera-model", "OPENCV", "--holdout", "none"}));
  ASSERT_EQ(result.exit_code, 0) << result.err;
  expect_line(result, "warning: --camera-model is not used");
  expect_line(result, "warning: --eval-every and --eval-views are not used");  // tiny() has one
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
  for (const char* steps : {"4", "5"}) {
    const ProgramResult shorter = resume({"--steps", steps});
    EXPECT_EQ(shorter.exit_code, 2);
    expect_line(shorter, "the run is 5 steps long");
    expect_line(shorter, std::string(steps) + " steps is not longer");
  }
  expect_refused(resume({"--steps", "9", "--minutes", "1"}), "nerf_train",
                 {"--minutes and --steps exclude each other"});
  expect_refused(resume({"--grid-levels", "5"}), "nerf_train",
                 {"begun with --grid-levels 4, not 5"});
  expect_refused(resume({"--downscale", "2"}), "nerf_train", {"--downscale 0, not 2"});
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
  resume_with(changed, "checkpoint of version 7; this program reads version 6");
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
  const ProgramResult usual =
      train({scene(), "-o", run_folder("usual"), "--steps", "2", "--eval-every", "0", "--threads",
             "2", "--grid-finest-resolution", "2048"});  // what is estimated for any
  ASSERT_EQ(usual.exit_code, 0) << usual.err;
  const double used = peak("usual") - peak("tiny");
  const double estimate =
      static_cast<double>(training_memory_bytes(TrainOptions(), /*unbounded=*/false, 2));
  EXPECT_LE(used, estimate);
  // A moment's extra memory is counted in full, and arrays that two steps leave untouched too.
  EXPECT_GE(used, estimate / 3);
}
#endif

}  // namespace
}  // namespace nerf
