#include "io/scene_times.h"

#include <gtest/gtest.h>

#include "io/scene_input.h"
#include "nerf/io/scene.h"
#include "support/temp_folder.h"
#include "test_scenes.h"

namespace nerf::internal {
namespace {

using namespace nerf::test;

SceneInput named(const std::vector<std::string>& names) {
  SceneInput input;
  for (const std::string& name : names) {
    input.views.emplace_back();
    input.views.back().name = name;
  }
  return input;
}

struct Settled {
  std::vector<double> times;
  CaptureTimes unit;
  SceneReport report;
};

Settled settle(SceneInput input, const std::string& option,
               SceneFormat format = SceneFormat::kColmap) {
  SceneOptions options;
  options.times = option;
  options.format = format;
  Settled settled;
  settled.unit = settle_times(input, options, settled.report);
  for (const View& view : input.views) settled.times.push_back(view.time);
  return settled;
}

std::string settle_error(const SceneInput& input, const std::string& option) {
  return error_of([&] { settle(input, option); });
}

using Times = std::vector<double>;

TEST(SceneTimes, OrderOfTheFrames) {
  const Settled s = settle(named({"a/1.png", "a/10.png", "a/9.png", "b/1.png"}), "frame");
  EXPECT_EQ(s.times, (Times{0, 1, 0.5, 0}));
  EXPECT_EQ(s.unit.to_unit(0.5), 1);
  EXPECT_EQ(s.report.times, "3 moments, 0 to 2 (order of the frames)");
  // Each split of Blender's files runs over all times.
  EXPECT_EQ(settle(named({"test/0.png", "test/1.png", "train/0.png", "train/1.png", "train/2.png"}),
                   "frame", SceneFormat::kBlender)
                .times,
            (Times{0, 1, 0, 0.5, 1}));
}

TEST(SceneTimes, NumbersInTheNames) {
  const Settled s =
      settle(named({"cam1/left_000030.png", "cam2_t12.5.jpg", "cam3_20x.jpg"}), "name");
  EXPECT_EQ(s.times, (Times{1, 0, 7.5 / 17.5}));
  EXPECT_EQ(s.unit.first, 12.5);
  EXPECT_EQ(s.unit.last, 30);
  EXPECT_EQ(s.report.times, "3 moments, 12.5 to 30 (numbers in the names)");
  EXPECT_TRUE(contains(settle_error(named({"a.png", "b2.png"}), "name"),
                       "--times name: 1 of 2 photos have no number in their names"));
  EXPECT_TRUE(
      contains(settle_error(named({"a99999999999999999.png", "b2.png"}), "name"), "too large"));
}

TEST(SceneTimes, ATable) {
  TempFolder folder;
  const auto file = folder / "times.json";
  const auto views = named({"x/a.png", "x/b.png", "x/c.png"});
  write_text(file, R"({"x/a.png": -1, "b.png": 3, "c": 0, "d": 9})");
  const Settled s = settle(views, file.string());
  EXPECT_EQ(s.times, (Times{0, 1, 0.25}));
  EXPECT_EQ(s.unit.first, -1);
  EXPECT_TRUE(any_contains(s.report.notes, "1 of 4 entries of times.json are of no photo"));
  write_text(file, R"({"x/a.png": 0, "c": 1})");
  EXPECT_TRUE(contains(settle_error(views, file.string()),
                       "times.json: has no time for 1 of 3 photos: x/b.png"));
  write_text(file, R"({"a": 0, "b": "soon", "c": 1})");
  EXPECT_TRUE(contains(settle_error(views, file.string()), "times.json, \"b\": is no number"));
  write_text(file, R"({"a": 0, "b": NaN, "c": 1})");
  EXPECT_TRUE(contains(settle_error(views, file.string()), "times.json, \"b\": is no number"));
  write_text(file, "[0, 1, 2]");
  EXPECT_TRUE(contains(settle_error(views, file.string()), "is no table of times"));
  EXPECT_NE(settle_error(views, (folder / "none.json").string()), "");
}

TEST(SceneTimes, EqualTimesAreNoMotion) {
  EXPECT_TRUE(contains(settle_error(named({"a/1.png", "b/1.png"}), "frame"),
                       "--times frame: all 2 photos have the same time, 0"));
  SceneInput input = named({"a.png", "b.png"});
  input.times = SceneInput::Times{"the file"};
  for (View& view : input.views) view.time = 7;
  const Settled s = settle(input, "");
  EXPECT_EQ(s.times, (Times{0, 0}));
  EXPECT_EQ(s.report.times, "");
}

TEST(SceneTimes, OfTheFiles) {
  SceneInput input = named({"a.png", "b.png", "c.png"});
  input.times = SceneInput::Times{"the file"};
  const auto give = [&](const Times& times) {
    for (size_t i = 0; i < times.size(); ++i) input.views[i].time = times[i];
  };
  give({0.2, 0.5, 0.4});  // in the range that is promised: stays
  EXPECT_EQ(settle(input, "").times, (Times{0.2, 0.5, 0.4}));
  EXPECT_EQ(settle(input, "").unit.to_unit(0.3), 0.3);
  give({10, 20, 15});
  EXPECT_EQ(settle(input, "").times, (Times{0, 1, 0.5}));
  EXPECT_EQ(settle(input, "").unit.from_unit(12.5), 0.25);
  // Asked for otherwise.
  EXPECT_EQ(settle(input, "frame").times, (Times{0, 0.5, 1}));
  EXPECT_EQ(settle(input, "none").times, (Times{0, 0, 0}));
  EXPECT_EQ(settle(input, "none").report.times, "");
}

// A film's frames have times of its clock, which count where something is said to move.
TEST(SceneTimes, OnRequest) {
  SceneInput input = named({"frame_1.jpg", "frame_2.jpg", "frame_3.jpg"});
  input.times = SceneInput::Times{.source = "film.mp4", .seconds = true, .on_request = true};
  input.views[0].time = 0.5;
  input.views[1].time = 1;
  input.views[2].time = 2.5;
  const Settled still = settle(input, "");
  EXPECT_EQ(still.times, (Times{0, 0, 0}));
  EXPECT_TRUE(any_contains(still.report.notes, "--times frame"));
  const Settled moving = settle(input, "frame");
  EXPECT_EQ(moving.times, (Times{0, 0.25, 1}));
  EXPECT_EQ(moving.report.times, "3 moments, 0.5 to 2.5 s (film.mp4)");
  EXPECT_TRUE(moving.unit.seconds);
}

// What says when a frame was taken where nothing moves: files, a film's clock, or names.
TEST(SceneTimes, FramesHaveAClock) {
  const auto clocks = [](SceneInput input, const std::string& option) {
    SceneOptions options;
    options.times = option;
    SceneReport report;
    settle_times(input, options, report);
    std::vector<double> out;
    for (const View& view : input.views) out.push_back(view.clock.value_or(-1));
    return out;
  };
  const SceneInput frames = named({"frame_07.png", "frame_09.png", "frame_12.png"});
  EXPECT_EQ(clocks(frames, ""), (Times{7, 9, 12}));
  EXPECT_EQ(clocks(frames, "frame"), (Times{0, 1, 2}));
  EXPECT_EQ(clocks(named({"frame_07.png", "b.png"}), ""), (Times{-1, -1}));
  SceneInput film = frames;
  film.times = SceneInput::Times{.source = "film.mp4", .seconds = true, .on_request = true};
  film.views[1].time = 0.25;
  film.views[2].time = 2.5;
  EXPECT_EQ(clocks(film, ""), (Times{0, 0.25, 2.5}));
  EXPECT_EQ(clocks(film, "frame"), (Times{0, 0.25, 2.5}));
  EXPECT_EQ(clocks(film, "name"), (Times{7, 9, 12}));
}

TEST(SceneTimes, WhatIsNewInHeldOutViews) {
  Scene scene;
  scene.views.resize(4);
  scene.train = {0, 2};
  scene.test = {1, 3};
  SceneReport report;
  describe_held_out(scene, report);
  EXPECT_EQ(report.times, "");
  EXPECT_EQ(held_out_kinds(scene), std::vector<HeldOut>(4, HeldOut::kStatic));
  scene.views[1].time = scene.views[2].time = 0.5;
  scene.views[3].time = 1;
  EXPECT_EQ(held_out_kinds(scene), (std::vector<HeldOut>{HeldOut::kSpace, HeldOut::kSpace,
                                                         HeldOut::kSpace, HeldOut::kTime}));
  describe_held_out(scene, report);
  EXPECT_EQ(
      report.times,
      "; held out: 1 of moments that training sees from elsewhere, 1 of moments that training "
      "does not see");
}

TEST(SceneTimes, OptionsAreChecked) {
  for (const char* good : {"", "frame", "name", "a.json"})
    EXPECT_EQ(error_of([&] { check_times_option(good); }), "");
  EXPECT_TRUE(contains(error_of([] { check_times_option("frames"); }), "did you mean frame"));
}

}  // namespace
}  // namespace nerf::internal
