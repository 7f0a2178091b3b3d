#include "io/cameras/lookalikes.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <numeric>
#include <optional>
#include <queue>
#include <string>
#include <tuple>
#include <unordered_set>
#include <utility>
#include <vector>

#include "io/colmap.h"
#include "math/relative_pose.h"
#include "nerf/base/text.h"
#include "nerf/math/camera_paths.h"

namespace nerf::internal {
namespace {

constexpr int kGrid = 16;             // cells along a photo's longest side
constexpr double kTolerance = 0.006;  // of a photo's longest side, in the middle of the photo
// Shares of a pair's matches from which on a model agrees with it, and up to which it contradicts.
constexpr double kAgrees = 0.6, kContradicts = 0.3;
constexpr int kPartners = 3;  // the closest of a photo
// How much closer photos are that follow each other, or have one between them.
constexpr double kNext = 2, kNextButOne = 1.5;
constexpr double kMostTurn = std::numbers::pi / 4;

struct ComparedPair {
  int first = 0, second = 0;  // photos
  double closeness = 0;
  double agreeing = 0;              // share of the matches
  Mat3d by_model;                   // rotation of second_from_first
  std::optional<Mat3d> by_matches;  // where the model contradicts
  bool agrees() const { return agreeing > kAgrees; }
  bool contradicted() const { return agreeing < kContradicts; }
};

// Directions in which both photos see what matches.
struct Sight {
  std::vector<Vec3d> first, second;
  SeenByTwo seen() const { return {first, second}; }
};

Pose second_from_first(const Pose& first, const Pose& second) {
  const Pose inverse = second.inverse();
  return {inverse.rotation * first.rotation, inverse * first.translation};
}

int longest_side(const Camera& camera) { return std::max(camera.width, camera.height); }

struct KnownPhoto : PlacedPhoto {
  int64_t id = 0;  // in the database
  std::vector<FeaturePlace> places;
};

class ModelChecker {
 public:
  ModelChecker(const std::vector<PlacedPhoto>& photos, FeatureDatabase& database)
      : database_(database) {
    std::map<std::string, int64_t> id_of;
    for (const FeatureDatabase::Image& image : database.images()) id_of[image.name] = image.id;
    for (const PlacedPhoto& photo : photos) {
      const auto it = id_of.find(photo.name);
      if (it == id_of.end()) continue;
      photo_of_[it->second] = static_cast<int>(photos_.size());
      photos_.push_back({photo, it->second, database.places(it->second)});
    }
    for (const ImageIdPair& ids : database.verified_pairs()) add(ids);
    std::ranges::sort(pairs_, [](const ComparedPair& a, const ComparedPair& b) {
      return std::tuple(-a.closeness, a.first, a.second) <
             std::tuple(-b.closeness, b.first, b.second);
    });
  }

  ModelCheck check() {
    ModelCheck check;
    check.contradicted = count_contradicted();
    for (const ComparedPair& pair : pairs_)
      if (pair.contradicted()) check.against.push_back(ids_of(pair));
    if (check.contradicted == 0) return check;
    for (ComparedPair& pair : pairs_)
      if (pair.contradicted()) {
        Sight sight;
        find_sight(pair, &sight);
        pair.by_matches = relative_rotation(sight.seen());
      }
    const std::vector<std::optional<Mat3d>> rotations = rotations_along_tree();
    bool changes_model = false;
    for (const ComparedPair& pair : pairs_) {
      const auto& first = rotations[static_cast<size_t>(pair.first)];
      const auto& second = rotations[static_cast<size_t>(pair.second)];
      const Mat3d* const own = rotation_of(pair);
      if (!first || !second || !own) continue;
      if (rotation_angle(*own, *second * first->transposed()) <= kMostTurn) continue;
      check.misleading.push_back(ids_of(pair));
      changes_model |= pair.agrees();
    }
    if (!changes_model) check.misleading.clear();
    return check;
  }

 private:
  ImageIdPair ids_of(const ComparedPair& pair) const {
    const int64_t a = photos_[static_cast<size_t>(pair.first)].id,
                  b = photos_[static_cast<size_t>(pair.second)].id;
    return {std::min(a, b), std::max(a, b)};
  }

  // Fills in directions; returns the cells that matches are in, of the photo where they are fewer.
  size_t find_sight(const ComparedPair& pair, Sight* sight) {
    const KnownPhoto& a = photos_[static_cast<size_t>(pair.first)];
    const KnownPhoto& b = photos_[static_cast<size_t>(pair.second)];
    const bool in_order = a.id < b.id;
    std::unordered_set<int64_t> cells_a, cells_b;
    for (const FeatureMatch& match : database_.verified_matches(ids_of(pair))) {
      const size_t at_a = in_order ? match.first : match.second;
      const size_t at_b = in_order ? match.second : match.first;
      if (at_a >= a.places.size() || at_b >= b.places.size()) continue;
      const auto from_a = add_cell(a, at_a, cells_a), from_b = add_cell(b, at_b, cells_b);
      if (!from_a || !from_b) continue;
      sight->first.push_back(*from_a);
      sight->second.push_back(*from_b);
    }
    return std::min(cells_a.size(), cells_b.size());
  }

