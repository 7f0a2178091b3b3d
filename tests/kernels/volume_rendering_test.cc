#include "nerf/kernels/volume_rendering.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "kernels/kernel_test.h"
#include "math/worst_error.h"
#include "nerf/kernels/elementwise.h"

namespace nerf {
namespace {

constexpr Real kInf = std::numeric_limits<Real>::infinity();
// Sums and products in double, of at most some thousand terms of the size of the results' parts.
constexpr double kDoubleError = 1e-12;

// Rays of all lengths around those of vectors, one after the other from an odd place on, with a gap
// of samples that belong to none at both ends.
struct Scene {
  static constexpr int kLengths[] = {0,  1,  2,  3,  4,  5,  7,  8,   9,
                                     15, 16, 17, 23, 24, 31, 40, 240, 1000};
  static constexpr int kFirst = 3, kGap = 13;

  explicit Scene(uint64_t seed, double most_density) {
    begin.push_back(kFirst);
    for (const int n : kLengths) begin.push_back(begin.back() + n);
    const int64_t n = begin.back() + kGap;
    const int64_t rays = static_cast<int64_t>(begin.size()) - 1;
    Random random(seed, 0, 0);
    density = Matrix(1, n, random, 0, most_density);
    delta = Matrix(1, n, random, 0, 0.1);
    colour = Matrix(3, n, random, -0.1, 1.1);
    background = Matrix(3, rays, random, 0, 1);
    d_pixel = Matrix(4, rays, random, -1, 1);
    dw = Matrix(1, n, random, -1, 1);
    // Rays that end opaque, without matter, and at infinity.
    density.at(0, begin[10] - 1) = 1e10_r;
    std::fill_n(&density.at(0, begin[9]), 6, 0.0_r);
    delta.at(0, begin[16] - 1) = kInf;
    alpha = Matrix(1, n, random, 0, 1);
    opacity(n, density.data.data(), delta.data.data(), alpha.data.data());
  }
  RayRanges rays() const { return {begin.data(), static_cast<int>(begin.size()) - 1}; }
  double interval(int i) const { return std::min(delta.at(0, i), kLongestInterval); }
  double toward(int r, int i) const {
    double out = d_pixel.at(3, r);
    for (int k = 0; k < 3; ++k) out += static_cast<double>(colour.at(k, i)) * d_pixel.at(k, r);
    return out;
  }

