#include "nerf/kernels/sample_groups.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "kernels/kernel_test.h"
#include "math/worst_error.h"

namespace nerf {
namespace {

constexpr int kRows = 37;  // more than are summed at a time

// Groups of 1 to `longest` samples; of every third one the last sample counts for nothing.
struct Case {
  Case(int64_t samples, int longest) : n(samples) {
    Random random(7, static_cast<uint64_t>(samples), static_cast<uint64_t>(longest));
    const size_t padded = static_cast<size_t>(round_up(n, kLane));
    of.assign(padded, 0);
    share.assign(padded, 0);
    per_light.assign(padded, 0);
    int left = 0;
    for (size_t i = 0; i < padded; ++i) {
      const bool used = static_cast<int64_t>(i) < n;
      if (used && left == 0) {
        left = 1 + static_cast<int>(random.below(static_cast<uint64_t>(longest)));
        ++count;
      }
      of[i] = std::max(count - 1, 0);
      if (!used) continue;
      --left;
      if (left == 0 && count % 3 == 0) continue;
      share[i] = uniform(random, 0.01, 1);
      per_light[i] = uniform(random, 1, 100);
    }
    x = Matrix(kRows, n, random, -1, 1);
    dy = Matrix(kRows, n, random, -1, 1);
    y = Matrix(kRows, n, random, -1, 1);
  }
  SampleGroups groups() const { return {n, count, of.data(), share.data(), per_light.data()}; }

  int64_t n;
  int count = 0;
  std::vector<int32_t> of;
  std::vector<Real> share, per_light;
  Matrix x{kRows, 0}, y{kRows, 0}, dy{kRows, 0};
};

template <class Body>
void for_each_case(const Body& body) {
  for (const int64_t n : kCounts)
    for (const int longest : {1, 3, 7, 40, 500}) {
      SCOPED_TRACE("samples " + std::to_string(n) + " longest " + std::to_string(longest));
      const Case c(n, longest);
      for_each_target([&](const std::string&) { body(c); });
    }
}

// A product, four sums within a vector of samples and, of the first two vectors, five more; then a
// sum in double, rounded: 11, or fewer where there are few samples.
TEST(SampleGroups, MeansAreThoseOfSumsInDouble) {
  WorstError worst("mean_of_groups");
  for_each_case([&](const Case& c) {
    Matrix got = c.y;
    mean_of_groups_forward(c.groups(), kRows, c.x.data.data(), c.x.ld, got.data.data(), got.ld);
    got.expect_untouched_beyond_padding();
    for (int k = 0; k < kRows; ++k) {
      std::vector<double> sum(static_cast<size_t>(c.count)), size(sum.size());
      const double n = static_cast<double>(c.n);
      const double bound = kRoundoff * std::min(n + 1, 11.0) + n * kDoubleRoundoff;
      for (int64_t i = 0; i < c.n; ++i) {
        const size_t s = static_cast<size_t>(i), g = static_cast<size_t>(c.of[s]);
        const double term = static_cast<double>(c.share[s]) * static_cast<double>(c.x.at(k, i));
        sum[g] += term;
        size[g] += std::fabs(term);
      }
      for (int g = 0; g < c.count; ++g)
        worst.compare(got.at(k, g), sum[static_cast<size_t>(g)],
                      bound * size[static_cast<size_t>(g)], "row", k, "group", g);
      for (int64_t g = c.count; g < round_up(c.count, kLane); ++g) EXPECT_EQ(got.at(k, g), 0) << g;
    }
  });
  worst.report();
}

TEST(SampleGroups, GradientsAddToWhatIsThere) {
  WorstError worst("mean_of_groups_backward");
  for_each_case([&](const Case& c) {
    for (const bool of_weights : {true, false})
      for (const bool of_x : {true, false}) {
        Random random(3, 3, 3);
        Matrix dw(1, c.n, random, -1, 1), dx(kRows, c.n, random, -1, 1);
        const Matrix dw_before = dw, dx_before = dx;
        mean_of_groups_backward(c.groups(), kRows, c.x.data.data(), c.x.ld, c.y.data.data(),
                                c.dy.data.data(), c.y.ld, of_weights ? dw.data.data() : nullptr,
                                of_x ? dx.data.data() : nullptr);
        for (int64_t i = 0; i < c.n; ++i) {
          const size_t s = static_cast<size_t>(i);
          double want = dw_before.at(0, i), size = std::fabs(want);
          for (int k = 0; k < kRows; ++k) {
            const double slope = c.dy.at(k, c.of[s]), x = c.x.at(k, i), mean = c.y.at(k, c.of[s]);
            const double per_light = of_weights ? static_cast<double>(c.per_light[s]) : 0;
            want += per_light * slope * (x - mean);
            size += per_light * std::fabs(slope) * (std::fabs(x) + std::fabs(mean));
            const double share = of_x ? static_cast<double>(c.share[s]) : 0;
            const double before = dx_before.at(k, i);
            worst.compare(dx.at(k, i), before + share * slope,
                          2 * kRoundoff * (std::fabs(before) + std::fabs(share * slope)), "dx", k,
                          "sample", i);
          }
          worst.compare(dw.at(0, i), want, (kRows + 4) * kRoundoff * size, "dw", i);
        }
        dw.expect_untouched_beyond_padding();
        dx.expect_untouched_beyond_padding();
      }
  });
  worst.report();
}

}  // namespace
}  // namespace nerf
