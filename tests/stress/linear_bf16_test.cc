// bf16 layers on numbers of extreme magnitudes, and on sums that cancel.
#include "nerf/kernels/linear_bf16.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "kernels/bf16_layers.h"
#include "math/worst_error.h"
#include "nerf/math/reference/bf16.h"

namespace nerf::stress {
namespace {

constexpr double kTiny = std::numeric_limits<float>::min();

// Powers of ten, whose products stay below the largest float, summed over any layer here; in layers
// wider than 200 the largest weights are a tenth of it.
struct Sizes {
  double w_low, w_high, x_low, x_high;
  // No product is below 1e-30. Products of two bf16 numbers have 16 bits, so that no sum of them is
  // below the normal numbers either: the template's bits.
  bool bits;
};
constexpr Sizes kSizes[] = {{-1, 1, -1, 1, true},     {-15, 5, -15, 30, true},
                            {5, 8, 20, 28, true},     {-30, -10, 0, 30, false},
                            {-38, 5, -38, 30, false}, {-45, -37, -10, 30, false},
                            {-20, 8, -45, -30, false}};

Floats rounded(Floats v) {
  for (float& x : v) x = reference::nearest_bf16(x);
  if (v.size() % 2) v.push_back(0);
  return v;
}

class Products {
 public:
  explicit Products(Bf16Unit unit) : unit_(unit) {}

  // What a product of these two is, and, where a partial sum or a term may have been flushed to 0,
  // how far from the exact one of the same bf16 numbers: as much as the smallest normal number for
  // each of them, beside the roundings of as many additions.
  template <class... Where>
  void compare(Real got, const Floats& left, const Floats& right, bool bits,
               const Where&... where) {
    const Floats a = rounded(left), b = rounded(right);
    ASSERT_TRUE(std::isfinite(got));
    if (bits) {
      const float want = unit_ == Bf16Unit::kAmx ? reference::dot_amx_bf16(a, b, 0)
                                                 : reference::dot_avx512_bf16(a, b, 0);
      ASSERT_EQ(got, want);
      return;
    }
    double sum = 0, size = 0;
    for (size_t k = 0; k < a.size(); ++k) {
      const double p = static_cast<double>(a[k]) * static_cast<double>(b[k]);
      sum += p;
      size += std::fabs(p);
    }
    const double n = static_cast<double>(a.size());
    worst_.compare(got, sum, rounding_bound(n) * size + 2 * n * kTiny, where...);
  }
  void report() const { worst_.report(); }

