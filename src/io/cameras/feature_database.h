// Features and matches in colmap's SQLite database.
//
// Schema: COLMAP's documentation, "Database Format". Tables and columns that are used here are the
// same from version 3.8 on; what newer versions add (rigs, frames, kinds of features) is left as it
// is.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "nerf/kernels/descriptors.h"

namespace nerf::internal {

// Indices of a feature of one photo and of a feature of another.
struct FeatureMatch {
  uint32_t first, second;
  friend bool operator==(const FeatureMatch&, const FeatureMatch&) = default;
};

constexpr int64_t kFewestMatches = 15;  // of a pair: COLMAP's least number of inliers

// Where a feature is in its photo, pixels.
struct FeaturePlace {
  float x, y;
};

using ImageIdPair = std::pair<int64_t, int64_t>;  // of database ids, the lower one first

class FeatureDatabase {
 public:
  struct Image {
    int64_t id, camera;
    std::string name;
  };

  // Opens what colmap made. Every function throws Error where the file is not such a database.
  explicit FeatureDatabase(const std::filesystem::path& file);
  ~FeatureDatabase();
  FeatureDatabase(const FeatureDatabase&) = delete;
  FeatureDatabase& operator=(const FeatureDatabase&) = delete;

  std::vector<Image> images();                      // in the order of names
  int64_t feature_count(int64_t image);             // 0 where features were not looked for
  std::vector<uint8_t> descriptors(int64_t image);  // [features x kDescriptorBytes]
  std::vector<FeaturePlace> places(int64_t image);

  // Pairs that have matches already, none perhaps. Ascending.
  std::vector<ImageIdPair> matched_pairs();
  // `first` of a match is a feature of pair.first.
  void write_matches(const ImageIdPair& pair, const std::vector<FeatureMatch>& matches);
  std::vector<FeatureMatch> matches(const ImageIdPair& pair);
  // Every pair that is not among matched_pairs() gets no matches.
  void fill_with_no_matches();

  // Pairs whose matches colmap has verified, and that some are left of. Ascending.
  std::vector<ImageIdPair> verified_pairs();
  std::vector<FeatureMatch> verified_matches(const ImageIdPair& pair);
  // In place of those that are left. With none, mappers do not see the pair.
  void replace_verified_matches(const ImageIdPair& pair, const std::vector<FeatureMatch>& matches);

  // Everything written between the two appears together.
  void begin();
  void commit();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace nerf::internal
