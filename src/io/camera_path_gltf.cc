// Cameras of glTF files as paths: of a training camera's file of nerf_export, of Blender.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <numbers>
#include <optional>

#include "camera_path_formats.h"
#include "colmap.h"
#include "gltf_animation.h"
#include "gltf_document.h"
#include "nerf/base/error.h"
#include "nerf/base/nearest_name.h"
#include "nerf/io/mesh_file.h"
#include "nerf/math/camera_paths.h"
#include "paths.h"
#include "scene_limits.h"

namespace nerf::internal {

namespace {

namespace fs = std::filesystem;

constexpr double kUsualFps = 30;
constexpr int kUsualHeight = 1080;  // where neither file nor model says any
constexpr int kLargestSide = 16384;
constexpr double kMostFrames = 100000;
constexpr double kOffGrid = 0.02;  // of a frame; times are floats

struct NamedCamera {
  size_t node;
  std::string name;
};

// A value's numbers; none where it is no list of so many.
std::optional<std::vector<double>> numbers_of(const tinygltf::Value& value, const char* key,
                                              size_t least, size_t most) {
  if (!value.IsObject() || !value.Has(key) || !value.Get(key).IsArray()) return std::nullopt;
  const tinygltf::Value& list = value.Get(key);
  if (list.ArrayLen() < least || list.ArrayLen() > most) return std::nullopt;
  std::vector<double> numbers;
  for (size_t i = 0; i < list.ArrayLen(); ++i) {
    const tinygltf::Value& x = list.Get(static_cast<int>(i));
    if (!x.IsNumber() || !(std::fabs(x.GetNumberAsDouble()) < kFarthestGltf)) return std::nullopt;
    numbers.push_back(x.GetNumberAsDouble());
  }
  return numbers;
}

std::optional<double> number_of(const tinygltf::Value& value, const char* key, double low,
                                double high) {
  if (!value.IsObject() || !value.Has(key) || !value.Get(key).IsNumber()) return std::nullopt;
  const double x = value.Get(key).GetNumberAsDouble();
  return x >= low && x <= high ? std::optional(x) : std::nullopt;
}

class GltfPath {
 public:
  GltfPath(const fs::path& file, const ModelInfo& info, const PathReading& reading)
      : file_(file),
        info_(info),
        reading_(reading),
        model_(load_gltf(file)),
        nodes_(model_, file),
        camera_(chosen()),
        animation_(model_, nodes_, {line(), {}, ""}, file) {}

  CameraPath read() {
    CameraPath path;
    path.notes = notes_;
    if (!animation_.others().empty())
      path.notes.push_back("of the animations of camera '" + camera_.name +
                           "' these do not play: " + name_list(animation_.others()));
    const Camera lens = lens_of(model_.nodes[camera_.node]);
    const Similarity to_gltf = input_to_file();
    path.fps = frames_per_second();
    size_t frames = 1;
    if (!animation_.empty()) {
      path.begin = animation_.first();
      const double steps = (animation_.last() - path.begin) * path.fps;
      if (!(steps < kMostFrames))
        fail(fmt::format("camera '{}' moves for {:g} s: more than {} frames", camera_.name,
                         animation_.last() - path.begin, kMostFrames),
             "give a smaller --fps");
      frames = 1 + static_cast<size_t>(steps + kOffGrid);
    }
    const bool timed = has_times(info_) && frames > 1;
    const std::string prefix = file_.stem().string();
    std::vector<NodePose> poses = nodes_.rest();
    for (size_t i = 0; i < frames; ++i) {
      const double share = static_cast<double>(i);
      if (!animation_.empty()) animation_.pose(path.begin + share / path.fps, poses);
      PathFrame frame{fmt::format("{}_{:04}", prefix, i), lens, {}, 0};
      frame.camera_to_world =
          to_gltf.apply_inverse(pose_of(nodes_.to_scene(camera_.node, poses), i));
      // The file says nothing of the scene's times: what moves does so once along the path.
      if (timed) frame.time = share / static_cast<double>(frames - 1);
      path.frames.push_back(std::move(frame));
    }
    return path;
  }

 private:
  [[noreturn]] void fail(const std::string& what,
                         const std::string& hint = "export the cameras again") const {
    throw Error(what, file_.string(), hint);
  }

