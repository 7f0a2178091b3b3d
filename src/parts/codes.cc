#include "nerf/parts/codes.h"

#include <algorithm>
#include <cmath>

#include "nerf/base/error.h"
#include "nerf/math/srgb.h"

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
  moments = shape.moments;
  photo_moments = shape.photo_moments;
  cameras = shape.cameras;
  photo_cameras = shape.photo_cameras;
  lenses = shape.lenses;
  photo_lenses = shape.photo_lenses;
  const auto place = [&](int numbers, size_t rows) {
    const LinearWeights table{begin, numbers, numbers > 0 ? static_cast<int>(rows) : 0};
    begin += table.size();
    return table;
  };
  appearance = place(shape.appearance, photos.size());
  colours = place(kColourChange, shape.colours ? photos.size() : 0);
  transient = place(shape.transient, photos.size());
  deformation = place(shape.deformation, moments.size());
  plane = place(shape.plane, moments.size());
  camera = place(shape.camera, cameras.size());
  falloff = place(kFalloff, lenses.size());
}

CodeShape CodeBooks::shape() const {
  const auto numbers = [](const LinearWeights& table) { return table.out > 0 ? table.in : 0; };
  return {numbers(appearance),  colours.out > 0, photos,        numbers(transient),
          numbers(deformation), numbers(plane),  moments,       photo_moments,
          numbers(camera),      cameras,         photo_cameras, lenses,
          photo_lenses};
}

size_t CodeBooks::size() const {
  size_t sum = 0;
  for (const LinearWeights* table :
       {&appearance, &colours, &transient, &deformation, &plane, &camera, &falloff})
    sum += table->size();
  return sum;
}

namespace {

// Where a time lies: between two moments, at `share` of the way.
struct Between {
  size_t low, high;
  double share;
};
Between between(std::span<const double> moments, double time) {
  NERF_CHECK(!moments.empty());
  const auto at = std::lower_bound(moments.begin(), moments.end(), time);
  const size_t high = std::min(static_cast<size_t>(at - moments.begin()), moments.size() - 1);
  if (high == 0 || moments[high] <= time) return {high, high, 0};
  return {high - 1, high, (time - moments[high - 1]) / (moments[high] - moments[high - 1])};
}

std::vector<Real> blended(std::span<const Real> a, std::span<const Real> b, double share) {
  std::vector<Real> out(a.begin(), a.end());
  for (size_t i = 0; i < out.size() && share > 0; ++i)
    out[i] = static_cast<Real>((1 - share) * static_cast<double>(a[i]) +
                               share * static_cast<double>(b[i]));
  return out;
}

// Of the rows that are chosen.
template <class Chosen>
std::vector<Real> mean_row(const LinearWeights& table, std::span<const Real> weights,
                           const Chosen& chosen) {
  std::vector<double> sums(static_cast<size_t>(table.in));
  int count = 0;
  for (int p = 0; p < table.out; ++p) {
    if (!chosen(p)) continue;
    ++count;
    const auto from = row(table, weights, p);
    for (size_t i = 0; i < sums.size(); ++i) sums[i] += static_cast<double>(from[i]);
  }
  std::vector<Real> out;
  for (const double sum : sums) out.push_back(static_cast<Real>(sum / std::max(count, 1)));
  return out;
}

constexpr auto kAll = [](int) { return true; };

void append(std::vector<Real>& to, std::span<const Real> numbers) {
  to.insert(to.end(), numbers.begin(), numbers.end());
}

}  // namespace

std::vector<Real> numbers_at(const LinearWeights& table, std::span<const double> moments,
                             std::span<const Real> weights, double time) {
  const Between at = between(moments, time);
  return blended(row(table, weights, static_cast<int>(at.low)),
                 row(table, weights, static_cast<int>(at.high)), at.share);
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

std::array<Real, kColourChange> change_of_exposure(double stops) {
  std::array<Real, kColourChange> out{};
  const double more = std::exp2(stops / 2.4) - 1;
  for (size_t k = 0; k < 3; ++k) {
    out[4 * k] = static_cast<Real>(more);
    out[9 + k] = static_cast<Real>(0.055 * more);
  }
  return out;
}

double exposure_of_change(std::span<const Real> change) {
  constexpr double kGrey = 0.5, kLeast = 1e-3;
  NERF_CHECK_EQ(change.size(), static_cast<size_t>(kColourChange));
  double light = 0;
  for (size_t k = 0; k < 3; ++k) {
    double c = kGrey + static_cast<double>(change[9 + k]);
    for (size_t i = 0; i < 3; ++i) c += kGrey * static_cast<double>(change[3 * k + i]);
    light += srgb_to_linear(c) / 3;
  }
  return std::log2(std::max(light, kLeast) / srgb_to_linear(kGrey));
}

Appearance appearance_of(const CodeBooks& books, std::span<const Real> weights, int photo) {
  NERF_CHECK(photo >= 0 && photo < books.rows());
  Appearance out;
  if (books.appearance.out > 0) append(out.code, row(books.appearance, weights, photo));
  if (books.camera.out > 0)
    append(out.code, row(books.camera, weights, books.photo_cameras[static_cast<size_t>(photo)]));
  if (books.colours.out > 0) append(out.colours, row(books.colours, weights, photo));
  return out;
}

Appearance mean_appearance(const CodeBooks& books, std::span<const Real> weights) {
  Appearance out;
  if (books.appearance.out > 0) append(out.code, mean_row(books.appearance, weights, kAll));
  if (books.camera.out > 0) append(out.code, mean_row(books.camera, weights, kAll));
  return out;
}

Appearance appearance_at(const CodeBooks& books, std::span<const Real> weights, double time,
                         int camera) {
  Appearance out;
  if (books.appearance.out > 0) {
    const Between at = between(books.moments, time);
    const auto of_moment = [&](size_t moment) {
      return mean_row(books.appearance, weights, [&](int photo) {
        return books.photo_moments[static_cast<size_t>(photo)] == static_cast<int>(moment);
      });
    };
    append(out.code, blended(of_moment(at.low), of_moment(at.high), at.share));
  }
  if (books.camera.out > 0) {
    const auto known = std::ranges::find(books.cameras, camera);
    append(out.code, mean_row(books.camera, weights, [&](int c) {
             return known == books.cameras.end() || c == known - books.cameras.begin();
           }));
  }
  return out;
}

Falloff falloff_of(const CodeBooks& books, std::span<const Real> weights, const std::string& lens) {
  Falloff out{};
  const auto known = std::ranges::find(books.lenses, lens);
  if (lens.empty() || known == books.lenses.end() || books.falloff.out == 0) return out;
  const auto from = row(books.falloff, weights, static_cast<int>(known - books.lenses.begin()));
  std::copy(from.begin(), from.end(), out.begin());
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
