#include "nerf/math/step_function.h"

#include <gtest/gtest.h>

#include <cmath>
#include <span>
#include <vector>

#include "golden/golden.h"
#include "math/complex_step.h"
#include "math/worst_error.h"

namespace nerf {
namespace {

using Doubles = std::vector<double>;

// Successive parts of a golden line.
class Reader {
 public:
  explicit Reader(const Doubles& line) : line_(line) {}
  double number() { return line_.at(at_++); }
  size_t count() { return static_cast<size_t>(number()); }
  Doubles take(size_t n) {
    Doubles out(line_.begin() + static_cast<ptrdiff_t>(at_),
                line_.begin() + static_cast<ptrdiff_t>(at_ + n));
    at_ += n;
    return out;
  }

 private:
  const Doubles& line_;
  size_t at_ = 0;
};

std::vector<float> to_float(const Doubles& v) { return {v.begin(), v.end()}; }

// In double the sums of a few hundred positive terms differ from exact ones by less than this
// share.
constexpr double kExactSums = 1e-12;

TEST(StepFunction, PointsMatchGolden) {
  WorstError in_double("points"), in_float("points_share");
  for (const Doubles& line : golden_lines("sampling.txt", "points")) {
    Reader r(line);
    const size_t m = r.count(), k = r.count();
    const Doubles x = r.take(m), w = r.take(m), u = r.take(k), want = r.take(k);
    Doubles scratch(2 * m), out(k);
    resample_points<double>(x, w, u, scratch, out);
    for (size_t i = 0; i < k; ++i)
      in_double.compare(out[i], want[i], 6 * kExactSums, "m", m, "i", i);

    // In float a sample may move as far as its share of the weights may be off: m additions.
    const auto xf = to_float(x), wf = to_float(w), uf = to_float(u);
    std::vector<float> scratch_f(2 * m), out_f(k);
    resample_points<float>(xf, wf, uf, scratch_f, out_f);
    double total = 0;
    for (size_t i = 1; i + 1 < m; ++i) total += w[i] + 1e-5;
    for (size_t i = 0; i < k; ++i) {
      double below = 0, within = 0;
      for (size_t b = 1; b + 1 < m; ++b) {
        const double low = 0.5 * (x[b - 1] + x[b]), high = 0.5 * (x[b] + x[b + 1]);
        const double share = std::clamp((out_f[i] - low) / (high - low), 0.0, 1.0);
        below += share * (w[b] + 1e-5);
        // Position itself is a float of size 6: what its last place is worth here.
        if (share > 0 && share < 1) within = 6 * 2 * kFloatRoundoff / (high - low) * (w[b] + 1e-5);
      }
      in_float.compare(
          below / total, u[i],
          rounding_bound(2.0 * static_cast<double>(m), kFloatRoundoff) + within / total, "m", m,
          "i", i);
    }
  }
  in_double.report();
  in_float.report();
}

TEST(StepFunction, BlurMatchesGolden) {
  WorstError in_double("blur"), in_float("blur_float");
  for (const Doubles& line : golden_lines("sampling.txt", "blur")) {
    Reader r(line);
    const size_t n = r.count();
    const double padding = r.number();
    const Doubles w = r.take(n), want = r.take(n);
    Doubles out = w;
    blur_weights<double>(out, padding, out);  // in place
    std::vector<float> out_f = to_float(w);
    blur_weights<float>(out_f, static_cast<float>(padding), out_f);
    for (size_t i = 0; i < n; ++i) {
      in_double.compare(out[i], want[i], kExactSums, "n", n, "i", i);
      in_float.compare(out_f[i], want[i], rounding_bound(2, kFloatRoundoff) * want[i], "n", n, "i",
                       i);
    }
  }
  in_double.report();
  in_float.report();
}

TEST(StepFunction, SharesMatchGolden) {
  WorstError in_double("shares"), in_float("shares_float");
  for (const Doubles& line : golden_lines("sampling.txt", "shares")) {
    Reader r(line);
    const size_t n = r.count();
    const Doubles w = r.take(n), want = r.take(n + 1);
    Doubles out(n + 1);
    cumulative_shares<double>(w, out);
    std::vector<float> out_f(n + 1);
    cumulative_shares<float>(to_float(w), out_f);
    EXPECT_EQ(out[0], 0);
    EXPECT_EQ(out[n], 1);
    for (size_t i = 0; i <= n; ++i) {
      in_double.compare(out[i], want[i], kExactSums, "n", n, "i", i);
      in_float.compare(out_f[i], want[i],
                       rounding_bound(2.0 * static_cast<double>(n) + 3, kFloatRoundoff), "n", n,
                       "i", i);
      EXPECT_GE(out_f[i], i > 0 ? out_f[i - 1] : 0.0f);
    }
  }
  in_double.report();
  in_float.report();
}

TEST(StepFunction, DilatedWeightsMatchGolden) {
  WorstError in_double("dilate"), in_float("dilate_float");
  for (const Doubles& line : golden_lines("sampling.txt", "dilate")) {
    Reader r(line);
    const size_t n = r.count();
    const double dilation = r.number();
    const Doubles e = r.take(n + 1), w = r.take(n), want_e = r.take(3 * n + 1),
                  want = r.take(3 * n);
    Doubles edges(dilated_edges(n)), mass(3 * n);
    DilationScratch<double> scratch;
    DilationScratch<float> scratch_f;
    dilate_weights<double>(e, w, dilation, 0, 1, edges, mass, scratch);
    std::vector<float> edges_f(dilated_edges(n)), mass_f(3 * n);
    dilate_weights<float>(to_float(e), to_float(w), static_cast<float>(dilation), 0, 1, edges_f,
                          mass_f, scratch_f);
    double sum = 0, largest = 0;
    for (size_t i = 0; i < n; ++i)
      if (e[i + 1] > e[i]) largest = std::max(largest, w[i] / (e[i + 1] - e[i]));
    for (size_t i = 0; i < 3 * n; ++i) {
      in_double.compare(edges[i], want_e[i], kExactSums, "edge", i);
      in_double.compare(mass[i], want[i], 100 * kExactSums, "n", n, "weight", i);
      in_float.compare(edges_f[i], want_e[i], 2 * kFloatRoundoff, "edge", i);
      sum += mass_f[i];
      EXPECT_TRUE(std::isfinite(mass_f[i]) && mass_f[i] >= 0);
    }
    const bool empty = *std::max_element(w.begin(), w.end()) == 0;
    in_float.compare(sum, empty ? 0 : 1,
                     rounding_bound(6.0 * static_cast<double>(n), kFloatRoundoff), "sum", n);
  }
  in_double.report();
  in_float.report();
}

TEST(StepFunction, AnnealingRaisesToAPower) {
  const Doubles edges{0, 0.2, 0.2, 0.7, 1}, w{0.5, 0.3, 0, 0.2};
  Doubles out(4);
  anneal_weights<double>(edges, w, 0.5, out);
  const double total = std::sqrt(0.5) + std::sqrt(0.2);  // the second bin has no width
  EXPECT_NEAR(out[0], std::sqrt(0.5) / total, kExactSums);
  EXPECT_EQ(out[1], 0);
  EXPECT_EQ(out[2], 0);
  EXPECT_NEAR(out[3], std::sqrt(0.2) / total, kExactSums);
  // Exponent 0: every bin with a width alike, whatever it weighs.
  anneal_weights<double>(edges, w, 0, out);
  EXPECT_EQ(out, (Doubles{1.0 / 3, 0, 1.0 / 3, 1.0 / 3}));
  // Nothing at all stays nothing.
  anneal_weights<double>(edges, Doubles(4, 0.0), 0.5, out);
  EXPECT_EQ(out, Doubles(4, 0.0));
}

TEST(StepFunction, AnnealingExponentIsSchlicksBias) {
  EXPECT_EQ(annealing_exponent(0.0), 0);
  EXPECT_EQ(annealing_exponent(1.0), 1);
  EXPECT_NEAR(annealing_exponent(0.1), 10 * 0.1 / (9 * 0.1 + 1), kExactSums);
}

TEST(StepFunction, PostsLieBetweenCentresAndMirrorAtTheEnds) {
  const Doubles centres{0.2, 0.3, 0.6};
  Doubles posts(4);
  posts_around<double>(centres, 0, 1, posts);
  EXPECT_NEAR(posts[0], 0.15, kExactSums);
  EXPECT_NEAR(posts[1], 0.25, kExactSums);
  EXPECT_NEAR(posts[2], 0.45, kExactSums);
  EXPECT_NEAR(posts[3], 0.75, kExactSums);
  posts_around<double>(Doubles{0.05, 0.4, 0.95}, 0, 1, posts);
  EXPECT_EQ(posts[0], 0);  // -0.125 and 1.225 lie outside
  EXPECT_EQ(posts[3], 1);
  Doubles two(2);
  posts_around<double>(Doubles{0.4}, 0, 1, two);
  EXPECT_EQ(two, (Doubles{0, 1}));
}

TEST(StepFunction, InversionReachesBothEndsAndSkipsEmptyBins) {
  const Doubles edges{1, 2, 3, 5}, cdf{0, 0.5, 0.5, 1}, u{0, 0.25, 0.5, 0.75, 1};
  Doubles out(5);
  invert_sorted<double>(edges, cdf, u, out);
  EXPECT_EQ(out, (Doubles{1, 1.5, 3, 4, 5}));
}

// Derivatives of every output by every input: f takes and returns vectors of any scalar. Complex
// step and dual numbers agree to rounding, and a difference with what the templates give in double.
template <class F>
void check_derivatives(const char* name, const F& f, const Doubles& x) {
  WorstError value("value"), derivative("derivative"), difference("difference");
  const Doubles y = f(x);
  for (size_t i = 0; i < x.size(); ++i) {
    std::vector<Complex> complex = to_complex(x);
    complex[i] += Complex(0, kComplexStep);
    std::vector<reference::Dual> dual(x.begin(), x.end());
    dual[i].derivative = 1;
    Doubles above = x, below = x;
    const double step = 1e-5;
    above[i] += step;
    below[i] -= step;
    const auto by_complex = f(complex);
    const auto by_dual = f(dual);
    const Doubles high = f(above), low = f(below);
    for (size_t k = 0; k < y.size(); ++k) {
      const double slope = by_dual[k].derivative, size = 1 + std::fabs(slope);
      value.compare(by_complex[k].real(), y[k], 1e-14 * (1 + std::fabs(y[k])), name, "output", k);
      value.compare(by_dual[k].value, y[k], 1e-14 * (1 + std::fabs(y[k])), name, "output", k);
      derivative.compare(by_complex[k].imag() / kComplexStep, slope, 1e-11 * size, name, "output",
                         k, "input", i);
      // The step's square times a third derivative of a few hundred.
      difference.compare((high[k] - low[k]) / (2 * step), slope, 1e-7 * size, name, "output", k,
                         "input", i);
    }
  }
  value.report();
  derivative.report();
  difference.report();
}

// Inputs: five weights, then six edges; positions are drawn at fixed numbers.
TEST(StepFunction, TemplatesRunOnComplexAndDualNumbers) {
  const Doubles x = {0.3, 0.05, 0.2, 0.35, 0.15, 0, 0.11, 0.32, 0.45, 0.81, 1};
  const Doubles u = {0.07, 0.31, 0.33, 0.62, 0.97};
  const auto weights = []<class T>(const std::vector<T>& v) { return std::span(v).first(5); };
  const auto edges = []<class T>(const std::vector<T>& v) { return std::span(v).subspan(5); };
  const auto drawn = [&]<class T>(const std::vector<T>& v) {
    std::vector<T> cdf(6), at(u.begin(), u.end()), out(5);
    cumulative_shares<T>(weights(v), cdf);
    invert_sorted<T>(edges(v), cdf, at, out);
    return out;
  };
  check_derivatives("drawn", drawn, x);
  check_derivatives(
      "points",
      [&]<class T>(const std::vector<T>& v) {
        std::vector<T> at(u.begin(), u.end()), scratch(10), out(5);
        resample_points<T>(edges(v).first(5), weights(v), at, scratch, out);
        return out;
      },
      x);
  check_derivatives(
      "blurred",
      [&]<class T>(const std::vector<T>& v) {
        std::vector<T> out(5);
        blur_weights<T>(weights(v), T(0.01), out);
        return out;
      },
      x);
  check_derivatives(
      "annealed",
      [&]<class T>(const std::vector<T>& v) {
        std::vector<T> out(5);
        anneal_weights<T>(edges(v), weights(v), T(0.7), out);
        return out;
      },
      x);
  check_derivatives(
      "posts",
      [&]<class T>(const std::vector<T>& v) {
        std::vector<T> out(7);
        posts_around<T>(edges(v), T(-1), T(0.99), out);
        return out;
      },
      x);
  check_derivatives(
      "dilated",
      [&]<class T>(const std::vector<T>& v) {
        std::vector<T> out_edges(dilated_edges(5)), out(out_edges.size() - 1);
        DilationScratch<T> scratch;
        dilate_weights<T>(edges(v), weights(v), T(0.03), T(-1), T(2), out_edges, out, scratch);
        out.insert(out.end(), out_edges.begin(), out_edges.end());
        return out;
      },
      x);
}

}  // namespace
}  // namespace nerf
