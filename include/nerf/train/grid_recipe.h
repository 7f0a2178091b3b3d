// How the grid method is trained.
#pragma once

#include <optional>

#include "nerf/base/options.h"
#include "nerf/train/camera_recipe.h"
#include "nerf/train/light_recipe.h"
#include "nerf/train/medium_recipe.h"
#include "nerf/train/motion_recipe.h"

namespace nerf {

struct GridRecipe {
  int batch_samples = 1 << 16;  // network samples of a step
  double network_rate = 1;      // of the networks, as a share of TrainOptions::rate
  // Adam's decay, of the first steps and of the last: a row of the tables counts the steps that
  // touch it, which may be few, so that at first a longer memory is older than the field.
  double beta1 = 0.8, beta2 = 0.95;
  double final_beta1 = 0.9, final_beta2 = 0.99;
  double huber_delta = 0.5;
  std::optional<double> distortion;  // see distortion_weight()
  double early_samples = 0.2;        // of the first steps, as a share of samples_per_cell
  double shared_colour = 0.125;      // light of a pixel that samples of one colour have together
  double stop_transmittance = 1.0 / 1024;  // light below which a sample learns nothing
  double gradient_roulette = 1;            // of the mean gradient: what is below learns by chance
  double occupancy_threshold = 0.01;       // opacity of a cell width below which a cell is empty
  // Cells of the occupancy grid that cannot hold matter by the cameras, by the photos' alpha and by
  // the sparse points are in use all the same.
  bool keep_unseen = false, keep_transparent = false, keep_free = false;
  LightRecipe light;
  CameraRecipe cameras;
  MotionRecipe motion;
  MediumRecipe medium;

  template <class V>
  void visit_options(V& v) {
    v("batch_samples", batch_samples, "network samples of a step", at_least(960), at_most(1 << 22));
    v("network_rate", network_rate, "step size of the networks, as a share of the tables'",
      above(0), at_most(10));
    v("beta1", beta1, "Adam's decay of the gradient at first", at_least(0), at_most(0.999));
    v("final_beta1", final_beta1,
      "Adam's decay of the gradient at last; it changes linearly while the step size falls",
      at_least(0), at_most(0.999));
    v("beta2", beta2, "Adam's decay of the squared gradient at first", at_least(0), at_most(0.999));
    v("final_beta2", final_beta2, "Adam's decay of the squared gradient at last, likewise",
      at_least(0), at_most(0.999));
    v("huber_delta", huber_delta, "error above which the loss grows linearly", above(0));
    v("distortion", distortion,
      "weight of the loss that draws the light of a ray together; without it 0.02 where the scene "
      "is unbounded, else 0",
      at_least(0), at_most(1000));
    v("early_samples", early_samples,
      "samples per cell of the first steps, as a share of --grid-samples-per-cell, which the last "
      "steps take, and where the scene is bounded all after 200 million samples: many rays first, "
      "exact ones later",
      above(0), at_most(1));
    v("shared_colour", shared_colour,
      "light of a pixel that successive samples of one colour, that of their mean features, have "
      "together at most; 0: each has its own",
      at_least(0), at_most(1));
    v("stop_transmittance", stop_transmittance,
      "light below which what lies behind a place of a ray learns nothing, where samples share a "
      "colour; 0: everything learns",
      at_least(0), at_most(0.5));
    v("gradient_roulette", gradient_roulette,
      "a sample whose gradient is below this share of its chunk's mean learns by chance, as often "
      "as its gradient is large and then by so much more; 0: all learn that have one",
      at_least(0), at_most(100));
    v("occupancy_threshold", occupancy_threshold,
      "opacity of one cell width below which a cell counts as empty; 0: none does that holds any "
      "matter",
      at_least(0), at_most(0.5));
    v("keep_unseen", keep_unseen,
      "cells that no camera of the training photos sees may hold matter too");
    v("keep_transparent", keep_transparent,
      "cells that photos with alpha show as wholly transparent may hold matter too");
    v("keep_free", keep_free,
      "cells that lie between cameras and the points they see, or nearer to cameras than what they "
      "see, may hold matter too, where a scene is unbounded");
    light.visit_options(v);
    cameras.visit_options(v);
    motion.visit_options(v);
    medium.visit_options(v);
    for (const char* name : {"network_l2", "late_levels", "coarse_photos", "error_guidance"})
      v.retired(name, 0.0);
    v.retired("every_row", false);
  }
};

}  // namespace nerf
