// What only moves or adds numbers, on those of every magnitude; and what is no number, which stays
// in its column.
#include "nerf/kernels/elementwise.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <string>
#include <type_traits>
#include <vector>

#include "kernels/kernel_test.h"
#include "nerf/kernels/encoding.h"
#include "nerf/math/reference/spherical_harmonics.h"
#include "stress/magnitudes.h"

namespace nerf::stress {
namespace {

const Real kNan = std::numeric_limits<Real>::quiet_NaN();

// Numbers of every magnitude and either sign, infinities, zeros, and what is no number: quiet and
// signalling, with a payload.
std::vector<Real> all_bits() {
  using Bits = std::conditional_t<sizeof(Real) == 4, uint32_t, uint64_t>;
  std::vector<Real> out = all_magnitudes(0x3ffff1, true);
  const Bits infinite = std::bit_cast<Bits>(kInf);
  for (const Bits nan : {infinite | 1, ~Bits{0}, std::bit_cast<Bits>(kNan) | 12345})
    out.push_back(std::bit_cast<Real>(nan));
  return out;
}

bool same_bits(const Real& a, const Real& b) { return std::memcmp(&a, &b, sizeof(Real)) == 0; }

// Nothing is computed with: every bit arrives, in squares and in what is left over beside them.
TEST(StressElementwise, TransposeKeepsEveryBit) {
  const std::vector<Real> values = all_bits();
  constexpr Real kUntouched = -7;
  for (const int64_t n : {0, 1, 3, 4, 17, 64})
    for (const int64_t rows : {0, 1, 4, 7, 16}) {
      const int64_t ldx = n + 5, ldy = rows + 3;
      std::vector<Real> x(static_cast<size_t>(rows * ldx)), y;
      for (size_t i = 0; i < x.size(); ++i)
        x[i] = values[(i * 5 + static_cast<size_t>(n)) % values.size()];
      for_each_mode(
          [&] {
            y.assign(static_cast<size_t>(n * ldy), kUntouched);
            transpose(n, rows, x.data(), ldx, y.data(), ldy);
          },
          [&] {
            for (int64_t s = 0; s < n; ++s)
              for (int64_t k = 0; k < ldy; ++k) {
                const Real got = y[static_cast<size_t>(s * ldy + k)];
                const Real want = k < rows ? x[static_cast<size_t>(k * ldx + s)] : kUntouched;
                ASSERT_TRUE(same_bits(got, want))
                    << n << " x " << rows << ": " << s << ", " << k << ": " << got << ' ' << want;
              }
          });
    }
}

// Two numbers that are, and whose sum is, normal or 0 give the one rounded sum there is; of others
// each may count as 0. What is no number, or infinities of either sign, give none.
TEST(StressElementwise, SumsOfEveryMagnitude) {
  const std::vector<Real> values = all_bits();
  const auto normal = [](Real v) { return !(std::fabs(v) < kTiny) || v == 0; };
  int64_t exact = 0, none = 0;
  for (const size_t apart : {0, 1, 7, 31, 200})
    for (const int64_t n : {int64_t{0}, int64_t{1}, int64_t{15}, int64_t{16}, int64_t{17},
                            static_cast<int64_t>(values.size())}) {
      Matrix x(1, n), before(1, n), y(1, n);
      for (int64_t i = 0; i < x.padded; ++i) {
        // From behind, where what is no number stands.
        const size_t at = values.size() - 1 - static_cast<size_t>(i) % values.size();
        x.at(0, i) = values[at];
        before.at(0, i) = values[(at * 3 + apart) % values.size()];
      }
      for_each_mode(
          [&] {
            for (int64_t i = 0; i < y.padded; ++i) y.at(0, i) = before.at(0, i);
            add_to(n, x.data.data(), y.data.data());
          },
          [&] {
            for (int64_t i = 0; i < n; ++i) {
              const Real a = x.at(0, i), b = before.at(0, i), want = a + b, got = y.at(0, i);
              if (std::isnan(want)) {
                ++none;
                ASSERT_TRUE(std::isnan(got)) << a << " + " << b;
              } else if (std::isinf(want) || (normal(a) && normal(b) && normal(want))) {
                ++exact;
                ASSERT_EQ(got, want) << a << " + " << b;
              } else {
                ASSERT_NEAR(got, want, 3 * kTiny) << a << " + " << b;
              }
            }
            y.expect_untouched_beyond_padding();
          });
    }
  EXPECT_GT(exact, 1000);
  EXPECT_GT(none, 30);
}

// A kernel on rows of inputs and of outputs, which hold 0.25 before.
struct Kernel {
  const char* name;
  int inputs, outputs;
  // Inputs whose being no number shows in each output, as bits. Of the others the header says
  // nothing: clamps may make a number of what is none.
  unsigned shows;
  void (*run)(int64_t n, const Matrix& in, Matrix& out);
  // What other columns may change by: a vector with an argument that is no number goes the way of
  // large ones, which is as near to the sine but not the same bits.
  double other_columns = 0;
};

const Real* row(const Matrix& m, int r) { return m.data.data() + r * m.ld; }
Real* row(Matrix& m, int r) { return m.data.data() + r * m.ld; }

// As tests/kernels/encoding_test.cc; both ways are off by as much.
constexpr double kSineError = 4 * kRoundoff;

const Kernel kKernels[] = {
    {"truncated_exp_forward", 1, 1, 0,
     [](int64_t n, const Matrix& in, Matrix& out) {
       truncated_exp_forward(n, row(in, 0), row(out, 0));
     }},
    {"truncated_exp_backward of x, dy", 2, 1, 0b10,
     [](int64_t n, const Matrix& in, Matrix& out) {
       truncated_exp_backward(n, row(in, 0), row(in, 1), row(out, 0));
     }},
    {"sigmoid_forward", 1, 1, 0,
     [](int64_t n, const Matrix& in, Matrix& out) { sigmoid_forward(n, row(in, 0), row(out, 0)); }},
    {"sigmoid_backward of y, dy", 2, 1, 0b11,
     [](int64_t n, const Matrix& in, Matrix& out) {
       sigmoid_backward(n, row(in, 0), row(in, 1), row(out, 0));
     }},
    {"softplus_forward", 1, 1, 0,
     [](int64_t n, const Matrix& in, Matrix& out) {
       softplus_forward(n, -1, row(in, 0), row(out, 0));
     }},
    {"softplus_backward of x, dy", 2, 1, 0b10,
     [](int64_t n, const Matrix& in, Matrix& out) {
       softplus_backward(n, -1, row(in, 0), row(in, 1), row(out, 0));
     }},
    {"relu_forward", 1, 1, 0,
     [](int64_t n, const Matrix& in, Matrix& out) { relu_forward(n, row(in, 0), row(out, 0)); }},
    {"relu_backward of y, dy", 2, 1, 0b10,
     [](int64_t n, const Matrix& in, Matrix& out) {
       std::copy_n(row(in, 1), in.padded, row(out, 0));
       relu_backward(1, row(in, 0), row(out, 0), out.ld, n);
     }},
    {"opacity of density, delta", 2, 1, 0,
     [](int64_t n, const Matrix& in, Matrix& out) {
       opacity(n, row(in, 0), row(in, 1), row(out, 0));
     }},
    {"add_to", 1, 1, 0b1,
     [](int64_t n, const Matrix& in, Matrix& out) { add_to(n, row(in, 0), row(out, 0)); }},
    {"sine_cosine_forward", 1, 2, 0b1,
     [](int64_t n, const Matrix& in, Matrix& out) {
       sine_cosine_forward(n, row(in, 0), nullptr, 8, 1, row(out, 0), row(out, 1));
     },
     2 * kSineError},
    {"sine_cosine_forward of x, variance", 2, 2, 0b01,
     [](int64_t n, const Matrix& in, Matrix& out) {
       sine_cosine_forward(n, row(in, 0), row(in, 1), 1, 1, row(out, 0), row(out, 1));
     },
     2 * kSineError},
    {"sine_cosine_backward of both, their gradients", 4, 2, 0b1111,
     [](int64_t n, const Matrix& in, Matrix& out) {
       sine_cosine_backward(n, row(in, 0), row(in, 1), row(in, 2), row(in, 3), 8, row(out, 0),
                            row(out, 1));
     }},
};

// All other columns keep their bits, to either side and in other vectors.
TEST(StressElementwise, WhatIsNoNumberStaysInItsColumn) {
  constexpr int64_t kCount = 40;
  for (const Kernel& kernel : kKernels) {
    SCOPED_TRACE(kernel.name);
    Random random(71, 0, 0);
    const Matrix in(kernel.inputs, kCount, random, 0.1, 0.9);
    for_each_target([&](const std::string&) {
      const auto run = [&](const Matrix& from) {
        Matrix out(kernel.outputs, kCount);
        for (int r = 0; r < out.rows; ++r) std::fill_n(row(out, r), out.padded, 0.25_r);
        kernel.run(kCount, from, out);
        out.expect_untouched_beyond_padding();
        return out;
      };
      const Matrix whole = run(in);
      for (int input = 0; input < kernel.inputs; ++input)
        for (const int64_t at : {0, 7, 15, 16, 39}) {
          Matrix broken = in;
          broken.at(input, at) = kNan;
          const Matrix out = run(broken);
          for (int r = 0; r < out.rows; ++r)
            for (int64_t i = 0; i < kCount; ++i) {
              if (i == at) {
                if (kernel.shows >> input & 1) {
                  ASSERT_TRUE(std::isnan(out.at(r, i)))
                      << "input " << input << " output " << r << ": " << out.at(r, i);
                }
              } else {
                ASSERT_NEAR(out.at(r, i), whole.at(r, i), kernel.other_columns)
                    << "input " << input << " at " << at << " output " << r << " column " << i;
              }
            }
        }
    });
  }
}

// Of a direction with one or all components no number, the polynomials of these are none.
TEST(StressElementwise, HarmonicsOfWhatIsNoNumber) {
  constexpr int64_t kCount = 40;
  Random random(72, 0, 0);
  const Matrix in(3, kCount, random, -0.5, 0.5);
  for_each_target([&](const std::string&) {
    const auto run = [&](const Matrix& from) {
      Matrix out(kSphericalHarmonics, kCount);
      spherical_harmonics(kCount, row(from, 0), from.ld, row(out, 0), out.ld);
      return out;
    };
    const Matrix whole = run(in);
    for (unsigned which = 1; which < 8; ++which)
      for (const int64_t at : {0, 7, 15, 16, 39}) {
        Matrix broken = in;
        for (int k = 0; k < 3; ++k)
          if (which >> k & 1) broken.at(k, at) = kNan;
        const std::vector<double> d = broken.column(at);
        const auto want = reference::spherical_harmonics<double>(d[0], d[1], d[2]);
        const Matrix out = run(broken);
        for (int r = 0; r < out.rows; ++r)
          for (int64_t i = 0; i < kCount; ++i) {
            if (i == at) {
              ASSERT_EQ(std::isnan(out.at(r, i)), std::isnan(want[static_cast<size_t>(r)]))
                  << "components " << which << " value " << r;
            } else {
              ASSERT_EQ(out.at(r, i), whole.at(r, i)) << "column " << i << " beside " << at;
            }
          }
      }
  });
}

}  // namespace
}  // namespace nerf::stress
