// colmap's database, read and written.
#include "io/cameras/feature_database.h"

#include "io/cameras/made_database.h"
#include "support/temp_folder.h"

namespace nerf::internal {
namespace {

using test::contains;
using test::error_of;
using test::MadeDatabase;
using test::TempFolder;

TEST(FeatureDatabase, ReadsWhatColmapWrote) {
  const TempFolder folder;
  MadeDatabase made(folder / "database.db");
  const int64_t b = made.add_image("b.jpg", std::vector<uint8_t>(3 * kDescriptorBytes, 7), 2);
  const int64_t a = made.add_image("a b.jpg", {}, 1);
  FeatureDatabase database(folder / "database.db");
  const std::vector<FeatureDatabase::Image> images = database.images();
  ASSERT_EQ(images.size(), 2u);
  EXPECT_EQ(images[0].name, "a b.jpg");
  EXPECT_EQ(images[0].id, a);
  EXPECT_EQ(images[1].camera, 2);
  EXPECT_EQ(database.feature_count(b), 3);
  EXPECT_EQ(database.descriptors(b), std::vector<uint8_t>(3 * kDescriptorBytes, 7));
  EXPECT_EQ(database.feature_count(99), 0);
  EXPECT_TRUE(database.descriptors(99).empty());
}

TEST(FeatureDatabase, KeepsMatches) {
  const TempFolder folder;
  MadeDatabase made(folder / "database.db");
  for (const char* name : {"a", "b", "c"}) made.add_image(name, {});
  const std::vector<FeatureMatch> matches{{1, 2}, {70000, 3}};
  {
    FeatureDatabase database(folder / "database.db");
    database.begin();
    database.write_matches({2, 3}, {});
    database.write_matches({1, 3}, {{9, 9}});
    database.write_matches({1, 3}, matches);  // in place of the former
    database.commit();
    database.begin();
    database.write_matches({1, 2}, matches);  // not committed: as if the program was killed
  }
  FeatureDatabase database(folder / "database.db");
  EXPECT_EQ(database.matched_pairs(), (std::vector<ImageIdPair>{{1, 3}, {2, 3}}));
  EXPECT_EQ(database.matches({1, 3}), matches);
  EXPECT_TRUE(database.matches({2, 3}).empty());
  database.fill_with_no_matches();
  EXPECT_EQ(database.matched_pairs(), (std::vector<ImageIdPair>{{1, 2}, {1, 3}, {2, 3}}));
  EXPECT_EQ(database.matches({1, 3}), matches);
  // COLMAP's number of a pair: 2147483647 times the lower id plus the higher one.
  EXPECT_EQ(made.number("SELECT pair_id FROM matches WHERE rows = 2"), int64_t{2147483647} + 3);
}

TEST(FeatureDatabase, DamageIsAnErrorThatNamesTheFile) {
  const TempFolder folder;
  const auto file = folder / "database.db";
  EXPECT_TRUE(contains(error_of([&] { FeatureDatabase database(file); }), "database.db"));
  {
    MadeDatabase made(file);
    made.add_image("a", std::vector<uint8_t>(2 * kDescriptorBytes));
    made.run("UPDATE descriptors SET rows = 1000000000000");
    FeatureDatabase database(file);
    EXPECT_TRUE(contains(error_of([&] { database.descriptors(1); }), "1000000000000 x 128"));
    made.run("UPDATE descriptors SET rows = 4, cols = 64");
    EXPECT_TRUE(contains(error_of([&] { database.descriptors(1); }), "4 x 64 values"));
    made.run("UPDATE images SET image_id = -5");
    EXPECT_TRUE(contains(error_of([&] { database.images(); }), "the id -5"));
    made.run("DROP TABLE matches");
    EXPECT_TRUE(contains(error_of([&] { database.matched_pairs(); }), "no such table"));
  }
  std::ofstream(file) << std::string(5000, 'x');
  FeatureDatabase database(file);
  EXPECT_TRUE(contains(error_of([&] { database.images(); }), "not a database"));
}

}  // namespace
}  // namespace nerf::internal
