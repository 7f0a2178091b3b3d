// A capture as the trainer sees it: cameras, views, sparse points, splits and the frame that the
// engine works in. A few photos are decoded, for what they have of alpha or of a cut-out colour.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "nerf/base/cancel.h"
#include "nerf/io/cut_out.h"
#include "nerf/math/camera.h"
#include "nerf/math/vec.h"
#include "nerf/model/capture_times.h"

namespace nerf {

struct View {
  std::string name;                  // path below the image folder, as the model names it
  std::filesystem::path image_path;  // file on disk
  std::filesystem::path mask_path;   // empty where there is none
  std::filesystem::path depth_path;  // of a depth map (depth_map.h); empty where there is none
  std::filesystem::path depth_confidence_path;  // a picture that is 0 where it is not to be trusted
  double depth_unit = 0;                        // input units of a 1 in the map; 0: not said
  double depth_reach = std::numeric_limits<double>::infinity();  // beyond it depth is unknown
  int camera = 0;                                                // index into Scene::cameras
  Pose pose;        // camera-to-world, input coordinates, OpenCV axes
  double time = 0;  // [0, 1]; 0 where the capture has no time; Scene::times has its unit
  // When it was taken, in the capture's unit, whether or not the scene moves: by a film's clock, as
  // View::time says, or the last number in its name. None: not said of every photo.
  std::optional<double> clock = {};
  ViewIds ids = {};
  int orientation = 1;  // EXIF's, of the pixels as the trainer reads them; 1: nothing to turn
  // By the photo's EXIF, log2(time ISO / aperture^2), in stops against the median of the capture's
  // photos; none where it does not say. What the camera let in, not how bright the scene was.
  std::optional<double> exposure = {};
  std::string lens = {};  // likewise: camera, lens and focal length, for a person; empty: not said
  int scale = 1;  // the photo is reduced by this (photo_scales.h); a pixel weighs its square
};

struct ScenePoint {
  Vec3d position;    // input coordinates
  double error = 0;  // mean reprojection error, pixels
  int views = 0;     // number of images that see it
};

// A point seen in a photo.
struct Observation {
  int32_t image;  // index into Scene::views
  int32_t point;  // index into Scene::points
};

enum class SceneFormat {
  kAuto,
  kBlender,
  kNerfies,
  kColmap,
  kTransforms,
  kLlff,
  kNonrigid,
  kPhotos,
  kVideo
};
enum class Split {
  kTest,  // held-out = indices 0, 8, 16, ... of the views sorted bytewise by name, or the test file
  kDev,   // test views removed; every 8th training view is held out instead, for tuning
  kNone,  // everything trains, nothing is held out
};

// kAuto: cameras of a COLMAP model are adjusted to its keypoints where they do not fit, one lens
// takes the place of one for each photo where it explains them as well, and colmap finds anew, in
// options.work_folder, those of a model that takes two sides of a thing for one. kOn: adjusted even
// where they fit, and found anew where there are no keypoints (photos and videos have had both).
enum class AdjustCameras { kOff, kAuto, kOn };
inline auto option_names(AdjustCameras) {
  return std::array{OptionName{AdjustCameras::kOff, "off"},
                    OptionName{AdjustCameras::kAuto, "auto"}, OptionName{AdjustCameras::kOn, "on"}};
}

struct SceneOptions {
  SceneFormat format = SceneFormat::kAuto;
  Split split = Split::kTest;
  // Photos are divided by this, area average. 0: by what brings the median photo's longest side to
  // 2048 pixels or less (a panorama's to 8192); scene.options then says by what.
  int downscale = 1;
  std::optional<Box3> bbox;         // input coordinates; what to reconstruct
  std::optional<Vec3d> up;          // input coordinates; overrides the estimate
  std::optional<double> near, far;  // input units; override the estimates
  // Where View::time comes from in place of the capture's files: "frame", the order of names in
  // each folder (of a video, its own clock); "name", the last number in a photo's name; "none": all
  // photos are of one moment; else a JSON file {"photo": time}. Empty: what the files say, and of a
  // video its clock where something moves.
  std::string times;
  std::string camera_model = "auto";  // for photos without a model (capture_tools.h)
  AdjustCameras adjust_cameras = AdjustCameras::kAuto;
  CutOut cut_out;                     // of photos without alpha
  std::filesystem::path work_folder;  // where photos and video put frames and the model
  std::filesystem::path run_folder;   // pictures below it are no photos; empty: none
};

// What a person wants to know before training starts.
struct SceneReport {
  std::string format;    // e.g. "COLMAP binary, with rigs and frames"
  int images_total = 0;  // listed by the model or found in its image folder
  int images_registered = 0;
  int images_missing = 0;                  // registered, no file
  std::vector<std::string> missing_names;  // the first few
  std::vector<std::string> camera_models;  // e.g. "OPENCV 1080x1920"
  double mean_reprojection_error = 0;      // pixels; 0 where unknown
  int points = 0;
  Vec3d up;                  // input coordinates, unit
  std::string up_source;     // how it was found
  Box3 extent;               // of cameras and central points, input coordinates
  double near = 0, far = 0;  // input units
  int masks = 0;
  std::string mask_convention;
  std::string cut_out;  // what was found of a background of one colour; empty: nothing
  uint64_t memory_estimate_bytes = 0;  // of the photos; a trainer adds its own
  uint64_t memory_limit_bytes = 0;     // of this process
  std::string times;                   // what was found of moments; empty: no times
  std::string exposure;                // what EXIF says of exposures; empty: nothing
  std::vector<std::string> notes;      // how files were understood that say it in an odd way
  std::vector<std::string> ignored;    // inputs that were found and not used
  std::vector<std::string> warnings;
};

struct Scene {
  std::filesystem::path root;
  std::vector<Camera> cameras;  // of the full-size photos, before --downscale
  std::vector<View> views;      // registered views whose image exists, sorted bytewise by name;
                                // then the same at other scales
  std::vector<ScenePoint> points;
  std::vector<Observation> observations;  // of the points, in the views as they were read
  std::vector<int> train, test;           // indices into views
  SceneOptions options;                   // as given; `format` is the one that was found
  CaptureTimes times;                     // of View::time
  bool cameras_adjusted = false;          // they are not those of the capture's files
  double frame_interval = 0;              // of the film, in View::clock's unit; 0: not known
  bool alpha = false;                     // photos carry alpha (Blender): composite on a background
  std::optional<Rgb8> cut_out;            // photos get alpha where they have this background

