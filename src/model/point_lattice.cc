#include "model/point_lattice.h"

#include <cmath>

namespace nerf::internal {

int32_t PointLattice::corner(const std::array<int64_t, 3>& index, Real spacing) {
  uint64_t key = 0;
  for (const int64_t i : index) key = key << 21 | (static_cast<uint64_t>(i) & 0x1fffff);
  const auto [at, is_new] = known_.try_emplace(key, static_cast<int32_t>(corners_.size()));
  if (is_new) {
    Vec3d p;
    for (int k = 0; k < 3; ++k)
      p[k] = static_cast<double>(index[static_cast<size_t>(k)]) * static_cast<double>(spacing);
    corners_.push_back(p);
  }
  return at->second;
}

bool PointLattice::surround(std::span<const Vec3d> points, Real spacing) {
  corners_.clear();
  places_.clear();
  known_.clear();
  std::array<int64_t, 3> last{};
  for (const Vec3d& p : points) {
    Place place;
    std::array<int64_t, 3> index;
    for (int k = 0; k < 3; ++k) {
      const double x = p[k] / static_cast<double>(spacing), floor = std::floor(x);
      index[static_cast<size_t>(k)] = static_cast<int64_t>(floor);
      place.within[k] = static_cast<Real>(x - floor);
    }
    if (!places_.empty() && index == last) {
      place.corner = places_.back().corner;
    } else {
      for (int64_t c = 0; c < 8; ++c)
        place.corner[static_cast<size_t>(c)] =
            corner({index[0] + (c & 1), index[1] + (c >> 1 & 1), index[2] + (c >> 2)}, spacing);
      last = index;
      if (corners_.size() >= points.size()) return false;
    }
    places_.push_back(place);
  }
  return !points.empty();
}

Vec3 PointLattice::at(size_t i, const std::vector<Vec3>& of_corners) const {
  const Place& place = places_[i];
  Vec3 sum{};
  for (size_t c = 0; c < 8; ++c) {
    Real weight = 1;
    for (int k = 0; k < 3; ++k) weight *= c >> k & 1 ? place.within[k] : 1 - place.within[k];
    sum = sum + of_corners[static_cast<size_t>(place.corner[c])] * weight;
  }
  return sum;
}

}  // namespace nerf::internal
