#include "nerf/autodiff/linear_weights.h"

#include <algorithm>

#include "nerf/kernels/linear_bf16.h"

namespace nerf {

void draw_weights(const LinearWeights& w, Real bound, Random random, Real* weights) {
  for (int j = 0; j < w.out; ++j)
    for (int k = 0; k < w.in; ++k)
      weights[w.offset + static_cast<size_t>(j * weight_stride(w.in) + k)] =
          bound * (2 * random.uniform() - 1);
}

void place_packs(std::span<LinearWeights* const> layers) {
  size_t f32 = 0, bf16 = 0;
  for (LinearWeights* w : layers) {
    w->packed = f32;
    w->packed_bf16 = bf16;
    f32 += static_cast<size_t>(linear_pack_size(w->in, w->out));
    bf16 += static_cast<size_t>(packed_layer_size(w->in, w->out));
  }
}

void pack_layers(std::span<const LinearWeights> layers, const Real* weights, Precision precision,
                 LayerPacks& packs, ThreadPool& pool) {
  const bool bf16 = resolve_precision(precision) == Precision::kBf16;
  size_t size = 0;
  for (const LinearWeights& w : layers) {
    const int64_t own = bf16 ? packed_layer_size(w.in, w.out) : linear_pack_size(w.in, w.out);
    size = std::max(size, (bf16 ? w.packed_bf16 : w.packed) + static_cast<size_t>(own));
  }
  if (bf16 && packs.bf16.size() < size) packs.bf16 = AlignedArray<uint16_t>(size);
  if (!bf16 && packs.f32.size() < size) packs.f32 = AlignedArray<Real>(size);
  pool.parallel_for(static_cast<int64_t>(layers.size()), [&](int64_t i) {
    const LinearWeights& w = layers[static_cast<size_t>(i)];
    if (bf16)
      pack_layer(w.in, w.out, weights + w.offset, packs.bf16.data() + w.packed_bf16);
    else
      linear_pack(w.in, w.out, weights + w.offset, packs.f32.data() + w.packed);
  });
}

}  // namespace nerf
