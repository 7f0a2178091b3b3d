// Things that look alike and are not the same: the sides of a building, the two halves of a can
// whose print repeats. A mapper that takes them for one puts photos of one side on the other side.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "io/cameras/feature_database.h"
#include "nerf/math/camera.h"

namespace nerf::internal {

// A model against the verified matches of its photos.
//
// How close two photos are is told by how much of them matches, in cells of a grid; those that
// follow each other in the order of names (as most people take them) count as closer. A pair of
// close photos shows the same things. So where a model contradicts close pairs (few of their
// matches agree with its cameras), matches of pairs that are less close led it astray.
struct ModelCheck {
  int contradicted = 0;  // photos with one of their three closest partners elsewhere
  // Pairs whose rotations differ by more than 45 degrees from those along the tree of the closest
  // pairs (by the model where it agrees with these, else by their matches). Empty where none of
  // them agrees with the model, or no photo is contradicted.
  std::vector<ImageIdPair> misleading;
  std::vector<ImageIdPair> against;  // all pairs that the model contradicts
};

// Where a model has a photo.
struct PlacedPhoto {
  std::string name;  // in the database
  int number = 0;    // of the photos in their order
  Camera camera;
  Pose pose;  // camera-to-world
};

// Throw Error: a model or database that cannot be read.
ModelCheck check_model(const std::filesystem::path& model, FeatureDatabase& database);
ModelCheck check_photos(const std::vector<PlacedPhoto>& photos, FeatureDatabase& database);

}  // namespace nerf::internal
