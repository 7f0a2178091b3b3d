// What is made of the weights of a million samples on one ray: sums, groups with their means, and
// the distortion loss, forward and backward. No bound here grows with the number of samples, but
// for roundings of double.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <memory>
#include <numeric>
#include <string>
#include <vector>

#include "kernels/kernel_test.h"
#include "nerf/autodiff/operations.h"
#include "nerf/autodiff/tape.h"
#include "nerf/math/reference/histogram_losses.h"
#include "nerf/math/reference/volume_rendering.h"
#include "nerf/parts/losses.h"
#include "stress/composite_run.h"

namespace nerf::stress {
namespace {

constexpr int kMillion = 1000000, kRows = 3;
constexpr double kDouble = 0x1p-53;
// Sums of as many products in double, here and in the library.
const double kSummed = 2 * rounding_bound(kMillion + 2.0, kDouble);

using Reals = std::vector<Real>;
using Doubles = std::vector<double>;

struct Light {
  std::string name;
  Reals weights;
};

// Of nothing, of what does not fill a group, of what is all alike, of any density, and of a wall
// between mist and what nobody sees. On the target in force.
std::vector<Light> lights() {
  std::vector<Light> out;
  const auto add = [&](const std::string& name, const std::function<Real(int)>& density) {
    Matter m;
    for (int i = 0; i < kMillion; ++i) m.add(density(i), 1.0_r / kMillion, {});
    const Doubles weights = run_composite(m, Path::kWeights).weights;
    EXPECT_LE(std::accumulate(weights.begin(), weights.end(), 0.0), 1 + 1e-6) << name;
    out.push_back({name, {weights.begin(), weights.end()}});
  };
  Random random(12, 0, 0);
  add("nothing", [](int) { return 0; });
  add("faint", [](int) { return 1e-3_r; });
  add("alike", [](int) { return 2.0_r; });
  add("random", [&](int) { return 40 * random.uniform(); });
  add("wall", [](int i) { return i == kMillion / 2 ? 1e10_r : 0.1_r; });
  return out;
}

// Rows that belong to the samples: all alike, so that every rounding goes the same way; of either
// sign, which cancel; a ramp.
const std::array<Reals, kRows>& rows() {
  static const std::array<Reals, kRows> all = [] {
    std::array<Reals, kRows> x;
    Random random(13, 0, 0);
    for (int i = 0; i < kMillion; ++i) {
      x[0].push_back(0.8_r);
      x[1].push_back(2 * random.uniform() - 1);
      x[2].push_back(static_cast<Real>(i) / kMillion);
    }
    return x;
  }();
  return all;
}

// Gradient that an output's element is given.
Real given(size_t output, int row, int column) {
  return static_cast<Real>(1 + column % 5) *
         ((static_cast<size_t>(row) + output) % 2 ? -0.3_r : 0.2_r);
}

// Ends a tape with them.
class Given : public Operation {
 public:
  Given(const std::vector<Value>& outputs, Value end) : Operation(outputs, end) {}
  const char* name() const override { return "given"; }
  void forward(Chunk&) const override {}
  void backward(Chunk& c) const override {
    for (size_t o = 0; o < inputs().size(); ++o) {
      const Value v = inputs()[o];
      for (int k = 0; k < c.tape->rows(v); ++k)
        for (int64_t i = 0; i < round_up(c.count(v), kLane); ++i)
          c.gradient(v)[k * c.stride(v) + i] =
              i < c.count(v) ? given(o, k, static_cast<int>(i)) : 0.0_r;
    }
  }
};

// One ray through operations on its samples' weights and rows, forward and backward.
class Ray {
 public:
  using Record = std::function<std::vector<Value>(Tape&, Value weights, Value x)>;
  Ray(const Reals& w, const Record& record)
      : tape(kMillion, 1),
        weights(tape.input(1, Domain::kSamples, true)),
        x(tape.input(kRows, Domain::kSamples, true)),
        outputs(record(tape, weights, x)),
        chunk(ended(tape, outputs)) {
    chunk.samples = kMillion;
    chunk.rays = 1;
    chunk.ray_begin = begin_;
    std::ranges::copy(w, chunk.data(weights));
    for (int k = 0; k < kRows; ++k)
      std::ranges::copy(rows()[static_cast<size_t>(k)], chunk.data(x) + k * chunk.stride(x));
    tape.forward(chunk);
    tape.backward(chunk);
  }
  double at(Value v, int row, int64_t column) const {
    return chunk.data(v)[row * chunk.stride(v) + column];
  }
  double gradient(Value v, int row, int64_t column) {
    return chunk.gradient(v)[row * chunk.stride(v) + column];
  }