  // The camera that is asked for, else the first that moves, else the first.
  NamedCamera chosen() {
    std::vector<NamedCamera> cameras;
    for (size_t i = 0; i < nodes_.size(); ++i) {
      const tinygltf::Node& node = model_.nodes[i];
      if (node.camera < 0) continue;
      if (static_cast<size_t>(node.camera) >= model_.cameras.size())
        fail(fmt::format("node {}: there is no camera {}", i, node.camera));
      const std::string& own = model_.cameras[static_cast<size_t>(node.camera)].name;
      const std::string& name = node.name.empty() ? own : node.name;
      cameras.push_back({i, name.empty() ? fmt::format("camera {}", i) : printable(name)});
    }
    if (cameras.empty())
      fail("there is no camera in it", "export the cameras too (Blender: Include, Cameras)");
    std::vector<std::string> names;
    for (const NamedCamera& c : cameras) names.push_back(c.name);
    if (!reading_.camera.empty()) {
      for (const NamedCamera& c : cameras)
        if (c.name == printable(reading_.camera)) return c;
      // Else by the name of its lens, which Blender gives another.
      for (const NamedCamera& c : cameras)
        if (model_.cameras[static_cast<size_t>(model_.nodes[c.node].camera)].name ==
            reading_.camera)
          return c;
      throw Error("there is no camera '" + printable(reading_.camera) + "' in " + file_.string(),
                  "--path-camera", nearest_name_hint(reading_.camera, names));
    }
    const std::vector<char> moved = nodes_.with_all_below(driven_nodes(model_));
    const auto found =
        std::ranges::find_if(cameras, [&](const NamedCamera& c) { return moved[c.node] != 0; });
    const auto shown = found == cameras.end() ? cameras.begin() : found;
    const NamedCamera camera = *shown;
    if (cameras.size() > 1) {
      names.erase(names.begin() + (shown - cameras.begin()));
      notes_.push_back("of the file's cameras '" + camera.name + "' is shown, not " +
                       name_list(names) + " (--path-camera NAME shows another)");
    }
    return camera;
  }

  std::vector<char> line() const {
    std::vector<char> line(nodes_.size());
    nodes_.mark_line(camera_.node, line);
    return line;
  }

  // nerf_export writes down the lens; what a program changed since counts more.
  Camera lens_of(const tinygltf::Node& node) const {
    const tinygltf::Camera& given = model_.cameras[static_cast<size_t>(node.camera)];
    if (given.type != "perspective")
      fail(fmt::format("camera '{}' is {}", camera_.name, printable(given.type)),
           "make it a perspective one");
    const double yfov = given.perspective.yfov, aspect = given.perspective.aspectRatio;
    if (!(yfov > 1e-4 && yfov < std::numbers::pi - 1e-4))
      fail(fmt::format("camera '{}' has a yfov of {:g}", camera_.name, yfov),
           "radians, above 0 and below pi");
    if (!(aspect >= 0 && aspect < 1e4))
      fail(fmt::format("camera '{}' has an aspect ratio of {:g}", camera_.name, aspect));
    Camera camera;
    const auto w = number_of(node.extras, "width", 1, kLargestSide),
               h = number_of(node.extras, "height", 1, kLargestSide);
    const tinygltf::Value& extras = node.extras;
    if (w && h && extras.Has("model") && extras.Get("model").IsString()) {
      const auto model = camera_model_from_name(extras.Get("model").Get<std::string>());
      const auto count = model ? static_cast<size_t>(camera_model_params(*model)) : 0;
      const auto params = numbers_of(extras, "params", count, count);
      if (model && params) {
        camera.model = *model;
        camera.width = static_cast<int>(*w);
        camera.height = static_cast<int>(*h);
        std::ranges::copy(*params, camera.params.begin());
        const double own = 2 * std::atan(0.5 * camera.height / camera.fy());
        const double wide = camera.width / camera.fx() / (camera.height / camera.fy());
        if (!camera_problem(camera) && !is_panorama(camera) && std::fabs(own - yfov) < 1e-4 &&
            (aspect == 0 || std::fabs(wide - aspect) < 1e-3 * aspect))
          return camera;
      }
    }
    const bool photos = !info_.views.empty();
    const Camera usual = photos ? path_camera(info_) : Camera();
    camera = {};
    camera.height = photos ? usual.height : kUsualHeight;
    const double ratio = aspect > 0 ? aspect
                         : photos   ? static_cast<double>(usual.width) / usual.height
                                    : 16.0 / 9;
    camera.width = static_cast<int>(
        std::clamp(std::round(camera.height * ratio), 1.0, static_cast<double>(kLargestSide)));
    const double focal = 0.5 * camera.height / std::tan(0.5 * yfov);
    camera.params = {focal, focal, 0.5 * camera.width, 0.5 * camera.height};
    return camera;
  }

