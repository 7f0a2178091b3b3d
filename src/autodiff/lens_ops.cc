// What a lens does to whole pixels.
#include <algorithm>
#include <memory>

#include "nerf/autodiff/operations.h"
#include "nerf/base/error.h"
#include "nerf/kernels/linear.h"
#include "nerf/math/vignetting.h"

namespace nerf {
namespace {

class Vignette : public Operation {
 public:
  Vignette(Value pixel, Value background, Value falloff, Value corner, Value out)
      : Operation({pixel, background, falloff, corner}, out) {}
  const char* name() const override { return "vignette"; }

  void forward(Chunk& c) const override {
    const int64_t ly = c.stride(output());
    Real* y = c.data(output());
    for (int64_t r = 0; r < c.rays; ++r) {
      const Seen seen(c, *this, r);
      for (int k = 0; k < 3; ++k) y[k * ly + r] = seen.behind[k] + seen.share * seen.dimmed[k];
      y[3 * ly + r] = seen.opacity;
    }
    for (int i = 0; i < 4; ++i)
      std::fill(y + i * ly + c.rays, y + i * ly + round_up(c.rays, kLane), 0.0_r);
  }

  // With c = f / s the colour before the background, f its share of the pixel, s the share's size,
  // L and S the transfer to light and back: pixel = behind + s S(gain L(c)).
  void backward(Chunk& c) const override {
    const int64_t lp = c.stride(inputs()[0]), lb = c.stride(inputs()[1]),
                  lf = c.stride(inputs()[2]), ly = c.stride(output());
    const Real* b = c.data(inputs()[1]);
    const Real* dy = c.gradient(output());
    Real* dp = c.tape->needs_gradient(inputs()[0]) ? c.gradient(inputs()[0]) : nullptr;
    Real* df = c.tape->needs_gradient(inputs()[2]) ? c.gradient(inputs()[2]) : nullptr;
    if (dp && overwrites(0)) clear(c, 4, dp, lp);
    if (df && overwrites(2)) clear(c, kFalloff, df, lf);
    for (int64_t r = 0; r < c.rays; ++r) {
      const Seen seen(c, *this, r);
      Real d_gain = 0, d_opacity = dy[3 * ly + r];
      for (int k = 0; k < 3; ++k) {
        const Real g = dy[k * ly + r], behind = b[k * lb + r];
        // S' at the dimmed light, L' at the colour.
        const Real back = seen.dimmed_light[k] <= 0.0031308_r
                              ? 12.92_r
                              : (seen.dimmed[k] + 0.055_r) / (2.4_r * seen.dimmed_light[k]);
        const Real there = seen.colour[k] <= 0.04045_r
                               ? 1 / 12.92_r
                               : 2.4_r * seen.light[k] / (seen.colour[k] + 0.055_r);
        const Real slope = back * seen.gain * there;
        d_gain += g * seen.share * back * seen.light[k];
        if (dp) dp[k * lp + r] += slope * g;
        d_opacity += g * (slope - 1) * behind;
        if (seen.opacity > kLeast) d_opacity += g * (seen.dimmed[k] - slope * seen.colour[k]);
      }
      if (dp) dp[3 * lp + r] += d_opacity;
      Real power = seen.square;
      for (int i = 0; df && i < kFalloff; ++i, power *= seen.square)
        df[i * lf + r] += d_gain * power;
    }
  }

 private:
  static constexpr Real kLeast = static_cast<Real>(kLeastOpacity);

  struct Seen {
    Seen(const Chunk& c, const Vignette& op, int64_t r) {
      const Value pixel = op.inputs()[0], background = op.inputs()[1], falloff = op.inputs()[2];
      square = c.data(op.inputs()[3])[r];
      Real abc[kFalloff];
      for (int i = 0; i < kFalloff; ++i) abc[i] = c.data(falloff)[i * c.stride(falloff) + r];
      gain = falloff_gain(abc, square);
      opacity = c.data(pixel)[3 * c.stride(pixel) + r];
      share = std::max(opacity, kLeast);
      for (int k = 0; k < 3; ++k) {
        behind[k] = (1 - opacity) * c.data(background)[k * c.stride(background) + r];
        colour[k] = (c.data(pixel)[k * c.stride(pixel) + r] - behind[k]) / share;
        light[k] = srgb_to_linear(colour[k]);
        dimmed_light[k] = gain * light[k];
        dimmed[k] = linear_to_srgb(dimmed_light[k]);
      }
    }
    Real square, gain, opacity, share;
    Real behind[3], colour[3], light[3], dimmed_light[3], dimmed[3];
  };

  static void clear(const Chunk& c, int rows, Real* gradient, int64_t stride) {
    for (int i = 0; i < rows; ++i)
      std::fill_n(gradient + i * stride, round_up(c.rays, kLane), 0.0_r);
  }
};

}  // namespace

Value vignette(Tape& tape, Value pixel, Value background, Value falloff, Value corner) {
  NERF_CHECK_EQ(tape.rows(pixel), 4);
  NERF_CHECK_EQ(tape.rows(background), 3);
  NERF_CHECK_EQ(tape.rows(falloff), kFalloff);
  NERF_CHECK_EQ(tape.rows(corner), 1);
  for (const Value v : {pixel, background, falloff, corner})
    NERF_CHECK(tape.domain(v) == Domain::kRays);
  // They are where the photo is, and not trained.
  NERF_CHECK(!tape.needs_gradient(background) && !tape.needs_gradient(corner));
  const Value from[] = {pixel, falloff};
  const Value out = tape.output(4, Domain::kRays, from);
  tape.record(std::make_unique<Vignette>(pixel, background, falloff, corner, out));
  return out;
}

}  // namespace nerf
