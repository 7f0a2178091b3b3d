// Small fields of known or of wild content, and what must hold of every picture of them.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <memory>
#include <utility>
#include <vector>

#include "nerf/model/grid_field.h"
#include "nerf/model/radiance_field.h"
#include "nerf/model/renderer.h"
#include "support/cameras.h"
#include "support/tables.h"

namespace nerf::stress {

// Matter of one density and colour in all cells: [-1, 1]^3, or as far as the cascades reach.
struct ConstantField {
  bool unbounded = false;
  int cascades = 1;
  Real log_density = 0;  // per engine unit
  std::array<Real, 3> colour_logit{0, 0, 0};
  uint8_t level = 30;  // of occupancy
};

inline GridOptions small_options() {
  GridOptions options;
  options.table_bits = 32;  // features of any size
  options.levels = 2;
  options.log2_entries = 10;
  options.base_resolution = 4;
  options.finest_resolution = 8;
  options.hidden = 16;
  options.colour_layers = 1;
  options.occupancy_side = 32;
  return options;
}

inline std::shared_ptr<GridField> constant_grid(const ConstantField& c) {
  auto grid = std::make_shared<GridField>(small_options(), c.unbounded, c.cascades);
  const auto weight = [&](const LinearWeights& w, int row, int column) -> Real& {
    return grid->weights[w.offset + static_cast<size_t>(row * weight_stride(w.in) + column)];
  };
  // Every feature is 1. One hidden unit carries it, in either network: through the constant of the
  // spherical harmonics in that of colours.
  for (Real& v : grid->table) v = 1;
  weight(grid->density_layers[0], 0, 0) = 1;
  weight(grid->density_layers[1], 0, 0) = c.log_density;
  const int constant = grid->options.geometry_features;
  weight(grid->colour_layers[0], 0, constant) = 1;
  for (int k = 0; k < 3; ++k)
    weight(grid->colour_layers[1], k, 0) =
        c.colour_logit[static_cast<size_t>(k)] / 0.28209479177387814_r;
  grid->occupancy.set_levels(std::vector<uint8_t>(grid->occupancy.levels().size(), c.level));
  return grid;
}

inline RadianceField constant_field(const ConstantField& c, const Similarity& to_engine = {}) {
  ModelInfo info;
  info.to_engine = to_engine;
  info.unbounded = c.unbounded;
  info.near = 1e-3;
  return RadianceField(std::move(info), constant_grid(c));
}

// Random weights of the given sizes: densities over many magnitudes, colours of all kinds, or all
// of them the same grey.
inline RadianceField wild_field(bool unbounded, int cascades, Real features, Real gain,
                                uint64_t seed, const Similarity& to_engine = {},
                                int table_bits = 32, bool grey = false) {
  GridOptions options = small_options();
  options.table_bits = table_bits;
  auto grid = std::make_shared<GridField>(options, unbounded, cascades);
  grid->initialise(seed);
  test::scale_table(*grid, features / 1e-4_r);
  for (Real& v : grid->weights) v *= gain;
  const LinearWeights& colour = grid->colour_layers.back();
  if (grey)
    std::fill_n(grid->weights.begin() + static_cast<std::ptrdiff_t>(colour.offset), colour.size(),
                0.0_r);
  std::vector<uint8_t> levels(grid->occupancy.levels().size());
  for (size_t i = 0; i < levels.size(); ++i) {
    const uint64_t h = mix64(seed + i);
    levels[i] = h % 3 ? static_cast<uint8_t>(h >> 8) : uint8_t{0};
  }
  grid->occupancy.set_levels(levels);
  ModelInfo info;
  info.to_engine = to_engine;
  info.unbounded = unbounded;
  info.near = 1e-3;
  return RadianceField(std::move(info), std::move(grid));
}

inline Camera pinhole(int size, double focal) { return test::pinhole(size, size, focal); }

// From `eye` towards `target`.
inline Pose look_at(const Vec3d& eye, const Vec3d& target) {
  const Vec3d forward = normalized(target - eye);
  const Vec3d aside = std::fabs(forward.z) < 0.9 ? Vec3d{0, 0, 1} : Vec3d{1, 0, 0};
  const Vec3d right = normalized(cross(forward, aside));
  Pose pose;
  pose.rotation.set_column(0, right);
  pose.rotation.set_column(1, cross(forward, right));
  pose.rotation.set_column(2, forward);
  pose.translation = eye;
  return pose;
}

inline void expect_picture(const Frame& frame) {
  for (size_t i = 0; i < frame.rgb.size(); ++i)
    ASSERT_TRUE(frame.rgb[i] >= 0 && frame.rgb[i] <= 1)
        << "pixel " << i / 3 << " channel " << i % 3 << " is " << frame.rgb[i];
  for (size_t i = 0; i < frame.alpha.size(); ++i) {
    ASSERT_TRUE(frame.alpha[i] >= 0 && frame.alpha[i] <= 1)
        << "opacity of pixel " << i << " is " << frame.alpha[i];
    ASSERT_TRUE(std::isfinite(frame.depth_z[i])) << "depth of pixel " << i;
  }
}

}  // namespace nerf::stress
