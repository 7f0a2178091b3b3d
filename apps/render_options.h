// Command line of nerf_render.
#pragma once

#include <array>
#include <filesystem>
#include <optional>
#include <string>

#include "insert_object.h"
#include "layer_files.h"
#include "looks.h"
#include "nerf/base/options.h"
#include "nerf/io/camera_path.h"
#include "nerf/kernels/bf16.h"
#include "nerf/math/option_types.h"
#include "nerf/model/renderer.h"
#include "options_cli.h"

namespace nerf {
namespace apps {

// Pixels; "WxH" as an option.
struct ImageSize {
  int width = 0, height = 0;
};
inline constexpr int kLargestSide = 16384;

// No value where `text` is not two whole numbers from 1 to kLargestSide with an x between them.
std::optional<ImageSize> parse_image_size(const std::string& text);

// "T" or "A..B" as an option: both are T of the former.
struct TimeSpan {
  double from = 0, to = 0;
};

// No value where `text` is neither.
std::optional<TimeSpan> parse_time_span(const std::string& text);
std::string time_span_text(const TimeSpan& span);

// What times on the command line are given in.
enum class TimeUnit {
  kShare,    // 0 is the capture's first moment, 1 its last
  kCapture,  // CaptureTimes
};
inline auto option_names(TimeUnit) {
  return std::array{OptionName{TimeUnit::kShare, "share"},
                    OptionName{TimeUnit::kCapture, "capture"}};
}

}  // namespace apps

template <>
struct OptionTraits<apps::TimeSpan> {
  static constexpr OptionType kType = OptionType::kText;
  static void describe(OptionField& f) {
    f.metavar = "T|A..B";
    f.problem = [](const OptionValue& v) -> std::string {
      if (apps::parse_time_span(std::get<std::string>(v))) return "";
      return "give a number, or two with .. between them, as in 0.2..0.8";
    };
  }
  static OptionValue to_value(const apps::TimeSpan& s) { return apps::time_span_text(s); }
  static apps::TimeSpan from_value(const OptionValue& v) {
    return apps::parse_time_span(std::get<std::string>(v)).value();
  }
};

template <>
struct OptionTraits<apps::ImageSize> {
  static constexpr OptionType kType = OptionType::kText;
  static void describe(OptionField& f) {
    f.metavar = "WxH";
    f.problem = [](const OptionValue& v) -> std::string {
      if (apps::parse_image_size(std::get<std::string>(v))) return "";
      return "give width and height in pixels, 1 to " + std::to_string(apps::kLargestSide) +
             ", as in 800x600";
    };
  }
  static OptionValue to_value(const apps::ImageSize& s) {
    return std::to_string(s.width) + "x" + std::to_string(s.height);
  }
  static apps::ImageSize from_value(const OptionValue& v) {
    return apps::parse_image_size(std::get<std::string>(v)).value();
  }
};

namespace apps {

struct RenderCommand {
  std::filesystem::path run;
  std::string views = "test";
  std::filesystem::path out;
  std::optional<ImageSize> size;
  int downscale = 1;
  std::optional<PictureKind> camera;
  std::optional<double> ipd;
  std::filesystem::path path;
  std::string path_camera;
  std::filesystem::path path_transform;
  std::optional<int> frames;
  std::optional<double> fps;
  std::filesystem::path mp4;
  std::optional<TimeSpan> time;
  std::optional<double> freeze_time;
  std::string freeze_camera;
  TimeUnit time_unit = TimeUnit::kShare;
  bool depth = true;
  std::optional<Box3> bbox;
  std::optional<Vec3> background;
  std::string appearance;
  std::string medium;
  double exposure = 0;
  int supersample = 0;
  Precision precision = Precision::kAuto;
  LookOptions look;
  LayerOptions layers;
  InsertOptions object;
  int threads = 0;

