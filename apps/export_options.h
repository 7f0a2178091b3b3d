// Command lines of nerf_export.
#pragma once

#include <array>
#include <filesystem>
#include <optional>
#include <string>

#include "nerf/base/options.h"
#include "nerf/kernels/bf16.h"
#include "nerf/math/option_types.h"
#include "options_cli.h"

namespace nerf {
namespace apps {

enum class SurfaceSource { kDepth, kDensity };
inline auto option_names(SurfaceSource) {
  return std::array{OptionName{SurfaceSource::kDepth, "depth"},
                    OptionName{SurfaceSource::kDensity, "density"}};
}

// What every export is told.
struct ExportCommand {
  std::filesystem::path run;
  std::filesystem::path out;

  template <class V>
  void visit_files(V& v) {
    v.heading("Files");
    v("run", run, "folder that nerf_train wrote, or a model file", positional(), required(),
      metavar("RUN"));
    v("out", out, "the file to write", short_name('o'), required(), metavar("FILE"));
  }
};

// What of the field is looked at, and how.
struct FieldCommand : ExportCommand {
  std::optional<Box3> bbox;
  double time = 0;
  std::string appearance;
  Precision precision = Precision::kAuto;
  int threads = 0;

  template <class V>
  void visit_bbox(V& v) {
    v("bbox", bbox,
      "only what is in this box, input coordinates; without it around what half as many training "
      "cameras see as see what most see, or around everything where photos have alpha");
  }
  template <class V>
  void visit_field(V& v) {
    v("time", time, "of a moving scene, 0 to 1", at_least(0), at_most(1));
    v("appearance", appearance,
      "the light of a photo, where the model has learnt the photos'; without it their mean",
      metavar("PHOTO"));
    v("precision", precision, "operands of the networks' products");
    v("threads", threads, "threads; 0 takes all processors", at_least(0), at_most(1024));
  }
};

struct MeshCommand : FieldCommand {
  SurfaceSource from = SurfaceSource::kDepth;
  int resolution = 512;
  double density = 0;
  int64_t triangles = 500000;
  double least_part = 0.02;
  bool colours = true;
  double metres = 1;

  template <class V>
  void visit_options(V& v) {
    visit_files(v);
    v.heading("The surface");
    visit_bbox(v);
    v("resolution", resolution, "voxels along the box's longest side", at_least(8), at_most(4096));
    v("from", from,
      "depth: what the training cameras see, fused; density: where the field's density passes a "
      "threshold");
    v("density", density,
      "that threshold, 1 / input unit; 0: where half of the light is stopped within two voxels",
      at_least(0));
    v("least_part", least_part,
      "drops parts with a smaller share of the triangles of the largest (0: none)", at_least(0),
      at_most(1));
    v("triangles", triangles, "at most so many, by collapsing edges; 0: all", at_least(0));
    v("colours", colours, "colours of the vertices, as the training cameras see them");
    v("metres", metres, "metres that an input unit is; GLB is in metres", above(0));
    v.heading("How the field is asked");
    visit_field(v);
  }
  void check_options() const;
};

struct PointsCommand : FieldCommand {
  int64_t points = 1000000;

  template <class V>
  void visit_options(V& v) {
    visit_files(v);
    v.heading("The points");
    visit_bbox(v);
    v("points", points, "about so many", at_least(1), at_most(100000000));
    v.heading("How the field is asked");
    visit_field(v);
  }
  void check_options() const;
};

struct CamerasCommand : ExportCommand {
  std::string path;
  int frames = 120;
  double metres = 1;

  template <class V>
  void visit_options(V& v) {
    visit_files(v);
    v.heading("The cameras");
    v("path", path,
      "a path beside them, as one animated camera: orbit, spiral, spherified, ellipse, interpolate "
      "or a camera path's file",
      metavar("VIEWS"));
    v("frames", frames, "length of a generated path", at_least(1), at_most(100000));
    v("metres", metres, "metres that an input unit is; GLB is in metres", above(0));
  }
  void check_options() const;
};

}  // namespace apps
}  // namespace nerf