  // Input coordinates to engine coordinates: +z up, centred on what the cameras look at. A bounded
  // scene fits [-1, 1]^3; in an unbounded one the region between the cameras does.
  Similarity to_engine;
  bool unbounded = false;
  double near = 0;             // engine units; no sample closer to a camera than this
  double far = 0;              // engine units; distance of the farthest content
  bool states_depths = false;  // the capture's files say how near and far its content is
  // Where the papers' code takes samples in captures of this kind, engine units; 0: it has no rule.
  double published_near = 0, published_far = 0;
  SceneReport report;
};

// What a held-out view of a capture that moves asks of a field.
enum class HeldOut {
  kStatic,  // nothing: the capture is of one moment
  kSpace,   // another place: training saw its moment from elsewhere
  kTime,    // another moment, between those that training saw
};

// How each view of the scene would be held out of its training views; times that differ by less
// than a millionth are one.
std::vector<HeldOut> held_out_kinds(const Scene& scene);

// Detects the format (in the order of SceneFormat), reads, checks and normalises. `path` is the
// scene's folder, a transforms .json or a video file. The images of a COLMAP scene are those of
// images/, or else of images_2, images_4 or images_8. Runs colmap or ffmpeg for
// photos and videos, in options.work_folder; a model found there from an earlier run on the same
// photos is used again. `progress` gets lines for a person while those programs run, `cancel` stops
// them. Throws Error, Cancelled.
Scene load_scene(const std::filesystem::path& path, const SceneOptions& options = {},
                 const std::function<void(const std::string&)>& progress = {},
                 const Cancel* cancel = nullptr);

// Throws Error where `times` is none that SceneOptions::times may be.
void check_times_option(const std::string& times);

// The report as lines for a person.
std::string format_report(const SceneReport& report);

}  // namespace nerf
