// Values that stand as pairs between two layers, against rows of the same values.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <bit>

#include "kernels/bf16_layers.h"
#include "nerf/math/reference/bf16.h"

namespace nerf {
namespace {

// The values of a matrix of a ReLU's output as pairs, padding too.
AlignedArray<uint16_t> pairs_of(const Matrix& m) {
  AlignedArray<uint16_t> pairs(static_cast<size_t>(pairs_size(m.rows, m.n)));
  for (int r = 0; r < m.rows; ++r)
    for (int64_t s = 0; s < m.padded; ++s)
      pairs[static_cast<size_t>(pair_index(m.rows, r, s))] =
          static_cast<uint16_t>(std::bit_cast<uint32_t>(reference::nearest_bf16(m.at(r, s))) >> 16);
  return pairs;
}

// Behind the last pair, of any width and count of samples.
struct PairsOut {
  static constexpr uint16_t kCanary = 0x7777;
  PairsOut(int rows, int64_t n) : size(static_cast<size_t>(pairs_size(rows, n))), data(size + 64) {
    std::ranges::fill(data, kCanary);
  }
  void expect_untouched_beyond() const {
    for (size_t i = size; i < data.size(); ++i) ASSERT_EQ(data[i], kCanary) << "behind the pairs";
  }
  size_t size;
  AlignedArray<uint16_t> data;
};

// A layer's output as pairs is its rows, rounded, with 0 behind the last; and as the next layer's
// input gives the bits that the rows give, in each product and as a mask.
TEST(LinearPairs, PairsAreTheRoundedRows) {
  for_each_bf16_unit([&](Bf16Unit) {
    Random random(26, 0, 0);
    for (const Shape& shape : shapes()) {
      if (!layer_writes_pairs(shape.in, shape.out)) continue;
      SCOPED_TRACE(name(shape));
      const Layer layer(shape, random);
      const Matrix x(shape.in, shape.n, random, -1, 1);
      for (const bool relu : {false, true}) {
        Matrix y(shape.out, shape.n);
        PairsOut pairs(shape.out, shape.n);
        const auto forward = [&](LayerOutput to) {
          linear_forward_bf16(shape.in, shape.out, layer.packed.data(), layer.bias.data(),
                              x.data.data(), to, x.ld, shape.n,
                              relu ? LinearActivation::kRelu : LinearActivation::kNone);
        };
        forward(y.data.data());
        forward(pairs.data.data());
        const AlignedArray<uint16_t> want = pairs_of(y);
        for (size_t i = 0; i < want.size(); ++i)
          ASSERT_EQ(pairs.data[i], want[i]) << "element " << i;
        pairs.expect_untouched_beyond();
      }
    }
  });
}

TEST(LinearPairs, PairsAreAnInputLikeRows) {
  for_each_bf16_unit([&](Bf16Unit) {
    Random random(27, 0, 0);
    for (const Shape& shape : shapes()) {
      SCOPED_TRACE(name(shape));
      const Layer layer(shape, random);
      Matrix x(shape.in, shape.n, random, -1, 1);
      for (Real& v : x.data) v = v == Matrix::kCanary ? v : std::max(v, 0.0_r);
      const Matrix dy(shape.out, shape.n, random, -1, 1, Matrix::Padding::kZero);
      const AlignedArray<uint16_t> pairs = pairs_of(x);
      const auto results = [&](LayerInput input) {
        Matrix y(shape.out, shape.n), dx(shape.in, shape.n);
        AlignedArray<Real> dw = layer.w;
        linear_forward_bf16(shape.in, shape.out, layer.packed.data(), nullptr, input, y.data.data(),
                            x.ld, shape.n, LinearActivation::kNone);
        linear_backward_input_bf16(shape.in, shape.out, layer.packed.data(), dy.data.data(),
                                   dx.data.data(), x.ld, shape.n, input);
        linear_backward_weights_bf16(shape.in, shape.out, dy.data.data(), input, x.ld, shape.n,
                                     dw.data(), nullptr);
        return std::array{y.data, dx.data, dw};
      };
      const auto got = results(pairs.data()), want = results(x.data.data());
      for (size_t i = 0; i < want.size(); ++i)
        ASSERT_TRUE(std::ranges::equal(got[i], want[i])) << "product " << i;
    }
  });
}

// What rounds to 0 is 0 to the next layer.
TEST(LinearPairs, NumbersBelowTheNormalOnesAreZeroInPairs) {
  for_each_bf16_unit([&](Bf16Unit) {
    const Shape shape{16, 16, 16};
    Random random(28, 0, 0);
    Layer layer(shape, random);
    std::ranges::fill(layer.bias, 0x1p-127_r);
    const Matrix x(16, 16, random, 0, 0);
    PairsOut pairs(16, 16);
    linear_forward_bf16(16, 16, layer.packed.data(), layer.bias.data(), x.data.data(),
                        pairs.data.data(), x.ld, 16, LinearActivation::kRelu);
    for (size_t i = 0; i < pairs.size; ++i) ASSERT_EQ(pairs.data[i], 0);
  });
}

}  // namespace
}  // namespace nerf
