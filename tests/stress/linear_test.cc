// Fully connected layers on numbers of extreme magnitudes.
#include "nerf/math/reference/linear.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <memory>
#include <vector>

#include "kernels/kernel_test.h"
#include "math/worst_error.h"
#include "nerf/base/threads.h"

namespace nerf::stress {
namespace {

constexpr double kTiny = std::numeric_limits<Real>::min();
using Vector = std::vector<double>;

// Biases are as large as products are.
struct Case {
  Case(int i, int o, int64_t n, double low, double high, Random& random)
      : in(i),
        out(o),
        x(i, n),
        w(static_cast<size_t>(o * weight_stride(i))),
        bias(static_cast<size_t>(round_up(o, kLane))),
        pack(static_cast<size_t>(linear_pack_size(i, o))) {
    for (int k = 0; k < in; ++k)
      for (int64_t s = 0; s < x.padded; ++s) x.at(k, s) = any_size(random, low, high);
    for (int j = 0; j < out; ++j)
      for (int k = 0; k < in; ++k) weight(j, k) = any_size(random, low, high);
    for (int j = 0; j < out; ++j)
      bias[static_cast<size_t>(j)] = any_size(random, std::max(2 * low, -45.0), 2 * high);
    linear_pack(in, out, w.data(), pack.data());
  }
  Real& weight(int j, int k) { return w[static_cast<size_t>(j * weight_stride(in) + k)]; }
  Real weight(int j, int k) const { return w[static_cast<size_t>(j * weight_stride(in) + k)]; }

