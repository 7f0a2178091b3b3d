// What a lens does to pixels.
#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "autodiff/reference_ops.h"
#include "nerf/autodiff/operations.h"
#include "nerf/math/vignetting.h"

namespace nerf {
namespace {

template <class T>
T power(T x, double y) {
  using std::exp, std::log;
  return exp(T(y) * log(x));
}

// The transfer functions of sRGB (IEC 61966-2-1), by the real part.
template <class T>
T to_linear(T x) {
  using reference::real_part;
  return real_part(x) <= 0.04045 ? x / T(12.92) : power((x + T(0.055)) / T(1.055), 2.4);
}
template <class T>
T to_srgb(T x) {
  using reference::real_part;
  return real_part(x) <= 0.0031308 ? x * T(12.92) : T(1.055) * power(x, 1 / 2.4) - T(0.055);
}

template <class T>
Outputs<T> vignetted(const Given<T>& v) {
  using reference::real_part;
  Columns<T> out = v[0];
  for (size_t r = 0; r < out.size(); ++r) {
    const std::vector<T>&p = v[0][r], &behind = v[1][r], &a = v[2][r];
    const T x = v[3][r][0];
    const T gain = T(1) + a[0] * x + a[1] * x * x + a[2] * x * x * x;
    const T share = real_part(p[3]) > kLeastOpacity ? p[3] : T(kLeastOpacity);
    for (size_t k = 0; k < 3; ++k) {
      const T background = (T(1) - p[3]) * behind[k];
      out[r][k] = background + share * to_srgb(gain * to_linear((p[k] - background) / share));
    }
  }
  return {out, v[0], v[2]};
}

// Dark and bright colours, of much and of little opacity, below the transfer's straight part too.
TEST(Gradient, Vignette) {
  for (int needs = 1; needs < 4; ++needs)
    for (const double least : {0.05, 0.4})
      check_operation({"vignette",
                       {{4, kRays, (needs & 1) != 0, least, 1},
                        {3, kRays, false, 0, 1},
                        {3, kRays, (needs & 2) != 0, -0.3, 0.2},
                        {1, kRays, false, 0, 1.1}},
                       {},
                       [](Tape& t, const Values& v) {
                         return Values{vignette(t, v[0], v[1], v[2], v[3]), v[0], v[2]};
                       },
                       60},
                      []<class T>(const Given<T>& v) { return vignetted(v); });
}

// Behind nothing there is nothing to dim.
TEST(Vignette, LeavesTheBackground) {
  Tape tape(16, 16);
  const Value pixel = tape.input(4, kRays), background = tape.input(3, kRays);
  const Value falloff = tape.input(3, kRays), corner = tape.input(1, kRays);
  const Value out = vignette(tape, pixel, background, falloff, corner);
  tape.plan();
  Chunk chunk(tape);
  chunk.rays = 1;
  for (int k = 0; k < 3; ++k) {
    chunk.data(pixel)[k * chunk.stride(pixel)] = 0.7_r;
    chunk.data(background)[k * chunk.stride(background)] = 0.7_r;
    chunk.data(falloff)[k * chunk.stride(falloff)] = -0.2_r;
  }
  chunk.data(pixel)[3 * chunk.stride(pixel)] = 0;
  chunk.data(corner)[0] = 1;
  tape.forward(chunk);
  for (int k = 0; k < 3; ++k)
    EXPECT_NEAR(static_cast<double>(chunk.data(out)[k * chunk.stride(out)]), 0.7, 1e-6);
  EXPECT_EQ(chunk.data(out)[3 * chunk.stride(out)], 0.0_r);
}

}  // namespace
}  // namespace nerf
