// What nerf_render writes for compositing beside its pictures.
#pragma once

#include <array>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "nerf/base/options.h"
#include "nerf/io/exr.h"
#include "nerf/model/model_info.h"
#include "nerf/model/renderer.h"

namespace nerf::apps {

struct PlannedFrame;
struct RenderPlan;

struct LayerOptions {
  std::string aov;
  std::string aov_format = "exr";
  bool deep = false;
  ExrType exr_type = ExrType::kFloat;
  bool exr_tiles = false;
  std::optional<double> metres;

  template <class V>
  void visit_options(V& v) {
    v.heading("Layers for compositing");
    v("aov", aov,
      "layers in DIR/exr, an OpenEXR file for each view, with its colour (linear, times opacity, "
      "before any background): all, or names with commas: depth (z, distance, mean, p05, p95), "
      "opacity, normal, normal_camera, transmittance, samples, variance; with --insert object, "
      "field and shadow",
      metavar("all|LIST"), brief("layers in DIR/exr as OpenEXR: all, or depth,normal,..."));
    v("aov_format", aov_format,
      "how --aov is written, with commas: exr, png16 (DIR/png16/LAYER) and npy (DIR/npy/LAYER), "
      "whose scale DIR/layers.json says",
      metavar("LIST"));
    v("deep", deep, "deep OpenEXR in DIR/deep: the light that is stopped along each ray",
      brief("deep OpenEXR in DIR/deep"));
    v("exr_type", exr_type, "colour, opacity and normals in OpenEXR; lengths are always float");
    v("exr_tiles", exr_tiles, "OpenEXR in tiles of 64 x 64 pixels, not lines");
    v("metres", metres, "metres that an input unit is, for the header of OpenEXR files", above(0));
  }
  // Throws Error for a layer or a format that is not known, and for a layer of inserted objects
  // where none is.
  void check_options(bool inserted) const;
};

// Writes layers of one run's frames.
class LayerFiles {
 public:
  // Throws Error where check_options() does. stops: of RenderCommand::exposure.
  LayerFiles(const LayerOptions& options, bool inserted, double stops, const ModelInfo& info);

  // Whether anything is wanted, and what pictures must be drawn with.
  bool wanted() const { return wanted_; }
  Layers layers() const { return layers_; }
  // Before the first frame: makes the folders below `out`, and DIR/layers.json. Throws Error.
  void begin(const std::filesystem::path& out) const;
  // Each file appears whole or not at all. Throws Error.
  void write(const std::filesystem::path& out, const RenderPlan& plan, const PlannedFrame& planned,
             const Frame& frame) const;

 private:
  LayerOptions options_;
  std::vector<std::string> names_;
  bool wanted_ = false, exr_ = false, png16_ = false, npy_ = false;
  Layers layers_;
  double stops_;
  double per_unit_;  // of lengths in PNG files
};

}  // namespace nerf::apps
