#include "nerf/kernels/linear.h"

#include <gtest/gtest.h>

#include <cmath>
#include <type_traits>
#include <vector>

#include "kernels/kernel_test.h"
#include "math/worst_error.h"
#include "nerf/math/reference/linear.h"

namespace nerf {
namespace {

using Vector = std::vector<double>;

// Weights [out x in], padded for the kernels and packed for the template.
struct Layer {
  Layer(int i, int o, Random& random)
      : in(i), out(o), w(static_cast<size_t>(o * weight_stride(i))) {
    for (int j = 0; j < out; ++j)
      for (int k = 0; k < in; ++k) {
        const Real v = uniform(random, -1, 1);
        w[static_cast<size_t>(j * weight_stride(in) + k)] = v;
        packed.push_back(v);
      }
    bias = AlignedArray<Real>(static_cast<size_t>(round_up(out, kLane)));
    for (int j = 0; j < out; ++j) bias[static_cast<size_t>(j)] = uniform(random, -1, 1);
  }
  Vector bias_vector() const { return {bias.begin(), bias.begin() + out}; }

  int in, out;
  AlignedArray<Real> w, bias;
  Vector packed;
};

Vector absolute(Vector v) {
  for (double& x : v) x = std::fabs(x);
  return v;
}

template <class Body>
void for_each_shape(const Body& body) {
  for_each_target([&](const std::string&) {
    Random random(17, 0, 0);
    for (int in : kWidths)
      for (int out : kWidths)
        for (int64_t n : kCounts) {
          SCOPED_TRACE("in " + std::to_string(in) + " out " + std::to_string(out) + " n " +
                       std::to_string(n));
          body(in, out, n, random);
        }
    // Wide layers take other ways: pieces of rows, and of samples in the weights' gradient.
    for (const auto& [in, out] : {std::pair{96, 96}, {97, 101}, {319, 130}, {340, 330}})
      for (int64_t n : {0, 1, 17, 193, in == 96 ? 530 : 400}) {
        SCOPED_TRACE("in " + std::to_string(in) + " out " + std::to_string(out) + " n " +
                     std::to_string(n));
        body(in, out, n, random);
      }
    // The widths that models have.
    for (int width : {128, 256, 512})
      for (int64_t n : {1, 40}) {
        SCOPED_TRACE("width " + std::to_string(width) + " n " + std::to_string(n));
        body(width, width, n, random);
      }
    SCOPED_TRACE("the widest");
    body(1024, 1024, 17, random);
  });
}

// A sum of in products and a bias, in any order: rounding_bound(in + 1) (|b| + sum |w| |x|).
TEST(Linear, Forward) {
  WorstError worst("forward");
  for_each_shape([&](int in, int out, int64_t n, Random& random) {
    const Layer layer(in, out, random);
    const Matrix x(in, n, random, -1, 1);
    for (bool relu : {false, true})
      for (bool with_bias : {false, true}) {
        Matrix y(out, n);
        linear_forward(in, out, layer.w.data(), with_bias ? layer.bias.data() : nullptr,
                       x.data.data(), y.data.data(), x.ld, n,
                       relu ? LinearActivation::kRelu : LinearActivation::kNone);
        const Vector bias = with_bias ? layer.bias_vector() : Vector();
        for (int64_t s = 0; s < n; ++s) {
          const Vector column = x.column(s);
          const Vector want =
              reference::linear(layer.packed, bias, column, static_cast<size_t>(out), relu);
          const Vector size = reference::linear(absolute(layer.packed), absolute(bias),
                                                absolute(column), static_cast<size_t>(out), false);
          for (int j = 0; j < out; ++j) {
            const size_t at = static_cast<size_t>(j);
            worst.compare(y.at(j, s), want[at], rounding_bound(in + 1) * size[at], "in", in, "out",
                          out, "n", n, "row", j, "sample", s);
          }
        }
        for (int j = 0; j < out; ++j)
          for (int64_t s = n; s < y.padded; ++s) ASSERT_TRUE(std::isfinite(y.at(j, s)));
        y.expect_untouched_beyond_padding();
      }
  });
  worst.report();
}

TEST(Linear, BackwardInput) {
  WorstError worst("backward_input");
  for_each_shape([&](int in, int out, int64_t n, Random& random) {
    const Layer layer(in, out, random);
    const Matrix dy(out, n, random, -1, 1, Matrix::Padding::kZero);
    // A layer input that is itself the output of a ReLU: about half of it 0.
    Matrix relu_output(in, n, random, -1, 1);
    for (Real& v : relu_output.data) v = std::max(v, 0.0_r);
    for (bool masked : {false, true}) {
      Matrix dx(in, n);
      linear_backward_input(in, out, layer.w.data(), dy.data.data(), dx.data.data(), dx.ld, n,
                            masked ? relu_output.data.data() : nullptr);
      Vector dw(layer.packed.size()), none, want, size;
      for (int64_t s = 0; s < n; ++s) {
        const Vector g = dy.column(s), x(static_cast<size_t>(in));
        reference::linear_backward(layer.packed, x, g, g, false, want, dw, none);
        reference::linear_backward(absolute(layer.packed), x, g, absolute(g), false, size, dw,
                                   none);
        for (int k = 0; k < in; ++k) {
          const size_t at = static_cast<size_t>(k);
          const bool open = !masked || relu_output.at(k, s) > 0;
          worst.compare(dx.at(k, s), open ? want[at] : 0, open ? rounding_bound(out) * size[at] : 0,
                        "in", in, "out", out, "n", n, "row", k, "sample", s);
        }
      }
      for (int k = 0; k < in; ++k)
        for (int64_t s = n; s < dx.padded; ++s) ASSERT_EQ(dx.at(k, s), 0) << "padding";
      dx.expect_untouched_beyond_padding();
    }
  });
  worst.report();
}

// What a pack holds of a wide layer's weights gives the bits that the weights give.
TEST(Linear, PacksChangeNothing) {
  for_each_target([&](const std::string&) {
    Random random(18, 0, 0);
    for (const auto& [in, out] : {std::pair{96, 96},
                                  {97, 101},
                                  {101, 97},
                                  {256, 256},
                                  {319, 130},
                                  {512, 512},
                                  {520, 516},
                                  {1024, 1024}}) {
      SCOPED_TRACE("in " + std::to_string(in) + " out " + std::to_string(out));
      const Layer layer(in, out, random);
      const size_t size = static_cast<size_t>(linear_pack_size(in, out));
      EXPECT_EQ(size % kLane, 0u);
      if constexpr (std::is_same_v<Real, float>) {
        EXPECT_GT(size, 0u);
      }
      AlignedArray<Real> pack(size);
      linear_pack(in, out, layer.w.data(), pack.data());
      for (int64_t n : {1, 17, 113}) {
        if (in == 1024 && n != 17) continue;
        const Matrix x(in, n, random, -1, 1);
        const Matrix dy(out, n, random, -1, 1, Matrix::Padding::kZero);
        Matrix y(out, n), with_pack(out, n), dx(in, n), dx_with_pack(in, n);
        // Without the weights themselves, which a pack stands for, where there is one.
        const AlignedArray<Real> nothing(layer.w.size());
        const Real* w = size > 0 ? nothing.data() : layer.w.data();
        linear_forward(in, out, layer.w.data(), layer.bias.data(), x.data.data(), y.data.data(),
                       x.ld, n, LinearActivation::kRelu);
        linear_forward(in, out, w, layer.bias.data(), x.data.data(), with_pack.data.data(), x.ld, n,
                       LinearActivation::kRelu, pack.data());
        linear_backward_input(in, out, layer.w.data(), dy.data.data(), dx.data.data(), dx.ld, n,
                              x.data.data());
        linear_backward_input(in, out, w, dy.data.data(), dx_with_pack.data.data(), dx.ld, n,
                              x.data.data(), pack.data());
        for (int64_t s = 0; s < n; ++s) {
          for (int j = 0; j < out; ++j) ASSERT_EQ(with_pack.at(j, s), y.at(j, s)) << j << " " << s;
          for (int k = 0; k < in; ++k)
            ASSERT_EQ(dx_with_pack.at(k, s), dx.at(k, s)) << k << " " << s;
        }
      }
    }
  });
}

// Sums of n products on top of what is there; the padding columns of dw stay 0.
TEST(Linear, BackwardWeights) {
  WorstError worst("backward_weights");
  for_each_shape([&](int in, int out, int64_t n, Random& random) {
    const Matrix x(in, n, random, -1, 1);
    const Matrix dy(out, n, random, -1, 1, Matrix::Padding::kZero);
    const int64_t stride = weight_stride(in);
    const Layer start(in, out, random);
    const bool with_bias = n % 2 == 1;
    AlignedArray<Real> dw = start.w, dbias = start.bias;
    linear_backward_weights(in, out, dy.data.data(), x.data.data(), dy.ld, n, dw.data(),
                            with_bias ? dbias.data() : nullptr);
    Vector want = start.packed, size = absolute(start.packed), dx;
    Vector want_bias = start.bias_vector(), size_bias = absolute(want_bias);
    const Vector no_w(want.size());
    for (int64_t s = 0; s < n; ++s) {
      const Vector column = x.column(s), g = dy.column(s);
      reference::linear_backward(no_w, column, g, g, false, dx, want, want_bias);
      reference::linear_backward(no_w, absolute(column), g, absolute(g), false, dx, size,
                                 size_bias);
    }
    const double bound = rounding_bound(static_cast<double>(n + 1));
    for (int j = 0; j < out; ++j) {
      for (int k = 0; k < in; ++k) {
        const size_t at = static_cast<size_t>(j * in + k);
        worst.compare(dw[static_cast<size_t>(j * stride + k)], want[at], bound * size[at], "in", in,
                      "out", out, "n", n, "row", j, "column", k);
      }
      for (int64_t k = in; k < stride; ++k)
        ASSERT_EQ(dw[static_cast<size_t>(j * stride + k)], 0) << "padding column " << k;
      const size_t at = static_cast<size_t>(j);
      worst.compare(dbias[at], with_bias ? want_bias[at] : start.bias[at], bound * size_bias[at],
                    "bias, in", in, "out", out, "n", n, "row", j);
    }
  });
  worst.report();
}

// The sums of the samples alone, as the weights' gradient takes them: the same bits. Numbers behind
// the last row keep what they are.
TEST(Linear, BackwardBias) {
  WorstError worst("backward_bias");
  for_each_target([&](const std::string&) {
    Random random(20, 0, 0);
    for (int out : {1, 3, 5, 16, 31, 64, 130})
      for (int64_t n : {0, 1, 15, 16, 17, 31, 33, 240, 600}) {
        const Matrix dy(out, n, random, -1, 1, Matrix::Padding::kZero), x(1, n, random, -1, 1);
        Matrix dbias(1, out + 1), beside(1, out + 1);
        AlignedArray<Real> dw(static_cast<size_t>(out * weight_stride(1)));
        Vector want;
        for (int64_t j = 0; j < out; ++j) {
          want.push_back(dbias.at(0, j) = uniform(random, -1, 1));
          beside.at(0, j) = dbias.at(0, j);
        }
        Vector size = absolute(want);
        linear_backward_bias(out, dy.data.data(), dy.ld, n, dbias.data.data());
        linear_backward_weights(1, out, dy.data.data(), x.data.data(), dy.ld, n, dw.data(),
                                beside.data.data());
        Vector none, dx;
        for (int64_t s = 0; s < n; ++s) {
          const Vector g = dy.column(s);
          reference::linear_backward<double>({}, {}, g, g, false, dx, none, want);
          reference::linear_backward<double>({}, {}, g, absolute(g), false, dx, none, size);
        }
        for (int64_t j = 0; j < out; ++j) {
          const size_t at = static_cast<size_t>(j);
          worst.compare(dbias.at(0, j), want[at],
                        rounding_bound(static_cast<double>(n + 1)) * size[at], "out", out, "n", n,
                        "row", j);
          ASSERT_EQ(dbias.at(0, j), beside.at(0, j)) << "out " << out << " n " << n << " row " << j;
        }
        for (int64_t j = out; j < dbias.ld; ++j) ASSERT_EQ(dbias.at(0, j), Matrix::kCanary) << j;
      }
  });
  worst.report();
}

TEST(Linear, ReluBackwardClosesExactlyWhereTheOutputIsZero) {
  for_each_target([&](const std::string&) {
    Random random(19, 0, 0);
    for (int64_t n : kCounts) {
      Matrix y(5, n, random, -1, 1), dy(5, n, random, -1, 1, Matrix::Padding::kZero);
      for (Real& v : y.data) v = v == Matrix::kCanary ? v : std::max(v, 0.0_r);
      if (n > 2) y.at(0, 0) = 1e-38_r, y.at(0, 1) = -0.0_r, y.at(0, 2) = 1e30_r;
      const Matrix before = dy;
      relu_backward(5, y.data.data(), dy.data.data(), y.ld, n);
      for (int r = 0; r < 5; ++r)
        for (int64_t s = 0; s < n; ++s)
          ASSERT_EQ(dy.at(r, s), y.at(r, s) > 0 ? before.at(r, s) : 0) << r << ' ' << s;
      dy.expect_untouched_beyond_padding();
    }
  });
}

// The kink from both sides: the smallest positive number passes, 0 and below give exactly 0.
TEST(Linear, ReluAtItsKink) {
  for_each_target([&](const std::string&) {
    AlignedArray<Real> w(kLane), x(kLane), y(kLane);
    w[0] = 1;
    const Real inputs[] = {-1e-30_r, -0.0_r, 0.0_r, 1e-30_r, -5, 5};
    std::copy(std::begin(inputs), std::end(inputs), x.begin());
    linear_forward(1, 1, w.data(), nullptr, x.data(), y.data(), kLane, 6, LinearActivation::kRelu);
    for (size_t i = 0; i < 6; ++i) EXPECT_EQ(y[i], std::max(inputs[i], 0.0_r)) << i;
  });
}

}  // namespace
}  // namespace nerf
