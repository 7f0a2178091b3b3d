#include <algorithm>

#include "nerf/autodiff/operations.h"
#include "nerf/base/error.h"
#include "nerf/kernels/elementwise.h"
#include "nerf/kernels/linear_bf16.h"

namespace nerf {
namespace {

class Linear : public Operation {
 public:
  Linear(Value x, Value y, const LinearWeights& w, LinearActivation activation)
      : Operation({x}, y), w_(w), activation_(activation) {}

  const char* name() const override { return "linear"; }
  LinearActivation activation() const { return activation_; }

  void forward(Chunk& c) const override {
    const Value x = inputs()[0], y = output();
    const Real* bias = w_.bias ? c.weights + w_.bias_offset() : nullptr;
    if (const uint16_t* packed = bf16_pack(c))
      linear_forward_bf16(w_.in, w_.out, packed, bias, input(c),
                          c.has_pairs(y) ? LayerOutput(c.pairs(y)) : c.data(y), c.stride(x),
                          c.count(x), activation_);
    else
      linear_forward(w_.in, w_.out, c.weights + w_.offset, bias, c.data(x), c.data(y), c.stride(x),
                     c.count(x), activation_, f32_pack(c));
  }

  void backward(Chunk& c) const override {
    const Value x = inputs()[0];
    const int64_t ld = c.stride(x), n = c.count(x);
    Real* dy = c.gradient(output());
    // Where the only reader is another layer, that one has applied the ReLU's mask already.
    if (activation_ == LinearActivation::kRelu && !masked_by_reader(c))
      relu_backward(w_.out, c.data(output()), dy, ld, n);

    const uint16_t* packed = bf16_pack(c);
    const bool needs_dx = c.tape->needs_gradient(x);
    // In bf16 the input's gradient first: where it reads x for a mask, x comes from memory while
    // its sums are made. In f32 the weights' gradient prefetches x, so that it goes first.
    if (packed && needs_dx) backward_input(c, packed, dy);
    Real* dw = c.weight_gradient + w_.offset;
    Real* dbias = w_.bias ? c.weight_gradient + w_.bias_offset() : nullptr;
    if (packed)
      linear_backward_weights_bf16(w_.in, w_.out, dy, input(c), ld, n, dw, dbias);
    else
      linear_backward_weights(w_.in, w_.out, dy, c.data(x), ld, n, dw, dbias);
    if (!packed && needs_dx) backward_input(c, packed, dy);
  }

  bool writes_pairs() const override {
    return activation_ == LinearActivation::kRelu && layer_writes_pairs(w_.in, w_.out);
  }
  bool reads_pairs() const override { return true; }

 private:
  void backward_input(Chunk& c, const uint16_t* packed, const Real* dy) const {
    const Value x = inputs()[0];
    const int64_t ld = c.stride(x), n = c.count(x);
    const Linear* maker = dynamic_cast<const Linear*>(c.tape->producer(x));
    const bool mask =
        maker && maker->activation_ == LinearActivation::kRelu && c.tape->only_consumer(x) == this;
    Real* dx = overwrites(0) ? c.gradient(x) : c.arena.data() + c.tape->scratch_offset();
    if (packed)
      linear_backward_input_bf16(w_.in, w_.out, packed, dy, dx, ld, n, mask ? input(c) : nullptr);
    else
      linear_backward_input(w_.in, w_.out, c.weights + w_.offset, dy, dx, ld, n,
                            mask ? c.data(x) : nullptr, f32_pack(c));
    if (!overwrites(0))
      for (int r = 0; r < w_.in; ++r) add_to(n, dx + r * ld, c.gradient(x) + r * ld);
  }

  bool masked_by_reader(const Chunk& c) const {
    return dynamic_cast<const Linear*>(c.tape->only_consumer(output())) != nullptr;
  }

  LayerInput input(Chunk& c) const {
    const Value x = inputs()[0];
    return c.has_pairs(x) ? LayerInput(c.pairs(x)) : c.data(x);
  }
  const uint16_t* bf16_pack(const Chunk& c) const {
    return c.packs && c.packs->bf16.size() > 0 ? c.packs->bf16.data() + w_.packed_bf16 : nullptr;
  }
  const Real* f32_pack(const Chunk& c) const {
    const bool packed = c.packs && linear_pack_size(w_.in, w_.out) > 0;
    return packed ? c.packs->f32.data() + w_.packed : nullptr;
  }

  LinearWeights w_;
  LinearActivation activation_;
};

}  // namespace

Value linear(Tape& tape, Value x, const LinearWeights& w, LinearActivation activation) {
  NERF_CHECK_EQ(tape.rows(x), w.in);
  const Value y = tape.output(w.out, tape.domain(x), {&x, 1}, /*trained=*/true);
  tape.need_scratch(static_cast<size_t>(w.in) * static_cast<size_t>(tape.capacity(tape.domain(x))));
  tape.record(std::make_unique<Linear>(x, y, w, activation));
  return y;
}

Value mlp(Tape& tape, Value x, std::span<const LinearWeights> layers) {
  for (size_t i = 0; i < layers.size(); ++i)
    x = linear(tape, x, layers[i],
               i + 1 < layers.size() ? LinearActivation::kRelu : LinearActivation::kNone);
  return x;
}

}  // namespace nerf