  static std::optional<Vec3d> add_cell(const KnownPhoto& photo, size_t feature,
                                       std::unordered_set<int64_t>& cells) {
    const Vec2d pixel{photo.places[feature].x, photo.places[feature].y};
    const double side = static_cast<double>(longest_side(photo.camera)) / kGrid;
    cells.insert(static_cast<int64_t>(pixel.y / side) * (kGrid + 1) +
                 static_cast<int64_t>(pixel.x / side));
    const auto direction = unproject(photo.camera, pixel);
    if (!direction) return std::nullopt;
    return normalized(*direction);
  }

  void add(const ImageIdPair& ids) {
    const auto a = photo_of_.find(ids.first), b = photo_of_.find(ids.second);
    if (a == photo_of_.end() || b == photo_of_.end()) return;
    ComparedPair pair;
    std::tie(pair.first, pair.second) = std::minmax({a->second, b->second});
    Sight sight;
    const auto cells = static_cast<double>(find_sight(pair, &sight));
    if (static_cast<int64_t>(sight.first.size()) < kFewestMatches) return;
    const KnownPhoto& first = photos_[static_cast<size_t>(pair.first)];
    const KnownPhoto& second = photos_[static_cast<size_t>(pair.second)];
    const int steps = std::abs(second.number - first.number);
    pair.closeness = cells * (steps == 1 ? kNext : steps == 2 ? kNextButOne : 1);
    const Pose pose = second_from_first(first.pose, second.pose);
    pair.by_model = pose.rotation;
    const auto tolerance = [](const Camera& camera) {
      return kTolerance * longest_side(camera) / camera.fx();
    };
    pair.agreeing = explained_share(pose, sight.seen(),
                                    std::max(tolerance(first.camera), tolerance(second.camera)));
    pairs_.push_back(pair);
  }

  int count_contradicted() const {
    std::vector<int> partners(photos_.size());
    std::vector<bool> contradicted(photos_.size());
    for (const ComparedPair& pair : pairs_)
      for (const int photo : {pair.first, pair.second}) {
        const auto i = static_cast<size_t>(photo);
        if (++partners[i] <= kPartners && pair.contradicted()) contradicted[i] = true;
      }
    return static_cast<int>(std::ranges::count(contradicted, true));
  }

  // None: the model neither agrees nor contradicts, or the matches leave it open.
  static const Mat3d* rotation_of(const ComparedPair& pair) {
    if (pair.agrees()) return &pair.by_model;
    return pair.by_matches ? &*pair.by_matches : nullptr;
  }

  // World to camera, of each photo that the closest pairs connect with the first pair's.
  std::vector<std::optional<Mat3d>> rotations_along_tree() const {
    std::vector<std::vector<std::pair<int, Mat3d>>> beside(photos_.size());
    std::vector<int> group(photos_.size());
    std::iota(group.begin(), group.end(), 0);
    const auto group_of = [&](int i) {
      while (group[static_cast<size_t>(i)] != i) i = group[static_cast<size_t>(i)];
      return i;
    };
    int start = -1;
    for (const ComparedPair& pair : pairs_) {
      const Mat3d* const rotation = rotation_of(pair);
      const int a = group_of(pair.first), b = group_of(pair.second);
      if (!rotation || a == b) continue;
      if (start < 0) start = pair.first;
      group[static_cast<size_t>(std::max(a, b))] = std::min(a, b);
      beside[static_cast<size_t>(pair.first)].emplace_back(pair.second, *rotation);
      beside[static_cast<size_t>(pair.second)].emplace_back(pair.first, rotation->transposed());
    }
    std::vector<std::optional<Mat3d>> rotations(photos_.size());
    if (start < 0) return rotations;
    rotations[static_cast<size_t>(start)] = Mat3d();
    std::queue<int> found;
    for (found.push(start); !found.empty(); found.pop()) {
      const auto from = static_cast<size_t>(found.front());
      for (const auto& [to, rotation] : beside[from]) {
        auto& there = rotations[static_cast<size_t>(to)];
        if (there) continue;
        there = rotation * *rotations[from];
        found.push(to);
      }
    }
    return rotations;
  }

  FeatureDatabase& database_;
  std::vector<KnownPhoto> photos_;
  std::map<int64_t, int> photo_of_;  // by id in the database
  std::vector<ComparedPair> pairs_;  // the closest first
};

}  // namespace

ModelCheck check_photos(const std::vector<PlacedPhoto>& photos, FeatureDatabase& database) {
  return ModelChecker(photos, database).check();
}

ModelCheck check_model(const std::filesystem::path& folder, FeatureDatabase& database) {
  if (database.verified_pairs().empty()) return {};
  const ColmapModel model = read_colmap_model(folder);
  std::vector<PlacedPhoto> photos;
  for (const ColmapImage& image : model.images)
    photos.push_back({image.name, 0, model.cameras[static_cast<size_t>(image.camera)], image.pose});
  std::ranges::sort(photos, natural_less, &PlacedPhoto::name);
  for (size_t i = 0; i < photos.size(); ++i) photos[i].number = static_cast<int>(i);
  return check_photos(photos, database);
}

}  // namespace nerf::internal
