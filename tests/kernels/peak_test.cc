// The loops that measure a machine's ceilings do the work that they are timed for.
#include "nerf/kernels/peak.h"

#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "nerf/base/aligned.h"
#include "nerf/kernels/simd.h"

namespace nerf {
namespace {

class Peak : public ::testing::TestWithParam<std::string> {
 protected:
  void SetUp() override { force_simd_target(GetParam()); }
  void TearDown() override { force_simd_target(""); }
};

TEST_P(Peak, CountsTheMultiplyAdds) {
  float sink = 0;
  const int64_t once = fma_loop(1, &sink);
  EXPECT_GT(once, 0);
  EXPECT_EQ(once % 2, 0);
  EXPECT_EQ(fma_loop(1000, &sink), 1000 * once);
  // Twelve chains in each lane have run to 1.
  EXPECT_FLOAT_EQ(sink, static_cast<float>(once / 2));
}

TEST_P(Peak, ReadsEveryValueOnce) {
  AlignedArray<float> x(3 * kReadUnit);
  for (size_t i = 0; i < x.size(); ++i) x[i] = static_cast<float>(i);
  const float n = static_cast<float>(x.size());
  EXPECT_EQ(read_loop(static_cast<int64_t>(x.size()), x.data()), n * (n - 1) / 2);
}

TEST_P(Peak, ReadsRowsAllOverTheTable) {
  // Rows that are 0 but for the second half's: about half of the reads meet a 1 per feature.
  constexpr int64_t kRows = 1 << 12, kReads = 1 << 14;
  AlignedArray<float> table(4 * kRows);
  for (size_t i = table.size() / 2; i < table.size(); ++i) table[i] = 1;
  for (const uint32_t salt : {0u, 12345u}) {
    const double share = random_row_loop(kRows, table.data(), kReads, salt) / (4.0 * kReads);
    EXPECT_NEAR(share, 0.5, 5 * 0.5 / std::sqrt(kReads)) << salt;
  }
}

INSTANTIATE_TEST_SUITE_P(Targets, Peak, ::testing::ValuesIn(simd_targets()),
                         [](const auto& info) { return info.param; });

}  // namespace
}  // namespace nerf
