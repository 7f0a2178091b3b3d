#include "nerf/parts/codes.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "nerf/kernels/linear.h"
#include "nerf/math/srgb.h"

namespace nerf {
namespace {

constexpr size_t kBegin = 48;  // weights that stand before the books

// Books of three photos whose number k of photo p is 10 p + k, of the colours negative.
struct Filled {
  CodeBooks books{{5, true, {"a", "b", "c"}}, kBegin};
  std::vector<Real> weights = std::vector<Real>(kBegin + books.size(), 99);

  Filled() {
    const auto fill = [&](const LinearWeights& book, Real sign) {
      for (int p = 0; p < book.out; ++p)
        for (int k = 0; k < book.in; ++k)
          weights[book.offset + static_cast<size_t>(p * weight_stride(book.in) + k)] =
              sign * static_cast<Real>(10 * p + k);
    };
    fill(books.appearance, 1);
    fill(books.colours, -1);
  }
};

TEST(CodeBooks, StandBehindEachOther) {
  const Filled f;
  EXPECT_EQ(f.books.appearance.offset, kBegin);
  EXPECT_EQ(f.books.colours.offset, kBegin + f.books.appearance.size());
  EXPECT_EQ(f.books.rows(), 3);
  EXPECT_FALSE(f.books.empty());
  const CodeShape shape = f.books.shape();
  EXPECT_EQ(shape.appearance, 5);
  EXPECT_TRUE(shape.colours);
  EXPECT_EQ(shape.photos, (std::vector<std::string>{"a", "b", "c"}));
}

TEST(CodeBooks, AreEmptyWithoutPhotosOrNumbers) {
  EXPECT_TRUE(CodeBooks({5, true, {}}, kBegin).empty());
  EXPECT_TRUE(CodeBooks({0, false, {"a"}}, kBegin).empty());
  EXPECT_EQ(CodeBooks({5, false, {"a"}}, kBegin).colours.size(), 0u);
  EXPECT_EQ(CodeBooks({0, true, {"a"}}, kBegin).appearance.size(), 0u);
}

TEST(CodeBooks, GiveAPhotosNumbers) {
  const Filled f;
  const Appearance b = appearance_of(f.books, f.weights, 1);
  EXPECT_EQ(b.code, (std::vector<Real>{10, 11, 12, 13, 14}));
  ASSERT_EQ(b.colours.size(), size_t{kColourChange});
  EXPECT_EQ(b.colours.front(), -10);
  EXPECT_EQ(b.colours.back(), -21);
}

TEST(CodeBooks, TheMeanChangesNoColours) {
  const Filled f;
  const Appearance mean = mean_appearance(f.books, f.weights);
  EXPECT_EQ(mean.code, (std::vector<Real>{10, 11, 12, 13, 14}));
  EXPECT_TRUE(mean.colours.empty());
}

TEST(Appearance, BlendsAreLinear) {
  const Filled f;
  const Appearance a = appearance_of(f.books, f.weights, 0),
                   c = appearance_of(f.books, f.weights, 2);
  EXPECT_EQ(blend(a, c, 0).code, a.code);
  EXPECT_EQ(blend(a, c, 1).colours, c.colours);
  EXPECT_EQ(blend(a, c, 0.25_r).code, (std::vector<Real>{5, 6, 7, 8, 9}));
  const Appearance none;
  EXPECT_EQ(blend(none, c, 0.5_r).code, (std::vector<Real>{10, 10.5_r, 11, 11.5_r, 12}));
}

TEST(Appearance, ChangesWhatStandsBeforeTheBackground) {
  Appearance a;
  const Real rgb[3] = {0.5_r, 0.25_r, 0.75_r};
  EXPECT_EQ(a.changed(rgb, 1, {}), (std::array<Real, 3>{0.5_r, 0.25_r, 0.75_r}));
  a.colours.assign(kColourChange, 0);
  a.colours[0] = 1;      // twice the red
  a.colours[5] = 0.5_r;  // half of the blue to the green
  a.colours[11] = -0.25_r;
  EXPECT_EQ(a.changed(rgb, 1, {}), (std::array<Real, 3>{1, 0.625_r, 0.5_r}));
  // A pixel that is all background, and one that is half.
  EXPECT_EQ(a.changed(rgb, 0, {0.5_r, 0.25_r, 0.75_r}),
            (std::array<Real, 3>{0.5_r, 0.25_r, 0.75_r}));
  EXPECT_EQ(a.changed(rgb, 0.5_r, {0.5_r, 0.5_r, 0.5_r}),
            (std::array<Real, 3>{0.75_r, 0.5_r, 0.625_r}));
}

// In linear light, of all values that sRGB does not hold in its straight part.
TEST(Appearance, ExposureIsAnAffineChangeOfColours) {
  for (const double stops : {-2.0, -0.3, 0.0, 0.5, 1.5}) {
    Appearance a;
    const auto change = change_of_exposure(stops);
    a.colours.assign(change.begin(), change.end());
    for (const double c : {0.2, 0.5, 0.9}) {
      const Real grey = static_cast<Real>(c);
      const Real rgb[3] = {grey, 0.5_r * grey + 0.1_r, grey};
      const auto seen = a.changed(rgb, 1, {});
      for (size_t k = 0; k < 3; ++k)
        EXPECT_NEAR(static_cast<double>(seen[k]),
                    linear_to_srgb(std::exp2(stops) * srgb_to_linear(static_cast<double>(rgb[k]))),
                    1e-6)
            << stops;
    }
    EXPECT_NEAR(exposure_of_change(change), stops, 1e-6);
  }
  // White balance alone is no exposure worth the name; black is not without end.
  std::array<Real, kColourChange> black{};
  for (size_t k = 0; k < 3; ++k) black[4 * k] = -1;
  EXPECT_TRUE(std::isfinite(exposure_of_change(black)));
}

TEST(CodeBooks, KnowLensesByName) {
  CodeShape shape{0, false, {"a", "b", "c"}};
  shape.lenses = {"wide", "tele"};
  shape.photo_lenses = {1, 0, 1};
  const CodeBooks books(shape, kBegin);
  EXPECT_EQ(books.falloff.out, 2);
  EXPECT_EQ(books.size(), books.falloff.size());
  EXPECT_FALSE(books.empty());
  EXPECT_FALSE(books.has_own_light());
  EXPECT_EQ(books.shape().photo_lenses, shape.photo_lenses);
  std::vector<Real> weights(kBegin + books.size(), 99);
  for (int k = 0; k < 3; ++k)
    weights[books.falloff.offset + static_cast<size_t>(weight_stride(3) + k)] =
        static_cast<Real>(k + 1);
  EXPECT_EQ(falloff_of(books, weights, "tele"), (Falloff{1, 2, 3}));
  EXPECT_EQ(falloff_of(books, weights, "macro"), Falloff{});
  EXPECT_EQ(falloff_of(books, weights, ""), Falloff{});
}

// Books of three moments, of two photos of the first and one of each other, and of two cameras,
// numbered 7 and 3: row r of every table has numbers 10 r + k.
struct Moving {
  CodeBooks books;
  std::vector<Real> weights;

