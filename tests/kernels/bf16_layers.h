// Layers of many widths for the tests of bf16 products.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "kernels/kernel_test.h"
#include "nerf/kernels/linear_bf16.h"

namespace nerf {

using Floats = std::vector<float>;  // what the units know

// Of a layer's weights as linear.h has them.
inline Floats row_of(const AlignedArray<Real>& w, int in, int j) {
  const Real* from = w.data() + j * weight_stride(in);
  return {from, from + in};
}
inline Floats column_of(const AlignedArray<Real>& w, int in, int out, int k) {
  Floats c;
  for (int j = 0; j < out; ++j) c.push_back(w[static_cast<size_t>(j * weight_stride(in) + k)]);
  return c;
}

inline Floats column_of(const Matrix& m, int64_t s) {
  Floats c;
  for (int r = 0; r < m.rows; ++r) c.push_back(m.at(r, s));
  return c;
}

struct Shape {
  int in, out;
  int64_t n;
};

inline std::vector<Shape> shapes() {
  std::vector<Shape> all;
  for (int in : kWidths)
    for (int out : kWidths)
      for (int64_t n : kCounts) all.push_back({in, out, n});
  // Wider than a strip of columns, deeper than what is summed at a time.
  for (const Shape s : {Shape{96, 130, 33},
                        {319, 97, 113},
                        {300, 20, 257},
                        {17, 300, 600},
                        {33, 7, 513},
                        {1024, 40, 16},
                        {1024, 1024, 5},
                        // The square ones that models have.
                        {128, 128, 600},
                        {256, 256, 33},
                        {512, 512, 17}})
    all.push_back(s);
  return all;
}

struct Layer {
  Layer(const Shape& s, Random& random)
      : in(s.in),
        out(s.out),
        w(static_cast<size_t>(out * weight_stride(in))),
        bias(static_cast<size_t>(round_up(out, kLane))),
        packed(static_cast<size_t>(packed_layer_size(in, out))) {
    for (int j = 0; j < out; ++j)
      for (int k = 0; k < in; ++k) at(j, k) = uniform(random, -1, 1);
    for (int j = 0; j < out; ++j) bias[static_cast<size_t>(j)] = uniform(random, -1, 1);
    pack_layer(in, out, w.data(), packed.data());
  }
  Real& at(int j, int k) { return w[static_cast<size_t>(j * weight_stride(in) + k)]; }
  Floats row(int j) const { return row_of(w, in, j); }
  Floats column(int k) const { return column_of(w, in, out, k); }
  int in, out;
  AlignedArray<Real> w, bias;
  AlignedArray<uint16_t> packed;
};

inline std::string name(const Shape& s) {
  return "in " + std::to_string(s.in) + " out " + std::to_string(s.out) + " n " +
         std::to_string(s.n);
}

}  // namespace nerf
