#include "render_plan.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "app.h"
#include "nerf/base/error.h"
#include "nerf/base/nearest_name.h"
#include "nerf/base/text.h"
#include "nerf/io/camera_path.h"
#include "nerf/math/camera_paths.h"
#include "render_times.h"

namespace nerf::apps {
namespace {

namespace fs = std::filesystem;

constexpr int kDefaultFrames = 120;
constexpr double kDefaultIpd = 0.064;  // metres, as nerfstudio
constexpr int kPanoramaHeight = 1024;  // of one eye's picture
// Per pixel, at the peak: five numbers of the frame, two 8-bit pictures, the encoder's copy, the
// sorted depths.
constexpr uint64_t kBytesPerPixel = 8 * sizeof(Real) + 32;
// Layers as drawn and as encoded, and a dozen deep samples likewise.
constexpr uint64_t kLayerBytesPerPixel = 64 * sizeof(Real), kDeepBytesPerPixel = 1000;

struct Views {
  CameraPath path;
  bool photos = false;  // the cameras are those of photos, with their lenses
  bool file = false;    // a file says the poses and how fast they follow each other
};

// Frames of another kind than the path's own; panoramas, in their usual size.
void change_picture(PictureKind picture, CameraPath& path) {
  if (picture == PictureKind::kPerspective)
    throw Error("the camera path's file is one of panoramas and says no field of view", "--camera",
                "give equirectangular, ods or vr180, or a path of perspective cameras");
  const int width = picture == PictureKind::kVr180 ? kPanoramaHeight : 2 * kPanoramaHeight;
  for (PathFrame& frame : path.frames)
    frame.camera = path.picture == PictureKind::kPerspective
                       ? panorama_of(picture, width, kPanoramaHeight)
                       : panorama_of(picture, frame.camera.width, frame.camera.height);
  path.picture = picture;
}

// A panorama's horizon is level, whatever the path's camera looks down on: heads do the looking.
void level(const Similarity& to_engine, CameraPath& path) {
  const Vec3d up = to_engine.rotation.transposed() * Vec3d{0, 0, 1};
  for (PathFrame& frame : path.frames) {
    const Mat3d& axes = frame.camera_to_world.rotation;
    const auto horizontal = [&](const Vec3d& v) { return v - up * dot(v, up); };
    Vec3d forward = horizontal(axes.column(2));
    // Of one that looks straight down what its picture's upper edge shows.
    if (length(forward) < 1e-6) forward = horizontal(-axes.column(1));
    frame.camera_to_world.rotation = look_rotation(forward, up);
  }
}

// What --views names; a frozen camera's film has a length of its own.
Views named_views(const RenderCommand& command, const ModelInfo& info, const ModelAnswers& model) {
  const auto kinds = option_names(PathKind{});
  const std::string given = command.path.empty() ? command.views : command.path.string();
  const auto kind = std::find_if(kinds.begin(), kinds.end(), [&](const auto& entry) {
    return command.path.empty() && given == entry.name;
  });
  for (const auto& [is_given, option] :
       {std::pair{!command.path_transform.empty(), "--path-transform"},
        std::pair{!command.path_camera.empty(), "--path-camera"}})
    if (is_given && kind != kinds.end())
      throw Error(std::string(option) + " is for camera path files", option, "leave it out");
  Views views;
  views.file = kind == kinds.end();
  views.photos = !views.file && (kind->value == PathKind::kTest || kind->value == PathKind::kTrain);
  const bool stands = !command.freeze_camera.empty();
  if (command.frames && !stands && (views.photos || views.file))
    throw Error("--frames is for orbit, spiral, spherified, ellipse and interpolate", "--frames",
                "leave it out: these views have a number of their own");
  if (!views.file) {
    PathOptions options;
    options.frames = stands ? kDefaultFrames : command.frames.value_or(kDefaultFrames);
    options.density = model.density;
    views.path = make_camera_path(info, kind->value, options);
  } else if (!command.path.empty() || given.ends_with(".json") || fs::exists(given)) {
    views.path =
        read_camera_path(given, info, {command.path_transform, command.fps, command.path_camera});
    views.photos = views.path.own_lenses;
  } else {
    std::vector<std::string> names;
    for (const auto& entry : kinds) names.emplace_back(entry.name);
    throw Error("'" + command.views + "' is neither a known kind of views nor a file", "--views",
                nearest_name_hint(command.views, names));
  }
  return views;
}

Views find_views(const RenderCommand& command, const ModelInfo& info, const ModelAnswers& model) {
  Views views;
  if (command.freeze_camera.empty()) {
    views = named_views(command, info, model);
  } else if (const auto photo = photo_frame(command.freeze_camera, info)) {
    views.path.frames = {*photo};
    views.photos = true;
  } else {
    views = named_views(command, info, model);
    views.path.frames = {numbered_frame(command.freeze_camera, views.path)};
    views.path.begin = 0;
  }
  const bool stands = !command.freeze_camera.empty();
  if (stands) views.path.frames = film_of(views.path.frames.front(), command.frames, info);
  set_times(command, info, model.moves, views.path);
  if (!views.file || stands)
    views.path.fps = capture_speed(info, views.path).value_or(views.path.fps);
  if (command.fps) views.path.fps = *command.fps;
  if (command.camera && views.photos)
    throw Error("--camera is for generated paths and camera path files", "--camera",
                "leave it out: these views have their photos' cameras");
  const PictureKind picture = command.camera.value_or(views.path.picture);
  if (picture != views.path.picture) change_picture(picture, views.path);
  if (picture != PictureKind::kPerspective && !views.file) level(info.to_engine, views.path);
  return views;
}

// A camera with a lens of its own is scaled with it, as a photo's is; a path's keeps its height's
// field of view and square pixels.
Camera resized(const Camera& camera, int width, int height, bool photo) {
  if (width == camera.width && height == camera.height) return camera;
  if (photo || camera.model != CameraModel::kPinhole) return camera.scaled_to(width, height);
  Camera result = camera;
  const double factor = static_cast<double>(height) / camera.height;
  result.width = width;
  result.height = height;
  result.params[0] *= factor;
  result.params[1] *= factor;
  result.params[2] = 0.5 * width;
  result.params[3] = 0.5 * height;
  return result;
}

Camera sized(const RenderCommand& command, const Camera& camera, bool photo) {
  if (command.size) return resized(camera, command.size->width, command.size->height, photo);
  const auto divided = [&](int side) {
    return std::max(1, (side + command.downscale / 2) / command.downscale);
  };
  return resized(camera, divided(camera.width), divided(camera.height), true);
}

void check_size(const RenderCommand& command, const Camera& camera, PictureKind picture,
                uint64_t memory_bytes) {
  const auto pixels = static_cast<uint64_t>(camera.width) * static_cast<uint64_t>(camera.height);
  // Both eyes' pictures stand beside the joined one.
  const uint64_t bytes = (is_stereo(picture) ? 3 : 1) * pixels *
                         (kBytesPerPixel + (command.layers.aov.empty() ? 0 : kLayerBytesPerPixel) +
                          (command.layers.deep ? kDeepBytesPerPixel : 0));
  if (bytes <= memory_bytes) return;
  throw Error(fmt::format("a picture of {}x{} needs {:.1f} GB of memory, and {:.1f} GB are there",
                          camera.width, camera.height, static_cast<double>(bytes) * 1e-9,
                          static_cast<double>(memory_bytes) * 1e-9),
              "--size", "give a smaller --size");
}

// A file that no other frame has: two photos may differ in their extension only, and a view may
// stand in a folder named depth.
fs::path unused(const fs::path& file, std::set<fs::path>& used) {
  fs::path candidate = file;
  for (int i = 2; !used.insert(candidate).second; ++i)
    candidate = file.parent_path() / fmt::format("{}_{}.png", file.stem().string(), i);
  return candidate;
}

}  // namespace

fs::path find_model_file(const fs::path& run) {
  std::error_code error;
  const fs::file_status status = fs::status(run, error);
  if (!fs::exists(status))
    throw Error("no such file or folder", run.string(),
                "give the folder that nerf_train wrote, or a model file");
  if (!fs::is_directory(status)) return run;
  fs::path model = run / "model.nerf";
  if (!fs::exists(model, error))
    throw Error("there is no model.nerf in this folder", run.string(),
                "train one with: nerf_train SCENE -o " + shell_quoted(run.string()));
  return model;
}

fs::path picture_file(const std::string& view_name) {
  fs::path file;
  for (const fs::path& part : fs::path(view_name).relative_path())
    if (!part.empty() && part != ".." && part != ".") file /= part;
  if (file.empty()) file = "view";
  return file.replace_filename(shortened(file.stem().string(), kLongestFileStem) + ".png");
}

RenderPlan make_render_plan(const RenderCommand& command, const ModelInfo& info,
                            uint64_t memory_bytes, const ModelAnswers& model) {
  const Views views = find_views(command, info, model);
  RenderPlan plan;
  plan.fps = views.path.fps;
  plan.notes = views.path.notes;
  plan.picture = views.path.picture;
  plan.look = command.look;
  const bool stereo = is_stereo(plan.picture);
  if (command.ipd && !stereo)
    throw Error("--ipd is for pictures of two eyes", "--ipd", "give --camera ods or vr180 too");
  const double ipd = command.ipd.value_or(kDefaultIpd);
  if (stereo && !command.ipd)
    plan.notes.push_back(fmt::format(
        "the eyes stand {} units of the capture apart, as if it were in metres: --ipd sets it",
        ipd));
  if (command.background && !model.shows_background)
    plan.notes.emplace_back(
        "--background is not used: this model is of photos without alpha, learnt before black");
  std::set<fs::path> used;
  bool stretched = false;
  for (const PathFrame& view : views.path.frames) {
    PlannedFrame frame;
    frame.name = view.name;
    frame.camera = sized(command, view.camera, views.photos);
    frame.camera_to_world = view.camera_to_world;
    frame.time = view.time;
    frame.seconds = views.path.begin;
    if (!command.freeze_time) frame.seconds += static_cast<double>(plan.frames.size()) / plan.fps;
    frame.color = unused(picture_file(view.name), used);
    if (stereo) {
      const Eye middle{frame.camera, frame.camera_to_world};
      const Eye left = left_eye(plan.picture, middle, ipd);
      frame.camera = left.camera;
      frame.camera_to_world = left.camera_to_world;
      frame.right = right_eye(plan.picture, middle, ipd);
    }
    check_size(command, frame.camera, plan.picture, memory_bytes);
    const double aspect = static_cast<double>(frame.camera.width) * view.camera.height /
                          (static_cast<double>(frame.camera.height) * view.camera.width);
    stretched |= command.size && views.photos && std::abs(aspect - 1) > 0.02;
    plan.frames.push_back(std::move(frame));
  }
  if (const Camera& c = plan.frames.front().camera;
      plan.picture != PictureKind::kPerspective &&
      c.width != (plan.picture == PictureKind::kVr180 ? 1 : 2) * c.height)
    plan.notes.push_back(fmt::format(
        "{}x{} pixels are not {}: the panorama is stretched", c.width, c.height,
        plan.picture == PictureKind::kVr180 ? "as wide as high, as 180 x 180 degrees are"
                                            : "twice as wide as high, as 360 x 180 degrees are"));
  if (stretched)
    plan.notes.emplace_back("--size has other proportions than the photos: pictures are stretched");
  if (command.depth)
    for (PlannedFrame& frame : plan.frames) frame.depth = unused("depth" / frame.color, used);
  if (command.look.film != FilmKind::kColour)
    for (PlannedFrame& frame : plan.frames) frame.film = unused("film" / frame.color, used);
  if (!command.mp4.empty())
    for (const PlannedFrame& frame : plan.frames)
      if (frame.camera.width != plan.frames[0].camera.width ||
          frame.camera.height != plan.frames[0].camera.height)
        throw Error("the views have different sizes, and a video has one", "--mp4",
                    "give the size of the pictures with --size");
  return plan;
}

}  // namespace nerf::apps
