// A trained radiance field as a program uses it: load, ask, render (renderer.h), save.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <span>

#include "nerf/base/cancel.h"
#include "nerf/base/real.h"
#include "nerf/base/threads.h"
#include "nerf/math/vec.h"
#include "nerf/model/medium.h"
#include "nerf/model/model_info.h"

namespace nerf {

struct Field;         // model/field.h
struct GridField;     // weights and occupancy, model/grid_field.h
struct NetworkField;  // weights of a paper method, model/network_field.h
namespace internal {
class MatterCells;
}

class RadianceField {
 public:
  RadianceField(ModelInfo info, std::shared_ptr<const GridField> grid);
  RadianceField(ModelInfo info, std::shared_ptr<const NetworkField> network);

  // Model file (docs/model_file.md). load throws Error for a file that is truncated, damaged or of
  // another version; save writes atomically.
  static RadianceField load(const std::filesystem::path& path);
  void save(const std::filesystem::path& path) const;

  const ModelInfo& info() const { return info_; }
  // Of the two kinds of field a model has one.
  bool is_grid() const { return grid_ != nullptr; }
  // What callers ask instead of which kind it is. Whether samples follow densities that are cached
  // in cells: most of what RenderOptions leaves out is about such a model.
  bool has_density_cache() const { return is_grid(); }
  // Whether pictures show RenderOptions::background. A paper's method that learnt photos without
  // alpha learnt them before black.
  bool shows_background() const { return is_grid() || info_.alpha; }
  // Whether pictures depend on RenderOptions::time.
  bool moves() const;
  // What the field has learnt that its photos were taken through, if anything.
  std::optional<Medium> medium() const;
  // A copy as if nothing were known to be empty: every cell may hold matter, and nothing is baked.
  RadianceField without_empty_cells() const;
  const Field& field() const;
  const GridField& grid() const { return *grid_; }
  const NetworkField& network() const { return *network_; }

  // Finds out where a paper method's model is empty, once, so that its pictures skip it; for
  // `pixels` pixels that are to be rendered, and only where it pays for them. Of other models it
  // does nothing. Not while another thread uses the model. Returns whether pictures skip now.
  // Throws Cancelled.
  bool bake(uint64_t pixels, ThreadPool& pool, const Cancel* cancel = nullptr);
  const internal::MatterCells* baked() const { return baked_.get(); }

  // Density (1 / input unit) and sRGB colour in [0, 1] at points seen along unit directions, both
  // in input coordinates. Spans of equal length n, rgb of 3n. As in pictures, the grid method's
  // density is 0 outside the trained region and in cells that are known to be empty; a paper
  // method's is that of its last level. In normalised device coordinates a density depends on the
  // direction, along which the cube's unit is so long or short; behind their camera it is 0. `time`
  // in [0, 1]; a static field is the same at any.
  void query(std::span<const Vec3d> points, std::span<const Vec3d> directions,
             std::span<Real> density, std::span<Real> rgb, ThreadPool& pool, Real time = 0) const;

 private:
  ModelInfo info_;
  std::shared_ptr<const GridField> grid_;
  std::shared_ptr<const NetworkField> network_;
  std::shared_ptr<const internal::MatterCells> baked_;
};

}  // namespace nerf