 private:
  Bf16Unit unit_;
  WorstError worst_{"bf16"};
};

struct Case {
  Case(int i, int o, int64_t samples, const Sizes& sizes, bool cancelling, Random& random)
      : in(i),
        out(o),
        n(samples),
        x(i, samples),
        dy(o, samples),
        w(static_cast<size_t>(o * weight_stride(i))),
        packed(static_cast<size_t>(packed_layer_size(i, o))) {
    const double largest = sizes.w_high - (in + out > 200);
    for (int j = 0; j < out; ++j)
      for (int k = 0; k < in; ++k) at(j, k) = any_size(random, sizes.w_low, largest);
    for (int64_t s = 0; s < x.padded; ++s) {
      for (int k = 0; k < in; ++k)
        x.at(k, s) = s < n ? any_size(random, sizes.x_low, sizes.x_high) : 0.5_r;
      for (int j = 0; j < out; ++j)
        dy.at(j, s) = s < n ? any_size(random, sizes.x_low, sizes.x_high) : 0.0_r;
    }
    // Each term again with the other sign, exactly or but for the last of 8 bits.
    if (cancelling) {
      for (int k = 0; k + in / 2 < in; ++k)
        for (int64_t s = 0; s < n; ++s)
          x.at(k + in / 2, s) = -x.at(k, s) * (s % 2 ? 1 + 0x1p-7_r : 1);
      for (int j = 0; j < out; ++j)
        for (int k = 0; k + in / 2 < in; ++k) at(j, k + in / 2) = at(j, k);
    }
    pack_layer(in, out, w.data(), packed.data());
  }
  Real& at(int j, int k) { return w[static_cast<size_t>(j * weight_stride(in) + k)]; }
  Floats row(int j) const { return row_of(w, in, j); }
  Floats column(int k) const { return column_of(w, in, out, k); }
  int in, out;
  int64_t n;
  Matrix x, dy;
  AlignedArray<Real> w;
  AlignedArray<uint16_t> packed;
};

Floats row_of(const Matrix& m, int r) {
  Floats v;
  for (int64_t s = 0; s < m.n; ++s) v.push_back(m.at(r, s));
  return v;
}

// {520, 24} and {24, 520} are deeper than what the units sum at a time, forward and backward.
constexpr std::pair<int, int> kShapes[] = {{1, 1},    {31, 5},   {64, 64},
                                           {130, 17}, {520, 24}, {24, 520}};

template <class Body>
void for_each_case(const Body& body) {
  for_each_bf16_unit([&](Bf16Unit unit) {
    Products products(unit);
    for (const Sizes& sizes : kSizes)
      for (const auto& [in, out] : kShapes)
        for (const int64_t n : {0, 1, in + out > 200 ? 17 : 48})
          for (const bool cancelling : {false, true}) {
            SCOPED_TRACE("weights from 1e" + std::to_string(sizes.w_low) + ", inputs " +
                         std::to_string(in) + ", samples " + std::to_string(n) +
                         (cancelling ? ", cancelling" : ""));
            Random random(41, static_cast<uint64_t>(in), cancelling);
            body(Case(in, out, n, sizes, cancelling, random), sizes.bits, products);
          }
    products.report();
  });
}

TEST(StressLinearBf16, ForwardOfEveryMagnitude) {
  for_each_case([](const Case& c, bool bits, Products& products) {
    Matrix y(c.out, c.n);
    linear_forward_bf16(c.in, c.out, c.packed.data(), nullptr, c.x.data.data(), y.data.data(),
                        c.x.ld, c.n, LinearActivation::kNone);
    for (int64_t s = 0; s < c.n; ++s)
      for (int j = 0; j < c.out; ++j)
        products.compare(y.at(j, s), c.row(j), column_of(c.x, s), bits, "row", j, "sample", s);
  });
}

TEST(StressLinearBf16, BackwardOfEveryMagnitude) {
  for_each_case([](const Case& c, bool bits, Products& products) {
    Matrix dx(c.in, c.n);
    linear_backward_input_bf16(c.in, c.out, c.packed.data(), c.dy.data.data(), dx.data.data(),
                               dx.ld, c.n, nullptr);
    for (int64_t s = 0; s < c.n; ++s)
      for (int k = 0; k < c.in; ++k)
        products.compare(dx.at(k, s), c.column(k), column_of(c.dy, s), bits, "input", k, "sample",
                         s);
  });
}

// Gradients of samples: both factors are of any size.
void check_weight_gradients(int in, int out, int64_t n, const Sizes& sizes, Products& products) {
  Random random(42, static_cast<uint64_t>(in), 0);
  Matrix x(in, n), dy(out, n);
  for (int64_t s = 0; s < x.padded; ++s) {
    for (int k = 0; k < in; ++k) x.at(k, s) = any_size(random, sizes.x_low, sizes.x_high);
    for (int j = 0; j < out; ++j)
      dy.at(j, s) = s < n ? any_size(random, sizes.w_low, sizes.w_high) : 0.0_r;
  }
  AlignedArray<Real> dw(static_cast<size_t>(out * weight_stride(in))),
      dbias(static_cast<size_t>(round_up(out, kLane)));
  linear_backward_weights_bf16(in, out, dy.data.data(), x.data.data(), x.ld, n, dw.data(),
                               dbias.data());
  for (int j = 0; j < out; ++j) {
    for (int k = 0; k < in; ++k)
      products.compare(dw[static_cast<size_t>(j * weight_stride(in) + k)], row_of(dy, j),
                       row_of(x, k), sizes.bits, "row", j, "column", k, "of", in, "samples", n);
    double sum = 0, size = 0;
    for (const float g : row_of(dy, j)) {
      sum += static_cast<double>(g);
      size += std::fabs(static_cast<double>(g));
    }
    const double terms = static_cast<double>(n);
    ASSERT_NEAR(static_cast<double>(dbias[static_cast<size_t>(j)]), sum,
                rounding_bound(terms + 1) * size + terms * kTiny);
  }
}

TEST(StressLinearBf16, WeightGradientsOfEveryMagnitude) {
  for_each_bf16_unit([](Bf16Unit unit) {
    Products products(unit);
    for (const Sizes& sizes : kSizes)
      for (const auto& [in, out] : {std::pair{33, 18}, {520, 5}})
        for (const int64_t n : {0, 1, 61}) check_weight_gradients(in, out, n, sizes, products);
    products.report();
  });
}

}  // namespace
}  // namespace nerf::stress
