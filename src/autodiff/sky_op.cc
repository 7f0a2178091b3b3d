// A sky behind everything, whose colour is learnt.
#include <algorithm>

#include "nerf/autodiff/operations.h"
#include "nerf/base/error.h"

namespace nerf {
namespace {

class OverSky : public Operation {
 public:
  OverSky(Value pixel, Value sky, Value cover, Value out) : Operation({pixel, sky, cover}, out) {}
  const char* name() const override { return "over_sky"; }

  void forward(Chunk& c) const override {
    const Value pixel = inputs()[0], sky = inputs()[1];
    const int64_t padded = round_up(c.rays, kLane);
    const int64_t lx = c.stride(pixel), lb = c.stride(sky), ly = c.stride(output());
    const Real *x = c.data(pixel), *b = c.data(sky), *cover = c.data(inputs()[2]);
    Real* y = c.data(output());
    for (int64_t i = 0; i < padded; ++i) {
      const bool used = i < c.rays;
      const Real share = used ? (1 - x[3 * lx + i]) * cover[i] : 0;
      for (int k = 0; k < 3; ++k) y[k * ly + i] = used ? x[k * lx + i] + share * b[k * lb + i] : 0;
      y[3 * ly + i] = used ? x[3 * lx + i] + share : 0;
    }
  }

  void backward(Chunk& c) const override {
    const Value pixel = inputs()[0], sky = inputs()[1];
    const int64_t padded = round_up(c.rays, kLane);
    const int64_t lx = c.stride(pixel), lb = c.stride(sky), ly = c.stride(output());
    const Real *x = c.data(pixel), *b = c.data(sky), *cover = c.data(inputs()[2]);
    const Real* dy = c.gradient(output());
    Real* dx = c.tape->needs_gradient(pixel) ? c.gradient(pixel) : nullptr;
    Real* db = c.tape->needs_gradient(sky) ? c.gradient(sky) : nullptr;
    for (int k = 0; dx && overwrites(0) && k < 4; ++k)
      std::fill(dx + k * lx, dx + k * lx + padded, 0.0_r);
    for (int k = 0; db && overwrites(1) && k < 3; ++k)
      std::fill(db + k * lb, db + k * lb + padded, 0.0_r);
    for (int64_t i = 0; i < c.rays; ++i) {
      const Real share = (1 - x[3 * lx + i]) * cover[i];
      Real d_opacity = (1 - cover[i]) * dy[3 * ly + i];
      for (int k = 0; k < 3; ++k) {
        const Real d = dy[k * ly + i];
        d_opacity -= cover[i] * b[k * lb + i] * d;
        if (dx) dx[k * lx + i] += d;
        if (db) db[k * lb + i] += share * d;
      }
      if (dx) dx[3 * lx + i] += d_opacity;
    }
  }
};

}  // namespace

Value over_sky(Tape& tape, Value pixel, Value sky, Value cover) {
  NERF_CHECK_EQ(tape.rows(pixel), 4);
  NERF_CHECK_EQ(tape.rows(sky), 3);
  NERF_CHECK_EQ(tape.rows(cover), 1);
  const Value from[] = {pixel, sky, cover};
  for (const Value v : from) NERF_CHECK(tape.domain(v) == Domain::kRays);
  NERF_CHECK(!tape.needs_gradient(cover));
  const Value out = tape.output(4, Domain::kRays, from);
  tape.record(std::make_unique<OverSky>(pixel, sky, cover, out));
  return out;
}

}  // namespace nerf