  Tape tape;
  Value weights, x;
  std::vector<Value> outputs;
  Chunk chunk;

 private:
  static const Tape& ended(Tape& tape, const std::vector<Value>& outputs) {
    const Value end = tape.output(1, Domain::kRays, outputs);
    tape.record(std::make_unique<Given>(outputs, end));
    tape.plan();
    return tape;
  }
  const int32_t begin_[2] = {0, kMillion};
};

// Forward a sum is made in double and rounded. Backward a weight's gradient is a sum over rows: a
// rounding of each product and one for each sum that it goes through; a row's is one product.
TEST(StressManySamples, SumsAlongTheRay) {
  WorstError forward("sums"), of_weight("sums_of_weight"), of_x("sums_of_x");
  for_each_target([&](const std::string&) {
    for (const Light& light : lights()) {
      const Reals& w = light.weights;
      Ray ray(w, [](Tape& t, Value weights, Value x) {
        return std::vector<Value>{sum_along_rays(t, weights, x)};
      });
      for (int k = 0; k <= kRows; ++k) {
        double want = 0, size = 0;
        for (size_t i = 0; i < w.size(); ++i) {
          const double x = k < kRows ? rows()[static_cast<size_t>(k)][i] : 1;
          want += double{w[i]} * x;
          size += double{w[i]} * std::fabs(x);
        }
        forward.compare(ray.at(ray.outputs[0], k, 0), want,
                        kRoundoff * std::fabs(want) + kSummed * size + kTiny, light.name, "row", k);
      }
      for (int i = 0; i < kMillion; ++i) {
        double want = given(0, kRows, 0), size = std::fabs(want);
        for (int k = 0; k < kRows; ++k) {
          const double g = given(0, k, 0),
                       term = g * rows()[static_cast<size_t>(k)][static_cast<size_t>(i)];
          want += term;
          size += std::fabs(term);
          const double of_row = g * double{w[static_cast<size_t>(i)]};
          of_x.compare(ray.gradient(ray.x, k, i), of_row, kRoundoff * std::fabs(of_row) + kTiny,
                       light.name, "row", k, "sample", i);
        }
        of_weight.compare(ray.gradient(ray.weights, 0, i), want, rounding_bound(kRows + 1) * size,
                          light.name, "sample", i);
      }
    }
  });
  for (const WorstError* e : {&forward, &of_weight, &of_x}) e->report();
}

struct GroupErrors {
  WorstError light{"light"}, mean{"mean"}, of_weight{"of_weight"}, of_x{"of_x"};
  void report() const {
    for (const WorstError* e : {&light, &mean, &of_weight, &of_x}) e->report();
  }
};

// Borders are those of the template, exactly: both add the same numbers in double.
//
// - Light: a sum in double, rounded.
// - A mean: a share and its product are rounded; the samples of one vector go through up to four
//   sums, those of the first one through the four of the second too and into it; the sum of vectors
//   is made in double and rounded: 12 u of the mean of magnitudes.
// - A weight's gradient is that of its group's light and what the mean grows by: per light, a
//   rounding, the slopes times x less the mean, which is off as it is; of each difference a
//   rounding and one for each of kRows + 2 sums that it goes through.
// - A row's gradient is a share, rounded, times the slope, rounded.
void check_groups(const Light& given_light, double most, double stop, GroupErrors& errors) {
  const std::string& name = given_light.name;
  const Reals& real = given_light.weights;
  const Doubles w(real.begin(), real.end());
  Ray ray(real, [&](Tape& t, Value weights, Value x) {
    const Value light = group_light(t, weights, static_cast<Real>(most), static_cast<Real>(stop));
    return std::vector<Value>{light, mean_of_groups(t, light, x)};
  });
  const Value light = ray.outputs[0], mean = ray.outputs[1];
  const std::vector<size_t> sizes = reference::light_groups(w, most, stop);
  ASSERT_EQ(ray.chunk.groups, static_cast<int>(sizes.size())) << name;
  EXPECT_EQ(ray.chunk.group_begin[1], ray.chunk.groups);
  double all = 0;
  size_t first = 0;
  for (int g = 0; g < ray.chunk.groups; ++g) {
    const size_t count = sizes[static_cast<size_t>(g)], end = first + count;
    double sum = 0;
    for (size_t i = first; i < end; ++i) sum += w[i];
    const double per_light = 1 / (sum + reference::kLeastLight * static_cast<double>(count));
    all += ray.at(light, 0, g);
    EXPECT_TRUE(count == 1 || ray.at(light, 0, g) <= most * (1 + kRoundoff)) << name << ' ' << g;
    errors.light.compare(ray.at(light, 0, g), sum, (kRoundoff + kSummed) * sum + kTiny, name,
                         "group", g, "of", count);
    std::array<double, kRows> want{}, off{};
    for (int k = 0; k < kRows; ++k) {
      const size_t row = static_cast<size_t>(k);
      double size = 0;
      for (size_t i = first; i < end; ++i) {
        const double share = (w[i] + reference::kLeastLight) * per_light, x = rows()[row][i];
        want[row] += share * x;
        size += share * std::fabs(x);
      }
      off[row] = (12 * kRoundoff + kSummed) * size + kTiny;
      errors.mean.compare(ray.at(mean, k, g), want[row], off[row], name, "row", k, "group", g, "of",
                          count);
    }
    const double of_light = given(0, 0, g);
    for (size_t i = first; i < end; ++i) {
      const int64_t at = static_cast<int64_t>(i);
      ASSERT_EQ(ray.chunk.state<GroupState>(light).of[i], g) << name << " sample " << i;
      double slope = 0, size = 0, means_off = 0;
      for (int k = 0; k < kRows; ++k) {
        const size_t row = static_cast<size_t>(k);
        const double dy = given(1, k, g), x = rows()[row][i];
        slope += dy * (x - want[row]);
        size += std::fabs(dy) * (std::fabs(x) + std::fabs(want[row]));
        means_off += std::fabs(dy) * off[row];
        const double of_x = (w[i] + reference::kLeastLight) * per_light * dy;
        errors.of_x.compare(ray.gradient(ray.x, k, at), of_x,
                            (rounding_bound(2) + kSummed) * std::fabs(of_x) + kTiny, name, "row", k,
                            "sample", i);
      }
      errors.of_weight.compare(
          ray.gradient(ray.weights, 0, at), of_light + per_light * slope,
          (rounding_bound(kRows + 4) + kSummed) * (std::fabs(of_light) + per_light * size) +
              per_light * means_off,
          name, "sample", i, "of", count);
    }
    first = end;
  }
  EXPECT_LE(all, 1 + 1e-6) << name;
  for (size_t i = first; i < w.size(); ++i) {  // behind what anybody sees
    ASSERT_EQ(ray.gradient(ray.weights, 0, static_cast<int64_t>(i)), 0) << name << ' ' << i;
    for (int k = 0; k < kRows; ++k)
      ASSERT_EQ(ray.gradient(ray.x, k, static_cast<int64_t>(i)), 0) << name << ' ' << i;
  }
}

// One group of all samples, some of very many, and nearly as many as samples.
TEST(StressManySamples, GroupsAndTheirMeans) {
  GroupErrors errors;
  for_each_target([&](const std::string&) {
    for (const Light& light : lights())
      for (const double most : {0.125, 0x1p-20}) check_groups(light, most, 0x1p-10, errors);
  });
  errors.report();
}

// The distortion loss and its gradient in O(n), other than the library's way: no term cancels.
// Light before a gap and light behind it are apart by the gap, once for each of both orders.
struct Distortion {
  Distortion(const Doubles& middles, const Doubles& widths, const Doubles& w)
      : slope(w.size()), size(w.size()) {
    const size_t n = w.size();
    Doubles before(n), behind(n);  // the sample's own among them
    double moment = 0;
    for (size_t i = 0; i < n; ++i) {
      before[i] = (i > 0 ? before[i - 1] : 0) + w[i];
      moment += w[i] * std::fabs(middles[i]);
    }
    for (size_t i = n; i-- > 0;) behind[i] = (i + 1 < n ? behind[i + 1] : 0) + w[i];
    double left = 0, right = 0;
    for (size_t i = 0; i < n; ++i) {
      if (i > 0) {
        const double gap = middles[i] - middles[i - 1];
        left += gap * before[i - 1];
        loss += 2 * gap * before[i - 1] * behind[i];
      }
      loss += w[i] * w[i] * widths[i] / 3;
      slope[i] = 2 * left + 2 * w[i] * widths[i] / 3;
      size[i] = std::fabs(middles[i]) * before[n - 1] + moment + w[i] * widths[i];
      all += 2 * w[i] * size[i];
    }
    for (size_t i = n - 1; i-- > 0;) {
      right += (middles[i + 1] - middles[i]) * behind[i + 1];
      slope[i] += 2 * right;
    }
  }
  double loss = 0, all = 0;  // what it would be if nothing cancelled
  Doubles slope, size;
};

// It is the template, whose terms are n^2.
TEST(StressManySamples, DistortionWithoutPairsIsTheTemplate) {
  Random random(14, 0, 0);
  Doubles middles, widths, w;
  double at = 0;
  for (int i = 0; i < 300; ++i) {
    widths.push_back(random.uniform());
    middles.push_back(at + 0.5 * widths.back());
    at += widths.back();
    w.push_back(random.uniform());
  }
  const Distortion got(middles, widths, w);
  std::vector<reference::Dual> along(w.begin(), w.end());
  along[100].derivative = 1;
  const reference::Dual want = reference::distortion_loss(middles, widths, along);
  EXPECT_NEAR(got.loss, want.value, 1e-12 * want.value);
  EXPECT_NEAR(got.slope[100], want.derivative, 1e-12 * want.derivative);
}

// The library's sums in double cancel: the loss has terms off by 2 n + 8 roundings of their size; a
// slope has six sums of n, all light and its moment, off by n + 8 each, and is rounded once. The
// sums here are chains of two or three of n, and none of them cancels.
TEST(StressManySamples, Distortion) {
  WorstError value("distortion"), gradient("distortion_gradient");
  const auto check = [&](const std::string& name, const Doubles& middles, const Doubles& widths,
                         const Reals& w, const auto& loss) {
    const Distortion want(middles, widths, {w.begin(), w.end()});
    Reals d(w.size(), 0.0_r);
    const double got = loss(d), n = static_cast<double>(w.size());
    value.compare(got, want.loss,
                  rounding_bound(2 * n + 8, kDouble) * want.all +
                      rounding_bound(3 * n + 5, kDouble) * want.loss + kTiny,
                  name);
    for (size_t i = 0; i < w.size(); ++i)
      gradient.compare(d[i], want.slope[i],
                       6 * rounding_bound(n + 8, kDouble) * want.size[i] +
                           (kRoundoff + rounding_bound(2 * n + 5, kDouble)) * want.slope[i] + kTiny,
                       name, "bin", i);
  };
  Reals even, crowded;  // half of the bins at one place
  for (int i = 0; i <= kMillion; ++i) {
    even.push_back(static_cast<Real>(i) / kMillion);
    crowded.push_back(i < kMillion / 2 ? even.back() : 1.0_r);
  }
  for_each_target([&](const std::string&) {
    for (const Light& light : lights())
      for (const Reals& edges : {even, crowded}) {
        Doubles middles, widths;
        Reals real_middles, real_widths;
        for (size_t i = 0; i < kMillion; ++i) {
          middles.push_back(0.5 * (double{edges[i]} + double{edges[i + 1]}));
          widths.push_back(double{edges[i + 1]} - double{edges[i]});
          real_middles.push_back(static_cast<Real>(middles.back()));
          real_widths.push_back(static_cast<Real>(widths.back()));
        }
        check(light.name + " between edges", middles, widths, light.weights,
              [&](Reals& d) { return distortion_loss(edges, light.weights, 1, d); });
        check(light.name + " of intervals", {real_middles.begin(), real_middles.end()},
              {real_widths.begin(), real_widths.end()}, light.weights, [&](Reals& d) {
                return distortion_loss(real_middles, real_widths, light.weights, 1, d);
              });
      }
  });
  value.report();
  gradient.report();
}

}  // namespace
}  // namespace nerf::stress
