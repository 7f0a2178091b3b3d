// New views of a trained model.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "nerf/base/cancel.h"
#include "nerf/base/real.h"
#include "nerf/base/threads.h"
#include "nerf/kernels/bf16.h"
#include "nerf/math/camera.h"
#include "nerf/math/vec.h"
#include "nerf/model/layers.h"
#include "nerf/model/medium.h"
#include "nerf/parts/codes.h"

namespace nerf {

class Insertion;  // model/insertion.h
class RadianceField;
struct ModelInfo;

inline constexpr int kMostSupersampling = 8;

struct RenderOptions {
  // sRGB; seen where alpha < 1. A paper's method that learnt photos without alpha has black.
  Vec3 background{1, 1, 1};
  // A field that has learnt a sky shows it in place of the background, with opacity 1, unless
  // `bbox` cuts the scene out.
  bool sky = true;
  bool unclipped = false;    // true samples every occupied cell, whatever is cached of it,
                             // without min_transmittance and what counts samples
  std::optional<Box3> bbox;  // input coordinates; nothing outside it is drawn
  Real time = 0;             // Ray::time of every ray
  // The light that the picture is taken in, where the field has learnt the photos'; a part of
  // another size than the field's is an error. Its change of colour is made last.
  Appearance appearance{};
  // A ray stops where the cached density lets less through, whatever it stopped at in training;
  // 0: nowhere.
  Real min_transmittance = 1e-6_r;
  // These three of the grid method. A ray also ends where the network's own densities let less
  // through; the samples behind add nothing.
  Real stop_transmittance = 1.0_r / 1024;
  Real unshaded = 1.0_r / 1024;  // share of a pixel's light whose colour may be left out
  // Share of a pixel's light that successive samples of its ray may have together to be given one
  // colour, that of the mean of their features by weight; 0: every sample has its own.
  Real shared_colour = 1.0_r / 8;
  // Grid method: a pixel whose neighbours foretell its colour to within so much, as far as can be
  // guessed, has no ray of its own (model/pixel_lattice.h; sRGB, [0, 1]); 0: every pixel has its
  // ray.
  Real interpolated = 4.0_r / 255;
  Precision precision = Precision::kAuto;  // of the networks' products
  // Rays along a pixel's side, averaged; 0: with the grid method a pixel's width in pixels of the
  // photos trained on (their median), rounded, 1 to kMostSupersampling; one with the paper methods.
  int supersample = 0;
  // Network samples of a ray of the grid method: how many against the last steps of training, how
  // many at most (training's, if those are more; never above kChunkSamples), and the weight of
  // those spread over all matter, which takes the place of SamplerOptions::uniform_share.
  Real sample_factor = 1;
  int max_samples = 96;
  Real uniform_share = 3;
  // Frame::layers is made too, of these and what they always hold; every pixel then has rays of its
  // own.
  std::optional<Layers> layers{};
  // What the scene is seen through, the box of the options or not; without: what the field has
  // learnt with its photos, if anything. An empty one leaves that out. Opacity counts the medium,
  // by the mean of the channels; distances, normals and samples are the field's alone.
  std::optional<Medium> medium{};

  // Turns off all of the above that leaves work out.
  void skip_nothing() {
    unclipped = true;
    min_transmittance = stop_transmittance = unshaded = shared_colour = interpolated = 0;
  }
};

// The work of a picture, the same for any number of threads.
struct RenderStatistics {
  int64_t rays = 0;      // marched: those of pixels that the lens and the box of the options cover
  int64_t segments = 0;  // passages of rays through occupied cells
  int64_t density_evaluations = 0, colour_evaluations = 0;  // network samples

  RenderStatistics& operator+=(const RenderStatistics& other);
};

// All images row by row from the top, one value (or three) per pixel.
struct Frame {
  int width = 0, height = 0;
  std::vector<Real> rgb;    // 3 per pixel, sRGB, background composited in
  std::vector<Real> alpha;  // opacity in [0, 1]
  // Median depth along the optical axis (of panoramas: along the ray), input unit; 0 where nothing.
  std::vector<Real> depth_z;
  RenderStatistics statistics{};
  PictureLayers layers{};  // of RenderOptions::layers
};

// What render() takes along a pixel's side: RenderOptions::supersample, or what its 0 stands for.
int rays_per_side(const RadianceField& field, const RenderOptions& options, const Camera& camera,
                  const Pose& camera_to_world);

// Renders the camera at camera.width x camera.height. `camera_to_world` in input coordinates,
// OpenCV axes; so is the eye of a stereo panorama (math/camera.h), of which this is one half.
// `progress` gets the fraction done in [0, 1], from one thread at a time. `insertion`: objects that
// stand in the picture. Throws Cancelled.
Frame render(const RadianceField& field, const Camera& camera, const Pose& camera_to_world,
             const RenderOptions& options, ThreadPool& pool,
             const std::function<void(double)>& progress = {}, const Cancel* cancel = nullptr,
             const Insertion* insertion = nullptr);

}  // namespace nerf
