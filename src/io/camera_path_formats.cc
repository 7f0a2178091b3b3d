// Camera paths of other tools: transforms.json, exported lists of cameras.
#include "camera_path_formats.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "colmap.h"
#include "nerf/base/error.h"
#include "nerf/base/file.h"
#include "nerf/base/text.h"
#include "nerf/math/camera_paths.h"
#include "paths.h"
#include "scene_limits.h"
#include "transforms_camera.h"

namespace nerf {
namespace internal {

namespace fs = std::filesystem;
using nlohmann::json;

namespace {

constexpr uint64_t kMaxFileBytes = uint64_t{256} << 20;

// The model's view that an image's path ends in the name of; nothing where none does.
const ModelView* view_named(const ModelInfo& info, const std::string& file_path) {
  const std::string name = clean_image_name(file_path);
  const auto ends_with = [&](const std::string& tail) {
    return name == tail || (name.size() > tail.size() && name.ends_with("/" + tail));
  };
  for (const ModelView& view : info.views)
    if (ends_with(view.name) || ends_with(fs::path(view.name).filename().string())) return &view;
  return nullptr;
}

// A frame's own name where it says one, without its folder.
std::string name_of(const FrameJson& frame, const std::string& otherwise) {
  const fs::path file = clean_image_name(frame.text("file_path"));
  return file.stem().empty() ? otherwise : file.stem().string();
}

}  // namespace

std::string PathSource::frame_name(size_t i) const {
  return fmt::format("{}_{:04}", frame_prefix, i);
}

json parse_path_json(const std::string& text, const std::string& where) {
  try {
    return json::parse(text);
  } catch (const json::parse_error& error) {
    const size_t byte = error.byte > 0 ? error.byte - 1 : 0;
    throw Error("not valid JSON", where + ":" + line_and_column(text, byte),
                "export the camera path again, or correct the text at this line and column");
  } catch (const json::exception&) {  // a number that no double can hold
    throw Error("holds a number that is out of range", where, "export the camera path again");
  }
}

Pose opengl_pose(const json& rows, const std::string& where) {
  const auto fail = [&](const std::string& what) -> void {
    throw Error(what, where,
                "3 or 4 rows of 4 numbers: the camera's unit axes right, up and "
                "backward, and its position");
  };
  if (!rows.is_array() || rows.size() < 3 || rows.size() > 4) fail("is no matrix of a pose");
  Pose pose;
  for (size_t r = 0; r < 3; ++r) {
    if (!rows[r].is_array() || rows[r].size() != 4) fail("is no matrix of a pose");
    for (size_t c = 0; c < 4; ++c) {
      const double x = rows[r][c].is_number() ? rows[r][c].get<double>() : std::nan("");
      if (!(std::abs(x) <= 1e9)) fail("holds what is not a number");
      if (c < 3)
        pose.rotation.m[r][c] = c == 0 ? x : -x;  // OpenGL's up and backward to down and forward
      else
        pose.translation[static_cast<int>(r)] = x;
    }
  }
  // A camera object scaled in its program scales all three axes.
  const double scale = length(pose.rotation.column(0));
  if (scale > 1e-9)
    for (int c = 0; c < 3; ++c) pose.rotation.set_column(c, pose.rotation.column(c) / scale);
  if (!(orthonormality_error(pose.rotation) <= 1e-3)) fail("does not begin with a rotation");
  pose.rotation = orthonormalized(pose.rotation);
  return pose;
}

CameraPath read_transforms_path(const PathSource& source) {
  const json& frames = source.document["frames"];
  if (!frames.is_array() || frames.empty())
    throw Error("expected a list of one frame or more", source.where + ": frames");
  CameraPath path;
  const Camera usual = path_camera(source.info);
  bool says_lens = false;
  for (size_t i = 0; i < frames.size(); ++i) {
    const FrameJson frame{frames[i], source.document,
                          fmt::format("{}: frames[{}]", source.where, i)};
    if (!frames[i].is_object()) frame.fail("expected an object");
    const FrameJson own{frames[i], frames[i], frame.where};
    const json* matrix = own.find("transform_matrix");
    if (matrix == nullptr) frame.fail("there is no \"transform_matrix\"");
    PathFrame view;
    view.name = name_of(own, source.frame_name(i));
    view.camera_to_world = opengl_pose(*matrix, frame.where + ".transform_matrix");
    view.camera = usual;
    bool lens = false;
    for (const char* key : {"fl_x", "fl_y", "camera_angle_x", "camera_angle_y", "x_fov", "y_fov"})
      lens |= frame.find(key) != nullptr;
    const std::string model = frame.text("camera_model");
    lens |= model == "EQUIRECTANGULAR" || model == "SPHERICAL" || frame.flag("latlong");
    if (lens) {
      FrameSize size = frame_size(frame);
      if (size.width == 0) size = {usual.width, usual.height};
      std::string warning;
      view.camera = frame_camera(frame, size, &warning);
      if (!warning.empty() && !says_lens) path.notes.push_back(warning);
    }
    says_lens |= lens;
    if (const auto time = own.number("time"))
      view.time = std::clamp(source.info.times.from_unit(*time), 0.0, 1.0);
    path.frames.push_back(std::move(view));
  }
  path.own_lenses = says_lens;
  if (!says_lens) path.notes.emplace_back("the path says no lens: it is drawn as the photos are");
  return path;
}

CameraPath read_pose_list(const PathSource& source) {
  const json& list = source.document;
  if (list.empty()) throw Error("the list of cameras is empty", source.where);
  CameraPath path;
  path.own_lenses = true;
  const Camera usual = path_camera(source.info);
  for (size_t i = 0; i < list.size(); ++i) {
    const FrameJson frame{list[i], list[i], fmt::format("{}: [{}]", source.where, i)};
    if (!list[i].is_object()) frame.fail("expected an object");
    const json* matrix = nullptr;
    for (const char* key : {"transform", "transform_matrix", "camera_to_world"})
      if (matrix == nullptr) matrix = frame.find(key);
    if (matrix == nullptr)
      frame.fail("there is no \"transform\"", "a list of cameras has a pose in each entry");
    PathFrame view;
    view.name = name_of(frame, source.frame_name(i));
    view.camera_to_world = opengl_pose(*matrix, frame.where + ".transform");
    const ModelView* same = view_named(source.info, frame.text("file_path"));
    view.camera = same != nullptr ? same->camera : usual;
    path.frames.push_back(std::move(view));
  }
  return path;
}

}  // namespace internal

CameraPath read_camera_path(const std::filesystem::path& file, const ModelInfo& info,
                            const PathReading& reading) {
  const bool folder = internal::is_folder(file), gltf = !folder && is_gltf(file);
  if (!gltf && !reading.camera.empty())
    throw Error("only glTF files hold several cameras", "--path-camera", "leave it out");
  if (folder || gltf) {
    CameraPath path = folder ? internal::read_nerfies_path(file, info)
                             : internal::read_gltf_path(file, info, reading);
    internal::place_path(path, file, reading.transform, info, false);
    return path;
  }
  const std::string text = read_text_file(file, internal::kMaxFileBytes);
  const std::string where = file.string();
  const nlohmann::json document = internal::parse_path_json(text, where);
  const internal::PathSource source{document, info, where, file.stem().string(),
                                    file.parent_path()};
  CameraPath path;
  bool of_nerfstudio = true;
  if (document.is_array()) {
    path = internal::read_pose_list(source);
  } else if (document.is_object() && document.contains("frames") &&
             !document.contains("camera_path")) {
    path = internal::read_transforms_path(source);
  } else if (document.is_object() && document.contains("path") &&
             !document.contains("camera_path")) {
    path = internal::read_instant_ngp_path(source);
    of_nerfstudio = false;
  } else if (document.is_object() && document.contains("keyframes") &&
             !document.contains("camera_path")) {
    throw Error("holds keyframes and no path between them", where,
                "let the viewer write the path itself (nerfstudio: Generate Command)");
  } else {
    path = parse_camera_path(text, where, file.stem().string());
  }
  internal::place_path(path, file, reading.transform, info, of_nerfstudio);
  return path;
}

}  // namespace nerf
