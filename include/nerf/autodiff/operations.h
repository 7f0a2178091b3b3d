// Operations that model code writes on a tape. Shapes in brackets: [rows x columns], columns being
// the samples or the rays of a chunk.
#pragma once

#include <span>

#include "nerf/autodiff/tape.h"
#include "nerf/kernels/linear.h"

namespace nerf {

// Where a layer's weights stand in the model's parameter array: [out x weight_stride(in)].
struct LinearWeights {
  size_t offset = 0;
  int in = 0, out = 0;
  size_t size() const { return static_cast<size_t>(out) * static_cast<size_t>(weight_stride(in)); }
};

// [in x n] -> [out x n], no bias: act(W x).
Value linear(Tape& tape, Value x, const LinearWeights& w, LinearActivation activation);

// ReLU layers with a linear last one (a fused MLP of tiny-cuda-nn's kind).
Value mlp(Tape& tape, Value x, std::span<const LinearWeights> layers);

// Rows of a above rows of b.
Value concat(Tape& tape, Value a, Value b);

// Rows [first, first + rows) of x.
Value slice(Tape& tape, Value x, int first, int rows);

// Density exp(x), truncated (kernels/elementwise.h).
Value truncated_exp(Tape& tape, Value x);

Value sigmoid(Tape& tape, Value x);

// Spherical harmonics [16 x samples] of the unit directions [3 x rays], repeated for a ray's
// samples.
Value view_code(Tape& tape, Value directions);

// Volume rendering (NeRF, equation 3) over the samples of each ray.
//   density [1 x samples], colour [3 x samples], delta [1 x samples] interval lengths (the last may
//   be infinite: kLongestInterval, kernels/elementwise.h),
//   background [3 x rays] -> [4 x rays]: colour over the background, opacity.
// Weights are left in the chunk: see weights().
struct Composite {
  Value pixel;    // [4 x rays]
  Value weights;  // [1 x samples], no gradient
};
Composite composite(Tape& tape, Value density, Value colour, Value delta, Value background);

// Huber loss of the pixels' colour against target [3 x rays], summed over channels and rays of the
// chunk and times `scale` (1 / (3 rays of the step)); for |r| <= delta it equals r^2. Adds to
// Chunk::loss.
Value huber_loss(Tape& tape, Value pixel, Value target, Value scale, float delta);

}  // namespace nerf