  template <class V>
  void visit_options(V& v) {
    v.heading("What to show");
    v("run", run, "folder that nerf_train wrote, or a model file", positional(), required(),
      metavar("RUN"), brief("folder that nerf_train wrote, or a model file"));
    v("views", views,
      "what to show: test, train, orbit, spiral, spherified, ellipse, interpolate, or a camera "
      "path: nerfstudio's JSON, a transforms.json, a list of exported cameras, instant-ngp's "
      "base_cam.json, in the input model's coordinates, or a camera of a glTF file, in those of "
      "nerf_export's GLB files",
      metavar("VIEWS"),
      brief("test, train, orbit, spiral, spherified, ellipse, interpolate, or the file of a camera "
            "path"));
    v("out", out, "folder that the pictures go to", short_name('o'), required(), metavar("DIR"),
      brief("folder that the pictures go to"));
    v("size", size,
      "size of the pictures; without it that of the photos, or the one that a camera path's file "
      "states",
      brief("size of the pictures; without it that of the photos"));
    v("downscale", downscale, "divides the pictures' size", at_least(1), at_most(64),
      brief("divides the pictures' size"));
    v("camera", camera,
      "what generated paths and a camera path's file show: perspective, equirectangular (all "
      "around), ods (all around in stereo, left eye above right) or vr180 (the half in front in "
      "stereo, left eye beside right); --size is that of one eye; without it perspective, or what "
      "the file says",
      brief("perspective, equirectangular, ods or vr180"));
    v("ipd", ipd,
      "distance between the eyes of ods and vr180, input unit; without it 0.064, as in metres",
      at_least(0), at_most(1e6));
    v("path", path, "the file of a camera path, as --views FILE", metavar("FILE"));
    v("path_camera", path_camera,
      "the camera of a glTF file by its name; without it the first that moves, or the first",
      metavar("NAME"));
    v("path_transform", path_transform,
      "dataparser_transforms.json of the nerfstudio run in whose space the camera path is; without "
      "it one beside the path's file, where the path then lies nearer to the photos' cameras",
      metavar("FILE"));
    v("frames", frames, "length of the generated paths (orbit, spiral, ...); without it 120",
      at_least(1), at_most(100000), brief("length of a generated path; without it 120"));
    v("fps", fps,
      "frames per second of the video, of a glTF file's camera, and of what an inserted object "
      "does; without it the camera path's, or 30",
      at_least(0.1), at_most(1000), brief("frames per second of the video"));
    v("mp4", mp4, "also writes the colour frames as a video, through ffmpeg", metavar("FILE"),
      brief("also writes a video"));
    v.heading("When, in a scene that moves");
    v("time", time,
      "the moment of all pictures, or from one to another along the frames; 0 is the capture's "
      "first and 1 its last; without it what the views say, and of generated paths all of them",
      brief("a moment from 0 to 1, or from one to another: T, A..B"));
    v("freeze_time", freeze_time, "time stands at this moment, while the camera moves",
      metavar("T"), brief("time stands at this moment, while the camera moves"));
    v("freeze_camera", freeze_camera,
      "the camera stands, while the scene runs: a photo's name, or a number of a frame of --views; "
      "--frames says of how many, else as many as the capture has moments",
      metavar("PHOTO|N"), brief("the camera stands at a photo's place, or a frame's of --views"));
    v("time_unit", time_unit,
      "what times are given in: share, from 0 to 1; capture, what the capture's files say (a "
      "video's seconds, numbers of frames)");
    v.heading("How to draw it");
    v("depth", depth, "colour-mapped depth pictures in DIR/depth",
      brief("pictures of depth too; --no-depth leaves them out"));
    look.visit_options(v);
    v("bbox", bbox, "draws nothing outside this box, input coordinates",
      brief("draws nothing outside this box"));
    v("background", background,
      "sRGB colour behind the scene, each 0 to 1; without it the sky that nerf_train --sky learnt, "
      "what its --background said, or white; not used with a paper's method that learnt photos "
      "without alpha: always black",
      at_least(0), at_most(1), metavar("R,G,B"), brief("colour behind the scene, each 0 to 1"));
    v("appearance", appearance,
      "the light of the pictures, where the model has learnt the photos': a photo's name; several "
      "with .. between them, one after the other along the frames; mean; or own, each training "
      "view's own; without it mean",
      metavar("PHOTO|A..B|mean"), brief("light of a photo, or from one to another: PHOTO, A..B"));
    v("medium", medium,
      "what the scene is seen through: fog, smoke or water; sigma is what weakens light, per input "
      "unit, of all channels or each; backscatter, where it is not the same, how fast its own "
      "light sets in; colour what is left to see, 0 to 1; falloff makes it thin "
      "with height, from sigma at `height` on; box is where it ends, input coordinates; off: "
      "clear; without it what nerf_train --medium has learnt",
      metavar(
          "KIND[,sigma=N][,backscatter=N][,colour=R,G,B][,height=H,falloff=L][,box=X,Y,Z,X,Y,Z]"),
      brief("fog, smoke or water before the scene; off: clear"));
    v("exposure", exposure, "stops by which the pictures are brighter", at_least(-10), at_most(10),
      brief("stops by which the pictures are brighter"));
    v("supersample", supersample,
      "rays along a pixel's side, averaged; 0: with the grid method a pixel's width in pixels of "
      "the photos, rounded, 1 to 8, else one",
      at_least(0), at_most(kMostSupersampling));
    v("precision", precision,
      "operands of the networks' products; auto: bf16 where the processor is faster with it");
    v("threads", threads, "threads; 0 takes all processors", at_least(0), at_most(1024),
      brief("0 takes all processors"));
    layers.visit_options(v);
    object.visit_options(v);
  }
  // Throws Error for combinations that cannot be.
  void check_options() const;
};

ProgramText render_program_text();

}  // namespace apps
extern template CollectedOptions collect_options(apps::RenderCommand&);

}  // namespace nerf
