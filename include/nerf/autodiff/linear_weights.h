// Weights of linear layers: where they stand, and their packs.
#pragma once

#include <cmath>
#include <cstdint>
#include <span>

#include "nerf/base/aligned.h"
#include "nerf/base/real.h"
#include "nerf/base/threads.h"
#include "nerf/kernels/bf16.h"
#include "nerf/kernels/linear.h"
#include "nerf/math/random.h"

namespace nerf {

// Where a layer's weights stand in the model's parameter array: [out x weight_stride(in)], then,
// where it has one, the bias [out], padded to kLane.
struct LinearWeights {
  size_t offset = 0;
  int in = 0, out = 0;
  bool bias = false;
  size_t packed = 0;       // where its pack in f32 begins (kernels/linear.h)
  size_t packed_bf16 = 0;  // and that in bf16 (kernels/linear_bf16.h), both in elements
  size_t bias_offset() const {
    return offset + static_cast<size_t>(out) * static_cast<size_t>(weight_stride(in));
  }
  size_t size() const {
    return bias_offset() - offset + (bias ? static_cast<size_t>(round_up(out, kLane)) : 0);
  }
  // Without padding.
  size_t parameters() const {
    return static_cast<size_t>(out) * static_cast<size_t>(in + (bias ? 1 : 0));
  }
};

// What the products read instead of the weights.
struct LayerPacks {
  AlignedArray<uint16_t> bf16;  // of all layers; empty: the products are taken in f32
  AlignedArray<Real> f32;       // then: of the wide ones
};

// Draws a layer's first weights evenly from [-bound, bound]; its bias stays.
void draw_weights(const LinearWeights& w, Real bound, Random random, Real* weights);
// The bound of Glorot and Bengio 2010, equation 16.
inline Real xavier_bound(const LinearWeights& w) {
  return std::sqrt(6.0_r / static_cast<Real>(w.in + w.out));
}

// Places the layers' packs one behind the other.
void place_packs(std::span<LinearWeights* const> layers);
// Packs the layers anew, for Chunk::packs: after every change of the weights. Allocates at the
// first call only. kAuto is what resolve_precision() says.
void pack_layers(std::span<const LinearWeights> layers, const Real* weights, Precision precision,
                 LayerPacks& packs, ThreadPool& pool);

}  // namespace nerf
