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
  ChangeColours(Value pixel, Value background, Value change, Value out)
      : Operation({pixel, background, change}, out) {}
  const char* name() const override { return "change_colours"; }

  void forward(Chunk& c) const override {
    const int64_t lp = c.stride(inputs()[0]), la = c.stride(inputs()[2]), ly = c.stride(output());
    const Real* p = c.data(inputs()[0]);
    const Real* a = c.data(inputs()[2]);
    Real* y = c.data(output());
    for (int64_t r = 0; r < c.rays; ++r) {
      const Foreground own(c, *this, r);
      for (int i = 0; i < 3; ++i) {
        Real sum = p[i * lp + r] + a[(9 + i) * la + r] * own.opacity;
        for (int k = 0; k < 3; ++k) sum += a[(3 * i + k) * la + r] * own.rgb[k];
        y[i * ly + r] = sum;
      }
      y[3 * ly + r] = own.opacity;
    }
    for (int i = 0; i < 4; ++i)
      std::fill(y + i * ly + c.rays, y + i * ly + round_up(c.rays, kLane), 0.0_r);
  }

  void backward(Chunk& c) const override {
    const int64_t lp = c.stride(inputs()[0]), lb = c.stride(inputs()[1]),
                  la = c.stride(inputs()[2]), ly = c.stride(output());
    const Real* b = c.data(inputs()[1]);
    const Real* a = c.data(inputs()[2]);
    const Real* dy = c.gradient(output());
    Real* dp = c.tape->needs_gradient(inputs()[0]) ? c.gradient(inputs()[0]) : nullptr;
    Real* da = c.tape->needs_gradient(inputs()[2]) ? c.gradient(inputs()[2]) : nullptr;
    if (dp && overwrites(0)) clear(c, 4, dp, lp);
    if (da && overwrites(2)) clear(c, 12, da, la);
    for (int64_t r = 0; r < c.rays; ++r) {
      const Foreground own(c, *this, r);
      for (int i = 0; i < 3; ++i) {
        const Real g = dy[i * ly + r];
        if (dp) dp[i * lp + r] += g;
        if (dp) dp[3 * lp + r] += a[(9 + i) * la + r] * g;
        if (da) da[(9 + i) * la + r] += own.opacity * g;
        for (int k = 0; k < 3; ++k) {
          const Real m = a[(3 * i + k) * la + r];
          if (dp) dp[k * lp + r] += m * g;
          if (dp) dp[3 * lp + r] += m * b[k * lb + r] * g;
          if (da) da[(3 * i + k) * la + r] += own.rgb[k] * g;
        }
      }
      if (dp) dp[3 * lp + r] += dy[3 * ly + r];
    }
  }

 private:
  // A pixel without its background.
  struct Foreground {
    Foreground(const Chunk& c, const ChangeColours& op, int64_t r) {
      const Value pixel = op.inputs()[0], background = op.inputs()[1];
      opacity = c.data(pixel)[3 * c.stride(pixel) + r];
      for (int k = 0; k < 3; ++k)
        rgb[k] = c.data(pixel)[k * c.stride(pixel) + r] -
                 (1 - opacity) * c.data(background)[k * c.stride(background) + r];
    }
    Real rgb[3], opacity;
  };

  static void clear(const Chunk& c, int rows, Real* gradient, int64_t stride) {
    for (int i = 0; i < rows; ++i)
      std::fill_n(gradient + i * stride, round_up(c.rays, kLane), 0.0_r);
  }
};

}  // namespace

Value change_colours(Tape& tape, Value pixel, Value background, Value change) {
  NERF_CHECK_EQ(tape.rows(pixel), 4);
  NERF_CHECK_EQ(tape.rows(background), 3);
  NERF_CHECK_EQ(tape.rows(change), 12);
  for (const Value v : {pixel, background, change}) NERF_CHECK(tape.domain(v) == Domain::kRays);
  NERF_CHECK(!tape.needs_gradient(background));  // not trained
  const Value from[] = {pixel, change};
  const Value out = tape.output(4, Domain::kRays, from);
  tape.record(std::make_unique<ChangeColours>(pixel, background, change, out));
  return out;
}

}  // namespace nerf
