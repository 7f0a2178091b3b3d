// When the frames of nerf_render are shown.
#include "render_times.h"

#include <gtest/gtest.h>

#include "nerf/math/camera_paths.h"
#include "render_plan.h"
#include "run_program.h"

namespace nerf::apps {
namespace {

constexpr uint64_t kPlenty = uint64_t{1} << 40;

// Six photos of a film, of 10 s to 20 s of its clock.
ModelInfo film(bool moves = true) {
  ModelInfo info;
  for (int i = 0; i < 6; ++i) {
    ModelView view;
    view.name = "frames/f" + std::to_string(i) + ".jpg";
    view.camera.model = CameraModel::kPinhole;
    view.camera.width = 64;
    view.camera.height = 48;
    view.camera.params = {60, 60, 31, 24};
    const Vec3d at{2 * std::cos(1.0 * i), 2 * std::sin(1.0 * i), 0.5};
    view.pose = {look_rotation(-at, {0, 0, 1}), at};
    view.held_out = i == 0;
    view.time = moves ? 0.2 * i : 0;
    info.views.push_back(view);
  }
  if (moves) info.times = {10, 20, true, "film.mp4"};
  return info;
}

RenderCommand command(const std::string& views) {
  RenderCommand c;
  c.run = "run";
  c.out = "out";
  c.views = views;
  return c;
}

RenderPlan plan_of(const RenderCommand& c, const ModelInfo& info = film(), bool moves = true) {
  c.check_options();
  return make_render_plan(c, info, kPlenty, {.moves = moves});
}

std::string error_of(const RenderCommand& c, const ModelInfo& info = film()) {
  return test::error_of([&] { plan_of(c, info); });
}

TEST(RenderTimes, AMomentOrASpanOfThem) {
  RenderCommand c = command("orbit");
  c.frames = 5;
  c.time = TimeSpan{0.25, 0.75};
  RenderPlan plan = plan_of(c);
  for (size_t i = 0; i < 5; ++i) EXPECT_NEAR(plan.frames[i].time, 0.25 + 0.125 * i, 1e-12);
  EXPECT_EQ(plan.fps, 1) << "4 steps in 5 s, and no film is slower";
  c.frames = 51;
  plan = plan_of(c);
  EXPECT_NEAR(plan.fps, 10, 1e-9) << "50 steps in 5 s";
  c.fps = 12;
  c.mp4 = "film.mp4";
  EXPECT_EQ(plan_of(c).fps, 12);
  c.fps = {};
  c.time = TimeSpan{0.75, 0.25};
  plan = plan_of(c);
  EXPECT_EQ(plan.frames.front().time, 0.75);
  EXPECT_EQ(plan.frames.back().time, 0.25);
  EXPECT_EQ(plan.fps, 30) << "time runs backwards, at no speed of its own";
  c.time = {};
  c.freeze_time = 0.5;
  for (const PlannedFrame& frame : plan_of(c).frames) EXPECT_EQ(frame.time, 0.5);
  EXPECT_EQ(plan_of(c).fps, 30);
}

TEST(RenderTimes, InTheUnitOfTheCapture) {
  RenderCommand c = command("train");
  c.time_unit = TimeUnit::kCapture;
  c.time = TimeSpan{12, 12};
  for (const PlannedFrame& frame : plan_of(c).frames) EXPECT_NEAR(frame.time, 0.2, 1e-12);
  c.time = TimeSpan{12, 20.5};
  EXPECT_TRUE(test::contains(error_of(c), "--time: 20.5 is outside 10 to 20"));
  c.time = {};
  c.freeze_time = 9;
  EXPECT_TRUE(test::contains(error_of(c), "--freeze-time: 9 is outside 10 to 20"));
  ModelInfo untold = film();
  untold.times = {};
  EXPECT_TRUE(test::contains(error_of(c, untold), "--time-unit: "));
  c.time_unit = TimeUnit::kShare;
  EXPECT_TRUE(test::contains(error_of(c), "9 is outside 0 to 1"));
}

TEST(RenderTimes, PhotosKeepTheirsAndTheirSpeed) {
  const RenderPlan plan = plan_of(command("train"));
  ASSERT_EQ(plan.frames.size(), 5u);
  EXPECT_EQ(plan.frames[2].time, film().views[3].time);
  EXPECT_EQ(plan.fps, 1) << "4 steps in 8 s";
  ModelInfo numbered = film();
  numbered.times.seconds = false;
  EXPECT_EQ(plan_of(command("train"), numbered).fps, 30);
}

TEST(RenderTimes, TheCameraOfAPhotoStands) {
  RenderCommand c = command("test");
  c.frames = 11;
  for (const char* name : {"frames/f3.jpg", "f3.jpg", "frames/f3", "f3"}) {
    c.freeze_camera = name;
    const RenderPlan plan = plan_of(c);
    ASSERT_EQ(plan.frames.size(), 11u) << name;
    for (size_t i = 0; i < 11; ++i) {
      EXPECT_EQ(plan.frames[i].camera_to_world.translation, film().views[3].pose.translation);
      EXPECT_EQ(plan.frames[i].camera.cx(), 31);
      EXPECT_NEAR(plan.frames[i].time, 0.1 * i, 1e-12);
    }
    EXPECT_EQ(plan.frames[7].color, "f3_0007.png");
    EXPECT_EQ(plan.fps, 1);
  }
  c.time = TimeSpan{0.5, 1};
  EXPECT_EQ(plan_of(c).frames.front().time, 0.5);
  c.time = {};
  // As long as the capture, where that is long enough to be seen.
  c.frames = {};
  EXPECT_EQ(plan_of(c).frames.size(), 120u);
  ModelInfo longer = film();
  for (int i = 0; i < 40; ++i) {
    longer.views.push_back(longer.views[3]);
    longer.views.back().time = i / 39.0;
  }
  EXPECT_EQ(plan_of(c, longer).frames.size(), 44u);  // 0 and 1 twice
}

TEST(RenderTimes, TheCameraOfAFrameStands) {
  RenderCommand c = command("orbit");
  c.freeze_camera = "30";
  c.frames = 4;
  const RenderPlan plan = plan_of(c), orbit = plan_of(command("orbit"));
  ASSERT_EQ(plan.frames.size(), 4u);
  for (const PlannedFrame& frame : plan.frames)
    EXPECT_EQ(frame.camera_to_world.translation, orbit.frames[30].camera_to_world.translation);
  EXPECT_EQ(plan.frames[3].time, 1);
  for (const char* wrong : {"120", "-1", "3x", "nobody"}) {
    c.freeze_camera = wrong;
    EXPECT_TRUE(test::contains(error_of(c), "a number from 0 to 119")) << wrong;
  }
}

TEST(RenderTimes, WhatStandsStillIsNoted) {
  RenderCommand c = command("train");
  EXPECT_TRUE(plan_of(c, film(false), false).notes.empty());
  c.time = TimeSpan{0, 7};
  RenderPlan plan = plan_of(c, film(false), false);
  ASSERT_EQ(plan.notes.size(), 1u);
  EXPECT_TRUE(test::contains(plan.notes[0], "--time changes nothing"));
  c.time = {};
  c.freeze_camera = "0";
  c.frames = 3;
  plan = plan_of(c, film(false), false);
  EXPECT_TRUE(test::contains(plan.notes.at(0), "--freeze-camera changes nothing"));
  EXPECT_EQ(plan.frames.size(), 3u);
}

TEST(RenderTimes, OptionsExcludeEachOther) {
  RenderCommand c = command("orbit");
  c.freeze_time = 0.5;
  c.freeze_camera = "0";
  EXPECT_TRUE(test::contains(error_of(c), "leave nothing that moves"));
  c.freeze_camera.clear();
  c.time = TimeSpan{0, 1};
  EXPECT_TRUE(test::contains(error_of(c), "exclude each other"));
}

TEST(RenderTimes, SpansAsText) {
  EXPECT_EQ(parse_time_span("0.5")->to, 0.5);
  EXPECT_EQ(parse_time_span("-1..2.5")->from, -1);
  EXPECT_EQ(parse_time_span("-1..2.5")->to, 2.5);
  EXPECT_EQ(time_span_text({0.25, 1}), "0.25..1");
  EXPECT_EQ(time_span_text({3, 3}), "3");
  for (const char* wrong : {"", "..", "1..", "..1", "a", "1..b", "nan", "inf", "0.5..1..2"})
    EXPECT_FALSE(parse_time_span(wrong)) << wrong;
}

}  // namespace
}  // namespace nerf::apps
