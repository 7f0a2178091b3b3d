// Camera paths: which views to render, and nerfstudio's camera-path JSON.
//
// All poses here are camera-to-world in the INPUT model's coordinates and unit, OpenCV axes.
#pragma once

#include <array>
#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "nerf/base/options.h"
#include "nerf/math/camera.h"
#include "nerf/math/vec.h"
#include "nerf/model/model_info.h"

namespace nerf {

struct PathFrame {
  std::string name;  // of the view it shows, as the model names it, or "orbit_0000"
  Camera camera;
  Pose camera_to_world;  // input coordinates
  double time = 0;       // [0, 1]
};

// What a frame of a path shows.
enum class PictureKind {
  kPerspective,      // what PathFrame::camera sees, whatever its lens
  kEquirectangular,  // all around
  kOds,    // omnidirectional stereo: all around, the left eye's picture over the right eye's
  kVr180,  // the half before the camera, the left eye's picture beside the right eye's
};
inline auto option_names(PictureKind) {
  return std::array{OptionName{PictureKind::kPerspective, "perspective"},
                    OptionName{PictureKind::kEquirectangular, "equirectangular"},
                    OptionName{PictureKind::kOds, "ods"}, OptionName{PictureKind::kVr180, "vr180"}};
}

// Whether a file is glTF, by its name or how it begins.
bool is_gltf(const std::filesystem::path& file);

struct CameraPath {
  std::vector<PathFrame> frames;
  PictureKind picture = PictureKind::kPerspective;  // else cameras are panoramas, of one eye
  double fps = 30;
  double begin = 0;                // seconds: of the first frame, in the file's own time
  bool own_lenses = false;         // cameras are those of photos, to be resized with their lenses
  std::vector<std::string> notes;  // for the user: fallbacks taken, things in a file not used
};

enum class PathKind {
  kTest,         // the held-out views, with their own cameras
  kTrain,        // the training views
  kOrbit,        // level circle around what the cameras look at
  kSpiral,       // small spiral around one pose, as LLFF shows forward-facing captures
  kSpherified,   // level circle on the sphere of the cameras, as LLFF shows captures all around
  kEllipse,      // level ellipse fitted to the cameras, as mip-NeRF 360 shows unbounded captures
  kInterpolate,  // through the training cameras in capture order
};
inline auto option_names(PathKind) {
  return std::array{OptionName{PathKind::kTest, "test"},
                    OptionName{PathKind::kTrain, "train"},
                    OptionName{PathKind::kOrbit, "orbit"},
                    OptionName{PathKind::kSpiral, "spiral"},
                    OptionName{PathKind::kSpherified, "spherified"},
                    OptionName{PathKind::kEllipse, "ellipse"},
                    OptionName{PathKind::kInterpolate, "interpolate"}};
}

struct PathOptions {
  int frames = 120;  // of the generated paths; views are as many as they are
  double fps = 30;
  // What the model has where a camera may go: densities (1 / input unit) at points in input
  // coordinates. Empty: the orbit does not look out for matter.
  using Density = std::function<std::vector<double>(std::span<const Vec3d>)>;
  Density density{};
};

// The views of `kind` for a trained model. The generated paths:
// - turn around the engine's up direction (ModelInfo::to_engine maps it to +z) and stand level: the
//   camera's x axis is horizontal in every frame;
// - use a pinhole camera with the focal length and image size most common among the training views
//   and the principal point in the middle (fisheyes: at most 90 degrees wide);
// - look at the point nearest to all training cameras' optical axes. Where these are too parallel,
//   they look at the middle of the engine's frame, or to a distance derived from near and far;
//   where most cameras look away from the point (a panorama), they look away from it;
// - close: the frame after the last would be the first. (interpolate does not.)
// What they do where a capture does not suit them:
// - orbit: at each azimuth as far away and as high as the cameras there. Cameras that do not stand
//   all the way round (a gap of 90 degrees or more) would show what no photo has seen; it then
//   swings along the arc that they cover, there and back. It gives way to matter;
// - spherified: the circle lies on the sphere around the focus whose radius is the root of the mean
//   squared distance of the cameras, at their mean height (spherify_poses of Mildenhall et al.
//   2020's code, whose up direction is the mean of the cameras' offsets; here it is the engine's);
// - ellipse: the same cameras get an ellipse around their own middle;
// - spiral: of cameras that surround the scene it takes the first one as its middle, with a width
//   of 15% of the distance to what it looks at; a single camera gets 5%;
// - interpolate: sorts by time where views have one, else by name with numbers counted as numbers;
//   of a rig in motion it takes the camera with the most views.
// time runs from 0 to 1 where the model's views have different times, and stays 0 elsewhere.
// Throws Error where the model has no such views, and for interpolate with fewer than two different
// poses.
CameraPath make_camera_path(const ModelInfo& info, PathKind kind, const PathOptions& options = {});

// Camera of the generated paths, see above.
Camera path_camera(const ModelInfo& info);

// The camera of one eye of a picture of another kind than kPerspective.
Camera panorama_of(PictureKind picture, int width, int height);

// nerfstudio's camera-path JSON: render_width, render_height, fps (or seconds), camera_type
// (perspective, fisheye, equirectangular, omnidirectional or vr180) and camera_path[] with
// camera_to_world (16 numbers, rows first, OpenGL axes: x right, y up, z backward), fov (vertical,
// degrees; panoramas need none) and optionally render_time. The size is that of one eye's picture.
// keyframes and crop are not used; the latter gets a note.
//
// nerfstudio itself stores paths in the normalised coordinates of its own run. A file read or
// written by these is in the input model's coordinates; read_camera_path() with a model, below,
// takes the other kind as well.
//
// Throws Error naming the file and the place (line:column, or camera_path[3].fov): not JSON,
// missing or mistyped entries, not-a-number, a matrix that is no rigid transform, sizes outside 1
// to 16384. Frames are named after the file: flight_0000 of flight.json.
CameraPath read_camera_path(const std::filesystem::path& path);

// A camera path of any tool for a trained model, told by what the file holds:
// - nerfstudio's, as above;
// - transforms.json (nerfstudio, instant-ngp, Blender): its poses, in order, with its intrinsics,
//   or the photos' where it has none;
// - a list of {"file_path", "transform": 3x4}, as nerfstudio exports its cameras: with the lens of
//   the model's view of that name, else the photos';
// - instant-ngp's base_cam.json: {"path": [{"R", "T", "fov"}], "loop", "duration_seconds"}, 30
//   frames a second; "scale" and "offset" of a transforms.json beside it are obeyed;
// - a folder of cameras in Nerfies' layout (camera-paths/NAME);
// - glTF 2.0 (GLB, or JSON): a camera, with the animation of its node and of what it hangs on, from
//   the first key to the last. Coordinates are those of nerf_export's GLB files (asset.extras says
//   them, else a metre is an input unit). The lens is that of the node's extras where it agrees
//   with the camera's yfov, as nerf_export writes both, else a pinhole with yfov and aspect ratio
//   that is as high as the photos. znear and zfar are not used.
// Notes say which camera is shown of several, and where a path lies far from the model's cameras.
// Throws Error as above.
struct PathReading {
  // dataparser_transforms.json of the nerfstudio run whose normalised space the path is in. Empty:
  // one beside the file is used if the path then lies nearer to the model's cameras; a note says
  // so.
  std::filesystem::path transform{};
  // Of glTF, which has no frames: how many a second; else those that nerf_export says, the keys'
  // own where they are as regular as a film's frames, or 30.
  std::optional<double> fps{};
  // Of glTF: a camera's or its node's name; empty: the first that moves, else the first.
  std::string camera{};
};
CameraPath read_camera_path(const std::filesystem::path& path, const ModelInfo& info,
                            const PathReading& reading = {});
CameraPath parse_camera_path(const std::string& json, const std::string& where,
                             const std::string& frame_prefix);

// Writes the same, atomically. Reading it back gives poses and fields of view to rounding (1e-12);
// lens distortion and principal points have no place in the format. Throws Error for an empty path,
// frames of different sizes, and where writing fails.
void write_camera_path(const std::filesystem::path& path, const CameraPath& camera_path);

}  // namespace nerf