  Moving() {
    CodeShape shape{2, false, {"a", "b", "c", "d"}};
    shape.deformation = 3;
    shape.plane = 2;
    shape.moments = {0, 0.25, 1};
    shape.photo_moments = {0, 0, 1, 2};
    shape.camera = 2;
    shape.cameras = {7, 3};
    shape.photo_cameras = {0, 1, 1, 0};
    books = CodeBooks(shape, kBegin);
    weights.assign(kBegin + books.size(), 99);
    for (const LinearWeights* book :
         {&books.appearance, &books.deformation, &books.plane, &books.camera})
      for (int row = 0; row < book->out; ++row)
        for (int k = 0; k < book->in; ++k)
          weights[book->offset + static_cast<size_t>(row * weight_stride(book->in) + k)] =
              static_cast<Real>(10 * row + k);
  }
  std::vector<Real> at(double time) const {
    return numbers_at(books.deformation, books.moments, weights, time);
  }
};

TEST(Moments, NumbersAreBlendedBetweenThem) {
  const Moving m;
  EXPECT_EQ(m.books.shape().moments, m.books.moments);
  EXPECT_EQ(m.books.size(), m.weights.size() - kBegin);
  EXPECT_EQ(m.at(0), (std::vector<Real>{0, 1, 2}));
  EXPECT_EQ(m.at(0.25), (std::vector<Real>{10, 11, 12}));
  EXPECT_EQ(m.at(1), (std::vector<Real>{20, 21, 22}));
  EXPECT_EQ(m.at(0.125), (std::vector<Real>{5, 6, 7}));
  EXPECT_EQ(m.at(0.4375), (std::vector<Real>{12.5_r, 13.5_r, 14.5_r}));
  EXPECT_EQ(m.at(-1), m.at(0));
  EXPECT_EQ(m.at(2), m.at(1));
}

TEST(Moments, LightFollowsTimeAndTheCamera) {
  const Moving m;
  EXPECT_FALSE(m.books.has_own_light());
  EXPECT_EQ(m.books.light(), 4);
  EXPECT_EQ(appearance_of(m.books, m.weights, 2).code, (std::vector<Real>{20, 21, 10, 11}));
  EXPECT_EQ(appearance_at(m.books, m.weights, 0, 7).code, (std::vector<Real>{5, 6, 0, 1}));
  EXPECT_EQ(appearance_at(m.books, m.weights, 0.125, 3).code,
            (std::vector<Real>{12.5_r, 13.5_r, 10, 11}));
  EXPECT_EQ(appearance_at(m.books, m.weights, 1, -1).code, (std::vector<Real>{30, 31, 5, 6}));
  EXPECT_EQ(appearance_at(m.books, m.weights, 1, 4).code, (std::vector<Real>{30, 31, 5, 6}));
}

}  // namespace
}  // namespace nerf
