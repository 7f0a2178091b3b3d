#include "autodiff/ray_rows.h"
#include "nerf/autodiff/operations.h"
#include "nerf/base/error.h"
#include "nerf/kernels/elementwise.h"

namespace nerf {
namespace {

// kernels/volume_rendering.h on a tape.
class CompositeOp : public Operation {
 public:
  CompositeOp(Value density, Value colour, Value delta, Value background, Value weights,
              Value pixel)
      : Operation({density, colour, delta, background}, pixel), weights_(weights) {}
  const char* name() const override { return "composite"; }

  void forward(Chunk& c) const override {
    Real* w = c.data(weights_);
    opacity(c.samples, c.data(inputs()[0]), c.data(inputs()[2]), w);
    composite_forward(internal::rays_of(c, inputs()[0]), w, internal::data_rows(c, inputs()[1]),
                      internal::data_rows(c, inputs()[3]), {c.data(output()), c.stride(output())});
  }

  void backward(Chunk& c) const override {
    NERF_CHECK(overwrites(0) && overwrites(1));
    const ColourRows<Real> d_colour = internal::gradient_rows(c, inputs()[1]);
    Real* d_density = c.gradient(inputs()[0]);
    composite_backward(internal::rays_of(c, inputs()[0]), c.data(inputs()[0]), c.data(inputs()[2]),
                       c.data(weights_), internal::data_rows(c, inputs()[1]),
                       internal::data_rows(c, inputs()[3]),
                       {c.gradient(output()), c.stride(output())}, d_density, d_colour);
    internal::clear_padding(c, inputs()[0], d_density);
    for (int k = 0; k < 3; ++k) internal::clear_padding(c, inputs()[1], d_colour.row(k));
  }

 private:
  Value weights_;
};

}  // namespace

Composite composite(Tape& tape, Value density, Value colour, Value delta, Value background) {
  NERF_CHECK_EQ(tape.rows(density), 1);
  NERF_CHECK_EQ(tape.rows(colour), 3);
  NERF_CHECK_EQ(tape.rows(background), 3);
  NERF_CHECK(!tape.needs_gradient(delta) && !tape.needs_gradient(background));  // not trained
  const Value from[] = {density, colour};
  const Value weights = tape.output(1, Domain::kSamples, {});
  const Value pixel = tape.output(4, Domain::kRays, from);
  tape.record(std::make_unique<CompositeOp>(density, colour, delta, background, weights, pixel));
  return {pixel, weights};
}

}  // namespace nerf
