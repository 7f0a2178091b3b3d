// Losses of pixels whose errors have every magnitude, with every kink, epsilon and scale.
#include "nerf/math/reference/pixel_losses.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "math/worst_error.h"
#include "nerf/autodiff/operations.h"
#include "nerf/math/reference/huber.h"
#include "stress/magnitudes.h"

namespace nerf::stress {
namespace {

// Value and slope in double of an error of one channel.
struct Exact {
  double value, slope;
};

struct Kind {
  std::string name;
  double parameter;
  Value (*record)(Tape&, Value pixel, Value target, Value scale, Real parameter);
  Exact (*exact)(double e, double parameter);
};

std::vector<Kind> kinds() {
  std::vector<Kind> out = {
      {"squared", 0,
       [](Tape& t, Value p, Value y, Value s, Real) { return squared_loss(t, p, y, s); },
       [](double e, double) { return Exact{reference::squared(e), reference::squared_slope(e)}; }}};
  for (const double delta : {1e-30, 1e-3, 1.0, 1e18})
    out.push_back({"huber", delta, huber_loss, [](double e, double d) {
                     return Exact{reference::huber(e, d), reference::huber_slope(e, d)};
                   }});
  for (const double epsilon : {1e-44, 1e-30, 1e-20, 1e-12, 1e-3, 1.0})
    out.push_back({"charbonnier", epsilon, charbonnier_loss, [](double e, double c) {
                     return Exact{reference::charbonnier(e, c), reference::charbonnier_slope(e, c)};
                   }});
  return out;
}

// Three errors of a ray: any, none, and any against a target that is not 0.
struct Pixels {
  explicit Pixels(const std::vector<Real>& all) : count(static_cast<int>(all.size())) {
    for (size_t i = 0; i < all.size(); ++i) {
      const Real other = all[(7 * i + 3) % all.size()];
      rows.push_back({all[i], other, other});
      targets.push_back({0.0_r, other, i % 2 ? 1.0_r : all[i]});
    }
  }
  int count;
  std::vector<std::array<Real, 3>> rows, targets;
};

// A loss is at least 0 and finite, and so is its slope, whose size is at most that of twice the
// error, twice the kink, or 1. All terms of a value are positive: the error is rounded once, which
// counts twice in its square, the square, a constant's, their sum, a root, three terms and a scale.
// An error or a square below the smallest normal number may be 0: off by kTiny, and its root by the
// share that this is of the sum, or where it is all of it by the root of that.
TEST(StressPixelLosses, ErrorsOfEveryMagnitude) {
  std::vector<Real> all = all_magnitudes(0xfff11, true);
  std::erase_if(all, [](Real v) { return !(std::fabs(v) <= 1e18_r); });
  const Pixels pixels(all);
  for (const Kind& kind : kinds()) {
    WorstError value("value_of_" + kind.name), slope("slope_of_" + kind.name);
    const double parameter = static_cast<Real>(kind.parameter);
    const bool root = kind.name == "charbonnier";
    for (const Real scale : {1.0_r, 1e-6_r, 1e-30_r})
      for (const bool flush : {false, true}) {
        Tape tape(kLane, pixels.count);
        const Value pixel = tape.input(4, Domain::kRays, true),
                    target = tape.input(3, Domain::kRays);
        const Value scales = tape.input(1, Domain::kRays);
        const Value loss = kind.record(tape, pixel, target, scales, static_cast<Real>(parameter));
        tape.plan();
        Chunk chunk(tape);
        chunk.rays = pixels.count;
        const int64_t ld = chunk.stride(pixel);
        for (int r = 0; r < pixels.count; ++r) {
          for (size_t k = 0; k < 3; ++k) {
            const int64_t at = static_cast<int64_t>(k) * ld + r;
            chunk.data(pixel)[at] = pixels.rows[static_cast<size_t>(r)][k];
            chunk.data(target)[at] = pixels.targets[static_cast<size_t>(r)][k];
          }
          chunk.data(scales)[r] = scale;
        }
        {
          const auto guard = flush ? std::make_unique<FlushDenormals>() : nullptr;
          tape.forward(chunk);
          tape.backward(chunk);
        }
        ASSERT_TRUE(std::isfinite(chunk.loss) && chunk.loss >= 0) << kind.name;
        for (int r = 0; r < pixels.count; ++r) {
          double sum = 0, off = 0;
          for (size_t k = 0; k < 3; ++k) {
            const double e = double{pixels.rows[static_cast<size_t>(r)][k]} -
                             double{pixels.targets[static_cast<size_t>(r)][k]};
            const Exact want = kind.exact(e, parameter);
            const double got = chunk.gradient(pixel)[static_cast<int64_t>(k) * ld + r];
            ASSERT_TRUE(std::isfinite(got)) << kind.name << ' ' << parameter << " of " << e;
            sum += want.value;
            if (!root) {
              off += kTiny * (2 + 2 * parameter);
              slope.compare(
                  got, double{scale} * want.slope,
                  double{scale} * (4 * kRoundoff * std::fabs(want.slope) + 2 * kTiny) + kTiny,
                  kind.name, parameter, "of", e, "scale", scale);
              continue;
            }
            // Of a root that may have lost both squares nothing is known but its sign and size.
            const double squares = e * e + parameter * parameter, lost = 3 * kTiny / squares;
            off += std::min(std::sqrt(3 * kTiny), 3 * kTiny / want.value);
            ASSERT_LE(std::fabs(got), 1.25 * scale) << kind.name << ' ' << parameter << " of " << e;
            ASSERT_GE(got * e, 0) << kind.name << ' ' << parameter << " of " << e;
            if (lost < 0.25)
              slope.compare(got, double{scale} * want.slope,
                            double{scale} * ((9 * kRoundoff + 2 * lost) * std::fabs(want.slope) +
                                             kTiny / want.value) +
                                kTiny,
                            kind.name, parameter, "of", e, "scale", scale);
          }
          ASSERT_EQ(chunk.gradient(pixel)[3 * ld + r], 0) << "opacity takes no part";
          value.compare(chunk.data(loss)[r], double{scale} * sum,
                        double{scale} * (rounding_bound(9) * sum + off) + kTiny, kind.name,
                        parameter, "ray", r, "scale", scale, "flush", flush);
        }
      }
    value.report();
    slope.report();
  }
}

}  // namespace
}  // namespace nerf::stress
