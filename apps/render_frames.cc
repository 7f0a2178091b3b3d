#include "render_frames.h"

#include <fmt/format.h>

#include <algorithm>
#include <set>
#include <utility>

#include "nerf/base/error.h"
#include "nerf/base/file.h"
#include "nerf/io/image.h"

namespace nerf::apps {
namespace {

namespace fs = std::filesystem;

constexpr int kPreviews = 5;
constexpr int kPreviewDivisor = 8;
constexpr int kLeastPreview = 48;  // pixels of the shorter side, where the picture has them

DepthRange preview_depth(const RenderPlan& plan, const RenderFunction& render) {
  const int frames = static_cast<int>(plan.frames.size());
  const int previews = std::min(kPreviews, frames);
  std::vector<DepthRange> ranges;
  for (int i = 0; i < previews; ++i) {
    const PlannedFrame& frame = plan.frames[static_cast<size_t>(i) * static_cast<size_t>(frames) /
                                            static_cast<size_t>(previews)];
    const int side = std::min(frame.camera.width, frame.camera.height);
    const int divisor = std::clamp(side / kLeastPreview, 1, kPreviewDivisor);
    const Camera small = frame.camera.scaled_to(std::max(1, frame.camera.width / divisor),
                                                std::max(1, frame.camera.height / divisor));
    const Frame picture = render(small, frame.camera_to_world, /*preview=*/true, {});
    ranges.push_back(depth_range(picture.depth_z, picture.alpha));
  }
  return merged(ranges);
}

// Creates each folder once.
class Folders {
 public:
  void make(const fs::path& folder) {
    if (made_.insert(folder).second) make_writable_folder(folder);
  }

 private:
  std::set<fs::path> made_;
};

}  // namespace

RenderedFiles render_frames(const RenderPlan& plan, const fs::path& out,
                            const RenderFunction& render, Progress& progress,
                            const Cancel& cancel) {
  RenderedFiles files;
  Folders folders;
  folders.make(out);
  const auto count = static_cast<double>(plan.frames.size());
  try {
    const bool depth = !plan.frames.empty() && !plan.frames.front().depth.empty();
    if (depth) files.depth = preview_depth(plan, render);
    for (size_t i = 0; i < plan.frames.size(); ++i) {
      if (cancel.requested()) throw Cancelled();
      const PlannedFrame& frame = plan.frames[i];
      const std::string text = fmt::format("{}/{} {}", i + 1, plan.frames.size(), frame.name);
      const Frame picture =
          render(frame.camera, frame.camera_to_world, /*preview=*/false, [&](double fraction) {
            progress.update((static_cast<double>(i) + fraction) / count, text);
          });
      if (depth) {
        folders.make((out / frame.depth).parent_path());
        write_image(out / frame.depth, depth_image(picture.width, picture.height, picture.depth_z,
                                                   picture.alpha, files.depth));
      }
      folders.make((out / frame.color).parent_path());
      const ImageF color{picture.width, picture.height, 3, picture.rgb};
      write_image(out / frame.color, to_8bit(color));
      files.color.push_back(out / frame.color);
      progress.update(static_cast<double>(i + 1) / count, text);
    }
  } catch (const Cancelled&) {
    files.cancelled = true;
  }
  return files;
}

}  // namespace nerf::apps