  std::vector<int32_t> begin;
  Matrix density{1, 0}, delta{1, 0}, colour{3, 0}, background{3, 0}, d_pixel{4, 0}, dw{1, 0},
      alpha{1, 0};
};

ColourRows<const Real> rows(const Matrix& m) { return {m.data.data(), m.ld}; }
ColourRows<Real> rows(Matrix& m) { return {m.data.data(), m.ld}; }

struct Light {
  std::vector<double> weights;  // of all samples, 0 where they belong to no ray
  std::vector<double> left;     // of all rays
};

// By the definition, one sample after the other.
Light light_of(const Scene& s, const Matrix& alpha, bool opaque_end) {
  Light out{std::vector<double>(static_cast<size_t>(alpha.n)), {}};
  for (int r = 0; r < s.rays().count; ++r) {
    long double t = 1;
    for (int i = s.begin[static_cast<size_t>(r)]; i < s.begin[static_cast<size_t>(r) + 1]; ++i) {
      const bool last = opaque_end && i + 1 == s.begin[static_cast<size_t>(r) + 1];
      const long double a = last ? 1.0L : static_cast<long double>(alpha.at(0, i));
      out.weights[static_cast<size_t>(i)] = static_cast<double>(t * a);
      t *= 1 - a;
    }
    out.left.push_back(static_cast<double>(t));
  }
  return out;
}

// What lies outside all rays is as it was.
void expect_same_outside(const Scene& s, const Matrix& before, const Matrix& after) {
  for (int k = 0; k < after.rows; ++k)
    for (int64_t i = 0; i < after.ld; i += i + 1 == s.begin.front() ? s.begin.back() - i : 1)
      ASSERT_EQ(after.at(k, i), before.at(k, i)) << "row " << k << " column " << i;
}

TEST(VolumeRendering, WeightsAreTheLightThatEachSampleStops) {
  WorstError worst("weights");
  for_each_target([&](const std::string&) {
    for (const double most : {0.1, 30.0, 2000.0})
      for (const bool opaque_end : {false, true}) {
        const Scene s(51, most);
        const Light want = light_of(s, s.alpha, opaque_end);
        Matrix w = s.alpha;
        render_weights_forward(s.rays(), opaque_end, w.data.data());
        for (int i = s.begin.front(); i < s.begin.back(); ++i) {
          const double exact = want.weights[static_cast<size_t>(i)];
          worst.compare(w.at(0, i), exact, kRoundoff * exact + 1e-38, "density to", most, "sample",
                        i);
        }
        expect_same_outside(s, s.alpha, w);
      }
  });
  worst.report();
}

TEST(VolumeRendering, CompositingBlendsOverTheBackground) {
  WorstError worst("pixels"), accumulated("from weights");
  for_each_target([&](const std::string&) {
    for (const double most : {0.1, 30.0, 2000.0}) {
      const Scene s(52, most);
      const Light light = light_of(s, s.alpha, false);
      Matrix w = s.alpha, pixel(4, s.rays().count), again(4, s.rays().count);
      composite_forward(s.rays(), w.data.data(), rows(s.colour), rows(s.background), rows(pixel));
      Matrix weights = s.alpha;
      render_weights_forward(s.rays(), false, weights.data.data());
      for (int64_t i = 0; i < w.ld; ++i) ASSERT_EQ(w.at(0, i), weights.at(0, i));
      accumulate_forward(s.rays(), weights.data.data(), rows(s.colour), rows(s.background),
                         rows(again));
      for (int r = 0; r < s.rays().count; ++r)
        for (int k = 0; k < 4; ++k) {
          double want = k == 3 ? 1 - light.left[static_cast<size_t>(r)]
                               : light.left[static_cast<size_t>(r)] * s.background.at(k, r);
          double from_weights = 0, all = 0;
          for (int i = s.begin[static_cast<size_t>(r)]; i < s.begin[static_cast<size_t>(r) + 1];
               ++i) {
            const double c = k == 3 ? 1 : s.colour.at(k, i);
            if (k < 3) want += light.weights[static_cast<size_t>(i)] * c;
            from_weights += static_cast<double>(weights.at(0, i)) * c;
            all += weights.at(0, i);
          }
          if (k < 3) from_weights += (1 - all) * s.background.at(k, r);
          worst.compare(pixel.at(k, r), want, kRoundoff * std::fabs(want) + kDoubleError, "ray", r,
                        "row", k);
          accumulated.compare(again.at(k, r), from_weights,
                              kRoundoff * std::fabs(from_weights) + kDoubleError, "ray", r, "row",
                              k);
        }
      EXPECT_EQ(pixel.at(3, 0), 0) << "a ray without samples";
    }
  });
  worst.report();
  accumulated.report();
}

// A derivative is the difference of what is seen and what is dimmed: the bound follows their sizes.
TEST(VolumeRendering, GradientsOfDensitiesAndColours) {
  WorstError densities("densities"), colours("colours"), weights("densities from weights");
  for_each_target([&](const std::string&) {
    for (const double most : {0.1, 30.0, 2000.0})
      for (const bool opaque_end : {false, true}) {
        const Scene s(53, most);
        Matrix w = s.alpha;
        render_weights_forward(s.rays(), opaque_end, w.data.data());
        const Matrix before(1, s.density.n), before_colour(3, s.density.n);
        Matrix d_density = before, d_colour = before_colour, d_alone = before;
        render_weights_backward(s.rays(), opaque_end, s.density.data.data(), s.delta.data.data(),
                                w.data.data(), s.dw.data.data(), d_alone.data.data());
        if (!opaque_end)
          composite_backward(s.rays(), s.density.data.data(), s.delta.data.data(), w.data.data(),
                             rows(s.colour), rows(s.background), rows(s.d_pixel),
                             d_density.data.data(), rows(d_colour));
        for (int r = 0; r < s.rays().count; ++r) {
          const int begin = s.begin[static_cast<size_t>(r)],
                    end = s.begin[static_cast<size_t>(r) + 1];
          long double depth = 0;
          for (int i = begin; i < end; ++i)
            depth += static_cast<long double>(s.density.at(0, i)) * s.interval(i);
          // What leaves sample i is found from the end, from the rounded weights, as the kernel
          // does: its error is that of their sum.
          double t = static_cast<double>(std::exp(-depth)), t_alone = t, behind = 0, alone = 0;
          for (int k = 0; k < 3; ++k)
            behind += t * s.background.at(k, r) * static_cast<double>(s.d_pixel.at(k, r));
          int last = end;
          if (opaque_end && end > begin) {
            --last;
            EXPECT_EQ(d_alone.at(0, last), 0);
            t_alone = w.at(0, last);
            alone = t_alone * s.dw.at(0, last);
          }
          for (int i = end; i-- > begin;) {
            const double weight = w.at(0, i), length = s.interval(i), g = s.toward(r, i);
            if (!opaque_end) {
              densities.compare(
                  d_density.at(0, i), length * (t * g - behind),
                  (kRoundoff * std::fabs(t * g - behind) + kDoubleError) * length + 1e-38, "ray", r,
                  "sample", i);
              for (int k = 0; k < 3; ++k) {
                const double exact = weight * s.d_pixel.at(k, r);
                colours.compare(d_colour.at(k, i), exact, kRoundoff * std::fabs(exact) + 1e-38,
                                "sample", i, "row", k);
              }
            }
            behind += weight * g;
            t = std::min(1.0, t + weight);
            if (i >= last) continue;
            const double h = s.dw.at(0, i);
            weights.compare(
                d_alone.at(0, i), length * (t_alone * h - alone),
                (kRoundoff * std::fabs(t_alone * h - alone) + kDoubleError) * length + 1e-38, "ray",
                r, "sample", i);
            alone += weight * h;
            t_alone = std::min(1.0, t_alone + weight);
          }
        }
        expect_same_outside(s, before, d_alone);
        expect_same_outside(s, before, d_density);
        expect_same_outside(s, before_colour, d_colour);
      }
  });
  densities.report();
  colours.report();
  weights.report();
}

TEST(VolumeRendering, AccumulationAddsToTheWeightsGradients) {
  WorstError weights("weights"), colours("colours");
  for_each_target([&](const std::string&) {
    const Scene s(54, 30);
    Matrix w = s.alpha;
    render_weights_forward(s.rays(), false, w.data.data());
    const Matrix before_colour(3, s.density.n);
    Matrix dw = s.dw, d_colour = before_colour, alone = s.dw, colour_alone = before_colour;
    const auto backward = [&](Real* to_weights, ColourRows<Real> to_colours) {
      accumulate_backward(s.rays(), w.data.data(), rows(s.colour), rows(s.background),
                          rows(s.d_pixel), to_weights, to_colours);
    };
    backward(dw.data.data(), rows(d_colour));
    backward(alone.data.data(), {});
    backward(nullptr, rows(colour_alone));
    for (int r = 0; r < s.rays().count; ++r)
      for (int i = s.begin[static_cast<size_t>(r)]; i < s.begin[static_cast<size_t>(r) + 1]; ++i) {
        double added = s.toward(r, i);
        for (int k = 0; k < 3; ++k) {
          added -= static_cast<double>(s.background.at(k, r)) * s.d_pixel.at(k, r);
          const double exact = static_cast<double>(w.at(0, i)) * s.d_pixel.at(k, r);
          colours.compare(d_colour.at(k, i), exact, kRoundoff * std::fabs(exact) + 1e-38, "sample",
                          i, "row", k);
          EXPECT_EQ(d_colour.at(k, i), colour_alone.at(k, i));
        }
        const double start = s.dw.at(0, i);
        weights.compare(dw.at(0, i), start + added,
                        2 * kRoundoff * (std::fabs(start) + std::fabs(added)), "sample", i);
        EXPECT_EQ(dw.at(0, i), alone.at(0, i));
      }
    expect_same_outside(s, s.dw, dw);
    expect_same_outside(s, before_colour, d_colour);
  });
  weights.report();
  colours.report();
}

}  // namespace
}  // namespace nerf