  int in, out;
  Matrix x;
  AlignedArray<Real> w, bias, pack;  // the pack empty of a layer that is not wide
};

Vector packed(const Case& c, bool absolute) {
  Vector out;
  for (int j = 0; j < c.out; ++j)
    for (int k = 0; k < c.in; ++k)
      out.push_back(absolute ? std::fabs(c.weight(j, k)) : c.weight(j, k));
  return out;
}

// Ranges of powers of ten whose products stay below the largest float, summed over any layer here:
// all magnitudes mixed, large ones, and small ones whose products vanish.
constexpr std::pair<double, double> kRanges[] = {{-18, 18}, {15, 18}, {-38, -10}, {-44, -30}};

// From a width of 96 on layers are packed and go through panels, and from a depth of 277 (less on
// targets of more lanes) on sums are taken in parts: of the inputs in {1024, 40}, of the outputs in
// {40, 1024}. A sum of so many products of the largest size is a float as well.
constexpr std::pair<int, int> kShapes[] = {{1, 1},    {31, 5},    {64, 64},  {40, 16},
                                           {97, 130}, {1024, 40}, {40, 1024}};
constexpr double kLargestOfWide = 17;

template <class Body>
void for_each_case(const Body& body) {
  for_each_target([&](const std::string&) {
    for (const auto& [low, high] : kRanges)
      for (const auto& [in, out] : kShapes)
        for (bool flush : {false, true}) {
          Random random(31, static_cast<uint64_t>(in), flush);
          SCOPED_TRACE("magnitudes from 1e" + std::to_string(low) + ", inputs " +
                       std::to_string(in));
          const double most = in + out > 200 ? std::min(high, kLargestOfWide) : high;
          for (const int64_t n : {0, 1, 17, in + out > 200 ? 72 : 48}) {
            SCOPED_TRACE("samples " + std::to_string(n));
            body(Case(in, out, n, low, most, random), flush, random);
          }
        }
  });
}

// The pack of the same weights gave the same bits; nothing was written beyond the samples.
void expect_same(const Matrix& y, const Matrix& with_pack) {
  for (int j = 0; j < y.rows; ++j)
    for (int64_t s = 0; s < y.n; ++s)
      ASSERT_EQ(with_pack.at(j, s), y.at(j, s)) << "row " << j << " sample " << s;
  y.expect_untouched_beyond_padding();
  with_pack.expect_untouched_beyond_padding();
}

// Each of k + 1 terms, in any order: the roundings of sum |a b|; each term and partial sum below
// the smallest normal number may be 0, and so may each factor: the other one times kTiny.
double sum_error(double terms, double size, double factors) {
  return rounding_bound(terms) * size + kTiny * (terms + factors);
}

TEST(StressLinear, ForwardOfEveryMagnitude) {
  WorstError worst("forward");
  for_each_case([&](const Case& c, bool flush, Random&) {
    for (bool relu : {false, true}) {
      const bool with_bias = relu == (c.x.n % 2 == 0);
      const Real* bias = with_bias ? c.bias.data() : nullptr;
      const LinearActivation activation = relu ? LinearActivation::kRelu : LinearActivation::kNone;
      Matrix y(c.out, c.x.n), with_pack(c.out, c.x.n);
      {
        const auto guard = flush ? std::make_unique<FlushDenormals>() : nullptr;
        linear_forward(c.in, c.out, c.w.data(), bias, c.x.data.data(), y.data.data(), c.x.ld, c.x.n,
                       activation);
        linear_forward(c.in, c.out, c.w.data(), bias, c.x.data.data(), with_pack.data.data(),
                       c.x.ld, c.x.n, activation, c.pack.data());
      }
      expect_same(y, with_pack);
      const Vector w = packed(c, false), absolute = packed(c, true);
      Vector added, added_size;
      for (int j = 0; with_bias && j < c.out; ++j) {
        added.push_back(bias[j]);
        added_size.push_back(std::fabs(added.back()));
      }
      for (int64_t s = 0; s < c.x.n; ++s) {
        Vector x = c.x.column(s);
        const Vector want = reference::linear(w, added, x, static_cast<size_t>(c.out), relu);
        double factors = 0;
        for (double& v : x) factors += (v = std::fabs(v));
        const Vector size =
            reference::linear(absolute, added_size, x, static_cast<size_t>(c.out), false);
        for (int j = 0; j < c.out; ++j) {
          const size_t at = static_cast<size_t>(j);
          double all = factors;
          for (int k = 0; k < c.in; ++k) all += std::fabs(c.weight(j, k));
          ASSERT_TRUE(std::isfinite(y.at(j, s))) << "row " << j << " sample " << s;
          worst.compare(y.at(j, s), want[at], sum_error(c.in + 1 + with_bias, size[at], all), "row",
                        j, "sample", s, "of", c.x.n, "bias", with_bias, "flush", flush);
        }
      }
    }
  });
  worst.report();
}

TEST(StressLinear, BackwardOfEveryMagnitude) {
  WorstError input("input"), weight("weight"), bias("bias");
  for_each_case([&](const Case& c, bool flush, Random& random) {
    const auto [low, high] = std::pair{-18.0, c.in + c.out > 200 ? 16.0 : 17.0};
    Matrix dy(c.out, c.x.n), dx(c.in, c.x.n), with_pack(c.in, c.x.n);
    for (int j = 0; j < c.out; ++j)
      for (int64_t s = 0; s < dy.padded; ++s)
        dy.at(j, s) = s < dy.n ? any_size(random, low, high) : 0.0_r;
    AlignedArray<Real> dw(c.w.size()), dbias(c.bias.size());
    {
      const auto guard = flush ? std::make_unique<FlushDenormals>() : nullptr;
      linear_backward_input(c.in, c.out, c.w.data(), dy.data.data(), dx.data.data(), c.x.ld, c.x.n,
                            nullptr);
      linear_backward_input(c.in, c.out, c.w.data(), dy.data.data(), with_pack.data.data(), c.x.ld,
                            c.x.n, nullptr, c.pack.data());
      linear_backward_weights(c.in, c.out, dy.data.data(), c.x.data.data(), c.x.ld, c.x.n,
                              dw.data(), dbias.data());
    }
    expect_same(dx, with_pack);
    for (int k = 0; k < c.in; ++k)
      for (int64_t s = 0; s < c.x.n; ++s) {
        double want = 0, size = 0, factors = 0;
        for (int j = 0; j < c.out; ++j) {
          const double a = c.weight(j, k), b = dy.at(j, s);
          want += a * b;
          size += std::fabs(a * b);
          factors += std::fabs(a) + std::fabs(b);
        }
        ASSERT_TRUE(std::isfinite(dx.at(k, s)));
        input.compare(dx.at(k, s), want, sum_error(c.out + 1, size, factors), "row", k, "sample", s,
                      "flush", flush);
      }
    for (int j = 0; j < c.out; ++j) {
      double sum = 0, sum_size = 0;
      for (int64_t s = 0; s < c.x.n; ++s) {
        sum += double{dy.at(j, s)};
        sum_size += std::fabs(double{dy.at(j, s)});
      }
      bias.compare(dbias[static_cast<size_t>(j)], sum,
                   sum_error(static_cast<double>(c.x.n) + 1, sum_size, 0), "row", j, "flush",
                   flush);
      for (int k = 0; k < c.in; ++k) {
        double want = 0, size = 0, factors = 0;
        for (int64_t s = 0; s < c.x.n; ++s) {
          const double a = dy.at(j, s), b = c.x.at(k, s);
          want += a * b;
          size += std::fabs(a * b);
          factors += std::fabs(a) + std::fabs(b);
        }
        const double got = dw[static_cast<size_t>(j * weight_stride(c.in) + k)];
        ASSERT_TRUE(std::isfinite(got));
        weight.compare(got, want, sum_error(static_cast<double>(c.x.n) + 1, size, factors), "row",
                       j, "column", k, "flush", flush);
      }
    }
  });
  input.report();
  weight.report();
  bias.report();
}

// A sample whose numbers overflow, or are none, is alone with it: all others keep every bit.
TEST(StressLinear, OverflowInOneSampleTouchesNoOther) {
  for_each_target([&](const std::string&) {
    for (const auto& [in, out] : {std::pair{5, 3}, {31, 16}, {64, 64}, {97, 130}, {300, 310}})
      for (Real odd : {1e38_r, std::numeric_limits<Real>::infinity(), Real{NAN}})
        for (int64_t at : {0, 7, 15, 16, 39}) {
          Random random(32, 0, 0);
          const Case c(in, out, 40, -2, 2, random);
          Case broken = c;
          for (int k = 0; k < in; ++k) broken.x.at(k, at) = odd;
          Matrix y[2] = {{out, 40}, {out, 40}}, dx[2] = {{in, 40}, {in, 40}};
          for (int i = 0; i < 2; ++i) {
            const Matrix& x = i ? broken.x : c.x;
            linear_forward(in, out, c.w.data(), nullptr, x.data.data(), y[i].data.data(), x.ld, 40,
                           LinearActivation::kRelu);
            Matrix dy(out, 40);
            for (int j = 0; j < out; ++j)
              for (int64_t s = 0; s < dy.padded; ++s)
                dy.at(j, s) = s >= 40 ? 0.0_r : i && s == at ? odd : 0.5_r;
            linear_backward_input(in, out, c.w.data(), dy.data.data(), dx[i].data.data(), dy.ld, 40,
                                  nullptr);
          }
          for (int64_t s = 0; s < 40; ++s) {
            if (s == at) continue;
            for (int j = 0; j < out; ++j) ASSERT_EQ(y[0].at(j, s), y[1].at(j, s)) << s;
            for (int k = 0; k < in; ++k) ASSERT_EQ(dx[0].at(k, s), dx[1].at(k, s)) << s;
          }
        }
  });
}

}  // namespace
}  // namespace nerf::stress
