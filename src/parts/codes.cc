#include "nerf/parts/codes.h"

#include <algorithm>

#include "nerf/base/error.h"

namespace nerf {

namespace {

std::span<const Real> row(const LinearWeights& table, std::span<const Real> weights, int photo) {
  const size_t stride = static_cast<size_t>(weight_stride(table.in));
  return weights.subspan(table.offset + static_cast<size_t>(photo) * stride,
                         static_cast<size_t>(table.in));
}

std::vector<Real> blend(std::vector<Real> a, std::vector<Real> b, Real share) {
  const size_t n = std::max(a.size(), b.size());
  a.resize(n);
  b.resize(n);
  for (size_t i = 0; i < n; ++i) a[i] += share * (b[i] - a[i]);
  return a;
}

}  // namespace

CodeBooks::CodeBooks(const CodeShape& shape, size_t begin) {
  if (!shape.any()) return;
  photos = shape.photos;
  const int n = static_cast<int>(photos.size());
  appearance = {begin, shape.appearance, shape.appearance > 0 ? n : 0};
  colours = {begin + appearance.size(), kColourChange, shape.colours ? n : 0};
  transient = {begin + appearance.size() + colours.size(), shape.transient,
               shape.transient > 0 ? n : 0};
}

CodeShape CodeBooks::shape() const {
  return {appearance.out > 0 ? appearance.in : 0, colours.out > 0, photos,
          transient.out > 0 ? transient.in : 0};
}

std::array<Real, 3> Appearance::changed(const Real rgb[3], Real opacity,
                                        const Vec3& background) const {
  std::array<Real, 3> out{rgb[0], rgb[1], rgb[2]};
  if (colours.empty()) return out;
  for (size_t i = 0; i < 3; ++i) {
    out[i] += colours[9 + i] * opacity;
    for (size_t k = 0; k < 3; ++k)
      out[i] += colours[3 * i + k] * (rgb[k] - (1 - opacity) * background[static_cast<int>(k)]);
  }
  return out;
}

Appearance appearance_of(const CodeBooks& books, std::span<const Real> weights, int photo) {
  NERF_CHECK(photo >= 0 && photo < books.rows());
  Appearance out;
  const auto copy = [&](const LinearWeights& table, std::vector<Real>& to) {
    if (table.out == 0) return;
    const auto from = row(table, weights, photo);
    to.assign(from.begin(), from.end());
  };
  copy(books.appearance, out.code);
  copy(books.colours, out.colours);
  return out;
}

Appearance mean_appearance(const CodeBooks& books, std::span<const Real> weights) {
  Appearance out;
  if (books.appearance.out == 0) return out;
  std::vector<double> sums(static_cast<size_t>(books.appearance.in));
  for (int p = 0; p < books.rows(); ++p) {
    const auto from = row(books.appearance, weights, p);
    for (size_t i = 0; i < sums.size(); ++i) sums[i] += static_cast<double>(from[i]);
  }
  for (const double sum : sums) out.code.push_back(static_cast<Real>(sum / books.rows()));
  return out;
}

void fill_rows(std::span<const Real> numbers, int n, Value input, Chunk& chunk) {
  const int64_t stride = chunk.stride(input);
  for (size_t k = 0; k < numbers.size(); ++k)
    std::fill_n(chunk.data(input) + static_cast<int64_t>(k) * stride, round_up(n, kLane),
                numbers[k]);
}

Appearance blend(const Appearance& a, const Appearance& b, Real share) {
  return {blend(a.code, b.code, share), blend(a.colours, b.colours, share)};
}

}  // namespace nerf
