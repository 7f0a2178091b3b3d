#include "nerf/kernels/linear_bf16.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <span>
#include <vector>

#include "kernels/bf16_layers.h"
#include "math/worst_error.h"
#include "nerf/base/error.h"
#include "nerf/kernels/bf16.h"
#include "nerf/math/reference/bf16.h"
#include "nerf/math/reference/linear.h"

namespace nerf {
namespace {

// An operand of the templates: bf16 numbers, an even count of them.
Floats rounded(Floats v) {
  for (float& x : v) x = reference::nearest_bf16(x);
  if (v.size() % 2) v.push_back(0);
  return v;
}
// All of them at once, since each takes part in many products: of(0) to of(count - 1).
template <class Of>
std::vector<Floats> all_rounded(int count, const Of& of) {
  std::vector<Floats> out;
  for (int i = 0; i < count; ++i) out.push_back(rounded(of(i)));
  return out;
}

float dot(Bf16Unit unit, std::span<const float> a, std::span<const float> b) {
  return unit == Bf16Unit::kAmx ? reference::dot_amx_bf16(a, b, 0)
                                : reference::dot_avx512_bf16(a, b, 0);
}

// products[s][i] of column s of m with each of `operands`.
std::vector<Floats> products(Bf16Unit unit, const std::vector<Floats>& operands, const Matrix& m) {
  std::vector<Floats> out;
  for (int64_t s = 0; s < m.n; ++s) {
    const Floats column = rounded(column_of(m, s));
    out.emplace_back();
    for (const Floats& operand : operands) out.back().push_back(dot(unit, operand, column));
  }
  return out;
}

TEST(Bf16, RoundsToTheNearestNumber) {
  std::vector<float> x = {0.0f,
                          -0.0f,
                          1,
                          -1,
                          1 + 0x1p-8f,         // a tie, to the even 1
                          1 + 0x1.8p-7f,       // a tie, up to the even 1 + 2^-6
                          1 + 0x1.00002p-8f,   // just above the tie
                          1 + 0x1.fffffcp-9f,  // just below
                          0x1.fffffep127f,     // rounds beyond the largest
                          -0x1.fefffep127f,    // to the largest
                          0x1p-126f,
                          0x1.fffffcp-127f,  // below the normal numbers
                          std::numeric_limits<float>::denorm_min(),
                          std::numeric_limits<float>::infinity(),
                          -std::numeric_limits<float>::infinity()};
  Random random(3, 0, 0);
  for (int i = 0; i < 100000; ++i) {
    const float v = std::bit_cast<float>(static_cast<uint32_t>(random.below(uint64_t{1} << 32)));
    if (!std::isnan(v)) x.push_back(v);
  }
  // Whole vectors, parts of one, none, from wherever they stand.
  const auto check = [&](size_t first, size_t n) {
    std::vector<uint16_t> rounded(n + 1, 0x7777);
    std::vector<float> back(n + 1, 7.0f);
    round_to_bf16(static_cast<int64_t>(n), x.data() + first, rounded.data());
    widen_bf16(static_cast<int64_t>(n), rounded.data(), back.data());
    for (size_t i = 0; i < n; ++i)
      ASSERT_EQ(std::bit_cast<uint32_t>(back[i]),
                std::bit_cast<uint32_t>(reference::nearest_bf16(x[first + i])))
          << std::hexfloat << x[first + i] << " became " << back[i];
    EXPECT_EQ(rounded[n], 0x7777);
    EXPECT_EQ(back[n], 7.0f);
  };
  const float nan = std::bit_cast<float>(0x7f800001u);  // its upper half alone is an infinity
  for_each_target([&](const std::string&) {
    check(0, x.size());
    for (size_t n = 0; n < 20; ++n) check(n % 5, n);
    uint16_t half;
    round_to_bf16(1, &nan, &half);
    float again;
    widen_bf16(1, &half, &again);
    EXPECT_TRUE(std::isnan(again));
  });
}

// Bit for bit in the unit's own order; rows beyond the depth and columns in the padding count for
// nothing.
TEST(LinearBf16, ForwardIsTheTemplateOfTheUnit) {
  for_each_bf16_unit([&](Bf16Unit unit) {
    Random random(21, 0, 0);
    for (const Shape& shape : shapes()) {
      SCOPED_TRACE(name(shape));
      const Layer layer(shape, random);
      const Matrix x(shape.in, shape.n, random, -1, 1);
      const std::vector<Floats> product =
          products(unit, all_rounded(shape.out, [&](int j) { return layer.row(j); }), x);
      for (const bool relu : {false, true})
        for (const bool with_bias : {false, true}) {
          Matrix y(shape.out, shape.n);
          linear_forward_bf16(shape.in, shape.out, layer.packed.data(),
                              with_bias ? layer.bias.data() : nullptr, x.data.data(), y.data.data(),
                              x.ld, shape.n,
                              relu ? LinearActivation::kRelu : LinearActivation::kNone);
          for (int64_t s = 0; s < shape.n; ++s)
            for (int j = 0; j < shape.out; ++j) {
              Real want = product[static_cast<size_t>(s)][static_cast<size_t>(j)];
              if (with_bias) want += layer.bias[static_cast<size_t>(j)];
              ASSERT_EQ(y.at(j, s), relu ? std::max(want, 0.0_r) : want) << j << ' ' << s;
            }
          for (int j = 0; j < shape.out; ++j)
            for (int64_t s = shape.n; s < y.padded; ++s) ASSERT_TRUE(std::isfinite(y.at(j, s)));
          y.expect_untouched_beyond_padding();
        }
    }
  });
}

TEST(LinearBf16, BackwardInputIsTheTemplateOfTheUnit) {
  for_each_bf16_unit([&](Bf16Unit unit) {
    Random random(22, 0, 0);
    for (const Shape& shape : shapes()) {
      SCOPED_TRACE(name(shape));
      const Layer layer(shape, random);
      const Matrix dy(shape.out, shape.n, random, -1, 1, Matrix::Padding::kZero);
      Matrix relu_output(shape.in, shape.n, random, -1, 1);
      for (Real& v : relu_output.data) v = std::max(v, 0.0_r);
      const std::vector<Floats> product =
          products(unit, all_rounded(shape.in, [&](int k) { return layer.column(k); }), dy);
      for (const bool masked : {false, true}) {
        Matrix dx(shape.in, shape.n);
        linear_backward_input_bf16(shape.in, shape.out, layer.packed.data(), dy.data.data(),
                                   dx.data.data(), dx.ld, shape.n,
                                   masked ? relu_output.data.data() : nullptr);
        for (int64_t s = 0; s < shape.n; ++s)
          for (int k = 0; k < shape.in; ++k) {
            const bool open = !masked || relu_output.at(k, s) > 0;
            const Real want = product[static_cast<size_t>(s)][static_cast<size_t>(k)];
            ASSERT_EQ(dx.at(k, s), open ? want : 0) << k << ' ' << s;
          }
        for (int k = 0; k < shape.in; ++k)
          for (int64_t s = shape.n; s < dx.padded; ++s) ASSERT_EQ(dx.at(k, s), 0) << "padding";
        dx.expect_untouched_beyond_padding();
      }
    }
  });
}

TEST(LinearBf16, BackwardWeightsIsTheTemplateOfTheUnit) {
  for_each_bf16_unit([&](Bf16Unit unit) {
    const size_t part =
        unit == Bf16Unit::kAmx ? reference::kAmxBf16Samples : reference::kAvx512Bf16Samples;
    Random random(23, 0, 0);
    for (const Shape& shape : shapes()) {
      SCOPED_TRACE(name(shape));
      const Matrix x(shape.in, shape.n, random, -1, 1);
      const Matrix dy(shape.out, shape.n, random, -1, 1, Matrix::Padding::kZero);
      const Layer start(shape, random);
      AlignedArray<Real> dw = start.w, dbias = start.bias;
      linear_backward_weights_bf16(shape.in, shape.out, dy.data.data(), x.data.data(), dy.ld,
                                   shape.n, dw.data(), dbias.data());
      const auto rows = [](const Matrix& m) {
        return all_rounded(m.rows, [&](int r) {
          const Real* data = m.data.data() + r * m.ld;
          return Floats(data, data + m.n);
        });
      };
      const std::vector<Floats> left = rows(dy), right = rows(x);
      const auto samples = [&](const Floats& row, size_t from) {
        return std::span(row).subspan(from, std::min(part, row.size() - from));
      };
      for (int j = 0; j < shape.out; ++j) {
        for (int k = 0; k < shape.in; ++k) {
          Real want = start.row(j)[static_cast<size_t>(k)];
          for (size_t s = 0; s < static_cast<size_t>(shape.n); s += part)
            want += dot(unit, samples(left[static_cast<size_t>(j)], s),
                        samples(right[static_cast<size_t>(k)], s));
          ASSERT_EQ(dw[static_cast<size_t>(j * weight_stride(shape.in) + k)], want)
              << j << ' ' << k;
        }
        for (int64_t k = shape.in; k < weight_stride(shape.in); ++k)
          ASSERT_EQ(dw[static_cast<size_t>(j * weight_stride(shape.in) + k)], 0) << "padding";
        double sum = static_cast<double>(start.bias[static_cast<size_t>(j)]), size = std::fabs(sum);
        for (int64_t s = 0; s < shape.n; ++s) {
          sum += static_cast<double>(dy.at(j, s));
          size += std::fabs(static_cast<double>(dy.at(j, s)));
        }
        ASSERT_NEAR(static_cast<double>(dbias[static_cast<size_t>(j)]), sum,
                    rounding_bound(static_cast<double>(shape.n + 1)) * size);
      }
    }
  });
}

// How far operands of 8 bits and sums of 24 are from the exact product: each operand is wrong by at
// most 2^-8 of it (half a unit in the last of 8 bits, whose unit is at most 2^-7 of the number).
TEST(LinearBf16, IsWithinTheRoundingOfItsOperandsOfTheExactLayer) {
  for_each_bf16_unit([&](Bf16Unit) {
    WorstError worst("bf16_forward");
    Random random(24, 0, 0);
    for (const Shape& shape : {Shape{64, 64, 240}, {256, 256, 48}}) {
      const Layer layer(shape, random);
      const Matrix x(shape.in, shape.n, random, -1, 1);
      Matrix y(shape.out, shape.n);
      linear_forward_bf16(shape.in, shape.out, layer.packed.data(), nullptr, x.data.data(),
                          y.data.data(), x.ld, shape.n, LinearActivation::kNone);
      const double bound = (1 + 0x1p-8) * (1 + 0x1p-8) - 1 + rounding_bound(shape.in);
      for (int64_t s = 0; s < shape.n; ++s)
        for (int j = 0; j < shape.out; ++j) {
          double exact = 0, size = 0;
          const Floats row = layer.row(j);
          for (int k = 0; k < shape.in; ++k) {
            const double p =
                static_cast<double>(row[static_cast<size_t>(k)]) * static_cast<double>(x.at(k, s));
            exact += p;
            size += std::fabs(p);
          }
          worst.compare(y.at(j, s), exact, bound * size, "in", shape.in, "out", shape.out, "row", j,
                        "sample", s);
        }
    }
    worst.report();
  });
}

// Infinite and undefined numbers are not lost on the way.
TEST(LinearBf16, NonFiniteNumbersStaySo) {
  for_each_bf16_unit([&](Bf16Unit) {
    const Shape shape{16, 16, 16};
    Random random(25, 0, 0);
    const Layer layer(shape, random);
    for (const Real bad : {std::numeric_limits<Real>::infinity(),
                           std::numeric_limits<Real>::quiet_NaN(), 3.4e38_r}) {
      Matrix x(16, 16, random, 0.5, 1), y(16, 16);
      x.at(3, 5) = bad;
      linear_forward_bf16(16, 16, layer.packed.data(), nullptr, x.data.data(), y.data.data(), x.ld,
                          16, LinearActivation::kNone);
      for (int j = 0; j < 16; ++j)
        for (int64_t s = 0; s < 16; ++s)
          EXPECT_EQ(std::isfinite(y.at(j, s)), s != 5) << j << ' ' << s;
    }
  });
}

// What comes nearest to its tolerance is named with the unit that it ran on.
TEST(Bf16, UnitsNameTheWorstElement) {
  for_each_bf16_unit([](Bf16Unit unit) {
    EXPECT_EQ(bf16_unit(), unit);
    EXPECT_EQ(worst::target.name, bf16_unit_name(unit));
  });
  EXPECT_EQ(worst::target.name, "");
}

TEST(Bf16, UnitsHaveNames) {
  const Bf16Unit before = bf16_unit();
  for (const Bf16Unit unit : bf16_units()) {
    EXPECT_NE(bf16_unit_name(unit), "none");
    force_bf16_unit(unit);
    EXPECT_EQ(bf16_unit(), unit);
    EXPECT_EQ(precision_name(Precision::kBf16), "bf16 (" + bf16_unit_name(unit) + ")");
  }
  force_bf16_unit(before);
  EXPECT_EQ(resolve_precision(Precision::kF32), Precision::kF32);
  EXPECT_NE(resolve_precision(Precision::kAuto), Precision::kAuto);
}

#ifndef NERF_EMULATED_BF16  // where every target has them
TEST(Bf16, UnitsNeedTheirTarget) {
  for (const std::string& target : simd_targets()) {
    if (target == "AVX3") continue;
    force_simd_target(target);
    EXPECT_EQ(bf16_unit(), Bf16Unit::kNone) << target;
    EXPECT_EQ(resolve_precision(Precision::kAuto), Precision::kF32);
    try {
      resolve_precision(Precision::kBf16);
      ADD_FAILURE() << "bf16 on " << target;
    } catch (const Error& e) {
      EXPECT_NE(std::string(e.what()).find(target), std::string::npos) << e.what();
    }
  }
  force_simd_target("");
}
#endif

}  // namespace
}  // namespace nerf
