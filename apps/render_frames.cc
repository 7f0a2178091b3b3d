#include "render_frames.h"

#include <fmt/format.h>

#include <algorithm>
#include <future>
#include <set>
#include <utility>

#include "nerf/base/error.h"
#include "nerf/base/file.h"
#include "nerf/io/depth_legend.h"
#include "nerf/io/image.h"

namespace nerf::apps {
namespace {

namespace fs = std::filesystem;

constexpr int kPreviews = 5;
constexpr int kPreviewDivisor = 8;
constexpr int kLeastPreview = 48;  // pixels of the shorter side, where the picture has them

// A frame at its own size (divisor 0), or as a preview so many times smaller.
Frame draw(const RenderPlan& plan, const PlannedFrame& frame, const RenderFunction& render,
           int divisor, const std::function<void(double)>& progress) {
  const auto draw_eye = [&](const Camera& camera, const Pose& camera_to_world, double from,
                            double share) {
    const bool preview = divisor > 0;
    const Camera sized = preview ? camera.scaled_to(std::max(1, camera.width / divisor),
                                                    std::max(1, camera.height / divisor))
                                 : camera;
    return render(sized, camera_to_world, frame, preview, [&](double fraction) {
      if (progress) progress(from + share * fraction);
    });
  };
  if (!frame.right) return draw_eye(frame.camera, frame.camera_to_world, 0, 1);
  const Frame left = draw_eye(frame.camera, frame.camera_to_world, 0, 0.5);
  const Frame right = draw_eye(frame.right->camera, frame.right->camera_to_world, 0.5, 0.5);
  return join_eyes(plan.picture, left, right);
}

DepthRange preview_depth(const RenderPlan& plan, const RenderFunction& render) {
  const int frames = static_cast<int>(plan.frames.size());
  const int previews = std::min(kPreviews, frames);
  std::vector<DepthRange> ranges;
  for (int i = 0; i < previews; ++i) {
    const PlannedFrame& frame = plan.frames[static_cast<size_t>(i) * static_cast<size_t>(frames) /
                                            static_cast<size_t>(previews)];
    const int side = std::min(frame.camera.width, frame.camera.height);
    const int divisor = std::clamp(side / kLeastPreview, 1, kPreviewDivisor);
    const Frame picture = draw(plan, frame, render, divisor, {});
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
                            const RenderFunction& render, Progress& progress, const Cancel& cancel,
                            const FrameWriter& more) {
  RenderedFiles files;
  Folders folders;
  folders.make(out);
  const auto count = static_cast<double>(plan.frames.size());
  try {
    const bool depth = !plan.frames.empty() && !plan.frames.front().depth.empty();
    const bool ranged = depth && plan.look.depth_map != DepthLook::kNormal;
    if (ranged) files.depth = preview_depth(plan, render);
    const auto finished = [&](const Image8& image) {
      return ranged && plan.look.depth_legend ? with_legend(image, files.depth, plan.look.depth_map)
                                              : image;
    };
    const auto write = [&](size_t i, const Frame& picture) {
      const PlannedFrame& frame = plan.frames[i];
      const Image8 color = to_8bit({picture.width, picture.height, 3, picture.rgb});
      if (depth) {
        const Image8 depths = depth_picture(plan.look, picture, frame.camera_to_world, files.depth);
        folders.make((out / frame.depth).parent_path());
        write_image(out / frame.depth, finished(depths));
        if (!frame.film.empty()) {
          const double position = count > 1 ? static_cast<double>(i) / (count - 1) : 0;
          folders.make((out / frame.film).parent_path());
          write_image(out / frame.film,
                      finished(film_picture(plan.look.film, color, depths, position)));
          files.film.push_back(out / frame.film);
        }
      }
      if (more) more(frame, picture);
      folders.make((out / frame.color).parent_path());
      write_image(out / frame.color, color);
      files.color.push_back(out / frame.color);
    };
    // One picture's files are written while the next is drawn: encoding takes one thread only.
    std::future<void> writing;
    for (size_t i = 0; i < plan.frames.size(); ++i) {
      if (cancel.requested()) throw Cancelled();
      const PlannedFrame& frame = plan.frames[i];
      const std::string text = fmt::format("{}/{} {}", i + 1, plan.frames.size(), frame.name);
      Frame picture = draw(plan, frame, render, 0, [&](double fraction) {
        progress.update((static_cast<double>(i) + fraction) / count, text);
      });
      if (writing.valid()) writing.get();
      writing = std::async(std::launch::async, write, i, std::move(picture));
      progress.update(static_cast<double>(i + 1) / count, text);
    }
    if (writing.valid()) writing.get();
  } catch (const Cancelled&) {
    files.cancelled = true;
  }
  return files;
}

}  // namespace nerf::apps
