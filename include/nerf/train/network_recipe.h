// How a paper method's networks are trained.
#pragma once

#include "nerf/base/options.h"
#include "nerf/base/real.h"

namespace nerf {

// Of an annealing whose training does not know its length while it begins.
inline constexpr int kAnnealSteps = 2000;

struct NetworkRecipe {
  int rays = 1024;         // of a step
  bool one_photo = false;  // all rays of a step from one photo
  int crop_steps = 0;      // first steps, whose pixels come from the middle of the photos
  double crop = 0.5;       // of width and height
  Real coarse = 1;
  Real interlevel = 0;
  Real distortion = 0;
  Real charbonnier = 0;
  Real density_noise = 0;
  double beta2 = 0.999;
  double epsilon = 1e-7;
  double clip = 0;
  double warmup_rate = 1;
  double near = 0, far = 0;
  bool anneal = false;
  int anneal_steps = 0;
  bool skip = true;
  Real negligible = 0;
  int empty_steps = 0;
  bool photo_range = false;
  Real transient_density = 0.01_r;
  Real least_deviation = 0.03_r;
  // Of scenes that move.
  int curriculum_steps = 0;
  int window_steps = 0, ambient_start = 0, ambient_steps = 0;
  Real elastic = 0;
  int elastic_steps = 0, elastic_fall_steps = 0;
  Real still = 0;
  int still_points = 16384;

  template <class V>
  void visit_options(V& v) {
    v("rays", rays, "pixels of a step", at_least(1), at_most(1 << 20));
    v("one_photo", one_photo, "take all pixels of a step from one photo");
    v("crop_steps", crop_steps, "first steps, whose pixels come from the middle of the photos",
      at_least(0));
    v("crop", crop, "how much of width and height the middle is", above(0), at_most(1));
    v("coarse", coarse, "weight of the colour error of the levels before the last", at_least(0),
      at_most(100));
    v("interlevel", interlevel, "weight of the loss by which proposals bound the last level",
      at_least(0), at_most(1000));
    v("distortion", distortion, "weight of the loss that draws a ray's weights together",
      at_least(0), at_most(1000));
    v("charbonnier", charbonnier, "epsilon of the Charbonnier colour loss; 0: squared error",
      at_least(0), at_most(1));
    v("density_noise", density_noise, "standard deviation of noise on the raw density", at_least(0),
      at_most(100));
    v("beta2", beta2, "Adam's decay of the squared gradient", at_least(0), at_most(0.9999));
    // Above the root of what a squared gradient is flushed to zero below, or a step would have no
    // bound.
    v("epsilon", epsilon, "Adam's epsilon", at_least(1e-15), at_most(1));
    v("clip", clip, "largest norm of a network's gradient; 0: any", at_least(0));
    v("warmup_rate", warmup_rate,
      "share of the step size that the warm-up begins with, rising along a quarter sine", above(0),
      at_most(1));
    v("near", near, "first distance of samples, engine units; 0: from the scene", at_least(0));
    v("far", far, "last distance of samples, engine units; 0: from the scene", at_least(0));
    v("photo_range", photo_range,
      "sample each photo's rays where the sparse points lie that it sees, between 0.1 and 99.9 % "
      "of their distances");
    v("transient_density", transient_density,
      "weight of the mean transient density of a ray's samples (--network-transient-code)",
      at_least(0), at_most(100));
    v("least_deviation", least_deviation,
      "standard deviation of a pixel that shows nothing transient, added to the learnt one "
      "(--network-transient-code)",
      above(0), at_most(10));
    v("curriculum_steps", curriculum_steps,
      "first steps, which draw from the first photos by time, at first 3, in the end all",
      at_least(0));
    v("window_steps", window_steps,
      "steps over which the frequencies of the warp's position open, coarse ones first; 0: open",
      at_least(0));
    v("ambient_start", ambient_start, "step from which on ambient coordinates' frequencies open",
      at_least(0));
    v("ambient_steps", ambient_steps, "steps over which they do; 0: open", at_least(0));
    v("elastic", elastic,
      "weight of the loss that holds a warp to motions of rigid parts (--network-deform-warp)",
      at_least(0), at_most(100));
    v("elastic_steps", elastic_steps, "steps before that weight falls", at_least(0));
    v("elastic_fall_steps", elastic_fall_steps, "steps over which it falls to nothing; 0: it stays",
      at_least(0));
    v("still", still,
      "weight of the loss that keeps the capture's sparse points where they are at every moment",
      at_least(0), at_most(100));
    v("still_points", still_points, "how many of them a step asks for", at_least(1),
      at_most(1 << 20));
    v("skip", skip,
      "leave out samples that a ReLU gives no density, which have no gradient, and negligible "
      "ones");
    v("negligible", negligible,
      "share of a ray's light below which a sample is left out (of a ReLU's samples the share that "
      "reaches it, of a softplus's the share that it stops); 0: none",
      at_least(0), below(1));
    v("empty_steps", empty_steps,
      "leave out cells of space in which no sample mattered for so many steps, but for one ray of "
      "eight, which looks everywhere; 0: none",
      at_least(0), at_most(2000));
    v("anneal", anneal,
      "raise the proposals' weights that samples are drawn from to a power that grows to 1");
    v("anneal_steps", anneal_steps,
      "steps over which it does; 0: all of them, which a training of minutes does not know (it and "
      "the presets small and tiny take 2000)",
      at_least(0));
  }
};

}  // namespace nerf
