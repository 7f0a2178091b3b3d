// Nearest descriptors against plain loops, bit for bit.
#include "nerf/kernels/descriptors.h"

#include "kernel_test.h"
#include "nerf/math/reference/descriptors.h"
#ifndef NERF_DOUBLE
#include "kernels/descriptor_tiles.h"
#endif

namespace nerf {
namespace {

using Bytes = std::vector<uint8_t>;

struct Nearest {
  std::vector<NearestTwo> of_rows, of_columns;
  friend bool operator==(const Nearest&, const Nearest&) = default;
};

template <class Function>
Nearest nearest(const Bytes& a, const Bytes& b, const Function& function) {
  // What stood there before must not count.
  Nearest out{std::vector<NearestTwo>(a.size() / kDescriptorBytes, {1 << 30, 1 << 30, 7}),
              std::vector<NearestTwo>(b.size() / kDescriptorBytes, {1 << 30, 1 << 30, 7})};
  function(static_cast<int64_t>(out.of_rows.size()), a.data(),
           static_cast<int64_t>(out.of_columns.size()), b.data(), out.of_rows.data(),
           out.of_columns.data());
  return out;
}

Nearest expected(const Bytes& a, const Bytes& b) {
  return nearest(a, b,
                 [](int64_t rows, const uint8_t* x, int64_t columns, const uint8_t* y,
                    NearestTwo* of_rows, NearestTwo* of_columns) {
                   reference::nearest_descriptors(rows, x, columns, y, kDescriptorBytes, of_rows,
                                                  of_columns);
                 });
}

// Every target, and each way to multiply that it has.
void expect_as_reference(const Bytes& a, const Bytes& b) {
  const Nearest truth = expected(a, b);
  for_each_target([&](const std::string&) {
    EXPECT_TRUE(nearest(a, b, nearest_descriptors) == truth);
#ifndef NERF_DOUBLE
    EXPECT_TRUE(nearest(a, b, [](auto... arguments) {
                  internal::nearest_descriptors(internal::word_products(), arguments...);
                }) == truth);
#endif
  });
}

// Bytes below `limit`: a small one gives many equal dot products.
Bytes random_descriptors(int64_t n, uint64_t stream, int limit = 256) {
  Bytes out(static_cast<size_t>(n) * kDescriptorBytes);
  Random random(3, stream, 0);
  for (uint8_t& v : out) v = static_cast<uint8_t>(random.uniform() * static_cast<Real>(limit));
  return out;
}

TEST(Descriptors, AnyNumberOfRowsAndColumns) {
  for (const int64_t rows : {0, 1, 15, 16, 17, 150})
    for (const int64_t columns : {0, 1, 127, 128, 129, 300}) {
      SCOPED_TRACE(std::to_string(rows) + " x " + std::to_string(columns));
      expect_as_reference(random_descriptors(rows, 1), random_descriptors(columns, 2));
    }
}

TEST(Descriptors, TheFirstOfEqualDotProductsCounts) {
  // 12 values of a dot product at most, so that nearly all are shared.
  Bytes a(40 * kDescriptorBytes), b(400 * kDescriptorBytes);
  Random random(3, 4, 0);
  for (Bytes* x : {&a, &b})
    for (size_t i = 0; i < x->size(); i += 32) (*x)[i] = random.uniform() < 0.5_r;
  expect_as_reference(a, b);
  const Nearest truth = expected(a, b);
  EXPECT_EQ(truth.of_rows[0].best, truth.of_rows[0].second);
}

TEST(Descriptors, ExtremesNeitherOverflowNorMatch) {
  Bytes ones(20 * kDescriptorBytes, 255), zeros(140 * kDescriptorBytes, 0);
  expect_as_reference(ones, Bytes(140 * kDescriptorBytes, 255));
  expect_as_reference(ones, zeros);
  expect_as_reference(zeros, ones);
  EXPECT_EQ(expected(ones, ones).of_rows[3], (NearestTwo{128 * 255 * 255, 128 * 255 * 255, 0}));
  EXPECT_EQ(expected(ones, zeros).of_rows[3], NearestTwo());
}

// Sums of four 8-bit products are kept in 16 bits where they are known to fit.
TEST(Descriptors, FourBytesAtTheLimitOfSixteenBits) {
  const auto all = [](int64_t n, int value) {
    return Bytes(static_cast<size_t>(n) * kDescriptorBytes, static_cast<uint8_t>(value));
  };
  for (const int row : {0, 47, 48, 49, 174, 175, 176, 255})
    for (const int column : {0, 1, 63, 64, 65, 66, 254, 255}) {
      SCOPED_TRACE(std::to_string(row) + " x " + std::to_string(column));
      // 16 rows fill a tile; with one, those that fill it up are 0.
      for (const int64_t rows : {1, 16}) expect_as_reference(all(rows, row), all(130, column));
    }
  // One descriptor of a tile that differs from all others.
  Bytes a = random_descriptors(32, 6, 100), b = random_descriptors(256, 7, 100);
  std::fill_n(a.begin() + 17 * kDescriptorBytes, kDescriptorBytes, uint8_t{176});
  std::fill_n(b.begin() + 200 * kDescriptorBytes, kDescriptorBytes, uint8_t{255});
  expect_as_reference(a, b);
  expect_as_reference(b, a);
}

TEST(Descriptors, NeighboursFarApartAreFound) {
  // The two nearest of each descriptor stand in other panels than its own.
  Bytes a = random_descriptors(260, 5, 64);
  Bytes b(a.rbegin(), a.rend());
  expect_as_reference(a, b);
  expect_as_reference(a, a);
}

}  // namespace
}  // namespace nerf
