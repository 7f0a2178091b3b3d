// The loops that measure a machine's ceilings do the work that they are timed for.
#include "nerf/kernels/peak.h"

#include <cmath>

#include "kernel_test.h"

namespace nerf {
namespace {

TEST(Peak, CountsTheMultiplyAdds) {
  for_each_target([](const std::string&) {
    Real sink = 0;
    const int64_t once = fma_loop(1, &sink);
    EXPECT_GT(once, 0);
    EXPECT_EQ(fma_loop(1000, &sink), 1000 * once);
    // All chains have run to 1 in each lane.
    EXPECT_FLOAT_EQ(sink, static_cast<Real>(once / 2));
  });
}

TEST(Peak, CountsThePairsOfBf16) {
  for_each_bf16_unit([](Bf16Unit unit) {
    Real none = 0, sink = 0;
    EXPECT_EQ(bf16_loop(0, &none), 0);
    const int64_t once = bf16_loop(1, &sink);
    EXPECT_GT(once, 0);
    EXPECT_EQ(bf16_loop(1024, &sink), 1024 * once);
    // On AVX-512 every product of the FLOPs counted, 1 times 2^-11, is in the sum, which is exact;
    // on AMX it is of zeros.
    const double grown = static_cast<double>(sink) - static_cast<double>(none);
    const double products = 1024 * static_cast<double>(once / 2);
    EXPECT_EQ(grown, unit == Bf16Unit::kAvx512 ? products * 0x1p-11 : 0);
  });
  // Without a unit there is nothing to measure.
  const Bf16Unit before = bf16_unit();
  force_bf16_unit(Bf16Unit::kNone);
  Real sink = 0;
  EXPECT_THROW(bf16_loop(1, &sink), Error);
  force_bf16_unit(before);
}

TEST(Peak, ReadsEveryValueOnce) {
  for_each_target([](const std::string&) {
    AlignedArray<Real> x(3 * kReadUnit);
    for (size_t i = 0; i < x.size(); ++i) x[i] = static_cast<Real>(i);
    const Real n = static_cast<Real>(x.size());
    EXPECT_EQ(read_loop(static_cast<int64_t>(x.size()), x.data()), n * (n - 1) / 2);
  });
}

TEST(Peak, ReadsRowsAllOverTheTable) {
  // The second half of the rows holds ones: about half of the reads meet them.
  constexpr int64_t kRows = 1 << 12, kReads = 1 << 14;
  AlignedArray<Real> table(4 * kRows);
  for (size_t i = table.size() / 2; i < table.size(); ++i) table[i] = 1;
  for_each_target([&](const std::string&) {
    for (const uint32_t salt : {0u, 12345u}) {
      const double share = random_row_loop(kRows, table.data(), kReads, salt) / (4.0 * kReads);
      EXPECT_NEAR(share, 0.5, 5 * 0.5 / std::sqrt(kReads)) << salt;
    }
  });
}

}  // namespace
}  // namespace nerf
