// For tests: options with which a step takes milliseconds, and everything that steps wrote.
#pragma once

#include <algorithm>
#include <cstdint>
#include <string>
#include <vector>

#include "nerf/base/file.h"
#include "nerf/train/methods.h"
#include "nerf/train/trainer.h"
#include "support/synthetic_scene.h"
#include "support/temp_folder.h"

namespace nerf::test {

inline TrainOptions tiny_options(int64_t steps) {
  TrainOptions o;
  o.steps = steps;
  o.grid_recipe.batch_samples = 4800;
  o.rate = 0.01;
  o.grid.levels = 4;
  o.grid.log2_entries = 12;
  o.grid.occupancy_side = 64;
  o.grid.base_resolution = 8;
  o.grid.finest_resolution = 64;
  o.grid.hidden = 16;
  o.grid.colour_layers = 1;
  return o;
}

// The same of a paper's method.
inline TrainOptions tiny_method_options(const std::string& method, int64_t steps) {
  TrainOptions o = method_options(method, Scale::kTiny);
  o.steps = steps;
  o.hold = 0.1;
  o.rate = 5e-3;
  o.warmup_steps = 8;
  o.network.depth = o.network.proposal_depth = 3;
  o.network.width = o.network.proposal_width = o.network.bottleneck = 32;
  o.network.view_width = 16;
  o.network.position_degrees = 4;
  o.network.sampling.coarse = 16;
  o.network.sampling.fine = 16;
  o.recipe.rays = 96;
  o.recipe.crop_steps = 3;
  o.recipe.anneal_steps = 0;
  DeformOptions& d = o.network.deform;
  d.depth = d.sheet_depth = 2;
  d.skip = 2;
  d.width = d.sheet_width = 16;
  d.degrees = d.sheet_degrees = 3;
  d.time_degrees = 3;
  o.recipe.curriculum_steps = std::min(o.recipe.curriculum_steps, 6);
  o.recipe.window_steps = std::min(o.recipe.window_steps, 40);
  o.recipe.ambient_start = std::min(o.recipe.ambient_start, 4);
  o.recipe.ambient_steps = std::min(o.recipe.ambient_steps, 20);
  o.recipe.still_points = 300;
  // The sphere is 2.3 away: of the paper's distances in inverse depth it would fill one of 32. At
  // the others' rate some seeds stay blank, which run_training() would answer with another salt.
  if (o.recipe.far > 0) {
    o.rate = 2e-3;
    o.recipe.near = 2;
    o.recipe.far = 100;
  }
  return o;
}

inline TrainOptions tiny_options(const std::string& method, int64_t steps) {
  return method == kGridMethod ? tiny_options(steps) : tiny_method_options(method, steps);
}

// What a method can be trained on: the sphere, for those of scenes that move at a moment of its own
// in each photo, by two cameras, with points on it that stand still.
inline SyntheticCapture capture_of(const std::string& method, int views = 6, int size = 32) {
  SyntheticCapture c = sphere_capture(views, size);
  if (!method_options(method, Scale::kTiny).network.deform.any()) return c;
  for (int i = 0; i < views; ++i) {
    View& view = c.scene.views[static_cast<size_t>(i)];
    view.time = static_cast<double>(i) / (views - 1);
    view.ids = {i, i, i % 2};
    c.scene.points.push_back(
        {spiral_pose(i, views).translation * (kSphereRadius / kCameraDistance), 0.5, 3});
  }
  return c;
}

// The model of all its steps.
inline RadianceField trained(const SyntheticCapture& c, const TrainOptions& options,
                             ThreadPool& pool) {
  Trainer trainer(c.scene, c.photos, options, pool);
  trainer.run({});
  return trainer.snapshot();
}

// The trainer's state as bytes, its options among them.
inline std::vector<uint8_t> bits_of(const Trainer& trainer) {
  const TempFolder folder;
  trainer.save_checkpoint(folder / "bits");
  return read_file(folder / "bits");
}

// What a trainer of the grid method has learnt, and nothing of its options.
inline std::vector<Real> learnt_by(const Trainer& trainer) {
  const RadianceField model = trainer.snapshot();
  const GridField& field = model.grid();
  std::vector<Real> all(field.weights.begin(), field.weights.end());
  all.insert(all.end(), field.table.begin(), field.table.end());
  all.insert(all.end(), field.half_table.begin(), field.half_table.end());
  return all;
}

}  // namespace nerf::test
