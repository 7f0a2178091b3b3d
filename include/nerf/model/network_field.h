// The field of the paper methods: encoded positions through wide networks (Mildenhall et al. 2020,
// figure 7, and its successors), evaluated level by level on a ray.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "nerf/autodiff/operations.h"
#include "nerf/base/aligned.h"
#include "nerf/base/real.h"
#include "nerf/math/ndc.h"
#include "nerf/math/vec.h"
#include "nerf/model/field.h"
#include "nerf/model/network_options.h"
#include "nerf/model/pixel_loss.h"

namespace nerf {

// One network:
//   encoding -> depth layers of width, ReLU -> density (1)
//                                            -> bottleneck -> [., direction] -> ReLU -> colour (3)
struct RadianceNetwork {
  std::vector<LinearWeights> trunk;
  LinearWeights density;
  LinearWeights bottleneck, view, colour;  // of size 0 where there is no colour
  LinearWeights codes;                     // [photos x image_code], behind all networks' weights
  bool has_colour = false;
  size_t begin = 0, end = 0;  // in the field's weights
  size_t parameters() const;  // without padding
};

// The networks of these options, one behind the other: that of the levels before the last, unless
// all share one, then the last level's. Behind them come the codes of so many photos.
std::vector<RadianceNetwork> place_networks(const NetworkOptions& options, int photos = 0);
// Of these photos, NetworkOptions::image_code numbers each.
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
               std::vector<std::string> photos = {});

  NetworkOptions options;
  double near, far;
  std::vector<RadianceNetwork> networks;
  CodeBooks books;
  AlignedArray<Real> weights;  // of the networks, then the books
  NdcFrame ndc;                // engine units; with Space::kNdc

  const RadianceNetwork& network_of(int level) const {
    return nerf::network_of(options, networks, level);
  }
  size_t parameters() const;  // without padding, of the networks
  std::vector<LinearWeights> layers() const override;
  std::unique_ptr<FieldQuery> query(const LayerPacks* packs) const override;
  bool may_hold(const Vec3d&) const override { return true; }
  const CodeBooks& codes() const override { return books; }
  std::span<const Real> all_weights() const override { return weights.span(); }
  // Zeros, as the authors have it.
  std::vector<Real> default_code() const override {
    return std::vector<Real>(static_cast<size_t>(options.image_code), 0.0_r);
  }
  size_t network_size() const { return networks.back().end; }  // of `weights`
  // Random weights, keyed by the seed; biases 0.
  void initialise(uint64_t seed);
};

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
  Value photo = -1;      // in, training with image codes: [1 x rays], Ray::photo; below 0: zeros
  Value code = -1;       // in, else with image codes: [image_code x rays]
  Value noise = -1;      // in, training with density noise: [1 x samples], added to the raw density
  Value background = 0;  // in: [3 x rays]
  PixelLossInputs pixel_loss;   // in, training
  Value weight_gradient = -1;   // in between the passes, training: [1 x samples]
  Value density_gradient = -1;  // in, kGradient: [1 x samples]
  Value density = 0;            // out: [1 x samples]
  Value weights = 0;            // out: [1 x samples]
  Value colour = -1;            // out: [3 x samples]
  Value pixel = -1;             // out: [4 x rays]

  struct Losses {
    bool colour = true;  // whether the level's pixels are compared with the photos
    PixelLoss pixel;
    bool on_weights = false;  // whether the caller has gradients of the weights
    bool density_noise = false;
  };
  // For at most so many samples on at most so many rays.
  NetworkTape(const NetworkOptions& options, const RadianceNetwork& network, int samples, int rays,
              Purpose purpose, const Losses& losses);

  // Density and weights only.
  void forward_weights(Chunk& chunk) const { tape.forward(chunk, 0, weight_operations_); }
  void forward(Chunk& chunk) const { tape.forward(chunk); }

 private:
  size_t weight_operations_ = 0;
};

}  // namespace nerf
