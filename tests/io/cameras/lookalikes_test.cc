// A walk around a can whose print repeats on its other side.
#include "io/cameras/lookalikes.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "io/cameras/can_walk.h"

namespace nerf::internal {
namespace {

using test::CanWalk;
using test::MadeDatabase;
using test::TempFolder;

class Lookalikes : public ::testing::Test {
 protected:
  template <class F>
  ModelCheck check(F&& stands_at) {
    CanWalk::write_model(folder_ / "model", stands_at);
    FeatureDatabase database(folder_ / "database.db");
    return check_model(folder_ / "model", database);
  }

  TempFolder folder_;
};

TEST_F(Lookalikes, WhatFoldsAWalkRoundACanIsFound) {
  CanWalk::write_database(folder_ / "database.db", true);
  const ModelCheck folded = check([](int i) { return i % CanWalk::kHalf; });
  // At the two places where the walk jumps back, some photos on either side.
  EXPECT_GE(folded.contradicted, 4);
  EXPECT_LE(folded.contradicted, 12);
  FeatureDatabase database(folder_ / "database.db");
  std::vector<ImageIdPair> across;
  for (const ImageIdPair& pair : database.verified_pairs()) {
    const int64_t steps = pair.second - pair.first;
    if (std::min(steps, CanWalk::kPhotos - steps) > CanWalk::kHalf / 2) across.push_back(pair);
  }
  ASSERT_GT(across.size(), 100u);
  std::vector<ImageIdPair> misleading = folded.misleading;
  std::ranges::sort(misleading);
  EXPECT_EQ(misleading, across);
}

TEST_F(Lookalikes, ARightModelStaysAsItIs) {
  CanWalk::write_database(folder_ / "database.db", true);
  const ModelCheck right = check([](int i) { return i; });
  EXPECT_EQ(right.contradicted, 0);
  EXPECT_TRUE(right.misleading.empty());
}

TEST_F(Lookalikes, WherePhotosAreInWrongPlacesWithoutAnythingThatMisledNothingIsTakenAway) {
  CanWalk::write_database(folder_ / "database.db", false);
  EXPECT_EQ(check([](int i) { return i; }).contradicted, 0);
  const ModelCheck swapped = check([](int i) { return i == 3 ? 23 : i; });
  EXPECT_GE(swapped.contradicted, 1);
  EXPECT_TRUE(swapped.misleading.empty());
}

TEST_F(Lookalikes, ADatabaseWithoutVerifiedPairsNeedsNoModel) {
  {
    MadeDatabase made(folder_ / "database.db");
  }
  FeatureDatabase database(folder_ / "database.db");
  EXPECT_EQ(check_model(folder_ / "nowhere", database).contradicted, 0);
}

}  // namespace
}  // namespace nerf::internal