  // Camera-to-scene. Scales above a camera move it and do not change what it shows (section 3.10 of
  // glTF 2.0).
  Pose pose_of(const GltfTransform& to_scene, size_t frame) const {
    Pose pose;
    pose.translation = to_scene.offset;
    for (int c = 0; c < 3; ++c) {
      const Vec3d axis = normalized(to_scene.linear.column(c));
      pose.rotation.set_column(c, c == 0 ? axis : -axis);  // from x right, y up, -z forward
    }
    const Vec3d x = pose.rotation.column(0), y = pose.rotation.column(1),
                z = pose.rotation.column(2);
    if (!(dot(x, cross(y, z)) > 1e-6) || !coordinate_ok(pose.translation))
      fail(fmt::format("camera '{}' has no pose in frame {}: it is mirrored, flat or not finite",
                       camera_.name, frame),
           "apply the scale of what it hangs on");
    pose.rotation = orthonormalized(pose.rotation);
    return pose;
  }

  // Blender drops what nerf_export said of this: a metre is then a unit of the input.
  Similarity input_to_file() const {
    const auto m = numbers_of(model_.asset.extras, "input_to_gltf", 16, 16);
    if (!m) return input_to_gltf(info_);
    const GltfTransform t = gltf_matrix([&](int i) { return (*m)[static_cast<size_t>(i)]; });
    Similarity s;
    s.scale = length(t.linear.column(0));
    for (int c = 0; c < 3; ++c) s.rotation.set_column(c, t.linear.column(c) / s.scale);
    if (!(s.scale > 0) || !(orthonormality_error(s.rotation) <= 1e-3))
      fail("asset.extras.input_to_gltf is no similarity", "leave it out, or export again");
    s.rotation = orthonormalized(s.rotation);
    s.center = s.rotation.transposed() * t.offset / -s.scale;
    return s;
  }

  // What is asked for, what nerf_export wrote, or the steps of keys for every frame of a film.
  double frames_per_second() const {
    if (reading_.fps) return *reading_.fps;
    const auto own = number_of(model_.nodes[camera_.node].extras, "fps", 1e-3, 1000);
    if (own) return *own;
    double step = 1e9;
    for (const KeyCurve& curve : animation_.curves())
      if (const auto& t = curve.times(); t.size() > 2)
        for (size_t i = 1; i < t.size(); ++i) step = std::min(step, t[i] - t[i - 1]);
    if (!(step >= 1.0 / 240 && step <= 1.0 / 10)) return kUsualFps;
    // Keys' times are floats: the shortest step is too short, by more the longer the film.
    const double all = animation_.last() - animation_.first();
    step = all / std::max(1.0, std::round(all / step));
    for (const KeyCurve& curve : animation_.curves())
      for (const double t : curve.times()) {
        const double steps = (t - curve.times().front()) / step;
        if (std::fabs(steps - std::round(steps)) > kOffGrid) return kUsualFps;
      }
    return std::round(1e3 / step) * 1e-3;
  }

  const fs::path& file_;
  const ModelInfo& info_;
  const PathReading& reading_;
  std::vector<std::string> notes_;
  tinygltf::Model model_;
  GltfNodes nodes_;
  NamedCamera camera_;
  GltfAnimation animation_;
};

}  // namespace

CameraPath read_gltf_path(const fs::path& file, const ModelInfo& info, const PathReading& reading) {
  return GltfPath(file, info, reading).read();
}

}  // namespace nerf::internal

namespace nerf {

bool is_gltf(const std::filesystem::path& file) {
  const std::string extension = internal::lower_extension(file);
  if (extension == ".gltf" || extension == ".glb") return true;
  char magic[4] = {};
  std::ifstream(file, std::ios::binary).read(magic, 4);
  return std::string_view(magic, 4) == "glTF";
}

}  // namespace nerf
