// Changes of the colours of whole pixels.
#include <algorithm>
#include <memory>

#include "nerf/autodiff/operations.h"
#include "nerf/base/error.h"
#include "nerf/kernels/linear.h"

namespace nerf {
namespace {

class ChangeColours : public Operation {
 public:
  ChangeColours(Value pixel, Value change, Value out) : Operation({pixel, change}, out) {}
  const char* name() const override { return "change_colours"; }

  void forward(Chunk& c) const override {
    const int64_t lp = c.stride(inputs()[0]), la = c.stride(inputs()[1]), ly = c.stride(output());
    const Real* p = c.data(inputs()[0]);
    const Real* a = c.data(inputs()[1]);
    Real* y = c.data(output());
    for (int i = 0; i < 4; ++i)
      for (int64_t r = 0; r < round_up(c.rays, kLane); ++r) {
        Real sum = p[i * lp + r];
        if (i < 3) {
          sum += a[(9 + i) * la + r];
          for (int k = 0; k < 3; ++k) sum += a[(3 * i + k) * la + r] * p[k * lp + r];
        }
        y[i * ly + r] = r < c.rays ? sum : 0.0_r;
      }
  }

  void backward(Chunk& c) const override {
    const int64_t lp = c.stride(inputs()[0]), la = c.stride(inputs()[1]), ly = c.stride(output());
    const Real* p = c.data(inputs()[0]);
    const Real* a = c.data(inputs()[1]);
    const Real* dy = c.gradient(output());
    if (c.tape->needs_gradient(inputs()[0])) {
      Real* dp = c.gradient(inputs()[0]);
      if (overwrites(0)) clear(c, 4, dp, lp);
      for (int64_t r = 0; r < c.rays; ++r) {
        for (int i = 0; i < 4; ++i) dp[i * lp + r] += dy[i * ly + r];
        for (int i = 0; i < 3; ++i)
          for (int k = 0; k < 3; ++k) dp[k * lp + r] += a[(3 * i + k) * la + r] * dy[i * ly + r];
      }
    }
    if (!c.tape->needs_gradient(inputs()[1])) return;
    Real* da = c.gradient(inputs()[1]);
    if (overwrites(1)) clear(c, 12, da, la);
    for (int64_t r = 0; r < c.rays; ++r)
      for (int i = 0; i < 3; ++i) {
        da[(9 + i) * la + r] += dy[i * ly + r];
        for (int k = 0; k < 3; ++k) da[(3 * i + k) * la + r] += p[k * lp + r] * dy[i * ly + r];
      }
  }

 private:
  static void clear(const Chunk& c, int rows, Real* gradient, int64_t stride) {
    for (int i = 0; i < rows; ++i)
      std::fill_n(gradient + i * stride, round_up(c.rays, kLane), 0.0_r);
  }
};

}  // namespace

Value change_colours(Tape& tape, Value pixel, Value change) {
  NERF_CHECK_EQ(tape.rows(pixel), 4);
  NERF_CHECK_EQ(tape.rows(change), 12);
  NERF_CHECK(tape.domain(pixel) == Domain::kRays && tape.domain(change) == Domain::kRays);
  const Value from[] = {pixel, change};
  const Value out = tape.output(4, Domain::kRays, from);
  tape.record(std::make_unique<ChangeColours>(pixel, change, out));
  return out;
}

}  // namespace nerf
