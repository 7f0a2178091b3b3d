#include "render_frames.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "nerf/base/error.h"
#include "nerf/io/image.h"
#include "run_program.h"

namespace nerf::apps {
namespace {

namespace fs = std::filesystem;
using testing_apps::TempFolder;

RenderPlan plan_of(const std::vector<fs::path>& files, bool depth = true) {
  RenderPlan plan;
  for (size_t i = 0; i < files.size(); ++i) {
    PlannedFrame f;
    f.name = files[i].string();
    f.camera.width = 16 + static_cast<int>(i);
    f.camera.height = 8;
    f.camera.params = {10, 10, 8, 4};
    f.camera_to_world.translation.x = static_cast<double>(i);
    f.color = files[i];
    if (depth) f.depth = "depth" / files[i];
    plan.frames.push_back(f);
  }
  return plan;
}

// Pictures of one colour; depth 1 + the camera's x.
Frame flat_frame(const Camera& camera, const Pose& pose) {
  Frame frame;
  frame.width = camera.width;
  frame.height = camera.height;
  const size_t n = static_cast<size_t>(camera.width) * static_cast<size_t>(camera.height);
  frame.rgb.assign(3 * n, 0.2_r * static_cast<Real>(pose.translation.x));
  frame.alpha.assign(n, 1.0_r);
  frame.depth_z.assign(n, 1 + static_cast<Real>(pose.translation.x));
  return frame;
}

Progress silent() {
  return Progress("", ProgressStyle{}, [] { return 0.0; }, [](std::string_view) {});
}

std::vector<std::string> tree(const fs::path& folder) {
  std::vector<std::string> files;
  for (const auto& entry : fs::recursive_directory_iterator(folder))
    if (entry.is_regular_file())
      files.push_back(fs::relative(entry.path(), folder).generic_string());
  std::sort(files.begin(), files.end());
  return files;
}

// Left over right or beside it, in colour and in depth.
TEST(RenderFrames, JoinsTheEyes) {
  for (const PictureKind picture : {PictureKind::kOds, PictureKind::kVr180}) {
    const TempFolder folder;
    RenderPlan plan = plan_of({"a.png"});
    plan.picture = picture;
    PlannedFrame& f = plan.frames[0];
    f.camera_to_world.translation.x = 1;
    f.right = Eye{f.camera, f.camera_to_world};
    f.right->camera_to_world.translation.x = 3;
    Progress progress = silent();
    const Cancel cancel;
    double last = 0;
    const auto files = render_frames(
        plan, folder.path(),
        [&](const Camera& camera, const Pose& pose, const PlannedFrame&, bool preview,
            const std::function<void(double)>& report) {
          if (!preview) {
            EXPECT_GE(pose.translation.x, last);
            last = pose.translation.x;
          }
          report(1);
          return flat_frame(camera, pose);
        },
        progress, cancel);
    EXPECT_EQ(files.depth.near, 2);
    EXPECT_EQ(files.depth.far, 4);
    const bool over = picture == PictureKind::kOds;
    const Image8 colour = read_image_8bit(folder.path() / "a.png");
    ASSERT_EQ(colour.width, over ? 16 : 32);
    ASSERT_EQ(colour.height, over ? 16 : 8);
    for (int y = 0; y < colour.height; ++y)
      for (int x = 0; x < colour.width; ++x) {
        const bool right = over ? y >= 8 : x >= 16;
        ASSERT_EQ(colour.pixels[static_cast<size_t>(3 * (y * colour.width + x))], right ? 153 : 51)
            << x << ' ' << y;
      }
    EXPECT_EQ(read_image_info(folder.path() / "depth" / "a.png").width, colour.width);
  }
}

// Layers stand where their pixels do.
TEST(JoinEyes, JoinsTheirLayersToo) {
  for (const PictureKind picture : {PictureKind::kOds, PictureKind::kVr180}) {
    Frame eyes[2];
    for (int e = 0; e < 2; ++e) {
      Frame& f = eyes[e];
      f.width = 3;
      f.height = 2;
      f.rgb.resize(18);
      f.alpha.resize(6);
      f.depth_z.resize(6);
      f.layers.resize(6, {.normal = true, .deep = true});
      for (size_t i = 0; i < 6; ++i) {
        f.alpha[i] = f.layers.distance[i] = static_cast<Real>(10 * e) + static_cast<Real>(i);
        f.layers.normal[3 * i + 2] = f.alpha[i];
        f.layers.deep[i].resize(static_cast<size_t>(e) + i);
      }
    }
    const Frame joined = join_eyes(picture, eyes[0], eyes[1]);
    EXPECT_TRUE(joined.layers.mean.empty());
    ASSERT_EQ(joined.layers.distance.size(), 12u);
    EXPECT_EQ(joined.layers.distance, joined.alpha);
    for (size_t i = 0; i < 12; ++i) {
      EXPECT_EQ(joined.layers.normal[3 * i + 2], joined.alpha[i]);
      const bool right = joined.alpha[i] >= 10;
      EXPECT_EQ(joined.layers.deep[i].size(),
                static_cast<size_t>(joined.alpha[i]) - (right ? 9u : 0u));
    }
  }
}

TEST(RenderFrames, WritesColourAndDepthWhereThePlanSays) {
  const TempFolder folder;
  const fs::path out = folder.path() / "new" / "out";
  Progress progress = silent();
  const Cancel cancel;
  int previews = 0, frames = 0;
  const auto files = render_frames(
      plan_of({"a.png", "s/b.png", "c.png"}), out,
      [&](const Camera& camera, const Pose& pose, const PlannedFrame&, bool preview,
          const std::function<void(double)>& report) {
        ++(preview ? previews : frames);
        if (report) report(0.5);
        return flat_frame(camera, pose);
      },
      progress, cancel);
  EXPECT_FALSE(files.cancelled);
  EXPECT_EQ(frames, 3);
  EXPECT_EQ(previews, 3) << "the depth's range comes from pictures of its own";
  EXPECT_EQ(files.color, (std::vector<fs::path>{out / "a.png", out / "s/b.png", out / "c.png"}));
  EXPECT_EQ(tree(out), (std::vector<std::string>{"a.png", "c.png", "depth/a.png", "depth/c.png",
                                                 "depth/s/b.png", "s/b.png"}));
  EXPECT_EQ(files.depth.near, 1);
  EXPECT_EQ(files.depth.far, 3);
  const Image8 b = read_image_8bit(out / "s/b.png");
  EXPECT_EQ(b.width, 17);
  EXPECT_EQ(b.height, 8);
  EXPECT_EQ(b.channels, 3);
  EXPECT_EQ(b.pixels[0], 51);
  // One range for all: the nearest picture is all red, the farthest all blue.
  const Image8 near = read_image_8bit(out / "depth/a.png");
  const Image8 far = read_image_8bit(out / "depth/c.png");
  EXPECT_GT(near.pixels[0], near.pixels[2]);
  EXPECT_LT(far.pixels[0], far.pixels[2]);
}

TEST(RenderFrames, WithoutDepthOnlyColour) {
  const TempFolder folder;
  Progress progress = silent();
  const Cancel cancel;
  int calls = 0;
  render_frames(
      plan_of({"a.png", "b.png"}, false), folder.path(),
      [&](const Camera& camera, const Pose& pose, const PlannedFrame&, bool,
          const std::function<void(double)>&) {
        ++calls;
        return flat_frame(camera, pose);
      },
      progress, cancel);
  EXPECT_EQ(calls, 2);
  EXPECT_EQ(tree(folder.path()), (std::vector<std::string>{"a.png", "b.png"}));
}

TEST(RenderFrames, AStopLeavesWholeFramesOnly) {
  for (const bool thrown : {true, false}) {
    const TempFolder folder;
    Progress progress = silent();
    Cancel cancel;
    int frame = 0;
    const auto files = render_frames(
        plan_of({"a.png", "b.png", "c.png"}), folder.path(),
        [&](const Camera& camera, const Pose& pose, const PlannedFrame&, bool preview,
            const std::function<void(double)>&) {
          if (!preview && ++frame == 2) {
            cancel.request();
            if (thrown) throw Cancelled();  // in mid-frame
          }
          return flat_frame(camera, pose);
        },
        progress, cancel);
    EXPECT_TRUE(files.cancelled);
    EXPECT_EQ(files.color.size(), thrown ? 1u : 2u);
    EXPECT_EQ(tree(folder.path()).size(), thrown ? 2u : 4u);
  }
}

TEST(RenderFrames, UnwritableFoldersAreErrors) {
  const TempFolder folder;
  testing_apps::write_text(folder.path() / "file", "x");
  Progress progress = silent();
  const Cancel cancel;
  const auto run = [&](const RenderPlan& plan, const fs::path& out) {
    render_frames(
        plan, out,
        [](const Camera& camera, const Pose& pose, const PlannedFrame&, bool,
           const std::function<void(double)>&) { return flat_frame(camera, pose); },
        progress, cancel);
  };
  EXPECT_THROW(run(plan_of({"a.png"}), folder.path() / "file"), Error);
  EXPECT_THROW(run(plan_of({"file/a.png"}), folder.path()), Error);
}

TEST(RenderFrames, ProgressGoesFromFrameToFrame) {
  const TempFolder folder;
  std::string out;
  ProgressStyle style;
  style.line_seconds = 0;
  Progress progress("r", style, [] { return 0.0; }, [&](std::string_view text) { out += text; });
  const Cancel cancel;
  render_frames(
      plan_of({"a.png", "b.png"}, false), folder.path(),
      [&](const Camera& camera, const Pose& pose, const PlannedFrame&, bool,
          const std::function<void(double)>& report) {
        report(0.5);
        return flat_frame(camera, pose);
      },
      progress, cancel);
  EXPECT_EQ(out,
            "r  25%  1/2 a.png\nr  50%  1/2 a.png\nr  75%  2/2 b.png\nr 100%  2/2 b.png  0s\n");
}

}  // namespace
}  // namespace nerf::apps
