// For every_option_test.cc: a line for each option of TrainOptions.
#pragma once

#include <string>
#include <vector>

#include "nerf/train/trainer.h"
#include "support/synthetic_film.h"
#include "support/synthetic_scene.h"
#include "support/tiny_options.h"

namespace nerf::test {

// A training before the option is changed.
struct OptionSetting {
  SyntheticCapture capture;
  TrainOptions options;
};

struct OptionLine {
  std::string option;
  std::vector<std::string> others;  // the first that is not the method's own value is taken
  void (*given)(OptionSetting&) = [](auto&) {};  // without which there is nothing to change
};

// One camera sees a part of the region only, twice: a scene that moves has several moments.
inline void one_place(OptionSetting& s) {
  Scene& scene = s.capture.scene;
  scene.train.resize(2);
  const size_t first = static_cast<size_t>(scene.train[0]);
  const size_t second = static_cast<size_t>(scene.train[1]);
  scene.views[second].pose = scene.views[first].pose;
  s.capture.photos.photos[second] = s.capture.photos.photos[first];
}
// Nothing is opaque behind photos with alpha, whatever NetworkOptions::opaque_end says.
inline void opaque_photos(OptionSetting& s) {
  s.capture.scene.alpha = false;
  for (Photo& p : s.capture.photos.photos)
    for (size_t i = 3; i < p.pixels8.size(); i += 4) p.pixels8[i] = 255;
}
inline void in_fog(OptionSetting& s) {
  opaque_photos(s);
  s.options.grid_recipe.medium.medium = LearntMedium::kFog;
}
// Points tell where it is: above them.
inline void before_sky(OptionSetting& s) {
  opaque_photos(s);
  add_sphere_points(s.capture.scene);
  s.options.grid_recipe.light.sky = Switch::kOn;
}
// So thin that the last interval is not opaque by itself; a softplus is nowhere 0, so that one
// without end would be.
inline void thin_and_opaque_photos(OptionSetting& s) {
  opaque_photos(s);
  s.options.network.density_bias = -8;
  s.options.network.last_interval = 1;
}
// Free space is known of scenes without bounds, from what photos see: here the sphere's middle.
inline void unbounded_with_points(OptionSetting& s) {
  opaque_photos(s);
  s.capture.scene.unbounded = true;
  for (int i = 0; i < 30; ++i) {
    s.capture.scene.points.push_back({{0.02 * i - 0.3, 0, 0}, 0.5, 3});
    for (const int v : s.capture.scene.train) s.capture.scene.observations.push_back({v, i});
  }
}
// A sensor says where the sphere's middle is.
inline void with_depth(OptionSetting& s) {
  for (Photo& p : s.capture.photos.photos) {
    const size_t pixels = static_cast<size_t>(p.width) * static_cast<size_t>(p.height);
    p.depth = {p.width, p.height, std::vector<uint16_t>(pixels, 0x4200)};  // 3 as a half float
  }
}
// The right half of each photo is masked out.
inline void with_masks(OptionSetting& s) {
  for (Photo& p : s.capture.photos.photos) {
    p.mask.resize(static_cast<size_t>(p.width) * static_cast<size_t>(p.height));
    for (size_t i = 0; i < p.mask.size(); ++i)
      p.mask[i] = i % static_cast<size_t>(p.width) < static_cast<size_t>(p.width / 2) ? 255 : 0;
  }
  s.capture.photos.fraction_masked = 0.5;
}
inline void learnt_light(OptionSetting& s) {
  s.options.grid_recipe.light.appearance = {false, 4};
  s.options.grid_recipe.light.colour_correction = Switch::kOn;
  s.options.grid_recipe.light.vignetting = Switch::kOn;
}
inline void told_exposures(OptionSetting& s) {
  learnt_light(s);
  for (size_t v = 0; v < s.capture.scene.views.size(); ++v)
    s.capture.scene.views[v].exposure = v % 2 ? 0.5 : -0.5;
}
inline void photos_of_two_moments(OptionSetting& s) {
  for (size_t v = 0; v < s.capture.scene.views.size(); v += 2) s.capture.scene.views[v].time = 1;
}
inline void moving(OptionSetting& s) {
  photos_of_two_moments(s);
  s.options.grid_recipe.motion.deform = Deform::kTranslation;
}
inline void cameras_at_once(OptionSetting& s) {
  s.options.grid_recipe.cameras.first_step = 2;
  s.options.grid_recipe.cameras.first_levels = 2;
}
inline void refined(OptionSetting& s) {
  cameras_at_once(s);
  s.options.grid_recipe.cameras.refine = RefineCameras::kOn;
}
inline void filmed(OptionSetting& s) { film(s.capture, 0.8); }
inline void filmed_by_rows(OptionSetting& s) {
  filmed(s);
  s.options.grid_recipe.cameras.rolling_shutter = {false, 0.8};
}
inline void without_crop(OptionSetting& s) { s.options.recipe.crop_steps = 0; }
inline void warmed_up(OptionSetting& s) { s.options.recipe.warmup_rate = 0.1; }
inline void annealed(OptionSetting& s) { s.options.recipe.anneal = true; }
// Without a view direction there is no layer that a photo's numbers join.
inline void without_codes(OptionSetting& s) {
  NetworkOptions& n = s.options.network;
  n.image_code = n.camera_code = n.transient_code = 0;
}
// Cameras' numbers stand in place of photos'.
inline void without_cameras(OptionSetting& s) { s.options.network.camera_code = 0; }
inline void with_codes(OptionSetting& s) {
  without_cameras(s);
  s.options.network.image_code = 4;
}
// Integrated encodings have no points that could be moved.
inline void standing(OptionSetting& s) {
  s.options.network.deform.warp = WarpKind::kNone;
  s.options.network.deform.slice = Slice::kNone;
  s.options.network.deform.still_start = false;  // of warps alone
}
inline void transient(OptionSetting& s) { s.options.network.transient_code = 4; }
// Photos of several moments, by two cameras, with points that stand still: what every capture of a
// scene that moves has.
inline void moments(OptionSetting& s) {
  s.capture.scene.points.clear();
  const size_t views = s.capture.scene.views.size();
  for (size_t i = 0; i < views; ++i) {
    View& view = s.capture.scene.views[i];
    view.time = static_cast<double>(i) / static_cast<double>(views - 1);
    view.ids = {static_cast<int>(i), static_cast<int>(i), static_cast<int>(i % 2)};
    s.capture.scene.points.push_back({{0.1 * static_cast<double>(i) - 0.4, 0.2, 0.1}, 0.5, 3});
  }
  // So much that a few steps show it.
  s.options.recipe.curriculum_steps = 0;
}
inline void two_cameras(OptionSetting& s) {
  moments(s);
  s.options.network.view_dependence = true;
}
inline void moves_anywhere(OptionSetting& s) {
  moments(s);
  s.options.network.encoding = Encoding::kFrequency;
  s.options.network.deform.still_start = false;
}
inline void warped(OptionSetting& s) {
  moves_anywhere(s);
  DeformOptions& d = s.options.network.deform;
  if (d.warp == WarpKind::kNone) d.warp = WarpKind::kSe3;
  if (d.slice == Slice::kNone) d.code = 4;
}
inline void warped_by_time(OptionSetting& s) {
  warped(s);
  s.options.network.deform.code = 0;
}
inline void translated(OptionSetting& s) {
  warped(s);
  s.options.network.deform.warp = WarpKind::kTranslation;
}
inline void sliced(OptionSetting& s) {
  warped(s);
  s.options.network.deform.slice = Slice::kSheet;
}
inline void sliced_in_steps(OptionSetting& s) {
  sliced(s);
  s.options.recipe.ambient_steps = 8;
}
inline void elastic_for_steps(OptionSetting& s) {
  warped(s);
  s.options.recipe.elastic = 10;
  s.options.recipe.elastic_steps = 1;
  s.options.recipe.elastic_fall_steps = 4;
}
inline void held_still(OptionSetting& s) {
  warped(s);
  s.options.recipe.still = 10;
}
// What photos see is in a part of the distances that samples would have.
inline void sampled_by_points(OptionSetting& s) {
  unbounded_with_points(s);
  s.options.recipe.near = s.options.recipe.far = 0;
}
// Cones have intervals, which coarse+fine resampling does not.
inline void intervals(OptionSetting& s) {
  IntervalOptions& sampling = s.options.network.sampling;
  if (!sampling.intervals()) sampling.resampling = Resampling::kBlurred;
}
// The levels before the last have a network of their own, or learn colours.
inline void own_network(OptionSetting& s) {
  if (s.options.network.shared) s.options.recipe.coarse = std::max(s.options.recipe.coarse, 0.1_r);
  s.options.network.shared = false;
}
inline void coloured_proposals(OptionSetting& s) {
  s.options.network.proposal_colour = true;
  s.options.recipe.coarse = std::max(s.options.recipe.coarse, 0.1_r);
}
// What trains them without colours.
inline void bounded_proposals(OptionSetting& s) {
  own_network(s);
  s.options.network.sampling.resampling = Resampling::kProposal;
  s.options.recipe.coarse = s.options.recipe.interlevel = 1;
}
// So dense that little light reaches most samples of a ReLU, and most of a softplus stop little.
inline void dense(OptionSetting& s) { s.options.network.density_bias = 2; }
inline void dense_and_skipping(OptionSetting& s) {
  dense(s);
  s.options.recipe.negligible = 0.25_r;
}

inline const std::vector<OptionLine>& option_lines() {
  static const std::vector<OptionLine> lines = {
      {"seed", {"2"}},
      {"steps", {"160"}},
      {"plan_changes", {"10:60"}},
      {"background", {"black"}},
      {"batch_samples", {"2880"}},
      {"rate", {"0.02"}},
      {"precision", {"bf16"}},
      {"network_rate", {"0.5"}},
      {"final_rate", {"0.5"}},
      {"warmup_steps", {"16"}, warmed_up},
      {"hold", {"0.5"}},
      {"beta1", {"0.9"}},
      {"final_beta1", {"0.8"}},
      {"beta2", {"0.99"}},
      {"final_beta2", {"0.95"}},
      {"huber_delta", {"0.05"}},
      {"distortion", {"0.01"}},
      {"depth_loss", {"0.5"}, with_depth},
      {"point_depth", {"0.3"}, unbounded_with_points},
      {"masked_share", {"0.5"}, with_masks},
      {"early_samples", {"1"}},
      {"shared_colour", {"0"}},
      {"stop_transmittance", {"0.1"}},
      {"gradient_roulette", {"0"}},
      {"occupancy_threshold", {"0.2"}},
      {"keep_unseen", {"true"}, one_place},
      {"keep_transparent", {"true"}},
      {"keep_free", {"true"}, unbounded_with_points},
      {"robust", {"0.4"}},
      {"appearance", {"4"}},
      {"colour_correction", {"on"}},
      {"code_rate", {"0.5"}, learnt_light},
      {"code_decay", {"50"}, learnt_light},
      {"colour_rate", {"0.5"}, learnt_light},
      {"colour_decay", {"50"}, learnt_light},
      {"exif_exposure", {"1"}, told_exposures},
      {"vignetting", {"on"}},
      {"vignetting_rate", {"0.5"}, learnt_light},
      {"vignetting_decay", {"50"}, learnt_light},
      {"sky", {"on"}, opaque_photos},
      {"sky_clearing", {"1"}, before_sky},
      {"deform", {"translation"}, photos_of_two_moments},
      {"ambient", {"2"}, moving},
      {"motion_rate", {"0.9"}, moving},
      {"motion_width", {"16"}, moving},
      {"motion_offset", {"0.5"}, moving},
      {"medium", {"water"}, opaque_photos},
      {"medium_rate", {"0.1"}, in_fog},
      {"refine_cameras", {"on"}, cameras_at_once},
      {"camera_rate", {"0.01"}, refined},
      {"camera_final_rate", {"0.5"}, refined},
      {"camera_first_step", {"8"}, refined},
      {"camera_steps", {"2"}, refined},
      {"camera_prior", {"100"}, refined},
      {"camera_lens", {"false"}, refined},
      {"camera_centre", {"true"}, refined},
      {"camera_first_levels", {"3"}, refined},
      {"camera_levels_open", {"0.9"}, refined},
      {"rolling_shutter", {"0.8"}, filmed},
      {"first_line", {"left"}, filmed_by_rows},
      {"grid.levels", {"3"}},
      {"grid.log2_entries", {"11"}},
      {"grid.features", {"2"}},
      {"grid.base_resolution", {"16", "8"}},
      {"grid.finest_resolution", {"0", "64"}},
      {"grid.hidden", {"32"}},
      {"grid.density_layers", {"2"}},
      {"grid.colour_layers", {"2", "1"}},
      {"grid.geometry_features", {"8"}},
      {"grid.occupancy_side", {"32"}},
      {"grid.max_samples", {"8"}},
      {"grid.min_samples", {"8"}},
      {"grid.samples_per_cell", {"1"}},
      {"grid.uniform_share", {"0.1"}},
      {"grid.min_transmittance", {"0.5"}},
      {"network.cast", {"cone", "point"}, intervals},
      {"network.space", {"contract", "identity"}},
      {"network.encoding", {"integrated", "frequency"}, standing},
      {"network.position_degrees", {"3"}},
      {"network.direction_degrees", {"2"}},
      {"network.view_dependence", {"false"}, without_codes},
      {"network.sampling.resampling", {"blurred", "proposal"}, coloured_proposals},
      {"network.sampling.spacing", {"inverse", "uniform"}},
      {"network.sampling.coarse", {"12"}},
      {"network.sampling.fine", {"12"}},
      {"network.sampling.rounds", {"2", "1"}},
      {"network.sampling.padding", {"0.1"}},
      {"network.shared", {"true", "false"}, coloured_proposals},
      {"network.depth", {"2"}},
      {"network.width", {"16"}},
      {"network.skip", {"1"}},
      {"network.bottleneck", {"16"}},
      {"network.view_width", {"8"}},
      {"network.image_code", {"2"}, without_cameras},
      {"network.camera_code", {"4", "2"}, two_cameras},
      {"network.transient_code", {"2"}},
      {"network.transient_depth", {"1"}, transient},
      {"network.transient_width", {"8"}, transient},
      {"network.code_spread", {"20"}, with_codes},
      {"network.proposal_depth", {"2"}, own_network},
      {"network.proposal_width", {"16"}, own_network},
      {"network.proposal_colour", {"false", "true"}, bounded_proposals},
      {"network.deform.warp", {"se3", "translation"}, moves_anywhere},
      {"network.deform.degrees", {"2"}, warped},
      {"network.deform.depth", {"3"}, warped},
      {"network.deform.width", {"8"}, warped},
      {"network.deform.skip", {"0", "2"}, warped},
      {"network.deform.code", {"3", "0"}, warped},
      {"network.deform.time_degrees", {"2"}, warped_by_time},
      {"network.deform.still_start", {"true", "false"}, translated},
      {"network.deform.slice", {"plane", "sheet"}, moves_anywhere},
      {"network.deform.ambient", {"3"}, sliced},
      {"network.deform.ambient_degrees", {"2"}, sliced},
      {"network.deform.sheet_degrees", {"2"}, sliced},
      {"network.deform.sheet_depth", {"3"}, sliced},
      {"network.deform.sheet_width", {"8"}, sliced},
      {"network.density", {"softplus", "relu"}},
      {"network.density_bias", {"0.5"}},
      {"network.colour_padding", {"0.1"}},
      {"network.opaque_end", {"true", "false"}, thin_and_opaque_photos},
      {"network.last_interval", {"0.01"}},
      {"network.initialisation", {"he", "glorot"}},
      {"recipe.rays", {"48"}},
      {"recipe.one_photo", {"true", "false"}, without_crop},  // a crop is of one photo anyway
      {"recipe.crop_steps", {"1"}},
      {"recipe.crop", {"0.25"}},
      {"recipe.coarse", {"0.5", "1"}, coloured_proposals},
      {"recipe.interlevel", {"1000"}, coloured_proposals},
      {"recipe.distortion", {"0.5"}},
      {"recipe.charbonnier", {"0.1"}},
      {"recipe.density_noise", {"1"}},
      {"recipe.beta2", {"0.9"}},
      {"recipe.epsilon", {"0.001"}},
      {"recipe.clip", {"0.00001"}},
      {"recipe.warmup_rate", {"0.5"}},
      {"recipe.near", {"0.7"}},
      {"recipe.far", {"4.5"}},
      {"recipe.photo_range", {"true", "false"}, sampled_by_points},
      {"recipe.transient_density", {"1"}, transient},
      {"recipe.least_deviation", {"0.2"}, transient},
      {"recipe.curriculum_steps", {"30"}, moments},
      {"recipe.window_steps", {"400"}, warped},
      {"recipe.ambient_start", {"6"}, sliced_in_steps},
      {"recipe.ambient_steps", {"400"}, sliced},
      {"recipe.elastic", {"10"}, warped},
      {"recipe.elastic_steps", {"2"}, elastic_for_steps},
      {"recipe.elastic_fall_steps", {"6"}, elastic_for_steps},
      {"recipe.still", {"10"}, warped},
      {"recipe.still_points", {"20"}, held_still},
      {"recipe.skip", {"false"}, dense_and_skipping},
      {"recipe.negligible", {"0.25"}, dense},
      {"recipe.empty_steps", {"1"}, dense_and_skipping},
      {"recipe.anneal", {"true", "false"}},
      {"recipe.anneal_steps", {"2"}, annealed},
  };
  return lines;
}

}  // namespace nerf::test
