// Leaves samples out of the backward pass that hardly change anything.
#include <algorithm>

#include "nerf/autodiff/operations.h"
#include "nerf/base/error.h"
#include "nerf/kernels/roulette.h"

namespace nerf {
namespace {

class Roulette : public Operation {
 public:
  // `values`: what the operations before it may read in their backward passes.
  Roulette(Value x, Value out, std::vector<Value> values, Real least)
      : Operation({x}, out), values_(std::move(values)), least_(least) {}
  const char* name() const override { return "roulette"; }

  void forward(Chunk&) const override {}

  std::unique_ptr<OperationState> make_state(const Tape& tape) const override {
    auto state = std::make_unique<RouletteState>();
    const size_t samples = static_cast<size_t>(tape.capacity(Domain::kSamples));
    state->kept.resize(samples);
    state->norms.resize(samples);
    state->factor.resize(samples);
    state->ray_begin.resize(static_cast<size_t>(tape.capacity(Domain::kRays)) + 1);
    return state;
  }

  void backward(Chunk& c) const override {
    const Value x = inputs()[0];
    NERF_CHECK(!overwrites(0));  // nothing after it reads x
    const int64_t ld = c.stride(x);
    const int rows = c.tape->rows(x);
    Real* dx = c.gradient(x);
    RouletteState& r = c.state<RouletteState>(output());
    column_norms(rows, c.samples, dx, ld, r.norms.data());
    const int64_t count = gradient_roulette(c.samples, r.norms.data(), least_, r.offset,
                                            r.kept.data(), r.factor.data());
    const int64_t padded = round_up(count, kLane);
    keep_columns(rows, r.kept.data(), count, dx, ld);
    for (int k = 0; k < rows; ++k) {
      Real* row = dx + k * ld;
      for (int64_t i = 0; i < count; ++i) row[i] *= r.factor[static_cast<size_t>(i)];
      std::fill(row + count, row + padded, 0.0_r);
    }
    for (const Value v : values_)
      if (c.has_pairs(v))
        keep_pairs(c.tape->rows(v), r.kept.data(), count, c.pairs(v));
      else
        keep_columns(c.tape->rows(v), r.kept.data(), count, c.data(v), c.stride(v));
    // Offsets of the samples that remain of each ray.
    int64_t at = 0;
    for (int ray = 0; ray <= c.rays; ++ray) {
      while (at < count && r.kept[static_cast<size_t>(at)] < c.ray_begin[ray]) ++at;
      r.ray_begin[static_cast<size_t>(ray)] = static_cast<int32_t>(at);
    }
    c.samples = static_cast<int>(count);
    c.ray_begin = r.ray_begin.data();
  }

 private:
  std::vector<Value> values_;
  Real least_;
};

}  // namespace

Value roulette(Tape& tape, Value x, Real least) {
  NERF_CHECK(tape.domain(x) == Domain::kSamples && tape.needs_gradient(x));
  const Value out = tape.output(1, Domain::kRays, {&x, 1});
  std::vector<Value> values;
  for (Value v = 0; v < out; ++v) {
    NERF_CHECK(tape.domain(v) != Domain::kGroups);
    if (tape.domain(v) == Domain::kSamples) values.push_back(v);
  }
  tape.record(std::make_unique<Roulette>(x, out, std::move(values), least));
  return out;
}

}  // namespace nerf
