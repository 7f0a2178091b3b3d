// The field of the paper methods: encoded positions through wide networks (Mildenhall et al. 2020,
// figure 7, and its successors), evaluated level by level on a ray.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "nerf/autodiff/operations.h"
#include "nerf/base/aligned.h"
#include "nerf/base/real.h"
#include "nerf/math/ndc.h"
#include "nerf/math/vec.h"
#include "nerf/model/deform_networks.h"
#include "nerf/model/field.h"
#include "nerf/model/network_options.h"
#include "nerf/model/pixel_loss.h"

namespace nerf {

// One network, of a scene that moves in canonical coordinates, with ambient ones beside them
// (deform_networks.h):
//   encoding -> depth layers of width, ReLU -> density (1)
//                                            -> bottleneck -> [., direction] -> ReLU -> colour (3)
// and where photos show what others do not, of the last level in training
//                                               bottleneck -> [., code] -> ReLU layers
//                                                          -> density (1), colour (3), deviation
//                                                          (1)
struct RadianceNetwork {
  std::vector<LinearWeights> trunk;
  LinearWeights density;
  LinearWeights bottleneck, view, colour;  // of size 0 where there is no colour
  // Hidden layers, then density, colour and deviation; empty: nothing is transient. Behind the
  // bottleneck and the photo's transient numbers.
  std::vector<LinearWeights> transient;
  // [photos x image_code], [cameras x camera_code], [photos x transient_code], behind all networks'
  // weights
  LinearWeights codes, camera_codes, transient_codes;
  DeformNetworks deform;  // the same of all networks, before their weights
  bool has_colour = false;
  size_t begin = 0, end = 0;  // in the field's weights
  size_t parameters() const;  // without padding and what all networks share
};

// The networks of these options, one behind the other: what leads points to the canonical scene,
// that of the levels before the last, unless all share one, then the last level's. Behind them come
// the codes.
std::vector<RadianceNetwork> place_networks(const NetworkOptions& options,
                                            const CodeShape& codes = {});
// Of these photos, as many numbers each as the options say; moments and cameras are the caller's.
CodeShape code_shape(const NetworkOptions& options, std::vector<std::string> photos);

inline const RadianceNetwork& network_of(const NetworkOptions& options,
                                         const std::vector<RadianceNetwork>& networks, int level) {
  return level + 1 == options.sampling.levels() ? networks.back() : networks.front();
}

// Everything that rendering needs. Plain data: the trainer writes it between steps.
struct NetworkField final : Field {
  // near and far: the first and last distance of samples from a camera, engine units; 0 and 1 in
  // normalised device coordinates. photos: that have a code (NetworkOptions::image_code).
  NetworkField(const NetworkOptions& options, double near, double far,
               std::vector<std::string> photos = {})
      : NetworkField(code_shape(options, std::move(photos)), options, near, far) {}
  NetworkField(const CodeShape& codes, const NetworkOptions& options, double near, double far);

  NetworkOptions options;
  double near, far;
  std::vector<RadianceNetwork> networks;
  CodeBooks books;
  AlignedArray<Real> weights;  // of the networks, then the books
  DeformWindows windows;       // of what pictures show, and of the training's next step
  NdcFrame ndc;                // engine units; with Space::kNdc

  const RadianceNetwork& network_of(int level) const {
    return nerf::network_of(options, networks, level);
  }
  size_t parameters() const;  // without padding, of the networks
  std::vector<LinearWeights> layers() const override;
  std::unique_ptr<FieldQuery> query(const LayerPacks* packs) const override;
  bool may_hold(const Vec3d&) const override { return true; }
  bool moves() const override { return options.deform.any(); }
  const CodeBooks& codes() const override { return books; }
  std::span<const Real> all_weights() const override { return weights.span(); }
  // Zeros, as the authors have it; of a scene that moves the light of the moment.
  std::vector<Real> default_code(Real time, int camera = -1) const override;
  size_t network_size() const { return networks.back().end; }  // of `weights`
  // Random weights, keyed by the seed; biases 0.
  void initialise(uint64_t seed);
};

// Whether the input is given again behind hidden layer `layer` of so many: every skip-th, but not
// behind the last, where nothing would read it.
bool input_behind(const NetworkOptions& options, int layer, int depth);
// What the transient layers end in: density, colour and deviation.
inline constexpr int kTransientRows = 5;

// Number of features of an encoded position and direction.
int position_features(const NetworkOptions& options);
int direction_features(const NetworkOptions& options);
// Rows of a level's position input: 3 coordinates, or one along each off-axis direction.
int position_rows(const NetworkOptions& options);

// Directions of the off-axis encoding: the vertices of an icosahedron whose edges are halved, one
// of each opposite pair (Barron et al. 2022, section 3; 21 unit vectors).
std::span<const Vec3> off_axis_directions();
// Of these options' encoding: those, or the three axes.
std::span<const Vec3> encoding_axes(const NetworkOptions& options);

// A level's network on a tape, with the values that a caller fills and reads.
struct NetworkTape {
  enum class Purpose {
    kTrain,     // with losses
    kRender,    // density, weights and pixel
    kDensity,   // density and weights
    kPoints,    // density and colour
    kGradient,  // density, and its gradient by position (with integrated encodings by the mean)
  };

  Tape tape;
  Value position = 0;    // in: [position_rows x samples], mean of a sample
  Value variance = 0;    // in, integrated encodings: the same shape
  Value directions = 0;  // in: [3 x rays], unit
  Value delta = 0;       // in: [1 x samples]
  Value photo = -1;      // in, training with codes: [1 x rays], Ray::photo; below 0: zeros
  Value camera = -1;     // in, training with cameras' codes: [1 x rays], a row of theirs
  Value code = -1;       // in, else, with such codes: [NetworkOptions::light() x rays]
  DeformInputs deform;
  Value noise = -1;      // in, training with density noise: [1 x samples], added to the raw density
  Value background = 0;  // in: [3 x rays]
  PixelLossInputs pixel_loss;   // in, training
  Value weight_gradient = -1;   // in between the passes, training: [1 x samples]
  Value density_gradient = -1;  // in, kGradient: [1 x samples]
  // Out: of what every photo shows, but for the pixel in training.
  Value density = 0;    // [1 x samples]
  Value weights = 0;    // [1 x samples]
  Value features = -1;  // [bottleneck x samples], with view dependence
  Value colour = -1;    // [3 x samples]
  Value pixel = -1;     // [4 x rays], a fifth row with transient matter

  struct Losses {
    bool colour = true;  // whether the level's pixels are compared with the photos
    PixelLoss pixel;
    bool on_weights = false;  // whether the caller has gradients of the weights
    bool density_noise = false;
    // Whether the pixel shows what is transient too. Its loss is then the uncertain one, with that
    // least deviation, and the mean transient density with that weight.
    bool transient = false;
    Real least_deviation = 0.03_r, transient_density = 0;
    bool elastic = false;  // whether the warp is held to motions of rigid parts
  };
  // For at most so many samples on at most so many rays.
  NetworkTape(const NetworkOptions& options, const RadianceNetwork& network, int samples, int rays,
              Purpose purpose, const Losses& losses);

  // Density and weights only.
  void forward_weights(Chunk& chunk) const { tape.forward(chunk, 0, weight_operations_); }
  void forward(Chunk& chunk) const { tape.forward(chunk); }
  // From the next pass on. All frequencies are open at first.
  void open(const DeformWindows& windows);
  // Of as many samples as the chunk has.
  void place_axes(Chunk& chunk) const;
  // Whether a backward pass gives any gradient.
  bool learns() const { return pixel >= 0 || weight_gradient >= 0 || deform.elastic_scale >= 0; }

 private:
  // Features of the position, canonical where the scene moves.
  Value record_position(const NetworkOptions& options, const RadianceNetwork& network,
                        Purpose purpose, const Losses& losses);
  void record_transient(const NetworkOptions& options, const RadianceNetwork& network,
                        const Losses& losses);
  size_t weight_operations_ = 0;
  std::shared_ptr<std::vector<Real>> warp_window_, ambient_window_;
};

// Colours of samples from the bottleneck's features, the unit directions [3 x rays] and the photos'
// numbers [image_code x rays], below 0: none.
Value record_colour(Tape& tape, const NetworkOptions& options, const RadianceNetwork& network,
                    Value features, Value directions, Value numbers);

}  // namespace nerf
